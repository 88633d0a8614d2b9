/* `make check`: what the page promises of ceiling, slew, mean, energy, guard, watchdog, seams and
 * arming, on the last code that keeps it and the first that does not; a hostile host at the slew;
 * and the fuzzer's calls with random bytes. mutants.py shows that no safety line goes unchecked.
 */
#include <stdio.h>

/* A test that changes memory seals it as the core would have. */
#include "haptix_internal.h"
#include "haptix_window.h"

#include "fuzz.c"

static void fail(int line, const char *wanted) {
    fprintf(stderr, "check.c:%d: %s\n", line, wanted);
    exit(1);
}

#define demand(is_so) ((is_so) ? (void)0 : fail(__LINE__, #is_so))

#define RAMP 80u       /* 5 ms */
#define WATCHDOG 640u  /* 40 ms */
#define TOP CEILING_CODE
#define GENTLE 46666u  /* V/s, 382 codes in an output sample: 0.7 mA through 15 nF */
#define GENTLE_STEP 382
#define STEEP 4666666u

static uint8_t frame_bytes[1024], payload_bytes[1024];
static uint32_t random_state = 1;

static uint32_t chance(uint32_t n) {
    random_state = random_state * 1664525u + 1013904223u;
    return (random_state >> 8) % n;
}

static int fault(void) { return device.fault.code; }

static void say(uint8_t kind, uint16_t mode, const uint8_t *bytes, uint32_t n) {
    uint32_t length = make_frame(frame_bytes, kind, device.next_sequence, mode, bytes, n);
    hx_device_receive(&device, frame_bytes, length);
}

static void power_up(const hx_config *board) {
    demand(hx_device_init(&device, board));
    forget_second();
}

static void hello(void) {
    static const uint8_t versions[2] = {HX_VERSION, HX_VERSION};
    say(HX_HELLO, 0, versions, 2);
}

typedef struct {
    uint32_t mode, watchdog_ms, rate_hz, full_scale_mv, ceiling_mv, slew, carrier_mhz, lead_us;
} set_up_fields;

static const set_up_fields plain = {HX_WAVEFORM, WATCHDOG_MS, RATE_HZ, 250000, 200000, STEEP, 0, 0};

static int setup_with(set_up_fields s) {
    hx_put_u16(payload_bytes, (uint16_t)s.mode);
    hx_put_u16(payload_bytes + 2, (uint16_t)s.watchdog_ms);
    hx_put_u32(payload_bytes + 4, s.rate_hz);
    hx_put_u32(payload_bytes + 8, s.full_scale_mv);
    hx_put_u32(payload_bytes + 12, s.ceiling_mv);
    hx_put_u32(payload_bytes + 16, s.slew);
    hx_put_u32(payload_bytes + 20, s.carrier_mhz);
    hx_put_u32(payload_bytes + 24, s.lead_us);
    hx_put_u16(payload_bytes + 28, 0);
    say(HX_SETUP, 0, payload_bytes, HX_SETUP_BYTES);
    return fault() == HX_FAULT_NONE && device.is_set_up;
}

/* A new session of the same device, armed: at once, or when the output has come to rest. */
static void arm_at_once(set_up_fields s) {
    hello();
    demand(setup_with(s));
    say(HX_ARM, 0, NULL, 0);
    demand(device.is_armed && fault() == HX_FAULT_NONE);
}

static void ready(set_up_fields s) {
    hello();
    play(RAMP + 1u);
    demand(out[RAMP] == 0);
    arm_at_once(s);
}

static int stream(const int32_t *codes, uint32_t n) {
    hx_put_u32(payload_bytes, device.next_index);
    for (uint32_t i = 0; i < n; i++) hx_put_u16(payload_bytes + 4 + 2 * i, (uint16_t)codes[i]);
    say(HX_STREAM, device.mode, payload_bytes, 4 + 2 * n);
    return fault();
}

static int stream_level(int32_t code, uint32_t n) {
    int32_t codes[160];
    for (uint32_t i = 0; i < n; i++) codes[i] = code;
    return stream(codes, n);
}

static int stream_one(int32_t code) { return stream(&code, 1); }

/* Replace samples, the first of them so many ahead of the output. */
static int revise(uint32_t ahead, uint16_t revision, const int32_t *codes, uint32_t n) {
    hx_put_u32(payload_bytes, device.samples_played + ahead);
    hx_put_u16(payload_bytes + 4, revision);
    for (uint32_t i = 0; i < n; i++) hx_put_u16(payload_bytes + 6 + 2 * i, (uint16_t)codes[i]);
    say(HX_REVISE, device.mode, payload_bytes, 6 + 2 * n);
    return fault();
}

static int revise_one(uint32_t ahead, int32_t code) {
    return revise(ahead, device.revisions, &code, 1);
}

static void meets_the_ramp_from(int32_t level) {
    demand(!device.is_armed && device.queued == 0);
    play(RAMP + 20u);
    for (int32_t k = 1; k <= (int32_t)RAMP + 20; k++) {
        int32_t due = k < (int32_t)RAMP ? level * ((int32_t)RAMP - k) / (int32_t)RAMP : 0;
        demand(out[k - 1] == due);
    }
    demand(stream_one(0) != HX_FAULT_NONE && device.queued == 0);
}

static void boards(void) {
    static hx_device other;
    hx_config c = config;
    c.max_watchdog_ms = 160, demand(hx_device_init(&other, &c));
    c.max_watchdog_ms = 161, demand(!hx_device_init(&other, &c));
    c.max_watchdog_ms = 9, demand(!hx_device_init(&other, &c));
    c = config, c.ceiling_mv = 200001, demand(!hx_device_init(&other, &c));
    c = config, c.max_slew_v_per_s = 4666667, demand(!hx_device_init(&other, &c));
    /* Code 26213 in 80 steps: 328 codes each, 328 16000 250 / 32767 V/s. */
    c = config, c.max_slew_v_per_s = 40041, demand(hx_device_init(&other, &c));
    c.max_slew_v_per_s = 40040, demand(!hx_device_init(&other, &c));
    c = config, c.guard_ticks = 0, demand(!hx_device_init(&other, &c));
    c = config, c.guard_ticks = 65536, demand(!hx_device_init(&other, &c));
    c = config, c.queue_samples = HX_QUEUE_SAMPLES + 1u, demand(!hx_device_init(&other, &c));
    c = config, c.max_frame_samples = 161, demand(!hx_device_init(&other, &c));
    c = config, c.full_scale_mv = 0, demand(!hx_device_init(&other, &c));
    c = config, c.rates[1].sample_rate_hz = 3000, demand(!hx_device_init(&other, &c));
    c = config, c.output_rate_hz = 999, demand(!hx_device_init(&other, &c));
    c = config, c.sense_rate_hz = 300, demand(!hx_device_init(&other, &c));
    c = config, c.sense_rate_hz = 750, demand(!hx_device_init(&other, &c));
    c = config, c.sense_rate_hz = 8000, demand(!hx_device_init(&other, &c));
    c = config, c.sense_full_scale_na = 99999, demand(!hx_device_init(&other, &c));
    c = config, c.sense_full_scale_na = 50000001, demand(!hx_device_init(&other, &c));
    c = config, c.panel_pf = 99, demand(!hx_device_init(&other, &c));
    c = config, c.panel_pf = 100001, demand(!hx_device_init(&other, &c));
}

/* Each is taken by a new session, or refused there; none is armed then. */
static void takes(set_up_fields s, int is_taken) {
    hello();
    demand(setup_with(s) == is_taken);
    demand(is_taken || fault() == HX_FAULT_SETUP);
    say(HX_ARM, 0, NULL, 0);
    demand(device.is_armed == is_taken);
}

static void setups(void) {
    set_up_fields s = plain, carried = plain;
    carried.mode = HX_ENVELOPE, carried.carrier_mhz = 1000000;
    power_up(&config);
    takes(plain, 1);
    takes(carried, 1);
    s.ceiling_mv = 200001, takes(s, 0);
    s.ceiling_mv = 0, takes(s, 0);
    s = plain, s.slew = 4666667, takes(s, 0);
    s.slew = 40041, takes(s, 1);
    s.slew = 40040, takes(s, 0);
    s = plain, s.watchdog_ms = 41, takes(s, 0);
    s.watchdog_ms = 10, takes(s, 1);
    s.watchdog_ms = 9, takes(s, 0);
    s = plain, s.full_scale_mv = 250001, takes(s, 0);
    s = plain, s.rate_hz = 8000, takes(s, 0);
    s = plain, s.mode = 2, takes(s, 0);
    s = plain, s.lead_us = 40000, takes(s, 1);
    s.lead_us = 40001, takes(s, 0);
    s = plain, s.carrier_mhz = 1000000, takes(s, 0);
    s = carried, s.carrier_mhz = 999999, takes(s, 0);
    s.carrier_mhz = 8000001, takes(s, 0);

    /* Limits are lowered only, until the next HELLO. */
    hello();
    s = plain, s.ceiling_mv = 150000, s.slew = 900000;
    demand(setup_with(s));
    s.ceiling_mv = 150001, demand(!setup_with(s));
    s.ceiling_mv = 150000, s.slew = 900001, demand(!setup_with(s));
    hello();
    demand(setup_with(plain));
    s = plain, s.mode = 2, demand(!setup_with(s));
    say(HX_ARM, 0, NULL, 0);
    demand(!device.is_armed); /* a refused set-up leaves none */
}

