/* One stepper axis: position, moves with a chosen approach direction, homing, switches.
 * The steps themselves are timed by core/ramp and given by core/stepsched. Integer only. */
#ifndef SC_CORE_AXIS_H
#define SC_CORE_AXIS_H

#include "firmware/core/ramp.h"
#include "firmware/hal/hal_axis.h"
#include <stdbool.h>
#include <stdint.h>

enum axis_flag { /* bits of pan_flags and tilt_flags */
                 AXIS_MOVING = 1 << 0,
                 AXIS_HOMED = 1 << 1,
                 AXIS_HOMING = 1 << 2,
                 AXIS_AT_LIMIT_MIN = 1 << 3,
                 AXIS_AT_LIMIT_MAX = 1 << 4,
                 AXIS_AT_HOME = 1 << 5,
                 AXIS_POSITIVE = 1 << 6,
                 AXIS_TAKEN_UP = 1 << 7
};

enum axis_homing {
    AXIS_HOMING_OFF = 0,
    AXIS_HOMING_LEAVE = 1,  /* fast, positive, out of the home switch's zone, if it starts there */
    AXIS_HOMING_LEFT = 2,   /* ramping down outside the zone */
    AXIS_HOMING_SEEK = 3,   /* fast, negative, until the home switch closes */
    AXIS_HOMING_STOP = 4,   /* ramping down inside the zone, at least the backlash deep */
    AXIS_HOMING_EDGE = 5,   /* slow, positive, until it opens: that edge is home_position */
    AXIS_HOMING_SETTLE = 6, /* ramping down behind the edge */
    AXIS_HOMING_FAILED = 7  /* the whole travel without an edge, or a limit switch */
};

/* Everything that a move needs to know; copied from the holding registers by core/cregs. */
struct axis_limits {
    uint32_t velocity_max; /* 0.001 steps/s */
    uint32_t acceleration; /* steps/s^2 */
    int32_t min_steps, max_steps;
    uint16_t backlash_steps;
    int32_t home_position;
    uint32_t home_fast, home_slow; /* 0.001 steps/s */
    bool invert;
};

struct axis {
    /* set at init */
    enum hal_axis id;
    /* under the interrupt lock, or in interrupts */
    struct axis_limits limits;
    struct ramp ramp;
    int32_t position;      /* after the last step made */
    bool positive;         /* direction of the pending or last step */
    uint32_t run;          /* steps made in that direction since the last reversal, saturating */
    uint64_t last_step_us; /* time of the last step */
    int32_t leg;           /* where the current leg of the move ends */
    int32_t target;        /* where the move ends; differs from leg for run-ups and reversals */
    uint32_t leg_velocity; /* velocity limit of the move */
    uint16_t run_up;       /* steps over which the move must end in positive direction */
    bool active;           /* a move is not finished */
    bool homed;
    uint8_t homing; /* enum axis_homing */
    int32_t home_error;
    uint8_t switches; /* AXIS_AT_* bits of the last sample */
};

void axis_init(struct axis *axis, enum hal_axis id);

/* Moves to `target` (absolute steps), always ending in positive direction over at least
 * backlash_steps unless the backlash is already taken up that way. From rest or in motion (then it
 * first does what the ramp allows: stretch, shorten, or stop and come back). `velocity_max` 0 means
 * the axis limit. `now_us` is the time of a start from rest. Under the interrupt lock. */
void axis_move(struct axis *axis, int32_t target, uint32_t velocity_max, uint64_t now_us);

/* As axis_move, but without a run-up: for legs of a scan, which take the backlash up themselves. */
void axis_move_direct(struct axis *axis, int32_t target, uint32_t velocity_max, uint64_t now_us);

/* Ramps down to rest as soon as the acceleration allows; ends homing. Under the interrupt lock. */
void axis_stop(struct axis *axis);

/* No further step, at once: drive power goes away. A moving axis, or one being homed, is no longer
 * homed. Under the interrupt lock or in interrupts. */
void axis_abort(struct axis *axis);

/* Starts homing. Under the interrupt lock. */
void axis_home(struct axis *axis, uint64_t now_us);

/* The pending step is due: gives the pulse, counts it, plans on. `switches` are the AXIS_AT_* bits
 * read just before. A step later than AXIS_LATE_MAX_US shifts the rest of the ramp, so that nothing
 * has to be caught up. Step interrupt. Returns true if the ramp was shifted. */
#define AXIS_LATE_MAX_US 20u
bool axis_step(struct axis *axis, uint8_t switches, uint64_t now_us);

/* The switches were sampled by the safety tick: returns true if the axis moves into a closed limit
 * switch outside homing. During homing a limit switch makes the homing fail instead (see
 * axis.homing). Interrupts. */
bool axis_switches(struct axis *axis, uint8_t switches);

/* True while a step is pending. */
static inline bool axis_pending(const struct axis *axis) {
    return axis->ramp.pending;
}
/* enum axis_flag bits. */
uint16_t axis_flags(const struct axis *axis);
/* Signed velocity, 0.001 steps/s. */
int32_t axis_velocity(const struct axis *axis);
/* Part of the way to the pending step at time `t_us`, 1/65536; 0 at rest. One division. */
uint16_t axis_phase(const struct axis *axis, uint64_t t_us);

#endif
