/* Frames out of bytes and reports, and what is no frame. */
#include "haptix_internal.h"

static void drop(hx_device *d, uint32_t n) {
    d->received -= n;
    for (uint32_t i = 0; i < d->received; i++) d->buffer[i] = d->buffer[i + n];
}

/* Bytes that the frame at the start of the buffer has, or is believed to have so far. */
static uint32_t bytes_due(const hx_device *d) {
    if (d->received < HX_HEADER_BYTES) return HX_FRAME_OVERHEAD_BYTES;
    return HX_FRAME_OVERHEAD_BYTES + hx_get_u16(d->buffer + 6);
}

/* Whether a header may be believed; a damaged length must not swallow the frames behind it. */
static int is_header(hx_device *d) {
    uint16_t due = hx_crc16(d->buffer, HX_HEADER_BYTES - 2u);
    uint16_t carried = hx_get_u16(d->buffer + HX_HEADER_BYTES - 2u);
    uint16_t sequence = hx_get_u16(d->buffer + 4);
    uint32_t length = hx_get_u16(d->buffer + 6);
    if (carried != due) {
        hx_meet_damage(d, 0, due, carried);
        return 0;
    }
    if (d->buffer[2] != HX_VERSION) {
        hx_refuse(d, HX_FAULT_VERSION, 0, sequence, HX_VERSION, d->buffer[2]);
        return 0;
    }
    if (length > hx_longest_payload(d)) {
        hx_refuse(d, HX_FAULT_LENGTH, 0, sequence, hx_longest_payload(d), length);
        return 0;
    }
    return 1;
}

/* Take every whole frame out of the buffer, and every byte that belongs to none. */
static void take_frames(hx_device *d) {
    uint32_t loose = 0; /* bytes to drop, once and not one by one */
    while (d->received > loose) {
        if (d->buffer[loose] != 'H' || (d->received > loose + 1u && d->buffer[loose + 1u] != 'X')) {
            hx_meet_damage(d, 0, 0, 0);
            loose++;
            continue;
        }
        if (loose > 0) {
            drop(d, loose);
            loose = 0;
        }
        if (d->received < HX_HEADER_BYTES) return;
        if (!is_header(d)) {
            loose = 1;
            continue;
        }
        uint32_t due = bytes_due(d);
        if (d->received < due) return;
        uint32_t crc = hx_crc32(d->buffer, due - HX_CRC_BYTES);
        uint32_t carried = hx_get_u32(d->buffer + due - HX_CRC_BYTES);
        if (crc == carried) {
            hx_take_frame(d);
            drop(d, due);
        } else {
            hx_meet_damage(d, hx_get_u16(d->buffer + 4), crc, carried);
            loose = 1;
        }
    }
    drop(d, loose);
}

void hx_device_receive(hx_device *d, const uint8_t *bytes, uint32_t n) {
    if (n > 0) d->pause_ticks = 0;
    while (n > 0) {
        /* No further than the next decision, so that a whole frame stands at the start. */
        uint32_t due = d->received < HX_HEADER_BYTES ? HX_HEADER_BYTES : bytes_due(d);
        uint32_t piece = due - d->received;
        if (piece > n) piece = n;
        for (uint32_t i = 0; i < piece; i++) d->buffer[d->received + i] = bytes[i];
        d->received += piece;
        bytes += piece;
        n -= piece;
        take_frames(d);
    }
}

void hx_device_receive_report(hx_device *d, const uint8_t *report, uint32_t n) {
    uint32_t length = n < HX_REPORT_PREFIX_BYTES ? 0u : report[1] & ~HX_REPORT_BEGINS;
    if (n < HX_REPORT_PREFIX_BYTES || report[0] != HX_REPORT_ID ||
        length > n - HX_REPORT_PREFIX_BYTES) {
        hx_meet_damage(d, 0, 0, 0);
        return;
    }
    if ((report[1] & HX_REPORT_BEGINS) && d->received > 0) {
        if (d->is_armed) hx_refuse(d, HX_FAULT_TRUNCATED, 0, 0, bytes_due(d), d->received);
        d->received = 0;
    }
    hx_device_receive(d, report + HX_REPORT_PREFIX_BYTES, length);
}

void hx_give_up_frame(hx_device *d) {
    if (d->is_armed) hx_refuse(d, HX_FAULT_TRUNCATED, 0, 0, bytes_due(d), d->received);
    d->pause_ticks = 0;
    drop(d, 1);
    take_frames(d);
}
