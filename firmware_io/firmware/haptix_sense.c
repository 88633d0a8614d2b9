/* The current, measured beside the output: readings for the host, and limits that it holds as well.
 *
 * A reading needs no phase of its own: times the drive and times the drive a sample before, the current
 * gives the part in phase and the part ahead of it, over whole periods of the carrier. What is taken so is
 * the rest beside the current of the untouched panel, which is added in a reading. The limits are
 * looked at in each half period. What is measured can end the output. It changes no other limit, and
 * a converter that is not believed changes nothing.
 */
#include "haptix_internal.h"

#define ONE 65536          /* of a ratio of codes */
#define PANEL_READINGS 16u /* of the untouched panel, before it is known */
#define MOST_OFFSET 256   /* of the converter, in its codes */
#define QUARTER 0x40000000u /* of a turn, by which a carrier's step is smaller: halves have two samples */
#define RAIL 32752         /* the highest code of 12 bits, at the left of 16 */

static int has_sensor(const hx_device *d) { return d->config.sense_rate_hz != 0; }

static uint32_t ticks_of(const hx_device *d, uint32_t ms) {
    return (d->config.output_rate_hz * ms + 999u) / 1000u;
}

static uint32_t root(uint64_t square) {
    uint32_t found = 0;
    for (uint32_t bit = 0x80000000u; bit > 0; bit >>= 1)
        if ((uint64_t)(found + bit) * (found + bit) <= square) found += bit;
    return found;
}

static void forget(hx_sums *sums) {
    static const hx_sums none = {0, 0, 0, 0, 0, 0, 0, 0, 0};
    *sums = none;
}

/* Readings and halves begin anew. */
static void start_over(hx_sensor *s) {
    forget(&s->half);
    forget(&s->whole);
    s->drive_before = 0;
    s->has_begun = 0;
}

/* The host reads late: the oldest is lost. */
static void keep(hx_device *d, uint64_t clock, int32_t in_phase_na, int32_t ahead_na, int32_t driven,
                 uint32_t flags) {
    if (d->readings == HX_READINGS) {
        d->readings--;
        for (uint32_t i = 0; i < d->readings; i++) d->reading[i] = d->reading[i + 1u];
    }
    hx_reading *reading = &d->reading[d->readings++];
    reading->clock = clock;
    reading->in_phase_na = in_phase_na;
    reading->ahead_na = ahead_na;
    reading->driven = (int16_t)driven;
    reading->flags = (uint16_t)flags;
}

/* Go on by what is computed alone, and say so. */
static void doubt(hx_device *d, enum hx_doubt why) {
    hx_sensor *s = &d->sensor;
    s->well_ticks = 0;
    s->too_much = s->missing = s->lies = 0;
    if (s->doubt == why) return;
    s->doubt = (uint8_t)why;
    if (why != HX_BELIEVED) keep(d, d->clock, 0, 0, 0, (uint32_t)why << 1);
}

/* Codes of current, with 16 bits behind the point, for one code of drive on a capacitance. */
static int32_t ratio_of(const hx_device *d, uint32_t pf) {
    const hx_config *c = &d->config;
    /* 2 pi as in SETUP; mV times pF over s are 10^-15 A, and 10^6 of them a nA. */
    uint64_t ratio = (uint64_t)d->carrier_rad_per_s * c->full_scale_mv / 1000u * pf / 1000u;
    ratio = (ratio << 16) / c->sense_full_scale_na;
    return ratio < 2u * ONE ? (int32_t)ratio : 2 * ONE; /* beyond, the converter saturates */
}

/* Current = in phase * drive + ahead * (cosine * drive - drive before) / sine. */
static void set_panel(hx_sensor *s, int32_t in_phase, int32_t ahead) {
    s->in_phase = in_phase;
    s->ahead = ahead;
    int64_t before = (int64_t)ahead * 32767 / s->sine;
    int64_t drive = in_phase + before * s->cosine / 32767;
    /* In 15 bits, so that no product needs more than 32. */
    s->shift = 16;
    while (before > 32767 || before < -32767 || drive > 32767 || drive < -32767) {
        before /= 2;
        drive /= 2;
        s->shift--;
    }
    s->with_before = (int32_t)-before;
    s->with_drive = (int32_t)drive;
}

