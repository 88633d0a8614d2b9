/* The wire format of PROTOCOL.md: constants, check sums, little-endian numbers. */
#ifndef HAPTIX_WIRE_H
#define HAPTIX_WIRE_H

#include <stdint.h>

#define HX_VERSION 4u
/* HELLO is taken in this version as well, so that a host can ask before it knows. */
#define HX_OLDEST_HELLO 3u
#define HX_HEADER_BYTES 12u
#define HX_CRC_BYTES 4u
#define HX_FRAME_OVERHEAD_BYTES (HX_HEADER_BYTES + HX_CRC_BYTES)

enum hx_kind {
    HX_HELLO = 0x01,
    HX_SETUP = 0x02,
    HX_ARM = 0x03,
    HX_STREAM = 0x04,
    HX_STOP = 0x05,
    HX_PING = 0x06,
    HX_REVISE = 0x07,
    HX_MARK = 0x08,
    HX_CAPABILITIES = 0x81,
    HX_STATUS = 0x82,
    HX_FAULT = 0x83,
    HX_TOUCH = 0x84,
    HX_MARKED = 0x85,
    HX_SENSE = 0x86
};

/* Of a reading: it was saturated, and from bit 1 on why the converter is not believed. */
#define HX_SATURATED 1u
enum hx_doubt {
    HX_BELIEVED = 0,
    HX_STUCK = 1, /* the same code over half a period */
    HX_LIES = 2,  /* a current that no load draws */
    HX_LATE = 3,  /* no samples */
    HX_DIRECT = 4 /* no carrier to measure by */
};

enum hx_mode { HX_WAVEFORM = 0, HX_ENVELOPE = 1, HX_MODES = 2 };

enum hx_state { HX_IDLE = 0, HX_ARMED = 1, HX_PLAYING = 2, HX_RAMPING = 3 };

enum hx_fault_code {
    HX_FAULT_NONE = 0,
    HX_FAULT_DAMAGED = 1,
    HX_FAULT_VERSION = 2,
    HX_FAULT_KIND = 3,
    HX_FAULT_LENGTH = 4,
    HX_FAULT_SEQUENCE = 5,
    HX_FAULT_SAMPLE_INDEX = 6,
    HX_FAULT_NOT_ARMED = 7,
    HX_FAULT_ALREADY_ARMED = 8,
    HX_FAULT_NOT_SET_UP = 9,
    HX_FAULT_SETUP = 10,
    HX_FAULT_MODE = 11,
    HX_FAULT_CEILING = 12,
    HX_FAULT_SLEW = 13,
    HX_FAULT_QUEUE_FULL = 14,
    HX_FAULT_STARVED = 15,
    HX_FAULT_TRUNCATED = 16,
    HX_FAULT_ENERGY = 17,
    HX_FAULT_MEAN = 18,
    HX_FAULT_PEAK_CURRENT = 19,
    HX_FAULT_RMS_CURRENT = 20,
    HX_FAULT_NO_CURRENT = 21,
    HX_FAULT_OVERLOAD = 22
};

#define HX_HELLO_BYTES 2u
#define HX_SETUP_BYTES 30u
#define HX_PING_BYTES 4u
#define HX_INDEX_BYTES 4u
#define HX_REVISE_HEAD_BYTES 6u
#define HX_CAPABILITIES_BYTES 80u
#define HX_GUARD_BYTES 4u
#define HX_RATE_BYTES 8u
#define HX_STATUS_BYTES 44u
#define HX_FAULT_BYTES 20u
#define HX_TOUCH_BYTES 20u
#define HX_MARK_BYTES 6u
#define HX_MARKED_BYTES 14u
#define HX_READING_BYTES 20u

#define HX_REPORT_ID 1u
#define HX_REPORT_BEGINS 0x80u
#define HX_REPORT_PREFIX_BYTES 2u

/* CRC-16, polynomial 0x1021, from 0xffff, not reflected. */
uint16_t hx_crc16(const uint8_t *bytes, uint32_t n);

/* CRC-32 of IEEE 802.3, reflected, as in zlib. */
uint32_t hx_crc32(const uint8_t *bytes, uint32_t n);

/* Here, since they are called for every sample. */
static inline uint16_t hx_get_u16(const uint8_t *bytes) {
    return (uint16_t)(bytes[0] | (uint16_t)bytes[1] << 8);
}

static inline int16_t hx_get_i16(const uint8_t *bytes) {
    int32_t value = hx_get_u16(bytes);
    return (int16_t)(value < 0x8000 ? value : value - 0x10000);
}

uint32_t hx_get_u32(const uint8_t *bytes);
void hx_put_u16(uint8_t *bytes, uint16_t value);
void hx_put_u32(uint8_t *bytes, uint32_t value);
void hx_put_u64(uint8_t *bytes, uint64_t value);

#endif
