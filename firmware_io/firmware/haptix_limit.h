/* The limiter's decision, in functions of numbers alone, so that `make prove` can show what their
 * contracts say for every input; docs/safety.md says what they mean together. Inlined where output
 * samples are played. */
#ifndef HAPTIX_LIMIT_H
#define HAPTIX_LIMIT_H

#include "haptix_device.h"

/*@ predicate is_code(integer code) = -32767 <= code <= 32767;
  @ predicate is_level(integer level) = -32768 <= level <= 32767; // memory may hold any
  @ logic integer size_of(integer level) = level < 0 ? -level : level;
  @*/

/* A code as it goes to the output: within the ceiling, and a step away from the one before. */
/*@ requires 0 <= most <= 32767 && 0 <= step <= 65534;
  @ requires is_code(before) && -0x40000000 <= code <= 0x40000000;
  @ assigns \nothing;
  @ ensures is_code(\result) && -step <= \result - before <= step;
  @ ensures -most <= before <= most ==> -most <= \result <= most;
  @ // From beyond the ceiling it goes towards it, as fast as the slew admits.
  @ ensures before > most ==> \result <= \max(before - step, most);
  @ ensures before < -most ==> \result >= \min(before + step, -most);
  @ // What keeps both is left as it is.
  @ ensures -most <= code <= most && -step <= code - before <= step ==> \result == code;
  @*/
static inline int32_t hx_limited(int32_t most, int32_t step, int32_t before, int32_t code) {
    if (code > most) code = most;
    if (code < -most) code = -most;
    if (code > before + step) return before + step;
    if (code < before - step) return before - step;
    return code;
}

/* Whether an energy, and that of a ramp of so much from a level of 1, keeps the limit. */
/*@ requires energy <= 0x10000000000000 && is_level(level) && ramp_energy <= 1668;
  @ assigns \nothing;
  @ ensures \result <==> energy + level * level * ramp_energy <= most;
  @*/
static inline int hx_energy_holds(uint64_t energy, int32_t level, uint32_t ramp_energy,
                                  uint64_t most) {
    //@ assert 0 <= level * level <= 32768 * 32768;
    //@ assert 0 <= level * level * ramp_energy <= 32768 * 32768 * 1668;
    return energy + (uint64_t)(uint32_t)(level * level) * ramp_energy <= most;
}

/* The most that the stretches of a ramp from a level sum to, either way. With a carrier no stretch
 * of a falling envelope sums to more than half a turn at its highest. */
/*@ requires is_level(level) && 1 <= ramp_ticks <= 5000 && half_turn_ticks <= 502;
  @ assigns \nothing;
  @ ensures \result <= 0x7fffffff;
  @ ensures half_turn_ticks > 0 ==> \result == size_of(level) * half_turn_ticks;
  @ ensures half_turn_ticks == 0 ==> \result == size_of(level) * (ramp_ticks - 1) / 2;
  @*/
static inline uint32_t hx_ramp_sum(int32_t level, uint32_t ramp_ticks, uint32_t half_turn_ticks) {
    uint32_t size = (uint32_t)(level < 0 ? -level : level);
    //@ assert size == size_of(level) && size <= 32768;
    //@ assert 0 <= size * half_turn_ticks <= 32768 * 502;
    //@ assert 0 <= size * (ramp_ticks - 1) <= 32768 * 4999;
    return half_turn_ticks > 0 ? size * half_turn_ticks : size * (ramp_ticks - 1u) / 2u;
}

#endif
