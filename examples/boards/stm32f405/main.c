/* The loop of the board: bytes in, answers out. Everything timed happens in output.c. */
#include "board.h"
#include "registers.h"

/* Bytes handed to the core at once: bounds how long the output's interrupt is kept out. */
#define PIECE_BYTES 32u

static hx_config config = {
    .output_rate_hz = BOARD_OUTPUT_HZ,
    .full_scale_mv = 200000u, /* of the amplifier at code 32767: measure it, then write it here */
    .ceiling_mv = 200000u,
    .max_slew_v_per_s = 4666666u, /* 0.7 mA through 150 pF: less for an earthed person */
    .queue_samples = HX_QUEUE_SAMPLES,
    .max_frame_samples = HX_MAX_FRAME_SAMPLES,
    .max_watchdog_ms = HX_MAX_WATCHDOG_MS,
    .report_bytes = 0,
    .flags = 2, /* takes marks */
    .rate_count = 4,
    .rates = {{BOARD_OUTPUT_HZ, 3u},
              {BOARD_OUTPUT_HZ / 2u, 3u},
              {BOARD_OUTPUT_HZ / 4u, 3u},
              {BOARD_OUTPUT_HZ / 8u, 3u}},
    .name = "stm32f405",
    .serial = "0",
    .calibration_id = "",
    .guard_ticks = BOARD_HALF_SAMPLES, /* what the interrupt plays at once */
};

static void receive(void) {
    uint8_t bytes[PIECE_BYTES];
    uint32_t n = board_serial_read(bytes, sizeof bytes);
    if (n == 0) return;
    board_output_mask();
    hx_device_receive(&board_device, bytes, n);
    board_output_unmask();
}

static void transmit(void) {
    static uint8_t answer[HX_ANSWER_BYTES];
    static uint32_t length, sent;
    if (sent == length) {
        sent = 0;
        board_output_mask();
        length = hx_device_transmit(&board_device, answer, sizeof answer);
        board_output_unmask();
    }
    while (sent < length && board_serial_write(answer[sent])) sent++;
}

/* A reset may have come amid a playback, whose second of energy and mean is forgotten: 0 V for one. */
static void hold_a_second(void) {
    uint32_t played = 0;
    while (played < BOARD_OUTPUT_HZ) {
        board_output_mask();
        played = (uint32_t)board_device.clock;
        board_output_unmask();
        board_output_loop_ran();
        board_serial_wait();
    }
}

extern const uint8_t image_begin[];
extern const uint32_t image_crc;
__attribute__((section(".crc"), used)) static const uint32_t space_for_crc = 0;

/* What reset the board, after its watchdog has shown that it can: 1 power, 2 the watchdog. */
static uint32_t reset_cause(void) {
#ifdef BOARD_EMULATED
    return 0; /* the emulator has no watchdog */
#else
    static uint32_t proving __attribute__((section(".noinit")));
    uint32_t is_by_watchdog = RCC_CSR >> 29 & 1u, is_shown = proving == 0x50524f56u;
    RCC_CSR |= 1u << 24;
    proving = is_by_watchdog ? 0 : 0x50524f56u;
    if (!is_by_watchdog) board_output_prove_watchdog();
    return is_shown ? 1u : 2u;
#endif
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
    board_serial_begin();
    for (;;) {
        receive();
        transmit();
        board_output_loop_ran();
        board_serial_wait();
    }
}
