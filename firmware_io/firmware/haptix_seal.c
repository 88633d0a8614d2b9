/* Memory that goes bad between calls: a seal over all that decides what leaves.
 *
 * Every call of the core begins by looking at the seal and ends by making it anew, so that no bit
 * that has changed in between is used. A core that is not whole goes to 0 V, from the last output
 * sample that two of three copies agree on, within the slew, and does nothing else until it is
 * initialised. The blocks of the window have a seal of their own, looked at whenever they are read.
 * Left without one are samples, which the limiter bounds, bytes received, which their check sums
 * guard, and what is told of touches and marks.
 */
#include <stddef.h>

#include "haptix_internal.h"

#ifdef __GNUC__
typedef uint32_t __attribute__((may_alias)) word;
#else
typedef uint32_t word;
#endif

/* One bit always changes it, and several but once in 2^32: each step is one to one, and spreads. */
static uint32_t seal_of(const hx_device *d) {
    const word *from = (const word *)d, *to = (const word *)(const void *)d->blocks;
    uint32_t seal = 1u; /* so that empty memory is not whole */
    for (; from < to; from++) seal = ((seal << 5 | seal >> 27) ^ *from) * 0x9e3779b1u;
    return seal;
}

int hx_device_is_whole(const hx_device *d) { return !d->is_lost && seal_of(d) == d->seal; }

void hx_seal(hx_device *d) { d->seal = seal_of(d); }

void hx_keep_way_out(hx_device *d) {
    uint32_t step = (uint32_t)d->step_codes_now;
    d->way_out[0] = d->way_out[1] = d->way_out[2] = (uint16_t)d->code | step << 16;
}

static uint32_t way_out(const hx_device *d) {
    uint32_t a = d->way_out[0], b = d->way_out[1], c = d->way_out[2];
    return (a & b) | (b & c) | (c & a);
}

void hx_play_way_out(hx_device *d, int16_t *out, uint8_t *what, uint32_t n) {
    uint32_t kept = way_out(d);
    int32_t code = (int16_t)(uint16_t)kept, step = (int32_t)(kept >> 16);
    for (uint32_t i = 0; i < n; i++) {
        if (what != NULL) what[i] = code != 0 ? HX_OUT_RAMP : HX_OUT_IDLE;
        code = code > step ? code - step : code < -step ? code + step : 0;
        out[i] = (int16_t)code;
    }
    d->way_out[0] = d->way_out[1] = d->way_out[2] = (uint16_t)code | (uint32_t)step << 16;
}

uint32_t hx_way_out_ticks(const hx_device *d) {
    uint32_t kept = way_out(d), step = kept >> 16;
    int32_t code = (int16_t)(uint16_t)kept;
    uint32_t size = (uint32_t)(code < 0 ? -code : code);
    return step > 0 ? (size + step - 1u) / step : size > 0;
}