/* Every way to end: each leads to 0 V on the ramp, and to nothing else. */
static void endings(void) {
    static const int32_t level = 20000;
    int32_t codes[2] = {level, TOP + 1};
    uint8_t bytes[64] = {0};
    for (int way = 0; way < 19; way++) {
        int due = HX_FAULT_NONE;
        set_up_fields s = plain;
        power_up(&config);
        ready(s);
        demand(stream_level(level, 150) == HX_FAULT_NONE);
        play(20);
        demand(out[0] == level && out[19] == level);
        switch (way) {
        case 0: say(HX_STOP, 0, NULL, 0); break;
        case 1: hello(); break;
        case 2:
            hx_device_release(&device);
            demand(!device.is_set_up);
            break;
        case 3: bytes[0] = 0xff, hx_device_receive(&device, bytes, 1), due = HX_FAULT_DAMAGED; break;
        case 4: /* a wrong check sum of the frame */
            hx_put_u32(payload_bytes, 0);
            make_frame(frame_bytes, HX_PING, device.next_sequence, 0, payload_bytes, 4);
            frame_bytes[13] ^= 1, hx_device_receive(&device, frame_bytes, 20);
            due = HX_FAULT_DAMAGED;
            break;
        case 5: /* and of its header alone */
            make_frame(frame_bytes, HX_STOP, device.next_sequence, 0, NULL, 0);
            frame_bytes[10] ^= 1, hx_put_u32(frame_bytes + 12, hx_crc32(frame_bytes, 12));
            hx_device_receive(&device, frame_bytes, 16);
            due = HX_FAULT_DAMAGED;
            break;
        case 6:
            make_frame(frame_bytes, HX_PING, (uint16_t)(device.next_sequence + 1u), 0, payload_bytes, 4);
            hx_device_receive(&device, frame_bytes, 20), due = HX_FAULT_SEQUENCE;
            break;
        case 7: say(HX_ARM, 0, NULL, 0), due = HX_FAULT_ALREADY_ARMED; break;
        case 8: setup_with(plain), due = HX_FAULT_ALREADY_ARMED; break;
        case 9: /* a sample that leaves a gap */
            hx_put_u32(payload_bytes, device.next_index + 1u), hx_put_u16(payload_bytes + 4, 0);
            say(HX_STREAM, 0, payload_bytes, 6), due = HX_FAULT_SAMPLE_INDEX;
            break;
        case 10: stream(codes, 2), due = HX_FAULT_CEILING; break;
        case 11: codes[1] = -TOP - 1, stream(codes, 2), due = HX_FAULT_CEILING; break;
        case 12: codes[1] = -32768, stream(codes, 2), due = HX_FAULT_CEILING; break;
        case 13: codes[1] = -TOP, stream(codes, 2), due = HX_FAULT_SLEW; break;
        case 14: stream_level(level, 31), due = HX_FAULT_QUEUE_FULL; break; /* 30 are free */
        case 15: /* a carrier's amplitudes */
            hx_put_u32(payload_bytes, device.next_index), hx_put_u16(payload_bytes + 4, 0);
            say(HX_STREAM, HX_ENVELOPE, payload_bytes, 6), due = HX_FAULT_MODE;
            break;
        case 16: say(HX_PING, 0, payload_bytes, 5), due = HX_FAULT_LENGTH; break;
        case 17: say(9, 0, NULL, 0), due = HX_FAULT_KIND; break;
        default: /* a report that begins a frame amid another */
            bytes[0] = HX_REPORT_ID, bytes[1] = HX_REPORT_BEGINS | 1u, bytes[2] = 'H';
            hx_device_receive_report(&device, bytes, 64);
            demand(fault() == HX_FAULT_NONE);
            bytes[1] = HX_REPORT_BEGINS, hx_device_receive_report(&device, bytes, 64);
            due = HX_FAULT_TRUNCATED;
        }
        demand(fault() == due);
        demand(device.faults == (uint32_t)(due != HX_FAULT_NONE));
        meets_the_ramp_from(level);
    }
    /* The queue is full exactly. */
    power_up(&config);
    ready(plain);
    demand(stream_level(level, 150) == HX_FAULT_NONE);
    demand(stream_level(level, 10) == HX_FAULT_NONE);
    demand(stream_one(level) == HX_FAULT_QUEUE_FULL);
}

static void ceiling_and_slew(void) {
    set_up_fields s = plain;
    power_up(&config);
    ready(s);
    demand(stream_one(TOP) == HX_FAULT_NONE);
    s.ceiling_mv = 150000; /* 19660.2 codes */
    ready(s);
    demand(stream_one(19660) == HX_FAULT_NONE);
    demand(stream_one(19661) == HX_FAULT_CEILING);

    s = plain, s.slew = GENTLE;
    ready(s);
    demand(stream_one(GENTLE_STEP) == HX_FAULT_NONE);
    demand(stream_one(2 * GENTLE_STEP) == HX_FAULT_NONE);
    demand(stream_one(GENTLE_STEP - 1) == HX_FAULT_SLEW);
    ready(s);
    demand(stream_one(GENTLE_STEP + 1) == HX_FAULT_SLEW); /* from 0 V */
    ready(s);
    int32_t codes[3] = {300, 600, 983};
    demand(stream(codes, 3) == HX_FAULT_SLEW); /* within a frame */
    ready(s);
    demand(stream_level(GENTLE_STEP, 20) == HX_FAULT_NONE);
    play(20);
    say(HX_STOP, 0, NULL, 0);
    play(RAMP);
    say(HX_ARM, 0, NULL, 0);
    demand(stream_one(GENTLE_STEP + 1) == HX_FAULT_SLEW); /* after arming as well */

    /* Four output samples to one: whole codes in each of them. */
    s.rate_hz = RATE_HZ / 4u;
    ready(s);
    demand(stream_one(4 * GENTLE_STEP) == HX_FAULT_NONE);
    demand(stream_one(-1) == HX_FAULT_SLEW);

    /* |c1 - c0| 16000 + 18850 max(c0, c1) at most 382 16000, 18850 being 2 pi 3 kHz rounded up. */
    s = plain, s.slew = GENTLE, s.mode = HX_ENVELOPE, s.carrier_mhz = 3000000;
    ready(s);
    demand(stream_one(175) == HX_FAULT_NONE);
    demand(stream_one(240) == HX_FAULT_NONE);
    demand(stream_one(273) == HX_FAULT_NONE);
    demand(stream_one(300) == HX_FAULT_NONE);
    demand(stream_one(272) == HX_FAULT_NONE);
    demand(stream_one(300) == HX_FAULT_NONE);
    demand(stream_one(271) == HX_FAULT_SLEW);
    ready(s);
    demand(stream_one(176) == HX_FAULT_SLEW);
    ready(s); /* 38 16000 + 18849.6 292 would pass */
    demand(stream_one(175) == HX_FAULT_NONE);
    demand(stream_one(254) == HX_FAULT_NONE);
    demand(stream_one(292) == HX_FAULT_SLEW);
}

static void watchdog(void) {
    power_up(&config);
    ready(plain);
    demand(stream_level(10000, 20) == HX_FAULT_NONE);
    play(100);
    demand(stream_level(10000, 150) == HX_FAULT_NONE); /* counted from here */
    play(10);
    say(HX_PING, 0, payload_bytes, 4); /* feeds nothing */
    play(WATCHDOG - RAMP - 11u);
    demand(fault() == HX_FAULT_NONE);
    play(1);
    demand(fault() == HX_FAULT_STARVED && !device.is_armed);
    play(RAMP);
    demand(out[RAMP - 1u] == 0);

    /* A revision feeds it; one that is refused does not. */
    power_up(&config);
    set_up_fields s = plain;
    s.rate_hz = RATE_HZ / 4u;
    ready(s);
    demand(stream_level(10000, 150) == HX_FAULT_NONE);
    play(400);
    demand(revise_one(20, 10000) == HX_FAULT_NONE && device.revisions == 1);
    play(100);
    demand(revise_one(1, 10000) == HX_FAULT_NONE && device.revisions == 1);
    play(WATCHDOG - RAMP - 101u);
    demand(fault() == HX_FAULT_NONE);
    play(1);
    demand(fault() == HX_FAULT_STARVED);

    /* A count that has gone past the end, as memory may, ends all the same. */
    power_up(&config);
    ready(plain);
    demand(stream_level(10000, 150) == HX_FAULT_NONE);
    play(10);
    device.silent_ticks = WATCHDOG, hx_seal(&device);
    play(1);
    demand(fault() == HX_FAULT_STARVED);

    /* To the sample, however many are queued behind it and asked for at once. */
    hx_config deep = config;
    deep.queue_samples = 1000;
    power_up(&deep);
    ready(plain);
    for (int i = 0; i < 5; i++) demand(stream_level(10000, 150) == HX_FAULT_NONE);
    play(WATCHDOG);
    demand(fault() == HX_FAULT_STARVED && device.fault.clock == RAMP + 1u + WATCHDOG - RAMP);
    demand(out[WATCHDOG - RAMP - 1u] == 10000 && out[WATCHDOG - RAMP] == 10000 * 79 / 80);
    demand(out[WATCHDOG - 1u] == 0);

    /* A frame that breaks off. The watchdog is shorter, so that only a frame's pause is left. */
    power_up(&config);
    ready(plain);
    hx_device_receive(&device, (const uint8_t *)"HX", 2);
    play(RATE_HZ * HX_PAUSE_MS / 1000u - 1u);
    demand(device.is_armed);
    play(1);
    demand(fault() == HX_FAULT_TRUNCATED && !device.is_armed);
    demand(RATE_HZ * HX_PAUSE_MS == 1600000u);
}

