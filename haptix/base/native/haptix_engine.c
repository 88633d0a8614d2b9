/* Plays a program of a touch: fingers, regions, materials, samples. */
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "haptix_program.h"

enum { PLACES = HX_FINGERS * HX_POINTS, ROWS = 13, KEPT = 4 };

static const double first_interval_s = 1.0 / 60; /* as haptix.play.touch.touches */
static const double joined_s = 0.002;    /* as haptix.play.render.samples */
static const double slow_mm_s = 2.0;     /* as haptix.feel.motion.block.SLOW_MM_PER_S */
static const double felt_gain = 0.5;     /* as haptix.play.render.master */
static const int64_t most_bytes = 1 << 30;
static const double lightest_n = 1e-3, hardest_n = 100.0, latest_s = 1e10, largest_mm = 1e4;

typedef struct {
    int64_t id, is_used, is_down, is_known, is_new; /* is_known: its track has been played */
    hx_tracker tracker;
    double force_n;
    int64_t is_force_known;
    hx_touched reported; /* the last report, or is_down 0 */
    int64_t recalled;    /* facts that are kept, of KEPT */
    hx_track track; /* as it has been predicted since the last block that knew of news */
} touch;

struct hx_engine {
    hx_program program;
    int64_t multiplies, has_priorities, converts, fades;
    double step_s, before_v;
    double playable_s; /* from when on a report can still change what happens */
    int64_t sample; /* the first of the next block */
    int64_t at_rest; /* whether fingers at rest got drive in the last block */
    hx_mix mix;
    double lag_s; /* clock of samples less that of the scene, at the last block */
    double intensity[HX_POINTS];
    touch touches[HX_FINGERS];
    int64_t order[HX_FINGERS], down; /* touches in the order in which they came */
    double interval_s;               /* of reports of the last touch that has ended */
    hx_felt felt;
    int8_t status[PLACES];
    double row[ROWS][PLACES];       /* space to compute in */
    double moved[(4 * HX_FINGERS + 1) * HX_POINTS + 3 * HX_FINGERS + 1];
    double friction[PLACES];
    hx_facts *facts;  /* [HX_FINGERS][KEPT][1 + regions], of all and of each region; or NULL */
    int8_t force_known[HX_FINGERS];
    double *seen;     /* rows for hx_feel, behind the numbers */
    double numbers[]; /* of hx_render: PLACES + HX_POINTS + HX_POINTS * step */
};

/* What the rows hold. */
enum { X, Y, VX, VY, VALUE, LOWEST, HIGHEST, LOCAL_X, LOCAL_Y, LOCAL_VX, LOCAL_VY, COVER, FELT };

static int64_t facts_of(const uint8_t *program)
{
    int64_t regions = program[56] | (int64_t)program[57] << 8 | (int64_t)program[58] << 16 |
                      (int64_t)program[59] << 24;
    return hx_program_recalls(program) ? HX_FINGERS * KEPT * (1 + regions) : 0;
}

static int64_t own_size(int64_t step, int64_t depth, int64_t facts)
{
    int64_t numbers = PLACES + HX_POINTS * (1 + step) + PLACES * HX_SEEN_ROWS * depth;
    return ((int64_t)offsetof(struct hx_engine, numbers) + 8 * numbers + 7) / 8 * 8 +
           facts * (int64_t)sizeof(hx_facts);
}

static int64_t step_of(const uint8_t *program)
{
    return program[20] | (int64_t)program[21] << 8; /* the check has found it to be small */
}

int64_t hx_engine_size(const uint8_t *program, int64_t size)
{
    return hx_engine_size_after(program, size, NULL);
}

int64_t hx_engine_size_after(const uint8_t *program, int64_t size, const hx_engine *before)
{
    int64_t contents = hx_program_size(program, size, before ? &before->program : NULL);
    if (contents < 0)
        return contents;
    contents += own_size(step_of(program), hx_program_depth(program), facts_of(program));
    return contents > most_bytes ? HX_TOO_LARGE : contents;
}

hx_engine *hx_engine_open(const uint8_t *program, int64_t size, void *memory)
{
    (void)size;
    return hx_engine_open_after(program, memory, NULL);
}

hx_engine *hx_engine_open_after(const uint8_t *program, void *memory, const hx_engine *before)
{
    hx_engine *e = memory;
    memset(e, 0, sizeof *e);
    int64_t step = step_of(program), depth = hx_program_depth(program);
    int64_t facts = facts_of(program), size_of_all = own_size(step, depth, facts);
    hx_program_read(program, &e->program, (uint8_t *)memory + size_of_all, before ? &before->program : NULL);
    e->seen = e->numbers + PLACES + HX_POINTS * (1 + step);
    if (facts)
        e->facts = (hx_facts *)(void *)((uint8_t *)memory + size_of_all) - facts;
    const hx_program *p = &e->program;
    e->step_s = (double)p->rendering.step / p->sample_rate_hz;
    e->interval_s = first_interval_s;
    e->at_rest = p->drives_at_rest;
    e->mix.before = e->mix.after = 1.0;
    e->mix.start_s = e->mix.end_s = -INFINITY;
    e->mix.stands_s = NAN;
    e->program.rendering.joined = (int64_t)hx_most(1.0, joined_s / e->step_s + 0.5);
    for (int64_t i = 0; i < p->regions; i++) {
        e->multiplies |= p->region[i].blend == BLEND_MULTIPLY;
        e->has_priorities |= p->region[i].priority != 0;
        e->fades |= hx_feels_rest(p, p->region[i].material);
    }
    e->converts = e->fades;
    for (int64_t i = 0; i < p->materials; i++)
        e->converts |= p->material[i].target != p->rendering.target;
    return e;
}

