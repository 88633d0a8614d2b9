/* What a host does to each sample that it is about to send; see drive_sums.py and drive_codes.py. */
#include "haptix_host.h"

void hx_host_sums(const double *volts, const double *leaving, uint32_t n, double before_v,
                  double *sums) {
    double sum = 0.0, low = 0.0, high = 0.0, gone = 0.0, gone_low = 0.0, gone_high = 0.0;
    double peak = 0.0, squares = 0.0, steps = 0.0, last = before_v;
    for (uint32_t i = 0; i < n; i++) {
        double volt = volts[i], step = volt - last, size = volt < 0.0 ? -volt : volt;
        last = volt;
        squares += volt * volt;
        steps += step * step;
        sum += volt;
        gone += leaving[i];
        peak = size > peak ? size : peak;
        low = sum < low ? sum : low;
        high = sum > high ? sum : high;
        gone_low = gone < gone_low ? gone : gone_low;
        gone_high = gone > gone_high ? gone : gone_high;
    }
    sums[0] = low;
    sums[1] = high;
    sums[2] = gone_low;
    sums[3] = gone_high;
    sums[4] = peak;
    sums[5] = squares;
    sums[6] = steps;
}

int hx_host_codes(const double *volts, uint32_t n, double before_v, double most_v,
                  double most_step_v, double full_scale_v, int top, int16_t *codes) {
    const double even = 6755399441055744.0; /* 1.5 * 2^52: adding it rounds to even */
    double last = before_v;
    for (uint32_t i = 0; i < n; i++) {
        double volt = volts[i], step = volt - last;
        /* Written so that NaN, which compares false with everything, is refused. */
        if (!(-most_v <= volt && volt <= most_v)) return 0;
        if (!(-most_step_v <= step && step <= most_step_v)) return 0;
        last = volt;
        volatile double moved = volt / full_scale_v * 32767.0 + even;
        double code = moved - even;
        codes[i] = (int16_t)(code > top ? top : code < -top ? -top : code);
    }
    return 1;
}
