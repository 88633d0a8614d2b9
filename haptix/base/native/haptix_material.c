/* What materials ask for under fingers; see the classes of haptix.feel.materials. */
#include <math.h>
#include <stddef.h>

#include "haptix_program.h"

enum { CHUNK = 64 };

static const double two_pi = 6.283185307179586;
static const double slow_mm_s = 2.0;   /* as haptix.feel.motion.block.SLOW_MM_PER_S */
static const double side_bands = 1.4;  /* as haptix.feel.materials.by_curve.SIDE_BANDS */

static double clipped(double value, double low, double high)
{
    return value > low ? (value < high ? value : high) : low; /* low for NaN */
}

static int is_near(double x_mm, double y_mm)
{
    return fabs(x_mm) <= HX_FARTHEST_MM && fabs(y_mm) <= HX_FARTHEST_MM; /* false for NaN */
}

static double scaled(const hx_material *m, double level) { return m->low + (m->high - m->low) * level; }

/* Direction along x or y: 0 at rest, and smooth. */
static double unit(double v_mm_s, double speed_mm_s) { return v_mm_s / hx_length(speed_mm_s, slow_mm_s); }

/* First of increasing numbers that is above a value, or not below it with `or_equal`. */
static int64_t above(const double *number, int64_t count, double value, int or_equal)
{
    int64_t first = 0, end = count;
    while (first < end) {
        int64_t middle = first + (end - first) / 2;
        if (number[middle] < value || (!or_equal && number[middle] == value))
            first = middle + 1;
        else
            end = middle;
    }
    return first;
}

/* A line through corners, level beyond them. */
static double line_at(const double *corner, const double *value, int64_t count, double at)
{
    int64_t next = above(corner, count, at, 0);
    if (next == 0 || next == count)
        return value[next == 0 ? 0 : count - 1];
    double slope = (value[next] - value[next - 1]) / (corner[next] - corner[next - 1]);
    return slope * (at - corner[next - 1]) + value[next - 1];
}

/* Maps and gratings. */

static double map_depth(double footprint_mm, double pixel_mm)
{
    double wide = footprint_mm / pixel_mm;
    if (!(wide > 0.5))
        return 0.0;
    double depth = log2(wide);
    return depth >= 1.0 ? depth : depth < 0.0 ? depth + 1.0 : 1.0;
}

static void feel_map(const hx_material *m, const hx_motion *on, double *value)
{
    double depth = map_depth(on->footprint_mm, m->pixel_mm), half = m->sharp_mm / 2;
    int is_sharp = m->sharp_mm > 0.0 && on->footprint_mm == 0.0;
    int64_t n = on->fingers * on->points;
    double x[CHUNK], y[CHUNK];
    for (int64_t from = 0; from < n; from += CHUNK) {
        int64_t count = n - from < CHUNK ? n - from : CHUNK;
        for (int64_t i = 0; i < count; i++) {
            double x_mm = on->x_mm[from + i], y_mm = on->y_mm[from + i];
            double across = x_mm * m->cosine + y_mm * m->sine;
            double down = y_mm * m->cosine - x_mm * m->sine;
            if (is_sharp) { /* at a point the edge is a step; the map has a ramp there */
                if (!(across >= 0.0 && across <= m->width_mm && down >= 0.0 &&
                      down <= m->height_mm))
                    across = INFINITY;
                else {
                    across = hx_least(hx_most(across, half), m->width_mm - half);
                    down = hx_least(hx_most(down, half), m->height_mm - half);
                }
            }
            x[i] = across;
            y[i] = down;
        }
        hx_map_sample(&m->map, x, y, depth, NULL, count, value + from);
    }
}

