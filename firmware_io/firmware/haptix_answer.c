/* What the device says: frames written at the moment they are read, so that none is stale. */
#include "haptix_internal.h"

static uint32_t put_frame(hx_device *d, uint8_t *bytes, enum hx_kind kind, uint32_t length) {
    bytes[0] = 'H';
    bytes[1] = 'X';
    bytes[2] = HX_VERSION;
    bytes[3] = (uint8_t)kind;
    hx_put_u16(bytes + 4, d->answer_sequence);
    hx_put_u16(bytes + 6, (uint16_t)length);
    hx_put_u16(bytes + 8, 0);
    hx_put_u16(bytes + 10, hx_crc16(bytes, HX_HEADER_BYTES - 2u));
    hx_put_u32(bytes + HX_HEADER_BYTES + length, hx_crc32(bytes, HX_HEADER_BYTES + length));
    d->answer_sequence++;
    return HX_FRAME_OVERHEAD_BYTES + length;
}

static void put_text(uint8_t *bytes, const char *text) {
    for (uint32_t i = 0; i < 16u; i++) bytes[i] = (uint8_t)text[i];
}

static uint32_t capabilities_bytes(const hx_device *d) {
    return HX_CAPABILITIES_BYTES + d->config.rate_count * HX_RATE_BYTES + HX_GUARD_BYTES;
}

static uint32_t put_capabilities(const hx_device *d, uint8_t *p) {
    const hx_config *c = &d->config;
    p[0] = HX_VERSION;
    p[1] = HX_VERSION;
    hx_put_u16(p + 2, c->report_bytes);
    hx_put_u32(p + 4, c->output_rate_hz);
    hx_put_u32(p + 8, c->full_scale_mv);
    hx_put_u32(p + 12, c->ceiling_mv);
    hx_put_u32(p + 16, c->max_slew_v_per_s);
    hx_put_u32(p + 20, c->queue_samples);
    hx_put_u16(p + 24, c->max_frame_samples);
    hx_put_u16(p + 26, c->max_watchdog_ms);
    put_text(p + 28, c->name);
    put_text(p + 44, c->serial);
    put_text(p + 60, c->calibration_id);
    uint32_t flags = c->flags;
    for (uint32_t hz = c->sense_rate_hz; hz >= 250u; hz /= 2u) flags += 1u << HX_SENSE_SHIFT;
    hx_put_u16(p + 76, (uint16_t)flags);
    hx_put_u16(p + 78, c->rate_count);
    for (uint32_t i = 0; i < c->rate_count; i++) {
        uint8_t *rate = p + HX_CAPABILITIES_BYTES + i * HX_RATE_BYTES;
        hx_put_u32(rate, c->rates[i].sample_rate_hz);
        hx_put_u32(rate + 4, c->rates[i].modes);
    }
    hx_put_u32(p + HX_CAPABILITIES_BYTES + c->rate_count * HX_RATE_BYTES, c->guard_ticks);
    return capabilities_bytes(d);
}

static uint8_t state(const hx_device *d) {
    if (d->is_armed) return d->is_playing ? HX_PLAYING : HX_ARMED;
    return d->ramp_ticks_left > 0 ? HX_RAMPING : HX_IDLE;
}

void hx_device_status(const hx_device *d, uint8_t *p) {
    p[0] = state(d);
    p[1] = d->fault.code;
    hx_put_u16(p + 2, d->next_sequence);
    hx_put_u32(p + 4, d->token);
    hx_put_u32(p + 8, d->queued);
    hx_put_u32(p + 12, d->config.queue_samples - d->queued);
    hx_put_u32(p + 16, d->samples_played);
    hx_put_u32(p + 20, d->underruns);
    hx_put_u32(p + 24, d->faults);
    hx_put_u64(p + 28, d->clock);
    hx_put_u16(p + 36, d->revisions);
    hx_put_u16(p + 38, d->refused);
    hx_put_u32(p + 40, (uint32_t)d->margin);
}

void hx_device_fault(const hx_device *d, uint8_t *p) {
    p[0] = d->fault.code;
    p[1] = d->fault.field;
    hx_put_u16(p + 2, d->fault.sequence);
    hx_put_u32(p + 4, d->fault.expected);
    hx_put_u32(p + 8, d->fault.got);
    hx_put_u64(p + 12, d->fault.clock);
}

static void put_touch(const hx_touch *touch, uint8_t *p) {
    hx_put_u64(p, touch->clock);
    hx_put_u32(p + 8, touch->x_um);
    hx_put_u32(p + 12, touch->y_um);
    hx_put_u16(p + 16, touch->normal_force_mn);
    p[18] = touch->contact;
    p[19] = touch->phase;
}

