/* From numbers of a texture to drive samples: inversion, envelope, carrier. */
#include <math.h>
#include <stddef.h>

#include "haptix_native.h"

/* Numbers of haptix.model.status.Status. */
enum { OK = 0, PULL_IN = 1, BELOW = 2, ABOVE = 3, OUT_OF_RANGE = 4 };

static const double slack = 1e-9;     /* relative: rounding puts no end of a column out of range */
static const double near_end = 1e-6;  /* relative: rounding does not change what ends a column */
static const double least_mu = 1e-150; /* frictions of 0 and below have no inverse */

/* Friction against voltage at one force: -1/mu lies between two neighbouring columns. */
typedef struct {
    const double *low, *high;
    double part, pull_in_v, end_drive, end_v, first_inverse, end_inverse, lowest_mu, highest_mu;
    int64_t force_cell, drive_cell; /* where the last search ended: the next point is near */
    int8_t ends_by, is_inside;
} column;

static double between(double low, double high, double part) { return low + part * (high - low); }

static double inverse_at(const column *c, int64_t node)
{
    return between(c->low[node], c->high[node], c->part);
}

/* Cell of x among nodes, the last one that begins at x or below, or the first one; from `cell`. */
static int64_t cell_of(const double *nodes, int64_t count, double x, int64_t cell)
{
    while (cell > 0 && x < nodes[cell])
        cell--;
    while (cell < count - 2 && x >= nodes[cell + 1])
        cell++;
    return cell;
}

/* -1/mu at a drive within the column; the search begins at a cell, and leaves its own there. */
static double inverse_of(const hx_slice *s, const column *c, double drive, int64_t *from)
{
    int64_t cell = *from = cell_of(s->drive, s->drives, drive, *from);
    double low = inverse_at(c, cell), start = s->drive[cell];
    double slope = (inverse_at(c, cell + 1) - low) / (s->drive[cell + 1] - start);
    return low + slope * (drive - start);
}

/* Move a column to a force; one that begins has 0 as its cells. */
static void move(const hx_slice *s, column *c, double force_n)
{
    int64_t width = s->drives + 2, cell = 0, end_cell = s->drives - 2;
    c->part = 0.0;
    if (s->forces > 1) {
        double log_force = log(force_n), low, high;
        c->force_cell = cell = cell_of(s->log_force, s->forces, log_force, c->force_cell);
        low = s->log_force[cell];
        high = s->log_force[cell + 1];
        c->part = (log_force - low) / (high - low);
        c->part = c->part < 0.0 ? 0.0 : c->part > 1.0 ? 1.0 : c->part;
    }
    c->low = s->columns + cell * width;
    c->high = s->forces > 1 ? c->low + width : c->low;
    c->pull_in_v = s->unit_v * exp(inverse_at(c, s->drives));
    double end_v = s->limit_v, breakdown_v = INFINITY;
    if (s->limited_by) {
        breakdown_v = s->unit_v * exp(inverse_at(c, s->drives + 1));
        end_v = breakdown_v < end_v ? breakdown_v : end_v;
    }
    double ratio = end_v / c->pull_in_v, last = s->drive[s->drives - 1];
    c->end_drive = ratio * ratio < last ? ratio * ratio : last;
    c->end_v = c->pull_in_v * sqrt(c->end_drive);
    c->end_v = c->end_v < s->limit_v ? c->end_v : s->limit_v;
    c->ends_by = c->end_drive >= s->pull_in_drive * (1 - near_end) ? PULL_IN : ABOVE;
    if (breakdown_v <= c->end_v * (1 + near_end) && breakdown_v < s->limit_v)
        c->ends_by = (int8_t)s->limited_by;
    c->is_inside = s->lowest_n <= force_n && force_n <= s->highest_n;
    c->first_inverse = inverse_at(c, 0);
    c->end_inverse = inverse_of(s, c, c->end_drive, &end_cell);
    c->lowest_mu = -1.0 / c->first_inverse;
    c->highest_mu = -1.0 / c->end_inverse;
}

