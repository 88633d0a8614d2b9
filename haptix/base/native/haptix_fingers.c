/* Fingers at the points of a block. */
#include <math.h>

#include "haptix_native.h"

typedef struct {
    double x_mm, y_mm, vx_mm_s, vy_mm_s;
} prediction;

/* Place and velocity at a time, at most `lost_after_s` from the report; of a finger that rests, the
 * place that was reported. */
static prediction predicted(const hx_following *f, const hx_track *t, double t_s)
{
    double rested_s = t_s - t->rests_s;
    double age_s = (rested_s > 0.0 ? t->rests_s : t_s) - t->reported_s, limit_s = f->lost_after_s;
    double ahead_s = f->latency_s + (age_s < limit_s ? age_s : limit_s);
    ahead_s = ahead_s > -limit_s ? ahead_s : -limit_s;
    double to_speed = 0.0, to_place = 0.0;
    if (t->ax_mm_s2 != 0.0 || t->ay_mm_s2 != 0.0) {
        to_speed = -t->lasting_s * expm1(-ahead_s / t->lasting_s);
        to_place = t->lasting_s * (ahead_s - to_speed);
    }
    prediction p = {
        t->x_mm + t->vx_mm_s * ahead_s + t->ax_mm_s2 * to_place,
        t->y_mm + t->vy_mm_s * ahead_s + t->ay_mm_s2 * to_place,
        t->vx_mm_s + t->ax_mm_s2 * to_speed,
        t->vy_mm_s + t->ay_mm_s2 * to_speed,
    };
    if (rested_s > 0.0) {
        double left = exp(-rested_s / f->blend_s);
        p.x_mm = t->rest_x_mm + left * (p.x_mm - t->rest_x_mm);
        p.y_mm = t->rest_y_mm + left * (p.y_mm - t->rest_y_mm);
        p.vx_mm_s = p.vy_mm_s = 0.0;
    }
    return p;
}

void hx_finger_place(const hx_following *following, const hx_track *track, double t_s,
                     double *place)
{
    prediction p = predicted(following, track, t_s);
    place[0] = p.x_mm;
    place[1] = p.y_mm;
    place[2] = p.vx_mm_s;
    place[3] = p.vy_mm_s;
}

/* It rises while the finger gets drive, then falls. */
double hx_finger_gain(const hx_following *f, const hx_track *t, int64_t at_rest, double t_s)
{
    double until_s = t->start_s, last_s = at_rest ? t->reported_s + f->lost_after_s : t->rests_s;
    if (t->is_down && (t->is_sliding || at_rest) && last_s > until_s)
        until_s = last_s;
    double rising_s = (t_s < until_s ? t_s : until_s) - t->start_s;
    double falling_s = t_s - until_s;
    double gain = t->gain + (rising_s > 0.0 ? rising_s : 0.0) / f->fade_s;
    gain = (gain < 1.0 ? gain : 1.0) - (falling_s > 0.0 ? falling_s : 0.0) / f->fade_s;
    return gain > 0.0 ? gain : 0.0;
}

void hx_finger_update(const hx_following *f, hx_track *track, const hx_track *before,
                      int64_t at_rest, double t0_s)
{
    track->start_s = t0_s;
    /* Two intervals from its start on: reports are late, but all by about the same. */
    track->rests_s = fmin(t0_s + track->moves_s, track->reported_s + f->lost_after_s);
    track->dx_mm = track->dy_mm = track->df_n = track->gain = 0.0;
    if (!before)
        return;
    track->gain = hx_finger_gain(f, before, at_rest, t0_s);
    /* A finger that was lost, and whose drive had faded out, begins anew. */
    if (track->gain <= 0.0 && before->reported_s + f->lost_after_s < t0_s)
        return;
    prediction was = predicted(f, before, t0_s), is = predicted(f, track, t0_s);
    double passed_s = t0_s - before->start_s;
    double left = exp(-(passed_s > 0.0 ? passed_s : 0.0) / f->blend_s);
    track->dx_mm = was.x_mm + left * before->dx_mm - is.x_mm;
    track->dy_mm = was.y_mm + left * before->dy_mm - is.y_mm;
    track->df_n = before->normal_force_n + left * before->df_n - track->normal_force_n;
}

