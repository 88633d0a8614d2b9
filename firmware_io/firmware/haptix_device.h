/* The device side of the wire protocol: a driver board's firmware without its board.
 *
 * Portable C99: no allocation, no calls to an operating system or a C library, no floating
 * point. The board's program owns one hx_device, hands it what arrives, sends what it answers,
 * and asks it for every output sample. It knows no clock but the samples it was asked for. Not
 * reentrant: a program that plays in an interrupt masks it around the other calls.
 */
#ifndef HAPTIX_DEVICE_H
#define HAPTIX_DEVICE_H

#include <stdint.h>

#include "haptix_wire.h"

/* What a board has memory for; a configuration may use less. */
#ifndef HX_MAX_FRAME_SAMPLES
#define HX_MAX_FRAME_SAMPLES 1024u
#endif
#ifndef HX_QUEUE_SAMPLES
#define HX_QUEUE_SAMPLES 4096u
#endif

#define HX_MAX_REPORT_BYTES 64u
#define HX_MAX_RATES 8u
#define HX_TOUCHES 8u
#define HX_MARKS 8u
/* Readings of the current that wait for the host, and those in a frame. */
#ifndef HX_READINGS
#define HX_READINGS 16u
#endif
#define HX_SENSE_READINGS 8u
/* Flags of a configuration. */
#define HX_SENDS_TOUCH 1u
#define HX_TAKES_MARK 2u
#define HX_TESTED 4u /* the board has tested itself at power-up, and all was well */
/* What reset the board, from bit 3 on: 0 unknown, 1 power, 2 its watchdog. */
#define HX_RESET_SHIFT 3u
/* Readings of the current a second, from bit 5 on: 0 none, then 250 doubled. The core sets it. */
#define HX_SENSE_SHIFT 5u

/* No board may be built to drive more, whatever its configuration says. */
#define HX_ABSOLUTE_CEILING_MV 200000u
/* 0.7 mA through the 150 pF of a body. */
#define HX_ABSOLUTE_SLEW_V_PER_S 4666666u
/* Over any second: 1.01 times the rms of a sine at 200 V, and a twentieth of the ceiling. */
#define HX_MAX_RMS_MV 142835u
#define HX_MEAN_DIVISOR 20u
/* Half a turn of the slowest carrier keeps the mean below 0.1 V. */
#define HX_MIN_CARRIER_MHZ 1000000u
#define HX_MAX_WATCHDOG_MS 160u

/* How long the output takes to 0 V after a fault, STOP or silence. */
#define HX_RAMP_MS 5u
#define HX_MIN_WATCHDOG_MS 10u
/* A waveform whose samples ran out is at 0 V after this long: it is held, then ramped. */
#define HX_DRY_MS 10u
/* Of the second that energy and mean are taken over: 0.8 % of either is the error. */
#define HX_WINDOW_BLOCKS 128u
#define HX_ENERGY_UNIT 4096u
/* The digital line is high for this long from the sample that was marked on. */
#define HX_MARK_MS 1u
/* Current through the person, measured beside that of the untouched panel: peak, rms, and that of
 * the capacitance of a body. */
#define HX_MAX_PEAK_NA 700000u
#define HX_MAX_RMS_NA 500000u
#define HX_BODY_PF 150u
/* At the ceiling, the most by which learning moves the panel's current, in phase or ahead. */
#define HX_LEARNED_NA 100000u
/* From this amplitude on a current is expected. */
#define HX_SENSE_LEAST_MV 10000u
/* A converter without samples is not believed after this long, and believed again after that. */
#define HX_SENSE_LATE_MS 5u
#define HX_SENSE_BACK_MS 500u
/* Without a finger for this long the panel is measured: touches are told late. */
#define HX_UNTOUCHED_MS 50u
/* The ramp after a measured excess: 0.25 ms. No carrier that is allowed is slower than it. */
#define HX_CUT 20u
/* A frame whose bytes pause for this long is given up. */
#define HX_PAUSE_MS 100u
/* What a received byte buys of check sums and copying; an ordinary frame needs less. */
#define HX_WORK_PER_BYTE 2u
/* Readings of the output in turn that are not what was sent: fewer are noise. */
#define HX_BAD_READINGS 8u
/* And at most this many times the longest frame, which is where it begins. */
#define HX_WORK_FRAMES 3u

