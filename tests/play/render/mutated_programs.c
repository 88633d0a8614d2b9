/* Opens and plays damaged copies of a program of a touch, under the compiler's sanitizers.
 *
 * Usage: mutated_programs FILE COUNT SEED. Prints how many were refused and played. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptix_native.h"

static uint64_t state;

static uint64_t random_bits(void)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state;
}

static int64_t below(int64_t n) { return (int64_t)(random_bits() % (uint64_t)n); }

static void put(uint8_t *at, uint64_t value, int bytes)
{
    for (int i = 0; i < bytes; i++)
        at[i] = (uint8_t)(value >> 8 * i);
}

static uint32_t crc(const uint8_t *bytes, int64_t size)
{
    uint32_t sum = 0xFFFFFFFFu;
    for (int64_t i = 0; i < size; i++) {
        sum ^= bytes[i];
        for (int bit = 0; bit < 8; bit++)
            sum = sum >> 1 ^ (sum & 1 ? 0xEDB88320u : 0);
    }
    return ~sum;
}

static double random_double(void)
{
    static const double odd[] = {0.0, -0.0, 1e-320, 1e300, -1e300, 1e12, -1e12, 1e-9, 1.0, -1.0};
    int64_t which = below(16);
    if (which < 10)
        return odd[which];
    return which == 10 ? NAN : which == 11 ? INFINITY : (double)below(2000) / 100.0 - 10.0;
}

/* Change some bytes, most of them in the header and the records, where numbers are read. */
static int64_t mutate(uint8_t *bytes, int64_t size, int64_t records_at)
{
    for (int64_t changes = 1 + below(4); changes > 0; changes--) {
        int64_t from = below(3) == 0 ? 0 : records_at, to = from ? size : 328;
        if (below(8) == 0)
            from = 0, to = size;
        int64_t at = from + below((to - from) / 4) * 4;
        uint64_t bits;
        switch (below(4)) {
        case 0: bytes[at + below(4)] ^= (uint8_t)(1 << below(8)); break;
        case 1: put(bytes + at, random_bits() >> below(64), 4); break;
        case 2: put(bytes + at, (uint64_t)(below(40) - 8), 4); break;
        default:
            if (at + 8 <= size) {
                double value = random_double();
                memcpy(&bits, &value, 8);
                put(bytes + at / 8 * 8, bits, 8);
            }
        }
    }
    int64_t kept = below(10) == 0 ? below(size + 1) : size;
    if (kept >= 328 && below(20) != 0) {
        put(bytes, 0x0A1A0A0D50584889u, 8);
        put(bytes + 8, 2, 4);
        put(bytes + 16, (uint64_t)kept, 4);
        put(bytes + 12, crc(bytes + 16, kept - 16), 4);
    }
    return kept;
}

/* Half of the programs may take over maps of the engine of the whole one. */
static int play(const uint8_t *bytes, int64_t size, const hx_engine *whole)
{
    const hx_engine *before = below(2) ? whole : NULL;
    int64_t room = hx_engine_size_after(bytes, size, before);
    if (room < 0)
        return 0;
    if (room > (int64_t)1 << 28)
        return 0; /* more than this test gives it */
    void *memory = malloc((size_t)room);
    if (!memory)
        abort();
    memset(memory, 0xA5, (size_t)room);
    hx_engine *engine = hx_engine_open_after(bytes, memory, before);
    double highest_v = 0.0;
    for (int i = 0; i < 12; i++) {
        for (int64_t id = 0; id < 3; id++)
            hx_engine_touch(engine, id, i * 0.004, random_double() + i, random_double() + i,
                            random_double(), below(9) != 0);
        const hx_felt *felt = hx_engine_block(engine, 1 + below(HX_POINTS));
        highest_v = felt->highest_v;
        for (int64_t at = 0; at < felt->points * felt->step; at++)
            if (!(fabs(felt->drive_v[at]) <= highest_v))
                abort();
    }
    double row[5][8], gain[8] = {1, 1, 1, 1, 1, 1, 1, 1};
    for (int64_t i = 0; i < 8; i++) {
        for (int k = 0; k < 4; k++)
            row[k][i] = random_double();
        row[4][i] = 0.05 + fabs((double)below(40)) / 10.0;
    }
    hx_motion motion = {
        2, 4, row[0], row[1], row[2], row[3], row[4], below(2) ? 0.0 : (double)below(1000) / 50.0,
        1e-4, 0.5, NULL, NULL,
    };
    hx_engine_play(engine, &motion, gain);
    free(memory);
    return 1;
}

int main(int argc, char **argv)
{
    if (argc != 4)
        return 2;
    FILE *in = fopen(argv[1], "rb");
    if (!in || fseek(in, 0, SEEK_END) != 0)
        return 2;
    int64_t size = ftell(in);
    uint8_t *whole = malloc((size_t)size);
    rewind(in);
    if (!whole || fread(whole, 1, (size_t)size, in) != (size_t)size)
        return 2;
    fclose(in);
    state = 88172645463325252u + strtoull(argv[3], NULL, 10);
    int64_t records_at = whole[72] | (int64_t)whole[73] << 8 | (int64_t)whole[74] << 16;
    long count = strtol(argv[2], NULL, 10), was_played = 0;
    void *memory = malloc((size_t)hx_engine_size(whole, size));
    const hx_engine *engine = memory ? hx_engine_open(whole, size, memory) : NULL;
    if (!play(whole, size, engine))
        return 3;
    for (long i = 0; i < count; i++) {
        uint8_t *bytes = malloc((size_t)size);
        if (!bytes)
            return 2;
        memcpy(bytes, whole, (size_t)size);
        int64_t kept = mutate(bytes, size, records_at);
        uint8_t *copy = malloc((size_t)kept + !kept); /* no byte more than the program has */
        if (!copy)
            return 2;
        memcpy(copy, bytes, (size_t)kept);
        was_played += play(copy, kept, engine);
        free(copy);
        free(bytes);
    }
    printf("%ld refused, %ld played\n", count - was_played, was_played);
    free(memory);
    free(whole);
    return 0;
}
