/* An engine as the source of a driver's queue. */
#include <math.h>
#include <string.h>

#include "haptix_native.h"

enum { POINTS = 1 << 13, UNDER_WAY = 32, STATUSES = 16 };

typedef struct {
    int64_t first, count; /* points */
    double before_v[HX_POINTS];
} revision;

struct hx_live {
    hx_engine *engine;
    double rate_hz, reaction_s, ahead_s; /* clock of touches minus that of samples */
    int64_t step;
    int64_t end;                  /* points of which the amplitude is known */
    double amplitude_v[POINTS];   /* at the end of each point's step, in a ring; [0]: before the first */
    revision under_way[UNDER_WAY];
    int64_t first_under_way, under_way_count;
    double updated_s, driven_until_s;
    hx_live_counts counts, shown; /* to other threads */
    char is_change_held;     /* by the thread that writes or reads what stands around it */
    int64_t has_mix;
    hx_mix mix;
    hx_engine *adopted;      /* plays from the next window on; or NULL */
};

int64_t hx_live_bytes(void) { return (int64_t)sizeof(hx_live); }

void hx_live_init(hx_live *l, hx_engine *engine, double reaction_s)
{
    memset(l, 0, sizeof *l);
    l->engine = engine;
    l->reaction_s = reaction_s;
    l->end = 1;
    l->ahead_s = NAN;
    l->updated_s = l->driven_until_s = -INFINITY;
    hx_engine_rate(engine, &l->rate_hz, &l->step);
}

static double *at(hx_live *l, int64_t point) { return &l->amplitude_v[point % POINTS]; }

static revision *under_way(hx_live *l, int64_t place)
{
    return &l->under_way[(l->first_under_way + place) % UNDER_WAY];
}

/* The other threads hold it while they copy a change; the one that plays never waits for it. */
static void hold(hx_live *l)
{
    while (__atomic_test_and_set(&l->is_change_held, __ATOMIC_ACQUIRE)) {
    }
}

static void let_go(hx_live *l) { __atomic_clear(&l->is_change_held, __ATOMIC_RELEASE); }

void hx_live_mix(hx_live *l, const hx_mix *mix)
{
    hold(l);
    l->mix = *mix;
    l->has_mix = 1;
    let_go(l);
}

void hx_live_adopt(hx_live *l, hx_engine *engine, const hx_mix *mix)
{
    hold(l);
    hx_engine_match(engine, l->engine);
    l->adopted = engine;
    l->mix = *mix;
    l->has_mix = 1;
    let_go(l);
}

int64_t hx_live_needs(hx_live *l, const hx_engine *engine)
{
    hold(l);
    int64_t is_needed = engine == l->engine || engine == l->adopted;
    let_go(l);
    return is_needed;
}

int64_t hx_live_has_taken(hx_live *l)
{
    hold(l);
    int64_t has_taken = !l->has_mix;
    let_go(l);
    return has_taken;
}

/* Take over what has changed, unless it is being written; then the next window does. */
static void take_change(hx_live *l)
{
    if (__atomic_test_and_set(&l->is_change_held, __ATOMIC_ACQUIRE))
        return;
    if (l->adopted) {
        hx_engine_follow(l->adopted, l->engine);
        l->engine = l->adopted;
    }
    l->adopted = NULL;
    if (l->has_mix)
        hx_engine_mix(l->engine, &l->mix);
    l->has_mix = 0;
    let_go(l);
}

void hx_live_window(void *live, int64_t first, int64_t count, double at_s, int64_t is_revision,
                    double *volts)
{
    hx_live *l = live;
    int64_t point = first / l->step, points = count / l->step;
    l->ahead_s = at_s - (double)first / l->rate_hz;
    take_change(l);
    revision *r = under_way(l, l->under_way_count);
    if (is_revision) { /* its length is at most that of a block */
        points = points < HX_POINTS ? points : HX_POINTS;
        r->first = point + 1;
        r->count = points;
        for (int64_t i = 0; i < points; i++)
            r->before_v[i] = *at(l, point + 1 + i);
        if (l->under_way_count < UNDER_WAY)
            l->under_way_count++;
        l->updated_s = (double)first / l->rate_hz;
    }
    while (points > 0) {
        int64_t n = points < HX_POINTS ? points : HX_POINTS;
        const hx_felt *felt = hx_engine_window(l->engine, point * l->step, n, *at(l, point),
                                               is_revision ? r->before_v : NULL, is_revision);
        for (int64_t i = 0; i < n; i++) {
            *at(l, point + 1 + i) = felt->amplitude_v[i];
            if (felt->amplitude_v[i] > l->counts.most_v)
                l->counts.most_v = felt->amplitude_v[i];
        }
        memcpy(volts, felt->drive_v, sizeof(double) * (size_t)(n * l->step));
        for (int64_t i = 0; i < felt->fingers * n; i++)
            l->counts.status[felt->status[i] & (STATUSES - 1)] += l->step;
        l->counts.samples += n * l->step;
        double until_s = (double)((point + n) * l->step) / l->rate_hz;
        if (felt->fingers && until_s > l->driven_until_s)
            l->driven_until_s = until_s;
        volts += n * l->step;
        point += n;
        points -= n;
    }
    if (!__atomic_test_and_set(&l->is_change_held, __ATOMIC_ACQUIRE)) {
        l->shown = l->counts;
        let_go(l);
    }
    if (point + 1 > l->end)
        l->end = point + 1;
}

void hx_live_settle(void *live, int64_t obeyed, int64_t undone)
{
    hx_live *l = live;
    obeyed = obeyed < l->under_way_count ? obeyed : l->under_way_count;
    l->first_under_way = (l->first_under_way + obeyed) % UNDER_WAY;
    l->under_way_count -= obeyed;
    while (undone && l->under_way_count > 0) {
        const revision *r = under_way(l, --l->under_way_count);
        for (int64_t i = 0; i < r->count; i++)
            *at(l, r->first + i) = r->before_v[i];
    }
}

void hx_live_played(void *live, int64_t index)
{
    (void)live; /* the ring forgets what is older than its length */
    (void)index;
}

void hx_live_report(void *live, int64_t touch_id, int64_t is_down, double arrival_s, double t_s,
                    double x_mm, double y_mm, double force_n)
{
    hx_live *l = live;
    if (isnan(l->ahead_s))
        return; /* nothing plays yet */
    hx_engine_playable(l->engine, arrival_s + l->reaction_s - l->ahead_s);
    hx_engine_touch(l->engine, touch_id, t_s - l->ahead_s, x_mm, y_mm, force_n, is_down);
}

int64_t hx_live_is_live(void *live)
{
    const hx_live *l = live;
    return hx_engine_is_touched(l->engine) || l->updated_s < l->driven_until_s;
}

void hx_live_count(hx_live *l, hx_live_counts *counts)
{
    hold(l);
    *counts = l->shown;
    let_go(l);
}
