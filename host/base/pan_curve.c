#include "base/pan_curve.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

/* Position while standing: counted exactly; in motion latched to 1/65536 step. */
static const double latch_steps = 1.0 / 65536 / 3.4641;
/* Speeds of neighbouring stretches that differ by less are one speed: where their noise is to be
 * measured, and by so many sigmas of it where it is known. */
static const double same_speed = 2e-3, same_sigmas = 6;
static const double tick_s = 1e-6;                 /* steps and events are timed to it */
static const double uniform = 0.28867513459481287; /* sigma of a uniform distribution of width 1 */

static double span_s(const struct sweep_index *a, const struct sweep_index *b) {
    return (double)(b->t_controller_ns - a->t_controller_ns) * 1e-9;
}

static bool joined(const struct sweep_index *index, size_t count, size_t i) {
    return i + 1 < count && index[i].log == index[i + 1].log &&
           index[i + 1].t_controller_ns > index[i].t_controller_ns;
}

/* Mean speed of the stretch from i to i + 1; NaN: there is none. */
static double mean_speed(const struct sweep_index *index, size_t count, size_t i) {
    if (!joined(index, count, i))
        return (double)NAN;
    return (index[i + 1].pan_steps - index[i].pan_steps) / span_s(&index[i], &index[i + 1]);
}

/* Sigma of the mean speed of a stretch. */
static double speed_noise(double speed, double noise_steps, double time_s) {
    return 1.5 * (hypot(noise_steps, latch_steps) + fabs(speed) * tick_s) / time_s;
}

static bool same(double a, double b, double noise_steps_s) {
    return fabs(a - b) <= same_sigmas * noise_steps_s; /* false for NaN */
}

/* What is known of the speed at event i: from the stretch on the far side of it, if that keeps its
 * speed. */
static double speed_at(const struct sweep_index *index, size_t count, size_t i, bool left_is_far,
                       double noise_steps) {
    if (!index[i].pan_moving)
        return 0;
    size_t far = left_is_far ? i - 1 : i, beyond = left_is_far ? i - 2 : i + 1;
    if (left_is_far && i < 1)
        return (double)NAN;
    double v = mean_speed(index, count, far);
    double w = left_is_far && i < 2 ? (double)NAN : mean_speed(index, count, beyond);
    if (isnan(v) || isnan(w))
        return (double)NAN;
    double time_s =
        fmin(span_s(&index[far], &index[far + 1]), span_s(&index[beyond], &index[beyond + 1]));
    return same(v, w, speed_noise(v, noise_steps, time_s)) ? v : (double)NAN;
}

/* Speed by the parabola through three events around i. */
static double speed_by_three(const struct sweep_index *index, size_t count, size_t i) {
    double right = mean_speed(index, count, i);
    double left = i ? mean_speed(index, count, i - 1) : (double)NAN;
    if (isnan(left) || isnan(right))
        return isnan(left) ? right : left;
    double tl = span_s(&index[i - 1], &index[i]), tr = span_s(&index[i], &index[i + 1]);
    return (left * tr + right * tl) / (tl + tr);
}

static void tilt_of(const struct sweep_index *a, const struct sweep_index *b,
                    struct pan_curve *out) {
    double way = fabs(b->tilt_steps - a->tilt_steps);
    out->tilt0 = a->tilt_steps;
    out->tilt1 = b->tilt_steps;
    /* Tilt is logged in whole steps. If it moved, it was somewhere on its way. */
    bool moved = way > 0 || a->tilt_moving || b->tilt_moving;
    bool all_along = a->tilt_moving && b->tilt_moving;
    out->tilt_sigma_steps = !moved ? 0 : uniform * (all_along ? 1 : 1 + way);
}

