#include "firmware/core/axis.h"

static int32_t clamp(int64_t value, int32_t low, int32_t high) {
    return value < low ? low : value > high ? high : (int32_t)value;
}

void axis_init(struct axis *axis, enum hal_axis id) {
    *axis = (struct axis){.id = id, .positive = true};
    ramp_init(&axis->ramp);
}

static uint32_t move_velocity(const struct axis *axis) {
    uint32_t limit = axis->limits.velocity_max;
    return axis->leg_velocity && axis->leg_velocity < limit ? axis->leg_velocity : limit;
}

static void finish(struct axis *axis) {
    axis->active = false;
    axis->leg = axis->position;
    axis->target = axis->position;
}

/* Starts a leg from rest. */
static void start_leg(struct axis *axis, int32_t leg, uint64_t now_us) {
    bool positive = leg > axis->position;
    if (positive != axis->positive)
        axis->run = 0;
    axis->positive = positive;
    hal_axis_direction(axis->id, positive != axis->limits.invert);
    int64_t way = (int64_t)leg - axis->position;
    axis->leg = leg;
    axis->active = true;
    axis->last_step_us = now_us;
    ramp_start(&axis->ramp, now_us * RAMP_FINE, (uint32_t)(way < 0 ? -way : way),
               move_velocity(axis), axis->limits.acceleration);
}

/* At rest: the next leg towards the target, or the end of the move. The last leg is positive and at
 * least run_up long, unless that much was already run in positive direction. */
static void plan_from_rest(struct axis *axis, uint64_t now_us) {
    int32_t at = axis->position, target = axis->target;
    int32_t start =
        clamp((int64_t)target - axis->run_up, axis->limits.min_steps, axis->limits.max_steps);
    if (start > target)
        start = target; /* a target below the soft limit: homing knows no limits */
    /* Near the soft limit there may be less room than the backlash: then as much as there is. */
    bool taken_up =
        !axis->run_up || (axis->positive && axis->run >= (uint32_t)((int64_t)target - start));
    if (at == target && (taken_up || start == target))
        finish(axis);
    else if (at < target && (taken_up || at <= start))
        start_leg(axis, target, now_us);
    else
        start_leg(axis, start, now_us);
}

static int32_t pending_position(const struct axis *axis) {
    return axis->position + (axis->positive ? 1 : -1);
}

static void retarget_leg(struct axis *axis, int64_t leg) {
    int64_t way = leg - pending_position(axis);
    if (!axis->positive)
        way = -way;
    /* way >= ramp_stopping: the callers have made sure of it */
    (void)ramp_retarget(&axis->ramp, (uint32_t)way, move_velocity(axis), axis->ramp.acceleration);
    axis->leg = (int32_t)leg;
}

/* Where the axis comes to rest if it is stopped now: never beyond the end of its leg, because a
 * move keeps the acceleration that it started with. */
static int64_t rest_position(const struct axis *axis) {
    int64_t stop = ramp_stopping(&axis->ramp, axis->ramp.acceleration);
    return pending_position(axis) + (axis->positive ? stop : -stop);
}

/* In motion: bends the current leg towards the new target if the ramp allows, otherwise stops
 * first. */
static void plan_in_motion(struct axis *axis) {
    int64_t rest = rest_position(axis);
    int64_t wanted = axis->target;
    if (!axis->positive && axis->run_up)
        wanted = clamp(wanted - axis->run_up, axis->limits.min_steps, axis->limits.max_steps);
    bool reachable = axis->positive ? wanted >= rest : wanted <= rest;
    int64_t from = axis->position - (int64_t)axis->run; /* where this direction began */
    if (axis->positive && axis->run_up && wanted - from < axis->run_up)
        reachable =
            false; /* would arrive with the backlash half taken up: stop, go back, come again */
    retarget_leg(axis, reachable ? wanted : rest);
}

