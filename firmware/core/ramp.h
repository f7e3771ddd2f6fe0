/* Integer velocity ramps: when is the next step due.
 *
 * The ideal motion has constant acceleration a up to the velocity limit, cruises, and decelerates
 * with a so that it comes to rest exactly on the target. Between steps n and n+1 it is described by
 * w = v^2, which is linear in the way x:  dw/dx = +-2a  (from v dv = a dx). So w at each step is an
 * exact integer, and the time between two points of one phase is |sqrt(w1) - sqrt(w0)| / a. Each
 * phase keeps its own origin (time and sqrt(w)), so that rounding does not add up; cruising keeps
 * the remainder of its division. Steps are due at the ideal time rounded to a tick: intervals
 * differ from the ideal ones by less than a tick, after any number of steps.
 *
 * Units: way in steps, v in 0.001 steps/s, w in its square, a in steps/s^2; g = 2a 10^6 is the
 * change of w over one step. Time in 1/256 us ("fine"), 64 bits. No allocation; integer only; one
 * step costs at most two 64-bit square roots per phase it touches (typically one) and two
 * divisions: about 5 us at 168 MHz. */
#ifndef SC_CORE_RAMP_H
#define SC_CORE_RAMP_H

#include <stdbool.h>
#include <stdint.h>

#define RAMP_FINE             256u      /* fine units in a tick of 1 us */
#define RAMP_VELOCITY_MIN     100u      /* 0.001 steps/s */
#define RAMP_VELOCITY_MAX     50000000u /* 0.001 steps/s */
#define RAMP_ACCELERATION_MAX 1000000u
#define RAMP_ACCELERATION_MIN 100u

enum ramp_phase { RAMP_REST, RAMP_ACCEL, RAMP_CRUISE, RAMP_DECEL };

struct ramp {
    /* the limits of the current move */
    uint32_t velocity_max;
    uint32_t acceleration;
    uint64_t w_max; /* velocity_max^2 */
    uint64_t g;     /* 2 a 10^6 */
    uint32_t cap;   /* more remaining steps than this cannot matter yet: bounds g * remaining */
    /* the state at the step that comes next */
    uint32_t remaining; /* steps to the target after that step */
    uint64_t w;         /* at that step */
    uint64_t t_fine;    /* its time */
    /* the phase that led there */
    enum ramp_phase phase;
    uint64_t ref_fine; /* origin of the phase: time */
    uint64_t ref_root; /* and root of w, see ramp.c */
    uint64_t cruise_quotient, cruise_remainder,
        cruise_sum; /* interval 256e9 / v as a rational number */
    bool pending;   /* a next step exists */
};

/* At rest, nothing pending. */
void ramp_init(struct ramp *ramp);

/* Starts from rest at time `start_fine` a move of `steps` >= 1 steps. Limits are clipped to the
 * ranges above. Returns with the first step pending. */
void ramp_start(struct ramp *ramp, uint64_t start_fine, uint32_t steps, uint32_t velocity_max,
                uint32_t acceleration);

/* The pending step has been made: computes the next. Returns false if that was the last (now at
 * rest). */
bool ramp_advance(struct ramp *ramp);

/* While a step is pending: the least number of steps after the pending one in which the move can
 * come to rest with acceleration `acceleration`. */
uint32_t ramp_stopping(const struct ramp *ramp, uint32_t acceleration);

/* While a step is pending: changes the move so that it ends `remaining` steps after the pending
 * one, with new limits. Returns false and changes nothing if `remaining` < ramp_stopping(). */
bool ramp_retarget(struct ramp *ramp, uint32_t remaining, uint32_t velocity_max,
                   uint32_t acceleration);

/* The pending step comes `late_fine` later than planned: shifts the rest of the move by as much. */
void ramp_delay(struct ramp *ramp, uint64_t late_fine);

/* Time of the pending step, rounded to ticks. */
uint64_t ramp_due_us(const struct ramp *ramp);

/* Velocity at the pending step, 0.001 steps/s. */
uint32_t ramp_velocity(const struct ramp *ramp);

/* Floor of the square root of any 64-bit number. */
uint32_t ramp_isqrt(uint64_t x);

#endif