static bool corner(struct pan_curve *c, const struct pan_curve_params *params) {
    double way = c->p1 - c->p0, dv = c->v1 - c->v0;
    if (isnan(c->v0) || isnan(c->v1) || fabs(dv) < 1e-9)
        return false;
    double at_s = (c->v1 * c->span_s - way) / dv;
    double slack_s = 3 * c->noise_steps / fabs(dv);
    if (at_s < -slack_s || at_s > c->span_s + slack_s)
        return false;
    c->corner_s = fmin(fmax(at_s, 0), c->span_s);
    c->half_max_s = fmin(c->corner_s, c->span_s - c->corner_s);
    c->half_s = 0.5 * c->half_max_s;
    if (params->acceleration_steps_s2 > 0) {
        double known_s = 0.5 * fabs(dv) / params->acceleration_steps_s2;
        c->half_s = fmin(known_s, c->half_max_s);
        c->half_max_s = 0;
    }
    return true;
}

bool pan_curve_make(const struct sweep_index *index, size_t count, size_t i,
                    const struct pan_curve_params *params, struct pan_curve *out_curve) {
    if (!joined(index, count, i))
        return false;
    const struct sweep_index *a = &index[i], *b = &index[i + 1];
    struct pan_curve c = {.span_s = span_s(a, b),
                          .p0 = a->pan_steps,
                          .p1 = b->pan_steps,
                          .noise_steps = params->noise_steps};
    tilt_of(a, b, &c);
    double mean = (c.p1 - c.p0) / c.span_s;
    double noise = speed_noise(mean, params->noise_steps, c.span_s);
    c.v0 = speed_at(index, count, i, true, params->noise_steps);
    c.v1 = speed_at(index, count, i + 1, false, params->noise_steps);
    bool like_left = i && same(mean, mean_speed(index, count, i - 1), noise);
    bool like_right = same(mean, mean_speed(index, count, i + 1), noise);
    if (!a->pan_moving && !b->pan_moving) {
        c.shape = c.p0 == c.p1 ? PAN_CURVE_STANDS : PAN_CURVE_UNKNOWN;
        c.v0 = c.v1 = mean;
    } else if (a->pan_moving && b->pan_moving &&
               (like_left || like_right || same(mean, c.v0, noise) || same(mean, c.v1, noise))) {
        c.shape = PAN_CURVE_LINE;
        c.v0 = c.v1 = mean;
    } else if (corner(&c, params)) {
        c.shape = PAN_CURVE_CORNER;
    } else {
        c.shape = PAN_CURVE_CUBIC;
        c.v0 = a->pan_moving ? speed_by_three(index, count, i) : 0;
        c.v1 = b->pan_moving ? speed_by_three(index, count, i + 1) : 0;
        if (isnan(c.v1))
            c.v1 = mean;
    }
    *out_curve = c;
    return true;
}

static void at_corner(const struct pan_curve *c, double t, struct pan_curve_point *p) {
    double dv = c->v1 - c->v0, s = t - c->corner_s, h = c->half_s;
    if (s <= -h) {
        p->pan_steps = c->p0 + c->v0 * t;
        p->pan_rate = c->v0;
    } else if (s >= h) {
        p->pan_steps = c->p1 - c->v1 * (c->span_s - t);
        p->pan_rate = c->v1;
    } else {
        p->pan_steps = c->p0 + c->v0 * t + dv * (s + h) * (s + h) / (4 * h);
        p->pan_rate = c->v0 + dv * (s + h) / (2 * h);
    }
    /* Between a sharp corner and the widest one. */
    double m = c->half_max_s;
    if (m > 0 && fabs(s) < m)
        p->pan_sigma_steps =
            hypot(p->pan_sigma_steps, uniform * fabs(dv) * (m - fabs(s)) * (m - fabs(s)) / (4 * m));
    /* Where the corner lies is as well known as the positions. */
    p->pan_sigma_steps = hypot(p->pan_sigma_steps, c->noise_steps);
}