static int is_near(double x_mm, double y_mm)
{
    return fabs(x_mm) <= HX_FARTHEST_MM && fabs(y_mm) <= HX_FARTHEST_MM; /* false for NaN */
}

/* Convert numbers of a material to the target of all; beside a region that drives fingers at rest
 * they fade out at rest. See Layout._converted. */
static void convert(const hx_engine *e, int64_t material, const hx_motion *on, double *value)
{
    const hx_program *p = &e->program;
    int64_t from = p->material[material].target, to = p->rendering.target;
    int fades = e->fades && !hx_feels_rest(p, material);
    if (from == to && !fades)
        return;
    for (int64_t i = 0; i < on->fingers * on->points; i++) {
        double speed = hx_length(on->vx_mm_s[i], on->vy_mm_s[i]);
        double share = fades ? hx_least(sqrt(2.0) * speed / hx_length(speed, slow_mm_s), 1.0) : 1.0;
        if (from == to && to != TARGET_MU) {
            value[i] *= share;
            continue;
        }
        double lowest = e->row[LOWEST][i], highest = e->row[HIGHEST][i];
        double mu = hx_as_mu(from, value[i], lowest, highest);
        mu = fades ? lowest + (mu - lowest) * share : mu;
        value[i] = to == TARGET_MU         ? mu
                   : to == TARGET_CONTRAST ? mu / lowest - 1
                                           : (mu - lowest) / hx_most(highest - lowest, 1e-12);
    }
}

/* Regions. */

/* Share of a line that is done at a time. */
static double done(double start_s, double end_s, double t_s)
{
    return end_s > start_s ? hx_least(hx_most((t_s - start_s) / (end_s - start_s), 0.0), 1.0)
                           : (double)(t_s >= end_s);
}

/* A number of a glide at a time; see Glide.at. */
static double glided(double before, double after, double start_s, double end_s, double t_s)
{
    if (t_s >= end_s)
        return after;
    return t_s <= start_s ? before : before + (t_s - start_s) / (end_s - start_s) * (after - before);
}

/* A step from 0 to 1, as a ramp around a depth of 0. */
static double ramp_at(double depth_mm, double ramp_mm)
{
    return hx_least(hx_most(0.5 + depth_mm / ramp_mm, 0.0), 1.0);
}

/* Distance to the nearest edge of a polygon, below 0 outside. */
static double depth_in(const hx_region *r, double x, double y)
{
    double nearest = INFINITY;
    int is_inside = 0;
    const double *before = r->corner_mm + 2 * (r->corners - 1);
    for (int64_t i = 0; i < r->corners; i++) {
        const double *corner = r->corner_mm + 2 * i;
        double dx = corner[0] - before[0], dy = corner[1] - before[1];
        double along = ((x - before[0]) * dx + (y - before[1]) * dy) / hx_most(dx * dx + dy * dy, 1e-300);
        along = hx_least(hx_most(along, 0.0), 1.0);
        nearest = hx_least(nearest, hx_length(x - before[0] - along * dx, y - before[1] - along * dy));
        if (dy != 0.0 && (before[1] > y) != (corner[1] > y)) /* a ray to the right crosses it */
            is_inside ^= x < before[0] + (y - before[1]) * dx / dy;
        before = corner;
    }
    return is_inside ? nearest : -nearest;
}

/* Share of a place that is inside a region, see Outline.cover. */
static double covered(const hx_region *r, double x, double y, double ramp_mm)
{
    double ramp = hx_most(ramp_mm, 1e-9), width = r->width_mm, height = r->height_mm;
    if (r->shape == SHAPE_RECTANGLE)
        return (ramp_at(x, ramp) - ramp_at(x - width, ramp)) *
               (ramp_at(y, ramp) - ramp_at(y - height, ramp));
    if (r->shape == SHAPE_POLYGON)
        return ramp_at(depth_in(r, x, y), ramp);
    double a = width / 2, b = height / 2;
    double depth = (1 - hx_length(x / a - 1, y / b - 1)) * hx_least(a, b);
    return ramp_at(hx_least(depth, hx_least(a - fabs(x - a), b - fabs(y - b))), ramp);
}

/* Places or velocities in the axes of a region, whose corner is x0, y0. */
static void see(const hx_region *r, const double *x, const double *y, double x0, double y0,
                int64_t n, double *to_x, double *to_y)
{
    double c = cos(r->angle_rad) / r->scale, s = sin(r->angle_rad) / r->scale;
    for (int64_t i = 0; i < n; i++) {
        double dx = x[i] - x0, dy = y[i] - y0;
        to_x[i] = r->angle_rad == 0.0 ? dx / r->scale : dx * c + dy * s;
        to_y[i] = r->angle_rad == 0.0 ? dy / r->scale : dy * c - dx * s;
    }
}

