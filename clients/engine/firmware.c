/* The firmware for a web page: one virtual driver, by numbers that JavaScript has.
 *
 * scripts/make-engine.py makes src/firmware.wasm of it. */
#include "haptix_device.h"

enum { BYTES = 4096, SAMPLES = 1024 };

static hx_device device;
static uint8_t bytes[BYTES], what[SAMPLES];
static int16_t codes[SAMPLES];

/* Begin as after a reset, with samples of a rate that goes into that of the output; 0 if it does not. */
__attribute__((export_name("begin"))) int begin(uint32_t output_rate_hz, uint32_t rate_hz)
{
    hx_config config = {
        .output_rate_hz = output_rate_hz,
        .full_scale_mv = HX_ABSOLUTE_CEILING_MV,
        .ceiling_mv = HX_ABSOLUTE_CEILING_MV,
        .max_slew_v_per_s = HX_ABSOLUTE_SLEW_V_PER_S,
        .queue_samples = HX_QUEUE_SAMPLES,
        .max_frame_samples = HX_MAX_FRAME_SAMPLES,
        .max_watchdog_ms = HX_MAX_WATCHDOG_MS,
        .rate_count = 1,
        .rates = {{rate_hz, 1}},
        .name = "virtual",
        .guard_ticks = SAMPLES, /* played at once */
    };
    return hx_device_init(&device, &config);
}

__attribute__((export_name("bytes"))) uint8_t *bytes_at(void) { return bytes; }
__attribute__((export_name("codes"))) int16_t *codes_at(void) { return codes; }

/* Take bytes that were written to `bytes`. */
__attribute__((export_name("receive"))) void receive(uint32_t n)
{
    hx_device_receive(&device, bytes, n);
}

/* Write an answer to `bytes`; its length, 0 if there is none. */
__attribute__((export_name("transmit"))) uint32_t transmit(void)
{
    return hx_device_transmit(&device, bytes, BYTES);
}

/* Play samples into `codes`. */
__attribute__((export_name("play"))) void play(uint32_t n)
{
    hx_device_play(&device, codes, what, n < SAMPLES ? n : SAMPLES);
}
