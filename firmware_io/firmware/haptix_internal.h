/* Functions that the files of the core share. */
#ifndef HAPTIX_INTERNAL_H
#define HAPTIX_INTERNAL_H

#include "haptix_device.h"

/* Begin the safety ramp, throw the queue away, disarm. */
void hx_end_output(hx_device *device);

/* The sine of a phase (2^32 is a turn) in 1/32767. */
int32_t hx_sine_of(uint32_t phase);

/* Forget a mark. */
void hx_drop_mark(hx_device *device, uint32_t at);

/* Refuse: end the output, remember and count the first cause, owe the host a FAULT. */
void hx_refuse(hx_device *device, enum hx_fault_code code, uint8_t field, uint16_t sequence,
               uint32_t expected, uint32_t got);

/* End the output in the short ramp, for a fault that was measured. */
void hx_cut(hx_device *device, enum hx_fault_code code, uint32_t expected, uint32_t got);

/* The converter begins with a playback, and has missed output samples. */
void hx_sense_begin(hx_device *device);
void hx_sense_miss(hx_device *device, uint32_t n);

/* A finger on the panel, or off it. */
void hx_sense_touch(hx_device *device, uint32_t contact, int is_down);

/* Bytes that are no frame: a fault in a stream, nothing at a port that is being opened. */
void hx_meet_damage(hx_device *device, uint16_t sequence, uint32_t expected, uint32_t got);

/* The most that a header may announce and be believed. */
uint32_t hx_longest_payload(const hx_device *device);

/* The most units of work that a receiver may save up. */
uint32_t hx_most_work(const hx_device *device);

/* Act on a whole frame. */
void hx_take_frame(hx_device *device, const uint8_t *frame);

/* The bytes of a frame have paused for too long. Short: it is called for an output sample. */
void hx_meet_pause(hx_device *device);

/* The end of every call that may change the device. */
void hx_seal(hx_device *device);

/* After every output: what a core whose memory has gone bad ends from. */
void hx_keep_way_out(hx_device *device);

/* Output samples of such a core, and how many until it is at 0 V. */
void hx_play_way_out(hx_device *device, int16_t *out, uint8_t *what, uint32_t n);
uint32_t hx_way_out_ticks(const hx_device *device);

/* Look again at the bytes of a frame that has paused, without its first one. */
void hx_look_again(hx_device *device);

#endif
