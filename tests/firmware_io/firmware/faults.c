/* `make faults`: a failure at every step of recorded sessions, and bits of the core's memory that flip.
 *
 * SESSIONS sessions of a host (bytes and output samples, by chance) are recorded with what they play.
 * Then, at each step of each: the host dies, goes away, a byte of the step is lost, doubled or has a
 * bit flipped, the board resets, or browns out and 32 bits of its memory are others. The output must
 * be what was recorded, or leave it and be at 0 V a ramp later (for a byte that is lost, and shows
 * itself only with the next, a watchdog time; for a brown-out, keep the limits), and at 0 V a
 * watchdog time after the host's last word. FLIPS times one bit of the core's memory flips between two steps; the output must
 * stay within ceiling, slew, energy and mean, or be at 0 V within 15 ms.
 *
 * The same program runs on an emulated Cortex-M (`make faults-cortex-m`, HX_EMULATED).
 */
#include "fuzz.c"

#define RAMP 80u      /* 5 ms */
#define WATCHDOG 640u /* 40 ms */
#define IN_TIME 240u  /* 15 ms */
#define MOST_STEPS 100u
#define MOST_TICKS 8192u
#define SLACK 4 /* codes, of a carrier's rounding in the energy and mean below */

typedef struct {
    uint32_t bytes, begin; /* of what the host says; 0 if the step is time */
    uint32_t ticks;
} step;

typedef struct {
    hx_device device;
    uint32_t at; /* output samples before it */
} moment;

static step steps[MOST_STEPS];
static moment moments[MOST_STEPS + 1u];
static uint32_t count, said, ticks_played;
static uint8_t words[40000];
static int16_t recorded[MOST_TICKS], played[MOST_TICKS];
static uint32_t random_state = 1;

static uint32_t chance(uint32_t n) {
    random_state = random_state * 1664525u + 1013904223u;
    return (uint32_t)((uint64_t)(random_state >> 4) * n >> 28);
}

/* Record a step, and take it. */
static void take(uint32_t bytes, uint32_t ticks) {
    demand(count < MOST_STEPS && said + bytes < sizeof words && ticks_played + ticks < MOST_TICKS);
    moments[count].device = device;
    moments[count].at = ticks_played;
    steps[count].bytes = bytes;
    steps[count].begin = said;
    steps[count++].ticks = ticks;
    hx_device_receive(&device, words + said, bytes);
    hx_device_play(&device, recorded + ticks_played, NULL, ticks);
    said += bytes;
    ticks_played += ticks;
}

static void tell(uint8_t kind, uint16_t mode, const uint8_t *payload, uint32_t n) {
    take(make_frame(words + said, kind, device.next_sequence, mode, payload, n), 0);
}

static uint8_t payload[512];

static void put_codes(uint8_t *bytes, uint32_t n) {
    uint64_t each = device.sample_rate_hz + device.carrier_rad_per_s;
    int32_t most = (int32_t)(device.slew_codes_per_s / each / 2u);
    if (most > device.ceiling_code) most = device.ceiling_code;
    for (uint32_t i = 0; i < n; i++)
        hx_put_u16(bytes + 2u * i, (uint16_t)((int32_t)chance(2u * (uint32_t)most + 1u) - most));
}

/* A host's session, ended by STOP, by silence or not at all. */
static void record(void) {
    static const uint8_t versions[2] = {HX_VERSION, HX_VERSION};
    count = said = ticks_played = 0;
    demand(hx_device_init(&device, &config));
    tell(HX_HELLO, 0, versions, 2);
    hx_put_u16(payload, (uint16_t)chance(2));
    hx_put_u16(payload + 2, WATCHDOG_MS);
    hx_put_u32(payload + 4, chance(2) ? RATE_HZ / 4u : RATE_HZ);
    hx_put_u32(payload + 8, 250000);
    hx_put_u32(payload + 12, 100000u + chance(100001));
    hx_put_u32(payload + 16, chance(2) ? 46666u : 4666666u);
    hx_put_u32(payload + 20, payload[0] ? 1000000u + chance(3000000) : 0);
    hx_put_u32(payload + 24, chance(2000));
    hx_put_u16(payload + 28, (uint16_t)chance(5));
    tell(HX_SETUP, 0, payload, HX_SETUP_BYTES);
    tell(HX_ARM, 0, payload, 0);
    uint32_t rounds = 5u + chance(12);
    for (uint32_t round = 0; round < rounds; round++) {
        uint32_t n = 10u + chance(40), ratio = RATE_HZ / device.sample_rate_hz;
        if (n <= device.config.queue_samples - device.queued) {
            hx_put_u32(payload, device.next_index);
            put_codes(payload + 4, n);
            tell(HX_STREAM, device.mode, payload, 4u + 2u * n);
        }
        if (chance(3) == 0 && device.queued > 30u) {
            hx_put_u32(payload, device.samples_played + 20u);
            hx_put_u16(payload + 4, device.revisions);
            put_codes(payload + 6, 5);
            tell(HX_REVISE, device.mode, payload, 16);
        }
        hx_put_u32(payload, device.next_index);
        if (chance(4) == 0) tell(HX_PING, 0, payload, 4);
        if (chance(4) == 0 && device.marks < HX_MARKS) tell(HX_MARK, 0, payload, 6);
        take(0, chance(2) ? n * ratio : chance(2u * n * ratio));
    }
    if (chance(2)) tell(HX_STOP, 0, payload, 0);
    take(0, chance(RAMP));
    moments[count].device = device;
    moments[count].at = ticks_played;
    demand(device.fault.code == HX_FAULT_NONE || device.fault.code == HX_FAULT_STARVED);
}

