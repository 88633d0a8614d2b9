/* The carrier's sine. */
#include "haptix_sine.h"
#include "haptix_internal.h"

/* The sine of a phase (2^32 is a turn) in 1/32767, interpolated in the table. */
int32_t hx_sine_of(uint32_t phase) {
    uint32_t index = phase >> 22;
    int32_t fraction = (int32_t)(phase >> 6 & 0xffffu);
    int32_t a = hx_sine[index], b = hx_sine[index + 1u];
    return a + (b - a) * fraction / 65536;
}
