/* Equilibria of contacts whose spots the attraction widens: the lowest branch of each state.
 *
 * The steps are those of haptix.model.fidelity.mean_field and WideningAttraction, which torch takes
 * where gradients are asked for. What depends on the contact alone is found once for neighbouring
 * states that differ in the drive alone. */
#include <math.h>

#include "haptix_native.h"

enum { TOTAL, SHARE, LIFT, PARTS };
enum { LIMIT_STEPS = 3, BISECTIONS = 48, NEWTON_STEPS = 80 };

static const double settled = 1e-5, least_curvature = 1e-6;

/* Polynomials of the rise of one contact: [powers][nodes] of each part, and for a single power their
 * slopes per step too, once they are found. */
typedef struct {
    const hx_widening *table;
    const double *of[PARTS], *slopes[PARTS];
    int64_t powers, stride;
    double per_step, log_applied, applied;
} contact;

typedef struct {
    double value, slope;
} result;

static double held(double x, double low, double high) /* NaN becomes `low` */
{
    x = x > low ? x : low;
    return x < high ? x : high;
}

static inline double inner_difference(const double *v, int64_t at)
{
    return (v[at - 2] - v[at + 2] + 8.0 * (v[at + 1] - v[at - 1])) / 12.0;
}

/* Rise per step at a node, as `differences` of haptix.model.contact.tables. */
static double difference(const double *v, int64_t nodes, int64_t at)
{
    if (at >= 2 && at < nodes - 2)
        return inner_difference(v, at);
    if (at == 0)
        return -1.5 * v[0] + 2.0 * v[1] - 0.5 * v[2];
    if (at == nodes - 1)
        return 1.5 * v[at] - 2.0 * v[at - 1] + 0.5 * v[at - 2];
    return (v[at + 1] - v[at - 1]) / 2.0;
}

/* A polynomial of the rise at ln p, and its slope. */
static inline result polynomial(const contact *c, int part, double log_pressure, int64_t powers)
{
    const hx_widening *table = c->table;
    double place = (log_pressure - table->start) * c->per_step, most = (double)(table->nodes - 2);
    int64_t cell = (int64_t)held(place, 0.0, most);
    double t = place - (double)cell, rise = log_pressure - c->log_applied;
    rise = rise < table->largest_rise ? rise : table->largest_rise;
    double value = 0.0, by_place = 0.0, by_rise = 0.0;
    for (int64_t power = powers; power-- > 0;) {
        const double *v = c->of[part] + power * c->stride, *slopes = c->slopes[part];
        double first = slopes ? slopes[cell] : difference(v, table->nodes, cell);
        double next = slopes ? slopes[cell + 1] : difference(v, table->nodes, cell + 1);
        double step = v[cell + 1] - v[cell], a = first - step, b = step - next;
        double second = b - 2.0 * a, third = a - b;
        by_rise = by_rise * rise + value;
        value = value * rise + (((third * t + second) * t + first) * t + v[cell]);
        by_place = by_place * rise + ((3.0 * third * t + 2.0 * second) * t + first);
    }
    return (result){value, by_place * c->per_step + by_rise};
}

/* A part of the effect at ln p, and its slope. The usual counts are constants for the compiler. */
static result part_at(const contact *c, int part, double log_pressure)
{
    switch (c->powers) {
    case 1: return polynomial(c, part, log_pressure, 1);
    case 7: return polynomial(c, part, log_pressure, 7);
    default: return polynomial(c, part, log_pressure, c->powers);
    }
}

/* I at ln p, and its slope. */
static result attraction(const contact *c, double log_pressure)
{
    result log_total = part_at(c, TOTAL, log_pressure);
    double value = exp(log_total.value);
    return (result){value, value * log_total.slope};
}

/* Ln p at which ln of applied pressure plus the gaps' attraction is `log_limit`. */
static double limit(const contact *c, double log_limit)
{
    double last = log_limit + c->table->log_widest;
    double at = log_limit + c->table->log_widest / 2.0;
    for (int i = 0; i < LIMIT_STEPS; i++) {
        result log_share = part_at(c, SHARE, at);
        double rise = at - c->log_applied, share = exp(log_share.value);
        double gaps = expm1(rise) * share;
        double steepness = ((gaps + share) + gaps * log_share.slope) / (1.0 + gaps);
        double lack = log_limit - c->log_applied - log1p(gaps);
        at = held(at + lack / held(steepness, c->table->flattest, c->table->steepest), log_limit,
                  last);
    }
    return at;
}