static void feel_relief(const hx_material *m, const hx_motion *on, double *value)
{
    double depth = map_depth(on->footprint_mm, m->pixel_mm), ramp = hx_most(m->ramp_mm, 1e-9);
    int64_t n = on->fingers * on->points;
    double slope[2 * CHUNK];
    for (int64_t from = 0; from < n; from += CHUNK) {
        const double *x = on->x_mm + from, *y = on->y_mm + from;
        int64_t count = n - from < CHUNK ? n - from : CHUNK;
        hx_map_sample(&m->map, x, y, depth, NULL, count, slope);
        for (int64_t i = 0; i < count; i++) {
            double vx = on->vx_mm_s[from + i], vy = on->vy_mm_s[from + i], speed = hx_length(vx, vy);
            double uphill = slope[2 * i] * unit(vx, speed) + slope[2 * i + 1] * unit(vy, speed);
            double level = 0.5 * clipped(uphill, -1.0, 1.0);
            double inside_mm = hx_least(hx_least(x[i], m->width_mm - x[i]), hx_least(y[i], m->height_mm - y[i]));
            value[from + i] = scaled(m, level + m->bias * clipped(inside_mm / ramp, 0.0, 1.0));
        }
    }
}

/* One period of a grating, of `size` numbers, at a place from 0 to 1. */
static double read_table(const double *table, int64_t size, double place)
{
    double at = place * (double)size;
    int64_t cell = (int64_t)at, next = cell + 1;
    double part = at - (double)cell;
    cell = cell < size ? cell : cell - size; /* rounding may reach the end of the period */
    next = next < size ? next : next - size;
    return part * (table[next] - table[cell]) + table[cell];
}

static double wave_at(const hx_material *m, double place)
{
    if (m->wave == WAVE_SQUARE)
        return place < m->duty ? m->high : m->low;
    double level = m->wave == WAVE_SINE ? sin(two_pi * place) : 2 * place - 1;
    return (m->low + m->high) / 2 + (m->high - m->low) / 2 * level;
}

void hx_grating_sample(const hx_material *m, const double *x_mm, const double *y_mm,
                       double footprint_mm, const double *footprints_mm, int64_t n, double *value)
{
    const double *table = m->number;
    int64_t number = 0, size = hx_table_size(0);
    double depth = 0.0, last = (double)(m->numbers - 1), before_mm = 0.0;
    for (int64_t i = 0; i < n; i++) {
        double wide_mm = footprints_mm ? footprints_mm[i] : footprint_mm;
        if (!is_near(x_mm[i], y_mm[i])) {
            value[i] = m->outside;
            continue;
        }
        double place = (x_mm[i] * m->cosine + y_mm[i] * m->sine) / m->period_mm + m->phase;
        place -= floor(place);
        if (!(wide_mm > 0.0)) {
            value[i] = wave_at(m, place);
            continue;
        }
        if (wide_mm != before_mm) {
            double room = m->period_mm / (2 * wide_mm);
            depth = hx_least(log2(room > 1.0 ? room : 1.0), last);
            table = m->number;
            for (number = 0; number < (int64_t)depth; number++)
                table += hx_table_size(number);
            size = hx_table_size(number);
            before_mm = wide_mm;
        }
        double part = depth - (double)number;
        value[i] = read_table(table, size, place);
        if (part > 0.0) {
            double next = read_table(table + size, hx_table_size(number + 1), place);
            value[i] += part * (next - value[i]);
        }
    }
}

/* Controls. */

/* A raised cosine; where the drive cannot follow it, wider and lower with the same area. */
static double ridge(double distance_mm, double width_mm, double footprint_mm)
{
    double width = hx_most(width_mm, 4 * footprint_mm);
    double part = clipped(fabs(distance_mm) / width, 0.0, 0.5);
    return width_mm / width * (0.5 + 0.5 * cos(two_pi * part));
}

static void feel_slider(const hx_material *m, const hx_motion *on, double *value)
{
    const double *place = m->number;
    int64_t last = m->numbers - 1;
    for (int64_t i = 0; i < on->fingers * on->points; i++) {
        double along = on->x_mm[i] * m->cosine + on->y_mm[i] * m->sine;
        /* The two tops beside the detent that is below it. */
        int64_t below = above(place, m->numbers, along, 0) - 1;
        below = below < 0 ? 0 : below >= last ? last - 1 : below;
        double away = INFINITY;
        for (int64_t k = below - 1; k <= below + 1; k++)
            if (k >= 0 && k < last)
                away = hx_least(away, fabs(along - (place[k] + place[k + 1]) / 2));
        double beyond = hx_most(place[0] - along, along - place[last]);
        double wall = clipped(beyond / m->ramp_mm, 0.0, 1.0);
        value[i] = scaled(m, hx_most(ridge(away, m->ramp_mm, on->footprint_mm), wall));
    }
}