static void running_dry(void) {
    power_up(&config);
    ready(plain);
    demand(stream_level(24000, 50) == HX_FAULT_NONE);
    play(50);
    play(200);
    for (int32_t k = 0; k < 200; k++) { /* 10 ms behind the last sample: 80 held, 80 down */
        int32_t due = k < 80 ? 24000 : k < 160 ? 24000 - 300 * (k - 79) : 0;
        demand(out[k] == due);
    }
    demand(stream_level(24000, 100) == HX_FAULT_NONE);
    play(100);
    for (int32_t k = 1; k <= 100; k++) demand(out[k - 1] == (k < 80 ? 300 * k : 24000));

    /* Where the stream needs all of the slew, the gain waits, either way. By hand for each sample. */
    for (int32_t sign = -1; sign < 2; sign += 2) {
        set_up_fields s = plain;
        s.slew = GENTLE;
        ready(s);
        int32_t codes[60], at = 0;
        for (int i = 0; i < 60; i++) codes[i] = at += i < 40 ? sign * GENTLE_STEP : -sign * GENTLE_STEP;
        demand(stream(codes, 60) == HX_FAULT_NONE);
        play(60);
        play(120); /* 40 of the 80 steps to 0 V */
        int32_t gain = 40, before = out[119];
        demand(before == at * 40 / 80);
        for (int i = 0; i < 60; i++) codes[i] = at += i < 30 ? sign * GENTLE_STEP : -sign * GENTLE_STEP;
        demand(stream(codes, 60) == HX_FAULT_NONE);
        play(60);
        int waited = 0;
        for (int i = 0; i < 60; i++) {
            if (gain < 80) {
                int32_t step = codes[i] * (gain + 1) / 80 - before;
                if (step <= GENTLE_STEP && step >= -GENTLE_STEP) gain++;
                else waited++;
            }
            before = codes[i] * gain / 80;
            demand(out[i] == before);
        }
        demand(waited > 3 && gain > 60);
    }
}

static void revisions(void) {
    set_up_fields s = plain;
    s.slew = GENTLE;
    int32_t flat[100] = {0}, hill[3] = {300, 500, 300}, cliff[2] = {300, 500};
    power_up(&config);
    ready(s);
    demand(stream(flat, 100) == HX_FAULT_NONE);
    play(10);
    /* 90 are queued; the guard is 16. */
    demand(revise(15, 0, hill, 3) == HX_FAULT_NONE && device.revisions == 0 && device.refused == 1);
    demand(revise(16, 1, hill, 3) == HX_FAULT_NONE && device.revisions == 0 && device.refused == 2);
    demand(revise(16, 0, hill, 3) == HX_FAULT_NONE && device.revisions == 1);
    play(40);
    for (int i = 0; i < 40; i++) demand(out[i] == (i >= 16 && i < 19 ? hill[i - 16] : 0));

    /* To the end: what is appended goes on from there. 50 are queued. */
    demand(revise(48, 1, cliff, 2) == HX_FAULT_NONE && device.revisions == 2);
    demand(stream_one(500 + GENTLE_STEP) == HX_FAULT_NONE);
    play(51);
    demand(out[48] == 300 && out[49] == 500 && out[50] == 882);

    static const struct {
        uint32_t ahead;
        int32_t code;
        int due;
    } wrong[] = {
        {20, GENTLE_STEP, HX_FAULT_NONE},      {20, GENTLE_STEP + 1, HX_FAULT_SLEW}, /* before */
        {20, -GENTLE_STEP - 1, HX_FAULT_SLEW}, {99, GENTLE_STEP + 1, HX_FAULT_SLEW},
        {100, 0, HX_FAULT_SAMPLE_INDEX},       {101, 0, HX_FAULT_SAMPLE_INDEX},
        {20, TOP + 1, HX_FAULT_CEILING},       {20, -32768, HX_FAULT_CEILING},
    };
    for (uint32_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        ready(s);
        demand(stream(flat, 100) == HX_FAULT_NONE);
        demand(revise_one(wrong[i].ahead, wrong[i].code) == wrong[i].due);
    }
    /* The seam behind the last of them, where the ones before are gentle. */
    ready(s);
    demand(stream(flat, 100) == HX_FAULT_NONE);
    demand(revise(20, 0, cliff, 2) == HX_FAULT_SLEW);
    /* The seam before the first is to the sample that is queued there, not to the last one. */
    ready(s);
    int32_t rise[100], level[50];
    for (int i = 0; i < 100; i++) rise[i] = i < 60 ? 0 : (i - 59) * 20;
    for (int i = 0; i < 50; i++) level[i] = 800;
    demand(stream(rise, 100) == HX_FAULT_NONE);
    demand(revise(50, 0, level, 50) == HX_FAULT_SLEW);
    say(HX_STOP, 0, NULL, 0);
    demand(revise_one(20, 0) != HX_FAULT_NONE && !device.is_armed);
    /* A carrier's: the mode must be that of the set-up. */
    ready(s);
    demand(stream(flat, 100) == HX_FAULT_NONE);
    hx_put_u32(payload_bytes, 20), hx_put_u16(payload_bytes + 4, 0), hx_put_u16(payload_bytes + 6, 0);
    say(HX_REVISE, HX_ENVELOPE, payload_bytes, 8);
    demand(fault() == HX_FAULT_MODE);
}

/* The page's sums by hand, each from all that was played. */
#define MOST_TICKS 60000u
#define BLOCK 125u
static int32_t codes_played[MOST_TICKS], level_at[MOST_TICKS];

/* The limit that output sample n would break, of a device that began with the first of them. */
static int broken_by(uint32_t n, uint32_t half_turn) {
    uint64_t rms = (uint64_t)142835u * 32767u * 256u / 250000u;
    uint64_t most = (rms * rms >> 16) * (RATE_HZ + 2u * BLOCK), squares = 0;
    uint64_t level = (uint64_t)(level_at[n] < 0 ? -level_at[n] : level_at[n]);
    uint32_t whole = n / BLOCK, first = whole > 128u ? whole - 128u : 0u;
    int64_t high, low, stretch = 0;
    for (uint32_t block = first; block < whole; block++) {
        uint64_t own = 0;
        for (uint32_t i = block * BLOCK; i < (block + 1u) * BLOCK; i++)
            own += (uint64_t)((int64_t)codes_played[i] * codes_played[i]);
        squares += (own + 4095u) / 4096u * 4096u;
    }
    for (uint32_t i = whole * BLOCK; i <= n; i++)
        squares += (uint64_t)((int64_t)codes_played[i] * codes_played[i]);
    if (squares + level * level * (RAMP / 3u + 1u) > most) return HX_FAULT_ENERGY;
    high = low = codes_played[n];
    for (uint32_t i = n + 1u; i-- > first * BLOCK;) {
        stretch += codes_played[i];
        if (stretch > high) high = stretch;
        if (stretch < low) low = stretch;
    }
    uint64_t ramp = half_turn ? level * half_turn : level * (RAMP - 1u) / 2u;
    if (half_turn || level_at[n] > 0) high += (int64_t)ramp;
    if (half_turn || level_at[n] <= 0) low -= (int64_t)ramp;
    int64_t most_sum = (int64_t)TOP * RATE_HZ / 20;
    return high > most_sum || -low > most_sum ? HX_FAULT_MEAN : HX_FAULT_NONE;
}

/* Play levels until a limit of the window is broken: the sample and the limit are those by hand. */
static void breaks(set_up_fields s, int32_t (*level)(uint32_t), uint32_t look_from, int due) {
    uint32_t ticks = 0, half_turn = 0;
    power_up(&config);
    arm_at_once(s);
    if (s.mode == HX_ENVELOPE) half_turn = 0x80000000u / device.phase_step + 2u;
    while (fault() == HX_FAULT_NONE) {
        int32_t codes[100];
        demand(ticks + 200u < MOST_TICKS);
        for (uint32_t i = 0; i < 100; i++) level_at[ticks + i] = codes[i] = level(ticks + i);
        demand(stream(codes, 100) == HX_FAULT_NONE);
        play(100);
        for (uint32_t i = 0; i < 100; i++, ticks++) {
            codes_played[ticks] = out[i];
            if ((what[i] & 0x7f) != HX_OUT_STREAM) break;
            if (ticks >= look_from) demand(broken_by(ticks, half_turn) == HX_FAULT_NONE);
        }
    }
    /* What would have been played in the place of the first sample of the ramp. */
    demand((int)fault() == due);
    if (!half_turn) {
        codes_played[ticks] = level_at[ticks];
        demand(broken_by(ticks, 0) == due);
    }
    demand(ticks > look_from);
    play(200);
    demand(out[199] == 0);
}