/* 1 - (1 - p0/p) dlnI/dlnp: above 0 where (p - p0)/I rises with p. */
static double rising(const contact *c, double log_pressure)
{
    double share = 1.0 - c->applied * exp(-log_pressure);
    return 1.0 - share * part_at(c, TOTAL, log_pressure).slope;
}

/* Ln p of the first fold before the limit, or the limit; `slopes` are those of ln I per
 * step at nodes. */
static double first_end(const contact *c, const double *slopes, int64_t from, int64_t to,
                        double limit)
{
    const hx_widening *table = c->table;
    for (int64_t node = from; node < to; node++) {
        double at = table->start + table->step * (double)node;
        /* On the branch p0 is below p, so that flatter curves have no fold. */
        if (!(slopes[node] > table->step) || at <= c->log_applied || at >= limit + table->step ||
            !((1.0 - c->applied * exp(-at)) * slopes[node] > table->step))
            continue;
        double low = at - table->step, high = at;
        low = low > c->log_applied ? low : c->log_applied;
        for (int i = 0; i < BISECTIONS; i++) {
            double middle = (low + high) / 2.0;
            if (rising(c, middle) >= 0.0)
                low = middle;
            else
                high = middle;
        }
        return low < limit ? low : limit;
    }
    return limit;
}

/* Pressure at a share of the strength that ends the branch: see `_interpolated`. */
static double interpolated(const contact *c, double share, double end, result rest, result at_end)
{
    double least = c->applied / end, fall = 1.0 - least;
    double first = fall / least * rest.value / at_end.value;
    double left = 1.0 - fall * at_end.slope / at_end.value;
    double last = least * fall / (left > least_curvature ? left : least_curvature);
    first = first < 3.0 * fall ? first : 3.0 * fall;
    last = last < 3.0 * fall ? last : 3.0 * fall;
    double bend = share * (1.0 - share) *
                  ((fall - first) * (1.0 - share) + (last - fall) * share);
    return c->applied / (1.0 - fall * share + bend);
}

/* Newton's method for p0/p, with bisection where a step would leave the bracket: see `_root`. The
 * unknown is r = p/p0; returns it after a step that hardly moved it, with ln I and its slope there. */
static double root(const contact *c, double strength, double r, double end, result *pull)
{
    double low = 1.0, high = end;
    int is_small = 0;
    for (int i = 0;; i++) {
        *pull = part_at(c, TOTAL, c->log_applied + log(r));
        if (is_small || i == NEWTON_STEPS)
            return r;
        double excess = r - 1.0 - strength * exp(pull->value); /* over p0 */
        if (excess < 0.0)
            low = r;
        else
            high = r;
        double steepness = 1.0 + (r - 1.0) * (1.0 - pull->slope);
        double trial = r * steepness / (steepness + excess);
        is_small = fabs(trial - r) <= settled * r;
        r = is_small || (trial > low && trial < high) ? trial : (low + high) / 2.0;
    }
}

/* Write a part at the nodes from one to another, for the contact's rise there, into a row. */
static void along(const contact *c, int part, int64_t from, int64_t to, const double *restrict rise,
                  double *restrict row)
{
    for (int64_t node = from; node < to; node++)
        row[node] = 0.0;
    for (int64_t power = c->powers; power-- > 0;) {
        const double *restrict v = c->of[part] + power * c->stride;
        for (int64_t node = from; node < to; node++)
            row[node] = row[node] * rise[node] + v[node];
    }
}