static double toggle_rise(const hx_material *m, double past_mm, double footprint_mm)
{
    double fall_mm = hx_most(m->ramp_mm, 4 * footprint_mm);
    return clipped(1 + past_mm / m->height_mm, 0.0, 1.0) * clipped(1 - past_mm / fall_mm, 0.0, 1.0);
}

static void feel_toggle(const hx_material *m, const hx_motion *on, double *value)
{
    for (int64_t i = 0; i < on->fingers * on->points; i++) {
        double vx = on->vx_mm_s[i], along = unit(vx, hx_length(vx, on->vy_mm_s[i]));
        double past_mm = on->x_mm[i] - m->width_mm / 2;
        double right = toggle_rise(m, past_mm, on->footprint_mm) * hx_most(along, 0.0);
        double left = toggle_rise(m, -past_mm, on->footprint_mm) * hx_most(-along, 0.0);
        value[i] = scaled(m, right + left);
    }
}

static void feel_dial(const hx_material *m, const hx_motion *on, double *value)
{
    double detents = (double)m->numbers, ramp = hx_most(m->ramp_mm, 4 * on->footprint_mm);
    for (int64_t i = 0; i < on->fingers * on->points; i++) {
        double x = on->x_mm[i] - m->about_x_mm, y = on->y_mm[i] - m->about_y_mm;
        double radius = hx_length(x, y);
        double turn = atan2(y, x) * (detents / two_pi) - 0.5;
        double way = (turn - rint(turn)) * radius * (two_pi / detents);
        double depth = hx_least(radius - m->width_mm, m->height_mm - radius);
        double within = clipped(0.5 + depth / ramp, 0.0, 1.0);
        value[i] = scaled(m, within * ridge(way, m->ramp_mm, on->footprint_mm));
    }
}

/* Materials that change another one, by speed, force, time or motion. */

static void multiply(const hx_program *p, const hx_material *m, const hx_motion *on, double *rows,
                     double *value)
{
    hx_motion wider = *on;
    wider.footprint_mm *= side_bands;
    if (m->of >= 0)
        hx_feel(p, m->of, &wider, rows, value);
    else
        for (int64_t i = 0; i < on->fingers * on->points; i++)
            value[i] = 1.0;
}

static void feel_by_curve(const hx_program *p, const hx_material *m, const hx_motion *on,
                          double *rows, double *value)
{
    multiply(p, m, on, rows, value);
    for (int64_t i = 0; i < on->fingers * on->points; i++) {
        double at = m->kind == KIND_BY_FORCE ? on->force_n[i]
                                             : hx_length(on->vx_mm_s[i], on->vy_mm_s[i]);
        value[i] *= line_at(m->number, m->number + m->numbers, m->numbers, at);
    }
}

/* A curve at a time since its beginning; NaN: it has not begun. */
static double curve_at(const hx_material *m, double age_s)
{
    if (m->period_s > 0.0) {
        age_s = fmod(age_s, m->period_s);
        age_s += age_s < 0.0 ? m->period_s : 0.0;
    }
    double last = (double)(m->numbers - 1), at = clipped(age_s * m->rate_hz - m->first, 0.0, last);
    int64_t cell = (int64_t)at;
    double low = m->number[cell], part = at - (double)cell;
    return part > 0.0 ? part * (m->number[cell + 1] - low) + low : low;
}

/* Facts of a finger at a time. */
static const hx_facts *facts_at(const hx_motion *on, int64_t finger, double t_s)
{
    static const hx_facts nothing = {0, {NAN, NAN, NAN, NAN}, NAN};
    if (on->history) {
        const hx_history *history = &on->history[finger];
        for (int64_t i = history->count - 1; i >= 0; i--)
            if (history->first[i * history->stride].since_s <= t_s)
                return &history->first[i * history->stride];
    }
    return &nothing;
}

