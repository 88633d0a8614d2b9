/* Maps at falling resolutions, read between their pixels. */
#include <math.h>

#include "haptix_native.h"

static double held(double place, double low, double high)
{
    return place < low ? low : place > high ? high : place;
}

/* Bilinear values of a level; those of the rim for places beyond. */
static void read_level(const hx_level *level, int64_t channels, double x_mm, double y_mm,
                       double *values)
{
    double across = held(x_mm, level->low_x, level->high_x) * level->per_mm + level->column;
    double down = held(y_mm, level->low_y, level->high_y) * level->per_mm + level->row;
    int64_t left = (int64_t)across, above = (int64_t)down; /* neither is below 0 */
    const double *upper = level->values + (above * level->columns + left) * channels;
    const double *lower = upper + level->columns * channels;
    across -= (double)left;
    down -= (double)above;
    for (int64_t i = 0; i < channels; i++) {
        double over = upper[i] + (upper[i + channels] - upper[i]) * across;
        double under = lower[i] + (lower[i + channels] - lower[i]) * across;
        values[i] = over + (under - over) * down;
    }
}

void hx_map_sample(const hx_map *map, const double *x_mm, const double *y_mm, double depth,
                   const double *depths, int64_t n, double *values)
{
    double far = map->farthest_mm, last = (double)(map->count - 1);
    for (int64_t i = 0; i < n; i++, values += map->channels) {
        double x = x_mm[i], y = y_mm[i], deep = depths ? depths[i] : depth;
        if (!(x >= -far && x <= far && y >= -far && y <= far)) { /* NaN too */
            for (int64_t j = 0; j < map->channels; j++)
                values[j] = j == 0 ? map->outside : 0.0;
            continue;
        }
        if (map->period_x_mm > 0)
            x -= map->period_x_mm * floor(x / map->period_x_mm);
        if (map->period_y_mm > 0)
            y -= map->period_y_mm * floor(y / map->period_y_mm);
        deep = deep > 0 ? (deep < last ? deep : last) : 0.0;
        int64_t level = (int64_t)deep;
        read_level(map->levels + level, map->channels, x, y, values);
        deep -= (double)level;
        if (deep > 0) {
            double coarse[2];
            read_level(map->levels + level + 1, map->channels, x, y, coarse);
            for (int64_t j = 0; j < map->channels; j++)
                values[j] += deep * (coarse[j] - values[j]);
        }
    }
}