/* Write the most urgent frame if it fits; return its bytes. */
static uint32_t put_next(hx_device *d, uint8_t *bytes, uint32_t capacity) {
    uint8_t *payload = bytes + HX_HEADER_BYTES;
    if (d->capabilities_due) {
        if (HX_FRAME_OVERHEAD_BYTES + capabilities_bytes(d) > capacity) return 0;
        d->capabilities_due = 0;
        return put_frame(d, bytes, HX_CAPABILITIES, put_capabilities(d, payload));
    }
    if (d->fault_due) {
        if (HX_FRAME_OVERHEAD_BYTES + HX_FAULT_BYTES > capacity) return 0;
        d->fault_due = 0;
        hx_device_fault(d, payload);
        return put_frame(d, bytes, HX_FAULT, HX_FAULT_BYTES);
    }
    if (d->status_due) {
        if (HX_FRAME_OVERHEAD_BYTES + HX_STATUS_BYTES > capacity) return 0;
        d->status_due = 0;
        hx_device_status(d, payload);
        return put_frame(d, bytes, HX_STATUS, HX_STATUS_BYTES);
    }
    for (uint32_t i = 0; i < d->marks; i++) {
        if (!d->mark[i].is_due) continue;
        if (HX_FRAME_OVERHEAD_BYTES + HX_MARKED_BYTES > capacity) return 0;
        hx_put_u64(payload, d->mark[i].clock);
        hx_put_u32(payload + 8, d->mark[i].index);
        hx_put_u16(payload + 12, d->mark[i].code);
        hx_drop_mark(d, i);
        return put_frame(d, bytes, HX_MARKED, HX_MARKED_BYTES);
    }
    if (d->touches > 0) {
        if (HX_FRAME_OVERHEAD_BYTES + HX_TOUCH_BYTES > capacity) return 0;
        put_touch(&d->touch[0], payload);
        d->touches--;
        for (uint32_t i = 0; i < d->touches; i++) d->touch[i] = d->touch[i + 1u];
        return put_frame(d, bytes, HX_TOUCH, HX_TOUCH_BYTES);
    }
    if (d->readings > 0) {
        uint32_t n = d->readings < HX_SENSE_READINGS ? d->readings : HX_SENSE_READINGS;
        if (HX_FRAME_OVERHEAD_BYTES + n * HX_READING_BYTES > capacity) return 0;
        for (uint32_t i = 0; i < n; i++, payload += HX_READING_BYTES) {
            const hx_reading *reading = &d->reading[i];
            hx_put_u64(payload, reading->clock);
            hx_put_u32(payload + 8, (uint32_t)reading->in_phase_na);
            hx_put_u32(payload + 12, (uint32_t)reading->ahead_na);
            hx_put_u16(payload + 16, (uint16_t)reading->driven);
            hx_put_u16(payload + 18, reading->flags);
        }
        d->readings -= n;
        for (uint32_t i = 0; i < d->readings; i++) d->reading[i] = d->reading[i + n];
        return put_frame(d, bytes, HX_SENSE, n * HX_READING_BYTES);
    }
    return 0;
}

uint32_t hx_device_transmit(hx_device *d, uint8_t *bytes, uint32_t capacity) {
    uint32_t written = 0, frame;
    if (!hx_device_is_whole(d)) return 0;
    hx_look_again(d);
    while ((frame = put_next(d, bytes + written, capacity - written)) > 0) written += frame;
    hx_seal(d);
    return written;
}

static uint32_t transmit_report(hx_device *d, uint8_t *report, uint32_t capacity) {
    uint32_t size = d->config.report_bytes;
    if (size == 0 || size > capacity) return 0;
    hx_look_again(d);
    uint8_t begins = 0;
    if (d->answer_sent == d->answer_bytes) {
        d->answer_sent = 0;
        d->answer_bytes = put_next(d, d->answer, sizeof d->answer);
        if (d->answer_bytes == 0) return 0;
        begins = HX_REPORT_BEGINS;
    }
    uint32_t length = d->answer_bytes - d->answer_sent;
    if (length > size - HX_REPORT_PREFIX_BYTES) length = size - HX_REPORT_PREFIX_BYTES;
    report[0] = HX_REPORT_ID;
    report[1] = (uint8_t)(length | begins);
    for (uint32_t i = 0; i < size - HX_REPORT_PREFIX_BYTES; i++)
        report[HX_REPORT_PREFIX_BYTES + i] = i < length ? d->answer[d->answer_sent + i] : 0;
    d->answer_sent += length;
    return size;
}

uint32_t hx_device_transmit_report(hx_device *d, uint8_t *report, uint32_t capacity) {
    if (!hx_device_is_whole(d)) return 0;
    uint32_t written = transmit_report(d, report, capacity);
    hx_seal(d);
    return written;
}

int hx_device_touch(hx_device *d, const hx_touch *touch) {
    if (!hx_device_is_whole(d)) return 0;
    hx_sense_touch(d, touch->contact, touch->phase != 0);
    hx_seal(d);
    if (d->touches == HX_TOUCHES) return 0;
    d->touch[d->touches] = *touch;
    d->touch[d->touches].clock = d->clock;
    d->touches++;
    hx_seal(d);
    return 1;
}
