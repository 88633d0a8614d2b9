/* What the window does for each output sample: here, so that it is inlined where they are played. */
#ifndef HAPTIX_WINDOW_H
#define HAPTIX_WINDOW_H

#include "haptix_device.h"

/* The window of energy and mean begins with 0 V. */
void hx_window_init(hx_device *device);

/* Put the block under way, which is full, in the place of the oldest. */
void hx_window_close_block(hx_device *device);

/* Whether an output sample, of a level, would break a limit behind a block under way. */
static inline enum hx_fault_code hx_window_check(const hx_device *d, const hx_block *now,
                                                 uint64_t energy_now, int32_t level,
                                                 int32_t code) {
    uint32_t size = (uint32_t)(level < 0 ? -level : level);
    uint64_t energy = d->energy_before + energy_now + (uint32_t)(code * code);
    if (energy + (uint64_t)(size * size) * d->ramp_energy > d->max_energy) return HX_FAULT_ENERGY;

    int64_t high = now->high + code, low = now->low + code;
    if (high < now->sum + code + d->high_before) high = now->sum + code + d->high_before;
    if (low > now->sum + code + d->low_before) low = now->sum + code + d->low_before;
    if (d->has_carrier) {
        /* No stretch of a falling envelope sums to more than half a turn at its highest. */
        uint32_t half_turn = size * d->half_turn_ticks;
        high += half_turn;
        low -= half_turn;
    } else {
        uint32_t ramp = size * (d->ramp_ticks - 1u) / 2u;
        if (level > 0) high += ramp;
        else low -= ramp;
    }
    return high > d->max_sum || -low > d->max_sum ? HX_FAULT_MEAN : HX_FAULT_NONE;
}

/* Count an output sample in a block that is not full. */
static inline void hx_window_take(hx_block *now, uint64_t *energy_now, int32_t code) {
    now->sum += code;
    now->high += code;
    now->low += code;
    if (now->high < 0) now->high = 0;
    if (now->low > 0) now->low = 0;
    *energy_now += (uint32_t)(code * code);
}

#endif
