/* One touch from its reports: the filter of its place, and when it slides and rests; see
 * haptix.play.touch, which has the sources of the filters. */
#include <math.h>
#include <string.h>

#include "haptix_touch.h"

/* Reports closer than this count as simultaneous: the speed between them would be noise over
 * nothing. */
static const double simultaneous_s = 1e-5;
/* Intervals without a report, after which a finger rests where it was reported last. Panels and
 * browsers are silent about a finger that does not move; one report may go missing. */
static const double rests_after = 2.2, least_rest_s = 0.015; /* less, a busy machine may be late */
static const double longest_interval_s = 0.036, newest_weight = 0.25; /* of the estimate */
/* A report jumps if it is farther from where the finger is expected: what panels are off as fingers
 * come down and turn, what a hand accelerates, and the motion in which a finger comes down. */
static const double off_mm = 5.0, most_mm_s2 = 5e4, first_mm_s = 1500.0, most_mm_s = 3000.0;
/* After so many late events in a row, each later than the one before, the clock has jumped. */
enum { JUMPS_IN_A_ROW = 3, LATE_IN_A_ROW = 3 };
/* Number of reports that the assumed noise of a panel stands for; a tenth of the resolution of
 * capacitive panels; longest duration of five reports from which noise is estimated. */
static const double assumed_reports = 6.0, least_noise_mm = 0.01, longest_five_s = 0.1;
static const double least_weight = 0.001; /* of a model, which can so regain it within some reports */

/* Places of the parameters of each filter. */
enum { ACCELERATION, PER_SPEED, CORRELATION, NOISE, FIRST_SPEED, NOISE_REPORTS, GENTLE, STAY };
enum { WHITE_DENSITY, WHITE_NOISE, WHITE_FIRST_SPEED };
enum { EURO_CUTOFF, EURO_PER_SPEED, EURO_DERIVATIVE };

/* Filters. */

static int is_singer(const hx_touching *s) { return s->filter <= HX_SINGER; }

/* Time in which an acceleration decays; the others estimate none. */
static double lasting_s(const hx_touching *s) { return is_singer(s) ? s->own[CORRELATION] : 1.0; }

