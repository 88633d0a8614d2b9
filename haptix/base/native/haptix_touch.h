/* How one touch is followed; see haptix.play.touch. */
#ifndef HAPTIX_TOUCH_H
#define HAPTIX_TOUCH_H

#include "haptix_native.h"

/* Reports that are kept, so that a late one is put in its place. A small machine keeps fewer. */
#ifndef HX_REPORTS
#define HX_REPORTS 64
#endif

/* cffi: begin */
/* Filters of a place; see haptix.play.touch.filters. */
enum { HX_TWO_SINGERS = 0, HX_SINGER = 1, HX_WHITE_ACCELERATION = 2, HX_ONE_EURO = 3 };
enum { HX_MODEL = 12, HX_PARAMETERS = 8 };

/* Of TouchSettings, and the parameters of its filter in the order of its class. */
typedef struct {
    double own[HX_PARAMETERS];
    double slide_above_mm_s, rest_below_mm_s, turn_above_mm_s, turn_s, slide_smoothing_s;
    double reorder_s, least_interval_s, lost_after_s;
    int64_t filter;
} hx_touching;

/* The state of a filter: the mean of its models, and each of two. A model is x, y, vx, vy, ax, ay
 * and the covariance of an axis xx, xv, xa, vv, va, aa; of HX_ONE_EURO, whose have no covariance,
 * `agile` begins with the smoothed velocity. */
typedef struct {
    double t_s, mean[HX_MODEL], variance, reports, weight, gentle[HX_MODEL], agile[HX_MODEL];
    double recent[15]; /* the last reports: time, x, y */
    int64_t recents;
} hx_filtered;

void hx_filter_start(const hx_touching *settings, double t_s, double x_mm, double y_mm,
                     hx_filtered *state);
void hx_filter_step(const hx_touching *settings, hx_filtered *state, double t_s, double x_mm,
                    double y_mm);

/* Follows a touch. */
typedef struct hx_tracker hx_tracker;
int64_t hx_tracker_bytes(void);

/* Follow a touch from its first report on; the interval is that of the touch before. */
void hx_tracker_start(const hx_touching *settings, hx_tracker *tracker, double interval_s,
                      double t_s, double x_mm, double y_mm);
double hx_tracker_interval_s(const hx_tracker *tracker);

/* What became of a report: whether it counts, and is the newest; whether it replaced another one,
 * was put before a later one, jumped, came too late, or showed that the clock has jumped. */
enum {
    HX_TAKEN = 1, HX_LATEST = 2, HX_COALESCED = 4, HX_REORDERED = 8, HX_JUMPED = 16, HX_LATE = 32,
    HX_CLOCK_JUMPED = 64
};

/* Take a report; return what became of it. */
int64_t hx_tracker_push(const hx_touching *settings, hx_tracker *tracker, double t_s, double x_mm,
                        double y_mm);

/* Predict the touch from its last report on. */
void hx_tracker_follow(const hx_touching *settings, const hx_tracker *tracker, hx_track *track);
/* cffi: end */

/* A report, and the state after it. One that jumps is held, with the state of the last one that
 * counts. */
typedef struct {
    double t_s, x_mm, y_mm;
    double used_t_s, used_x_mm, used_y_mm; /* of the report that counts */
    hx_filtered filtered;
    double slow_vx, slow_vy, slow_speed, moved_s, interval_s;
    int64_t is_sliding, is_held, jumps, number, used;
} hx_report;

struct hx_tracker {
    hx_report history[HX_REPORTS], now;
    int64_t first, count, numbers, late;
    double interval_s, late_t_s;
};

#endif