static int32_t up(uint32_t n) { return n < MOST_TICKS ? TOP : 0; }
static int32_t down(uint32_t n) { return -up(n); }
static int32_t square(uint32_t n) { return n % 5u == 4u ? 0 : n % 10u < 4u ? TOP : -TOP; }
/* Loud until the limit is near, then so quiet that the rounding of the blocks decides: rounded down
 * they would let five samples more pass. */
static int32_t hushed(uint32_t n) {
    int32_t size = n < 11855u ? 4000 : n < 12350u ? 1000 : 300;
    return n < 10315u ? square(n) : n % 2u ? size : -size;
}
/* A burst at the begin, and one that ends while the first is the oldest of the window. */
static int32_t bursts(uint32_t n) { return n < 100u || n > 128u * BLOCK - 650u ? TOP : 0; }
static int32_t loud_bursts(uint32_t n) {
    return n < 110u || n >= 128u * BLOCK - 10200u ? square(n) : 0;
}
/* The first burst has left: what is behind it counts alone. */
static int32_t opposite(uint32_t n) { return n < 400u ? -TOP : n > 16500u ? TOP : 0; }
/* An amplitude in step with a carrier of 1 kHz. */
static int32_t gated(uint32_t n) { return n % 16u < 8u ? 20000 : 0; }

static void energy_and_mean(void) {
    set_up_fields carried = plain;
    carried.mode = HX_ENVELOPE, carried.carrier_mhz = 1000000;
    breaks(plain, up, 700, HX_FAULT_MEAN);
    breaks(plain, down, 700, HX_FAULT_MEAN);
    breaks(plain, square, 10000, HX_FAULT_ENERGY);
    breaks(plain, hushed, 12400, HX_FAULT_ENERGY);
    breaks(plain, bursts, 128u * BLOCK - 400u, HX_FAULT_MEAN);
    breaks(plain, loud_bursts, 128u * BLOCK - 200u, HX_FAULT_ENERGY);
    breaks(plain, opposite, 17000, HX_FAULT_MEAN);
    breaks(carried, gated, 1500, HX_FAULT_MEAN);
    /* A carrier's ramp counts both ways, whichever side its level is on. */
    power_up(&config);
    device.has_carrier = 1, device.half_turn_ticks = 10;
    for (int32_t level = -100; level <= 100; level += 200)
        for (int32_t side = -1; side <= 1; side += 2)
            for (int32_t over = 0; over < 2; over++) {
                int32_t most = (int32_t)device.max_sum - 1000 + over;
                hx_block now = {side * most, side > 0 ? most : 0, side > 0 ? 0 : -most, 0};
                int due = over ? HX_FAULT_MEAN : HX_FAULT_NONE;
                demand((int)hx_window_check(&device, &now, 0, level, 0) == due);
            }
    /* A new session, a host that goes away: the second goes on. */
    power_up(&config);
    int refused = 0;
    for (int i = 0; i < 40; i++) {
        ready(plain);
        demand(stream_level(TOP, 100) == HX_FAULT_NONE);
        play(100);
        refused += fault() == HX_FAULT_MEAN;
        if (i % 2) hx_device_release(&device);
        else say(HX_STOP, 0, NULL, 0);
        play(RAMP);
    }
    demand(refused > 20);
}

/* Samples changed in memory after they were checked: the output keeps ceiling and slew. */
static void bad_memory(void) {
    set_up_fields s = plain;
    s.slew = GENTLE, s.ceiling_mv = 150000;
    /* Twice as they are, at the output's own rate, and twice with lines between them. */
    for (int sign = -1, time = 0; time < 4; time++, sign = -sign) {
        s.rate_hz = time < 2 ? RATE_HZ : RATE_HZ / 4u;
        power_up(&config);
        ready(s);
        demand(stream_level(100, 150) == HX_FAULT_NONE);
        for (uint32_t i = 0; i < 150; i++) device.queue[i] = (int16_t)(sign * 32767);
        play(150);
        for (int i = 0; i < 150; i++) demand(out[i] * sign <= 19660);
        for (int i = 1; i < 150; i++) demand((out[i] - out[i - 1]) * sign <= GENTLE_STEP);
        demand(out[149] * sign == 19660);
        say(HX_STOP, 0, NULL, 0);
        play(RAMP);
        demand(out[0] * sign < 19660 && out[RAMP - 1u] == 0);
    }
}

/* A lost core goes from a level to 0 V by the steps of its slew, answers nothing, and stays there. */
static void is_lost_from(int32_t level) {
    static uint8_t answer[256];
    uint32_t ticks = (uint32_t)((level < 0 ? -level : level) + GENTLE_STEP - 1) / GENTLE_STEP;
    hello();
    demand(!hx_device_is_whole(&device) && hx_device_pending(&device) == ticks);
    demand(hx_device_transmit(&device, answer, 256) == 0);
    demand(hx_device_transmit_report(&device, answer, 64) == 0);
    hx_device_play(&device, out, what, 4000);
    for (int32_t i = 0; i < 4000; i++) {
        int32_t gone = (i + 1) * GENTLE_STEP;
        int32_t due = level > gone ? level - gone : level < -gone ? level + gone : 0;
        demand(out[i] == due && (i == 0 || what[i] == (out[i - 1] ? HX_OUT_RAMP : HX_OUT_IDLE)));
    }
    demand(hx_device_pending(&device) == 0);
}

static void lost_memory(void) {
    set_up_fields s = plain;
    s.slew = GENTLE;
    for (int32_t way = 0, level = GENTLE_STEP; way < 7; way++, level = -level) {
        power_up(&config);
        ready(s);
        for (int32_t i = 1; i <= 20; i++) demand(stream_one(i * level) == HX_FAULT_NONE);
        demand(stream_level(20 * level, 100) == HX_FAULT_NONE);
        play(40);
        switch (way) {
        case 0: device.watchdog_ticks ^= 0x10000u; break;
        case 1: device.config.ceiling_mv ^= 1u; break;
        case 2: device.clock ^= 1ull << 63, device.way_out[0] ^= 0x1004u; break;
        case 3: device.is_armed ^= 0x80u, device.way_out[2] ^= 0x20008000u; break;
        case 4: device.seal ^= 1u; break;
        case 5: device.has_begun = 0, device.touches = HX_TOUCHES + 1u; break;
        default: /* the last word, and the same bit of two */
            device.received ^= 0x80000000u, device.awaited ^= 0x80000000u;
        }
        is_lost_from(20 * level);
        hx_device_release(&device);
        hx_device_receive_report(&device, what, 64);
        demand(!hx_device_is_whole(&device) && hx_device_init(&device, &config));
        demand(hx_device_is_whole(&device));
    }
    /* The window: with the end of its block, and no sample later. */
    power_up(&config);
    ready(s);
    for (int32_t i = 1; i <= 20; i++) demand(stream_one(i * GENTLE_STEP) == HX_FAULT_NONE);
    demand(stream_level(20 * GENTLE_STEP, 120) == HX_FAULT_NONE);
    uint32_t left = device.block_ticks - device.block_tick;
    device.blocks[(device.block_at + 64u) % HX_WINDOW_BLOCKS].energy ^= 0x100u;
    hx_device_play(&device, out, what, left + 20u);
    demand(left > 30u && out[left - 1u] == 20 * GENTLE_STEP);
    for (int32_t i = 0; i < 20; i++) demand(out[(int32_t)left + i] == (19 - i) * GENTLE_STEP);
    /* What a header has announced counts, and not what has become of its bytes. */
    power_up(&config);
    ready(s);
    hx_put_u32(payload_bytes, 0);
    uint32_t n = make_frame(frame_bytes, HX_STREAM, device.next_sequence, 0, payload_bytes, 84);
    hx_device_receive(&device, frame_bytes, 20);
    device.buffer[7] ^= 0x80u;
    static uint8_t longer[HX_BUFFER_BYTES + 64u]; /* more than there is room for */
    for (uint32_t i = 20; i < n; i++) longer[i - 20u] = frame_bytes[i];
    hx_device_receive(&device, longer, sizeof longer);
    demand(fault() == HX_FAULT_DAMAGED && !device.is_armed);
    hx_device_receive(&device, frame_bytes, 13);
    for (uint32_t i = 0; i < sizeof device; i++) ((uint8_t *)&device)[i] = 0;
    demand(!hx_device_is_whole(&device)); /* nothing was begun */
}