static void turn(double *x, double *y, double angle_rad, double scale)
{
    double c = angle_rad == 0.0 ? 1.0 : cos(angle_rad), s = angle_rad == 0.0 ? 0.0 : sin(angle_rad);
    double dx = *x, dy = *y;
    *x = (dx * c + dy * s) / scale;
    *y = (dy * c - dx * s) / scale;
}

/* The fingers in the axes of a region that glides, in the rows of local places and velocities;
 * see RegionState.axes and Motion.seen_from. Return the footprint. */
static double see_gliding(hx_engine *e, const hx_region *r, const hx_motion *screen)
{
    const hx_glide *g = &r->glide;
    double to[4] = {r->x_mm, r->y_mm, r->angle_rad, r->scale}, change[4];
    double *x = e->row[LOCAL_X], *y = e->row[LOCAL_Y], *vx = e->row[LOCAL_VX], *vy = e->row[LOCAL_VY];
    double span_s = g->place_end_s - g->place_start_s, fastest = 0.0, first_s = screen->start_s;
    double last_s = first_s + screen->step_s * (double)screen->points;
    int is_within = g->place_start_s <= first_s && last_s <= g->place_end_s, is_still = is_within;
    for (int k = 0; k < 4; k++) {
        change[k] = to[k] - g->place[k];
        is_still &= change[k] == 0.0;
    }
    for (int64_t i = 0; i < screen->fingers * screen->points; i++) {
        double t_s = first_s + screen->step_s * (double)(i % screen->points + 1);
        double part = is_within ? (t_s - g->place_start_s) / span_s
                                : done(g->place_start_s, g->place_end_s, t_s);
        int moves = is_within || (part > 0.0 && part < 1.0);
        double rate = moves && span_s > 0.0 ? 1.0 / span_s : 0.0, at[4];
        for (int k = 0; k < 4; k++)
            at[k] = g->place[k] + part * change[k];
        double growth = rate * change[3] / at[3], turning = rate * change[2];
        x[i] = screen->x_mm[i] - at[0];
        y[i] = screen->y_mm[i] - at[1];
        vx[i] = screen->vx_mm_s[i] - rate * change[0] + turning * y[i] - growth * x[i];
        vy[i] = screen->vy_mm_s[i] - rate * change[1] - turning * x[i] - growth * y[i];
        turn(&x[i], &y[i], at[2], at[3]);
        turn(&vx[i], &vy[i], at[2], at[3]);
        fastest = hx_most(hx_length(vx[i], vy[i]), fastest);
    }
    if (is_still)
        return screen->footprint_mm / r->scale;
    return screen->footprint_mm > 0.0 ? fastest * screen->step_s : 0.0;
}

/* Left, right, top and bottom of the places of the fingers. */
static void around(const hx_motion *on, double *box)
{
    box[0] = box[2] = INFINITY;
    box[1] = box[3] = -INFINITY;
    for (int64_t i = 0; i < on->fingers * on->points; i++) {
        box[0] = hx_least(on->x_mm[i], box[0]);
        box[1] = hx_most(on->x_mm[i], box[1]);
        box[2] = hx_least(on->y_mm[i], box[2]);
        box[3] = hx_most(on->y_mm[i], box[3]);
    }
}

static double blended(int64_t blend, double below, double felt)
{
    switch (blend) {
    case BLEND_ADD: return below + felt;
    case BLEND_MULTIPLY: return below * felt;
    case BLEND_MAX: return hx_most(below, felt);
    case BLEND_MIN: return hx_least(below, felt);
    default: return felt;
    }
}

static int has_inner(const hx_glide *g)
{
    return g->inner[0] != 0.0 || g->inner[1] != 0.0 || g->inner[2] != 0.0 || g->inner[3] != 1.0;
}

