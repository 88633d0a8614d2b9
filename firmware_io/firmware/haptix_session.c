/* What each frame does, and what a refused frame causes. */
#include <stddef.h>

#include "haptix_internal.h"
#include "haptix_window.h"

static uint32_t magnitude(int16_t code) {
    int32_t value = code;
    return (uint32_t)(value < 0 ? -value : value);
}

static uint32_t ceiling_code(uint32_t ceiling_mv, uint32_t full_scale_mv) {
    uint32_t code = (uint32_t)((uint64_t)ceiling_mv * 32767u / full_scale_mv);
    return code < 32767u ? code : 32767u;
}

static uint32_t ramp_ticks(const hx_config *c) {
    return (c->output_rate_hz * HX_RAMP_MS + 999u) / 1000u;
}

/* The slew in V/s of the ramp from a ceiling to 0, by which every state ends: no limit may be less. */
static uint32_t lowest_slew(const hx_config *c, uint32_t ceiling_mv) {
    uint32_t ticks = ramp_ticks(c);
    uint64_t step = (ceiling_code(ceiling_mv, c->full_scale_mv) + ticks - 1u) / ticks;
    uint32_t slew = (uint32_t)((step * c->output_rate_hz * c->full_scale_mv + 32766999u) / 32767000u);
    return slew > 0 ? slew : 1u;
}

static int describes_a_device(const hx_config *c) {
    if (c->output_rate_hz < 1000u || c->output_rate_hz > 1000000u) return 0;
    if (c->full_scale_mv < 1u || c->full_scale_mv > 1000000u) return 0;
    if (c->ceiling_mv < 1u || c->ceiling_mv > HX_ABSOLUTE_CEILING_MV) return 0;
    if (c->max_slew_v_per_s < lowest_slew(c, c->ceiling_mv)) return 0;
    if (c->max_slew_v_per_s > HX_ABSOLUTE_SLEW_V_PER_S) return 0;
    if (c->queue_samples > HX_QUEUE_SAMPLES) return 0;
    if (c->max_frame_samples < 1u || c->max_frame_samples > HX_MAX_FRAME_SAMPLES) return 0;
    if (c->max_frame_samples > c->queue_samples) return 0;
    if (c->max_watchdog_ms < HX_MIN_WATCHDOG_MS) return 0;
    if (c->max_watchdog_ms > HX_MAX_WATCHDOG_MS) return 0;
    if (c->report_bytes != 0 && (c->report_bytes < 8u || c->report_bytes > HX_MAX_REPORT_BYTES))
        return 0;
    if (c->guard_ticks < 1u || c->guard_ticks > 65535u) return 0;
    if (c->sense_rate_hz != 0) {
        if (c->sense_rate_hz % 250u != 0 || c->sense_rate_hz > 4000u) return 0;
        uint32_t rate = c->sense_rate_hz / 250u;
        if ((rate & (rate - 1u)) != 0) return 0;
        if (c->sense_full_scale_na < 100000u || c->sense_full_scale_na > 50000000u) return 0;
        if (c->panel_pf < 100u || c->panel_pf > 100000u) return 0;
    }
    if (c->rate_count < 1u || c->rate_count > HX_MAX_RATES) return 0;
    for (uint32_t i = 0; i < c->rate_count; i++) {
        uint32_t rate_hz = c->rates[i].sample_rate_hz;
        if (rate_hz == 0 || c->output_rate_hz % rate_hz != 0) return 0;
        if (c->output_rate_hz / rate_hz > 1024u) return 0;
        if (c->rates[i].modes < 1u || c->rates[i].modes > 3u) return 0;
    }
    return 1;
}

static void forget_setup(hx_device *d) {
    d->ceiling_mv = d->config.ceiling_mv;
    d->max_slew_v_per_s = d->config.max_slew_v_per_s;
    d->is_set_up = 0;
}

uint32_t hx_device_bytes(void) { return (uint32_t)sizeof(hx_device); }

int hx_device_init(hx_device *d, const hx_config *config) {
    if (!describes_a_device(config)) return 0;
    uint8_t *bytes = (uint8_t *)d;
    for (size_t i = 0; i < sizeof(hx_device); i++) bytes[i] = 0;
    d->config = *config;
    d->top_code = (int16_t)ceiling_code(config->ceiling_mv, config->full_scale_mv);
    d->ramp_ticks = ramp_ticks(config);
    d->hold_ticks = config->output_rate_hz * HX_DRY_MS / 1000u - d->ramp_ticks;
    d->line_ticks = (config->output_rate_hz * HX_MARK_MS + 999u) / 1000u;
    hx_window_init(d);
    d->work = hx_most_work(d);
    forget_setup(d);
    hx_seal(d);
    return 1;
}

