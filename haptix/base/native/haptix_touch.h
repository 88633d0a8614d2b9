/* How one touch is followed; see haptix.play.touch. */
#ifndef HAPTIX_TOUCH_H
#define HAPTIX_TOUCH_H

#include "haptix_native.h"

/* Reports that are kept, so that a late one is put in its place. A small machine keeps fewer. */
#ifndef HX_REPORTS
#define HX_REPORTS 64
#endif

enum { HX_MODEL = 12 };

/* Parameters of haptix.play.touch.InteractingSinger and TouchSettings. */
typedef struct {
    double acceleration_mm_s2, acceleration_per_speed_hz, correlation_s, position_noise_mm;
    double first_speed_mm_s, noise_reports, gentle, stay;
    double slide_above_mm_s, rest_below_mm_s, turn_above_mm_s, turn_s, slide_smoothing_s;
    double reorder_s, least_interval_s, lost_after_s;
} hx_touching;

typedef struct {
    double t_s, mean[HX_MODEL], variance, reports, weight, gentle[HX_MODEL], agile[HX_MODEL];
    double recent[15]; /* the last reports: time, x, y */
    int64_t recents;
} hx_filtered;

/* A report, and the state after it. One that jumps is held, with the state of the last one that
 * counts. */
typedef struct {
    double t_s, x_mm, y_mm;
    double used_t_s, used_x_mm, used_y_mm; /* of the report that counts */
    hx_filtered filtered;
    double slow_vx, slow_vy, slow_speed, moved_s, interval_s;
    int64_t is_sliding, is_held, jumps, number, used;
} hx_report;

typedef struct {
    hx_report history[HX_REPORTS], now;
    int64_t first, count, numbers, late, is_latest;
    double interval_s, late_t_s;
} hx_tracker;

/* Follow a touch from its first report on; the interval is that of the touch before. */
void hx_tracker_start(const hx_touching *settings, hx_tracker *tracker, double interval_s,
                      double t_s, double x_mm, double y_mm);

/* Take a report; 0 if it does not count. `is_latest` tells whether it is the newest. */
int64_t hx_tracker_push(const hx_touching *settings, hx_tracker *tracker, double t_s, double x_mm,
                        double y_mm);

/* Predict the touch from `start_s` of the track on. */
void hx_tracker_follow(const hx_touching *settings, const hx_tracker *tracker, hx_track *track);

#endif