/* What a board tests at power-up: it passes, and each limit that does not trip is named. */
static void own_tests(void) {
    static uint32_t memory[64];
    hx_config gentle = config, carrier = config;
    int16_t sent[16], found[16];
    demand(hx_test_memory(memory, sizeof memory) && memory[0] == 0 && memory[63] == 0);
    demand(hx_test_limits(&device, &config) == 0 && device.clock == 0 && !device.is_armed);
    gentle.max_slew_v_per_s = GENTLE, gentle.ceiling_mv = 100000;
    demand(hx_test_limits(&device, &gentle) == 0);
    carrier.rates[0].modes = 2;
    demand(hx_test_limits(&device, &carrier) == 0);
    carrier.ceiling_mv = 0;
    demand(hx_test_limits(&device, &carrier) == 0xffffffffu);
    power_up(&config);
    for (int i = 0; i < 16; i++) sent[i] = (int16_t)(100 * i), found[i] = (int16_t)(100 * i + (i % 2 ? 9 : -9));
    hx_device_read_back(&device, sent, found, 16, 9);
    demand(hx_device_is_whole(&device));
    for (int i = 8; i < 15; i++) found[i]++, found[i] = (int16_t)(found[i] + (i % 2 ? 0 : -2));
    hx_device_read_back(&device, sent, found, 16, 9);
    demand(hx_device_is_whole(&device)); /* seven in turn, then a good one */
    hx_device_read_back(&device, sent + 8, found + 8, 7, 9);
    demand(hx_device_is_whole(&device));
    hx_device_read_back(&device, sent + 8, found + 8, 1, 9);
    demand(!hx_device_is_whole(&device));
}

/* A set-up amid the ramp of another session, with a lower slew: the ramp stays as it was begun. */
static void arming(void) {
    set_up_fields s = plain;
    power_up(&config);
    ready(plain);
    demand(stream_level(TOP, 100) == HX_FAULT_NONE);
    play(50);
    say(HX_STOP, 0, NULL, 0);
    s.ceiling_mv = 100000, s.slew = 21000; /* 172 codes; the ramp takes 328 */
    arm_at_once(s);
    demand(stream_level(172, 100) == HX_FAULT_NONE);
    play(RAMP);
    for (int32_t k = 1; k <= (int32_t)RAMP; k++) demand(out[k - 1] == TOP * (80 - k) / 80);
    play(10);
    for (int i = 0; i < 10; i++) demand(out[i] == 172);
    /* Four output samples to one: the line begins at 0 V, whatever was played before. */
    s = plain, s.rate_hz = RATE_HZ / 4u;
    arm_at_once(s);
    demand(stream_one(8000) == HX_FAULT_NONE);
    play(RAMP + 4u);
    for (uint32_t k = 1; k <= 4; k++) demand(out[RAMP - 1u + k] == 2000 * (int32_t)k);
    /* Nothing leaves before the first sample has come, and none before the lead is over. */
    power_up(&config);
    s = plain, s.lead_us = 1000;
    ready(s);
    play(100);
    for (int i = 0; i < 100; i++) demand(out[i] == 0);
    demand(stream_level(5000, 100) == HX_FAULT_NONE);
    play(20);
    demand(out[15] == 0 && out[16] == 5000);
    say(HX_STOP, 0, NULL, 0);
    play(RAMP);
    say(HX_ARM, 0, NULL, 0); /* and waits for ever, with its lead before it */
    play(2u * WATCHDOG);
    demand(fault() == HX_FAULT_NONE);
    demand(stream_level(5000, 100) == HX_FAULT_NONE);
    play(20);
    demand(out[15] == 0 && out[16] == 5000);
    /* Disarmed, not set up, or after a refused set-up nothing is taken. */
    power_up(&config);
    demand(stream_one(0) == HX_FAULT_NOT_ARMED);
    hello();
    say(HX_ARM, 0, NULL, 0);
    demand(fault() == HX_FAULT_NOT_SET_UP && !device.is_armed);
}

/* The steepest samples that pass, with pauses, ends and new sessions at random; `play` looks. */
static void hostile_host(void) {
    power_up(&config);
    set_up_fields s = plain;
    int32_t at = 0, step = 0, way = 1;
    for (int round = 0; round < 3000; round++) {
        if (!device.is_armed || chance(30) == 0) {
            if (chance(2)) say(HX_STOP, 0, NULL, 0);
            else hx_device_release(&device);
            play(chance(100));
            s.slew = chance(2) ? GENTLE : 40041u + chance(400000);
            s.rate_hz = chance(2) ? RATE_HZ : RATE_HZ / 4u;
            ready(s);
            step = (int32_t)((uint64_t)s.slew * 32767000u / 250000u / RATE_HZ);
            if (s.rate_hz < RATE_HZ) step *= 4;
            at = 0;
        }
        int32_t codes[40];
        uint32_t n = 1u + chance(40);
        for (uint32_t i = 0; i < n; i++) {
            if (chance(40) == 0 || at + way * step > TOP || at + way * step < -TOP) way = -way;
            if (at + way * step <= TOP && at + way * step >= -TOP) at += way * step;
            codes[i] = at;
        }
        if (device.queued + n > 160u) play(400);
        if (device.is_armed) demand(stream(codes, n) == HX_FAULT_NONE);
        play(n * RATE_HZ / s.rate_hz + (chance(3) ? 0u : chance(240)));
        demand(fault() == HX_FAULT_NONE || fault() == HX_FAULT_MEAN || fault() == HX_FAULT_ENERGY);
    }
    demand(device.underruns > 300u);
}

/* A carrier at the highest amplitude of the slew, at a rate where its chords are its tangents. */
static void steep_carrier(void) {
    hx_config board = config;
    set_up_fields s = plain;
    int16_t codes[64];
    int32_t before = 0;
    board.output_rate_hz = 96000, board.rates[0].sample_rate_hz = 4000, board.rate_count = 1;
    s.mode = HX_ENVELOPE, s.rate_hz = 4000, s.slew = GENTLE, s.carrier_mhz = 1000000;
    power_up(&board);
    for (int round = 0; round < 200; round++) {
        ready(s);
        int32_t levels[150], at = 0;
        for (int i = 0; i < 150; i++) { /* 63 codes in an output sample; 6284 is 2 pi 1 kHz */
            int32_t room = (63 * 96000 - 6284 * at) / (4000 + 6284);
            levels[i] = at += room;
        }
        demand(stream(levels, 150) == HX_FAULT_NONE);
        for (uint32_t played = 0; played < 1200u + chance(96); played += 8) {
            hx_device_play(&device, codes, NULL, 8);
            for (int i = 0; i < 8; i++) {
                demand(codes[i] - before <= 63 && before - codes[i] <= 63);
                before = codes[i];
            }
            if (played == 600) say(HX_STOP, 0, NULL, 0);
        }
        demand(before == 0);
    }
    /* It begins with its turn, wherever that of the playback before ended. */
    int16_t first[64];
    for (int round = 0; round < 2; round++) {
        ready(s);
        demand(stream_level(100, 20) == HX_FAULT_NONE);
        hx_device_play(&device, codes, NULL, 64);
        for (int i = 0; i < 64; i++) demand(round == 0 || codes[i] == first[i]);
        for (int i = 0; i < 64; i++) first[i] = codes[i];
        demand(first[63] != 0);
        say(HX_STOP, 0, NULL, 0);
        for (int i = 0; i < 10; i++) hx_device_play(&device, codes, NULL, 64); /* a ramp of 480 */
    }
}

/* A converter on a panel of 2 nF: 180 V of 4 kHz draw 9 mA, of which 77 parts in 1000 are 0.7 mA. */
enum failure { WELL, NOISE, DEAD, STUCK, INVERTED, SATURATED, LATE, SILENT, SQUARE, UPSIDE, AT_END };
#define SENSE_HZ 48000u
#define MS (SENSE_HZ / 1000u)
#define PERIOD 12u
#define VOLTS 23592 /* 180 V */
static enum failure failure;
static int32_t panel_parts, in_phase_parts, offset_code; /* of the panel's current, in 1/1000 */
static int32_t rise_parts, rise_ahead_parts; /* in each 40 ms */
static int32_t level_now;
static uint32_t changed_at;
static int32_t converter_before, late_codes[3], stuck_code, square_code;

static int32_t converted(int32_t drive) {
    double sine = device.sensor.sine ? device.sensor.sine : 32767, cosine = device.sensor.cosine;
    double unit = device.sensor.panel / 65536.0;
    double ahead = unit * (drive * cosine - converter_before * 32767.0) / sine;
    double code = ahead * panel_parts / 1000.0 + unit * drive * in_phase_parts / 1000.0;
    converter_before = drive;
    int32_t noise = (int32_t)chance(33) - 16, exact = (int32_t)code + noise + offset_code;
    int32_t late = late_codes[0];
    late_codes[0] = late_codes[1], late_codes[1] = late_codes[2], late_codes[2] = exact;
    switch (failure) {
    case NOISE: return noise;
    case DEAD: return 0;
    case STUCK: return stuck_code;
    case INVERTED: return -exact;
    case SATURATED: return exact > 0 ? 32752 : exact < 0 ? -32752 : 0;
    case LATE: return late;
    case SQUARE: return exact + (drive >= 0 ? square_code : -square_code);
    case AT_END: return 32767;
    case UPSIDE: return exact > -12000 ? exact : -32752;
    default: return stuck_code = exact;
    }
}

