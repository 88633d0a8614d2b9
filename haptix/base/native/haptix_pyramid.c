/* The levels of a map: smoothed, and from the third on of half the resolution each. */
#include <stddef.h>

#include "haptix_native.h"

enum { REACH = 4, MARGIN = 2, WRAPPED = 1 };

static const double kernel[REACH + 1] = {70 / 256.0, 56 / 256.0, 28 / 256.0, 8 / 256.0, 1 / 256.0};

/* One direction of a level: its pixels, the place of the first in these, and what is beyond. */
typedef struct {
    int64_t pixels, origin, beyond;
} side;

static int64_t around(side s) { return s.beyond == HX_REPEAT ? WRAPPED : MARGIN; }

static int64_t padded(side s) { return s.pixels + 2 * around(s); }

static side smoothed(side s)
{
    int64_t more = s.beyond == HX_REPEAT ? 0 : REACH;
    side after = {s.pixels + 2 * more, s.origin - more, s.beyond};
    return after;
}

/* Every second pixel, those at even places. */
static side halved(side s)
{
    int64_t more = s.beyond == HX_REPEAT ? 0 : 1, origin = s.origin - more, odd = origin & 1;
    side after = {(s.pixels + 2 * more - odd + 1) / 2, (origin + odd) / 2, s.beyond};
    return after;
}

/* Steps of the pixels of the last level, at least. */
static int64_t widest(side x, side y)
{
    int64_t least = x.pixels < y.pixels ? x.pixels : y.pixels;
    if (x.beyond == HX_REPEAT)
        return y.beyond == HX_REPEAT ? least : x.pixels;
    return y.beyond == HX_REPEAT ? y.pixels : 2 * (x.pixels > y.pixels ? x.pixels : y.pixels);
}

int64_t hx_pyramid_size(int64_t rows, int64_t columns, int64_t beyond_x, int64_t beyond_y,
                        int64_t *levels)
{
    side x = {columns, 0, beyond_x}, y = {rows, 0, beyond_y};
    int64_t size = padded(x) * padded(y), end = widest(x, y), longest = 0, step = 1;
    for (*levels = 1; *levels == 1 || step < end; *levels += 1) {
        if (*levels > 1) {
            x = halved(x);
            y = halved(y);
            step *= 2;
        }
        longest = x.pixels > longest ? x.pixels : longest;
        x = smoothed(x);
        y = smoothed(y);
        size += padded(x) * padded(y);
    }
    return size + longest + 4 * REACH;
}

/* Pixel of a line of `pixels` that stands for one beyond its ends; below 0: the value outside. */
static int64_t stands_for(int64_t at, int64_t pixels, int64_t beyond)
{
    if (at >= 0 && at < pixels)
        return at;
    if (beyond == HX_REPEAT)
        return (at % pixels + pixels) % pixels;
    return beyond == HX_OUTSIDE ? INT64_MIN : at < 0 ? 0 : pixels - 1;
}

/* Fill what is around the pixels of a level; outside there is a number in the first channel alone. */
static void surround(double *level, int64_t channels, side x, side y, double outside)
{
    int64_t left = around(x), top = around(y), width = padded(x), rows = padded(y);
    for (int64_t row = 0; row < rows; row++) {
        int64_t of_y = stands_for(row - top, y.pixels, y.beyond);
        for (int64_t column = 0; column < width; column++) {
            int64_t of_x = stands_for(column - left, x.pixels, x.beyond);
            if (of_x == column - left && of_y == row - top)
                continue;
            double *to = level + (row * width + column) * channels;
            int64_t from = of_x < 0 || of_y < 0 ? -1 : (of_y + top) * width + of_x + left;
            for (int64_t i = 0; i < channels; i++)
                to[i] = from >= 0 ? level[from * channels + i] : i == 0 ? outside : 0.0;
        }
    }
}

static hx_level described(const double *values, side x, side y, double pixel_mm, double step)
{
    double columns = (double)padded(x), rows = (double)padded(y), side_mm = pixel_mm * step;
    double slack = 1e-9 * (rows > columns ? rows : columns);
    double column = -0.5 / step - (double)x.origin + (double)around(x);
    double row = -0.5 / step - (double)y.origin + (double)around(y);
    hx_level level = {
        values, padded(x), 1 / side_mm, column, row,
        (slack - column) * side_mm, (columns - 1 - slack - column) * side_mm,
        (slack - row) * side_mm, (rows - 1 - slack - row) * side_mm,
    };
    return level;
}

