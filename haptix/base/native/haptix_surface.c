/* The friction surface at many points.
 *
 * Each step goes over a chunk of points: its short loops overlap, where one long loop would wait
 * for every look-up. */
#include <math.h>

#include "haptix_native.h"

enum { CHUNK = 256, CORNERS = 8 };

/* Numbers of haptix.model.status.Status. */
enum { OK = 0, PULL_IN = 1, OUT_OF_RANGE = 4 };

static const double slack = 1 + 1e-9; /* rounding puts no end of a column out of range */

/* Add the cell of each x, in units of `stride`, to `row`, and write the position in it from 0 to 1;
 * values beyond the ends are held there. */
static void find(const hx_cells *cells, const double *x, int64_t n, int64_t stride, int64_t *row,
                 double *part)
{
    double most = (double)(cells->places - 1);
    for (int64_t i = 0; i < n; i++) {
        double place = (x[i] - cells->start) * cells->per_width;
        place = place > 0.0 ? place : 0.0; /* NaN too */
        int64_t cell = cells->guide[(int64_t)(place < most ? place : most)];
        for (int64_t step = 0; step < cells->steps; step++)
            cell += x[i] >= cells->upper[cell];
        double at = cells->offset[cell] + x[i] * cells->scale[cell];
        at = at < 0.0 ? 0.0 : at;
        part[i] = at > 1.0 ? 1.0 : at;
        row[i] += stride * cell;
    }
}

/* For a constant number of axes, which the compiler unrolls. */
static inline void evaluate(const hx_surface *s, const double *voltage_v,
                            const double *const *log_place, int64_t total, double *mu,
                            int64_t *status, int axes)
{
    int corners = 1 << axes;
    int64_t width = s->width, stride[3] = {1, 1, 1}, offset[CORNERS] = {0};
    for (int axis = axes - 1; axis > 0; axis--)
        stride[axis - 1] = stride[axis] * (s->axis[axis].cells + 1);
    for (int corner = 0; corner < corners; corner++)
        for (int axis = 0; axis < axes; axis++)
            if (corner >> (axes - 1 - axis) & 1)
                offset[corner] += stride[axis];

    double weight[CHUNK][CORNERS], part[3][CHUNK], drive[CHUNK], in_cell[CHUNK];
    double pull_in_v[CHUNK], breakdown_v[CHUNK];
    int64_t row[CHUNK], first[CHUNK];
    for (int64_t start = 0; start < total; start += CHUNK) {
        int64_t n = total - start < CHUNK ? total - start : CHUNK;
        for (int64_t i = 0; i < n; i++)
            row[i] = 0;
        for (int axis = 0; axis < axes; axis++)
            find(&s->axis[axis], log_place[axis] + start, n, stride[axis], row, part[axis]);
        for (int64_t i = 0; i < n; i++) {
            double *w = weight[i], log_pull_in = 0.0, log_breakdown = 0.0;
            w[0] = 1.0;
            for (int axis = 0, count = 1; axis < axes; axis++, count *= 2)
                for (int k = count - 1; k >= 0; k--) {
                    double both = w[k];
                    w[2 * k + 1] = both * part[axis][i];
                    w[2 * k] = both - w[2 * k + 1];
                }
            const double *ends = s->ends + 2 * row[i];
            for (int k = 0; k < corners; k++) {
                log_pull_in += w[k] * ends[2 * offset[k]];
                log_breakdown += w[k] * ends[2 * offset[k] + 1];
            }
            pull_in_v[i] = log_pull_in;
            breakdown_v[i] = log_breakdown;
        }
        for (int64_t i = 0; i < n; i++) {
            pull_in_v[i] = s->unit_v * exp(pull_in_v[i]);
            breakdown_v[i] = s->limited_by ? s->unit_v * exp(breakdown_v[i]) : INFINITY;
        }
        for (int64_t i = 0; i < n; i++) {
            double voltage = voltage_v[start + i], ratio = voltage / pull_in_v[i];
            double end_v = breakdown_v[i] < s->limit_v ? breakdown_v[i] : s->limit_v;
            double end = end_v / pull_in_v[i], at = ratio * ratio, top = end * end;
            top = top < s->last_drive ? top : s->last_drive;
            int is_inside = voltage <= s->limit_v * slack;
            for (int axis = 0; axis < axes; axis++) {
                double place = log_place[axis][start + i];
                is_inside &= place >= s->lowest[axis];
                is_inside &= place <= s->highest[axis];
            }
            status[start + i] = !is_inside                          ? OUT_OF_RANGE
                                : at > s->pull_in_drive * slack    ? PULL_IN
                                : voltage > breakdown_v[i] * slack ? s->limited_by
                                                                   : OK;
            drive[i] = at > top ? top : at;
            first[i] = row[i] * width;
        }
        find(&s->drive, drive, n, 1, first, in_cell);
        for (int64_t i = 0; i < n; i++) {
            const double *column = s->columns + first[i], *w = weight[i];
            double low = 0.0, high = 0.0;
            for (int k = 0; k < corners; k++) {
                low += w[k] * column[offset[k] * width];
                high += w[k] * column[offset[k] * width + 1];
            }
            mu[start + i] = -1.0 / (low + in_cell[i] * (high - low));
        }
    }
}

void hx_surface_evaluate(const hx_surface *surface, const double *voltage_v,
                         const double *const *log_place, int64_t n, double *mu, int64_t *status)
{
    switch (surface->axes) {
    case 0: evaluate(surface, voltage_v, log_place, n, mu, status, 0); break;
    case 1: evaluate(surface, voltage_v, log_place, n, mu, status, 1); break;
    case 2: evaluate(surface, voltage_v, log_place, n, mu, status, 2); break;
    default: evaluate(surface, voltage_v, log_place, n, mu, status, 3); break;
    }
}