static void move(struct axis *axis, int32_t target, uint32_t velocity_max, uint16_t run_up,
                 uint64_t now_us) {
    axis->target = target;
    axis->leg_velocity = velocity_max;
    axis->run_up = run_up;
    if (axis->ramp.pending)
        plan_in_motion(axis);
    else
        plan_from_rest(axis, now_us);
}

void axis_move(struct axis *axis, int32_t target, uint32_t velocity_max, uint64_t now_us) {
    axis->homing = AXIS_HOMING_OFF;
    move(axis, target, velocity_max, axis->limits.backlash_steps, now_us);
}

void axis_move_direct(struct axis *axis, int32_t target, uint32_t velocity_max, uint64_t now_us) {
    axis->homing = AXIS_HOMING_OFF;
    move(axis, target, velocity_max, 0, now_us);
}

/* Ramps down; the move then ends `extra` steps or more after the pending one. */
static void come_to_rest(struct axis *axis, uint32_t at_least) {
    uint32_t stop = ramp_stopping(&axis->ramp, axis->ramp.acceleration);
    if (stop < at_least)
        stop = at_least;
    int64_t rest = pending_position(axis) + (axis->positive ? (int64_t)stop : -(int64_t)stop);
    axis->run_up = 0;
    axis->target = (int32_t)rest;
    retarget_leg(axis, rest);
}

void axis_stop(struct axis *axis) {
    axis->homing = AXIS_HOMING_OFF;
    if (axis->ramp.pending)
        come_to_rest(axis, 0);
    else
        finish(axis);
}

void axis_abort(struct axis *axis) {
    if (axis->active || axis->homing)
        axis->homed = false;
    axis->homing = AXIS_HOMING_OFF;
    ramp_init(&axis->ramp);
    axis->run = 0;
    finish(axis);
}

/* --- homing ---------------------------------------------------------------------------------- */

/* A homing phase: at most `steps` in one direction; the switch ends it earlier. */
static void homing_leg(struct axis *axis, enum axis_homing phase, bool positive, uint32_t steps,
                       uint32_t velocity_max, uint64_t now_us) {
    axis->homing = (uint8_t)phase;
    axis->run_up = 0;
    axis->leg_velocity = velocity_max;
    int64_t leg = axis->position + (positive ? (int64_t)steps : -(int64_t)steps);
    axis->target = (int32_t)leg;
    start_leg(axis, (int32_t)leg, now_us);
}

/* A quarter more than the whole soft travel: further, there is no switch. */
static uint32_t homing_travel(const struct axis *axis) {
    int64_t travel = (int64_t)axis->limits.max_steps - axis->limits.min_steps;
    return (uint32_t)(travel + travel / 4 + 1000);
}

/* So deep into the zone that the slow way out takes the backlash up before it meets the edge. */
static uint32_t homing_depth(const struct axis *axis) {
    return axis->limits.backlash_steps + 8u;
}

void axis_home(struct axis *axis, uint64_t now_us) {
    if (axis->ramp.pending) /* refused by core/cregs; here only for safety's sake */
        return;
    bool inside = axis->switches & AXIS_AT_HOME;
    homing_leg(axis, inside ? AXIS_HOMING_LEAVE : AXIS_HOMING_SEEK, inside, homing_travel(axis),
               axis->limits.home_fast, now_us);
}

/* The switches were read before this step's pulse, when the last step had long been made: the edge
 * lies one step back. */
static void found_edge(struct axis *axis) {
    int32_t here = axis->limits.home_position + 1;
    axis->home_error = axis->homed ? axis->position - here : 0;
    axis->position = here;
    axis->homed = true;
    axis->homing = AXIS_HOMING_SETTLE;
    come_to_rest(axis, 0);
}

