/* Samples and look-ups of haptix: plain functions on arrays that the caller owns.
 *
 * They keep nothing, allocate nothing and call nothing back. Numbers that are not finite pass
 * through to what is computed from them; they never become an index. */
#ifndef HAPTIX_NATIVE_H
#define HAPTIX_NATIVE_H

#include <stdint.h>

/* Fingers that an engine follows, and the most control points of a block; a board has fewer. */
#ifndef HX_POINTS
#define HX_FINGERS 10
#define HX_POINTS 240
#endif

/* cffi: begin */
/* Cells between increasing nodes; see haptix.model.surface.axes.Cells. */
typedef struct {
    double start, per_width;
    int64_t places, cells, steps;
    const int32_t *guide;                  /* [places] */
    const double *upper, *scale, *offset; /* [cells] */
} hx_cells;

/* A friction surface; see haptix.model.surface.interpolant.Interpolant. */
typedef struct {
    int64_t axes;              /* that vary, 0 to 3 */
    hx_cells axis[3];          /* of their logarithms, */
    double lowest[3], highest[3]; /* and where each ends */
    hx_cells drive;
    int64_t width;         /* of a column */
    const double *columns; /* [...][width]: -1/mu at each node of the drive; what follows is not read */
    const double *ends;    /* [...][2]: logarithms of pull-in and breakdown voltage */
    double unit_v, limit_v, last_drive, pull_in_drive;
    int64_t limited_by;
} hx_surface;

/* Friction and status at n voltages, and at logarithms of places on the axes that vary. */
void hx_surface_evaluate(const hx_surface *surface, const double *voltage_v,
                         const double *const *log_place, int64_t n, double *mu, int64_t *status);

/* The effect of attractions that widen contact spots, as polynomials of the rise ln p_A/p0 at nodes of
 * ln p_A; see haptix.model.electro.attraction_table.WideningBranches. */
typedef struct {
    double start, step;              /* ln p_A [Pa] of the first node, and from node to node */
    int64_t nodes, powers;           /* of ln p_A and of the rise */
    const double *effect;            /* [columns][powers][3][nodes]: ln I, ln of the gaps' share, lift */
    double least_rise, largest_rise; /* where the polynomials hold */
    double log_widest;               /* ln of the largest p_A over applied pressure and gaps' pull */
    double flattest, steepest;       /* bounds of the slope of ln of that sum */
    int64_t by_contact;              /* whether each contact gets a row of its own, without powers */
} hx_widening;

/* Equilibria of n states at p0 [Pa] and ln of the largest applied pressure and gaps' pull of light
 * contact; with `of_end` the strengths are shares of those at which that ends. `row` is room for 7
 * rows of nodes. I of the gaps and the lift are those at the pressures. */
void hx_widening_branches(const hx_widening *widening, int64_t n, const int64_t *column,
                          const double *applied_pa, const double *log_limit, const double *strength,
                          int64_t of_end, double *row, double *pressure_pa, double *strength_at_end,
                          uint8_t *is_stable, double *gaps, double *lift);

/* Waves against w = ln(q/q0 - 1), and the panels of an integral over them; see WavesIntegral of
 * haptix.model.contact.tables. */
typedef struct {
    int64_t cells;
    const double *nodes;  /* [cells + 1] of w */
    const double *lines;  /* [cells][4]: intercept and slope of ln T and of ln(dT/dw / (2 q E*)) */
    const int32_t *hints; /* [cells]: a cell at or before each of as many even parts of the nodes */
    double per_hint;
    int64_t panels;
    const double *ends;    /* [panels] in w */
    const int32_t *points; /* [panels] */
    const double *rules;   /* [sum of points][2]: points and weights */
    int64_t j_nodes;
    const double *cubics; /* [j_nodes - 1][4]: ln J in each cell of ln y */
    double start, end, per_step; /* of ln y; from the end on J is 0 */
    double growth;               /* of J per 1/y before the start */
    double least;                /* tau over pressure at which J is 0 */
} hx_waves;