/* The steps from one on, of a device that may have met a failure: what it plays goes to `played`. */
static uint32_t go_on(uint32_t from, uint32_t at, uint32_t until) {
    for (uint32_t i = from; i < until; i++) {
        hx_device_receive(&device, words + steps[i].begin, steps[i].bytes);
        hx_device_play(&device, played + at, NULL, steps[i].ticks);
        at += steps[i].ticks;
    }
    return at;
}

/* Whether output samples keep the limits of the page, the first of them behind `before`. They are
 * fewer than a second, so that those from the begin of the session on are all that counts. */
static int keeps_limits(uint32_t begin, uint32_t end, int32_t most, int32_t step_most) {
    int64_t squares = 0, high = 0, low = 0;
    int32_t before = 0;
    for (uint32_t i = 0; i < end; i++) {
        int32_t code = i < begin ? recorded[i] : played[i];
        if (i >= begin && (code > most || code < -most)) return 0;
        if (i >= begin && (code - before > step_most || before - code > step_most)) return 0;
        before = code;
        squares += (int64_t)code * code;
        high = high + code > 0 ? high + code : 0;
        low = low + code < 0 ? low + code : 0;
    }
    return squares <= (int64_t)MOST_SQUARE * RATE_HZ &&
           high * 20 <= (int64_t)(CEILING_CODE + SLACK) * RATE_HZ &&
           low * -20 <= (int64_t)(CEILING_CODE + SLACK) * RATE_HZ;
}

enum failure { DEATH, GONE, LOST, DOUBLED, FLIPPED, RESET, BROWN_OUT, FAILURES };

static void spoil(void) {
    uint32_t bit = chance(8u * sizeof device);
    ((uint8_t *)&device)[bit / 8u] ^= (uint8_t)(1u << bit % 8u);
}

/* Whether a failure at a step leaves the output as recorded, or at 0 V in time. */
static int ends_well(enum failure failure, uint32_t at_step) {
    const step *s = &steps[at_step];
    uint32_t begin = moments[at_step].at, at = begin, next = at_step, after, first;
    device = moments[at_step].device;
    int32_t ceiling = device.ceiling_code, step_codes = device.step_codes;
    if (failure == GONE) hx_device_release(&device);
    if (failure == RESET) demand(hx_device_init(&device, &config));
    if (failure == BROWN_OUT)
        for (int i = 0; i < 32; i++) spoil();
    if (failure == DEATH) next = count;
    if (failure == LOST || failure == DOUBLED || failure == FLIPPED) {
        uint32_t where = chance(s->bytes), from = failure == DOUBLED ? where : where + 1u;
        uint8_t bad = (uint8_t)(words[s->begin + where] ^ 1u << chance(8));
        hx_device_receive(&device, words + s->begin, failure == DOUBLED ? where + 1u : where);
        if (failure == FLIPPED) hx_device_receive(&device, &bad, 1);
        hx_device_receive(&device, words + s->begin + from, s->bytes - from);
        next++;
    }
    after = at = go_on(next, at, count);
    demand(after + WATCHDOG < MOST_TICKS);
    hx_device_play(&device, played + at, NULL, WATCHDOG);
    at += WATCHDOG;
    if (played[at - 1u] != 0) return 0;
    for (first = begin; first < after && played[first] == recorded[first];) first++;
    if (failure == DEATH || first == after) return 1;
    if (failure == BROWN_OUT && keeps_limits(begin, at, ceiling, step_codes)) return 1;
    /* A board that resets is at 0 V by its hardware, a byte that is lost shows itself with the next
     * or when the host falls silent, and everything else ramps at once. */
    uint32_t late = failure == RESET ? 0u : failure == LOST ? WATCHDOG : RAMP - 1u;
    for (uint32_t i = first + late; i < at; i++)
        if (played[i] != 0) return 0;
    return 1;
}