/* Write the slopes per step of a part at the nodes into a row. */
static void slopes_along(const contact *c, int part, int64_t from, int64_t to, const double *rise,
                         double *row)
{
    int64_t nodes = c->table->nodes;
    if (c->powers == 1 && from >= 2 && to <= nodes - 2) { /* which compilers vectorize */
        for (int64_t node = from; node < to; node++)
            row[node] = inner_difference(c->of[part], node);
        return;
    }
    for (int64_t node = from; node < to; node++) {
        double value = 0.0, by_rise = 0.0, by_place = 0.0;
        for (int64_t power = c->powers; power-- > 0;) {
            const double *v = c->of[part] + power * c->stride;
            by_rise = by_rise * rise[node] + value;
            value = value * rise[node] + v[node];
            by_place = by_place * rise[node] + difference(v, nodes, node);
        }
        row[node] = by_place + by_rise * c->table->step;
    }
}

void hx_widening_branches(const hx_widening *table, int64_t n, const int64_t *column,
                          const double *applied_pa, const double *log_limit,
                          const double *strength, int64_t of_end, double *row,
                          double *pressure_pa, double *strength_at_end, uint8_t *is_stable,
                          double *gaps, double *lift)
{
    contact c = {0};
    double *slopes = row + PARTS * table->nodes, *rise = slopes + PARTS * table->nodes;
    double end = 0.0, bearable = 0.0;
    result rest = {0.0, 0.0}, at_end = {0.0, 0.0};
    for (int64_t i = 0; i < n; i++) {
        if (i == 0 || column[i] != column[i - 1] || applied_pa[i] != applied_pa[i - 1] ||
            log_limit[i] != log_limit[i - 1]) {
            c = (contact){.table = table, .powers = table->powers, .stride = PARTS * table->nodes};
            c.per_step = 1.0 / table->step;
            c.applied = applied_pa[i];
            c.log_applied = log(c.applied);
            for (int part = 0; part < PARTS; part++)
                c.of[part] = table->effect + column[i] * table->powers * c.stride +
                             part * table->nodes;
            double first = (c.log_applied - table->start) / table->step;
            double last = (log_limit[i] + table->log_widest - table->start) / table->step;
            int64_t from = (int64_t)held(floor(first) - 3.0, 0.0, (double)table->nodes);
            int64_t to = (int64_t)held(floor(last) + 5.0, 0.0, (double)table->nodes);
            for (int64_t node = from; node < to; node++)
                rise[node] = held(table->start + table->step * (double)node - c.log_applied,
                                  table->least_rise, table->largest_rise);
            if (table->by_contact) {
                for (int part = 0; part < PARTS; part++) {
                    along(&c, part, from, to, rise, row + part * table->nodes);
                    c.of[part] = row + part * table->nodes;
                }
                c.powers = 1;
            }
            /* Of one power the slopes serve all steps, of several only the search for a fold. */
            for (int part = 0; part < (c.powers == 1 ? PARTS : 1); part++) {
                slopes_along(&c, part, from, to, rise, slopes + part * table->nodes);
                if (c.powers == 1)
                    c.slopes[part] = slopes + part * table->nodes;
            }
            double log_end = first_end(&c, slopes, from, to, limit(&c, log_limit[i]));
            end = exp(log_end);
            rest = attraction(&c, c.log_applied);
            at_end = attraction(&c, log_end);
            bearable = (end - c.applied) / at_end.value;
        }
        double wanted = of_end ? strength[i] * bearable : strength[i];
        int stable = wanted <= bearable;
        double pressure = end, total = at_end.value;
        if (stable) {
            double per_load = wanted / c.applied;
            double start = interpolated(&c, wanted / bearable, end, rest, at_end);
            result pull;
            double r = root(&c, per_load, start / c.applied, end / c.applied, &pull);
            double value = exp(pull.value), stiffness = 1.0 - per_load * value * pull.slope / r;
            if (stiffness > 1e-9) {
                double step = (r - 1.0 - per_load * value) / stiffness;
                pressure = c.applied * (r - step);
                total = value * (1.0 - pull.slope * step / r);
                if (!(fabs(step) < 1e-7 * r)) /* near a fold */
                    total = attraction(&c, log(pressure)).value;
            }
        }
        double log_pressure = log(pressure), share = part_at(&c, SHARE, log_pressure).value;
        pressure_pa[i] = pressure;
        strength_at_end[i] = bearable;
        is_stable[i] = (uint8_t)stable;
        gaps[i] = total * exp(share < 0.0 ? share : 0.0);
        lift[i] = part_at(&c, LIFT, log_pressure).value;
    }
}
