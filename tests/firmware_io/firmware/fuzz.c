/* A fuzzer's way into the core (libFuzzer's entry point; `make fuzz`, `make check`).
 *
 * The input is a program of calls: bytes as they come, bytes in reports, whole frames with their
 * check sums made right (no fuzzer finds a CRC-32 by itself), time, answers. Whatever it says, no
 * output is above the ceiling, none further from the one before than the slew that was stated, no
 * second above the energy or the mean, the output is at 0 V when the watchdog time has passed in
 * silence, and the device hears a HELLO behind any garbage.
 */
#include <stddef.h>
#include <stdint.h>
#ifdef HX_EMULATED /* a board without a library */
void abort(void);
#else
#include <stdlib.h>
#endif

#include "haptix_device.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define RATE_HZ 16000u
#define WATCHDOG_MS 40u
#define GUARD_TICKS 16u
#define CEILING_CODE 26213 /* 200 V of 250 V */
#define MOST_SQUARE 357527000 /* (142.835 V / 250 V 32767)^2 and 2 % */

static hx_device device;

static const hx_config config = {
    RATE_HZ, 250000, 200000, 4666666, 160, 150, WATCHDOG_MS, 64,
    HX_SENDS_TOUCH | HX_TAKES_MARK, 2,
    {{RATE_HZ, 3}, {RATE_HZ / 4, 3}}, "fuzzed", "1", "none", GUARD_TICKS, 4000, 20000000, 2000};

/* The last second of the output. */
static int16_t second[RATE_HZ];
static uint32_t second_at;
static int64_t sum, energy;
/* The last output, and the most codes by which the next may differ from it. */
static int32_t last, most_step;
static int is_at_rest;
/* What was played last. */
static int16_t out[4096];
static uint8_t what[4096];
/* What the converter tells: eighths of the drive, and of the one before it; 0: nothing. */
static uint32_t load;
static int16_t raw[4096];

/* The slew that a SETUP has stated, in codes of an output sample. */
static int32_t stated_step(void) {
    uint64_t codes_per_s = (uint64_t)device.max_slew_v_per_s * 32767000u / 250000u;
    return (int32_t)(codes_per_s / RATE_HZ);
}

static void forget_second(void) {
    last = most_step = 0;
    is_at_rest = 1;
    for (uint32_t i = 0; i < RATE_HZ; i++) second[i] = 0;
    second_at = 0;
    sum = energy = 0;
}

static void demand(int is_so) {
    if (!is_so) abort();
}

static void play(uint32_t n) {
    uint32_t pending = hx_device_pending(&device);
    demand(device.marks <= HX_MARKS);
    /* A ramp may still be that of a set-up before. */
    if (is_at_rest || most_step < stated_step()) most_step = stated_step();
    hx_device_play(&device, out, what, n);
    for (uint32_t i = 0; i < n && device.faults == 0 && i < pending && device.received == 0; i++)
        demand((what[i] & 0x7f) != HX_OUT_HELD);
    for (uint32_t i = 0; i < n; i++) {
        demand(out[i] <= CEILING_CODE && out[i] >= -CEILING_CODE);
        demand((what[i] & 0x7f) != HX_OUT_IDLE || out[i] == 0);
        demand(out[i] - last <= most_step && last - out[i] <= most_step);
        last = out[i];
        is_at_rest = (what[i] & 0x7f) == HX_OUT_IDLE;
        if (is_at_rest) most_step = stated_step();
        int64_t goes = second[second_at], comes = out[i];
        second[second_at] = out[i];
        second_at = (second_at + 1u) % RATE_HZ;
        sum += comes - goes;
        energy += comes * comes - goes * goes;
        demand(sum * 20 <= (int64_t)CEILING_CODE * RATE_HZ);
        demand(sum * -20 <= (int64_t)CEILING_CODE * RATE_HZ);
        demand(energy <= (int64_t)MOST_SQUARE * RATE_HZ);
        int32_t code = (out[i] * (int32_t)(load & 15u) - (i ? out[i - 1u] : 0) * (int32_t)(load >> 4)) / 8;
        raw[i] = (int16_t)(code > 32767 ? 32767 : code < -32768 ? -32768 : code);
    }
    if (load > 0) hx_device_sense(&device, out, raw, n, 0);
}

