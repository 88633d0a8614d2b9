/* What the host has compiled beside the firmware; no board has it. */
#ifndef HAPTIX_HOST_H
#define HAPTIX_HOST_H

#include <stdint.h>

/* cffi: begin */
/* Of n samples behind one of before_v, and of the n samples that leave a window meanwhile, write:
 * the lowest and highest sum of the first samples, of none too; the same of those that leave; the
 * largest magnitude; the sum of squares; the sum of squared steps. */
void hx_host_sums(const double *volts, const double *leaving, uint32_t n, double before_v,
                  double *sums);

/* Write the codes of n samples behind one of before_v. Return 0, and leave the codes undefined, if
 * one of them is above most_v, is further than most_step_v from the one before it, or is not
 * finite; codes are bounded by top. */
int hx_host_codes(const double *volts, uint32_t n, double before_v, double most_v,
                  double most_step_v, double full_scale_v, int top, int16_t *codes);
/* cffi: end */

#endif
