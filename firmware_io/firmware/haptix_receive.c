/* Frames out of bytes and reports, and what is no frame.
 *
 * Bytes that were made to look like frames within frames could be checked again and again. So
 * each byte that comes buys a few units of work, a check sum or a move costs one for each byte,
 * and when they run out, what is held is thrown away.
 */
#include "haptix_internal.h"

static int spend(hx_device *d, uint32_t n) {
    if (d->work < n) {
        d->work = 0;
        return 0;
    }
    d->work -= n;
    return 1;
}

/* Bytes that the frame at the start of the buffer has, or is believed to have so far. */
static uint32_t bytes_due(const hx_device *d) {
    return d->awaited > 0 ? d->awaited : HX_FRAME_OVERHEAD_BYTES;
}

/* Whether a header may be believed; a damaged length must not swallow the frames behind it. */
static int is_header(hx_device *d, const uint8_t *bytes) {
    uint16_t due = hx_crc16(bytes, HX_HEADER_BYTES - 2u);
    uint16_t carried = hx_get_u16(bytes + HX_HEADER_BYTES - 2u);
    uint16_t sequence = hx_get_u16(bytes + 4);
    uint32_t length = hx_get_u16(bytes + 6);
    if (carried != due) {
        hx_meet_damage(d, 0, due, carried);
        return 0;
    }
    if (bytes[2] != HX_VERSION &&
        (bytes[3] != HX_HELLO || bytes[2] < HX_OLDEST_HELLO || bytes[2] > HX_VERSION)) {
        hx_refuse(d, HX_FAULT_VERSION, 0, sequence, HX_VERSION, bytes[2]);
        return 0;
    }
    if (length > hx_longest_payload(d)) {
        hx_refuse(d, HX_FAULT_LENGTH, 0, sequence, hx_longest_payload(d), length);
        return 0;
    }
    return 1;
}

/* Take the frame at these bytes, or find that none begins here; return the bytes to drop. Of a
 * header that was checked, what it announced counts, and not the bytes that have stood here since. */
static uint32_t take_one(hx_device *d, const uint8_t *bytes, uint32_t n, uint32_t due) {
    if (bytes[0] != 'H' || (n > 1u && bytes[1] != 'X')) {
        hx_meet_damage(d, 0, 0, 0);
        return 1;
    }
    if (n < HX_HEADER_BYTES) return 0;
    if (due == 0) {
        if (!spend(d, HX_HEADER_BYTES)) return n;
        if (!is_header(d, bytes)) return 1;
        due = HX_FRAME_OVERHEAD_BYTES + hx_get_u16(bytes + 6);
    }
    if (n < due) {
        d->awaited = due;
        return 0;
    }
    if (!spend(d, due)) return n;
    uint32_t crc = hx_crc32(bytes, due - HX_CRC_BYTES);
    uint32_t carried = hx_get_u32(bytes + due - HX_CRC_BYTES);
    if (crc == carried) {
        hx_take_frame(d, bytes);
        return due;
    }
    hx_meet_damage(d, hx_get_u16(bytes + 4), crc, carried);
    return 1;
}

/* Take every whole frame out of the buffer, and every byte that belongs to none. */
static void take_frames(hx_device *d) {
    uint32_t first = 0, taken = 1, due = d->awaited;
    d->awaited = 0;
    while (d->received > first && taken > 0) {
        taken = take_one(d, d->buffer + first, d->received - first, due);
        first += taken;
        due = 0;
    }
    if (first == 0) return;
    uint32_t rest = d->received - first;
    d->received = 0;
    if (!spend(d, rest)) {
        d->awaited = 0;
        return;
    }
    for (uint32_t i = 0; i < rest; i++) d->buffer[i] = d->buffer[first + i];
    d->received = rest;
}

static void receive(hx_device *d, const uint8_t *bytes, uint32_t n) {
    uint32_t most = hx_most_work(d);
    hx_look_again(d);
    if (n > 0) d->pause_ticks = 0;
    while (n > 0) {
        /* No further than the next decision, so that a whole frame stands at the start. */
        uint32_t due = d->received < HX_HEADER_BYTES ? HX_HEADER_BYTES : bytes_due(d);
        uint32_t piece = due - d->received;
        if (piece > n) piece = n;
        uint8_t *rest = d->buffer + d->received;
        for (uint32_t i = 0; i < piece; i++) rest[i] = bytes[i];
        d->received += piece;
        d->work += piece * HX_WORK_PER_BYTE;
        if (d->work > most) d->work = most;
        bytes += piece;
        n -= piece;
        if (d->received >= d->awaited) take_frames(d);
    }
}

void hx_device_receive(hx_device *d, const uint8_t *bytes, uint32_t n) {
    if (!hx_device_is_whole(d)) return;
    receive(d, bytes, n);
    hx_seal(d);
}

static void receive_report(hx_device *d, const uint8_t *report, uint32_t n) {
    uint32_t length = n < HX_REPORT_PREFIX_BYTES ? 0u : report[1] & ~HX_REPORT_BEGINS;
    hx_look_again(d);
    if (n < HX_REPORT_PREFIX_BYTES || report[0] != HX_REPORT_ID ||
        length > n - HX_REPORT_PREFIX_BYTES) {
        hx_meet_damage(d, 0, 0, 0);
        return;
    }
    if ((report[1] & HX_REPORT_BEGINS) && d->received > 0) {
        if (d->is_armed) hx_refuse(d, HX_FAULT_TRUNCATED, 0, 0, bytes_due(d), d->received);
        d->received = 0;
        d->awaited = 0;
    }
    receive(d, report + HX_REPORT_PREFIX_BYTES, length);
}

void hx_device_receive_report(hx_device *d, const uint8_t *report, uint32_t n) {
    if (!hx_device_is_whole(d)) return;
    receive_report(d, report, n);
    hx_seal(d);
}

void hx_meet_pause(hx_device *d) {
    if (d->is_armed) hx_refuse(d, HX_FAULT_TRUNCATED, 0, 0, bytes_due(d), d->received);
    d->pause_ticks = 0;
    d->has_paused = 1;
}

void hx_look_again(hx_device *d) {
    if (!d->has_paused) return;
    d->has_paused = 0;
    d->awaited = 0;
    d->received--;
    for (uint32_t i = 0; i < d->received; i++) d->buffer[i] = d->buffer[i + 1u];
    take_frames(d);
}