static void clear_fault(hx_device *d) {
    d->fault.code = HX_FAULT_NONE;
    d->fault_due = 0;
}

static void accept(hx_device *d, uint16_t sequence) { d->next_sequence = (uint16_t)(sequence + 1u); }

static void take_hello(hx_device *d, uint16_t sequence, const uint8_t *payload) {
    hx_end_output(d);
    forget_setup(d);
    clear_fault(d);
    d->status_due = 0;
    d->readings = 0;
    d->marks = 0;
    d->token = 0;
    if (payload[0] > HX_VERSION || payload[1] < HX_VERSION) {
        uint32_t got = payload[0] > HX_VERSION ? payload[0] : payload[1];
        hx_refuse(d, HX_FAULT_VERSION, 0, sequence, HX_VERSION, got);
        return;
    }
    accept(d, sequence);
    d->capabilities_due = 1;
}

static int plays(const hx_device *d, uint32_t rate_hz, uint32_t mode) {
    for (uint32_t i = 0; i < d->config.rate_count; i++)
        if (d->config.rates[i].sample_rate_hz == rate_hz && (d->config.rates[i].modes >> mode & 1u))
            return 1;
    return 0;
}

static void take_setup(hx_device *d, uint16_t sequence, const uint8_t *payload) {
    uint32_t mode = hx_get_u16(payload), watchdog_ms = hx_get_u16(payload + 2);
    uint32_t rate_hz = hx_get_u32(payload + 4), full_scale_mv = hx_get_u32(payload + 8);
    uint32_t ceiling_mv = hx_get_u32(payload + 12), slew = hx_get_u32(payload + 16);
    uint32_t carrier_mhz = hx_get_u32(payload + 20), lead_us = hx_get_u32(payload + 24);
    uint32_t status_ms = hx_get_u16(payload + 28);
    uint32_t output_hz = d->config.output_rate_hz;
    uint32_t highest_carrier = mode == HX_ENVELOPE ? output_hz * 500u : 0u;
    uint32_t lowest_carrier = mode == HX_ENVELOPE ? HX_MIN_CARRIER_MHZ : 0u;
    uint8_t field = 255;
    uint32_t bound = 0, got = 0;

    if (mode >= HX_MODES) {
        field = 0, bound = HX_MODES - 1u, got = mode;
    } else if (watchdog_ms < HX_MIN_WATCHDOG_MS || watchdog_ms > d->config.max_watchdog_ms) {
        field = 2, got = watchdog_ms;
        bound = watchdog_ms < HX_MIN_WATCHDOG_MS ? HX_MIN_WATCHDOG_MS : d->config.max_watchdog_ms;
    } else if (!plays(d, rate_hz, mode)) {
        field = 4, bound = d->config.rates[0].sample_rate_hz, got = rate_hz;
    } else if (full_scale_mv != d->config.full_scale_mv) {
        field = 8, bound = d->config.full_scale_mv, got = full_scale_mv;
    } else if (ceiling_mv < 1u || ceiling_mv > d->ceiling_mv) {
        field = 12, bound = ceiling_mv < 1u ? 1u : d->ceiling_mv, got = ceiling_mv;
    } else if (slew < lowest_slew(&d->config, ceiling_mv) || slew > d->max_slew_v_per_s) {
        field = 16, bound = lowest_slew(&d->config, ceiling_mv), got = slew;
        if (slew > d->max_slew_v_per_s) bound = d->max_slew_v_per_s;
    } else if (carrier_mhz < lowest_carrier || carrier_mhz > highest_carrier) {
        field = 20, got = carrier_mhz;
        bound = carrier_mhz < lowest_carrier ? lowest_carrier : highest_carrier;
    } else if (lead_us > watchdog_ms * 1000u) {
        field = 24, bound = watchdog_ms * 1000u, got = lead_us;
    }
    if (field != 255) {
        d->is_set_up = 0;
        hx_refuse(d, HX_FAULT_SETUP, field, sequence, bound, got);
        return;
    }
    d->mode = (uint8_t)mode;
    d->sample_rate_hz = rate_hz;
    d->ticks_per_sample = output_hz / rate_hz;
    d->guard_samples = (d->config.guard_ticks + d->ticks_per_sample - 1u) / d->ticks_per_sample;
    d->ceiling_mv = ceiling_mv;
    d->max_slew_v_per_s = slew;
    d->phase_step = (uint32_t)(((uint64_t)carrier_mhz << 32) / ((uint64_t)output_hz * 1000u));
    /* 2 pi as 411775 / 65536, and rounded up: the slew of the carrier is not underrated. */
    d->carrier_rad_per_s =
        (uint32_t)(((uint64_t)carrier_mhz * 411775u + 65535999u) / 65536000u);
    /* Whole codes in each output sample: rounding to codes then never adds to a slope. */
    uint64_t step_codes = (uint64_t)slew * 32767000u / full_scale_mv / output_hz;
    d->slew_codes_per_s = step_codes * output_hz;
    d->step_codes = step_codes < 65534u ? (int32_t)step_codes : 65534;
    d->ceiling_code = (int16_t)ceiling_code(ceiling_mv, full_scale_mv);
    d->watchdog_ms = watchdog_ms;
    d->watchdog_ticks = (uint32_t)((uint64_t)watchdog_ms * output_hz / 1000u);
    d->setup_lead_ticks = (uint32_t)((uint64_t)lead_us * output_hz / 1000000u);
    d->status_ticks = (uint32_t)((uint64_t)status_ms * output_hz / 1000u);
    d->is_set_up = 1;
    clear_fault(d);
    accept(d, sequence);
    d->status_due = 1;
}

