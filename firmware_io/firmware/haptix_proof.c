/* What a board tests at power-up, with its amplifier disabled: memory, and each limit tripped once. */
#include "haptix_internal.h"

/* March C-: each bit holds either value, whatever stands around it. */
static int marches(volatile uint32_t *words, uint32_t n, uint32_t from, int is_down) {
    for (uint32_t i = 0; i < n; i++) {
        volatile uint32_t *word = words + (is_down ? n - 1u - i : i);
        if (*word != from) return 0;
        *word = ~from;
    }
    return 1;
}

int hx_test_memory(void *memory, uint32_t bytes) {
    volatile uint32_t *words = memory;
    uint32_t n = bytes / 4u, ones = ~(uint32_t)0;
    for (uint32_t i = 0; i < n; i++) words[i] = 0;
    return marches(words, n, 0, 0) && marches(words, n, ones, 0) && marches(words, n, 0, 1) &&
           marches(words, n, ones, 1) && marches(words, n, 0, 0) && marches(words, n, ones, 0);
}

#define CODES 8u
#define BIT(fault) ((uint32_t)1 << (fault)) /* an int may have 16 bits */

static void say(hx_device *d, uint8_t kind, uint32_t length, uint8_t *frame) {
    frame[3] = kind;
    hx_put_u16(frame + 4, d->next_sequence);
    hx_put_u16(frame + 6, (uint16_t)length);
    hx_put_u16(frame + 8, kind == HX_STREAM ? d->mode : 0);
    hx_take_frame(d, frame);
    hx_seal(d);
}

/* A new session of a board, armed. */
static void begin(hx_device *d, const hx_config *config) {
    uint8_t frame[HX_HEADER_BYTES + HX_SETUP_BYTES] = {0}, *payload = frame + HX_HEADER_BYTES;
    uint32_t mode = config->rates[0].modes & 1u ? HX_WAVEFORM : HX_ENVELOPE;
    hx_device_init(d, config);
    hx_put_u16(payload, (uint16_t)mode);
    hx_put_u16(payload + 2, config->max_watchdog_ms);
    hx_put_u32(payload + 4, config->rates[0].sample_rate_hz);
    hx_put_u32(payload + 8, config->full_scale_mv);
    hx_put_u32(payload + 12, config->ceiling_mv);
    hx_put_u32(payload + 16, config->max_slew_v_per_s);
    hx_put_u32(payload + 20, mode == HX_ENVELOPE ? HX_MIN_CARRIER_MHZ : 0);
    say(d, HX_SETUP, HX_SETUP_BYTES, frame);
    say(d, HX_ARM, 0, frame);
}

/* Stream some samples of a code, the first of them perhaps another; return the fault. */
static uint8_t stream(hx_device *d, int32_t first, int32_t code) {
    uint8_t frame[HX_HEADER_BYTES + HX_INDEX_BYTES + 2u * CODES];
    hx_put_u32(frame + HX_HEADER_BYTES, d->next_index);
    for (uint32_t i = 0; i < CODES; i++)
        hx_put_u16(frame + HX_HEADER_BYTES + HX_INDEX_BYTES + 2u * i, (uint16_t)(i ? code : first));
    say(d, HX_STREAM, HX_INDEX_BYTES + 2u * CODES, frame);
    return d->fault.code;
}

/* Play until a fault, at most so many samples, a level that goes up and down with a period (0: it
 * stays up), as steep as it may; return the fault. */
static uint8_t play_until(hx_device *d, uint32_t ticks, uint32_t period_ticks) {
    int16_t out[CODES];
    int32_t step = (int32_t)(d->slew_codes_per_s / d->sample_rate_hz), code = 0, most = d->ceiling_code;
    for (uint32_t at = 0; at < ticks && !d->fault.code; at += CODES * d->ticks_per_sample) {
        int32_t to = period_ticks && at / period_ticks % 2u ? -most : most;
        code = code < to - step ? code + step : code > to + step ? code - step : to;
        if (stream(d, code, code)) break;
        for (uint32_t i = 0; i < d->ticks_per_sample; i++) hx_device_play(d, out, 0, CODES);
    }
    return d->fault.code;
}

uint32_t hx_test_limits(hx_device *d, const hx_config *config) {
    uint32_t wrong = 0, second = config->output_rate_hz;
    int16_t out;
    if (!hx_device_init(d, config)) return ~(uint32_t)0;
    begin(d, config);
    if (!d->is_armed || config->max_frame_samples < CODES) return ~(uint32_t)0;
    if (stream(d, 0, -32768) != HX_FAULT_CEILING) wrong |= BIT(HX_FAULT_CEILING);
    begin(d, config);
    d->slew_codes_per_s /= 2u * HX_MAX_FRAME_SAMPLES; /* so that a step that fits the ceiling breaks it */
    if (stream(d, d->ceiling_code, 0) != HX_FAULT_SLEW) wrong |= BIT(HX_FAULT_SLEW);
    begin(d, config);
    stream(d, 0, 0);
    for (uint32_t i = 1; i < d->watchdog_ticks && !d->fault.code; i++) hx_device_play(d, &out, 0, 1u);
    if (d->fault.code != HX_FAULT_STARVED) wrong |= BIT(HX_FAULT_STARVED);
    begin(d, config);
    if (d->mode == HX_WAVEFORM) {
        if (play_until(d, second, 0) != HX_FAULT_MEAN) wrong |= BIT(HX_FAULT_MEAN);
        begin(d, config);
        /* Three quarters of a square wave's energy, for the ramps between its levels. */
        uint64_t most = (uint64_t)((int32_t)d->ceiling_code * d->ceiling_code) / 4u * 3u * second;
        if (most > d->max_energy && play_until(d, second, second / 50u) != HX_FAULT_ENERGY)
            wrong |= BIT(HX_FAULT_ENERGY);
    }
    hx_device_init(d, config);
    return wrong;
}

void hx_device_read_back(hx_device *d, const int16_t *sent, const int16_t *found, uint32_t n,
                         int32_t tolerance) {
    if (!hx_device_is_whole(d)) return;
    for (uint32_t i = 0; i < n; i++) {
        int32_t error = (int32_t)found[i] - sent[i];
        d->bad_readings = error > tolerance || error < -tolerance ? d->bad_readings + 1u : 0u;
        if (d->bad_readings >= HX_BAD_READINGS) d->is_lost = 1;
    }
    hx_seal(d);
}