/* Integrals of n contacts at pressures and variances, each from a w = low on. */
void hx_over_waves(const hx_waves *waves, int64_t n, const double *pressure, const double *variance,
                   const double *low, double *total);

/* A surface at one frequency and thickness; see haptix.model.surface.interpolant.Slice. */
typedef struct {
    int64_t forces, drives;
    const double *log_force; /* [forces] */
    const double *drive;     /* [drives] */
    const double *columns;   /* [forces][drives + 2] */
    double unit_v, limit_v, pull_in_drive, lowest_n, highest_n;
    int64_t limited_by;
} hx_slice;

/* Lowest and highest friction at n forces. */
void hx_slice_reach(const hx_slice *slice, const double *force_n, int64_t n, double *lowest_mu,
                    double *highest_mu);

/* Friction at n forces and amplitudes; above a column's end, that of the end. */
void hx_slice_friction(const hx_slice *slice, const double *force_n, const double *amplitude_v,
                       int64_t n, double *mu);

/* How numbers of a texture become samples; see haptix.play.render.samples.RenderCore. */
typedef struct {
    int64_t target;      /* 0: friction, 1: contrast, 2: share of the reachable range */
    int64_t compresses;  /* whether numbers from span_low to span_high fill the range */
    double span_low, span_high;
    int64_t combination; /* of fingers, 0: the strongest, 1: the first, 2: their mean */
    double most_v, most_step_v;
    int64_t step;        /* samples from one point to the next */
    int64_t joined;      /* points over which what is queued is joined */
} hx_rendering;

/* What a block is rendered from. Arrays of fingers * points go finger after finger. */
typedef struct {
    int64_t fingers, points;
    const double *value;     /* [fingers * points] of the texture */
    const double *force_n;   /* [fingers * points] */
    const double *gain;      /* [fingers * points] */
    const double *intensity; /* [points]; NULL: 1 */
    const double *added;     /* [fingers * points] shares of the reachable range; NULL: 0 */
    const hx_slice *less;    /* how friction is inverted: by one slice, */
    const hx_slice *more;    /* or if not NULL by a blend of two, */
    double part;             /* with this part of the second, */
    const double *parts;     /* or if not NULL with these, [points] */
    double before_v;         /* amplitude before the block */
    const double *queued_v;  /* [queued] amplitudes at its last points, to be joined */
    int64_t queued;
    const double *wave;      /* [period] of 1 V */
    int64_t period, phase;   /* sample of the wave at the first sample */
    double idle_v;           /* amplitude without fingers */
} hx_block;

/* Render a block, and write its numbers one after the other: friction asked for [fingers * points],
 * amplitude [points], drive [points * step]; and the status of each friction. */
void hx_render(const hx_rendering *rendering, const hx_block *block, double *numbers,
               int8_t *status);

/* One resolution of a map; see haptix.feel.materials.pyramid. */
typedef struct {
    const double *values; /* [rows][columns][channels] */
    int64_t columns;
    double per_mm, column, row;
    double low_x, high_x, low_y, high_y;
} hx_level;

typedef struct {
    const hx_level *levels; /* [count], from the finest on */
    int64_t count, channels;
    double period_x_mm, period_y_mm; /* 0: does not repeat */
    double farthest_mm, outside;
} hx_map;

/* Values at n places, [n][channels], at one depth, or where depths is not NULL at one for each. A
 * depth of 1.5 is half way between the levels 1 and 2. */
void hx_map_sample(const hx_map *map, const double *x_mm, const double *y_mm, double depth,
                   const double *depths, int64_t n, double *values);
/* How touches are followed; see haptix.play.touch.TouchSettings. */
typedef struct {
    double latency_s, lost_after_s, blend_s, fade_s;
} hx_following;

/* One finger from a time on, as its reports until then predict it. */
typedef struct {
    double reported_s;
    double x_mm, y_mm, vx_mm_s, vy_mm_s;  /* at the report, */
    double ax_mm_s2, ay_mm_s2, lasting_s; /* with an acceleration that decays */
    double normal_force_n;
    double start_s;                       /* from when on it is so predicted */
    double dx_mm, dy_mm, df_n;            /* what was played less the prediction, at that time */
    double gain;                          /* share of its amplitude that it gets, at that time */
    double moves_s;                       /* from the start on, without a report; then it rests */
    double rests_s, rest_x_mm, rest_y_mm; /* when, and where */
    int64_t is_down, is_sliding;
} hx_track;