static void take_arm(hx_device *d, uint16_t sequence) {
    if (!d->is_set_up) {
        hx_refuse(d, HX_FAULT_NOT_SET_UP, 0, sequence, 0, 0);
        return;
    }
    clear_fault(d);
    accept(d, sequence);
    d->is_armed = 1;
    d->next_index = 0;
    d->last_queued = 0;
    d->samples_played = 0;
    d->revisions = 0;
    d->refused = 0;
    d->margin = 0;
    d->since_status_ticks = 0;
    d->status_due = 1;
}

static int is_too_steep(const hx_device *d, int16_t before, int16_t code) {
    int32_t step = (int32_t)code - before;
    uint64_t slew = (uint64_t)(uint32_t)(step < 0 ? -step : step) * d->sample_rate_hz;
    uint32_t a = magnitude(before), b = magnitude(code);
    if (d->mode == HX_ENVELOPE) slew += (uint64_t)d->carrier_rad_per_s * (a > b ? a : b);
    return slew > d->slew_codes_per_s;
}

/* Index of the first sample that differs too much from the one before it, or n. */
static uint32_t first_too_steep(const hx_device *d, int16_t before, const uint8_t *samples,
                                uint32_t n) {
    for (uint32_t i = 0; i < n; i++) {
        int16_t code = hx_get_i16(samples + 2u * i);
        if (is_too_steep(d, before, code)) return i;
        before = code;
    }
    return n;
}

/* Whether mode and ceiling hold for samples; refuse them if not. */
static int may_be_queued(hx_device *d, uint16_t sequence, uint16_t mode, const uint8_t *samples,
                         uint32_t n) {
    uint32_t peak = 0;
    if (mode != d->mode) {
        hx_refuse(d, HX_FAULT_MODE, 0, sequence, d->mode, mode);
        return 0;
    }
    for (uint32_t i = 0; i < n; i++) {
        uint32_t size = magnitude(hx_get_i16(samples + 2u * i));
        if (size > peak) peak = size;
    }
    if (peak > (uint32_t)d->ceiling_code) {
        uint32_t peak_mv = (uint32_t)(((uint64_t)peak * d->config.full_scale_mv + 32766u) / 32767u);
        hx_refuse(d, HX_FAULT_CEILING, 0, sequence, d->ceiling_mv, peak_mv);
        return 0;
    }
    return 1;
}

/* Write samples to the queue from a place that may lie past its end, which then wraps. */
static void put_samples(hx_device *d, uint32_t at, const uint8_t *samples, uint32_t n) {
    if (at >= HX_QUEUE_SAMPLES) at -= HX_QUEUE_SAMPLES;
    for (uint32_t i = 0; i < n; i++) {
        d->queue[at] = hx_get_i16(samples + 2u * i);
        at = at + 1u == HX_QUEUE_SAMPLES ? 0u : at + 1u;
    }
}

