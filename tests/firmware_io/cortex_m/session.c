/* A golden session on a Cortex-M3 that qemu emulates (mps2-an385), judged by the program itself. */
#include "haptix_device.h"
#include "startup.h"
#include "session.h" /* written by the test: config, steps, count of steps */

static hx_device device;

static int16_t out[1024];

static int is_played(const step *s) {
    hx_device_play(&device, out, 0, s->count);
    for (uint32_t i = 0; i < s->count; i++)
        if (out[i] != s->codes[i]) return 0;
    return 1;
}

static int is_answered(const step *s) {
    static uint8_t bytes[512];
    if (hx_device_transmit(&device, bytes, sizeof bytes) != s->count) return 0;
    for (uint32_t i = 0; i < s->count; i++)
        if (bytes[i] != s->bytes[i]) return 0;
    return 1;
}

void board_main(void) {
    if (!hx_device_init(&device, &config)) leave("the configuration is refused\n", 0);
    for (uint32_t i = 0; i < count_of_steps; i++) {
        const step *s = &steps[i];
        switch (s->kind) {
        case RECEIVE: hx_device_receive(&device, s->bytes, s->count); break;
        case REPORT: hx_device_receive_report(&device, s->bytes, s->count); break;
        case SENSE: hx_device_sense(&device, out, s->codes, s->count, 0); break;
        case TRANSMIT:
            if (!is_answered(s)) leave("another answer\n", 0);
            break;
        default:
            if (!is_played(s)) leave("other samples\n", 0);
        }
    }
    leave("as golden\n", 1);
}
