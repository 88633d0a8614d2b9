/* Separations of rough surfaces: integrals over the waves that have come into view.
 *
 * The steps are those of WavesIntegral of haptix.model.contact.tables, which torch
 * takes where gradients are asked for. One exponential has what torch multiplies: J, the waves'
 * opening, and 1/tau. */
#include <math.h>

#include "haptix_native.h"

/* The line of ln T and ln(dT/dw / (2 q E*)) at a wave; cells are looked for from `cell` on. */
static const double *line_at(const hx_waves *waves, double wave, int64_t *cell)
{
    double place = (wave - waves->nodes[0]) * waves->per_hint;
    if (place >= 1.0) {
        int64_t last = waves->cells - 1;
        int64_t hint = waves->hints[place < (double)last ? (int64_t)place : last];
        *cell = hint > *cell ? hint : *cell;
    }
    while (*cell < waves->cells - 1 && waves->nodes[*cell + 1] <= wave)
        ++*cell;
    return waves->lines + 4 * *cell;
}

/* ln of the tabulated J, at ln y within the table. */
static double log_j(const hx_waves *waves, double log_y)
{
    double place = (log_y - waves->start) * waves->per_step, most = (double)(waves->j_nodes - 2);
    int64_t at = (int64_t)(place < most ? place : most);
    const double *cubic = waves->cubics + 4 * at;
    double t = place - (double)at;
    return ((cubic[3] * t + cubic[2]) * t + cubic[1]) * t + cubic[0];
}

static double separation(const hx_waves *waves, double pressure, double below, double low)
{
    double total = 0.0, log_pressure = log(pressure), least = pressure * waves->least;
    const double *rule = waves->rules;
    int64_t cell = 0;
    least = 0.5 * least * least; /* rounding must not take tau below its value at the start */
    for (int64_t panel = 0; panel < waves->panels; rule += 2 * waves->points[panel++]) {
        double span = waves->ends[panel] - low, part = 0.0;
        if (!(span > 0.0))
            continue;
        for (int64_t k = 0; k < waves->points[panel]; k++) {
            double wave = low + span * ((1.0 + rule[2 * k]) / 2.0);
            const double *line = line_at(waves, wave, &cell);
            double square = exp(line[0] + line[1] * wave) - below;
            double log_tau = 0.5 * log(square > least ? square : least);
            double log_y = log_pressure - log_tau, opening = line[2] + line[3] * wave - log_tau;
            double small = waves->start - log_y; /* where J grows as the logarithm of 1/y */
            if (!(log_y < waves->end))
                continue;
            if (small > 0.0)
                part += rule[2 * k + 1] * exp(opening) *
                        (exp(log_j(waves, waves->start)) + waves->growth * small);
            else
                part += rule[2 * k + 1] * exp(opening + log_j(waves, log_y));
        }
        total += span * part;
        low = waves->ends[panel];
    }
    return total;
}

void hx_over_waves(const hx_waves *waves, int64_t n, const double *pressure, const double *variance,
                   const double *low, double *total)
{
    for (int64_t i = 0; i < n; i++)
        total[i] = separation(waves, pressure[i], variance[i], low[i]);
}