#define HX_BUFFER_BYTES (HX_FRAME_OVERHEAD_BYTES + HX_REVISE_HEAD_BYTES + 2u * HX_MAX_FRAME_SAMPLES + 32u)
#define HX_ANSWER_BYTES (HX_FRAME_OVERHEAD_BYTES + HX_SENSE_READINGS * HX_READING_BYTES) /* longer than CAPABILITIES */

/* cffi: begin */
typedef struct {
    uint32_t sample_rate_hz;
    uint32_t modes; /* bit 0: waveform, bit 1: envelope */
} hx_rate;

typedef struct {
    uint32_t output_rate_hz;   /* 1000 to 1000000 */
    uint32_t full_scale_mv;    /* 1 to 1000000 */
    uint32_t ceiling_mv;       /* 1 to 200000 */
    uint32_t max_slew_v_per_s; /* with which 5 ms lead from the ceiling to 0 V, at most 4666666 */
    uint32_t queue_samples;
    uint16_t max_frame_samples; /* at most queue_samples */
    uint16_t max_watchdog_ms; /* 10 to 160 */
    uint16_t report_bytes; /* 0 or 8 to 64 */
    uint16_t flags;
    uint16_t rate_count;
    hx_rate rates[8]; /* each goes into the output rate 1 to 1024 times */
    char name[16];
    char serial[16];
    char calibration_id[16];
    /* Output samples, 1 to 65535: what the board plays at once and while it takes in a frame. A
     * revision begins at least this far ahead of the output. */
    uint32_t guard_ticks;
    /* A converter of the electrode's current; all 0 without one. */
    uint32_t sense_rate_hz;       /* readings a second: 250, 500, 1000, 2000 or 4000 */
    uint32_t sense_full_scale_na; /* current of code 32767, 100000 to 50000000 */
    uint32_t panel_pf;            /* the untouched panel, within a third: 100 to 100000 */
} hx_config;

typedef struct {
    uint64_t clock;
    uint32_t x_um;
    uint32_t y_um;
    uint16_t normal_force_mn;
    uint8_t contact;
    uint8_t phase;
} hx_touch;

/* What an output sample is: nothing, a sample of the stream, the last one held, the ramp; and,
 * added to it, whether the digital line is high. */
enum hx_output {
    HX_OUT_IDLE = 0,
    HX_OUT_STREAM = 1,
    HX_OUT_HELD = 2,
    HX_OUT_RAMP = 3,
    HX_OUT_LINE = 0x80
};

typedef struct hx_device hx_device;

/* For programs that cannot see the structure. */
uint32_t hx_device_bytes(void);

/* Return 1, or 0 for a configuration that describes no possible device. */
int hx_device_init(hx_device *device, const hx_config *config);

/* Bytes from the host, in pieces of any size. */
void hx_device_receive(hx_device *device, const uint8_t *bytes, uint32_t n);

/* One HID report from the host, its id first. */
void hx_device_receive_report(hx_device *device, const uint8_t *report, uint32_t n);

/* Write as many whole frames for the host as fit; return their bytes. */
uint32_t hx_device_transmit(hx_device *device, uint8_t *bytes, uint32_t capacity);

/* Write one HID report for the host; return its bytes, or 0 if there is nothing to say. */
uint32_t hx_device_transmit_report(hx_device *device, uint8_t *report, uint32_t capacity);

/* The next n output samples as codes, and (unless NULL) what each of them is, an hx_output. */
void hx_device_play(hx_device *device, int16_t *out, uint8_t *what, uint32_t n);

/* A finger on the panel; its clock is filled in. Return 0 if the host has not read the last ones. */
int hx_device_touch(hx_device *device, const hx_touch *touch);

/* The host has gone away: a bus reset, a closed connection. */
void hx_device_release(hx_device *device);

/* Output samples until the output has nothing left to play but zeros or a held sample. */
uint32_t hx_device_pending(const hx_device *device);

/* 0 if memory has gone bad: the output goes to 0 V and stays there until hx_device_init. A board
 * that resets then stops feeding its watchdog. */
int hx_device_is_whole(const hx_device *device);

/* For power-up, with the amplifier disabled. March C- over memory, which it leaves at 0: 1 if it is
 * well. Each limit tripped once on a device that is then as hx_device_init leaves it: 0 if all did,
 * or a bit for each HX_FAULT that did not come. Takes the time of two seconds of output samples. */
