/* Reads a program of a touch. Every place, size and number is checked before it is used. */
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "haptix_program.h"

enum { VERSION = 2, HEADER = 328, MATERIAL = 128, REGION = 88, CHECKED_FROM = 16 };

enum { COMPRESSES = 1, DRIVES_AT_REST = 2, IS_LAYOUT = 4 };

static const uint8_t magic[8] = {137, 'H', 'X', 'P', 13, 10, 26, 10};
static const uint32_t no_material = 0xFFFFFFFFu;
static const int64_t most_bytes = 1 << 30, most_pixels = 1 << 24, longest_side = 1 << 16;
static const int64_t most_nodes = 1 << 16, longest_step = 1024;
static const double largest = 1e12; /* of any number: no product of a few overflows */

static uint32_t uint_at(const uint8_t *at)
{
    return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

static float float_at(const uint8_t *at)
{
    uint32_t bits = uint_at(at);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static double real_at(const uint8_t *at)
{
    uint64_t bits = (uint64_t)uint_at(at) | (uint64_t)uint_at(at + 4) << 32;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* CRC-32 as zlib's. */
static uint32_t checksum(const uint8_t *bytes, int64_t size)
{
    uint32_t table[16], crc = 0xFFFFFFFFu;
    for (uint32_t i = 0; i < 16; i++) {
        table[i] = i;
        for (int bit = 0; bit < 4; bit++)
            table[i] = table[i] >> 1 ^ (table[i] & 1 ? 0xEDB88320u : 0);
    }
    for (int64_t i = 0; i < size; i++) {
        crc ^= bytes[i];
        crc = crc >> 4 ^ table[crc & 15];
        crc = crc >> 4 ^ table[crc & 15];
    }
    return ~crc;
}

typedef struct {
    const uint8_t *bytes;
    int64_t size;
    const hx_program *before;
} file;

/* Whether `count` items of a width lie in the file, from a place on. */
static int holds(const file *f, uint32_t at, int64_t count, int64_t width)
{
    return at >= HEADER && at % 8 == 0 && count * width <= f->size - (int64_t)at;
}

static int is_between(double value, double least, double most)
{
    return value >= least && value <= most; /* false for NaN */
}

static int are_between(const uint8_t *at, int64_t count, double least, double most)
{
    for (int64_t i = 0; i < count; i++)
        if (!is_between(real_at(at + 8 * i), least, most))
            return 0;
    return 1;
}

static int rises(const uint8_t *at, int64_t count)
{
    for (int64_t i = 1; i < count; i++)
        if (!(real_at(at + 8 * i) > real_at(at + 8 * (i - 1))))
            return 0;
    return 1;
}

int64_t hx_table_size(int64_t table)
{
    int64_t harmonics = table == 0 ? 0 : (int64_t)1 << (table - 1);
    return 16 * (harmonics < 4 ? 4 : harmonics);
}

static int64_t tables_size(int64_t tables)
{
    int64_t size = 0;
    for (int64_t i = 0; i < tables; i++)
        size += hx_table_size(i);
    return size;
}

static int is_power_of_two(int64_t n) { return (n & (n - 1)) == 0; }

/* Doubles and levels that each of `maps` takes up; 0 if they cannot be. */
static int64_t map_size(const file *f, const uint8_t *m, int64_t maps, int64_t *levels)
{
    int64_t rows = uint_at(m + 36), columns = uint_at(m + 40);
    uint32_t beyond_x = uint_at(m + 44), beyond_y = uint_at(m + 48);
    if (rows < 1 || rows > longest_side || columns < 1 || columns > longest_side ||
        rows * columns > most_pixels || beyond_x > HX_REPEAT || beyond_y > HX_REPEAT)
        return 0;
    if ((beyond_x == HX_REPEAT && !is_power_of_two(columns)) ||
        (beyond_y == HX_REPEAT && !is_power_of_two(rows)))
        return 0;
    int64_t pixels = maps * rows * columns;
    if (!holds(f, uint_at(m + 32), pixels, 4))
        return 0;
    for (int64_t i = 0; i < pixels; i++)
        if (!is_between((double)float_at(f->bytes + uint_at(m + 32) + 4 * i), -largest, largest))
            return 0;
    return hx_pyramid_size(rows, columns, beyond_x, beyond_y, levels);
}

/* Whether a material changes another one, and may be without: its number stands at 40. */
static int changes(uint32_t kind) { return kind >= KIND_BY_SPEED && kind <= KIND_MOVING; }

/* Rows of numbers of a material, each as long as its record says. */
static int64_t rows_of(uint32_t kind)
{
    switch (kind) {
    case KIND_SLIDER:
    case KIND_CURVE: return 1;
    case KIND_BY_SPEED:
    case KIND_BY_FORCE: return 2;
    case KIND_MOVING: return 4;
    default: return 0;
    }
}

static int is_size(double value) { return is_between(value, 1e-9, 1e6); }

/* Whether the numbers of a control can be, or of a material that changes another one. */
static int can_be(const file *f, const uint8_t *m, uint32_t number)
{
    uint32_t kind = uint_at(m), at = uint_at(m + 32), count = uint_at(m + 36), of = uint_at(m + 40);
    int64_t numbers = rows_of(kind) * (int64_t)count;
    const uint8_t *first = f->bytes + at;
    if (numbers && (!holds(f, at, numbers, 8) || !are_between(first, numbers, -largest, largest)))
        return 0;
    if (changes(kind) && of >= number && (of != no_material || kind == KIND_MOVING))
        return 0; /* none lies in itself */
    if (!are_between(m + 56, 9, -largest, largest))
        return 0;
    switch (kind) {
    case KIND_SLIDER: return count >= 2 && rises(first, count) && is_size(real_at(m + 72));
    case KIND_TOGGLE: return are_between(m + 72, 3, 1e-9, 1e6);
    case KIND_DIAL: return count >= 1 && are_between(m + 72, 3, 1e-9, 1e6);
    case KIND_BY_SPEED:
    case KIND_BY_FORCE: return count >= 2 && rises(first, count);
    case KIND_BUTTON:
        return are_between(m + 80, 2, 1e-9, 1e6) && is_between(real_at(m + 72), 0.0, 1e6) &&
               are_between(m + 96, 2, 1e-9, 1e6);
    case KIND_CURVE:
        return count >= 1 && uint_at(m + 44) <= HX_EVENTS && is_between(real_at(m + 64), 1.0, 1e6) &&
               is_between(real_at(m + 72), 0.0, 1e6);
    case KIND_MOVING:
        return uint_at(m + 44) <= 1 &&
               (count == 0 || (count >= 2 && rises(first, count) && real_at(first) == 0.0));
    default: return 0;
    }
}

/* The map that a material takes over from the program before; NULL if it has its own. */
static const hx_map *kept_map(const uint8_t *m, const hx_program *before)
{
    uint32_t number = uint_at(m + 52);
    if (!before || uint_at(m + 32) != 0 || number >= before->materials)
        return NULL;
    return &before->material[number].map;
}

static int64_t pyramids_size(const file *f, const uint8_t *m, int64_t maps)
{
    const hx_map *kept = kept_map(m, f->before);
    if (kept)
        return kept->channels == maps ? 0 : HX_WRONG_NUMBER;
    int64_t levels = 0, size = map_size(f, m, maps, &levels);
    if (size == 0 || levels > HX_LEVELS)
        return HX_WRONG_NUMBER;
    return 8 * size * maps + (int64_t)sizeof(hx_level) * levels;
}

/* Bytes that a material takes up, or HX_WRONG_NUMBER. */
static int64_t material_size(const file *f, const uint8_t *m, uint32_t number)
{
    uint32_t kind = uint_at(m);
    if (uint_at(m + 4) > TARGET_SHARE || !is_between(real_at(m + 8), -largest, largest) ||
        !are_between(m + 16, 2, -1.0, 1.0))
        return HX_WRONG_NUMBER;
    if (kind == KIND_UNIFORM)
        return 0;
    if (kind == KIND_MAP) {
        if (!is_size(real_at(m + 56)) || !is_between(real_at(m + 64), 0.0, 1e6) ||
            !are_between(m + 72, 2, 0.0, 1e12))
            return HX_WRONG_NUMBER;
        return pyramids_size(f, m, 1);
    }
    if (kind == KIND_RELIEF) {
        if (!are_between(m + 56, 2, -largest, largest) || !is_between(real_at(m + 72), 0.0, 1e6) ||
            !are_between(m + 80, 2, 0.0, 1e12) || !is_between(real_at(m + 96), 0.0, 1.0) ||
            !is_size(real_at(m + 104)))
            return HX_WRONG_NUMBER;
        return pyramids_size(f, m, 2);
    }
    if (kind == KIND_GRATING) {
        uint32_t tables = uint_at(m + 36);
        if (tables < 1 || tables > MOST_TABLES || uint_at(m + 40) > WAVE_SAWTOOTH)
            return HX_WRONG_NUMBER;
        int64_t size = tables_size(tables);
        if (!holds(f, uint_at(m + 32), size, 8) ||
            !are_between(f->bytes + uint_at(m + 32), size, -largest, largest) ||
            !is_size(real_at(m + 56)) || !are_between(m + 64, 3, -largest, largest) ||
            !is_between(real_at(m + 88), 0.0, 1.0))
            return HX_WRONG_NUMBER;
        return 8 * size;
    }
    return can_be(f, m, number) ? 8 * rows_of(kind) * (int64_t)uint_at(m + 36) : HX_WRONG_NUMBER;
}

/* How many materials lie in each other, from one inwards, of those that move or of all. */
static int64_t nested(const uint8_t *materials, uint32_t number, int moving)
{
    int64_t depth = 0;
    for (;;) {
        const uint8_t *m = materials + (int64_t)number * MATERIAL;
        if (!changes(uint_at(m)) || uint_at(m + 40) == no_material || depth > MOST_NESTED)
            return depth + (!moving || uint_at(m) == KIND_MOVING);
        depth += !moving || uint_at(m) == KIND_MOVING;
        number = uint_at(m + 40);
    }
}

int64_t hx_program_depth(const uint8_t *bytes)
{
    int64_t deepest = 0;
    for (uint32_t i = 0; i < uint_at(bytes + 52); i++) {
        int64_t depth = nested(bytes + uint_at(bytes + 72), i, 1);
        deepest = depth > deepest ? depth : deepest;
    }
    return deepest;
}

/* Bytes that a region takes up, or HX_WRONG_NUMBER. */
static int64_t region_size(const file *f, const uint8_t *r, uint32_t materials)
{
    uint32_t mask = uint_at(r + 4), shape = uint_at(r + 8), corners = uint_at(r + 20);
    if (uint_at(r) >= materials || (mask >= materials && mask != no_material) ||
        shape > SHAPE_POLYGON || uint_at(r + 12) > BLEND_MIN ||
        !are_between(r + 32, 3, -largest, largest) || !is_between(real_at(r + 56), 1e-9, 1e6) ||
        !are_between(r + 64, 2, 1e-9, 1e6) || !is_between(real_at(r + 80), 0.0, 1.0))
        return HX_WRONG_NUMBER;
    if (shape != SHAPE_POLYGON)
        return 0;
    if (corners < 3 || corners > 256 || !holds(f, uint_at(r + 24), corners, 16) ||
        !are_between(f->bytes + uint_at(r + 24), 2 * corners, -largest, largest))
        return HX_WRONG_NUMBER;
    return 16 * (int64_t)corners;
}

static int64_t slice_doubles(const uint8_t *h)
{
    int64_t forces = uint_at(h + 36), drives = uint_at(h + 40);
    return forces + drives + forces * (drives + 2);
}

/* Whether the slice and the numbers of the header can be. */
static int is_possible(const file *f)
{
    const uint8_t *h = f->bytes;
    int64_t forces = uint_at(h + 36), drives = uint_at(h + 40);
    uint32_t step = uint_at(h + 20), wave = uint_at(h + 48), slice_at = uint_at(h + 64);
    if (step < 1 || step > longest_step || uint_at(h + 24) > TARGET_SHARE || uint_at(h + 28) > 2 ||
        uint_at(h + 32) > 7 || forces < 1 || forces > most_nodes || drives < 2 ||
        drives > most_nodes || uint_at(h + 44) > 127 || wave < 1 || wave > most_nodes)
        return 0;
    if (!holds(f, slice_at, slice_doubles(h), 8) || !holds(f, uint_at(h + 68), wave, 8))
        return 0;
    const uint8_t *log_force = h + slice_at, *drive = log_force + 8 * forces;
    const uint8_t *column = drive + 8 * drives;
    if (!are_between(log_force, forces, -100.0, 100.0) || !rises(log_force, forces) ||
        !are_between(drive, drives, 0.0, largest) || !rises(drive, drives))
        return 0;
    for (int64_t i = 0; i < forces; i++, column += 8 * (drives + 2))
        if (!are_between(column, drives, -largest, -1.0 / largest) ||
            !are_between(column + 8 * drives, 2, -100.0, 100.0))
            return 0;
    /* Rates, then volts, then the ends of the range, forces, times and speeds. */
    return are_between(h + uint_at(h + 68), wave, -1.0, 1.0) && are_between(h + 80, 2, 1.0, 1e9) &&
           are_between(h + 96, 2, 0.0, 1e6) && are_between(h + 112, 2, -largest, largest) &&
           (!(uint_at(h + 32) & COMPRESSES) || real_at(h + 120) > real_at(h + 112)) &&
           are_between(h + 128, 3, 1e-9, largest) && are_between(h + 152, 3, 1e-9, largest) &&
           is_between(real_at(h + 176), 0.0, 1.0) && are_between(h + 184, 3, 1e-6, 1e3) &&
           are_between(h + 208, 2, 0.0, 1e6) && is_between(real_at(h + 224), 1e-9, 1e9) &&
           is_between(real_at(h + 232), 0.0, 1e9) && are_between(h + 240, 3, 1e-9, 1e9) && is_between(real_at(h + 264), 0.0, 1e9) &&
           are_between(h + 272, 2, 1e-6, 1.0 - 1e-6) && are_between(h + 288, 5, 0.0, 1e6) &&
           is_between(real_at(h + 304), 1e-9, 1e6);
}

int64_t hx_program_size(const uint8_t *bytes, int64_t size, const hx_program *before)
{
    file f = {bytes, size, before};
    if (size < HEADER || memcmp(bytes, magic, sizeof magic) != 0)
        return HX_NO_PROGRAM;
    if (uint_at(bytes + 8) != VERSION)
        return HX_OTHER_VERSION;
    if ((int64_t)uint_at(bytes + 16) != size)
        return HX_NO_PROGRAM;
    if (uint_at(bytes + 12) != checksum(bytes + CHECKED_FROM, size - CHECKED_FROM))
        return HX_DAMAGED;
    uint32_t materials = uint_at(bytes + 52), regions = uint_at(bytes + 56);
    uint32_t materials_at = uint_at(bytes + 72), regions_at = uint_at(bytes + 76);
    if (!is_possible(&f) || uint_at(bytes + 60) >= materials ||
        !holds(&f, materials_at, materials, MATERIAL) || !holds(&f, regions_at, regions, REGION))
        return HX_WRONG_NUMBER;
    int64_t total = 8 * (slice_doubles(bytes) + uint_at(bytes + 48));
    for (uint32_t i = 0; i < materials; i++) {
        int64_t more = material_size(&f, bytes + materials_at + (int64_t)i * MATERIAL, i);
        if (more < 0)
            return more;
        if (nested(bytes + materials_at, i, 0) > MOST_NESTED)
            return HX_WRONG_NUMBER;
        total += (int64_t)sizeof(hx_material) + more;
        if (total > most_bytes)
            return HX_TOO_LARGE;
    }
    for (uint32_t i = 0; i < regions; i++) {
        int64_t more = region_size(&f, bytes + regions_at + (int64_t)i * REGION, materials);
        if (more < 0)
            return more;
        total += (int64_t)sizeof(hx_region) + more;
    }
    return total > most_bytes ? HX_TOO_LARGE : total;
}

/* Copy numbers of the file to the memory, which goes on behind them. */
static double *taken(const uint8_t *from, int64_t count, uint8_t **memory)
{
    double *to = (double *)(void *)*memory;
    for (int64_t i = 0; i < count; i++)
        to[i] = real_at(from + 8 * i);
    *memory += 8 * count;
    return to;
}

int64_t hx_program_recalls(const uint8_t *bytes)
{
    for (uint32_t i = 0; i < uint_at(bytes + 52); i++) {
        const uint8_t *m = bytes + uint_at(bytes + 72) + (int64_t)i * MATERIAL;
        if (uint_at(m) == KIND_BUTTON || (uint_at(m) == KIND_CURVE && uint_at(m + 44) != 0))
            return 1;
    }
    return 0;
}

/* Make the map of `maps` of pixels that lie one after the other in the file, in the memory. */
static hx_map read_map(const uint8_t *m, const uint8_t *values, int64_t maps, double pixel_mm,
                       double outside, uint8_t **memory)
{
    int64_t rows = uint_at(m + 36), columns = uint_at(m + 40), count;
    int64_t beyond_x = uint_at(m + 44), beyond_y = uint_at(m + 48);
    int64_t size = hx_pyramid_size(rows, columns, beyond_x, beyond_y, &count);
    hx_level *levels = (hx_level *)(void *)*memory;
    *memory += sizeof(hx_level) * (size_t)count;
    double *numbers = (double *)(void *)*memory;
    *memory += 8 * size * maps;
    for (int64_t i = 0; i < rows * columns * maps; i++) {
        int64_t row = i / columns % rows, column = i % columns, map = i / (rows * columns);
        double *to = hx_pyramid_row(numbers, columns, maps, beyond_x, beyond_y, row);
        to[column * maps + map] = (double)float_at(values + 4 * i);
    }
    hx_pyramid_make(rows, columns, maps, pixel_mm, outside, beyond_x, beyond_y, levels, numbers);
    hx_map map = {
        levels, count, maps,
        beyond_x == HX_REPEAT ? (double)columns * pixel_mm : 0.0,
        beyond_y == HX_REPEAT ? (double)rows * pixel_mm : 0.0,
        HX_FARTHEST_MM, outside,
    };
    return map;
}

static void read_material(const uint8_t *bytes, const uint8_t *m, const hx_program *before,
                          hx_material *to, uint8_t **memory)
{
    const hx_map *kept = kept_map(m, before);
    const uint8_t *numbers = bytes + uint_at(m + 32);
    double real[9];
    for (int i = 0; i < 9; i++)
        real[i] = real_at(m + 56 + 8 * i);
    memset(to, 0, sizeof *to);
    to->kind = uint_at(m);
    to->target = uint_at(m + 4);
    to->outside = real_at(m + 8);
    to->cosine = real_at(m + 16);
    to->sine = real_at(m + 24);
    to->numbers = uint_at(m + 36);
    to->of = !changes(uint_at(m)) || uint_at(m + 40) == no_material ? -1 : (int64_t)uint_at(m + 40);
    to->low = real[0];
    to->high = real[1];
    to->ramp_mm = real[2];
    to->width_mm = real[3];
    to->height_mm = real[4];
    if (rows_of(uint_at(m)))
        to->number = taken(numbers, rows_of(uint_at(m)) * to->numbers, memory);
    switch (to->kind) {
    case KIND_MAP:
        to->pixel_mm = real[0];
        to->sharp_mm = real[1];
        to->width_mm = real[2];
        to->height_mm = real[3];
        to->map = kept ? *kept : read_map(m, numbers, 1, to->pixel_mm, to->outside, memory);
        break;
    case KIND_GRATING:
        to->wave = uint_at(m + 40);
        to->number = taken(numbers, tables_size(to->numbers), memory);
        to->period_mm = real[0];
        to->phase = real[1];
        to->low = real[2];
        to->high = real[3];
        to->duty = real[4];
        break;
    case KIND_DIAL:
        to->about_x_mm = real[5];
        to->about_y_mm = real[6];
        break;
    case KIND_RELIEF:
        to->bias = real[5];
        to->pixel_mm = real[6];
        to->map = kept ? *kept : read_map(m, numbers, 2, to->pixel_mm, 0.0, memory); /* right, down */
        break;
    case KIND_BUTTON:
        to->press_n = real[5];
        to->release_n = real[6];
        break;
    case KIND_CURVE:
        to->begins = uint_at(m + 44);
        to->first = real[0];
        to->rate_hz = real[1];
        to->period_s = real[2];
        break;
    case KIND_MOVING:
        to->loops = uint_at(m + 44);
        memcpy(to->rate, real, sizeof to->rate);
        to->about_x_mm = real[3];
        to->about_y_mm = real[4];
        break;
    default: break;
    }
}

static void read_region(const uint8_t *bytes, const uint8_t *r, hx_region *to, uint8_t **memory)
{
    uint32_t mask = uint_at(r + 4), priority = uint_at(r + 16);
    memset(to, 0, sizeof *to);
    to->material = uint_at(r);
    to->mask = mask == no_material ? -1 : (int64_t)mask;
    to->shape = uint_at(r + 8);
    to->blend = uint_at(r + 12);
    to->priority = (int64_t)priority - (priority >> 31 ? (int64_t)1 << 32 : 0);
    to->x_mm = real_at(r + 32);
    to->y_mm = real_at(r + 40);
    to->angle_rad = real_at(r + 48);
    to->scale = real_at(r + 56);
    to->width_mm = real_at(r + 64);
    to->height_mm = real_at(r + 72);
    to->opacity = to->glide.opacity = real_at(r + 80);
    to->glide.inner[3] = 1.0;
    to->glide.place_end_s = to->glide.opacity_end_s = -INFINITY;
    to->facts_before = -1;
    if (to->shape == SHAPE_POLYGON) {
        to->corners = uint_at(r + 20);
        to->corner_mm = taken(bytes + uint_at(r + 24), 2 * to->corners, memory);
    }
}

void hx_program_read(const uint8_t *bytes, hx_program *program, uint8_t *memory,
                     const hx_program *before)
{
    const uint8_t *h = bytes, *slice = bytes + uint_at(h + 64);
    int64_t forces = uint_at(h + 36), drives = uint_at(h + 40);
    program->period = uint_at(h + 48);
    program->materials = uint_at(h + 52);
    program->regions = uint_at(h + 56);
    program->background = uint_at(h + 60);
    program->sample_rate_hz = real_at(h + 80);
    program->assumed_n = real_at(h + 168);
    program->is_layout = uint_at(h + 32) & IS_LAYOUT ? 1 : 0;
    program->drives_at_rest = uint_at(h + 32) & DRIVES_AT_REST ? 1 : 0;
    hx_touching touching = {
        {0}, real_at(h + 208), real_at(h + 216), real_at(h + 288), real_at(h + 296), real_at(h + 304),
        real_at(h + 312), real_at(h + 320), real_at(h + 184), HX_TWO_SINGERS,
    };
    program->touching = touching;
    for (int i = 0; i < HX_PARAMETERS; i++)
        program->touching.own[i] = real_at(h + 224 + 8 * i);
    hx_following following = {
        real_at(h + 176), real_at(h + 184), real_at(h + 192), real_at(h + 200),
    };
    program->following = following;
    hx_rendering rendering = {
        uint_at(h + 24), uint_at(h + 32) & COMPRESSES, real_at(h + 112), real_at(h + 120), uint_at(h + 28),
        real_at(h + 96), real_at(h + 104), uint_at(h + 20), 1,
    };
    program->rendering = rendering;
    const double *numbers = taken(slice, slice_doubles(h), &memory);
    hx_slice table = {
        forces, drives, numbers, numbers + forces, numbers + forces + drives,
        real_at(h + 128), real_at(h + 136), real_at(h + 144), real_at(h + 152), real_at(h + 160),
        uint_at(h + 44),
    };
    program->slice = table;
    program->wave = taken(bytes + uint_at(h + 68), program->period, &memory);
    hx_material *material = (hx_material *)(void *)memory;
    memory += sizeof *material * (size_t)program->materials;
    for (int64_t i = 0; i < program->materials; i++)
        read_material(bytes, bytes + uint_at(h + 72) + i * MATERIAL, before, &material[i], &memory);
    hx_region *region = (hx_region *)(void *)memory;
    memory += sizeof *region * (size_t)program->regions;
    for (int64_t i = 0; i < program->regions; i++) {
        read_region(bytes, bytes + uint_at(h + 76) + i * REGION, &region[i], &memory);
        region[i].facts = i;
    }
    program->material = material;
    program->region = region;
}