/* The weighted sum of nine numbers around the middle one. */
static double sum(const double *middle)
{
    double total = middle[0] * kernel[0];
    for (int64_t i = REACH; i > 0; i--)
        total += (middle[-i] + middle[i]) * kernel[i];
    return total;
}

/* Smooth a level, of whose pixels every first or second one is taken, from `first` on. `line` has
 * room for a row and 8 numbers on either side. */
static void smooth(const double *first, int64_t width, int64_t every, side from_x, side from_y,
                   int64_t channels, double outside, double *line, double *level)
{
    side x = smoothed(from_x), y = smoothed(from_y);
    for (int64_t row = 0; row < y.pixels; row++) {
        const double *of[2 * REACH + 1]; /* NULL: outside */
        for (int64_t i = -REACH; i <= REACH; i++) {
            int64_t at = row + y.origin - from_y.origin + i;
            at = stands_for(at, from_y.pixels, from_y.beyond);
            of[REACH + i] = at < 0 ? NULL : first + at * every * width * channels;
        }
        for (int64_t column = 0; column < from_x.pixels; column++) {
            double nine[2 * REACH + 1];
            for (int64_t i = 0; i <= 2 * REACH; i++)
                nine[i] = of[i] ? of[i][column * every * channels] : outside;
            line[column] = sum(nine + REACH);
        }
        for (int64_t i = 1; i <= 2 * REACH; i++) {
            int64_t left = stands_for(-i, from_x.pixels, from_x.beyond);
            int64_t right = stands_for(from_x.pixels - 1 + i, from_x.pixels, from_x.beyond);
            line[-i] = left < 0 ? outside : line[left];
            line[from_x.pixels - 1 + i] = right < 0 ? outside : line[right];
        }
        double *to = level + ((row + around(y)) * padded(x) + around(x)) * channels;
        for (int64_t column = 0; column < x.pixels; column++)
            to[column * channels] = sum(line + column + x.origin - from_x.origin);
    }
}

void hx_pyramid_make(int64_t rows, int64_t columns, int64_t channels, double pixel_mm,
                     double outside, int64_t beyond_x, int64_t beyond_y, hx_level *levels,
                     double *numbers)
{
    side x = {columns, 0, beyond_x}, y = {rows, 0, beyond_y};
    int64_t count, step = 1;
    hx_pyramid_size(rows, columns, beyond_x, beyond_y, &count);
    surround(numbers, channels, x, y, outside);
    levels[0] = described(numbers, x, y, pixel_mm, 1.0);
    double *before = numbers;
    for (int64_t number = 1; number < count; number++) {
        double *level = before + padded(x) * padded(y) * channels;
        side from_x = x, from_y = y;
        int64_t width = padded(x), every = 1;
        const double *first = before + (around(y) * width + around(x)) * channels;
        if (number > 1) {
            x = halved(x);
            y = halved(y);
            /* The first pixel may be one of those around. */
            first += ((2 * y.origin - from_y.origin) * width + 2 * x.origin - from_x.origin) * channels;
            every = 2;
            step *= 2;
        }
        side wide = smoothed(x), high = smoothed(y);
        double *line = level + padded(wide) * padded(high) * channels + 2 * REACH;
        for (int64_t i = 0; i < channels; i++)
            smooth(first + i, width, every, x, y, channels, i == 0 ? outside : 0.0, line, level + i);
        x = wide;
        y = high;
        surround(level, channels, x, y, outside);
        levels[number] = described(level, x, y, pixel_mm, (double)step);
        before = level;
    }
}

double *hx_pyramid_row(double *numbers, int64_t columns, int64_t channels, int64_t beyond_x,
                       int64_t beyond_y, int64_t row)
{
    side x = {columns, 0, beyond_x}, y = {1, 0, beyond_y};
    return numbers + ((row + around(y)) * padded(x) + around(x)) * channels;
}