void hx_sense_begin(hx_device *d) {
    hx_sensor *s = &d->sensor;
    if (!has_sensor(d)) return;
    start_over(s);
    s->before = 0;
    s->too_much = s->missing = s->lies = 0;
    s->heard = d->clock;
    if (!d->has_carrier || d->phase_step >= QUARTER) {
        doubt(d, HX_DIRECT);
        return;
    }
    if (s->doubt == HX_DIRECT) doubt(d, HX_BELIEVED);
    int32_t step_sine = hx_sine_of(d->phase_step), panel = ratio_of(d, d->config.panel_pf);
    if (s->panel != panel || s->sine != step_sine) s->measured = 0; /* another carrier */
    s->panel = panel;
    s->body = ratio_of(d, HX_BODY_PF);
    s->sine = step_sine;
    s->cosine = hx_sine_of(d->phase_step + QUARTER);
    /* A full scale below it is never driven so far: no current is expected. */
    uint32_t least = (uint32_t)((uint64_t)HX_SENSE_LEAST_MV * 32767u / d->config.full_scale_mv);
    s->least = least > 32767u ? 0xffffffffu : least * least / 2u;
    if (s->measured == 0) set_panel(s, 0, panel);
}

void hx_sense_miss(hx_device *d, uint32_t n) {
    hx_sensor *s = &d->sensor;
    if (!has_sensor(d)) return;
    if (s->untouched_ticks < 0x40000000u) s->untouched_ticks = s->fingers ? 0u : s->untouched_ticks + n;
    if (!d->is_playing || s->doubt == HX_DIRECT) return;
    if (d->clock > s->heard + ticks_of(d, HX_SENSE_LATE_MS)) doubt(d, HX_LATE);
}

void hx_sense_touch(hx_device *d, uint32_t contact, int is_down) {
    uint32_t finger = (uint32_t)1 << (contact & 31u);
    if (is_down) d->sensor.fingers |= finger;
    else d->sensor.fingers &= ~finger;
    d->sensor.untouched_ticks = 0;
}

/* A sum over the drive's energy, as a ratio with 16 bits behind the point. */
static int32_t over(int64_t sum, uint64_t drive) {
    int64_t most = (int64_t)drive * 8;
    if (sum > most) sum = most;
    if (sum < -most) sum = -most;
    return (int32_t)(sum * ONE / (int64_t)drive);
}

/* The part of a rest that is ahead of the drive, times the drive's amplitude. */
static int64_t times_ahead(const hx_sensor *s, const hx_sums *sums) {
    return (s->cosine * sums->with_drive - 32767 * sums->with_before) / s->sine;
}

static int32_t ahead_of(const hx_sensor *s, const hx_sums *sums) {
    return over(times_ahead(s, sums), sums->drive);
}

/* Whether a rest is a load's: less than a fifth of it takes from the current ahead. */
static int is_load(const hx_sensor *s, const hx_sums *half) {
    return -times_ahead(s, half) < (int64_t)root(half->rest) * root(half->drive) / 5;
}

/* Whether a current's energy is more than that of a ratio to the drive. */
static int is_more(uint64_t current, uint64_t drive, uint64_t ratio) {
    return current > (drive * (ratio * ratio >> 12) >> 20);
}

static uint32_t code_of(const hx_device *d, uint32_t na) {
    return (uint32_t)((uint64_t)na * 32767u / d->config.sense_full_scale_na);
}

/* What half a period says of the converter and of the current. A load beside the panel adds to the
 * current ahead of the drive, or to that in phase: what takes from the one ahead is no load. The half
 * in which something begins has something of before, so that one alone decides only a peak. */