/* Amplitude of a friction, or of the nearest in the reachable range, and its status. */
static double invert(const hx_slice *s, column *c, double mu, int8_t *status)
{
    double goal = -1.0 / (mu < least_mu ? least_mu : mu);
    int64_t cell = c->drive_cell;
    while (cell > 0 && goal < inverse_at(c, cell))
        cell--;
    while (cell < s->drives - 2 && goal >= inverse_at(c, cell + 1))
        cell++;
    c->drive_cell = cell;
    double start = inverse_at(c, cell), drive = s->drive[cell];
    if (!(goal <= start)) {
        double rise = inverse_at(c, cell + 1) - start;
        drive += (goal - start) * (s->drive[cell + 1] - drive) / (rise > 1e-300 ? rise : 1e-300);
    }
    drive = drive > c->end_drive ? c->end_drive : drive;
    /* All of these are below 0: the slack widens the range. */
    *status = goal > (1 - slack) * c->end_inverse     ? c->ends_by
              : goal < (1 + slack) * c->first_inverse ? BELOW
                                                      : OK;
    if (!c->is_inside)
        *status = OUT_OF_RANGE;
    double amplitude_v = c->pull_in_v * sqrt(drive);
    return amplitude_v > c->end_v ? c->end_v : amplitude_v;
}

void hx_slice_reach(const hx_slice *slice, const double *force_n, int64_t n, double *lowest_mu,
                    double *highest_mu)
{
    column c = {0};
    for (int64_t i = 0; i < n; i++) {
        if (i == 0 || force_n[i] != force_n[i - 1])
            move(slice, &c, force_n[i]);
        lowest_mu[i] = c.lowest_mu;
        highest_mu[i] = c.highest_mu;
    }
}

void hx_slice_friction(const hx_slice *slice, const double *force_n, const double *amplitude_v,
                       int64_t n, double *mu)
{
    column c = {0};
    for (int64_t i = 0; i < n; i++) {
        if (i == 0 || force_n[i] != force_n[i - 1])
            move(slice, &c, force_n[i]);
        double v = amplitude_v[i] > c.end_v ? c.end_v : amplitude_v[i];
        double root = v / c.pull_in_v;
        mu[i] = -1.0 / inverse_of(slice, &c, root * root, &c.drive_cell);
    }
}

double hx_as_mu(int64_t target, double value, double lowest, double highest)
{
    return target == 0   ? value
           : target == 1 ? lowest * (1 + value)
                         : lowest + value * (highest - lowest);
}

static double wanted_mu(const hx_rendering *r, double value, double lowest, double highest)
{
    double mu = hx_as_mu(r->target, value, lowest, highest);
    if (!r->compresses)
        return mu;
    double bottom = hx_as_mu(r->target, r->span_low, lowest, highest);
    double top = hx_as_mu(r->target, r->span_high, lowest, highest);
    /* A texture that lies wholly outside the range goes to the nearest end. */
    double low = bottom > lowest ? bottom : lowest, high = top < highest ? top : highest;
    return low + (mu - bottom) / (top - bottom) * (high > low ? high - low : 0.0);
}

/* Amplitude of one finger at one point by one slice; also the friction and its status. */
static double wanted_v(const hx_rendering *r, const hx_block *b, const hx_slice *s, column *c,
                       int64_t at, int64_t point, double *mu, int8_t *status)
{
    double lowest = c->lowest_mu, highest = c->highest_mu;
    *mu = wanted_mu(r, b->value[at], lowest, highest);
    if (b->added) { /* up to the end of the range; then the intensity scales what is above */
        double most = *mu > highest ? *mu : highest;
        double more = *mu + b->added[at] * (highest - lowest);
        *mu = more > most ? most : more;
    }
    if (b->intensity)
        *mu = lowest + b->intensity[point] * (*mu - lowest);
    return invert(s, c, *mu, status);
}