int hx_test_memory(void *memory, uint32_t bytes);
uint32_t hx_test_limits(hx_device *device, const hx_config *config);

/* Output samples, and what the board has measured of each at its output, as codes: when
 * HX_BAD_READINGS in turn differ by more than a tolerance, the core is no longer whole. */
void hx_device_read_back(hx_device *device, const int16_t *sent, const int16_t *found, uint32_t n,
                         int32_t tolerance);

/* What the converter measured of the current of each output sample, as codes at the left of 16 bits,
 * and how many output samples were played behind the last of them. */
void hx_device_sense(hx_device *device, const int16_t *sent, const int16_t *raw, uint32_t n,
                     uint32_t behind);

/* Bytes of a STATUS payload, for a board's own panel and for tests. */
void hx_device_status(const hx_device *device, uint8_t *payload);
/* Bytes of a FAULT payload: the first cause, with code 0 if there is none. */
void hx_device_fault(const hx_device *device, uint8_t *payload);
/* cffi: end */

typedef struct {
    uint8_t code;
    uint8_t field;
    uint16_t sequence;
    uint32_t expected;
    uint32_t got;
    uint64_t clock;
} hx_fault;

/* A sample of the stream to tell of, by the digital line and by a MARKED. */
typedef struct {
    uint64_t clock; /* all ones: the sample had been played when the MARK came */
    uint32_t index;
    uint16_t code;
    uint8_t is_due; /* to be told */
} hx_mark;

/* Output samples: their sum, the highest and lowest sum up to the last of them, the energy. */
typedef struct {
    int32_t sum;
    int32_t high;
    int32_t low;
    uint32_t energy; /* in HX_ENERGY_UNIT codes squared */
} hx_block;

/* The current over whole periods of the carrier. */
typedef struct {
    uint64_t clock; /* of its end */
    int32_t in_phase_na;
    int32_t ahead_na;
    int16_t driven; /* amplitude, as a code */
    uint16_t flags;
} hx_reading;

/* Sums over output samples: of the drive, of the current, and what of it is not the panel's. */
typedef struct {
    int64_t with_drive; /* the rest times drive, and times the drive a sample before */
    int64_t with_before;
    int64_t offset;
    uint64_t drive;
    uint64_t current;
    uint64_t rest;
    uint32_t rest_peak;
    uint32_t ticks;
    uint8_t is_saturated;
} hx_sums;

/* The converter and what is known by it. Ratios of current to drive in codes have 16 bits behind the point. */
typedef struct {
    hx_sums half; /* under way: between two changes of the drive's sign */
    hx_sums whole; /* of a reading: halves */
    uint64_t drive_before; /* of the half before, as its part ahead of the drive */
    int64_t ahead_before;
    int32_t sine;          /* of the carrier's step, in 1/32767 */
    int32_t cosine;
    int32_t panel;   /* ratio ahead that the untouched panel must have, by its capacitance */
    int32_t body;    /* and a body */
    int32_t in_phase; /* of the untouched panel as measured */
    int32_t ahead;
    int32_t first_in_phase; /* when it was first known */
    int32_t first_ahead;
    int32_t with_drive; /* those as factors of the drive and of the drive a sample before, times 2^shift */
    int32_t with_before;
    int32_t shift;
    uint32_t measured; /* readings of the panel, until it is known */
    uint32_t least;    /* mean square of the drive at which a current is expected */
    uint32_t fingers;  /* a bit each, 32 of them */
    uint32_t untouched_ticks;
    uint32_t well_ticks;
    uint32_t same_ticks; /* with the same code, in turn */
    uint32_t missing;    /* ticks of halves in turn */
    uint32_t too_much;   /* halves in turn */
    uint32_t lies;
    uint64_t heard;  /* clock behind the last sample that was measured, or of the playback's begin */
    int32_t offset;  /* of the converter */
    int16_t before;
    int16_t code; /* the converter's last one */
    uint8_t has_begun; /* a whole period after another begins with the next half */
    uint8_t doubt;
} hx_sensor;

struct hx_device {
    hx_config config;
    int16_t top_code; /* that of the hard ceiling */