static void take_stream(hx_device *d, uint16_t sequence, uint16_t mode, const uint8_t *payload,
                        uint32_t length) {
    uint32_t index = hx_get_u32(payload), n = (length - HX_INDEX_BYTES) / 2u;
    const uint8_t *samples = payload + HX_INDEX_BYTES;

    if (!d->is_armed) {
        hx_refuse(d, HX_FAULT_NOT_ARMED, 0, sequence, 0, 0);
        return;
    }
    if (index != d->next_index) {
        hx_refuse(d, HX_FAULT_SAMPLE_INDEX, 0, sequence, d->next_index, index);
        return;
    }
    if (!may_be_queued(d, sequence, mode, samples, n)) return;
    uint32_t steep = first_too_steep(d, d->last_queued, samples, n);
    if (steep < n) {
        hx_refuse(d, HX_FAULT_SLEW, 0, sequence, d->max_slew_v_per_s, steep);
        return;
    }
    uint32_t free = d->config.queue_samples - d->queued;
    if (n > free) {
        hx_refuse(d, HX_FAULT_QUEUE_FULL, 0, sequence, free, n);
        return;
    }
    put_samples(d, d->head + d->queued, samples, n);
    d->queued += n;
    d->last_queued = hx_get_i16(samples + 2u * (n - 1u));
    d->next_index += n;
    d->silent_ticks = 0;
    if (!d->has_begun) {
        d->has_begun = 1;
        d->lead_ticks = d->setup_lead_ticks;
    }
    accept(d, sequence);
}

static int16_t queued_code(const hx_device *d, uint32_t ahead) {
    uint32_t at = d->head + ahead;
    return d->queue[at < HX_QUEUE_SAMPLES ? at : at - HX_QUEUE_SAMPLES];
}

/* Replace samples that are queued and not yet due, all of them or none. */
static void take_revise(hx_device *d, uint16_t sequence, uint16_t mode, const uint8_t *payload,
                        uint32_t length) {
    uint32_t index = hx_get_u32(payload), n = (length - HX_REVISE_HEAD_BYTES) / 2u;
    uint16_t revision = hx_get_u16(payload + HX_INDEX_BYTES);
    const uint8_t *samples = payload + HX_REVISE_HEAD_BYTES;

    if (!d->is_armed) {
        hx_refuse(d, HX_FAULT_NOT_ARMED, 0, sequence, 0, 0);
        return;
    }
    uint32_t ahead = index - d->samples_played;  /* queued in front of the first of these */
    uint32_t behind = d->next_index - index - n; /* and behind the last */
    int is_past = ahead > 0x7fffffffu;
    if (behind > 0x7fffffffu || (!is_past && ahead > d->queued)) {
        hx_refuse(d, HX_FAULT_SAMPLE_INDEX, 0, sequence, d->next_index, index + n);
        return;
    }
    if (!may_be_queued(d, sequence, mode, samples, n)) return;
    d->margin = is_past ? -(int32_t)(0xffffffffu - ahead) - 1 : (int32_t)ahead;
    if (d->margin < (int32_t)d->guard_samples || revision != d->revisions) {
        /* It is late, or was made for a queue that an earlier refusal left unchanged: no fault. */
        accept(d, sequence);
        d->refused++;
        d->status_due = 1;
        return;
    }
    uint32_t steep = first_too_steep(d, queued_code(d, ahead - 1u), samples, n);
    int16_t last = hx_get_i16(samples + 2u * (n - 1u));
    int is_seam = steep == n && behind > 0;
    if (steep < n || (is_seam && is_too_steep(d, last, queued_code(d, ahead + n)))) {
        hx_refuse(d, HX_FAULT_SLEW, 0, sequence, d->max_slew_v_per_s, steep);
        return;
    }
    put_samples(d, d->head + ahead, samples, n);
    if (behind == 0) d->last_queued = last;
    d->revisions++;
    d->silent_ticks = 0;
    accept(d, sequence);
}

/* Report when a sample is played. */
static void take_mark(hx_device *d, uint16_t sequence, const uint8_t *payload) {
    uint32_t index = hx_get_u32(payload);
    if (!d->is_armed) {
        hx_refuse(d, HX_FAULT_NOT_ARMED, 0, sequence, 0, 0);
        return;
    }
    if (d->marks == HX_MARKS) {
        hx_refuse(d, HX_FAULT_QUEUE_FULL, 0, sequence, 0, 1);
        return;
    }
    hx_mark *mark = &d->mark[d->marks++];
    mark->index = index;
    mark->code = hx_get_u16(payload + HX_INDEX_BYTES);
    mark->clock = ~(uint64_t)0;
    mark->is_due = index - d->samples_played > 0x7fffffffu; /* too late for the line */
    accept(d, sequence);
}

