/* The host's own checks of what it is about to send, in volts; no board has them.
 *
 * They share nothing with the device's: where the core runs in the host's process, as behind an
 * audio interface, one mistake must not pass both.
 */
#ifndef HAPTIX_HOST_H
#define HAPTIX_HOST_H

#include <stdint.h>

/* cffi: begin */
/* The last samples that were driven. The caller owns its memory. */
typedef struct hx_host_window hx_host_window;

/* Of the samples in a window. */
typedef struct {
    double most_squares; /* sum of their squares */
    double most_steps;   /* sum of the squares of the steps that lead to them */
    double most_stretch; /* sum of those that follow each other up to the newest, and a ramp */
    double ramp_samples; /* such a ramp has the sum of the sample before it this many times */
    double mean_share;   /* of the largest magnitude, in each sample of the window */
    double mean_floor;   /* or this, if it is more */
} hx_host_limits;

enum hx_host_verdict {
    HX_HOST_KEPT = 0,
    HX_HOST_SQUARES = 1,
    HX_HOST_MEAN = 2,
    HX_HOST_STRETCH = 3,
    HX_HOST_STEPS = 4
};

uint32_t hx_host_window_bytes(uint32_t size);

/* A window of so many samples of 0 V. */
void hx_host_window_init(hx_host_window *window, uint32_t size);

/* Return the limit that one of n samples breaks, at most as many as the window has; write the first
 * such sample's index and the sum that is too large. */
int hx_host_check(hx_host_window *window, const hx_host_limits *limits, const double *volts,
                  uint32_t n, uint32_t *index, double *sum);

/* Take n samples that are driven. */
void hx_host_take(hx_host_window *window, const double *volts, uint32_t n);

/* Write the codes of n samples behind one of before_v. Return 0, and leave the codes undefined, if
 * one of them is above most_v, is further than most_step_v from the one before it, or is not
 * finite; codes are bounded by top. */
int hx_host_codes(const double *volts, uint32_t n, double before_v, double most_v,
                  double most_step_v, double full_scale_v, int top, int16_t *codes);
/* cffi: end */

#endif
