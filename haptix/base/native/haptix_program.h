/* A program of a touch as an engine keeps it; docs/program.md has the format of the file. */
#ifndef HAPTIX_PROGRAM_H
#define HAPTIX_PROGRAM_H

#include <math.h>

#include "haptix_native.h"
#include "haptix_touch.h"

/* The second where they cannot be compared. Without a call, as fmin and fmax have in WebAssembly. */
static inline double hx_least(double a, double b) { return a < b ? a : b; }
static inline double hx_most(double a, double b) { return a > b ? a : b; }

/* Of a vector in millimetres: no square overflows, as hypot takes care that none does. */
static inline double hx_length(double x, double y) { return sqrt(x * x + y * y); }

enum {
    KIND_UNIFORM = 0, KIND_MAP = 1, KIND_GRATING = 2, KIND_SLIDER = 3, KIND_TOGGLE = 4,
    KIND_DIAL = 5, KIND_RELIEF = 6, KIND_BY_SPEED = 7, KIND_BY_FORCE = 8, KIND_CURVE = 9,
    KIND_MOVING = 10, KIND_BUTTON = 11
};
enum { WAVE_SINE = 0, WAVE_SQUARE = 1, WAVE_SAWTOOTH = 2 };
enum { TARGET_MU = 0, TARGET_CONTRAST = 1, TARGET_SHARE = 2 };
enum { SHAPE_RECTANGLE = 0, SHAPE_ELLIPSE = 1, SHAPE_POLYGON = 2 };
enum { BLEND_OVER = 0, BLEND_ADD = 1, BLEND_MULTIPLY = 2, BLEND_MAX = 3, BLEND_MIN = 4 };
enum { MOST_TABLES = 12, MOST_NESTED = 8, HX_SEEN_ROWS = 4 };

typedef struct {
    int64_t material, mask; /* -1: none */
    int64_t shape, blend, priority, corners;
    const double *corner_mm; /* [corners][2] */
    double x_mm, y_mm, angle_rad, scale, width_mm, height_mm, opacity;
    hx_glide glide;
    int64_t facts, facts_before; /* region whose facts are its own, in this engine and in the one before; -1: none */
    int64_t forgets;             /* whether those are of another state of its material */
} hx_region;

typedef struct {
    hx_rendering rendering;
    hx_following following;
    hx_slice slice;
    hx_touching touching;
    double sample_rate_hz, assumed_n;
    int64_t drives_at_rest, is_layout;
    int64_t period, materials, regions, background;
    const double *wave;
    const hx_material *material;
    hx_region *region; /* the lowest first */
} hx_program;

/* Numbers of the period of a grating with 0, 1, 2, 4, ... harmonics. */
int64_t hx_table_size(int64_t table);

/* Bytes of memory of the contents of a program, or why it is refused. It may take over maps of the
 * one `before`, if that is not NULL. */
int64_t hx_program_size(const uint8_t *bytes, int64_t size, const hx_program *before);

/* Depth to which materials that move lie in each other. */
int64_t hx_program_depth(const uint8_t *bytes);

/* Whether what is felt depends on what a finger did before. */
int64_t hx_program_recalls(const uint8_t *bytes);

/* Take over the contents of a program that hx_program_size accepts, into memory of that size. */
void hx_program_read(const uint8_t *bytes, hx_program *program, uint8_t *memory,
                     const hx_program *before);

/* Numbers of a material under fingers; `rows` is room for HX_SEEN_ROWS rows of numbers for each
 * material that moves, one in another. */
void hx_feel(const hx_program *program, int64_t material, const hx_motion *on, double *rows,
             double *value);

/* Whether a material drives a finger that rests. */
int hx_feels_rest(const hx_program *program, int64_t material);

/* A report of a finger in the axes of a material; its force is NaN if it was not measured. */
typedef struct {
    double t_s, x_mm, y_mm, force_n;
    int64_t is_down;
} hx_touched;

/* Change the facts of a finger by a report; `before` is NULL where it has just come down. */
void hx_react(const hx_program *program, int64_t material, hx_facts *facts,
              const hx_touched *before, const hx_touched *now);

#endif