static void feel_curve(const hx_program *p, const hx_material *m, const hx_motion *on, double *rows,
                       double *value)
{
    multiply(p, m, on, rows, value);
    for (int64_t i = 0; i < on->fingers * on->points; i++) {
        double t_s = on->start_s + on->step_s * (double)(i % on->points + 1), began_s = 0.0;
        if (m->begins)
            began_s = facts_at(on, i / on->points, t_s)->time_s[m->begins - 1];
        value[i] *= curve_at(m, t_s - began_s);
    }
}

/* Buttons. */

static const double edge_mm = 0.3, rises_from = 0.3; /* as haptix.feel.materials.controls */
static const double drop_s = 1e-3, low_s = 0.03, rise_s = 0.1;

static double inside_mm(const hx_material *m, double x_mm, double y_mm)
{
    return hx_least(hx_least(x_mm, m->width_mm - x_mm), hx_least(y_mm, m->height_mm - y_mm));
}

static double dropped(double since_s) { return clipped(1 - since_s / drop_s, 0.0, 1.0); }

static double risen(double since_s) { return clipped((since_s - low_s) / rise_s, 0.0, 1.0); }

/* Level of the face: by force until it is pressed, then by the time since that. */
static double pressing(const hx_facts *facts, double t_s, double by_force)
{
    double press_s = facts->time_s[HX_PRESS], release_s = facts->time_s[HX_RELEASE];
    if (t_s - press_s >= 0.0 && !(release_s >= press_s))
        return hx_most(dropped(t_s - press_s), risen(t_s - press_s));
    if (t_s - release_s >= 0.0)
        return hx_most(dropped(t_s - release_s), by_force * risen(t_s - release_s));
    return by_force;
}

static void feel_button(const hx_material *m, const hx_motion *on, double *value)
{
    double ramp = hx_most(edge_mm, 4 * on->footprint_mm), start = rises_from * m->press_n;
    for (int64_t i = 0; i < on->fingers * on->points; i++) {
        int64_t finger = i / on->points;
        double t_s = on->start_s + on->step_s * (double)(i % on->points + 1);
        double depth = inside_mm(m, on->x_mm[i], on->y_mm[i]);
        double inside = clipped(0.5 + depth / ramp, 0.0, 1.0);
        double face = clipped(0.5 + (depth - m->ramp_mm) / ramp, 0.0, 1.0);
        double speed = hx_length(on->vx_mm_s[i], on->vy_mm_s[i]), by_force = 0.0;
        if (!on->force_known || on->force_known[finger])
            by_force = clipped((on->force_n[i] - start) / (m->press_n - start), 0.0, 1.0);
        double pressed = pressing(facts_at(on, finger, t_s), t_s, by_force);
        value[i] = scaled(m, hx_most((inside - face) * unit(speed, speed), face * pressed));
    }
}

/* How far a material has moved and turned at a time, and how fast: x, y, angle. */
static void moved_at(const hx_material *m, double t_s, double *place, double *rate)
{
    const double *knot = m->number;
    int64_t last = m->numbers - 1;
    for (int k = 0; k < 3; k++) {
        place[k] = m->rate[k] * t_s;
        rate[k] = m->rate[k];
    }
    if (last < 1)
        return;
    if (m->loops)
        t_s = fmod(t_s, knot[last]);
    double inside_s = clipped(t_s, 0.0, knot[last]);
    int64_t cell = above(knot, m->numbers, t_s, 0) - 1;
    cell = cell < 0 ? 0 : cell >= last ? last - 1 : cell;
    for (int k = 0; k < 3; k++) {
        const double *at = knot + (k + 1) * m->numbers + cell;
        double slope = (at[1] - at[0]) / (knot[cell + 1] - knot[cell]);
        place[k] += at[0] + slope * (inside_s - knot[cell]);
        rate[k] += inside_s == t_s ? slope : 0.0;
    }
}

