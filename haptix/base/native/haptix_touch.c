/* One touch from its reports: the filter of its place, and when it slides and rests.
 *
 * It follows haptix.play.touch: InteractingSinger of filters.py and TouchTracker of touches.py,
 * where the sources and the reasons are. */
#include <math.h>
#include <string.h>

#include "haptix_touch.h"

static const double simultaneous_s = 1e-5;
static const double rests_after = 2.2, least_rest_s = 0.015, longest_interval_s = 0.036;
static const double newest_weight = 0.25;
static const double off_mm = 5.0, most_mm_s2 = 5e4, first_mm_s = 1500.0, most_mm_s = 3000.0;
enum { JUMPS_IN_A_ROW = 3, LATE_IN_A_ROW = 3 };
static const double assumed_reports = 6.0, least_noise_mm = 0.01, longest_five_s = 0.1;
static const double least_weight = 0.001;

/* The filter. Of a model: x, y, vx, vy, ax, ay, and the covariance xx, xv, xa, vv, va, aa. */

static void start(const hx_touching *s, double t_s, double x_mm, double y_mm, hx_filtered *to)
{
    double noise = s->position_noise_mm * s->position_noise_mm;
    double mean[HX_MODEL] = {
        x_mm, y_mm, 0, 0, 0, 0, noise, 0, 0, s->first_speed_mm_s * s->first_speed_mm_s, 0,
        s->acceleration_mm_s2 * s->acceleration_mm_s2,
    };
    double gentle = s->gentle * s->acceleration_mm_s2;
    memcpy(to->mean, mean, sizeof mean);
    memcpy(to->agile, mean, sizeof mean);
    memcpy(to->gentle, mean, sizeof mean);
    to->gentle[11] = gentle * gentle;
    to->t_s = t_s;
    to->variance = noise;
    to->reports = assumed_reports;
    to->weight = 0.5;
    double recent[3] = {t_s, x_mm, y_mm};
    memcpy(to->recent, recent, sizeof recent);
    to->recents = 1;
}

/* Mean and covariance of a mixture of two models; the first has the weight. */
static void mix(double weight, const double *first, const double *second, double *to)
{
    static const int8_t row[6][2] = {{0, 0}, {0, 2}, {0, 4}, {2, 2}, {2, 4}, {4, 4}};
    double rest = 1.0 - weight, half = 0.5 * weight * rest, off[6], mixed[HX_MODEL];
    for (int i = 0; i < 6; i++) {
        off[i] = second[i] - first[i];
        mixed[i] = first[i] + rest * off[i];
    }
    for (int i = 0; i < 6; i++) { /* both axes share one covariance */
        int a = row[i][0], b = row[i][1];
        mixed[6 + i] = weight * first[6 + i] + rest * second[6 + i] +
                       half * (off[a] * off[b] + off[a + 1] * off[b + 1]);
    }
    memcpy(to, mixed, sizeof mixed);
}

/* Variance of a report along each axis, from five; below 0 if it is not known. */
static double noise_of(const double *r)
{
    const double *t = r, *x = r + 1, *y = r + 2;
    int is_still = 1;
    for (int i = 3; i < 15; i += 3)
        is_still &= x[i] == x[0] && y[i] == y[0];
    if (t[12] - t[0] > longest_five_s || is_still)
        return -1.0;
    double t0 = t[0], t1 = t[3], t2 = t[6], t3 = t[9], t4 = t[12];
    double a0 = t2 - t0, a1 = t2 - t1, a3 = t2 - t3, a4 = t2 - t4;
    double w0 = a1 * a3 * a4 / ((t0 - t1) * (t0 - t3) * (t0 - t4));
    double w1 = a0 * a3 * a4 / ((t1 - t0) * (t1 - t3) * (t1 - t4));
    double w3 = a0 * a1 * a4 / ((t3 - t0) * (t3 - t1) * (t3 - t4));
    double w4 = a0 * a1 * a3 / ((t4 - t0) * (t4 - t1) * (t4 - t3));
    double dx = x[6] - (w0 * x[0] + w1 * x[3] + w3 * x[9] + w4 * x[12]);
    double dy = y[6] - (w0 * y[0] + w1 * y[3] + w3 * y[9] + w4 * y[12]);
    return (dx * dx + dy * dy) / (2.0 * (1.0 + w0 * w0 + w1 * w1 + w3 * w3 + w4 * w4));
}

