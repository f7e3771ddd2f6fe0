/* One clock in terms of another, from pairs of times of the same events: to = offset + rate * from.
 *
 * Pairs may be late (a thread that woke up late), and some may be wrong (mismatched events): the
 * fit is by least squares with outliers beyond 4 robust sigmas left out, repeated until the set
 * stands still. Times are taken relative to the middle, so that nanoseconds since long ago lose
 * nothing. */
#ifndef SC_BASE_CLOCK_FIT_H
#define SC_BASE_CLOCK_FIT_H

#include "base/st.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct clock_fit {
    int64_t from_mid_ns, to_mid_ns;  /* where the line is anchored */
    double rate;                     /* d to / d from, near 1 */
    double sigma_ns;                 /* robust scatter of the pairs about the line */
    double rate_sigma, mid_sigma_ns; /* standard deviations of rate and of the line at the middle */
    size_t used, count;
};

/* Fits `count` pairs in any order. One pair: rate 1. ST_INVALID without pairs or with a span above
 * 2^53 ns; ST_NOMEM; ST_SINGULAR if all `from` are equal but the `to` are not, or the rate is not
 * within 0.9..1.1. */
ST_MUST_CHECK enum st clock_fit_make(const int64_t *from_ns, const int64_t *to_ns, size_t count,
                                     struct clock_fit *out_fit);

/* The other clock's time, and back. */
int64_t clock_fit_apply(const struct clock_fit *fit, int64_t from_ns);
int64_t clock_fit_invert(const struct clock_fit *fit, int64_t to_ns);

#ifdef __cplusplus
}
#endif
#endif