static void lay(hx_engine *e, const hx_region *r, const hx_motion *screen)
{
    const hx_program *p = &e->program;
    double *value = e->row[VALUE], *cover = e->row[COVER], *felt = e->row[FELT];
    double *x = e->row[LOCAL_X], *y = e->row[LOCAL_Y], within_mm = screen->footprint_mm / r->scale;
    int64_t n = screen->fingers * screen->points, is_on = 0, is_inside = 0;
    const hx_glide *g = &r->glide;
    int glides = screen->start_s < g->place_end_s, fades = screen->start_s < g->opacity_end_s;
    if (glides) {
        double box[4], near_mm = 3 * screen->footprint_mm + 1e-9;
        around(screen, box);
        if (box[1] < g->way[0] - near_mm || box[0] > g->way[1] + near_mm ||
            box[3] < g->way[2] - near_mm || box[2] > g->way[3] + near_mm)
            return;
        is_inside = g->is_level && box[0] > g->core[0] + near_mm && box[1] < g->core[1] - near_mm &&
                    box[2] > g->core[2] + near_mm && box[3] < g->core[3] - near_mm;
        within_mm = see_gliding(e, r, screen);
    } else
        see(r, screen->x_mm, screen->y_mm, r->x_mm, r->y_mm, n, x, y);
    for (int64_t i = 0; i < n; i++) {
        double t_s = screen->start_s + screen->step_s * (double)(i % screen->points + 1);
        double opacity = r->opacity;
        if (fades)
            opacity = g->opacity + done(g->opacity_start_s, g->opacity_end_s, t_s) * (r->opacity - g->opacity);
        cover[i] = opacity * (is_inside ? 1.0 : covered(r, x[i], y[i], 4 * within_mm));
        is_on |= cover[i] > 0.0;
    }
    if (!is_on)
        return;
    hx_motion on = *screen;
    on.x_mm = x;
    on.y_mm = y;
    on.vx_mm_s = e->row[LOCAL_VX];
    on.vy_mm_s = e->row[LOCAL_VY];
    if (!glides)
        see(r, screen->vx_mm_s, screen->vy_mm_s, 0.0, 0.0, n, e->row[LOCAL_VX], e->row[LOCAL_VY]);
    if (r->mask >= 0) {
        on.footprint_mm = 2 * within_mm;
        hx_feel(p, r->mask, &on, e->seen, felt);
        for (int64_t i = 0; i < n; i++)
            cover[i] *= hx_least(hx_most(felt[i], 0.0), 1.0);
    }
    hx_history history[HX_FINGERS];
    for (int64_t k = 0; on.history && k < on.fingers; k++) {
        history[k] = screen->history[k];
        history[k].first += 1 + r->facts;
    }
    on.history = on.history ? history : NULL;
    on.footprint_mm = within_mm / g->inner[3];
    for (int64_t i = 0; has_inner(g) && i < n; i++) {
        x[i] -= g->inner[0];
        y[i] -= g->inner[1];
        turn(&x[i], &y[i], g->inner[2], g->inner[3]);
        turn(&e->row[LOCAL_VX][i], &e->row[LOCAL_VY][i], g->inner[2], g->inner[3]);
    }
    hx_feel(p, r->material, &on, e->seen, felt);
    if (r->blend != BLEND_MULTIPLY)
        convert(e, r->material, &on, felt);
    for (int64_t i = 0; i < n; i++)
        value[i] += cover[i] * (blended(r->blend, value[i], felt[i]) - value[i]);
}

/* Numbers wanted under the fingers; see Layout.wanted. */
static void want(hx_engine *e, const hx_motion *motion)
{
    const hx_program *p = &e->program;
    const hx_material *below = &p->material[p->background];
    double *x = e->row[X], *y = e->row[Y], *value = e->row[VALUE];
    int64_t n = motion->fingers * motion->points;
    if (e->converts)
        hx_slice_reach(&p->slice, motion->force_n, n, e->row[LOWEST], e->row[HIGHEST]);
    for (int64_t i = 0; i < n; i++) {
        int near = is_near(motion->x_mm[i], motion->y_mm[i]);
        x[i] = near ? motion->x_mm[i] : 0.0;
        y[i] = near ? motion->y_mm[i] : 0.0;
    }
    hx_motion screen = *motion;
    screen.x_mm = x;
    screen.y_mm = y;
    if (e->multiplies)
        screen.footprint_mm *= 2;
    hx_feel(p, p->background, &screen, e->seen, value);
    convert(e, p->background, &screen, value);
    for (int64_t i = 0; i < p->regions; i++)
        lay(e, &p->region[i], &screen);
    for (int64_t i = 0; i < n; i++)
        if (!is_near(motion->x_mm[i], motion->y_mm[i]))
            value[i] = below->outside;
}

/* Gains: 0 for a finger while another one is on a region of higher priority. */
static const double *share(hx_engine *e, const hx_motion *motion, const double *gain)
{
    const hx_program *p = &e->program;
    int64_t points = motion->points, n = motion->fingers * points;
    double *rank = e->row[COVER], *shared = e->row[FELT];
    for (int64_t i = 0; i < n; i++)
        rank[i] = 0.0;
    for (int64_t k = 0; k < p->regions; k++) {
        const hx_region *r = &p->region[k];
        if (motion->start_s < r->glide.place_end_s)
            see_gliding(e, r, motion);
        else
            see(r, motion->x_mm, motion->y_mm, r->x_mm, r->y_mm, n, e->row[LOCAL_X], e->row[LOCAL_Y]);
        for (int64_t i = 0; i < n; i++)
            if (covered(r, e->row[LOCAL_X][i], e->row[LOCAL_Y][i], 0.0) >= 0.5)
                rank[i] = (double)r->priority;
    }
    for (int64_t point = 0; point < points; point++) {
        double highest = -INFINITY;
        for (int64_t i = point; i < n; i += points)
            highest = hx_most(highest, rank[i]);
        for (int64_t i = point; i < n; i += points)
            shared[i] = rank[i] == highest ? gain[i] : 0.0;
    }
    return shared;
}

/* Blocks. */