void hx_filter_start(const hx_touching *s, double t_s, double x_mm, double y_mm, hx_filtered *to)
{
    const double *own = s->own;
    double noise = own[s->filter == HX_WHITE_ACCELERATION ? WHITE_NOISE : NOISE];
    double speed = own[s->filter == HX_WHITE_ACCELERATION ? WHITE_FIRST_SPEED : FIRST_SPEED];
    double acceleration = is_singer(s) ? own[ACCELERATION] : 0.0;
    double gentle = own[GENTLE] * acceleration;
    double mean[HX_MODEL] = {
        x_mm, y_mm, 0, 0, 0, 0, noise * noise, 0, 0, speed * speed, 0, acceleration * acceleration,
    };
    memset(to, 0, sizeof *to);
    memcpy(to->mean, mean, sizeof mean);
    to->t_s = t_s;
    if (!is_singer(s))
        return;
    memcpy(to->agile, mean, sizeof mean);
    memcpy(to->gentle, mean, sizeof mean);
    to->gentle[11] = gentle * gentle;
    to->variance = noise * noise;
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
    double noise = s->own[NOISE_REPORTS] > 0.0 ? noise_of(f->recent) : -1.0;
    if (noise >= 0.0) {
        f->reports = fmin(f->reports + 1.0, s->own[NOISE_REPORTS]);
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
    double left = exp(-dt / lasting_s(s)), to_speed = lasting_s(s) * (1.0 - left);
    double to_place = lasting_s(s) * (dt - to_speed);
    double vx = m[2], vy = m[3], ax = m[4], ay = m[5];
    double pxx = m[6], pxv = m[7], pxa = m[8], pvv = m[9], pva = m[10], paa = m[11];
    double jerk = share * (s->own[ACCELERATION] + s->own[PER_SPEED] * hypot(vx, vy));
    jerk *= 2.0 * jerk / lasting_s(s);
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

static void step_two(const hx_touching *s, hx_filtered *f, double t_s, double x_mm, double y_mm)
{
    double dt = t_s - f->t_s, weight = f->weight, gentle[HX_MODEL], agile[HX_MODEL];
    double before = s->own[STAY] * weight + (1.0 - s->own[STAY]) * (1.0 - weight);
    mix(s->own[STAY] * weight / before, f->gentle, f->agile, gentle);
    mix((1.0 - s->own[STAY]) * weight / (1.0 - before), f->gentle, f->agile, agile);
    double likely = moved(s, gentle, dt, s->own[GENTLE], f->variance, x_mm, y_mm);
    double other = moved(s, agile, dt, 1.0, f->variance, x_mm, y_mm);
    double odds = (1.0 - before) / before * exp(fmin(fmax(other - likely, -50.0), 50.0));
    f->weight = fmin(fmax(1.0 / (1.0 + odds), least_weight), 1.0 - least_weight);
    memcpy(f->gentle, gentle, sizeof gentle);
    memcpy(f->agile, agile, sizeof agile);
    mix(f->weight, gentle, agile, f->mean);
}

/* A velocity that wanders by white noise of the acceleration. */
static void step_white(const hx_touching *s, double *m, double dt, double x_mm, double y_mm)
{
    double noise = s->own[WHITE_NOISE] * s->own[WHITE_NOISE], grown = s->own[WHITE_DENSITY] * dt;
    double cross = m[7] + dt * (m[9] + 0.5 * grown), speed = m[9] + grown;
    double place = m[6] + dt * (m[7] + m[7] + dt * (m[9] + grown / 3.0));
    double gain = place / (place + noise), gain_speed = cross / (place + noise);
    double dx = x_mm - (m[0] + m[2] * dt), dy = y_mm - (m[1] + m[3] * dt);
    m[0] += m[2] * dt + gain * dx;
    m[1] += m[3] * dt + gain * dy;
    m[2] += gain_speed * dx;
    m[3] += gain_speed * dy;
    speed -= gain_speed * cross;
    m[6] = noise * gain;
    m[7] = noise * gain_speed;
    m[9] = speed > 0.0 ? speed : 0.0;
}

/* A low pass whose cut-off rises with speed: alpha = 1 / (1 + 1 / (2 pi cut-off dt)). */
static void step_euro(const hx_touching *s, double *m, double *smooth, double dt, double x_mm,
                      double y_mm)
{
    static const double two_pi = 6.283185307179586;
    double turns = two_pi * dt * s->own[EURO_DERIVATIVE], weight = turns / (1.0 + turns);
    double dx = x_mm - m[0], dy = y_mm - m[1];
    smooth[0] += weight * (dx / dt - smooth[0]);
    smooth[1] += weight * (dy / dt - smooth[1]);
    turns = two_pi * dt * (s->own[EURO_CUTOFF] + s->own[EURO_PER_SPEED] * hypot(smooth[0], smooth[1]));
    weight = turns / (1.0 + turns);
    m[0] += weight * dx;
    m[1] += weight * dy;
    m[2] = weight * smooth[0];
    m[3] = weight * smooth[1];
}

void hx_filter_step(const hx_touching *s, hx_filtered *f, double t_s, double x_mm, double y_mm)
{
    double dt = t_s - f->t_s;
    if (is_singer(s))
        learn_noise(s, f, t_s, x_mm, y_mm);
    if (s->filter == HX_TWO_SINGERS)
        step_two(s, f, t_s, x_mm, y_mm);
    else if (s->filter == HX_SINGER)
        moved(s, f->mean, dt, 1.0, f->variance, x_mm, y_mm);
    else if (s->filter == HX_WHITE_ACCELERATION)
        step_white(s, f->mean, dt, x_mm, y_mm);
    else if (dt > 0.0)
        step_euro(s, f->mean, f->agile, dt, x_mm, y_mm);
    f->t_s = t_s;
}

/* Place `ahead_s` after the filter's report. */
static void ahead(const hx_touching *s, const hx_filtered *f, double ahead_s, double *x, double *y)
{
    const double *m = f->mean;
    double to_speed = -lasting_s(s) * expm1(-ahead_s / lasting_s(s));
    double to_place = lasting_s(s) * (ahead_s - to_speed);
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
    hx_filter_start(s, t_s, x_mm, y_mm, &r.filtered);
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
    hx_filter_step(s, &r->filtered, t_s, x_mm, y_mm);
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
static int64_t insert(const hx_touching *s, hx_tracker *t, double t_s, double x_mm, double y_mm)
{
    double later[HX_REPORTS][3];
    int64_t count = 0, outcome = HX_REORDERED;
    for (; t->count && report_at(t, 0)->t_s > t_s + simultaneous_s; t->count--, count++) {
        const hx_report *r = report_at(t, 0);
        later[count][0] = r->t_s;
        later[count][1] = r->x_mm;
        later[count][2] = r->y_mm;
    }
    if (t->count && t_s - report_at(t, 0)->t_s <= simultaneous_s) {
        t_s = report_at(t, 0)->t_s;
        t->count--;
        outcome = HX_COALESCED;
    }
    add(s, t, t_s, x_mm, y_mm);
    while (count--)
        add(s, t, later[count][0], later[count][1], later[count][2]);
    return outcome;
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

int64_t hx_tracker_bytes(void) { return (int64_t)sizeof(hx_tracker); }

double hx_tracker_interval_s(const hx_tracker *t) { return t->interval_s; }

int64_t hx_tracker_push(const hx_touching *s, hx_tracker *t, double t_s, double x_mm, double y_mm)
{
    const hx_report *last = report_at(t, 0);
    double dt = t_s - last->t_s;
    int64_t outcome = HX_TAKEN;
    if (dt > s->lost_after_s)
        restart(s, t, t_s, x_mm, y_mm);
    else if (dt > simultaneous_s &&
             (t->count == 1 || last->t_s - report_at(t, 1)->t_s >= s->least_interval_s)) {
        add(s, t, t_s, x_mm, y_mm);
        if (report_at(t, 0)->is_held)
            return HX_JUMPED;
    } else if (dt >= -simultaneous_s) {
        double at_s = fmax(t_s, last->t_s);
        outcome |= HX_COALESCED;
        t->count--;
        add(s, t, at_s, x_mm, y_mm);
    } else if (dt >= -s->reorder_s &&
               (t_s > report_at(t, t->count - 1)->t_s || t->count < HX_REPORTS))
        outcome |= insert(s, t, t_s, x_mm, y_mm);
    else if (!is_clock_jump(t, t_s))
        return HX_LATE;
    else {
        outcome |= HX_CLOCK_JUMPED;
        restart(s, t, t_s, x_mm, y_mm);
    }
    t->late = 0;
    t->now = *report_at(t, 0);
    t->interval_s = t->now.interval_s;
    return t_s >= report_at(t, 0)->t_s ? outcome | HX_LATEST : outcome;
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
    to->lasting_s = lasting_s(s);
    to->rest_x_mm = now->used_x_mm;
    to->rest_y_mm = now->used_y_mm;
    to->is_sliding = now->is_sliding;
    to->moves_s = fmin(rests_after_s(now->interval_s), s->lost_after_s);
    to->start_s = to->reported_s;
    to->rests_s = to->reported_s + to->moves_s;
}