static void learn_noise(const hx_touching *s, hx_filtered *f, double t_s, double x_mm, double y_mm)
{
    double *newest = f->recent + 3 * f->recents;
    newest[0] = t_s;
    newest[1] = x_mm;
    newest[2] = y_mm;
    if (++f->recents < 5)
        return;
    double noise = s->noise_reports > 0.0 ? noise_of(f->recent) : -1.0;
    if (noise >= 0.0) {
        f->reports = fmin(f->reports + 1.0, s->noise_reports);
        f->variance = fmax(f->variance + (noise - f->variance) / f->reports,
                           least_noise_mm * least_noise_mm);
    }
    f->recents = 4;
    memmove(f->recent, f->recent + 3, 12 * sizeof *f->recent);
}

/* Move a model on to a report; return the logarithm of its likelihood. */
static double moved(const hx_touching *s, double *m, double dt, double share, double variance,
                    double x_mm, double y_mm)
{
    double left = exp(-dt / s->correlation_s), to_speed = s->correlation_s * (1.0 - left);
    double to_place = s->correlation_s * (dt - to_speed);
    double vx = m[2], vy = m[3], ax = m[4], ay = m[5];
    double pxx = m[6], pxv = m[7], pxa = m[8], pvv = m[9], pva = m[10], paa = m[11];
    double jerk = share * (s->acceleration_mm_s2 + s->acceleration_per_speed_hz * hypot(vx, vy));
    jerk *= 2.0 * jerk / s->correlation_s;
    double xa = pxa + dt * pva + to_place * paa;
    double xv = pxv + dt * pvv + to_place * pva;
    double va = pva + to_speed * paa;
    double noise = jerk * dt * dt;
    pxx += dt * pxv + to_place * pxa + dt * xv + to_place * xa + noise * dt * dt * dt * 0.05;
    pxv = xv + to_speed * xa + noise * dt * dt * 0.125;
    pvv += to_speed * (pva + va) + noise * dt / 3.0;
    pxa = left * xa + noise * dt / 6.0;
    pva = left * va + noise * 0.5;
    paa = left * left * paa + jerk * dt;
    double total = pxx + variance;
    double gain_x = pxx / total, gain_v = pxv / total, gain_a = pxa / total;
    double x = m[0] + (vx * dt + ax * to_place), y = m[1] + (vy * dt + ay * to_place);
    double dx = x_mm - x, dy = y_mm - y;
    pvv -= gain_v * pxv;
    paa -= gain_a * pxa;
    double after[HX_MODEL] = {
        x + gain_x * dx, y + gain_x * dy,
        vx + ax * to_speed + gain_v * dx, vy + ay * to_speed + gain_v * dy,
        left * ax + gain_a * dx, left * ay + gain_a * dy,
        variance * gain_x, variance * gain_v, variance * gain_a,
        pvv > 0.0 ? pvv : 0.0, pva - gain_v * pxa, paa > 0.0 ? paa : 0.0,
    };
    memcpy(m, after, sizeof after);
    return -0.5 * (dx * dx + dy * dy) / total - log(total);
}

static void step(const hx_touching *s, hx_filtered *f, double t_s, double x_mm, double y_mm)
{
    double dt = t_s - f->t_s, weight = f->weight, gentle[HX_MODEL], agile[HX_MODEL];
    learn_noise(s, f, t_s, x_mm, y_mm);
    double before = s->stay * weight + (1.0 - s->stay) * (1.0 - weight);
    mix(s->stay * weight / before, f->gentle, f->agile, gentle);
    mix((1.0 - s->stay) * weight / (1.0 - before), f->gentle, f->agile, agile);
    double likely = moved(s, gentle, dt, s->gentle, f->variance, x_mm, y_mm);
    double other = moved(s, agile, dt, 1.0, f->variance, x_mm, y_mm);
    double odds = (1.0 - before) / before * exp(fmin(fmax(other - likely, -50.0), 50.0));
    f->weight = fmin(fmax(1.0 / (1.0 + odds), least_weight), 1.0 - least_weight);
    memcpy(f->gentle, gentle, sizeof gentle);
    memcpy(f->agile, agile, sizeof agile);
    mix(f->weight, gentle, agile, f->mean);
    f->t_s = t_s;
}