/* Hand over what the converter measured of output samples. */
static void converter(const int16_t *codes, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) {
        int32_t code = converted(codes[i]);
        raw[i] = (int16_t)(code > 32767 ? 32767 : code < -32768 ? -32768 : code);
    }
    if (failure != SILENT) hx_device_sense(&device, codes, raw, n, 0);
}

/* Play for so many ms, or until a fault: return it. */
static int plays_for(uint32_t ms) {
    for (uint32_t at = 0; at < ms && !fault(); at++) {
        if (device.queued < 48u) stream_level(level_now, 48);
        if (at % 40u == 0) in_phase_parts += rise_parts, panel_parts += rise_ahead_parts;
        for (uint32_t piece = 0; piece < MS / PERIOD; piece++) {
            hx_device_play(&device, out, NULL, PERIOD);
            converter(out, PERIOD);
        }
    }
    return fault();
}

static void change(enum failure to, int32_t panel, int32_t in_phase) {
    failure = to, panel_parts = panel, in_phase_parts = in_phase;
    changed_at = (uint32_t)device.clock;
}

/* One output sample, measured. */
static void one(void) {
    if (device.queued < 48u && device.is_armed) stream_level(level_now, 48);
    hx_device_play(&device, out, NULL, 1);
    converter(out, 1);
}

/* Output samples from now until a fault or a doubt. */
static uint32_t until_told(void) {
    uint32_t n = 0;
    for (; n < SENSE_HZ && !fault() && !device.sensor.doubt; n++) one();
    return n;
}

/* One half period, from a change of sign to the next, in which the converter fails. */
static void one_half(enum failure how) {
    for (int32_t sign = 0; sign < 2; sign++) {
        int16_t before = out[0];
        do {
            before = out[0];
            one();
        } while ((before < 0) == (out[0] < 0));
        failure = sign ? WELL : how;
    }
}

/* Whether a fault has come, and the output is at 0 V within so many samples of the change. */
static int ends_by(enum hx_fault_code code, uint32_t samples) {
    uint64_t deadline = changed_at + samples;
    for (uint32_t at = 0; at < 4u * samples; at++) {
        one();
        if (device.clock > deadline && out[0] != 0) return 0;
    }
    return fault() == (int)code && out[0] == 0;
}

static void sensing_on(uint32_t flags, uint32_t sense_hz, uint32_t carrier_hz, uint32_t full_scale_mv) {
    hx_config board = config;
    set_up_fields s = {HX_ENVELOPE, WATCHDOG_MS, 16000, full_scale_mv, full_scale_mv * 4u / 5u, STEEP,
                       carrier_hz * 1000u, 0};
    board.output_rate_hz = SENSE_HZ, board.full_scale_mv = full_scale_mv;
    board.ceiling_mv = full_scale_mv * 4u / 5u;
    board.rates[0].sample_rate_hz = SENSE_HZ, board.rates[1].sample_rate_hz = 16000;
    board.flags = (uint16_t)flags, board.sense_rate_hz = sense_hz;
    power_up(&board);
    failure = WELL, panel_parts = 1000, in_phase_parts = offset_code = 0;
    rise_parts = rise_ahead_parts = 0;
    converter_before = 0;
    arm_at_once(s);
    for (int32_t i = 0; i < 100; i++) { /* up to the level in 50 ms */
        int32_t codes[8];
        for (int32_t k = 0; k < 8; k++) codes[k] = level_now * (8 * i + k) / 800;
        demand(stream(codes, 8) == HX_FAULT_NONE);
        hx_device_play(&device, out, NULL, 24);
        converter(out, 24);
    }
}

static void sensing(void) { level_now = VOLTS, sensing_on(HX_SENDS_TOUCH, 250, 4000, 250000); }

/* Until the panel is known: 50 ms untouched and 16 readings of 4 ms. */
static void known(void) {
    sensing();
    demand(plays_for(150) == HX_FAULT_NONE && device.sensor.measured == 16u);
}

static hx_touch finger(uint8_t phase) {
    hx_touch touch = {0, 1, 1, 1, 1, phase};
    return touch;
}

