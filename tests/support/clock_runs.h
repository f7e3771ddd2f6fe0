/* The clocks put to the test: a world of clock_world.h through cart_clock on line, or through
 * clock_solve and sweep off line, every placed sample held against the truth. */
#ifndef SC_TESTS_CLOCK_RUNS_H
#define SC_TESTS_CLOCK_RUNS_H

#include "base/cart_clock.h"
#include "clock_world.h"

struct clock_runs_errors {
    uint64_t samples, placed; /* while the pan is wanted to sweep */
    uint64_t moving;          /* placed, and the pan moves at its speed: what follows is of these */
    double rms_steps, max_steps, mean_sigma_steps;
    double within_1, within_2; /* shares of errors below one and two sigmas */
    double worst_counts;       /* encoder: what slips were not taken out */
};

struct clock_runs {
    struct clock_runs_errors error;
    struct cart_clock_report report;
    struct clock_world_done done;
};

/* Steps to mrad at 28 000 a turn. */
double clock_runs_mrad(double steps);

/* One run that is fed from outside, in order of host time. */
struct clock_runs_feed;
struct clock_runs_feed *clock_runs_open(bool online, const struct cart_clock_params *params,
                                        double pan_rate_steps_s);
struct clock_world_sink clock_runs_sink(struct clock_runs_feed *feed);
/* Ends it; out->done is left alone. */
void clock_runs_close(struct clock_runs_feed *feed, struct clock_runs *out);

/* A whole world. */
struct clock_runs clock_runs_online(const struct clock_world_spec *spec,
                                    const struct cart_clock_params *params);
struct clock_runs clock_runs_offline(const struct clock_world_spec *spec,
                                     const struct cart_clock_params *params);

#endif