static double now_s(const hx_engine *e) { return (double)e->sample / e->program.sample_rate_hz; }

/* Intensity at the points of the next block; NULL: 1. */
static const double *intensity(hx_engine *e, int64_t points)
{
    const hx_mix *m = &e->mix;
    double t0_s = now_s(e);
    if (t0_s >= m->end_s && m->after == 1.0)
        return NULL;
    for (int64_t i = 0; i < points; i++) {
        double t_s = t0_s + e->step_s * (double)(i + 1);
        e->intensity[i] = t0_s >= m->end_s ? m->after
                                           : m->before + done(m->start_s, m->end_s, t_s) * (m->after - m->before);
    }
    return e->intensity;
}

/* Shares of the reachable friction that effects add; NULL: 0. See PlayingEffect.added. */
static const double *added(hx_engine *e, const hx_motion *motion)
{
    static const hx_facts begun = {-INFINITY, {0.0, 0.0, 0.0, 0.0}, 0.0};
    double *sum = e->row[LOCAL_X], *value = e->row[LOCAL_Y];
    int64_t n = motion->fingers * motion->points, any = 0, has_reach = e->converts;
    hx_history history[HX_FINGERS];
    for (int64_t k = 0; k < motion->fingers; k++)
        history[k] = (hx_history){&begun, 1, 1};
    for (int64_t k = 0; k < e->mix.effects; k++) {
        const hx_effect *effect = &e->mix.effect[k];
        const hx_program *of = &effect->of->program;
        if (motion->start_s >= effect->end_s)
            continue;
        hx_motion since = *motion;
        since.start_s -= effect->start_s;
        since.history = history;
        hx_feel(of, of->background, &since, effect->of->seen, value);
        int is_contrast = of->material[of->background].target == TARGET_CONTRAST;
        if (is_contrast && !has_reach)
            hx_slice_reach(&e->program.slice, motion->force_n, n, e->row[LOWEST], e->row[HIGHEST]);
        has_reach |= is_contrast;
        for (int64_t i = 0; i < n; i++) {
            double t_s = motion->start_s + motion->step_s * (double)(i % motion->points + 1);
            double lowest = e->row[LOWEST][i], highest = e->row[HIGHEST][i];
            double share = is_contrast ? value[i] * lowest / hx_most(highest - lowest, 1e-9 * lowest)
                                       : value[i];
            share *= t_s < effect->end_s ? 1 - done(effect->fade_start_s, effect->fade_end_s, t_s) : 0.0;
            sum[i] = any ? sum[i] + share : share;
        }
        any = 1;
    }
    return any ? sum : NULL;
}

/* Record whether a finger feels the effects, unless their time stands; see Mix.mark. */
static void mark_felt(const hx_engine *e, const hx_motion *motion, const double *gain)
{
    int64_t effects = isnan(e->mix.stands_s) ? e->mix.effects : 0;
    for (int64_t k = 0; k < effects; k++) {
        const hx_effect *effect = &e->mix.effect[k];
        for (int64_t point = 0; point < motion->points; point++) {
            double t_s = motion->start_s + motion->step_s * (double)(point + 1), most = 0.0;
            double at = floor((t_s - effect->start_s) / HX_FELT_S);
            if (!(at >= 0.0 && at < (double)effect->felts))
                continue;
            for (int64_t i = point; i < motion->fingers * motion->points; i += motion->points)
                most = hx_most(gain[i], most);
            effect->felt[(int64_t)at] = most > felt_gain;
        }
    }
}

static const hx_felt *play(hx_engine *e, const hx_motion *motion, const double *gain,
                           const double *queued_v)
{
    const hx_program *p = &e->program;
    const double *force_n = motion->force_n;
    int64_t fingers = motion->fingers, points = motion->points, n = fingers * points;
    int64_t step = p->rendering.step;
    mark_felt(e, motion, gain);
    if (n) {
        want(e, motion);
        if (fingers > 1 && e->has_priorities)
            gain = share(e, motion, gain);
    }
    hx_block block = {0};
    block.fingers = fingers;
    block.points = points;
    block.value = e->row[VALUE];
    block.force_n = force_n;
    block.gain = gain;
    block.intensity = intensity(e, points);
    block.added = n && e->mix.effects ? added(e, motion) : NULL;
    block.less = &p->slice;
    block.before_v = e->before_v;
    block.queued_v = queued_v;
    block.queued = queued_v ? points : 0;
    block.wave = p->wave;
    block.period = p->period;
    block.phase = e->sample % p->period;
    hx_render(&p->rendering, &block, e->numbers, e->status);
    double *amplitude_v = e->numbers + n, *drive_v = amplitude_v + points;
    /* Numbers that are none must not go out. */
    for (int64_t i = 0; i < points; i++)
        amplitude_v[i] = fabs(amplitude_v[i]) <= p->rendering.most_v ? amplitude_v[i] : 0.0;
    for (int64_t i = 0; i < points * step; i++)
        drive_v[i] = fabs(drive_v[i]) <= p->rendering.most_v ? drive_v[i] : 0.0;
    for (int64_t i = 0; i < n; i += points)
        hx_slice_friction(&p->slice, force_n + i, amplitude_v, points, e->friction + i);
    hx_felt felt = {
        fingers, points, step, p->sample_rate_hz, p->rendering.most_v, e->sample,
        motion->x_mm, motion->y_mm, force_n, e->numbers, e->friction, e->status, amplitude_v, drive_v,
    };
    e->felt = felt;
    e->before_v = amplitude_v[points - 1];
    e->sample += points * step;
    e->playable_s = now_s(e);
    return &e->felt;
}