static void currents(void) {
    hx_touch down = finger(1), up = finger(0);
    uint32_t before;
    hx_reading *last_reading;
    /* Readings: at their rate, of the current that flows, with the converter's offset taken off. */
    for (uint32_t hz = 250; hz <= 4000; hz *= 2) {
        level_now = VOLTS, sensing_on(HX_SENDS_TOUCH, hz, 4000, 250000);
        in_phase_parts = 50, offset_code = 200;
        plays_for(20), device.readings = 0, hx_seal(&device);
        plays_for(3);
        uint32_t n = device.readings;
        demand(hz > 500 ? n >= hz * 3u / 1000u - 1u && n <= hz * 3u / 1000u + 1u : n <= 2u);
        plays_for(8);
        last_reading = &device.reading[device.readings - 1u];
        demand(last_reading->ahead_na > 8900000 && last_reading->ahead_na < 9200000);
        demand(last_reading->in_phase_na > 400000 && last_reading->in_phase_na < 500000);
        demand(last_reading->driven > VOLTS - 30 && last_reading->driven < VOLTS + 30);
        demand(last_reading->flags == 0);
    }
    hx_device_release(&device), demand(device.readings == 0);
    sensing(), plays_for(10), hello(), demand(device.readings == 0);
    /* A peak, ahead or in phase, is at 0 V within a millisecond; below it nothing is. */
    known(), change(WELL, 1085, 0), demand(ends_by(HX_FAULT_PEAK_CURRENT, MS + PERIOD));
    known(), change(WELL, 1000, 85), demand(ends_by(HX_FAULT_PEAK_CURRENT, MS + PERIOD));
    known(), change(WELL, 1050, 0), demand(plays_for(100) == HX_FAULT_NONE);
    known(), change(WELL, 1000, 50), demand(plays_for(100) == HX_FAULT_NONE);
    known(), change(WELL, 1078, 0), demand(plays_for(50) == HX_FAULT_PEAK_CURRENT); /* 0.706 mA */
    known(), change(WELL, 985, 100), demand(plays_for(50) == HX_FAULT_PEAK_CURRENT);
    square_code = 983; /* 0.6 mA, below the peak */
    known(), change(SQUARE, 1000, 0), demand(ends_by(HX_FAULT_RMS_CURRENT, MS + 2u * PERIOD));
    square_code = 835; /* 0.51 mA */
    known(), change(SQUARE, 1000, 0), demand(plays_for(3) == HX_FAULT_RMS_CURRENT);
    square_code = 795; /* 0.485 mA */
    known(), change(SQUARE, 1000, 0), demand(plays_for(3) == HX_FAULT_NONE);
    /* A broken electrode, a short, a converter at its end. */
    sensing(), change(NOISE, 1000, 0), demand(ends_by(HX_FAULT_NO_CURRENT, MS + PERIOD));
    known(), change(NOISE, 1000, 0), demand(ends_by(HX_FAULT_NO_CURRENT, MS + PERIOD));
    sensing(), change(WELL, 420, 0), demand(ends_by(HX_FAULT_NO_CURRENT, MS + 2u * PERIOD));
    sensing(), change(WELL, 1000, 2000), demand(ends_by(HX_FAULT_OVERLOAD, MS + PERIOD));
    sensing(), change(NOISE, 1000, 0), demand(until_told() <= 25u); /* four halves: 0.5 ms */
    sensing(), change(WELL, 1000, 2000), demand(until_told() <= 13u); /* two */
    sensing(), change(INVERTED, 1000, 0), demand(until_told() <= 20u); /* three */
    level_now = VOLTS / 2, sensing_on(HX_SENDS_TOUCH, 250, 4000, 250000); /* within the converter's range */
    change(WELL, 1000, 2000), demand(ends_by(HX_FAULT_OVERLOAD, MS + PERIOD));
    level_now = 1966, sensing_on(HX_SENDS_TOUCH, 250, 4000, 250000); /* 15 V */
    change(NOISE, 1000, 0), demand(ends_by(HX_FAULT_NO_CURRENT, MS + PERIOD));
    level_now = 1450, sensing_on(HX_SENDS_TOUCH, 250, 4000, 250000); /* 11 V, by the full scale */
    change(NOISE, 1000, 0), demand(ends_by(HX_FAULT_NO_CURRENT, MS + PERIOD));
    level_now = VOLTS, sensing_on(HX_SENDS_TOUCH, 250, 1000, 250000); /* one half decides nothing */
    for (uint32_t i = 0; i < 2u; i++) { /* of either sign */
        one_half(NOISE), demand(plays_for(20) == HX_FAULT_NONE && !device.sensor.doubt);
        for (uint32_t k = 0; k < 30u; k++) one();
    }
    sensing(), change(AT_END, 1000, 0), demand(ends_by(HX_FAULT_OVERLOAD, MS + 2u * PERIOD));
    sensing(), say(HX_STOP, 0, NULL, 0), change(NOISE, 1000, 0); /* nothing is judged on the way to 0 V */
    for (uint32_t i = 0; i < 3u * MS; i++) one();
    demand(fault() == HX_FAULT_NONE && !device.sensor.doubt);
    sensing(), change(SATURATED, 1000, 0), demand(ends_by(HX_FAULT_OVERLOAD, MS + 2u * PERIOD));
    sensing(), change(UPSIDE, 1000, 0), demand(ends_by(HX_FAULT_OVERLOAD, MS + 2u * PERIOD));
    /* A converter that is not believed is told within 10 ms, and changes nothing. */
    static const struct { enum failure is; uint32_t doubt; } fails[5] = {
        {DEAD, HX_STUCK}, {STUCK, HX_STUCK}, {INVERTED, HX_LIES}, {LATE, HX_LIES}, {SILENT, HX_LATE}};
    for (uint32_t i = 0; i < 5u; i++) {
        known(), change(fails[i].is, 1000, 0);
        uint32_t told = device.readings = 0;
        hx_seal(&device);
        demand(plays_for(10) == HX_FAULT_NONE && device.sensor.doubt == fails[i].doubt);
        for (uint32_t k = 0; k < device.readings; k++) told |= device.reading[k].flags;
        demand(told >> 1 == fails[i].doubt || told >> 1 == HX_LIES);
        demand(plays_for(100) == HX_FAULT_NONE);
        /* Believed again after half a second of good samples, not before. */
        change(WELL, 1000, 0), demand(plays_for(450) == HX_FAULT_NONE && device.sensor.doubt);
        demand(plays_for(100) == HX_FAULT_NONE && !device.sensor.doubt);
        change(WELL, 1085, 0), demand(ends_by(HX_FAULT_PEAK_CURRENT, MS + PERIOD));
    }
    known(), change(INVERTED, 1000, 0), plays_for(20);
    change(WELL, 1000, 0), plays_for(300), change(INVERTED, 1000, 0), plays_for(20);
    change(WELL, 1000, 0), plays_for(300), demand(device.sensor.doubt == HX_LIES);
    change(WELL, 1000, 2000), demand(plays_for(100) == HX_FAULT_NONE); /* of which nothing is believed */
    known(), change(INVERTED, 1000, 0), plays_for(20), say(HX_STOP, 0, NULL, 0);
    change(WELL, 1000, 0), plays_for(20); /* a playback that begins forgets no doubt */
    set_up_fields again = {HX_ENVELOPE, WATCHDOG_MS, 16000, 250000, 200000, STEEP, 4000000u, 0};
    hello(), demand(setup_with(again)), say(HX_ARM, 0, NULL, 0), level_now = 1000, plays_for(20);
    demand(device.sensor.doubt == HX_LIES), level_now = VOLTS;
    known(), change(SILENT, 1000, 0), plays_for(5), demand(!device.sensor.doubt);
    for (uint32_t i = 0; i < PERIOD; i++) one();
    demand(device.sensor.doubt == HX_LATE);
    change(WELL, 1000, 0), plays_for(300), change(SILENT, 1000, 0), plays_for(20);
    change(WELL, 1000, 0), plays_for(300), demand(device.sensor.doubt == HX_LATE);
    sensing(), hx_device_touch(&device, &down), change(LATE, 1000, 0);
    plays_for(10), demand(device.sensor.doubt == HX_LIES); /* though no panel is known */
    level_now = VOLTS, sensing_on(HX_SENDS_TOUCH, 4000, 4000, 250000), plays_for(100);
    device.readings = 0, hx_seal(&device), change(INVERTED, 1000, 0), until_told();
    demand(device.readings > 0);
    for (uint32_t i = 0; i < device.readings; i++) /* what may be a lie is marked as one */
        demand(device.reading[i].ahead_na > 0 || device.reading[i].flags >> 1 == HX_LIES);
    /* What takes from a known panel's current is no load; before it is known, a quarter may be. */
    sensing(), change(WELL, 800, 0), plays_for(30), demand(!device.sensor.doubt);
    sensing(), change(WELL, 600, 0), demand(plays_for(30) == HX_FAULT_NONE && !device.sensor.doubt);
    known(), change(WELL, 800, 0), plays_for(10), demand(device.sensor.doubt == HX_LIES && !fault());
    known(), change(WELL, 940, 0), plays_for(10), demand(!device.sensor.doubt && !fault());
    /* No finger becomes a part of the panel: reported, late, or never. */
    sensing(), hx_device_touch(&device, &down), plays_for(300), demand(device.sensor.measured == 0);
    change(WELL, 1085, 0), demand(plays_for(100) == HX_FAULT_NONE);
    hx_device_touch(&device, &up), change(WELL, 1000, 0), plays_for(40), demand(device.sensor.measured == 0);
    plays_for(110), demand(device.sensor.measured == 16u);
    change(WELL, 1085, 0), demand(ends_by(HX_FAULT_PEAK_CURRENT, MS + PERIOD));
    sensing(), before = device.sensor.measured;
    hx_device_touch(&device, &down), hx_device_touch(&device, &up); /* between two output samples */
    plays_for(40), demand(device.sensor.measured == before);
    hx_touch other_down = down; /* one finger lifts, another stays */
    other_down.contact = 17u;
    sensing(), hx_device_touch(&device, &other_down), hx_device_touch(&device, &down);
    hx_device_touch(&device, &up), plays_for(300), demand(device.sensor.measured == 0);
    known(), change(WELL, 1030, 0), plays_for(500);
    change(WELL, 1085, 0), demand(ends_by(HX_FAULT_PEAK_CURRENT, MS + PERIOD));
    known(), rise_parts = 1, demand(plays_for(6000) && in_phase_parts < 93);
    known(), rise_ahead_parts = 1, demand(plays_for(6000) && panel_parts < 1093);
    known(), change(WELL, 1010, 9), plays_for(1000); /* a panel that drifts is followed */
    change(WELL, 1010 + 79, 9), demand(plays_for(100) == HX_FAULT_PEAK_CURRENT);
    level_now = VOLTS, sensing_on(0, 250, 4000, 250000), plays_for(300);
    demand(device.sensor.measured == 0); /* a board that reports no touches */
    sensing(), change(WELL, 1400, 0), plays_for(200), demand(device.sensor.measured <= 1u);
    sensing(), change(WELL, 1000, 700), plays_for(200), demand(device.sensor.measured <= 1u);
    sensing(), change(INVERTED, 1000, 0), plays_for(100), change(WELL, 1000, 0), plays_for(300);
    demand(device.sensor.measured <= 1u && device.sensor.doubt); /* nor from what is not believed */
    /* Another carrier has another panel; one of four samples a period is not measured. */
    known(), say(HX_STOP, 0, NULL, 0), plays_for(20);
    before = device.sensor.measured;
    device.sensor.lies = device.sensor.missing = device.sensor.too_much = 1, hx_seal(&device);
    set_up_fields other = {HX_ENVELOPE, WATCHDOG_MS, 16000, 250000, 200000, STEEP, 3000000u, 0};
    for (uint32_t i = 0; i < 200u; i++) hx_device_play(&device, out, NULL, PERIOD);
    demand(!device.sensor.doubt); /* nobody measures while nothing plays, and then it is not late */
    hello(), demand(setup_with(other)), say(HX_ARM, 0, NULL, 0), level_now = 1000;
    plays_for(10), demand(before == 16u && device.sensor.measured == 0 && !device.sensor.doubt);
    demand(device.sensor.lies + device.sensor.missing + device.sensor.too_much == 0); /* of before */
    static const uint32_t carriers_hz[3] = {1700, 7000, 11900}; /* halves of 14, 3 and 2 samples */
    for (uint32_t i = 0; i < 3u; i++) {
        level_now = 7000, sensing_on(HX_SENDS_TOUCH, 250, carriers_hz[i], 250000);
        demand(plays_for(200) == HX_FAULT_NONE && !device.sensor.doubt && device.sensor.measured == 16u);
    }
    level_now = 1000, sensing_on(HX_SENDS_TOUCH, 250, 12000, 250000), change(NOISE, 1000, 0);
    demand(plays_for(100) == HX_FAULT_NONE && device.sensor.doubt == HX_DIRECT);
    /* Below 10 V, and where no code reaches it, no current is expected and no panel learned. */
    level_now = 1000, sensing_on(HX_SENDS_TOUCH, 250, 4000, 250000), change(NOISE, 1000, 0);
    demand(plays_for(100) == HX_FAULT_NONE && !device.sensor.doubt && device.sensor.measured == 0);
    level_now = VOLTS, sensing_on(HX_SENDS_TOUCH, 250, 4000, 3500), change(NOISE, 1000, 0);
    demand(plays_for(100) == HX_FAULT_NONE && !device.sensor.doubt);
    /* Samples that are told twice count once; behind a gap a reading begins anew. */
    known(), device.readings = 0, hx_seal(&device);
    for (uint32_t i = 0; i < 400u; i++) {
        if (device.queued < 48u) stream_level(level_now, 48);
        hx_device_play(&device, out, NULL, PERIOD);
        converter(out, PERIOD);
        hx_device_sense(&device, out, raw, PERIOD, 0);
    }
    demand(!fault() && !device.sensor.doubt);
    demand(device.readings >= (HX_READINGS < 22u ? HX_READINGS : 22u));
    last_reading = &device.reading[device.readings - 1u];
    demand(last_reading->clock - last_reading[-1].clock == SENSE_HZ / 250u);
    known(), device.readings = 0, hx_seal(&device);
    for (uint32_t i = 0; i < 400u; i++) { /* every second period is missing */
        if (device.queued < 48u) stream_level(level_now, 48);
        hx_device_play(&device, out, NULL, PERIOD + 5u * (i % 2u));
        if (i % 2u == 0) converter(out, PERIOD);
        else converter_before = out[PERIOD + 4u];
    }
    demand(!fault() && device.readings <= 3u);
}

