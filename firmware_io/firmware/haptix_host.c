/* What a host does to each sample that it is about to send; see drive_window.py. */
#include "haptix_host.h"

/* A value, and the number of the sample it belongs to. */
typedef struct {
    uint64_t at;
    double value;
} entry;

/* The values of a window that may become its lowest: each is below all before it that are left, so
 * the first is the lowest now. Kept in a ring of one more than the window. */
typedef struct {
    uint32_t first;
    uint32_t count;
} candidates;

enum { LOW, HIGH, SIZE, KINDS }; /* lowest and highest sum, largest size; the latter two negated */

struct hx_host_window {
    uint32_t size;
    uint32_t next; /* of the ring: the oldest sample */
    uint64_t taken;
    double newest;
    double left; /* the sample that left the window last */
    double sum;
    double squares;
    double steps;
    double total; /* of all samples since it was last set to 0 */
    candidates of[KINDS];
};

/* Behind the structure: the window's samples, then the candidates. */
static double *samples_of(hx_host_window *w) { return (double *)(w + 1); }

static const double *seen_by(const hx_host_window *w) { return (const double *)(w + 1); }

static uint32_t capacity(const hx_host_window *w) { return w->size + 1u; }

static entry *entry_at(const hx_host_window *w, int kind, uint32_t place) {
    entry *entries = (entry *)(seen_by(w) + w->size) + (uint64_t)kind * capacity(w);
    uint32_t at = w->of[kind].first + place;
    return entries + (at < capacity(w) ? at : at - capacity(w));
}

/* The lowest value from a sample on; places before it are skipped, and none is the last. */
static double lowest(const hx_host_window *w, int kind, uint64_t oldest, uint32_t *place) {
    while (*place < w->of[kind].count && entry_at(w, kind, *place)->at < oldest) ++*place;
    return *place < w->of[kind].count ? entry_at(w, kind, *place)->value : 1e300;
}

static void add(hx_host_window *w, int kind, uint64_t at, double value) {
    candidates *of = &w->of[kind];
    while (of->count > 0 && entry_at(w, kind, of->count - 1u)->value >= value) of->count--;
    of->count++;
    entry *last = entry_at(w, kind, of->count - 1u);
    last->at = at;
    last->value = value;
}

static void forget(hx_host_window *w, int kind, uint64_t oldest) {
    candidates *of = &w->of[kind];
    while (of->count > 0 && entry_at(w, kind, 0)->at < oldest) {
        of->first = of->first + 1u == capacity(w) ? 0u : of->first + 1u;
        of->count--;
    }
}

uint32_t hx_host_window_bytes(uint32_t size) {
    return (uint32_t)(sizeof(hx_host_window) + size * sizeof(double) +
                      KINDS * (size + 1u) * sizeof(entry));
}

void hx_host_window_init(hx_host_window *w, uint32_t size) {
    uint8_t *bytes = (uint8_t *)w;
    for (uint32_t i = 0; i < hx_host_window_bytes(size); i++) bytes[i] = 0;
    w->size = size;
    add(w, LOW, 0, 0.0); /* the sum before the first sample */
    add(w, HIGH, 0, 0.0);
}

int hx_host_check(const hx_host_window *w, const hx_host_limits *limits, const double *volts,
                  uint32_t n, uint32_t *index, double *found) {
    uint32_t place[KINDS] = {0};
    uint32_t at = w->next;
    uint64_t oldest = 0; /* sum, by the samples taken before, that begins a stretch in the window */
    double newest = w->newest, left = w->left, sum = w->sum, squares = w->squares;
    double steps = w->steps, total = w->total, low = 1e300, high = 1e300, size = 1e300;
    for (uint32_t i = 0; i < n; i++) {
        if (w->taken + i + 1u > w->size) oldest = w->taken + i + 1u - w->size;
        double volt = volts[i], gone = seen_by(w)[at], step = volt - newest, back = gone - left;
        at = at + 1u == w->size ? 0u : at + 1u;
        newest = volt;
        left = gone;
        sum += volt - gone;
        squares += volt * volt - gone * gone;
        steps += step * step - back * back;
        total += volt;
        double magnitude = volt < 0.0 ? -volt : volt;
        if (-magnitude < size) size = -magnitude;
        if (volt != 0.0) { /* 0 V is the remedy, whatever came before */
            if (squares > limits->most_squares) {
                *index = i, *found = squares;
                return HX_HOST_SQUARES;
            }
            double most = lowest(w, SIZE, oldest + 1u, &place[SIZE]);
            most = limits->mean_share * -(most < size ? most : size);
            if (most < limits->mean_floor) most = limits->mean_floor;
            if ((sum < 0.0 ? -sum : sum) > most * w->size && volt * sum > 0.0) {
                *index = i, *found = sum;
                return HX_HOST_MEAN;
            }
            /* From the lowest sum in the window up to here, or from the highest one. */
            double begin = volt > 0.0 ? lowest(w, LOW, oldest, &place[LOW])
                                      : lowest(w, HIGH, oldest, &place[HIGH]);
            double fresh = volt > 0.0 ? low : high;
            if (fresh < begin) begin = fresh;
            double stretch = (volt > 0.0 ? total : -total) - begin + limits->ramp_samples * magnitude;
            if (stretch > limits->most_stretch) {
                *index = i, *found = volt > 0.0 ? stretch : -stretch;
                return HX_HOST_STRETCH;
            }
            if (steps > limits->most_steps) {
                *index = i, *found = steps;
                return HX_HOST_STEPS;
            }
        }
        if (total < low) low = total;
        if (-total < high) high = -total;
    }
    return HX_HOST_KEPT;
}

/* Add up afresh, so that rounding does not add up over hours. */
static void recount(hx_host_window *w) {
    double before = w->left, base = w->total;
    w->sum = w->squares = w->steps = 0.0;
    for (uint32_t i = 0; i < w->size; i++) {
        uint32_t at = w->next + i;
        double volt = seen_by(w)[at < w->size ? at : at - w->size];
        w->sum += volt;
        w->squares += volt * volt;
        w->steps += (volt - before) * (volt - before);
        before = volt;
    }
    for (uint32_t i = 0; i < w->of[LOW].count; i++) entry_at(w, LOW, i)->value -= base;
    for (uint32_t i = 0; i < w->of[HIGH].count; i++) entry_at(w, HIGH, i)->value += base;
    w->total = 0.0;
}

void hx_host_take(hx_host_window *w, const double *volts, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) {
        double volt = volts[i], gone = seen_by(w)[w->next];
        double step = volt - w->newest, back = gone - w->left;
        samples_of(w)[w->next] = volt;
        w->next = w->next + 1u == w->size ? 0u : w->next + 1u;
        w->newest = volt;
        w->left = gone;
        w->sum += volt - gone;
        w->squares += volt * volt - gone * gone;
        w->steps += step * step - back * back;
        w->total += volt;
        w->taken++;
        uint64_t oldest = w->taken > w->size ? w->taken - w->size : 0u;
        forget(w, LOW, oldest);
        forget(w, HIGH, oldest);
        forget(w, SIZE, oldest + 1u);
        add(w, LOW, w->taken, w->total);
        add(w, HIGH, w->taken, -w->total);
        add(w, SIZE, w->taken, volt < 0.0 ? volt : -volt);
        if (w->next == 0) recount(w);
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