/* What a flipped bit does. */
enum outcome { NOTHING, ZERO, LIMITED, ESCAPED, OUTCOMES };

static enum outcome flip(void) {
    uint32_t at_step = 3u + chance(count - 3u), begin = moments[at_step].at;
    uint32_t until = at_step + chance(count - at_step + 1u), at, end, i;
    device = moments[at_step].device;
    int32_t step_codes = device.step_codes, ceiling = device.ceiling_code;
    spoil();
    at = go_on(at_step, begin, until);
    end = at + WATCHDOG + RAMP;
    hx_device_play(&device, played + at, NULL, end - at);
    for (i = begin; i < at && played[i] == recorded[i];) i++;
    int is_same = i == at;
    for (i = begin + IN_TIME < end ? begin + IN_TIME : end - 1u; i < end && played[i] == 0;) i++;
    int is_zero = i == end;
    if (played[end - 1u] != 0 || !keeps_limits(begin, end, ceiling, step_codes)) return ESCAPED;
    return is_same ? NOTHING : is_zero ? ZERO : LIMITED;
}

static uint32_t failures[FAILURES][2];
static uint32_t flips[OUTCOMES];

/* Sessions with a failure at each of their steps; return how many ended badly. */
static uint32_t fail_everywhere(uint32_t sessions, uint32_t each) {
    uint32_t bad = 0;
    for (uint32_t session = 0; session < sessions; session++) {
        record();
        for (uint32_t i = 0; i < count; i++)
            for (int failure = 0; failure < FAILURES; failure++) {
                int is_of_bytes = failure == LOST || failure == DOUBLED || failure == FLIPPED;
                if (is_of_bytes && steps[i].bytes == 0) continue;
                for (uint32_t time = 0; time < (is_of_bytes ? each : 1u); time++) {
                    int is_well = ends_well((enum failure)failure, i);
                    failures[failure][!is_well]++;
                    bad += !is_well;
                }
            }
    }
    return bad;
}

static void flip_bits(uint32_t n) {
    for (uint32_t i = 0; i < n; i++) {
        if (i % 1000u == 0) record();
        enum outcome outcome = flip();
        flips[outcome]++;
    }
}

#ifndef HX_EMULATED
#include <stdio.h>

int main(int argc, char **argv) {
    static const char *const names[FAILURES] = {"host dies", "host goes away", "byte lost", "byte doubled",
                                                "bit of a byte flipped", "board resets", "brown-out"};
    uint32_t sessions = argc > 1 ? (uint32_t)atoi(argv[1]) : 1000u;
    uint32_t bits = argc > 2 ? (uint32_t)atoi(argv[2]) : 1000000u;
    uint32_t bad = fail_everywhere(sessions, 3);
    for (int i = 0; i < FAILURES; i++)
        printf("%-22s %8u well, %u badly\n", names[i], failures[i][0], failures[i][1]);
    flip_bits(bits);
    printf("%u bits of memory flipped: %u changed nothing, %u at 0 V within 15 ms, %u within limits, "
           "%u escaped\n",
           bits, flips[NOTHING], flips[ZERO], flips[LIMITED], flips[ESCAPED]);
    return bad > 0 || flips[ESCAPED] > 0;
}
#else
#include "../cortex_m/startup.h"

void abort(void) { leave("a demand of the sessions failed\n", 0); }

static char line[160], *end_of_line = line;

static void write_words(const char *what) {
    while (*what) *end_of_line++ = *what++;
}

static void write_count(uint32_t n, const char *what) {
    uint32_t power = 1;
    while (n / power >= 10u) power *= 10u;
    for (; power > 0; power /= 10u) *end_of_line++ = (char)('0' + n / power % 10u);
    write_words(what);
}

void board_main(void) {
    random_state = HX_SEED;
    uint32_t bad = fail_everywhere(HX_SESSIONS, 1), well = 0;
    for (int i = 0; i < FAILURES; i++) well += failures[i][0];
    flip_bits(HX_FLIPS);
    write_count(well, " failures well, ");
    write_count(bad, " badly; bits flipped: ");
    write_count(flips[NOTHING], " changed nothing, ");
    write_count(flips[ZERO], " at 0 V within 15 ms, ");
    write_count(flips[LIMITED], " within limits, ");
    write_count(flips[ESCAPED], " escaped\n");
    leave(line, bad == 0 && flips[ESCAPED] == 0);
}
#endif