/* What a converter tells of n output samples: a panel, more or less, and all that is wrong with one. */
static void tell_current(uint32_t n, uint32_t kind, int32_t ahead, int32_t gain) {
    static int32_t before;
    for (uint32_t i = 0; i < n; i++) {
        /* A share of the panel's current, and of one in phase. */
        double sine = device.sensor.sine ? device.sensor.sine : 32767, cosine = device.sensor.cosine;
        double panel = device.sensor.panel / 65536.0 * (out[i] * cosine - before * 32767.0) / sine;
        if (panel > 30000.0 || panel < -30000.0) panel = 30000.0;
        int32_t code = (int32_t)(panel * ahead / 1000.0) + out[i] * gain / 1024;
        int32_t noise = (int32_t)chance(33) - 16;
        if (kind == 1) noise *= (int32_t)chance(4000);
        if (kind == 2) code = noise = gain * 30;
        if (kind == 3) code = chance(2) ? 32767 : -32768;
        if (kind == 4) code = 0;
        if (kind == 5) code = -code;
        code += noise;
        raw[i] = (int16_t)(code > 32767 ? 32767 : code < -32768 ? -32768 : code);
        before = out[i];
    }
}

/* Whatever a converter tells, every limit that play() demands holds, and the output is that of a twin
 * without a sensor, or goes to 0 V in a ramp of a millisecond at most. */
static void hostile_currents(uint32_t streams) {
    static hx_device twin;
    static int16_t twin_out[4096];
    uint32_t faults[4] = {0}, doubts[5] = {0};
    for (uint32_t i = 0; i < streams; i++) {
        hx_config board = config;
        power_up(&board);
        twin = device;
        board.sense_rate_hz = 250u << chance(5);
        board.sense_full_scale_na = 20000000u;
        board.panel_pf = 2000u;
        demand(hx_device_init(&device, &board));
        set_up_fields s = plain;
        s.mode = chance(40) ? HX_ENVELOPE : HX_WAVEFORM;
        s.rate_hz = chance(2) ? RATE_HZ : RATE_HZ / 4u;
        if (s.mode) s.carrier_mhz = 1000000u + chance(7000000u);
        int32_t most = s.mode ? (int32_t)(chance(2) ? 3000 : 6000) : 500, level = 0, to = most;
        hx_device *both[2] = {&device, &twin};
        demand(setup_with(s));
        hx_device_receive(&twin, frame_bytes, HX_SETUP_BYTES + HX_FRAME_OVERHEAD_BYTES);
        say(HX_ARM, 0, NULL, 0);
        hx_device_receive(&twin, frame_bytes, HX_FRAME_OVERHEAD_BYTES);
        uint32_t cut = 0, blocks = 8u + chance(60);
        for (uint32_t block = 0; block < blocks; block++) {
            uint32_t n = 1u + chance(16), kind = chance(12) ? 0 : chance(6);
            int32_t ahead = 1000, gain = 0;
            if (chance(8) == 0) ahead = (int32_t)chance(4000) - 1000;
            if (chance(8) == 0) gain = (int32_t)chance(300);
            for (uint32_t b = 0; b < 8u; b++) {
                if (chance(40) == 0) to = (int32_t)chance((uint32_t)most);
                hx_put_u32(payload_bytes, device.next_index);
                for (uint32_t k = 0; k < 4u; k++) {
                    level += to > level ? 1 + (to - level) / 8 : (to - level) / 8;
                    hx_put_u16(payload_bytes + 4 + 2 * k, (uint16_t)level);
                }
                uint32_t length = make_frame(frame_bytes, HX_STREAM, device.next_sequence,
                                             device.mode, payload_bytes, 12);
                if (!device.fault.code && device.config.queue_samples - device.queued >= 4u)
                    for (uint32_t k = 0; k < 2u; k++) hx_device_receive(both[k], frame_bytes, length);
                play(n);
                hx_device_play(&twin, twin_out, NULL, n);
                for (uint32_t k = 0; k < n; k++) {
                    int is_measured = device.fault.code >= HX_FAULT_PEAK_CURRENT;
                    if (!is_measured) demand(out[k] == twin_out[k]);
                    else if (++cut > RATE_HZ / 1000u) demand(out[k] == 0);
                }
                if (chance(300) == 0) {
                    hx_touch touch = {0, 1, 1, 1, (uint8_t)chance(3), (uint8_t)chance(3)};
                    hx_device_touch(&device, &touch);
                }
                tell_current(n, kind, ahead, gain);
                if (chance(500)) hx_device_sense(&device, out, raw, n, chance(90) ? 0 : chance(200));
            }
        }
        if (device.fault.code >= HX_FAULT_PEAK_CURRENT) faults[device.fault.code - HX_FAULT_PEAK_CURRENT]++;
        doubts[device.sensor.doubt]++;
        play(WATCHDOG);
        demand(out[WATCHDOG - 1u] == 0 && hx_device_is_whole(&device));
    }
    demand(streams < 1000u || (faults[0] && faults[2] && faults[3] && doubts[HX_STUCK] && doubts[HX_LIES]));
    printf("%u streams of currents: %u peaks, %u rms, %u no current, %u overloads\n", streams, faults[0],
           faults[1], faults[2], faults[3]);
}

/* Counters close to where they begin again, as after weeks. */
static void weeks_later(void) {
    power_up(&config);
    ready(plain);
    device.samples_played = device.next_index = 0xffffffc0u;
    device.revisions = 0xffff;
    device.clock = 0xffffffffu;
    device.underruns = 0xffffffffu;
    hx_seal(&device);
    int32_t hill[2] = {200, 100};
    for (int round = 0; round < 3; round++) {
        demand(stream_level(100, 40) == HX_FAULT_NONE);
        demand(revise(20, device.revisions, hill, 2) == HX_FAULT_NONE);
        play(40);
        for (int i = 0; i < 40; i++) demand(out[i] == (i == 20 ? 200 : 100));
    }
    demand(device.next_index == 0x38u && device.revisions == 2);
    demand(revise_one(0x7fffffffu, 100) == HX_FAULT_SAMPLE_INDEX);
}

/* `make weeks`: a stream of 50 days without an end, with revisions, until every count of 32 bits has
 * begun again. What leaves is what was sent, sample by sample. */
static void weeks(void) {
    static const int32_t turn[20] = {0,      3090,   5878,   8090,   9511,   10000,  9511,
                                     8090,   5878,   3090,   0,      -3090,  -5878,  -8090,
                                     -9511,  -10000, -9511,  -8090,  -5878,  -3090};
    hx_config board = config;
    set_up_fields s = plain;
    int32_t codes[40];
    board.output_rate_hz = board.rates[0].sample_rate_hz = s.rate_hz = 1000, board.rate_count = 1;
    power_up(&board);
    arm_at_once(s);
    for (int i = 0; i < 40; i++) codes[i] = turn[i % 20];
    demand(stream(codes, 40) == HX_FAULT_NONE);
    for (uint64_t block = 0; block < (1ull << 32) / 20u + 100000u; block++) {
        demand(stream(codes, 20) == HX_FAULT_NONE);
        int is_revised = block % 16u == 0;
        codes[7] += is_revised; /* of the block behind this one */
        if (is_revised) demand(revise(20, device.revisions, codes, 20) == HX_FAULT_NONE);
        codes[7] -= is_revised;
        hx_device_play(&device, out, what, 20);
        for (int i = 0; i < 20; i++)
            demand(out[i] == turn[i] + (i == 7 && block % 16u == 1u) && what[i] == HX_OUT_STREAM);
    }
    demand(device.clock > 0xffffffffu && device.samples_played < 3000000u && device.faults == 0);
    puts("50 days: each output sample is the one that was sent.");
}

int main(int argc, char **argv) {
    static uint8_t data[2048];
    if (argc > 2) {
        hostile_currents((uint32_t)atoi(argv[2]));
        return 0;
    }
    if (argc > 1) {
        weeks();
        return 0;
    }
    boards();
    setups();
    endings();
    ceiling_and_slew();
    watchdog();
    running_dry();
    revisions();
    energy_and_mean();
    bad_memory();
    lost_memory();
    own_tests();
    arming();
    hostile_host();
    steep_carrier();
    weeks_later();
    currents();
    hostile_currents(300);
    for (int round = 0; round < 1000; round++) {
        for (size_t i = 0; i < sizeof data; i++) data[i] = (uint8_t)chance(256);
        LLVMFuzzerTestOneInput(data, chance(sizeof data));
    }
    puts("No output above the ceiling, the slew, the energy or the mean; nothing left standing.");
    return 0;
}