/* Place and velocity that are predicted for a time: x, y, vx, vy. */
void hx_finger_place(const hx_following *following, const hx_track *track, double t_s,
                     double *place);

/* Share of its amplitude that a finger gets at a time; with `at_rest` where it rests, too. */
double hx_finger_gain(const hx_following *following, const hx_track *track, int64_t at_rest,
                      double t_s);

/* Let a finger be as its reports until now predict it, from t0_s on. What has been played since
 * `before` decays into that; NULL: it is new. */
void hx_finger_update(const hx_following *following, hx_track *track, const hx_track *before,
                      int64_t at_rest, double t0_s);

/* Fingers that get drive at t0_s + step_s * (1 ... points), of `count`: their number n. Write x, y,
 * force and gain, each [n][points]; [points] weights; of each finger, [3][n]: its velocities, and
 * which it is; and the speed of the fastest. */
int64_t hx_fingers(const hx_following *following, const hx_track *tracks, int64_t count,
                   double t0_s, double step_s, int64_t points, int64_t at_rest, double *numbers);

/* A line through knots at increasing times, at t0_s + step_s * (1 ... points); level beyond. */
void hx_line(const double *knot_s, const double *knot, int64_t knots, double t0_s, double step_s,
             int64_t points, double *values);

/* A pyramid is a map with its coarser levels; see haptix.feel.materials.pyramid. */
enum { HX_LEVELS = 32 };

/* How a map goes on beyond its edges. */
enum { HX_OUTSIDE = 0, HX_HOLD = 1, HX_REPEAT = 2 };

/* Numbers that each channel of the levels of a map takes up, and how many levels there are. */
int64_t hx_pyramid_size(int64_t rows, int64_t columns, int64_t beyond_x, int64_t beyond_y,
                        int64_t *levels);

/* Where the numbers of a row of the map begin, [columns][channels]: the caller writes them. */
double *hx_pyramid_row(double *numbers, int64_t columns, int64_t channels, int64_t beyond_x,
                       int64_t beyond_y, int64_t row);

/* Make the levels of the map whose rows are written. Outside, all channels but the first are 0. */
void hx_pyramid_make(int64_t rows, int64_t columns, int64_t channels, double pixel_mm,
                     double outside, int64_t beyond_x, int64_t beyond_y, hx_level *levels,
                     double *numbers);

/* What is felt, by its kind; docs/program.md describes the kinds. */
typedef struct {
    int64_t kind, target, of; /* the material that this one changes; -1: none */
    double outside, cosine, sine, low, high;
    int64_t numbers; /* detents, corners, knots, values; periods of a grating */
    const double *number;
    hx_map map; /* of a relief: its channels are the slopes to the right, and down */
    double pixel_mm, sharp_mm, width_mm, height_mm; /* of the map; inner and outer of a dial */
    double ramp_mm;                                 /* ridge of a control, edge of a relief */
    double bias;
    int64_t wave; /* of a grating */
    double period_mm, phase, duty;
    double about_x_mm, about_y_mm;
    double rate[3]; /* of what moves: along x, along y, turn */
    int64_t loops;
    double first, rate_hz, period_s; /* of a curve in time: its first value, and 0 or its period */
    int64_t begins;                  /* 0: with the first sample, else 1 + an event */
    double press_n, release_n;
} hx_material;

/* Numbers of a grating at n places, at one footprint, or where footprints is not NULL at one for
 * each. */
void hx_grating_sample(const hx_material *material, const double *x_mm, const double *y_mm,
                       double footprint_mm, const double *footprints_mm, int64_t n, double *value);

/* An engine plays a program of a touch; docs/program.md has its format. It lies in memory of the
 * caller, has no other state, and allocates nothing. */