/* A place in the axes of a material that has moved. */
static void seen_at(const hx_material *m, const double *moved, double *x_mm, double *y_mm)
{
    double c = cos(moved[2]), s = sin(moved[2]);
    double dx = *x_mm - (moved[0] + m->about_x_mm), dy = *y_mm - (moved[1] + m->about_y_mm);
    *x_mm = dx * c + dy * s + m->about_x_mm;
    *y_mm = dy * c - dx * s + m->about_y_mm;
}

static void feel_moving(const hx_program *p, const hx_material *m, const hx_motion *on, double *rows,
                        double *value)
{
    int64_t n = on->fingers * on->points;
    double *x = rows, *y = x + n, *vx = y + n, *vy = vx + n, fastest = 0.0;
    for (int64_t i = 0; i < n; i++) {
        double place[3], rate[3];
        moved_at(m, on->start_s + on->step_s * (double)(i % on->points + 1), place, rate);
        double c = cos(place[2]), s = sin(place[2]);
        double dx = on->x_mm[i] - (place[0] + m->about_x_mm);
        double dy = on->y_mm[i] - (place[1] + m->about_y_mm);
        double along = on->vx_mm_s[i] - rate[0] + rate[2] * dy;
        double down = on->vy_mm_s[i] - rate[1] - rate[2] * dx;
        x[i] = on->x_mm[i];
        y[i] = on->y_mm[i];
        seen_at(m, place, &x[i], &y[i]);
        vx[i] = along * c + down * s;
        vy[i] = down * c - along * s;
        fastest = hx_most(fastest, hx_length(vx[i], vy[i]));
    }
    hx_motion seen = *on;
    seen.x_mm = x;
    seen.y_mm = y;
    seen.vx_mm_s = vx;
    seen.vy_mm_s = vy;
    seen.footprint_mm = on->footprint_mm > 0.0 ? fastest * on->step_s : 0.0;
    hx_feel(p, m->of, &seen, rows + HX_SEEN_ROWS * n, value);
}

void hx_feel(const hx_program *p, int64_t material, const hx_motion *on, double *rows, double *value)
{
    const hx_material *m = &p->material[material];
    switch (m->kind) {
    case KIND_MAP: feel_map(m, on, value); break;
    case KIND_GRATING:
        hx_grating_sample(m, on->x_mm, on->y_mm, on->footprint_mm, NULL, on->fingers * on->points,
                          value);
        break;
    case KIND_SLIDER: feel_slider(m, on, value); break;
    case KIND_TOGGLE: feel_toggle(m, on, value); break;
    case KIND_DIAL: feel_dial(m, on, value); break;
    case KIND_RELIEF: feel_relief(m, on, value); break;
    case KIND_BY_SPEED:
    case KIND_BY_FORCE: feel_by_curve(p, m, on, rows, value); break;
    case KIND_CURVE: feel_curve(p, m, on, rows, value); break;
    case KIND_MOVING: feel_moving(p, m, on, rows, value); break;
    case KIND_BUTTON: feel_button(m, on, value); break;
    default:
        for (int64_t i = 0; i < on->fingers * on->points; i++)
            value[i] = m->outside;
    }
}

int hx_feels_rest(const hx_program *p, int64_t material)
{
    while (p->material[material].of >= 0)
        material = p->material[material].of;
    return p->material[material].kind == KIND_BUTTON;
}

/* What a finger did. */

static const double hysteresis = 0.05; /* of the pitch, past a ridge's top */

/* Place along the detents, in detents. */
static double detent_at(const hx_material *m, double x_mm, double y_mm)
{
    if (m->kind == KIND_TOGGLE)
        return hx_least(hx_most(0.5 + (x_mm - m->width_mm / 2) / m->height_mm, 0.0), 1.0);
    if (m->kind == KIND_DIAL)
        return atan2(y_mm - m->about_y_mm, x_mm - m->about_x_mm) * (double)m->numbers / two_pi;
    double along = x_mm * m->cosine + y_mm * m->sine;
    int64_t next = above(m->number, m->numbers, along, 0);
    if (next == 0 || next == m->numbers)
        return next == 0 ? 0.0 : (double)(m->numbers - 1);
    double low = m->number[next - 1];
    return (along - low) / (m->number[next] - low) + (double)(next - 1);
}

