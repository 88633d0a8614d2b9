/* The loop of the board: bytes in, answers out. Everything timed happens in output.c. */
#include "board.h"
#include "../usb/hx_usb.h"
#include "registers.h"

/* Bytes handed to the core at once: bounds how long the output's interrupt is kept out. */
#define PIECE_BYTES 32u

static hx_config config = {
    .output_rate_hz = BOARD_OUTPUT_HZ,
    .full_scale_mv = 200000u, /* of the amplifier at code 32767: `haptix firmware --full-scale-v` replaces it */
    .ceiling_mv = 200000u,
    .max_slew_v_per_s = 4666666u, /* 0.7 mA through 150 pF: less for an earthed person */
    .queue_samples = HX_QUEUE_SAMPLES,
    .max_frame_samples = HX_MAX_FRAME_SAMPLES,
    .max_watchdog_ms = HX_MAX_WATCHDOG_MS,
    .report_bytes = 64,
    .flags = HX_TAKES_MARK,
    .rate_count = 4,
    .rates = {{BOARD_OUTPUT_HZ, 3u},
              {BOARD_OUTPUT_HZ / 2u, 3u},
              {BOARD_OUTPUT_HZ / 4u, 3u},
              {BOARD_OUTPUT_HZ / 8u, 3u}},
    .name = BOARD_NAME,
    .serial = "serial-not-set", /* `haptix firmware pico --serial` replaces these 16 bytes */
    .calibration_id = "",
    .guard_ticks = 2u * BOARD_HALF_SAMPLES, /* what the interrupt plays at once, and the half on its way */
};

void hx_usb_receive(const uint8_t *bytes, uint32_t n) {
    for (uint32_t at = 0; at < n; at += PIECE_BYTES) {
        board_output_mask();
        hx_device_receive(&board_device, bytes + at, n - at < PIECE_BYTES ? n - at : PIECE_BYTES);
        board_output_unmask();
    }
}

void hx_usb_receive_report(const uint8_t *report, uint32_t n) {
    board_output_mask();
    hx_device_receive_report(&board_device, report, n);
    board_output_unmask();
}

/* At most a packet: the core writes whole frames, which are longer. */
uint32_t hx_usb_transmit(uint8_t *bytes, uint32_t capacity) {
    static uint8_t answer[HX_ANSWER_BYTES];
    static uint32_t length, sent;
    if (sent == length) {
        sent = 0;
        board_output_mask();
        length = hx_device_transmit(&board_device, answer, sizeof answer);
        board_output_unmask();
    }
    uint32_t n = 0;
    while (n < capacity && sent < length) bytes[n++] = answer[sent++];
    return n;
}

uint32_t hx_usb_transmit_report(uint8_t *report, uint32_t capacity) {
    board_output_mask();
    uint32_t n = hx_device_transmit_report(&board_device, report, capacity);
    board_output_unmask();
    return n;
}

void hx_usb_release(void) {
    board_output_mask();
    hx_device_release(&board_device);
    board_output_unmask();
}

const char *hx_usb_serial_number(void) { return config.serial; }

/* A reset may have come amid a playback, whose second of energy and mean is forgotten: 0 V for one. */
static void hold_a_second(void) {
    uint32_t played = 0;
    while (played < BOARD_OUTPUT_HZ) {
        board_output_mask();
        played = (uint32_t)board_device.clock;
        board_output_unmask();
        board_output_loop_ran();
    }
}

extern const uint8_t image_begin[];
extern const uint32_t image_crc;
__attribute__((section(".crc"), used)) static const uint32_t space_for_crc = 0;

/* What reset the board, after its watchdog has shown that it can: 1 power, 2 the watchdog. */
static uint32_t reset_cause(void) {
    const uint32_t proof = 0x50524f56u;
    uint32_t is_by_watchdog = WATCHDOG->REASON & 1u, is_shown = WATCHDOG->SCRATCH[0] == proof;
    WATCHDOG->SCRATCH[0] = is_by_watchdog ? 0 : proof;
    if (!is_by_watchdog) board_output_prove_watchdog();
    return is_shown ? 1u : 2u;
}

/* With the amplifier still disabled: the program, the core's memory, its limits. */
static int is_well(void) {
    uint32_t bytes = (uint32_t)((const uint8_t *)&image_crc - image_begin);
    return hx_crc32(image_begin, bytes) == image_crc &&
           hx_test_memory(&board_device, sizeof board_device) &&
           hx_test_limits(&board_device, &config) == 0;
}

int main(void) {
    uint32_t cause = reset_cause();
    if (!is_well()) return 1; /* the output was never switched on */
    config.flags = (uint16_t)(config.flags | HX_TESTED | cause << HX_RESET_SHIFT);
    if (!hx_device_init(&board_device, &config)) return 1; /* the output was never switched on */
    board_output_begin();
    hold_a_second();
    board_usb_begin();
    for (;;) {
        hx_usb_task();
        board_output_loop_ran();
        board_usb_wait();
    }
}