const hx_felt *hx_engine_play(hx_engine *e, const hx_motion *motion, const double *gain)
{
    return play(e, motion, gain, NULL);
}

static const hx_facts nothing = {0.0, {NAN, NAN, NAN, NAN}, NAN};

/* Touches. */

static double gain_at(const hx_engine *e, const hx_track *track, double t_s)
{
    return hx_finger_gain(&e->program.following, track, e->at_rest, t_s);
}

/* Let all reports until now count, from a time on. */
static void update(const hx_engine *e, touch *t, double t0_s)
{
    const hx_program *p = &e->program;
    hx_track before = t->track;
    hx_tracker_follow(&p->touching, &t->tracker, &t->track);
    t->track.is_down = t->is_down;
    t->track.normal_force_n = t->force_n;
    hx_finger_update(&p->following, &t->track, t->is_known ? &before : NULL, e->at_rest, t0_s);
    t->is_new = 0;
    t->is_known = 1;
}

/* Let all reports until now count, and forget fingers that get no drive any more. */
static void follow(hx_engine *e, double t0_s)
{
    int64_t count = 0;
    for (int64_t k = 0; k < e->down; k++) {
        touch *t = &e->touches[e->order[k]];
        if (t->is_new && (t->is_down || t->is_known))
            update(e, t, t0_s);
        else if (!t->is_down && (!t->is_known || gain_at(e, &t->track, t0_s) <= 0.0)) {
            t->is_used = 0;
            continue;
        }
        e->order[count++] = e->order[k];
    }
    e->down = count;
}

/* Fingers as the last block knew them, in the order in which they came. */
static int64_t known(const hx_engine *e, hx_track *tracks, int64_t *order)
{
    int64_t count = 0;
    for (int64_t k = 0; k < e->down; k++)
        if (e->touches[e->order[k]].is_known) {
            order[count] = e->order[k];
            tracks[count++] = e->touches[e->order[k]].track;
        }
    return count;
}

const hx_felt *hx_engine_block(hx_engine *e, int64_t points)
{
    return hx_engine_window(e, e->sample, points, e->before_v, NULL, 1);
}

const hx_felt *hx_engine_window(hx_engine *e, int64_t first_sample, int64_t points,
                                double before_v, const double *queued_v, int64_t news)
{
    hx_track tracks[HX_FINGERS];
    int64_t order[HX_FINGERS];
    e->sample = first_sample;
    e->before_v = before_v;
    double t0_s = now_s(e), *numbers = e->moved;
    e->lag_s = isnan(e->mix.stands_s) ? e->mix.stood_s : t0_s - e->mix.stands_s;
    if (news)
        follow(e, t0_s);
    e->at_rest = e->program.drives_at_rest;
    int64_t count = known(e, tracks, order);
    int64_t n = hx_fingers(&e->program.following, tracks, count, t0_s, e->step_s, points,
                           e->at_rest, numbers);
    int64_t size = n * points;
    const double *vx = numbers + 4 * size + points, *vy = vx + n;
    for (int64_t i = 0; i < size; i++) {
        e->row[VX][i] = vx[i / points];
        e->row[VY][i] = vy[i / points];
    }
    int64_t each = 1 + e->program.regions;
    hx_history history[HX_FINGERS];
    for (int64_t k = 0; k < n; k++) {
        int64_t number = order[(int64_t)vy[n + k]];
        const touch *t = &e->touches[number];
        hx_history of_finger = {e->facts + number * KEPT * each, t->recalled, each};
        e->force_known[k] = (int8_t)t->is_force_known;
        if (e->facts)
            history[k] = of_finger;
    }
    hx_motion motion = {
        n, points, numbers, numbers + size, e->row[VX], e->row[VY], numbers + 2 * size,
        vy[2 * n] * e->step_s, e->step_s, t0_s - e->lag_s, e->force_known, e->facts ? history : NULL,
    };
    return play(e, &motion, numbers + 3 * size, queued_v);
}

void hx_engine_playable(hx_engine *e, double playable_s) { e->playable_s = playable_s; }

void hx_engine_mix(hx_engine *e, const hx_mix *mix) { e->mix = *mix; }

void hx_engine_glide(hx_engine *e, int64_t region, const hx_glide *glide)
{
    e->program.region[region].glide = *glide;
}

/* The region of a key whose facts count: that which is not removed, or else the first one; -1. */
static int64_t region_of(const hx_program *p, int64_t key)
{
    int64_t found = -1;
    for (int64_t k = 0; k < p->regions; k++)
        if (p->region[k].glide.key == key && (found < 0 || p->region[k].opacity > 0.0))
            found = k;
    return found;
}