static double modulo(double value, double of)
{
    double rest = fmod(value, of);
    return rest < 0.0 ? rest + of : rest;
}

static double detents_between(const hx_material *m, double before, double now)
{
    double turn = (double)m->numbers, half = turn / 2;
    return m->kind == KIND_DIAL ? modulo(now - before + half, turn) - half : now - before;
}

/* Count a detent as crossed when the finger has passed the ridge before it. */
static void react_control(const hx_material *m, hx_facts *facts, const hx_touched *before,
                          const hx_touched *now)
{
    if (!now->is_down)
        return;
    double place = detent_at(m, now->x_mm, now->y_mm);
    if (isnan(facts->detent)) {
        facts->detent = rint(place);
        return;
    }
    double away = detents_between(m, facts->detent, place), steps = rint(away), at_s = now->t_s;
    if (!(fabs(away) >= 0.5 + hysteresis))
        return;
    if (before) { /* when it passed the top of the last ridge */
        double was = detent_at(m, before->x_mm, before->y_mm);
        double start = detents_between(m, facts->detent, was);
        double top = steps > 0.0 ? steps - 0.5 : steps + 0.5;
        double part = away != start ? (top - start) / (away - start) : 1.0;
        at_s = before->t_s + hx_least(hx_most(part, 0.0), 1.0) * (now->t_s - before->t_s);
    }
    facts->detent += steps;
    if (m->kind == KIND_DIAL)
        facts->detent = modulo(facts->detent, (double)m->numbers);
    facts->time_s[HX_DETENT] = at_s;
}

/* When the force went through a value between two reports; NaN if it did not. */
static double crossing(const hx_touched *before, const hx_touched *now, double force_n)
{
    if (!before || isnan(before->force_n))
        return NAN;
    double first = before->force_n - force_n, last = now->force_n - force_n;
    if (first * last > 0.0 || first == last || first == 0.0)
        return NAN;
    return before->t_s + (now->t_s - before->t_s) * first / (first - last);
}

static int is_on_face(const hx_material *m, const hx_touched *at)
{
    return inside_mm(m, at->x_mm, at->y_mm) >= m->ramp_mm;
}

static void react_button(const hx_material *m, hx_facts *facts, const hx_touched *before,
                         const hx_touched *now)
{
    double *press_s = &facts->time_s[HX_PRESS], *release_s = &facts->time_s[HX_RELEASE];
    int is_pressed = !isnan(*press_s) && !(*release_s >= *press_s);
    if (isnan(now->force_n) || !now->is_down || !is_on_face(m, now)) {
        if (is_pressed)
            *release_s = now->t_s;
        return;
    }
    double at_s = crossing(before, now, is_pressed ? m->release_n : m->press_n);
    if (is_pressed) {
        if (!isnan(at_s) && !(now->force_n > m->release_n))
            *release_s = at_s;
    } else if (now->force_n >= m->press_n) {
        if (!before)
            *press_s = now->t_s;
        else if (is_on_face(m, before) && (isnan(before->force_n) || !isnan(at_s)))
            *press_s = isnan(before->force_n) ? now->t_s : at_s;
    }
}

static hx_touched moved_report(const hx_material *m, hx_touched report)
{
    double place[3], rate[3];
    moved_at(m, report.t_s, place, rate);
    seen_at(m, place, &report.x_mm, &report.y_mm);
    return report;
}

void hx_react(const hx_program *p, int64_t material, hx_facts *facts, const hx_touched *before,
              const hx_touched *now)
{
    hx_touched then, here = *now;
    const hx_material *m = &p->material[material];
    if (before)
        then = *before;
    for (; m->of >= 0; m = &p->material[m->of])
        if (m->kind == KIND_MOVING) {
            here = moved_report(m, here);
            if (before)
                then = moved_report(m, then);
        }
    before = before ? &then : NULL;
    if (m->kind == KIND_BUTTON)
        react_button(m, facts, before, &here);
    else if (m->kind == KIND_SLIDER || m->kind == KIND_TOGGLE || m->kind == KIND_DIAL)
        react_control(m, facts, before, &here);
}