typedef struct hx_engine hx_engine;

/* Why a program is refused; these are below 0. */
enum {
    HX_NO_PROGRAM = -1,   /* it does not begin as one, or is not whole */
    HX_OTHER_VERSION = -2,
    HX_DAMAGED = -3,      /* another checksum */
    HX_WRONG_NUMBER = -4, /* a place, a size or a number that cannot be */
    HX_TOO_LARGE = -5
};

/* Bytes of memory that the engine of a program needs, or why it is refused. */
int64_t hx_engine_size(const uint8_t *program, int64_t size);

/* Make the engine of a program that hx_engine_size accepts, in memory of that size that is aligned
 * for a double. The program is not needed any more. */
hx_engine *hx_engine_open(const uint8_t *program, int64_t size, void *memory);

/* The same for a program that may take over maps of another engine, whose memory must then stay. */
int64_t hx_engine_size_after(const uint8_t *program, int64_t size, const hx_engine *before);
hx_engine *hx_engine_open_after(const uint8_t *program, void *memory, const hx_engine *before);

/* What a block was made of, until the next one: arrays that go finger after finger. */
typedef struct {
    int64_t fingers, points, step;
    double sample_rate_hz, highest_v;
    int64_t first_sample;
    const double *x_mm, *y_mm, *force_n; /* [fingers * points] */
    const double *wanted_mu, *felt_mu;   /* [fingers * points] */
    const int8_t *status;                /* [fingers * points] haptix.model.status.Status */
    const double *amplitude_v;           /* [points] */
    const double *drive_v;               /* [points * step] */
} hx_felt;

/* Take a report of a finger at a time on the clock of samples; 0 if it is dropped. A force that
 * no finger has, such as 0, stands for one that is not measured. News counts from the next block
 * on. */
int64_t hx_engine_touch(hx_engine *engine, int64_t touch_id, double t_s, double x_mm, double y_mm,
                        double force_n, int64_t is_down);

/* Play the next control points, 1 to HX_POINTS. */
const hx_felt *hx_engine_block(hx_engine *engine, int64_t points);

/* What a finger did on a material, as haptix.feel.motion.Facts: times are NaN until it happens. */
enum { HX_DOWN = 0, HX_PRESS = 1, HX_RELEASE = 2, HX_DETENT = 3, HX_EVENTS = 4 };

typedef struct {
    double since_s;         /* from when on these hold */
    double time_s[4], detent; /* of each event; number of the last detent */
} hx_facts;

/* Facts of one finger in the order of time, `stride` apart. */
typedef struct {
    const hx_facts *first;
    int64_t count, stride;
} hx_history;

/* Fingers during a block; arrays of fingers * points go finger after finger. */
typedef struct {
    int64_t fingers, points; /* 0 to HX_FINGERS, 1 to HX_POINTS */
    const double *x_mm, *y_mm, *vx_mm_s, *vy_mm_s, *force_n;
    double footprint_mm;    /* the way of the fastest from one point to the next */
    double step_s, start_s; /* time between points, and one step before the first */
    const int8_t *force_known;  /* [fingers] whether it was measured; NULL: of all */
    const hx_history *history;  /* [fingers]; NULL: nothing has happened */
} hx_motion;

/* The same for fingers in a given motion, with the share of its amplitude that each gets. */
const hx_felt *hx_engine_play(hx_engine *engine, const hx_motion *motion, const double *gain);

/* Play points from a sample on, after an amplitude: on, or again. Only with `news` do reports count,
 * from there on. `queued_v` are the amplitudes that were to be played at these points, into which
 * the last ones blend; NULL: none. Reports that come later change what happens from `playable_s`. */
const hx_felt *hx_engine_window(hx_engine *engine, int64_t first_sample, int64_t points,
                                double before_v, const double *queued_v, int64_t news);
void hx_engine_playable(hx_engine *engine, double playable_s);

/* An effect adds a material's numbers to the friction of all fingers; see
 * haptix.play.render.master.PlayingEffect. Times are those of the scene. */
