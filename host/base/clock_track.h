/* One clock against another that wanders: no line fits a whole day, so the difference d = to - from
 * is followed by a Kalman filter with the state (d, rate of d) whose rate walks at random.
 *
 *   d' = d + rate dt       rate' = rate + w,  E w^2 = q dt       seen: d + v,  E v^2 = s sigma^2
 *
 * How much the rate walks against the noise of the pairs (q / s) differs from crystal to crystal,
 * so seventeen filters with ratios half a decade apart run side by side and the likeliest is
 * believed; s is measured too (concentrated likelihood, Harvey 1989, section 3.4). Off line the
 * same model is run both ways (Rauch, Tung and Striebel 1965).
 *
 * Rates are ns of difference a second of `from`: 1 ns/s is 0.001 ppm. On line: no allocation, safe
 * on the real-time path, constant time. */
#ifndef SC_BASE_CLOCK_TRACK_H
#define SC_BASE_CLOCK_TRACK_H

#include "base/st.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { CLOCK_TRACK_MODELS = 17 };

/* State relative to the track's base; covariances in units of the model's scale. */
struct clock_track_model {
    double d_ns, rate_ns_s;
    double p_dd, p_dr, p_rr;
    double n, sum_z2, sum_log; /* likelihood, with forgetting */
};

struct clock_track {
    struct clock_track_model model[CLOCK_TRACK_MODELS];
    int64_t at_ns, base_ns; /* `from` time of the state; d counts from base */
    double rate_limit_ns_s; /* prior sigma of the rate */
    uint64_t used;
    unsigned best;
};

/* What is known at one time. */
struct clock_track_state {
    int64_t at_ns;   /* `from` time */
    int64_t base_ns; /* d = base_ns + d_ns */
    double d_ns;
    double sigma_ns; /* of d */
    double rate_ns_s, rate_sigma;
    double walk; /* q: variance of the rate's walk, (ns/s)^2 a second */
};

/* Starts with a first pair. max_drift_ppm: prior sigma of the rate. */
void clock_track_start(struct clock_track *track, int64_t from_ns, int64_t to_ns, double sigma_ns,
                       double max_drift_ppm);

/* The state carried to another time, forwards or (by a few steps at most) backwards. */
struct clock_track_state clock_track_at(const struct clock_track *track, int64_t from_ns);
/* `to` time at a `from` time, by a state not far from it; out_sigma_ns may be NULL. */
int64_t clock_track_apply(const struct clock_track_state *state, int64_t from_ns,
                          double *out_sigma_ns);
int64_t clock_track_invert(const struct clock_track_state *state, int64_t to_ns,
                           double *out_sigma_ns);

/* How far a pair is from what is expected, ns, and the sigma of that. Times must not go back. */
double clock_track_innovation(const struct clock_track *track, int64_t from_ns, int64_t to_ns,
                              double sigma_ns, double *out_sigma_ns);
/* Takes a pair. */
void clock_track_update(struct clock_track *track, int64_t from_ns, int64_t to_ns, double sigma_ns);
/* The scatter of pairs in units of their stated sigmas: sqrt(s) of the best model. */
double clock_track_scale(const struct clock_track *track);

/* Pairs to smooth, sorted by from_ns. */
struct clock_track_pairs {
    size_t count;
    const int64_t *from_ns, *to_ns;
    const double *sigma_ns;
};
/* The state at each pair from all pairs, before and after: out_states[count]. ST_NOMEM. */
ST_MUST_CHECK enum st clock_track_smooth(const struct clock_track_pairs *pairs,
                                         double max_drift_ppm,
                                         struct clock_track_state *out_states);

#ifdef __cplusplus
}
#endif
#endif
