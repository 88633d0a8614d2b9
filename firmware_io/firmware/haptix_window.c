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
    if (rms > 32767u * (uint64_t)256u) rms = 32767u * (uint64_t)256u; /* in 1/256 of a code */
    d->block_ticks = (uint32_t)((rate_hz + HX_WINDOW_BLOCKS - 1u) / HX_WINDOW_BLOCKS);
    d->max_energy = (rms * rms >> 16) * (rate_hz + 2u * d->block_ticks);
    d->ramp_energy = d->ramp_ticks / 3u + 1u;
    d->max_sum = (int64_t)((uint64_t)d->top_code * rate_hz / HX_MEAN_DIVISOR);
}

/*@ requires \valid_read(block);
  @ assigns \nothing; */
static uint32_t block_seal(const hx_block *block) {
    return (uint32_t)block->sum ^ (uint32_t)block->high ^ (uint32_t)block->low ^ block->energy;
}

/* What the whole blocks add up to, of which one is the newest; whether none of them went bad. */
/*@ requires \valid(d) && newest < HX_WINDOW_BLOCKS;
  @ assigns d->energy_before, d->high_before, d->low_before, d->is_lost;
  @ ensures d->energy_before <= 0x8000000000000;
  @ ensures -0x8000000000 <= d->low_before <= 0 <= d->high_before <= 0x8000000000;
  @*/
static void look_back(hx_device *d, uint32_t newest) {
    uint64_t energy = 0;
    int64_t sum = 0, high = 0, low = 0;
    uint32_t seal = d->blocks_seal;
    /*@ loop invariant i <= HX_WINDOW_BLOCKS && at < HX_WINDOW_BLOCKS;
      @ loop invariant energy <= i * 0xffffffff000;
      @ loop invariant -0x80000000 * i <= sum <= 0x80000000 * i;
      @ loop invariant -0x80000000 * i <= low <= 0 <= high <= 0x80000000 * i;
      @ loop assigns i, at, energy, sum, high, low, seal;
      @ loop variant HX_WINDOW_BLOCKS - i;
      @*/
    for (uint32_t i = 0, at = newest; i < HX_WINDOW_BLOCKS; i++) {
        const hx_block *block = &d->blocks[at];
        if (sum + block->high > high) high = sum + block->high;
        if (sum + block->low < low) low = sum + block->low;
        //@ assert \forall integer s; bounds(block, s) ==> low <= sum + s <= high;
        sum += block->sum;
        energy += (uint64_t)block->energy * HX_ENERGY_UNIT;
        seal ^= block_seal(block);
        at = at == 0 ? HX_WINDOW_BLOCKS - 1u : at - 1u;
    }
    if (seal != 0) d->is_lost = 1;
    d->energy_before = energy;
    d->high_before = high;
    d->low_before = low;
}

void hx_window_close_block(hx_device *d) {
    hx_block *oldest = &d->blocks[d->block_at];
    d->blocks_seal ^= block_seal(oldest);
    oldest->sum = d->block.sum;
    oldest->high = d->block.high;
    oldest->low = d->block.low;
    /* Rounded up: the window is never underrated. */
    oldest->energy = (uint32_t)((d->energy_now + HX_ENERGY_UNIT - 1u) / HX_ENERGY_UNIT);
    d->blocks_seal ^= block_seal(oldest);
    look_back(d, d->block_at);
    d->energy_now = 0;
    d->block.sum = d->block.high = d->block.low = 0;
    d->block_tick = 0;
    d->block_at = d->block_at + 1u == HX_WINDOW_BLOCKS ? 0u : d->block_at + 1u;
}
