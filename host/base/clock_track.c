#include "base/clock_track.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double ns_s_per_ppm = 1000;
/* The likelihood remembers so many pairs: a crystal warms up in minutes. */
static const double memory_pairs = 400;
/* As many pairs as this is the word of the stated sigmas worth. */
static const double prior_pairs = 4;
/* Walk of the rate of the stillest model, (ns/s)^2 a second: 0.001 ppm in a second. */
static const double stillest = 1, half_decade = 3.1622776601683795;

static double walk_of(unsigned model) {
    double q = stillest;
    for (unsigned i = 0; i < model; i++)
        q *= half_decade;
    return q;
}

static double scale_of(const struct clock_track_model *m) {
    return (m->sum_z2 + prior_pairs) / (m->n + prior_pairs);
}

static void carry(struct clock_track_model *m, double dt_s, double q) {
    double t = fabs(dt_s), sign = dt_s < 0 ? -1 : 1;
    m->d_ns += m->rate_ns_s * dt_s;
    m->p_dd += 2 * dt_s * m->p_dr + dt_s * dt_s * m->p_rr + q * t * t * t / 3;
    m->p_dr += dt_s * m->p_rr + sign * q * t * t / 2;
    m->p_rr += q * t;
}

/* One pair; gives the innovation and its variance in units of the scale. */
static void absorb(struct clock_track_model *m, double seen_ns, double variance, double *out_off,
                   double *out_variance) {
    double off = seen_ns - m->d_ns, s = m->p_dd + variance;
    double kd = m->p_dd / s, kr = m->p_dr / s, keep = 1 - kd;
    m->d_ns += kd * off;
    m->rate_ns_s += kr * off;
    m->p_rr -= kr * m->p_dr;
    m->p_dd = keep * keep * m->p_dd + kd * kd * variance; /* Joseph's form stays positive */
    m->p_dr *= keep;
    *out_off = off;
    *out_variance = s;
}

void clock_track_start(struct clock_track *track, int64_t from_ns, int64_t to_ns, double sigma_ns,
                       double max_drift_ppm) {
    memset(track, 0, sizeof *track);
    track->at_ns = from_ns;
    track->base_ns = to_ns - from_ns;
    track->rate_limit_ns_s = max_drift_ppm * ns_s_per_ppm;
    track->best = CLOCK_TRACK_MODELS / 2;
    track->used = 1;
    for (unsigned i = 0; i < CLOCK_TRACK_MODELS; i++) {
        track->model[i].p_dd = sigma_ns * sigma_ns;
        track->model[i].p_rr = track->rate_limit_ns_s * track->rate_limit_ns_s;
    }
}

static void choose(struct clock_track *track) {
    double most = -INFINITY;
    for (unsigned i = 0; i < CLOCK_TRACK_MODELS; i++) {
        const struct clock_track_model *m = &track->model[i];
        double likely = -0.5 * ((m->n + prior_pairs) * log(scale_of(m)) + m->sum_log);
        if (likely > most) {
            most = likely;
            track->best = i;
        }
    }
}

void clock_track_update(struct clock_track *track, int64_t from_ns, int64_t to_ns,
                        double sigma_ns) {
    double dt_s = (double)(from_ns - track->at_ns) * 1e-9;
    double seen = (double)(to_ns - from_ns - track->base_ns), variance = sigma_ns * sigma_ns;
    for (unsigned i = 0; i < CLOCK_TRACK_MODELS; i++) {
        struct clock_track_model *m = &track->model[i];
        double off, s, limit = 9 * scale_of(m);
        carry(m, dt_s, walk_of(i));
        absorb(m, seen, variance, &off, &s);
        if (track->used < 2) /* the first two tell what the state is, not how good the model is */
            continue;
        double forget = 1 - 1 / memory_pairs, z2 = off * off / s;
        m->n = forget * m->n + 1;
        m->sum_z2 = forget * m->sum_z2 + fmin(z2, limit);
        m->sum_log = forget * m->sum_log + log(s / variance);
    }
    track->at_ns = from_ns;
    track->used++;
    choose(track);
}

double clock_track_scale(const struct clock_track *track) {
    return sqrt(scale_of(&track->model[track->best]));
}

struct clock_track_state clock_track_at(const struct clock_track *track, int64_t from_ns) {
    struct clock_track_model m = track->model[track->best];
    double scale = scale_of(&m), dt_s = (double)(from_ns - track->at_ns) * 1e-9;
    struct clock_track_state state = {
        .at_ns = from_ns, .base_ns = track->base_ns, .walk = walk_of(track->best) * scale};
    carry(&m, dt_s, walk_of(track->best));
    state.d_ns = m.d_ns;
    state.rate_ns_s = m.rate_ns_s;
    state.sigma_ns = sqrt(scale * m.p_dd);
    state.rate_sigma = sqrt(scale * m.p_rr);
    return state;
}

int64_t clock_track_apply(const struct clock_track_state *state, int64_t from_ns,
                          double *out_sigma_ns) {
    double dt_s = (double)(from_ns - state->at_ns) * 1e-9, t = fabs(dt_s);
    if (out_sigma_ns)
        *out_sigma_ns =
            sqrt(state->sigma_ns * state->sigma_ns +
                 dt_s * dt_s * state->rate_sigma * state->rate_sigma + state->walk * t * t * t / 3);
    return from_ns + state->base_ns + (int64_t)llround(state->d_ns + state->rate_ns_s * dt_s);
}