static void judge(hx_device *d, const hx_sums *half) {
    hx_sensor *s = &d->sensor;
    uint32_t panel = (uint32_t)s->panel, is_known = s->measured == PANEL_READINGS;
    uint32_t peak = code_of(d, HX_MAX_PEAK_NA), rms = code_of(d, HX_MAX_RMS_NA);
    /* A broken electrode leaves some noise, for which its fault waits. At the end of its range the
     * converter may measure too much. */
    int is_same = s->same_ticks >= half->ticks && !half->is_saturated;
    if (is_same && s->same_ticks >= d->config.output_rate_hz / 4000u) {
        doubt(d, HX_STUCK);
        return;
    }
    int is_too_much = half->is_saturated || is_more(half->current, half->drive, panel * 2u);
    int is_missing = !is_more(half->current, half->drive, panel / 2u);
    /* Over a period: one half may have the samples at both changes of sign, and the other none. */
    int32_t ahead = over(times_ahead(s, half) + s->ahead_before, half->drive + s->drive_before);
    int is_a_lie = !is_missing && ahead < -(is_known ? s->ahead / 32 * 3 : s->panel / 4 * 3);
    if (s->doubt != HX_BELIEVED) {
        if (is_too_much || is_missing || is_a_lie) s->well_ticks = 0;
        else if ((s->well_ticks += half->ticks) > ticks_of(d, HX_SENSE_BACK_MS))
            doubt(d, HX_BELIEVED);
        return;
    }
    s->too_much = is_too_much ? s->too_much + 1u : 0u;
    s->missing = is_missing ? s->missing + half->ticks : 0u;
    s->lies = is_a_lie ? s->lies + 1u : 0u;
    if (s->too_much >= 2u) {
        hx_cut(d, HX_FAULT_OVERLOAD, panel, root(half->current / half->ticks));
    } else if (s->missing > half->ticks && s->missing >= d->config.output_rate_hz / 2000u) {
        hx_cut(d, HX_FAULT_NO_CURRENT, panel, root(half->current / half->ticks));
    } else if (s->lies >= 3u) {
        doubt(d, HX_LIES);
    } else if (is_known && !is_same && half->rest_peak > peak && is_load(s, half)) {
        hx_cut(d, HX_FAULT_PEAK_CURRENT, peak, half->rest_peak);
    } else if (is_known && !is_same && half->rest > (uint64_t)rms * rms * half->ticks && is_load(s, half)) {
        hx_cut(d, HX_FAULT_RMS_CURRENT, rms, root(half->rest / half->ticks));
    }
}

static int32_t within(int32_t value, int32_t centre, int32_t reach) {
    return value > centre + reach ? centre + reach : value < centre - reach ? centre - reach : value;
}

/* The panel, while nobody touches it and its current does not rise. A person whose touch is not
 * reported, and whose current rises slowly, looks like a panel that drifts: so what is learned stays
 * within HX_LEARNED_NA of what was known first. */
static void learn(hx_device *d, int32_t in_phase, int32_t ahead) {
    hx_sensor *s = &d->sensor;
    if (!(d->config.flags & HX_SENDS_TOUCH) || s->doubt != HX_BELIEVED) return;
    if (s->untouched_ticks < ticks_of(d, HX_UNTOUCHED_MS)) return;
    int32_t least = s->panel - s->panel / 3, most = s->panel + s->panel / 3;
    if (ahead < least || ahead > most || in_phase > most / 2 || in_phase < -most / 2) return;
    int is_known = s->measured == PANEL_READINGS;
    if (is_known && ahead > s->ahead + s->ahead / 256) return;
    if (!is_known) s->measured++;
    int32_t share = (int32_t)s->measured;
    in_phase = s->in_phase + (in_phase - s->in_phase) / share;
    ahead = s->ahead + (ahead - s->ahead) / share;
    if (is_known) {
        /* As a share of the drive at the ceiling, where the current is the highest. */
        uint32_t learned = code_of(d, HX_LEARNED_NA), most_code = (uint32_t)d->top_code;
        int32_t reach = (int32_t)((uint64_t)learned * (uint32_t)ONE / most_code);
        in_phase = within(in_phase, s->first_in_phase, reach);
        ahead = within(ahead, s->first_ahead, reach);
    } else {
        s->first_in_phase = in_phase;
        s->first_ahead = ahead;
    }
    set_panel(s, in_phase, ahead);
}

static int32_t na_of(const hx_device *d, int32_t ratio, uint32_t amplitude) {
    /* 2^17, 2^15 and 2^26 at most; whole codes would be coarser than the noise. */
    int64_t current = (int64_t)ratio * amplitude * (int64_t)d->config.sense_full_scale_na;
    return (int32_t)(current / ((int64_t)ONE * 32767));
}

