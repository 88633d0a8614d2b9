/* The last second of the output: its energy and its mean, in whole numbers.
 *
 * The second is kept in HX_WINDOW_BLOCKS blocks. The energy counts the whole blocks and the one
 * under way, which is a second and up to one block more. The mean counts every stretch up to that
 * long that ends now, because what came before such a stretch leaves the window later. Both leave
 * room for the safety ramp, so that a ramp can begin at any sample.
 */
#include "haptix_window.h"

void hx_window_init(hx_device *d) {
    uint64_t rate_hz = d->config.output_rate_hz;
    uint64_t rms = (uint64_t)HX_MAX_RMS_MV * 32767u * 256u / d->config.full_scale_mv;
    if (rms > 32767u * 256u) rms = 32767u * 256u; /* in 1/256 of a code */
    d->block_ticks = (uint32_t)((rate_hz + HX_WINDOW_BLOCKS - 1u) / HX_WINDOW_BLOCKS);
    d->max_energy = (rms * rms >> 16) * (rate_hz + 2u * d->block_ticks);
    d->ramp_energy = d->ramp_ticks / 3u + 1u;
    d->max_sum = (int64_t)((uint64_t)d->top_code * rate_hz / HX_MEAN_DIVISOR);
}

void hx_window_close_block(hx_device *d) {
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