int64_t clock_track_invert(const struct clock_track_state *state, int64_t to_ns,
                           double *out_sigma_ns) {
    int64_t from_ns = to_ns - state->base_ns - (int64_t)llround(state->d_ns);
    for (int i = 0; i < 3; i++) /* the rate is 1 within 1e-3: each step gains three digits */
        from_ns += to_ns - clock_track_apply(state, from_ns, NULL);
    (void)clock_track_apply(state, from_ns, out_sigma_ns);
    return from_ns;
}

double clock_track_innovation(const struct clock_track *track, int64_t from_ns, int64_t to_ns,
                              double sigma_ns, double *out_sigma_ns) {
    struct clock_track_state state = clock_track_at(track, from_ns);
    double pair = clock_track_scale(track) * sigma_ns;
    *out_sigma_ns = sqrt(state.sigma_ns * state.sigma_ns + pair * pair);
    return (double)(to_ns - from_ns - state.base_ns) - state.d_ns;
}

/* ---- both ways ---- */

struct step { /* after the pair, and as predicted before it */
    double d, r, p_dd, p_dr, p_rr;
    double pd, pr, pp_dd, pp_dr, pp_rr;
};

static void forward(const struct clock_track_pairs *pairs, const struct clock_track *first,
                    double q, struct step *steps) {
    struct clock_track_model m = first->model[0];
    for (size_t i = 0; i < pairs->count; i++) {
        struct step *s = &steps[i];
        double off, variance = pairs->sigma_ns[i] * pairs->sigma_ns[i];
        if (i) {
            carry(&m, (double)(pairs->from_ns[i] - pairs->from_ns[i - 1]) * 1e-9, q);
            *s = (struct step){
                .pd = m.d_ns, .pr = m.rate_ns_s, .pp_dd = m.p_dd, .pp_dr = m.p_dr, .pp_rr = m.p_rr};
            absorb(&m, (double)(pairs->to_ns[i] - pairs->from_ns[i] - first->base_ns), variance,
                   &off, &variance);
        }
        s->d = m.d_ns, s->r = m.rate_ns_s;
        s->p_dd = m.p_dd, s->p_dr = m.p_dr, s->p_rr = m.p_rr;
    }
}

/* x_k += C (x_k+1 - predicted), P_k += C (P_k+1 - predicted) C', C = P_k F' predicted^-1. */
static void back(struct step *s, const struct step *next, double dt_s) {
    double det = next->pp_dd * next->pp_rr - next->pp_dr * next->pp_dr;
    if (!(det > 0))
        return;
    double a = s->p_dd + dt_s * s->p_dr, b = s->p_dr; /* P F' */
    double c = s->p_dr + dt_s * s->p_rr, e = s->p_rr;
    double c11 = (a * next->pp_rr - b * next->pp_dr) / det;
    double c12 = (b * next->pp_dd - a * next->pp_dr) / det;
    double c21 = (c * next->pp_rr - e * next->pp_dr) / det;
    double c22 = (e * next->pp_dd - c * next->pp_dr) / det;
    double xd = next->d - next->pd, xr = next->r - next->pr;
    double g = next->p_dd - next->pp_dd, h = next->p_dr - next->pp_dr, k = next->p_rr - next->pp_rr;
    s->d += c11 * xd + c12 * xr;
    s->r += c21 * xd + c22 * xr;
    s->p_dd += c11 * (c11 * g + c12 * h) + c12 * (c11 * h + c12 * k);
    s->p_dr += c11 * (c21 * g + c22 * h) + c12 * (c21 * h + c22 * k);
    s->p_rr += c21 * (c21 * g + c22 * h) + c22 * (c21 * h + c22 * k);
}

enum st clock_track_smooth(const struct clock_track_pairs *pairs, double max_drift_ppm,
                           struct clock_track_state *out_states) {
    size_t n = pairs->count;
    struct step *steps = malloc((n + 1) * sizeof *steps);
    if (!steps)
        return ST_NOMEM;
    if (!n) {
        free(steps);
        return ST_OK;
    }
    struct clock_track track, first;
    clock_track_start(&first, pairs->from_ns[0], pairs->to_ns[0], pairs->sigma_ns[0],
                      max_drift_ppm);
    track = first;
    for (size_t i = 1; i < n; i++)
        clock_track_update(&track, pairs->from_ns[i], pairs->to_ns[i], pairs->sigma_ns[i]);
    double q = walk_of(track.best), scale = clock_track_scale(&track);
    forward(pairs, &first, q, steps);
    for (size_t i = n - 1; i-- > 0;)
        back(&steps[i], &steps[i + 1], (double)(pairs->from_ns[i + 1] - pairs->from_ns[i]) * 1e-9);
    for (size_t i = 0; i < n; i++)
        out_states[i] =
            (struct clock_track_state){.at_ns = pairs->from_ns[i],
                                       .base_ns = first.base_ns,
                                       .d_ns = steps[i].d,
                                       .sigma_ns = scale * sqrt(fmax(steps[i].p_dd, 0)),
                                       .rate_ns_s = steps[i].r,
                                       .rate_sigma = scale * sqrt(fmax(steps[i].p_rr, 0)),
                                       .walk = scale * scale * q};
    free(steps);
    return ST_OK;
}
