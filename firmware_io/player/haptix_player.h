/* Plays a source in C to a driver, without the interpreter of the program that owns it.
 *
 * It does what firmware_io/reviser.py does with a source in Python: it keeps the driver's queue
 * filled to the horizon and revises it after a report of a finger. The owner has armed the driver,
 * and calls `hx_player_run` in a thread that it lets go of. The samples pass the host's checks of
 * haptix_host.h before they are sent. However it ends, the driver is sent STOP, unless the link is
 * lost; then the driver's watchdog ends the output.
 */
#ifndef HAPTIX_PLAYER_H
#define HAPTIX_PLAYER_H

#include <stdint.h>

#include "../firmware/haptix_host.h"

/* cffi: begin */
/* What the owner, or a process to which it has given the pipe, writes there; in one piece. */
enum hx_report_kind { HX_ALIVE = 0, HX_FINGER = 1, HX_CHANGED = 2, HX_QUIT = 3, HX_MARK_NEXT = 4 };

typedef struct {
    int32_t kind;
    int32_t touch_id; /* of HX_MARK_NEXT: its code */
    int32_t is_down;
    int32_t reserved;
    double arrival_s, t_s, x_mm, y_mm; /* by the host's clock, CLOCK_MONOTONIC */
    double force_n;                    /* 0: not measured */
} hx_report;

/* Before a frame of the driver: when it came, and how many bytes it has. */
typedef struct {
    double at_s;
    int64_t bytes;
} hx_told;

/* Makes the samples of any stretch of a stream, as firmware_io.Source. */
typedef struct {
    void *of;
    void (*window)(void *of, int64_t first, int64_t count, double at_s, int64_t is_revision,
                   double *volts);
    void (*settle)(void *of, int64_t obeyed, int64_t undone);
    void (*played)(void *of, int64_t index);
    void (*report)(void *of, int64_t touch_id, int64_t is_down, double arrival_s, double t_s,
                   double x_mm, double y_mm, double force_n);
    int64_t (*is_live)(void *of);
} hx_source;

/* Two bulk endpoints, by libusb_bulk_transfer and its handle of the device. */
typedef struct {
    int (*transfer)(void *handle, unsigned char endpoint, unsigned char *data, int length, int *moved,
                    unsigned timeout_ms); /* NULL: the link is a file descriptor */
    void *handle;
    int32_t outward, inward;
} hx_bulk;

/* What the owner has agreed with the driver. Counts are in samples, times in seconds. */
typedef struct {
    int32_t link, reports; /* file descriptors; both are read without waiting */
    int32_t told; /* each frame of the driver is written there at once, as hx_told and its bytes */
    int64_t report_bytes; /* of HID; 0: the descriptor carries a stream of bytes */
    hx_bulk bulk; /* takes what is sent; hx_bulk_read brings what comes to `link` */
    int64_t grid, frame, revised, piece, least, horizon, most_ahead;
    double rate_hz, output_rate_hz, bytes_per_s; /* 0: the link has no rate of its own */
    double reaction_s, guard_s, least_interval_s, watchdog_s;
    double quiet_s; /* without HX_ALIVE for so long, it ends */
    double most_v, most_step_v, full_scale_v;
    int32_t top_code, version;
    uint32_t sequence;               /* of the next frame */
    uint32_t queued, free, underruns; /* of the driver's last report */
    const void *limits; /* hx_host_limits */
    void *window;       /* hx_host_window of the output until now */
} hx_player_setup;

/* Why it has ended. */
enum hx_outcome {
    HX_PLAYS = 0,
    HX_STOPPED = 1, /* by HX_QUIT, or all ends of the pipe are closed */
    HX_OVER_SAMPLE = 2, /* a sample over the ceiling or the slew */
    HX_OVER_WINDOW = 3, /* energy, mean or current: `verdict` of hx_host_check */
    HX_IN_FAULT = 4,    /* the driver's: `fault` is the payload of its FAULT */
    HX_LOST = 5,        /* the link: `error` is its errno, or 0 if the driver has closed it */
    HX_SILENT = 6,      /* the driver has reported nothing within its watchdog time */
    HX_QUIET = 7        /* the owner */
};

enum { HX_REACTIONS = 1024, HX_MARKS_KEPT = 1024 };

typedef struct {
    int64_t sent, bytes_sent, frames_sent;
    int64_t underruns, revisions, refused, late_samples;
    double longest_stall_s, last_v;
    double began_s; /* when sample 0 was played, by the host's clock, as if without a gap */
    int64_t reactions, windows; /* that were measured; the last ones are kept, in a ring */
    double reaction_s[1024];
    double window_s[1024]; /* time that the source took to make one */
    int32_t outcome, error, verdict;
    uint32_t sample;   /* of the piece that a limit refuses */
    double found;      /* the sum that is too large */
    uint32_t sequence; /* of the next frame */
    uint8_t fault[20];
} hx_player_counts;

typedef struct hx_player hx_player;

int64_t hx_player_bytes(void);

/* 0 if a number does not fit, or this platform has no such links. */
int64_t hx_player_init(hx_player *player, const hx_player_setup *setup, const hx_source *source);

/* Play until it ends; return why. It waits for the link and the pipe. */
int64_t hx_player_run(hx_player *player);

/* Read a bulk endpoint, in a thread of its own, and write what comes to a file descriptor, until the
 * endpoint fails or `is_over` is set. Return an error of errno.h, or 0. */
int64_t hx_bulk_read(const hx_bulk *bulk, int64_t to, const volatile int32_t *is_over);

/* Copy the counters, in any thread; those of the last step while it plays. */
void hx_player_count(hx_player *player, hx_player_counts *to);
/* cffi: end */

#endif
