/* The moving parts in true time: the mirror with its jitter, the pan-tilt unit with ramps and play.
 * State is advanced in steps of 1 ms and kept as knots for the current block, between which it is
 * interpolated; so any instant of the block can be asked for, by many threads. */
#ifndef SC_TWIN_MECHANICS_H
#define SC_TWIN_MECHANICS_H

#include "base/rig.h"
#include "base/rng.h"
#include "twin/faults.h"
#include "twin/twin_config.h"

#include <stdbool.h>
#include <stdint.h>

enum {
    MECHANICS_STEP_NS = 1000000,
    MECHANICS_BLOCK = 250 /* knots in a block: 0.25 s */
};

struct mechanics_axis {
    double motor_steps, velocity_steps_s; /* what the controller counts */
    double target_steps, rate_steps_s, acceleration_steps_s2;
    double lost_steps; /* the motor turned less than was counted by this */
    double load_steps; /* where the head really is: behind the play */
    double play_steps;
    int direction; /* of the last motion */
};

/* Everything that moves, at one instant. */
struct mechanics_state {
    double mirror_rad; /* theta, grows without bound */
    double mirror_rad_s;
    double pan_rad, tilt_rad; /* true angles of the head */
    double pan_motor_steps, tilt_motor_steps;
};

struct mechanics {
    /* set by init */
    struct rig rig; /* true */
    double spin_up_s, wander, ripple, ripple_phase_rad;
    const struct faults *faults; /* may be NULL */
    struct rng rng;
    /* state at the end of the block */
    int64_t t_ns;
    double mirror_rad, mirror_rad_s, mirror_target_rad_s, wander_state;
    struct mechanics_axis pan, tilt;
    double slip_counts; /* of the encoder disc */
    /* the block: knots 0..knot_count-1, the first at block_t_ns */
    int64_t block_t_ns;
    int knot_count;
    struct mechanics_state knot[MECHANICS_BLOCK + 1];
    double knot_slip_counts[MECHANICS_BLOCK + 1];
};

/* At rest, homed (approached in positive direction), true time 0. */
void mechanics_init(struct mechanics *m, const struct twin_config *config,
                    const struct faults *faults, uint64_t seed);

/* Mirror speed wanted; 0 lets it stop. */
void mechanics_mirror(struct mechanics *m, double speed_hz);
/* Starts a move of an axis to a motor position with a rate limit. */
void mechanics_move(struct mechanics_axis *axis, double target_steps, double rate_steps_s);
/* At its target and at rest? */
bool mechanics_at_rest(const struct mechanics_axis *axis);

/* Computes the next `steps` ms (1..MECHANICS_BLOCK) as the new block. */
void mechanics_advance(struct mechanics *m, int steps);

/* The state at t within the block (clamped to it). Any thread. */
struct mechanics_state mechanics_at(const struct mechanics *m, double t_ns);
/* What the encoder disc shows at that state: counts, growing without bound, slip included. */
double mechanics_counts(const struct mechanics *m, const struct mechanics_state *state,
                        double t_ns);

/* Index pulses (counts crossing a multiple of a turn upwards) in the block: their times. Returns
 * the number, at most `capacity`. */
int mechanics_index(const struct mechanics *m, int64_t *out_t_ns, int capacity);

#endif
