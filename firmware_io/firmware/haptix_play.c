/* From the queue to the output, one sample after the other: the device's only clock. */
#include <stddef.h>

#include "haptix_internal.h"
#include "haptix_window.h"

/* The line rises with a sample that was marked. */
static void meet_marks(hx_device *d, uint32_t index) {
    for (uint32_t i = 0; i < d->marks; i++) {
        hx_mark *mark = &d->mark[i];
        if (mark->is_due || mark->index != index) continue;
        mark->is_due = 1;
        mark->clock = d->clock;
        d->line_ticks_left = d->line_ticks;
    }
}

static void begin_playing(hx_device *d) {
    /* Only now: a ramp from before may have needed the carrier of its own stream. */
    d->is_playing = 1;
    d->is_dry = 0;
    d->has_carrier = d->mode == HX_ENVELOPE;
    d->phase_step_now = d->phase_step;
    d->step_codes_now = d->step_codes;
    d->ceiling_code_now = d->ceiling_code;
    d->half_turn_ticks = d->has_carrier ? 0x80000000u / d->phase_step + 2u : 0u;
    d->phase = 0;
    d->to = 0;
    d->tick_of_sample = d->ticks_per_sample;
    d->gain = d->ramp_ticks;
    hx_sense_begin(d);
}

/* No sample is due: hold a carrier; hold a waveform for a while, then ramp it to 0 V. */
static enum hx_output run_dry(hx_device *d) {
    if (!d->is_dry) {
        d->is_dry = 1;
        d->dry_ticks = 0;
        d->underruns++;
    }
    if (d->has_carrier || d->gain == 0) return HX_OUT_HELD;
    if (d->dry_ticks < d->hold_ticks) {
        d->dry_ticks++;
        return HX_OUT_HELD;
    }
    d->gain--;
    d->level = (int16_t)((int32_t)d->to * (int32_t)d->gain / (int32_t)d->ramp_ticks);
    return HX_OUT_RAMP;
}

static int is_in_reach(const hx_device *d, int32_t before, int32_t code) {
    return code <= before + d->step_codes_now && code >= before - d->step_codes_now;
}

/* Advance the level by one output sample; return what it is. */
static enum hx_output advance(hx_device *d) {
    int is_leading = d->lead_ticks > 0;
    if (d->has_begun && is_leading) d->lead_ticks--;
    if (d->ramp_ticks_left > 0) {
        d->ramp_ticks_left = d->ramp_ticks_left > d->ramp_step ? d->ramp_ticks_left - d->ramp_step : 0u;
        d->level = (int16_t)((int32_t)d->ramp_from * (int32_t)d->ramp_ticks_left /
                             (int32_t)d->ramp_ticks);
        if (d->ramp_ticks_left == 0) d->status_due = 1;
        return HX_OUT_RAMP;
    }
    if (!d->has_begun || is_leading) {
        d->level = 0;
        return HX_OUT_IDLE;
    }
    if (!d->is_playing) begin_playing(d);
    if (d->tick_of_sample >= d->ticks_per_sample) {
        if (d->queued == 0) return run_dry(d);
        d->is_dry = 0;
        d->from = d->to;
        d->to = d->queue[d->head];
        d->head = d->head + 1u == HX_QUEUE_SAMPLES ? 0u : d->head + 1u;
        d->queued--;
        meet_marks(d, d->samples_played++);
        d->tick_of_sample = 0;
    }
    int32_t line = d->to;
    if (++d->tick_of_sample < d->ticks_per_sample) { /* a division costs as much as all the rest */
        line = d->from + (line - d->from) * (int32_t)d->tick_of_sample /
                             (int32_t)d->ticks_per_sample;
    }
    if (d->gain < d->ramp_ticks) { /* back from a ramp when it had run dry */
        /* Where the stream itself needs the slew, the gain waits: as it is, it flattens slopes. */
        int32_t ramp = (int32_t)d->ramp_ticks;
        if (is_in_reach(d, d->code, line * ((int32_t)d->gain + 1) / ramp)) d->gain++;
        line = line * (int32_t)d->gain / ramp;
    }
    d->level = (int16_t)line;
    return HX_OUT_STREAM;
}

/* Samples were checked as they came, and ramp and gain keep the slew by themselves: what the limiter
 * changes is the rounding of a carrier, the first of its ramp, and memory that went bad. */
static int16_t limited(const hx_device *d, int32_t before, int32_t code) {
    return (int16_t)hx_limited(d->ceiling_code_now, d->step_codes_now, before, code);
}

/* The level as it goes to the output. */
static int16_t drive(const hx_device *d, enum hx_output what) {
    int32_t code = d->level;
    if (d->has_carrier && what != HX_OUT_IDLE) code = code * hx_sine_of(d->phase) / 32767;
    return limited(d, d->code, code);
}

static uint32_t pause_ticks(const hx_device *d) {
    return d->config.output_rate_hz * HX_PAUSE_MS / 1000u;
}

/* What the passing of output samples brings about: of one, or of some of which none is due. */
static void pass_time(hx_device *d, uint32_t ticks) {
    d->clock += ticks;
    if (d->is_armed && d->has_begun &&
        (d->silent_ticks += ticks) >= d->watchdog_ticks - d->ramp_ticks) {
        hx_refuse(d, HX_FAULT_STARVED, 0, 0, d->watchdog_ms, 0);
    }
    if (d->is_armed && d->status_ticks > 0 && (d->since_status_ticks += ticks) >= d->status_ticks) {
        d->since_status_ticks = 0;
        d->status_due = 1;
    }
    if (d->received > 0 && !d->has_paused && (d->pause_ticks += ticks) >= pause_ticks(d))
        hx_meet_pause(d);
}