/* Place `ahead_s` after the filter's report. */
static void ahead(const hx_touching *s, const hx_filtered *f, double ahead_s, double *x, double *y)
{
    const double *m = f->mean;
    double to_speed = -s->correlation_s * expm1(-ahead_s / s->correlation_s);
    double to_place = s->correlation_s * (ahead_s - to_speed);
    *x = m[0] + m[2] * ahead_s + m[4] * to_place;
    *y = m[1] + m[3] * ahead_s + m[5] * to_place;
}

/* The tracker. */

static double rests_after_s(double interval_s) { return fmax(rests_after * interval_s, least_rest_s); }

static hx_report *report_at(hx_tracker *t, int64_t back)
{
    return &t->history[(t->first + t->count - 1 - back) % HX_REPORTS];
}

static hx_report first_report(const hx_touching *s, double t_s, double x_mm, double y_mm,
                              double interval_s)
{
    hx_report r;
    memset(&r, 0, sizeof r);
    start(s, t_s, x_mm, y_mm, &r.filtered);
    r.t_s = r.used_t_s = r.moved_s = t_s;
    r.x_mm = r.used_x_mm = x_mm;
    r.y_mm = r.used_y_mm = y_mm;
    r.interval_s = interval_s;
    return r;
}

static void append(hx_tracker *t, const hx_report *report)
{
    if (t->count == HX_REPORTS) {
        t->first = (t->first + 1) % HX_REPORTS;
        t->count--;
    }
    t->count++;
    hx_report *newest = report_at(t, 0);
    *newest = *report;
    newest->number = ++t->numbers;
    if (!newest->is_held)
        newest->used = newest->number;
}

static void restart(const hx_touching *s, hx_tracker *t, double t_s, double x_mm, double y_mm)
{
    hx_report first = first_report(s, t_s, x_mm, y_mm, t->interval_s);
    t->first = t->count = 0;
    append(t, &first);
}

/* Let a report count, after the one that counted before. */
static void count_report(const hx_touching *s, hx_report *r, double t_s, double x_mm, double y_mm)
{
    double dt = t_s - r->used_t_s;
    step(s, &r->filtered, t_s, x_mm, y_mm);
    double vx = r->filtered.mean[2], vy = r->filtered.mean[3];
    double weight = dt / (dt + s->slide_smoothing_s);
    r->slow_vx += weight * (vx - r->slow_vx);
    r->slow_vy += weight * (vy - r->slow_vy);
    r->slow_speed += weight * (hypot(vx, vy) - r->slow_speed);
    int moves = hypot(r->slow_vx, r->slow_vy) >
                (r->is_sliding ? s->rest_below_mm_s : s->slide_above_mm_s);
    r->moved_s = moves ? t_s : r->moved_s;
    int turns = r->slow_speed > s->turn_above_mm_s && t_s - r->moved_s < s->turn_s;
    r->is_sliding = moves || (r->is_sliding && turns);
    r->t_s = r->used_t_s = t_s;
    r->x_mm = r->used_x_mm = x_mm;
    r->y_mm = r->used_y_mm = y_mm;
    r->is_held = r->jumps = 0;
}

static void add(const hx_touching *s, hx_tracker *t, double t_s, double x_mm, double y_mm)
{
    if (t->count == 0) {
        restart(s, t, t_s, x_mm, y_mm);
        return;
    }
    const hx_report *last = report_at(t, 0);
    hx_report next = *last; /* with all that is used of the one that counts */
    double interval_s = last->interval_s, dt = t_s - last->used_t_s, x, y;
    int is_new = last->used == report_at(t, t->count - 1)->number;
    ahead(s, &last->filtered, dt, &x, &y);
    double off = hypot(x_mm - x, y_mm - y);
    double from_used = hypot(x_mm - last->used_x_mm, y_mm - last->used_y_mm);
    if (dt > rests_after_s(interval_s) && from_used <= off) {
        next = first_report(s, last->used_t_s + interval_s, last->used_x_mm, last->used_y_mm,
                            interval_s);
        dt = t_s - next.t_s;
        off = from_used;
        is_new = 1;
    }
    if (off > off_mm + 0.5 * most_mm_s2 * dt * dt + first_mm_s * dt * is_new) {
        double near_mm = off_mm + most_mm_s * (t_s - last->t_s);
        int near = hypot(x_mm - last->x_mm, y_mm - last->y_mm) < near_mm;
        if (!last->is_held || !(near || last->jumps >= JUMPS_IN_A_ROW)) {
            next = *last;
            next.t_s = t_s;
            next.x_mm = x_mm;
            next.y_mm = y_mm;
            next.is_held = 1;
            next.jumps++;
            append(t, &next);
            return;
        }
        next = first_report(s, last->t_s, last->x_mm, last->y_mm, interval_s);
    }
    double since_s = fmin(t_s - last->t_s, 1.5 * interval_s);
    interval_s += newest_weight * (since_s - interval_s);
    count_report(s, &next, t_s, x_mm, y_mm);
    next.interval_s = fmin(interval_s, longest_interval_s);
    append(t, &next);
}

