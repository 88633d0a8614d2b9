/* What a host does to each sample that it is about to send; see drive_check.py. */
#include "haptix_host.h"

/* Sums are of all samples since the window was last counted anew. */
typedef struct {
    double lowest;
    double highest;
    double size; /* the largest magnitude of a sample */
} extremes;

struct hx_host_window {
    uint32_t size;
    uint32_t next;  /* of the ring: the oldest sample */
    uint32_t fresh; /* samples since it was counted anew, at most as many as it has */
    double newest;
    double left; /* the sample that left the window last */
    double sum;
    double squares;
    double steps;
    double total;   /* of the fresh samples */
    extremes since; /* of them, and of the sum before the first */
};

/* Behind the structure: the samples, then for each place, of those that were there when the window
 * was counted, the extremes from the one in this place of their order on; and for none of them. */
static double *samples_of(hx_host_window *w) { return (double *)(w + 1); }

static extremes *from_of(hx_host_window *w) { return (extremes *)(samples_of(w) + w->size); }

uint32_t hx_host_window_bytes(uint32_t size) {
    return (uint32_t)(sizeof(hx_host_window) + size * sizeof(double) +
                      (size + 1u) * sizeof(extremes));
}

static double size_of(double volt) { return volt < 0.0 ? -volt : volt; }

/* Count anew: rounding does not add up over hours, and the extremes behind each sample are known
 * until all of them have left the window. */
static void count(hx_host_window *w) {
    const double *samples = samples_of(w);
    extremes *from = from_of(w), found = {0.0, 0.0, 0.0};
    double total = 0.0, squares = 0.0, steps = 0.0;
    uint32_t at = w->next;
    from[w->size] = found;
    for (uint32_t place = w->size; place-- > 0;) {
        at = at == 0 ? w->size - 1u : at - 1u;
        double volt = samples[at];
        double before = place == 0 ? w->left : samples[at == 0 ? w->size - 1u : at - 1u];
        total -= volt;
        squares += volt * volt;
        steps += (volt - before) * (volt - before);
        found.lowest = total < found.lowest ? total : found.lowest;
        found.highest = total > found.highest ? total : found.highest;
        found.size = size_of(volt) > found.size ? size_of(volt) : found.size;
        from[place] = found;
    }
    w->sum = -total;
    w->squares = squares;
    w->steps = steps;
    w->total = 0.0;
    w->since = from[w->size];
    w->fresh = 0;
}

void hx_host_window_init(hx_host_window *w, uint32_t size) {
    uint8_t *bytes = (uint8_t *)w;
    for (uint32_t i = 0; i < hx_host_window_bytes(size); i++) bytes[i] = 0;
    w->size = size;
}

int hx_host_check(hx_host_window *w, const hx_host_limits *limits, const double *volts, uint32_t n,
                  uint32_t *index, double *found) {
    if (w->fresh + n > w->size) count(w);
    const hx_host_limits most = *limits;
    const double *samples = samples_of(w);
    const extremes *from = from_of(w) + w->fresh + 1u;
    const uint32_t window = w->size;
    uint32_t at = w->next;
    double newest = w->newest, left = w->left, sum = w->sum, squares = w->squares;
    double steps = w->steps, total = w->total;
    double low = w->since.lowest, high = w->since.highest, size = w->since.size;
    for (uint32_t i = 0; i < n; i++) {
        double volt = volts[i], gone = samples[at], step = volt - newest, back = gone - left;
        double magnitude = size_of(volt);
        at = at + 1u == window ? 0u : at + 1u;
        newest = volt;
        left = gone;
        sum += volt - gone;
        squares += volt * volt - gone * gone;
        steps += step * step - back * back;
        total += volt;
        size = magnitude > size ? magnitude : size;
        if (volt != 0.0) { /* 0 V is the remedy, whatever came before */
            if (squares > most.most_squares) {
                *index = i, *found = squares;
                return HX_HOST_SQUARES;
            }
            double mean = most.mean_share * (from[i].size > size ? from[i].size : size);
            if (mean < most.mean_floor) mean = most.mean_floor;
            if (size_of(sum) > mean * window && volt * sum > 0.0) {
                *index = i, *found = sum;
                return HX_HOST_MEAN;
            }
            /* From the lowest sum in the window up to here, or from the highest one. */
            double lowest = from[i].lowest < low ? from[i].lowest : low;
            double highest = from[i].highest > high ? from[i].highest : high;
            double stretch = (volt > 0.0 ? total - lowest : highest - total) +
                             most.ramp_samples * magnitude;
            if (stretch > most.most_stretch) {
                *index = i, *found = volt > 0.0 ? stretch : -stretch;
                return HX_HOST_STRETCH;
            }
            if (steps > most.most_steps) {
                *index = i, *found = steps;
                return HX_HOST_STEPS;
            }
        }
        low = total < low ? total : low;
        high = total > high ? total : high;
    }
    return HX_HOST_KEPT;
}

void hx_host_take(hx_host_window *w, const double *volts, uint32_t n) {
    while (n > 0) {
        if (w->fresh == w->size) count(w);
        uint32_t piece = w->size - w->fresh, at = w->next;
        if (piece > n) piece = n;
        double *samples = samples_of(w);
        double newest = w->newest, left = w->left, sum = w->sum, squares = w->squares;
        double steps = w->steps, total = w->total;
        extremes since = w->since;
        for (uint32_t i = 0; i < piece; i++) {
            double volt = volts[i], gone = samples[at], step = volt - newest, back = gone - left;
            samples[at] = volt;
            at = at + 1u == w->size ? 0u : at + 1u;
            newest = volt;
            left = gone;
            sum += volt - gone;
            squares += volt * volt - gone * gone;
            steps += step * step - back * back;
            total += volt;
            since.lowest = total < since.lowest ? total : since.lowest;
            since.highest = total > since.highest ? total : since.highest;
            since.size = size_of(volt) > since.size ? size_of(volt) : since.size;
        }
        w->next = at;
        w->fresh += piece;
        w->newest = newest;
        w->left = left;
        w->sum = sum;
        w->squares = squares;
        w->steps = steps;
        w->total = total;
        w->since = since;
        volts += piece;
        n -= piece;
    }
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