/* After a step of a homing phase, while more steps are pending. */
static void homing_step(struct axis *axis) {
    bool at_home = axis->switches & AXIS_AT_HOME;
    switch (axis->homing) {
    case AXIS_HOMING_LEAVE:
        if (!at_home) {
            axis->homing = AXIS_HOMING_LEFT;
            come_to_rest(axis, homing_depth(axis));
        }
        break;
    case AXIS_HOMING_SEEK:
        if (at_home) {
            axis->homing = AXIS_HOMING_STOP;
            come_to_rest(axis, homing_depth(axis));
        }
        break;
    case AXIS_HOMING_EDGE:
        if (!at_home)
            found_edge(axis);
        break;
    default: /* LEFT, STOP and SETTLE run out by themselves */
        break;
    }
}

/* A homing phase has come to rest. */
static void homing_rest(struct axis *axis, uint64_t now_us) {
    bool at_home = axis->switches & AXIS_AT_HOME;
    uint32_t travel = homing_travel(axis);
    if (axis->homing == AXIS_HOMING_LEFT && !at_home) {
        homing_leg(axis, AXIS_HOMING_SEEK, false, travel, axis->limits.home_fast, now_us);
    } else if (axis->homing == AXIS_HOMING_STOP && at_home) {
        homing_leg(axis, AXIS_HOMING_EDGE, true, travel, axis->limits.home_slow, now_us);
    } else if (axis->homing == AXIS_HOMING_SETTLE) {
        axis->homing = AXIS_HOMING_OFF;
        finish(axis);
    } else {
        axis->homing = AXIS_HOMING_FAILED; /* estop sees it at the next tick */
        finish(axis);
    }
}

/* --- steps ----------------------------------------------------------------------------------- */

bool axis_step(struct axis *axis, uint8_t switches, uint64_t now_us) {
    uint64_t due_us = ramp_due_us(&axis->ramp);
    uint64_t late_us = now_us > due_us ? now_us - due_us : 0;
    bool shifted = late_us > AXIS_LATE_MAX_US;
    hal_axis_step(axis->id);
    axis->position += axis->positive ? 1 : -1;
    if (axis->run < UINT32_MAX)
        axis->run++;
    axis->last_step_us = now_us;
    axis->switches = switches;
    if (shifted)
        ramp_delay(&axis->ramp, late_us * RAMP_FINE);
    if (axis->homing)
        homing_step(axis);
    if (!ramp_advance(&axis->ramp)) {
        if (axis->homing)
            homing_rest(axis, now_us);
        else
            plan_from_rest(axis, now_us);
    }
    return shifted;
}

bool axis_switches(struct axis *axis, uint8_t switches) {
    axis->switches = switches;
    if (!axis->ramp.pending)
        return false;
    if (!(switches & (axis->positive ? AXIS_AT_LIMIT_MAX : AXIS_AT_LIMIT_MIN)))
        return false;
    if (!axis->homing)
        return true;
    axis->homing = AXIS_HOMING_FAILED;
    return false;
}

uint16_t axis_flags(const struct axis *axis) {
    unsigned flags = axis->switches;
    flags |= axis->active ? AXIS_MOVING : 0u;
    flags |= axis->homed ? AXIS_HOMED : 0u;
    flags |= axis->homing && axis->homing != AXIS_HOMING_FAILED ? AXIS_HOMING : 0u;
    flags |= axis->positive ? AXIS_POSITIVE : 0u;
    flags |= axis->run >= axis->limits.backlash_steps ? AXIS_TAKEN_UP : 0u;
    return (uint16_t)flags;
}

int32_t axis_velocity(const struct axis *axis) {
    int32_t velocity = (int32_t)ramp_velocity(&axis->ramp);
    return axis->positive ? velocity : -velocity;
}

uint16_t axis_phase(const struct axis *axis, uint64_t t_us) {
    if (!axis->ramp.pending || t_us <= axis->last_step_us)
        return 0;
    uint64_t whole = ramp_due_us(&axis->ramp) - axis->last_step_us,
             part = t_us - axis->last_step_us;
    if (part >= whole)
        return UINT16_MAX;
    return (uint16_t)(part * 65536u / whole);
}
