#include "haptix_wire.h"

/* Tables of 16 entries, small enough for any flash: of the half byte that is shifted out last, and
 * of the one before it. */
static const uint16_t crc16_of_nibble[2][16] = {
    {0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50a5, 0x60c6, 0x70e7,
     0x8108, 0x9129, 0xa14a, 0xb16b, 0xc18c, 0xd1ad, 0xe1ce, 0xf1ef},
    {0x0000, 0x1231, 0x2462, 0x3653, 0x48c4, 0x5af5, 0x6ca6, 0x7e97,
     0x9188, 0x83b9, 0xb5ea, 0xa7db, 0xd94c, 0xcb7d, 0xfd2e, 0xef1f}};

static const uint32_t crc32_of_nibble[2][16] = {
    {0x00000000, 0x1db71064, 0x3b6e20c8, 0x26d930ac, 0x76dc4190, 0x6b6b51f4, 0x4db26158, 0x5005713c,
     0xedb88320, 0xf00f9344, 0xd6d6a3e8, 0xcb61b38c, 0x9b64c2b0, 0x86d3d2d4, 0xa00ae278, 0xbdbdf21c},
    {0x00000000, 0x77073096, 0xee0e612c, 0x990951ba, 0x076dc419, 0x706af48f, 0xe963a535, 0x9e6495a3,
     0x0edb8832, 0x79dcb8a4, 0xe0d5e91e, 0x97d2d988, 0x09b64c2b, 0x7eb17cbd, 0xe7b82d07, 0x90bf1d91}};

uint16_t hx_crc16(const uint8_t *bytes, uint32_t n) {
    uint32_t crc = 0xffff;
    for (uint32_t i = 0; i < n; i++) {
        crc ^= (uint32_t)bytes[i] << 8;
        crc = (crc << 8 & 0xffffu) ^ crc16_of_nibble[1][crc >> 12] ^
              crc16_of_nibble[0][crc >> 8 & 15u];
    }
    return (uint16_t)crc;
}

uint32_t hx_crc32(const uint8_t *bytes, uint32_t n) {
    uint32_t crc = 0xffffffff;
    for (uint32_t i = 0; i < n; i++) {
        crc ^= bytes[i];
        crc = crc >> 8 ^ crc32_of_nibble[1][crc & 15u] ^ crc32_of_nibble[0][crc >> 4 & 15u];
    }
    return crc ^ 0xffffffff;
}

uint32_t hx_get_u32(const uint8_t *bytes) {
    return hx_get_u16(bytes) | (uint32_t)hx_get_u16(bytes + 2) << 16;
}

void hx_put_u16(uint8_t *bytes, uint16_t value) {
    bytes[0] = (uint8_t)value;
    bytes[1] = (uint8_t)(value >> 8);
}

void hx_put_u32(uint8_t *bytes, uint32_t value) {
    hx_put_u16(bytes, (uint16_t)value);
    hx_put_u16(bytes + 2, (uint16_t)(value >> 16));
}

void hx_put_u64(uint8_t *bytes, uint64_t value) {
    hx_put_u32(bytes, (uint32_t)value);
    hx_put_u32(bytes + 4, (uint32_t)(value >> 32));
}