/* Amplitudes that all fingers together ask for at each point. */
static void combine(const hx_rendering *r, const hx_block *b, double *target_mu, int8_t *status,
                    double *amplitude_v)
{
    for (int64_t point = 0; point < b->points; point++)
        amplitude_v[point] = b->fingers ? 0.0 : b->idle_v;
    for (int64_t finger = 0; finger < b->fingers; finger++) {
        column less = {0}, more = {0};
        for (int64_t point = 0; point < b->points; point++) {
            int64_t at = finger * b->points + point;
            double force_n = b->force_n[at];
            if (point == 0 || force_n != b->force_n[at - 1]) {
                move(b->less, &less, force_n);
                if (b->more)
                    move(b->more, &more, force_n);
            }
            double v = wanted_v(r, b, b->less, &less, at, point, &target_mu[at], &status[at]);
            if (b->more) {
                double mu;
                int8_t other;
                double more_v = wanted_v(r, b, b->more, &more, at, point, &mu, &other);
                double part = b->parts ? b->parts[point] : b->part;
                v = between(v, more_v, part);
                target_mu[at] = between(target_mu[at], mu, part);
                status[at] = status[at] == OK ? other : status[at];
            }
            v *= b->gain[at];
            double *all = &amplitude_v[point];
            if (finger == 0)
                *all = v;
            else if (r->combination == 0)
                *all = v > *all || isnan(v) ? v : *all;
            else if (r->combination == 2)
                *all += v;
        }
    }
    for (int64_t point = 0; point < b->points; point++) {
        double *all = &amplitude_v[point];
        if (r->combination == 2 && b->fingers > 1)
            *all /= (double)b->fingers;
        *all = *all > r->most_v ? r->most_v : *all;
    }
}

static void limit_slope(const hx_rendering *r, double before_v, double *amplitude_v, int64_t points)
{
    for (int64_t i = 0; i < points; i++) {
        double change = amplitude_v[i] - before_v;
        if (change > r->most_step_v)
            amplitude_v[i] = before_v + r->most_step_v;
        else if (change < -r->most_step_v)
            amplitude_v[i] = before_v - r->most_step_v;
        before_v = amplitude_v[i];
    }
}

/* Let the amplitudes end at the last of those that are queued. */
static void join(const hx_rendering *r, const hx_block *b, double *amplitude_v)
{
    int64_t count = b->queued < r->joined ? b->queued : r->joined;
    double *end = amplitude_v + b->points - count, last = b->queued_v[b->queued - 1], reach = 0.0;
    const double *queued = b->queued_v + b->queued - count;
    for (int64_t i = 0; i < count; i++)
        end[i] += (double)(i + 1) / (double)count * (queued[i] - end[i]);
    limit_slope(r, b->before_v, amplitude_v, b->points);
    /* No further from the end than its slope allows: of two such limits the slope is kept. */
    for (int64_t i = b->points - 1; i >= 0; i--) {
        amplitude_v[i] = amplitude_v[i] > last + reach   ? last + reach
                         : amplitude_v[i] < last - reach ? last - reach
                                                         : amplitude_v[i];
        reach = r->most_step_v * (double)(b->points - i);
    }
}

void hx_render(const hx_rendering *rendering, const hx_block *block, double *numbers,
               int8_t *status)
{
    double *amplitude_v = numbers + block->fingers * block->points;
    double *drive_v = amplitude_v + block->points;
    combine(rendering, block, numbers, status, amplitude_v);
    if (block->queued > 0)
        join(rendering, block, amplitude_v);
    limit_slope(rendering, block->before_v, amplitude_v, block->points);
    double before_v = block->before_v, per_step = 1.0 / (double)rendering->step;
    int64_t phase = block->phase;
    for (int64_t point = 0; point < block->points; point++) {
        double change = amplitude_v[point] - before_v;
        for (int64_t i = 0; i < rendering->step; i++, drive_v++) {
            *drive_v = (before_v + change * ((double)i * per_step)) * block->wave[phase];
            if (++phase == block->period)
                phase = 0;
        }
        before_v = amplitude_v[point];
    }
}
