/* The last second of the output: its energy and its mean, in whole numbers.
 *
 * The second is kept in HX_WINDOW_BLOCKS blocks. The energy counts the whole blocks and the one
 * under way, which is a second and up to one block more. The mean counts every stretch up to that
 * long that ends now, because what came before such a stretch leaves the window later. Both leave
 * room for the safety ramp, so that a ramp can begin at any sample.
 */
#include "haptix_internal.h"

void hx_window_init(hx_device *d) {
    uint64_t rate_hz = d->config.output_rate_hz;
    uint64_t rms = (uint64_t)HX_MAX_RMS_MV * 32767u * 256u / d->config.full_scale_mv;
    if (rms > 32767u * 256u) rms = 32767u * 256u; /* in 1/256 of a code */
    d->block_ticks = (uint32_t)((rate_hz + HX_WINDOW_BLOCKS - 1u) / HX_WINDOW_BLOCKS);
    d->max_energy = (rms * rms >> 16) * (rate_hz + 2u * d->block_ticks);
    d->ramp_energy = d->ramp_ticks / 3u + 1u;
    d->max_sum = (int64_t)((uint64_t)d->top_code * rate_hz / HX_MEAN_DIVISOR);
}

enum hx_fault_code hx_window_check(const hx_device *d, int16_t code) {
    const hx_block *now = &d->block;
    uint32_t size = (uint32_t)(d->level < 0 ? -(int32_t)d->level : d->level);
    uint64_t energy = d->energy_before + d->energy_now + (uint32_t)((int32_t)code * code);
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
        if (d->level > 0) high += ramp;
        else low -= ramp;
    }
    return high > d->max_sum || -low > d->max_sum ? HX_FAULT_MEAN : HX_FAULT_NONE;
}

static void close_block(hx_device *d) {
    hx_block *oldest = &d->blocks[d->block_at];
    int64_t sum = 0;
    d->energy_before -= (uint64_t)oldest->energy << HX_ENERGY_SHIFT;
    *oldest = d->block;
    /* Rounded up: the window is never underrated. */
    oldest->energy = (uint32_t)((d->energy_now + (1u << HX_ENERGY_SHIFT) - 1u) >> HX_ENERGY_SHIFT);
    d->energy_before += (uint64_t)oldest->energy << HX_ENERGY_SHIFT;
    d->energy_now = 0;
    d->block.sum = d->block.high = d->block.low = 0;
    d->block_tick = 0;

    d->high_before = d->low_before = 0;
    for (uint32_t i = 0, at = d->block_at; i < HX_WINDOW_BLOCKS; i++) {
        const hx_block *block = &d->blocks[at];
        if (sum + block->high > d->high_before) d->high_before = sum + block->high;
        if (sum + block->low < d->low_before) d->low_before = sum + block->low;
        sum += block->sum;
        at = at == 0 ? HX_WINDOW_BLOCKS - 1u : at - 1u;
    }
    d->block_at = d->block_at + 1u == HX_WINDOW_BLOCKS ? 0u : d->block_at + 1u;
}

void hx_window_take(hx_device *d, int16_t code) {
    hx_block *now = &d->block;
    now->sum += code;
    now->high += code;
    now->low += code;
    if (now->high < 0) now->high = 0;
    if (now->low > 0) now->low = 0;
    d->energy_now += (uint32_t)((int32_t)code * code);
    if (++d->block_tick >= d->block_ticks) close_block(d);
}