void hx_engine_match(hx_engine *e, const hx_engine *before)
{
    hx_program *p = &e->program;
    for (int64_t k = 0; k < p->regions; k++) {
        hx_region *r = &p->region[k];
        r->facts = region_of(p, r->glide.key);
        r->facts_before = region_of(&before->program, r->glide.key);
        r->forgets = r->facts_before >= 0 &&
                     before->program.region[r->facts_before].glide.state != r->glide.state;
    }
}

/* Take over what a finger did; of another state of a material the number of its detent is none. */
static void take_facts(hx_engine *e, touch *t, const hx_engine *before)
{
    const hx_program *p = &e->program;
    int64_t each = 1 + p->regions, each_before = 1 + before->program.regions;
    if (!e->facts || !before->facts) {
        t->recalled = 0;
        t->reported.is_down = 0;
        return;
    }
    for (int64_t i = 0; i < t->recalled; i++) {
        hx_facts *to = e->facts + ((t - e->touches) * KEPT + i) * each;
        const hx_facts *from = before->facts + ((t - e->touches) * KEPT + i) * each_before;
        to[0] = from[0];
        for (int64_t k = 0; k < p->regions; k++) {
            const hx_region *r = &p->region[k];
            to[1 + k] = r->facts_before < 0 ? nothing : from[1 + r->facts_before];
            to[1 + k].since_s = from[0].since_s;
            if (r->forgets && i == t->recalled - 1)
                to[1 + k].detent = NAN;
        }
    }
}

void hx_engine_follow(hx_engine *e, const hx_engine *before)
{
    for (int64_t k = 0; k < HX_FINGERS; k++) {
        e->touches[k].is_used = 0;
        if (!before->touches[k].is_used)
            continue;
        e->touches[k] = before->touches[k];
        take_facts(e, &e->touches[k], before);
    }
    memcpy(e->order, before->order, sizeof e->order);
    e->down = before->down;
    e->interval_s = before->interval_s;
    e->before_v = before->before_v;
    e->playable_s = before->playable_s;
    e->sample = before->sample;
    e->at_rest = before->at_rest;
    e->lag_s = before->lag_s;
    e->mix = before->mix;
}

int64_t hx_engine_is_touched(const hx_engine *e) { return e->down > 0; }

void hx_engine_rate(const hx_engine *e, double *sample_rate_hz, int64_t *step)
{
    *sample_rate_hz = e->program.sample_rate_hz;
    *step = e->program.rendering.step;
}

/* What fingers did. */

static int is_later(double now_s, double before_s) { return !isnan(now_s) && !(now_s <= before_s); }

/* Take over the times of events that are newer; see LayoutFacts.newest. */
static void take_newer(hx_facts *all, const hx_facts *facts)
{
    if (is_later(facts->time_s[HX_DETENT], all->time_s[HX_DETENT]))
        all->detent = facts->detent;
    for (int k = 0; k < HX_EVENTS; k++)
        if (is_later(facts->time_s[k], all->time_s[k]))
            all->time_s[k] = facts->time_s[k];
}

static int differ(double one, double other) { return one != other && !(isnan(one) && isnan(other)); }

static hx_touched seen_report(const hx_region *r, const hx_touched *report)
{
    hx_touched seen = *report;
    const hx_glide *g = &r->glide;
    hx_region there = *r;
    double *place[4] = {&there.x_mm, &there.y_mm, &there.angle_rad, &there.scale};
    for (int k = 0; k < 4; k++)
        *place[k] = glided(g->place[k], *place[k], g->place_start_s, g->place_end_s, report->t_s);
    see(&there, &report->x_mm, &report->y_mm, there.x_mm, there.y_mm, 1, &seen.x_mm, &seen.y_mm);
    double width = r->width_mm, height = r->height_mm, x = seen.x_mm, y = seen.y_mm;
    int is_on = r->shape == SHAPE_RECTANGLE ? x >= 0.0 && x <= width && y >= 0.0 && y <= height
                : r->shape == SHAPE_ELLIPSE ? hx_length(2 * x / width - 1, 2 * y / height - 1) <= 1.0
                                            : covered(r, x, y, 0.0) >= 0.5;
    double opacity = glided(g->opacity, r->opacity, g->opacity_start_s, g->opacity_end_s, report->t_s);
    seen.is_down = report->is_down && opacity > 0.0 && is_on;
    if (has_inner(g)) {
        seen.x_mm -= g->inner[0];
        seen.y_mm -= g->inner[1];
        turn(&seen.x_mm, &seen.y_mm, g->inner[2], g->inner[3]);
    }
    return seen;
}

/* Facts of all regions after a report, of [0] what is newest; see Layout.react. A region has none
 * where the finger never came down on it. */