static int gets_drive(const hx_following *f, const hx_track *t, int64_t at_rest, double t0_s,
                      double step_s, int64_t points)
{
    for (int64_t i = 1; i <= points; i++)
        if (hx_finger_gain(f, t, at_rest, t0_s + step_s * (double)i) > 0.0)
            return 1;
    return 0;
}

int64_t hx_fingers(const hx_following *following, const hx_track *tracks, int64_t count,
                   double t0_s, double step_s, int64_t points, int64_t at_rest, double *numbers)
{
    int64_t n = 0;
    for (int64_t k = 0; k < count; k++)
        n += gets_drive(following, &tracks[k], at_rest, t0_s, step_s, points);
    int64_t size = n * points;
    double *x = numbers, *y = x + size, *force = y + size, *gain = force + size;
    double *left = gain + size, *vx = left + points, *vy = vx + n;
    double *which = vy + n, *fastest = which + n;
    double each = exp(-step_s / following->blend_s);
    for (int64_t i = 0; i < points; i++)
        left[i] = i == 0 ? each : left[i - 1] * each;
    *fastest = 0.0;
    for (int64_t k = 0, to = 0; k < count; k++) {
        const hx_track *t = &tracks[k];
        if (!gets_drive(following, t, at_rest, t0_s, step_s, points))
            continue;
        /* While it moves, a parabola through the predictions at the begin, the middle and the end.
         * It errs by 2 um over 10 ms where the acceleration of 10 m/s^2 that they assume decays
         * within 0.3 s. From when it rests on, it goes to the place that was reported. */
        double moves_s = fmin(fmax(t->rests_s - t0_s, 0.0), step_s * (double)points);
        prediction first = predicted(following, t, t0_s);
        prediction half = predicted(following, t, t0_s + moves_s / 2);
        prediction last = predicted(following, t, t0_s + moves_s);
        double back = exp((t->rests_s > t0_s ? moves_s : 0.0) / following->blend_s);
        double passed_s = t0_s - t->start_s;
        double decay = exp(-(passed_s > 0.0 ? passed_s : 0.0) / following->blend_s);
        double dx = decay * t->dx_mm, dy = decay * t->dy_mm, df = decay * t->df_n;
        for (int64_t i = 0, at = to * points; i < points; i++, at++) {
            double u = moves_s > 0.0 ? step_s * (double)(i + 1) / moves_s : 2.0;
            if (u <= 1.0) {
                double of_first = (2 * u - 1) * (u - 1), of_half = 4 * u * (1 - u);
                double of_last = u * (2 * u - 1);
                x[at] = first.x_mm * of_first + half.x_mm * of_half + last.x_mm * of_last;
                y[at] = first.y_mm * of_first + half.y_mm * of_half + last.y_mm * of_last;
            } else {
                x[at] = t->rest_x_mm + back * left[i] * (last.x_mm - t->rest_x_mm);
                y[at] = t->rest_y_mm + back * left[i] * (last.y_mm - t->rest_y_mm);
            }
            x[at] += dx * left[i];
            y[at] += dy * left[i];
            force[at] = t->normal_force_n + df * left[i];
            gain[at] = hx_finger_gain(following, t, at_rest, t0_s + step_s * (double)(i + 1));
        }
        vx[to] = half.vx_mm_s;
        vy[to] = half.vy_mm_s;
        which[to] = (double)k;
        double speed = hypot(vx[to], vy[to]);
        *fastest = speed > *fastest ? speed : *fastest;
        to++;
    }
    return n;
}

void hx_line(const double *knot_s, const double *knot, int64_t knots, double t0_s, double step_s,
             int64_t points, double *values)
{
    int64_t next = 0, end = knots; /* first knot after the first point */
    while (next < end) {
        int64_t middle = next + (end - next) / 2;
        if (knot_s[middle] <= t0_s + step_s)
            next = middle + 1;
        else
            end = middle;
    }
    for (int64_t i = 0; i < points; next++) {
        double start_s = 0.0, start = knot[next == 0 ? 0 : next - 1], slope = 0.0, until_s = INFINITY;
        if (next < knots)
            until_s = knot_s[next];
        if (0 < next && next < knots) {
            start_s = knot_s[next - 1];
            slope = (knot[next] - start) / (until_s - start_s);
        }
        for (; i < points; i++) {
            double t_s = t0_s + step_s * (double)(i + 1);
            if (t_s >= until_s)
                break;
            values[i] = slope * (t_s - start_s) + start;
        }
    }
}