/* Undo the later reports, add the late one, and add the others again. */
static void insert(const hx_touching *s, hx_tracker *t, double t_s, double x_mm, double y_mm)
{
    double later[HX_REPORTS][3];
    int64_t count = 0;
    for (; t->count && report_at(t, 0)->t_s > t_s + simultaneous_s; t->count--, count++) {
        const hx_report *r = report_at(t, 0);
        later[count][0] = r->t_s;
        later[count][1] = r->x_mm;
        later[count][2] = r->y_mm;
    }
    if (t->count && t_s - report_at(t, 0)->t_s <= simultaneous_s) {
        t_s = report_at(t, 0)->t_s;
        t->count--;
    }
    add(s, t, t_s, x_mm, y_mm);
    while (count--)
        add(s, t, later[count][0], later[count][1], later[count][2]);
}

static int is_clock_jump(hx_tracker *t, double t_s)
{
    t->late = t_s > t->late_t_s || t->late == 0 ? t->late + 1 : 1;
    t->late_t_s = t_s;
    return t->late >= LATE_IN_A_ROW;
}

void hx_tracker_start(const hx_touching *s, hx_tracker *t, double interval_s, double t_s,
                      double x_mm, double y_mm)
{
    memset(t, 0, sizeof *t);
    t->interval_s = interval_s;
    t->late_t_s = -1e300;
    restart(s, t, t_s, x_mm, y_mm);
    t->now = *report_at(t, 0);
}

int64_t hx_tracker_push(const hx_touching *s, hx_tracker *t, double t_s, double x_mm, double y_mm)
{
    const hx_report *last = report_at(t, 0);
    double dt = t_s - last->t_s;
    if (dt > s->lost_after_s)
        restart(s, t, t_s, x_mm, y_mm);
    else if (dt > simultaneous_s &&
             (t->count == 1 || last->t_s - report_at(t, 1)->t_s >= s->least_interval_s)) {
        add(s, t, t_s, x_mm, y_mm);
        if (report_at(t, 0)->is_held)
            return 0;
    } else if (dt >= -simultaneous_s) {
        double at_s = fmax(t_s, last->t_s);
        t->count--;
        add(s, t, at_s, x_mm, y_mm);
    } else if (dt >= -s->reorder_s &&
               (t_s > report_at(t, t->count - 1)->t_s || t->count < HX_REPORTS))
        insert(s, t, t_s, x_mm, y_mm);
    else if (!is_clock_jump(t, t_s))
        return 0;
    else
        restart(s, t, t_s, x_mm, y_mm);
    t->late = 0;
    t->now = *report_at(t, 0);
    t->interval_s = t->now.interval_s;
    t->is_latest = t_s >= report_at(t, 0)->t_s;
    return 1;
}

void hx_tracker_follow(const hx_touching *s, const hx_tracker *t, hx_track *to)
{
    const hx_report *now = &t->now;
    const double *m = now->filtered.mean;
    to->reported_s = now->used_t_s;
    to->x_mm = m[0];
    to->y_mm = m[1];
    to->vx_mm_s = m[2];
    to->vy_mm_s = m[3];
    to->ax_mm_s2 = m[4];
    to->ay_mm_s2 = m[5];
    to->lasting_s = s->correlation_s;
    to->rest_x_mm = now->used_x_mm;
    to->rest_y_mm = now->used_y_mm;
    to->is_sliding = now->is_sliding;
    double moves_s = fmin(rests_after_s(now->interval_s), s->lost_after_s);
    to->rests_s = fmin(to->start_s + moves_s, to->reported_s + s->lost_after_s);
}
