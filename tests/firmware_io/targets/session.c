/* A golden session on another processor, judged by the program itself. */
#include "haptix_device.h"
#include "target.h"  /* board_main is called; leave() ends with a text */
#include "session.h" /* written by the test: config, steps, count of steps */

static hx_device device;

static int16_t out[1024], codes[1024];
static uint8_t bytes[1024];

static int is_played(const FAR step *s) {
    hx_device_play(&device, out, 0, s->count);
    for (uint32_t i = 0; i < s->count; i++)
        if (out[i] != s->codes[i]) return 0;
    return 1;
}

static int is_answered(const FAR step *s) {
    if (hx_device_transmit(&device, bytes, 512) != s->count) return 0;
    for (uint32_t i = 0; i < s->count; i++)
        if (bytes[i] != s->bytes[i]) return 0;
    return 1;
}

/* What arrives, from memory that the core may not be able to address. */
static const uint8_t *arrived(const FAR step *s) {
    for (uint32_t i = 0; i < s->count; i++) bytes[i] = s->bytes[i];
    return bytes;
}

static const int16_t *measured(const FAR step *s) {
    for (uint32_t i = 0; i < s->count; i++) codes[i] = s->codes[i];
    return codes;
}

void board_main(void) {
    hx_config board = config;
    if (!hx_device_init(&device, &board)) leave("the configuration is refused\n", 0);
    for (uint32_t i = 0; i < count_of_steps; i++) {
        const FAR step *s = &steps[i];
        switch (s->kind) {
        case RECEIVE: hx_device_receive(&device, arrived(s), s->count); break;
        case REPORT: hx_device_receive_report(&device, arrived(s), s->count); break;
        case SENSE: hx_device_sense(&device, out, measured(s), s->count, 0); break;
        case TRANSMIT:
            if (!is_answered(s)) leave("another answer\n", 0);
            break;
        default:
            if (!is_played(s)) leave("other samples\n", 0);
        }
    }
    leave("as golden\n", 1);
}