static void react(const hx_engine *e, hx_facts *facts, const hx_touched *before,
                  const hx_touched *now)
{
    const hx_program *p = &e->program;
    if (!p->is_layout) {
        hx_react(p, p->background, facts, before, now);
        return;
    }
    for (int64_t k = 0; k < p->regions; k++) {
        const hx_region *r = &p->region[k];
        hx_facts *of = &facts[1 + k];
        if (r->opacity == 0.0) { /* it is being removed */
            if (r->facts == k)
                *of = nothing;
            continue;
        }
        int is_known = !isnan(of->time_s[HX_DOWN]);
        hx_touched here = seen_report(r, now), then;
        if (!here.is_down && !is_known)
            continue;
        if (!is_known) {
            *of = nothing;
            of->time_s[HX_DOWN] = now->t_s;
        } else if (before)
            then = seen_report(r, before);
        hx_react(p, r->material, of, is_known && before ? &then : NULL, &here);
        take_newer(facts, of);
        if (!here.is_down)
            *of = nothing;
    }
}

/* Keep what a report changes, from the first time on that can still be played; see
 * haptix.feel.motion.block.Reactions. */
static void recall(hx_engine *e, touch *t, const hx_touched *now)
{
    if (!e->facts)
        return;
    int64_t each = 1 + e->program.regions;
    size_t bytes = sizeof(hx_facts) * (size_t)each;
    hx_facts *kept = e->facts + (t - e->touches) * KEPT * each;
    double playable_s = e->playable_s - e->lag_s, since_s = INFINITY;
    while (t->recalled > 1 && (kept[each].since_s <= playable_s || t->recalled == KEPT)) {
        memmove(kept, kept + each, bytes * (size_t)(t->recalled - 1));
        t->recalled--;
    }
    hx_facts *facts = kept + t->recalled * each, then;
    if (t->recalled) {
        memcpy(facts, facts - each, bytes);
        then = *facts;
    } else {
        for (int64_t k = 0; k < each; k++)
            facts[k] = nothing;
        facts->time_s[HX_DOWN] = now->t_s;
        then = nothing;
    }
    react(e, facts, t->reported.is_down ? &t->reported : NULL, now);
    t->reported = *now;
    hx_facts all = facts[0];
    int is_new[HX_EVENTS], any = 0;
    for (int i = 0; i < HX_EVENTS; i++) {
        is_new[i] = differ(all.time_s[i], then.time_s[i]);
        any |= is_new[i];
        if (is_new[i])
            since_s = hx_least(since_s, all.time_s[i]);
    }
    if (t->recalled && !any && !differ(all.detent, then.detent))
        return;
    since_s = any ? since_s : now->t_s;
    if (since_s < playable_s) {
        since_s = playable_s;
        for (int64_t k = 0; k < each; k++)
            for (int i = 0; i < HX_EVENTS; i++)
                if (is_new[i] && (k == 0 || facts[k].time_s[i] == all.time_s[i]))
                    facts[k].time_s[i] = hx_most(all.time_s[i], playable_s);
    }
    for (int64_t k = 0; k < each; k++)
        facts[k].since_s = since_s;
    if (t->recalled && facts[0].since_s == (facts - each)->since_s)
        memcpy(facts - each, facts, bytes); /* the later one holds */
    else
        t->recalled++;
}

/* The touch of an id that is down, or an unused one; NULL if all are used. */
static touch *touch_of(hx_engine *e, int64_t id)
{
    touch *unused = NULL;
    for (int64_t k = 0; k < HX_FINGERS; k++) {
        touch *t = &e->touches[k];
        if (t->is_used && t->is_down && t->id == id)
            return t;
        if (!t->is_used && !unused)
            unused = t;
    }
    return unused;
}

int64_t hx_engine_touch(hx_engine *e, int64_t touch_id, double t_s, double x_mm, double y_mm,
                        double force_n, int64_t is_down)
{
    const hx_touching *settings = &e->program.touching;
    touch *t = touch_of(e, touch_id);
    int is_force = force_n >= lightest_n && force_n <= hardest_n;
    if (!t || (is_down && (!(fabs(x_mm) <= largest_mm) || !(fabs(y_mm) <= largest_mm) ||
                           !(fabs(t_s) <= latest_s))))
        return 0;
    if (!t->is_used) {
        if (!is_down)
            return 0;
        memset(t, 0, offsetof(touch, tracker));
        memset(&t->track, 0, sizeof t->track);
        memset(&t->reported, 0, sizeof t->reported);
        t->recalled = 0;
        t->id = touch_id;
        t->is_used = t->is_down = 1;
        t->force_n = is_force ? force_n : e->program.assumed_n;
        t->is_force_known = is_force;
        hx_tracker_start(settings, &t->tracker, e->interval_s, t_s, x_mm, y_mm);
        e->order[e->down++] = t - e->touches;
    } else if (is_down) {
        int64_t outcome = hx_tracker_push(settings, &t->tracker, t_s, x_mm, y_mm);
        if (!(outcome & HX_TAKEN))
            return 0;
        if (is_force && outcome & HX_LATEST) {
            t->force_n = force_n;
            t->is_force_known = 1;
        }
    } else {
        t->is_down = 0;
        e->interval_s = t->tracker.interval_s;
    }
    hx_touched now = {t->tracker.now.used_t_s - e->lag_s, x_mm, y_mm, is_force ? force_n : NAN, is_down};
    recall(e, t, &now);
    t->is_new = 1;
    return 1;
}
