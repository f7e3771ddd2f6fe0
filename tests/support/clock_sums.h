/* Sums over runs of the clocks, and the table of them. */
#ifndef SC_TESTS_CLOCK_SUMS_H
#define SC_TESTS_CLOCK_SUMS_H

#include "clock_runs.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>

/* What is asked: sigma of the pan error, and the share of errors below one stated sigma. */
static const double asked_mrad = 0.05, share_low = 0.60, share_high = 0.76;

struct sums {
    uint64_t runs, moving, samples, placed;
    double sum2, ones, twos, worst_rms_mrad, max_mrad;
};

static inline void add(struct sums *s, const struct clock_runs *r) {
    const struct clock_runs_errors *e = &r->error;
    double n = (double)e->moving;
    s->runs++;
    s->moving += e->moving;
    s->samples += e->samples;
    s->placed += e->placed;
    s->sum2 += n * e->rms_steps * e->rms_steps;
    s->ones += n * e->within_1;
    s->twos += n * e->within_2;
    s->worst_rms_mrad = fmax(s->worst_rms_mrad, clock_runs_mrad(e->rms_steps));
    s->max_mrad = fmax(s->max_mrad, clock_runs_mrad(e->max_steps));
}

static inline void print_head(void) {
    (void)printf("%-34s %8s %5s %10s %10s %10s %6s %6s\n", "", "samples", "runs", "rms, mrad",
                 "worst run", "worst", "1 s", "2 s");
}

static inline void print(const char *name, const char *how, const struct sums *s) {
    double n = (double)(s->moving ? s->moving : 1);
    (void)printf("%-24s %-9s %8" PRIu64 " %5" PRIu64 " %10.2g %10.2g %10.2g %5.1f%% %5.1f%%\n",
                 name, how, s->placed, s->runs, clock_runs_mrad(sqrt(s->sum2 / n)),
                 s->worst_rms_mrad, s->max_mrad, 100 * s->ones / n, 100 * s->twos / n);
}

#endif
