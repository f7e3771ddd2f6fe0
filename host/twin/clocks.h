/* The three clocks that never agree. True time is int64 ns from the start of the simulation; a
 * clock shows shown(t) = offset + t + drift * t + wander(t) + jumps, wander being a slow sum of
 * sines: smooth, so that it can be fitted, and never equal to a line. */
#ifndef SC_TWIN_CLOCKS_H
#define SC_TWIN_CLOCKS_H

#include "base/rng.h"

#include <stdint.h>

enum { CLOCKS_TERMS = 4, CLOCKS_JUMPS = 8 };

struct clocks_spec {
    double offset_s;
    double drift_ppm;
    double wander_us; /* standard deviation of the wander */
    double jitter_us; /* standard deviation of one reading */
};

struct clocks {
    struct clocks_spec spec;
    double amplitude_ns[CLOCKS_TERMS], rate_rad_s[CLOCKS_TERMS], phase_rad[CLOCKS_TERMS];
    int64_t jump_at_ns[CLOCKS_JUMPS], jump_by_ns[CLOCKS_JUMPS];
    int jumps;
};

/* A clock of that kind; the wander follows from the seed. */
struct clocks clocks_make(const struct clocks_spec *spec, uint64_t seed);

/* What it shows at true time t, ns, without the jitter of a reading. */
int64_t clocks_show(const struct clocks *clock, int64_t t_ns);
/* The true time at which it shows that, to 1 ns; with jumps, the earliest. */
int64_t clocks_when(const struct clocks *clock, int64_t shown_ns);
/* One reading, with its jitter. */
int64_t clocks_read(const struct clocks *clock, int64_t t_ns, struct rng *rng);

/* From true time `at` on it shows `by` more. Up to CLOCKS_JUMPS; more are ignored. */
void clocks_jump(struct clocks *clock, int64_t at_ns, int64_t by_ns);

#endif