    /* In force: lowered by SETUP, raised only by HELLO. */
    uint32_t ceiling_mv;
    uint32_t max_slew_v_per_s;
    uint8_t is_set_up;
    uint8_t mode;
    uint32_t sample_rate_hz;
    uint32_t ticks_per_sample;
    uint32_t phase_step;
    uint32_t carrier_rad_per_s;
    uint64_t slew_codes_per_s; /* whole codes in an output sample, times the output rate */
    int32_t step_codes;        /* those, of which no more than 65534 matter */
    int16_t ceiling_code;
    uint32_t watchdog_ms;
    uint32_t watchdog_ticks;
    uint32_t setup_lead_ticks;
    uint32_t status_ticks;
    uint32_t guard_samples; /* of the stream */

    uint8_t is_armed;
    uint8_t has_begun;  /* the first STREAM has come */
    uint8_t is_playing; /* its first sample has left the queue */
    uint8_t is_dry;
    uint16_t next_sequence;
    uint32_t next_index;
    int16_t last_queued;
    uint32_t lead_ticks;
    uint32_t silent_ticks;
    uint32_t since_status_ticks;
    uint32_t samples_played;
    uint16_t revisions; /* obeyed since ARM */
    uint16_t refused;   /* since ARM, without a fault */
    int32_t margin;     /* of the last REVISE: samples from the output to its first */

    /* Output: a line from one sample to the next, times the carrier. */
    int16_t from;
    int16_t to;
    int16_t level;
    uint32_t tick_of_sample;
    uint8_t has_carrier;
    uint32_t phase;
    /* Those of the stream on the output, which a SETUP does not touch. */
    uint32_t phase_step_now;
    int32_t step_codes_now;
    int16_t ceiling_code_now;
    int16_t code; /* the last output sample */
    int16_t ramp_from;
    uint32_t ramp_ticks_left;
    uint32_t ramp_step; /* 1, or HX_CUT */
    uint32_t ramp_ticks;
    uint32_t hold_ticks; /* a dry waveform is held this long, then its gain goes to 0 */
    uint32_t dry_ticks;
    uint32_t gain; /* 0 to ramp_ticks */

    /* The last second of the output: belongs to the driver, no session begins it anew. */
    hx_block block; /* under way */
    uint32_t block_at;
    uint32_t block_tick;
    uint32_t block_ticks;
    uint64_t energy_now;
    uint64_t energy_before;
    uint64_t max_energy;
    uint32_t ramp_energy;     /* of a ramp from a level of 1 */
    uint32_t half_turn_ticks; /* of the carrier on the output, and 2 */
    int64_t high_before;
    int64_t low_before;
    int64_t max_sum;
    uint32_t blocks_seal;

    uint64_t clock;
    uint32_t underruns;
    uint32_t faults;
    uint32_t token;
    hx_fault fault;

    uint8_t capabilities_due;
    uint8_t fault_due;
    uint8_t status_due;
    uint16_t answer_sequence;
    uint32_t answer_bytes; /* of a frame on its way in reports */
    uint32_t answer_sent;

    uint32_t touches;
    uint32_t readings;
    hx_sensor sensor;
    uint32_t marks;
    uint32_t line_ticks;
    uint32_t line_ticks_left; /* the line is high */

    uint32_t head;
    uint32_t queued;

    uint32_t pause_ticks;
    uint8_t has_paused; /* for too long: what was received is looked at again outside of play */
    uint8_t is_lost;    /* the window went bad, or the output is not what was sent */
    uint32_t bad_readings; /* in turn */
    uint32_t work;      /* what the receiver may still spend on what it holds */
    uint32_t awaited;   /* bytes of a frame whose header was checked; 0 if none was */
    uint32_t received;  /* bytes of a frame not yet whole */

    /* All above is sealed between calls; this has seals of its own or may go bad: haptix_seal.c. */
    hx_block blocks[HX_WINDOW_BLOCKS];
    uint32_t seal;
    uint32_t way_out[3]; /* each the last output sample, and the step of its slew */
    hx_touch touch[HX_TOUCHES];
    hx_mark mark[HX_MARKS];
    hx_reading reading[HX_READINGS];
    uint8_t answer[HX_ANSWER_BYTES];
    int16_t queue[HX_QUEUE_SAMPLES];
    uint8_t buffer[HX_BUFFER_BYTES];
};

#endif