static void at_cubic(const struct pan_curve *c, double t, struct pan_curve_point *p) {
    double x = t / c->span_s, y = 1 - x, way = c->p1 - c->p0;
    double r0 = c->v0 * c->span_s, r1 = c->v1 * c->span_s;
    double off = x * x * (3 - 2 * x) * way + x * y * y * r0 - x * x * y * r1;
    p->pan_steps = c->p0 + off;
    p->pan_rate =
        (6 * x * y * way + (1 - 4 * x + 3 * x * x) * r0 + (3 * x * x - 2 * x) * r1) / c->span_s;
    /* What it bends from the line, and how little the speeds fit the way; where it started or
     * stopped in between, nobody knows when. */
    double doubt = fabs(off - x * way) + x * y * fabs(0.5 * (r0 + r1) - way);
    if (c->v0 == 0 || c->v1 == 0)
        doubt = fmax(doubt, uniform * fabs(way));
    p->pan_sigma_steps = hypot(p->pan_sigma_steps, doubt);
}

struct pan_curve_point pan_curve_at(const struct pan_curve *curve, double t_s) {
    const struct pan_curve *c = curve;
    double t = fmin(fmax(t_s, 0), c->span_s), x = t / c->span_s, y = 1 - x;
    struct pan_curve_point p = {.pan_steps = c->p0 + x * (c->p1 - c->p0),
                                .pan_rate = c->v0,
                                .pan_sigma_steps =
                                    hypot(latch_steps, c->noise_steps) * sqrt(x * x + y * y),
                                .tilt_steps = c->tilt0 + x * (c->tilt1 - c->tilt0),
                                .tilt_sigma_steps = c->tilt_sigma_steps};
    if (c->shape == PAN_CURVE_STANDS)
        p.pan_sigma_steps = latch_steps;
    else if (c->shape == PAN_CURVE_CORNER)
        at_corner(c, t, &p);
    else if (c->shape == PAN_CURVE_CUBIC)
        at_cubic(c, t, &p);
    else if (c->shape == PAN_CURVE_UNKNOWN)
        p.pan_sigma_steps = hypot(p.pan_sigma_steps, uniform * fabs(c->p1 - c->p0));
    return p;
}

/* Second difference around event i where the pan keeps its speed, as the sigma of one position;
 * negative: it does not. */
static double position_noise(const struct sweep_index *index, size_t count, size_t i) {
    const struct sweep_index *a = &index[i - 1], *b = &index[i], *c = &index[i + 1];
    double left = mean_speed(index, count, i - 1), right = mean_speed(index, count, i);
    if (!a->pan_moving || !b->pan_moving || !c->pan_moving ||
        fabs(left - right) > same_speed * fmax(fabs(left), fabs(right)))
        return -1;
    double x = span_s(a, b) / span_s(a, c);
    double off = b->pan_steps - a->pan_steps - x * (c->pan_steps - a->pan_steps);
    return fabs(off) / sqrt(1 + x * x + (1 - x) * (1 - x));
}

double pan_curve_noise(const struct sweep_index *index, size_t count) {
    enum { OCTAVE = 16, OCTAVES = 40 }; /* 2^-30 to 2^10 steps */
    uint32_t bins[OCTAVE * OCTAVES] = {0}, n = 0, below = 0;
    for (int sweeps = 1; sweeps >= 0 && n < 8; sweeps--) { /* slews are quicker, and noisier */
        memset(bins, 0, sizeof bins);
        n = 0;
        for (size_t i = 1; i + 1 < count; i++) {
            double noise = sweeps && !index[i].sweep ? -1 : position_noise(index, count, i);
            if (noise < 0)
                continue;
            double octave = noise > 0 ? log2(noise) + 30 : 0;
            octave = fmin(fmax(octave, 0), OCTAVES - 0.01);
            bins[(int)(octave * OCTAVE)]++;
            n++;
        }
    }
    if (n < 8)
        return -1;
    int bin = 0;
    for (; 2 * (below + bins[bin]) < n; bin++)
        below += bins[bin];
    return 1.4826 * exp2((bin + 0.5) / OCTAVE - 30); /* the median of a normal scatter */
}