typedef struct {
    hx_engine *of; /* plays nothing: its background is the material */
    double start_s, end_s, fade_start_s, fade_end_s; /* it fades out from one to the other */
    uint8_t *felt; /* [felts] whether a finger felt it, for each HX_FELT_S from its start on */
    int64_t felts;
} hx_effect;

/* What is common to all fingers; see haptix.play.render.master. The intensity goes along a line
 * from one time of samples to another. The clock of the scene is that of samples less the time for
 * which it stood; where `stands_s` is no NaN, it stands there. Without it: 1, and the same clock. */
typedef struct {
    double before, after, start_s, end_s, stood_s, stands_s;
    const hx_effect *effect; /* [effects], which the caller keeps */
    int64_t effects;
} hx_mix;
void hx_engine_mix(hx_engine *engine, const hx_mix *mix);

/* How a region glides to its place and opacity in the program, by the clock of the scene; see
 * haptix.feel.layout.region_state.RegionState. A program alone has all regions at rest. */
typedef struct {
    double place[4], place_start_s, place_end_s; /* from a corner, an angle and a scale */
    double opacity, opacity_start_s, opacity_end_s;
    double inner[4];         /* axes of its material within it, the same four */
    double way[4], core[4];  /* left, right, top, bottom: it stays within, and covers, in the glide */
    int64_t is_level;        /* whether it covers its whole box */
    int64_t key, state;      /* which region it is; facts of another state of its material */
} hx_glide;
void hx_engine_glide(hx_engine *engine, int64_t region, const hx_glide *glide);

/* Let an engine go on where another one is that plays at the same rate: with its fingers, and with
 * their facts on the regions of the same keys, which the first call looks for. */
void hx_engine_match(hx_engine *engine, const hx_engine *before);
void hx_engine_follow(hx_engine *engine, const hx_engine *before);

/* An engine as the source of a driver's queue, any stretch of which is played again after a report;
 * see haptix.play.render.live.RenderSource and the hx_source of firmware_io. Times are the host's. */
typedef struct hx_live hx_live;
int64_t hx_live_bytes(void);
void hx_live_init(hx_live *live, hx_engine *engine, double reaction_s);
void hx_live_window(void *live, int64_t first, int64_t count, double at_s, int64_t is_revision,
                    double *volts);
void hx_live_settle(void *live, int64_t obeyed, int64_t undone);
void hx_live_played(void *live, int64_t index);
void hx_live_report(void *live, int64_t touch_id, int64_t is_down, double arrival_s, double t_s,
                    double x_mm, double y_mm, double force_n);
int64_t hx_live_is_live(void *live);

/* Take a mix in any thread; the next window has it. */
void hx_live_mix(hx_live *live, const hx_mix *mix);

/* Take an engine in any thread, with a mix; the next window is its first. */
void hx_live_adopt(hx_live *live, hx_engine *engine, const hx_mix *mix);

/* Whether an engine plays, or will. The memory of others may be freed. */
int64_t hx_live_needs(hx_live *live, const hx_engine *engine);

/* Whether the last mix has been taken over. Then the effects of those before may be freed. */
int64_t hx_live_has_taken(hx_live *live);

/* What was rendered, again or not: samples, those of all fingers by the status of their friction,
 * and the largest amplitude. */
typedef struct {
    int64_t samples, status[16];
    double most_v;
} hx_live_counts;
void hx_live_count(hx_live *live, hx_live_counts *counts);
/* cffi: end */

/* Whether a finger is on the screen or fades out, and the rate and step of the program. */
int64_t hx_engine_is_touched(const hx_engine *engine);
void hx_engine_rate(const hx_engine *engine, double *sample_rate_hz, int64_t *step);

/* Time that each number of an effect's `felt` stands for; as haptix.play.render.master. */
#define HX_FELT_S 1e-3

/* No finger is farther from the corner of a screen; as haptix.feel.motion.FARTHEST_MM. */
#define HX_FARTHEST_MM 1e6

/* As haptix.feel.materials.as_mu. */
double hx_as_mu(int64_t target, double value, double lowest, double highest);

#endif