/* A frame with its check sums made right, from kind, sequence, mode and payload. */
static uint32_t make_frame(uint8_t *frame, uint8_t kind, uint16_t sequence, uint16_t mode,
                           const uint8_t *payload, uint32_t length) {
    frame[0] = 'H';
    frame[1] = 'X';
    frame[2] = HX_VERSION;
    frame[3] = kind;
    hx_put_u16(frame + 4, sequence);
    hx_put_u16(frame + 6, (uint16_t)length);
    hx_put_u16(frame + 8, mode);
    hx_put_u16(frame + 10, hx_crc16(frame, 10));
    for (uint32_t i = 0; i < length; i++) frame[12 + i] = payload[i];
    hx_put_u32(frame + 12 + length, hx_crc32(frame, 12 + length));
    return length + HX_FRAME_OVERHEAD_BYTES;
}

static void send(const uint8_t *bytes, uint32_t n, int in_reports) {
    uint8_t report[64];
    if (!in_reports) {
        hx_device_receive(&device, bytes, n);
        return;
    }
    for (uint32_t start = 0; start < n; start += 62) {
        uint32_t piece = n - start < 62 ? n - start : 62;
        report[0] = HX_REPORT_ID;
        report[1] = (uint8_t)(piece | (start == 0 ? HX_REPORT_BEGINS : 0));
        for (uint32_t i = 0; i < piece; i++) report[2 + i] = bytes[start + i];
        hx_device_receive_report(&device, report, piece + 2);
    }
}

/* A set-up that the device takes, and for some operands one that it does not. */
static void set_up(uint8_t operand) {
    static const uint8_t fields[8] = {0, 2, 4, 8, 12, 16, 20, 24};
    uint8_t payload[HX_SETUP_BYTES] = {0}, frame[64];
    uint16_t mode = operand & 1u;
    hx_put_u16(payload, mode);
    hx_put_u16(payload + 2, WATCHDOG_MS);
    hx_put_u32(payload + 4, operand & 2u ? RATE_HZ / 4 : RATE_HZ);
    hx_put_u32(payload + 8, 250000);
    hx_put_u32(payload + 12, operand & 4u ? 150000 : 200000);
    hx_put_u32(payload + 16, operand & 32u ? 46666 : operand & 8u ? 900000 : 4666666);
    hx_put_u32(payload + 20, mode ? 3000000 : 0);
    hx_put_u32(payload + 24, operand & 16u ? 1000 : 0);
    hx_put_u16(payload + 28, 3);
    if (operand >= 224) hx_put_u16(payload + fields[operand % 8u], 0xfff0);
    send(frame, make_frame(frame, HX_SETUP, device.next_sequence, 0, payload, sizeof payload), 0);
}