/* The least of a number and of those left before a counter of samples reaches its end. */
static uint32_t less_left(uint32_t most, uint32_t count, uint32_t end) {
    uint32_t left = count + 1u < end ? end - count - 1u : 0u;
    return left < most ? left : most;
}

/* Output samples, of n, before anything but the next of the queue is due; 0 if something is. */
static uint32_t undisturbed(const hx_device *d, uint32_t n) {
    if (!d->is_playing || d->ticks_per_sample != 1u || d->lead_ticks > 0 ||
        d->ramp_ticks_left > 0 || d->gain < d->ramp_ticks || d->marks > 0 || d->line_ticks_left > 0)
        return 0;
    if (n > d->queued) n = d->queued;
    n = less_left(n, d->block_tick, d->block_ticks);
    n = less_left(n, d->silent_ticks, d->watchdog_ticks - d->ramp_ticks);
    if (d->status_ticks > 0) n = less_left(n, d->since_status_ticks, d->status_ticks);
    if (d->received > 0 && !d->has_paused) n = less_left(n, d->pause_ticks, pause_ticks(d));
    return n;
}

/* Play samples of the queue as the loop of hx_device_play does, while nothing else is due and no
 * limit of the window is broken; return how many. It looks once at what it looks at each time. */
static uint32_t play_run(hx_device *restrict d, int16_t *restrict out, uint8_t *restrict what,
                         uint32_t n) {
    uint32_t most = undisturbed(d, n), at = d->head, done;
    if (most == 0) return 0;
    hx_block now = d->block;
    uint64_t energy_now = d->energy_now;
    int16_t from = d->from, to = d->to, code = d->code;
    for (done = 0; done < most; done++) {
        int16_t next = d->queue[at], driven = limited(d, code, next);
        if (hx_window_check(d, &now, energy_now, next, driven) != HX_FAULT_NONE) break;
        hx_window_take(&now, &energy_now, driven);
        from = to;
        to = next;
        code = out[done] = driven;
        at = at + 1u == HX_QUEUE_SAMPLES ? 0u : at + 1u;
    }
    if (done == 0) return 0;
    if (what != NULL)
        for (uint32_t i = 0; i < done; i++) what[i] = HX_OUT_STREAM;
    d->is_dry = 0;
    d->from = from;
    d->to = to;
    d->level = d->code = code;
    d->head = at;
    d->queued -= done;
    d->samples_played += done;
    d->block = now;
    d->block_tick += done;
    d->energy_now = energy_now;
    pass_time(d, done);
    return done;
}

/* Play until all are played or the window has gone bad; return how many were. */
static uint32_t play(hx_device *d, int16_t *out, uint8_t *what, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) {
        if (d->is_lost) return i;
        if (!d->has_carrier) i += play_run(d, out + i, what == NULL ? NULL : what + i, n - i);
        if (i == n) break;
        int16_t before = d->level;
        enum hx_output is = advance(d);
        int16_t code = drive(d, is);
        enum hx_fault_code broken = HX_FAULT_NONE;
        if (d->is_playing) broken = hx_window_check(d, &d->block, d->energy_now, d->level, code);
        if (broken != HX_FAULT_NONE) { /* the ramp takes the place of this sample */
            uint32_t limit_mv = HX_MAX_RMS_MV;
            if (broken == HX_FAULT_MEAN) limit_mv = d->config.ceiling_mv / HX_MEAN_DIVISOR;
            d->level = before;
            hx_refuse(d, broken, 0, 0, limit_mv, 0);
            is = advance(d);
            code = drive(d, is);
        }
        if (d->has_carrier && is != HX_OUT_IDLE) d->phase += d->phase_step_now;
        hx_window_take(&d->block, &d->energy_now, code);
        if (++d->block_tick >= d->block_ticks) hx_window_close_block(d);
        d->code = out[i] = code;
        if (!d->has_carrier) d->level = code; /* a ramp begins at what stands on the output */
        if (what != NULL) what[i] = (uint8_t)(d->line_ticks_left > 0 ? is | HX_OUT_LINE : is);
        if (d->line_ticks_left > 0) d->line_ticks_left--;
        pass_time(d, 1u);
    }
    return n;
}

void hx_device_play(hx_device *d, int16_t *out, uint8_t *what, uint32_t n) {
    uint32_t played = 0;
    if (hx_device_is_whole(d)) {
        played = play(d, out, what, n);
        hx_sense_miss(d, played);
        hx_keep_way_out(d);
        hx_seal(d);
    }
    if (played == n) return;
    hx_play_way_out(d, out + played, what == NULL ? NULL : what + played, n - played);
}

uint32_t hx_device_pending(const hx_device *d) {
    if (!hx_device_is_whole(d)) return hx_way_out_ticks(d);
    uint32_t ramp = d->ramp_ticks_left;
    if (ramp > 0) ramp = (ramp + d->ramp_step - 1u) / d->ramp_step;
    if (!d->has_begun) return ramp;
    uint32_t before = ramp > d->lead_ticks ? ramp : d->lead_ticks;
    uint32_t rest = d->is_playing ? d->ticks_per_sample - d->tick_of_sample : 0u;
    return before + rest + d->queued * d->ticks_per_sample;
}