static void end_reading(hx_device *d, uint64_t clock) {
    hx_sensor *s = &d->sensor;
    const hx_sums *whole = &s->whole;
    int32_t in_phase = s->in_phase + over(whole->with_drive, whole->drive);
    int32_t ahead = s->ahead + ahead_of(s, whole);
    uint32_t amplitude = root(2u * whole->drive / whole->ticks);
    if (amplitude > 32767u) amplitude = 32767u;
    keep(d, clock, na_of(d, in_phase, amplitude), na_of(d, ahead, amplitude), (int32_t)amplitude,
         whole->is_saturated | (s->lies > 0 || s->missing > 0 ? (uint32_t)HX_LIES : s->doubt) << 1);
    if (whole->drive / whole->ticks > s->least) learn(d, in_phase, ahead);
    int64_t offset = whole->offset / (int64_t)whole->ticks; /* what stays over whole periods */
    s->offset = offset > MOST_OFFSET ? MOST_OFFSET : offset < -MOST_OFFSET ? -MOST_OFFSET : (int32_t)offset;
}

static void add(hx_sums *to, const hx_sums *half) {
    to->with_drive += half->with_drive;
    to->with_before += half->with_before;
    to->offset += half->offset;
    to->drive += half->drive;
    to->ticks += half->ticks;
    to->is_saturated |= half->is_saturated;
}

/* The drive has changed its sign; before the first time nothing was a whole half. */
static void end_half(hx_device *d, int is_rising, uint64_t clock) {
    hx_sensor *s = &d->sensor;
    hx_sums *half = &s->half;
    if (s->drive_before > 0 && half->drive > 0) {
        /* By the sum, as a sample at the change of sign counts for either half and adds nothing. */
        uint64_t drive = half->drive, before = s->drive_before;
        int is_steady = drive < before + before / 8u && before < drive + drive / 8u;
        if (is_steady && drive > (uint64_t)s->least * half->ticks && d->is_playing) judge(d, half);
        if (s->has_begun) add(&s->whole, half);
    }
    s->drive_before = half->drive;
    s->ahead_before = times_ahead(s, half);
    forget(half);
    if (!is_rising) return;
    if (s->has_begun && s->whole.ticks >= d->config.output_rate_hz / d->config.sense_rate_hz) {
        if (s->whole.drive > 0) end_reading(d, clock);
        forget(&s->whole);
    }
    s->has_begun = 1;
}

/* Without a drive no sign changes: the reading that is due says so, lest the sensor seem to be silent. */
static void end_idle(hx_device *d, uint64_t clock) {
    hx_sensor *s = &d->sensor;
    if ((s->whole.ticks + s->half.ticks) * d->config.sense_rate_hz < d->config.output_rate_hz) return;
    if (!d->is_playing || (uint64_t)s->half.ticks * d->phase_step >> 32 == 0) return; /* less than a period */
    keep(d, clock, 0, 0, 0, (uint32_t)s->doubt << 1);
    start_over(s);
}

static void measure(hx_sensor *s, int32_t drive, int32_t current) {
    hx_sums *half = &s->half;
    if (current >= RAIL || current <= -RAIL) half->is_saturated = 1;
    half->offset += current;
    s->same_ticks = current == s->code ? s->same_ticks + 1u : 1u;
    s->code = (int16_t)current;
    current -= s->offset;
    half->drive += (uint32_t)(drive * drive);
    half->current += (uint32_t)(current * current);
    int32_t rest = current - (s->with_drive * drive >> s->shift) - (s->with_before * s->before >> s->shift);
    rest = rest > 32767 ? 32767 : rest < -32767 ? -32767 : rest;
    half->with_drive += rest * drive;
    half->with_before += rest * s->before;
    uint32_t size = (uint32_t)(rest < 0 ? -rest : rest);
    half->rest += size * size;
    if (size > half->rest_peak) half->rest_peak = size;
    half->ticks++;
}

void hx_device_sense(hx_device *d, const int16_t *sent, const int16_t *raw, uint32_t n,
                     uint32_t behind) {
    if (!hx_device_is_whole(d)) return;
    hx_sensor *s = &d->sensor;
    if (has_sensor(d) && s->sine > 0 && s->doubt != HX_DIRECT && n + behind <= d->clock) {
        uint64_t clock = d->clock - behind - n;
        if (clock > s->heard) start_over(s); /* samples are missing */
        for (uint32_t i = 0; i < n; i++, clock++) {
            if (clock < s->heard) continue; /* of a playback before, or told twice */
            s->heard = clock + 1u;
            if ((sent[i] < 0) != (s->before < 0)) end_half(d, sent[i] >= 0, clock);
            measure(s, sent[i], raw[i]);
            s->before = sent[i];
            end_idle(d, clock + 1u);
        }
    }
    hx_seal(d);
}