/* Play the input; its first byte is one of these calls and those after it what the call needs. */
static void run(const uint8_t *data, size_t size) {
    static uint8_t frame[1024], payload[1024];
    size_t at = 0;
    while (at + 2 <= size) {
        uint8_t call = data[at], operand = data[at + 1];
        uint32_t n = operand;
        at += 2;
        if (n > size - at) n = (uint32_t)(size - at);
        switch (call % 13u) {
        case 0:
            hx_device_receive(&device, data + at, n);
            at += n;
            break;
        case 1:
            if (n > 64) n = 64;
            hx_device_receive_report(&device, data + at, n);
            at += n;
            break;
        case 2:
        case 3: { /* any kind of frame, with a twist */
            uint8_t twist = n > 0 ? data[at] : 0;
            for (uint32_t i = 0; i < n; i++) payload[i] = data[at + i];
            at += n;
            n = make_frame(frame, call / 13u % 9u,
                           (uint16_t)(device.next_sequence + (twist == 1)), twist == 2, payload, n);
            if (twist == 3) frame[operand % n] ^= 4;
            if (twist == 4) { /* from the future */
                frame[2] = HX_VERSION + 1;
                hx_put_u16(frame + 10, hx_crc16(frame, 10));
            }
            send(frame, n, call % 13u == 3);
            break;
        }
        case 4:
        case 5: /* a stream that goes on, one byte for each sample, or for each step */
            hx_put_u32(payload, device.next_index);
            for (uint32_t i = 0, from = (uint32_t)device.last_queued; i < n; i++) {
                uint32_t code = (uint32_t)(data[at + i] << 8 | (data[at + i] ^ 0x55)) & 0xffffu;
                if (call > 127u) code = from += (data[at + i] - 128u) * 3u;
                hx_put_u16(payload + 4 + 2 * i, (uint16_t)code);
            }
            at += n;
            n = make_frame(frame, HX_STREAM, device.next_sequence,
                           (uint16_t)(device.mode ^ (call > 243)), payload, 4 + 2 * n);
            send(frame, n, call % 13u == 5);
            break;
        case 6: set_up(operand); break;
        case 7:
            send(frame, make_frame(frame, HX_ARM, device.next_sequence, 0, payload, 0), operand & 1);
            break;
        case 8: play(operand); break;
        case 9: play(operand * 16u); break; /* up to a quarter of a second */
        case 10: {
            uint32_t written = hx_device_transmit(&device, frame, operand * 4u);
            demand(written <= operand * 4u);
            break;
        }
        case 11: { /* queued samples revised, some of them too late or too far */
            uint32_t first = call / 13u * 4u, queued = device.queued;
            uint16_t revisions = device.revisions;
            hx_put_u32(payload, device.samples_played + first);
            hx_put_u16(payload + 4, (uint16_t)(revisions + (operand > 250)));
            n /= 4;
            for (uint32_t i = 0; i < n; i++) {
                uint32_t code = (uint32_t)(data[at + i] << 8 | (data[at + i] ^ 0x55)) & 0xffffu;
                hx_put_u16(payload + 6 + 2 * i, (uint16_t)code);
            }
            at += n;
            n = make_frame(frame, HX_REVISE, device.next_sequence, device.mode, payload, 6 + 2 * n);
            send(frame, n, operand & 1);
            demand(device.queued == queued || device.queued == 0);
            demand(device.revisions == revisions || first >= device.guard_samples);
            break;
        }
        default:
            if (operand < 4) hx_device_release(&device);
            else if (operand < 32) load = call & 128u ? 0x42u : call;
            else if (operand < 128) hx_device_transmit_report(&device, frame, 64);
            else {
                hx_touch touch = {0, operand, 7, 100, 0, 1};
                hx_device_touch(&device, &touch);
            }
        }
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    uint8_t versions[2] = {HX_VERSION, HX_VERSION}, frame[256];
    demand(hx_device_bytes() == sizeof device && hx_device_init(&device, &config));
    forget_second();
    load = 0x42; /* about that of the panel */
    if (size > 0 && data[0] & 1u) { /* half of the inputs begin where it is interesting */
        set_up(data[0] >> 1 & 63u);
        hx_device_receive(&device, frame, make_frame(frame, HX_ARM, device.next_sequence, 0, frame, 0));
        demand(device.is_armed);
    }
    run(data, size);

    /* Silence: 0 V within the watchdog time, unless a pause there lets an old frame through. */
    uint32_t watchdog_ticks = WATCHDOG_MS * RATE_HZ / 1000u;
    int is_quiet = device.received == 0 ||
                   device.pause_ticks + watchdog_ticks < RATE_HZ * HX_PAUSE_MS / 1000u;
    play(watchdog_ticks);
    demand(!is_quiet || (device.level == 0 && device.ramp_ticks_left == 0));

    /* Any garbage is over when the longest frame has passed. */
    uint32_t hello = make_frame(frame, HX_HELLO, 7, 0, versions, 2);
    for (uint32_t sent = 0; sent < HX_INDEX_BYTES + 2u * 150u + 2u * hello; sent += hello)
        hx_device_receive(&device, frame, hello);
    demand(device.received == 0 && device.capabilities_due && !device.is_armed);
    demand(hx_device_transmit(&device, frame, sizeof frame) > HX_CAPABILITIES_BYTES);
    demand(!device.capabilities_due && frame[3] == HX_CAPABILITIES);
    return 0;
}
