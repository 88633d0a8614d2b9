/* What the window does for each output sample: here, so that it is inlined where they are played. */
#ifndef HAPTIX_WINDOW_H
#define HAPTIX_WINDOW_H

#include "haptix_limit.h"

/* The window of energy and mean begins with 0 V. */
void hx_window_init(hx_device *device);

/* A block bounds the sums of all stretches of its samples that end with its last one, and of the
 * empty one; a window those of all stretches of whole blocks that end with the last block. */
/*@ predicate bounds{L}(hx_block *b, integer sum) = b->low <= sum <= b->high;
  @ predicate is_block{L}(hx_block *b) = -0x10000000 <= b->low <= b->sum <= b->high <= 0x10000000
  @     && bounds(b, 0);
  @ predicate is_window{L}(hx_device *d) = d->energy_before <= 0x8000000000000
  @     && -0x8000000000 <= d->low_before <= 0 <= d->high_before <= 0x8000000000
  @     && d->ramp_energy <= 1668 && 1 <= d->ramp_ticks <= 5000 && d->half_turn_ticks <= 502
  @     && (d->has_carrier != 0 <==> d->half_turn_ticks > 0)
  @     && 0 <= d->max_sum <= 0x8000000000;
  @*/

/* Put the block under way, which is full, in the place of the oldest. */
/*@ requires \valid(d) && d->block_at < HX_WINDOW_BLOCKS && is_block(&d->block);
  @ requires d->energy_now <= 0x80000000000;
  @ assigns d->blocks[d->block_at], d->block, d->block_at, d->block_tick, d->energy_before,
  @     d->energy_now, d->high_before, d->low_before, d->blocks_seal, d->is_lost;
  @ ensures d->energy_before <= 0x8000000000000 && d->energy_now == 0 && d->block_tick == 0;
  @ ensures -0x8000000000 <= d->low_before <= 0 <= d->high_before <= 0x8000000000;
  @ ensures d->block_at == (\old(d->block_at) + 1) % HX_WINDOW_BLOCKS;
  @ ensures d->block.sum == d->block.high == d->block.low == 0;
  @ ensures is_block(&d->block);
  @*/
void hx_window_close_block(hx_device *d);

/* Whether an output sample, of a level, would break a limit behind a block under way. */
/*@ requires \valid_read(d) && \valid_read(now) && is_window(d) && is_block(now);
  @ requires energy_now <= 0x80000000000 && is_level(level) && is_code(code);
  @ assigns \nothing;
  @ ensures \result == HX_FAULT_NONE ==>
  @     d->energy_before + energy_now + code * code + level * level * d->ramp_energy
  @         <= d->max_energy;
  @ // No stretch that ends now, with a ramp behind it or without, sums to more than the limit.
  @ ensures \result == HX_FAULT_NONE ==> \forall integer sum;
  @     bounds(now, sum) || d->low_before <= sum - now->sum <= d->high_before ==>
  @     -d->max_sum <= sum + code <= d->max_sum;
  @ ensures \result == HX_FAULT_NONE && d->has_carrier ==> \forall integer sum;
  @     bounds(now, sum) || d->low_before <= sum - now->sum <= d->high_before ==>
  @     -d->max_sum + size_of(level) * d->half_turn_ticks <= sum + code
  @         <= d->max_sum - size_of(level) * d->half_turn_ticks;
  @ ensures \result == HX_FAULT_NONE && !d->has_carrier && level > 0 ==> \forall integer sum;
  @     bounds(now, sum) || d->low_before <= sum - now->sum <= d->high_before ==>
  @     sum + code + size_of(level) * (d->ramp_ticks - 1) / 2 <= d->max_sum;
  @ ensures \result == HX_FAULT_NONE && !d->has_carrier && level < 0 ==> \forall integer sum;
  @     bounds(now, sum) || d->low_before <= sum - now->sum <= d->high_before ==>
  @     sum + code - size_of(level) * (d->ramp_ticks - 1) / 2 >= -d->max_sum;
  @*/
static inline enum hx_fault_code hx_window_check(const hx_device *d, const hx_block *now,
                                                 uint64_t energy_now, int32_t level,
                                                 int32_t code) {
    uint64_t energy = d->energy_before + energy_now + (uint32_t)(code * code);
    if (!hx_energy_holds(energy, level, d->ramp_energy, d->max_energy)) return HX_FAULT_ENERGY;

    int64_t high = now->high + code, low = now->low + code;
    if (high < now->sum + code + d->high_before) high = now->sum + code + d->high_before;
    if (low > now->sum + code + d->low_before) low = now->sum + code + d->low_before;
    uint32_t ramp = hx_ramp_sum(level, d->ramp_ticks, d->half_turn_ticks);
    if (d->has_carrier || level > 0) high += ramp;
    if (d->has_carrier || level <= 0) low -= ramp;
    return high > d->max_sum || -low > d->max_sum ? HX_FAULT_MEAN : HX_FAULT_NONE;
}

/* Count an output sample in a block that is not full. */
/*@ requires \valid(now) && \valid(energy_now) && \separated(now, energy_now);
  @ requires is_block(now) && is_code(code) && *energy_now <= 0x80000000000;
  @ assigns *now, *energy_now;
  @ ensures *energy_now == \old(*energy_now) + code * code;
  @ ensures now->sum == \old(now->sum) + code && now->low <= now->sum <= now->high;
  @ // No stretch is forgotten, and the one that begins behind this sample is new.
  @ ensures \forall integer sum; \at(now->low, Pre) <= sum <= \at(now->high, Pre) ==> bounds(now, sum + code);
  @ ensures bounds(now, 0);
  @ // A block of so many samples is bounded by as many codes.
  @ ensures now->high <= \old(now->high) + size_of(code);
  @ ensures now->low >= \old(now->low) - size_of(code);
  @*/
static inline void hx_window_take(hx_block *now, uint64_t *energy_now, int32_t code) {
    now->sum += code;
    now->high += code;
    now->low += code;
    if (now->high < 0) now->high = 0;
    if (now->low > 0) now->low = 0;
    *energy_now += (uint32_t)(code * code);
}

#endif
