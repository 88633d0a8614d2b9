/* How an output ends: the ramp to 0 V, and the fault that caused it. */
#include "haptix_internal.h"

void hx_drop_mark(hx_device *d, uint32_t at) {
    d->marks--;
    for (; at < d->marks; at++) d->mark[at] = d->mark[at + 1u];
}

void hx_end_output(hx_device *d) {
    for (uint32_t i = d->marks; i-- > 0;)
        if (!d->mark[i].is_due) hx_drop_mark(d, i); /* its sample will not be played */
    d->is_armed = 0;
    d->has_begun = 0;
    d->is_playing = 0;
    d->head = 0;
    d->queued = 0;
    if (d->ramp_ticks_left == 0 && d->level != 0) {
        d->ramp_from = d->level;
        d->ramp_ticks_left = d->ramp_ticks;
        d->ramp_step = 1;
    }
}

void hx_refuse(hx_device *d, enum hx_fault_code code, uint8_t field, uint16_t sequence,
               uint32_t expected, uint32_t got) {
    /* The first cause is the one to report; what follows from it is not counted again. */
    if (d->fault.code == HX_FAULT_NONE) {
        d->fault.code = (uint8_t)code;
        d->fault.field = field;
        d->fault.sequence = sequence;
        d->fault.expected = expected;
        d->fault.got = got;
        d->fault.clock = d->clock;
        d->faults++;
    }
    d->fault_due = 1;
    hx_end_output(d);
}

void hx_cut(hx_device *d, enum hx_fault_code code, uint32_t expected, uint32_t got) {
    hx_refuse(d, code, 0, 0, expected, got);
    d->ramp_step = HX_CUT;
}

/* Noise at a port that is being opened is no fault; noise in a stream is. */
void hx_meet_damage(hx_device *d, uint16_t sequence, uint32_t expected, uint32_t got) {
    if (d->is_armed) hx_refuse(d, HX_FAULT_DAMAGED, 0, sequence, expected, got);
}