static uint32_t longest_stream(const hx_device *d) {
    return HX_INDEX_BYTES + 2u * d->config.max_frame_samples;
}

/* Bytes of the payload of this kind; 0 for kinds without a payload and for unknown kinds. */
static uint32_t fixed_length(uint8_t kind) {
    switch (kind) {
    case HX_HELLO: return HX_HELLO_BYTES;
    case HX_SETUP: return HX_SETUP_BYTES;
    case HX_PING: return HX_PING_BYTES;
    case HX_MARK: return HX_MARK_BYTES;
    default: return 0;
    }
}

uint32_t hx_longest_payload(const hx_device *d) {
    uint32_t revise = longest_stream(d) + HX_REVISE_HEAD_BYTES - HX_INDEX_BYTES;
    return revise > HX_SETUP_BYTES ? revise : HX_SETUP_BYTES;
}

uint32_t hx_most_work(const hx_device *d) {
    return (hx_longest_payload(d) + HX_FRAME_OVERHEAD_BYTES) * HX_WORK_FRAMES;
}

void hx_take_frame(hx_device *d, const uint8_t *frame) {
    const uint8_t *payload = frame + HX_HEADER_BYTES;
    uint8_t kind = frame[3];
    uint16_t sequence = hx_get_u16(frame + 4), mode = hx_get_u16(frame + 8);
    uint32_t length = hx_get_u16(frame + 6);

    uint8_t last_kind = d->config.flags & HX_TAKES_MARK ? HX_MARK : HX_REVISE;
    if (kind < HX_HELLO || kind > last_kind) {
        hx_refuse(d, HX_FAULT_KIND, 0, sequence, 0, kind);
        return;
    }
    if (kind == HX_STREAM || kind == HX_REVISE) {
        uint32_t head = kind == HX_STREAM ? HX_INDEX_BYTES : HX_REVISE_HEAD_BYTES;
        uint32_t longest = longest_stream(d) + head - HX_INDEX_BYTES;
        if (length < head + 2u || length % 2u || length > longest) {
            hx_refuse(d, HX_FAULT_LENGTH, 0, sequence, longest, length);
            return;
        }
    } else if (length != fixed_length(kind)) {
        hx_refuse(d, HX_FAULT_LENGTH, 0, sequence, fixed_length(kind), length);
        return;
    } else if (mode != 0) {
        hx_refuse(d, HX_FAULT_MODE, 0, sequence, 0, mode);
        return;
    }
    if (kind == HX_HELLO) {
        take_hello(d, sequence, payload);
        return;
    }
    if (d->is_armed && sequence != d->next_sequence) {
        hx_refuse(d, HX_FAULT_SEQUENCE, 0, sequence, d->next_sequence, sequence);
        if (kind == HX_STOP) d->status_due = 1;
        return;
    }
    if (d->is_armed && (kind == HX_SETUP || kind == HX_ARM)) {
        hx_refuse(d, HX_FAULT_ALREADY_ARMED, 0, sequence, 0, kind);
        return;
    }
    switch (kind) {
    case HX_SETUP: take_setup(d, sequence, payload); break;
    case HX_ARM: take_arm(d, sequence); break;
    case HX_STREAM: take_stream(d, sequence, mode, payload, length); break;
    case HX_REVISE: take_revise(d, sequence, mode, payload, length); break;
    case HX_MARK: take_mark(d, sequence, payload); break;
    case HX_STOP:
        accept(d, sequence);
        hx_end_output(d);
        d->status_due = 1;
        break;
    default: /* PING */
        accept(d, sequence);
        d->token = hx_get_u32(payload);
        d->status_due = 1;
    }
}

void hx_device_release(hx_device *d) {
    if (!hx_device_is_whole(d)) return;
    hx_end_output(d);
    forget_setup(d);
    d->received = 0;
    d->awaited = 0;
    d->pause_ticks = 0;
    d->has_paused = 0;
    d->capabilities_due = 0;
    d->fault_due = 0;
    d->status_due = 0;
    d->answer_bytes = 0;
    d->answer_sent = 0;
    d->touches = 0;
    d->readings = 0;
    d->marks = 0;
    hx_seal(d);
}
