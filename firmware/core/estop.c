#include "firmware/core/estop.h"
#include "firmware/hal/hal_safety.h"

#define BIT(fault) (1u << (fault))

/* Conditions that trip in every state, those that need the motors on, and the one that needs the
 * laser on. */
#define WITH_LASER  BIT(FAULT_MIRROR_SLOW)
#define WITH_MOTORS (BIT(FAULT_HOST_SILENT) | BIT(FAULT_MIRROR_STALL))

/* The driver's current has this many ticks to fall after the laser was switched off. */
#define LASER_FALL_TICKS 4u

static void outputs_off(struct estop *estop) {
    hal_safety_laser(false);
    hal_safety_motors(false);
    if (estop->state == CTLSTATE_LASER)
        estop->laser_dark = 0;
}

static void latch(struct estop *estop, enum faultcode fault, int32_t context, uint64_t now_us) {
    outputs_off(estop);
    estop->state = CTLSTATE_FAULT;
    estop->fault = fault;
    estop->context = context;
    estop->fault_us = now_us;
    if (estop->fault_count < UINT16_MAX)
        estop->fault_count++;
}

void estop_init(struct estop *estop, uint16_t reset_cause) {
    *estop = (struct estop){.state = CTLSTATE_IDLE, .laser_dark = LASER_FALL_TICKS};
    outputs_off(estop);
    if (reset_cause == RESETCAUSE_WATCHDOG)
        latch(estop, FAULT_WATCHDOG, 0, 0);
}

/* Everything that is wrong at this instant, bit n for fault n, whatever the state. */
static uint32_t find_conditions(const struct estop *estop, const struct estop_inputs *in) {
    bool lit = estop->state == CTLSTATE_LASER || estop->laser_dark < LASER_FALL_TICKS;
    const struct {
        bool present;
        enum faultcode fault;
    } checks[] = {
        {!(in->pins & HAL_IN_ESTOP_CLOSED), FAULT_ESTOP},
        {!(in->pins & HAL_IN_INTERLOCK_CLOSED), FAULT_INTERLOCK},
        {!(in->pins & HAL_IN_DOOR_CLOSED), FAULT_DOOR},
        {in->temperature_valid && in->temperature > in->temperature_max, FAULT_OVER_TEMP},
        {!in->temperature_valid, FAULT_TEMP_SENSOR},
        {in->pan_limit_hit, FAULT_PAN_LIMIT},
        {in->tilt_limit_hit, FAULT_TILT_LIMIT},
        {!in->mirror_in_range && !in->mirror_too_fast, FAULT_MIRROR_SLOW},
        {in->mirror_too_fast, FAULT_MIRROR_FAST},
        {in->mirror_stalled, FAULT_MIRROR_STALL},
        {in->host_silence_ms > in->host_timeout_ms, FAULT_HOST_SILENT},
        {in->stack_free < in->stack_min, FAULT_STACK},
        {!in->clock_ok || (in->tick_limit_us && in->tick_interval_us > in->tick_limit_us),
         FAULT_CLOCK},
        {in->loop_stall_ms > in->loop_limit_ms, FAULT_LOOP},
        {in->pan_homing_failed, FAULT_PAN_HOMING},
        {in->tilt_homing_failed, FAULT_TILT_HOMING},
        {in->laser_current && !lit, FAULT_LASER_STUCK},
    };
    uint32_t conditions = 0;
    for (unsigned i = 0; i < sizeof checks / sizeof checks[0]; i++)
        if (checks[i].present)
            conditions |= BIT(checks[i].fault);
    return conditions;
}

/* Those that matter in this state. */
static uint32_t mask_for(enum ctlstate state) {
    uint32_t mask = UINT32_MAX;
    if (state != CTLSTATE_LASER)
        mask &= ~WITH_LASER;
    if (state != CTLSTATE_LASER && state != CTLSTATE_READY)
        mask &= ~WITH_MOTORS;
    return mask;
}

/* The measured value that belongs to a fault, see FAULTCODE_LIST. */
static int32_t context_of(enum faultcode fault, const struct estop_inputs *in) {
    const int32_t values[FAULT_COUNT_] = {
        [FAULT_ESTOP] = (int32_t)in->pins,
        [FAULT_INTERLOCK] = (int32_t)in->pins,
        [FAULT_DOOR] = (int32_t)in->pins,
        [FAULT_OVER_TEMP] = in->temperature,
        [FAULT_PAN_LIMIT] = in->pan_steps,
        [FAULT_TILT_LIMIT] = in->tilt_steps,
        [FAULT_MIRROR_SLOW] = in->mirror_mrps,
        [FAULT_MIRROR_FAST] = in->mirror_mrps,
        [FAULT_MIRROR_STALL] = in->mirror_mrps,
        [FAULT_HOST_SILENT] = (int32_t)in->host_silence_ms,
        [FAULT_STACK] = in->stack_free,
        [FAULT_CLOCK] = (int32_t)in->tick_interval_us,
        [FAULT_LOOP] = (int32_t)in->loop_stall_ms,
        [FAULT_PAN_HOMING] = in->pan_homing,
        [FAULT_TILT_HOMING] = in->tilt_homing,
    };
    return values[fault];
}

static enum faultcode lowest(uint32_t conditions) {
    unsigned fault = 0;
    while (!(conditions >> fault & 1u))
        fault++;
    return (enum faultcode)fault;
}

bool estop_tick(struct estop *estop, const struct estop_inputs *in) {
    estop->last = *in;
    if (estop->state != CTLSTATE_LASER && estop->laser_dark < LASER_FALL_TICKS)
        estop->laser_dark++;
    estop->conditions = find_conditions(estop, in) & mask_for(estop->state);
    if (estop->state == CTLSTATE_FAULT) {
        outputs_off(estop); /* again and again: a latch that an upset pin cannot leave */
        return false;
    }
    if (!estop->conditions)
        return false;
    enum faultcode fault = lowest(estop->conditions);
    latch(estop, fault, context_of(fault, in), in->now_us);
    return true;
}

void estop_trip(struct estop *estop, enum faultcode fault, int32_t context, uint64_t now_us) {
    estop->conditions |= BIT(fault);
    if (estop->state == CTLSTATE_FAULT)
        outputs_off(estop);
    else
        latch(estop, fault, context, now_us);
}

enum refusal estop_motors_check(const struct estop *estop) {
    if (estop->state == CTLSTATE_FAULT)
        return REFUSAL_FAULTED;
    if (estop->last.host_silence_ms > estop->last.host_timeout_ms)
        return REFUSAL_HOST;
    return REFUSAL_NONE;
}

enum refusal estop_laser_check(const struct estop *estop) {
    if (estop->state == CTLSTATE_FAULT)
        return REFUSAL_FAULTED;
    if (estop->state == CTLSTATE_IDLE)
        return REFUSAL_MOTORS_OFF;
    if (!estop->last.commissioned)
        return REFUSAL_UNCOMMISSIONED;
    if (estop->last.limit_closed)
        return REFUSAL_LIMIT;
    if (!estop->last.mirror_in_range)
        return REFUSAL_MIRROR;
    return REFUSAL_NONE;
}

enum refusal estop_clear_check(const struct estop *estop, uint16_t code) {
    if (estop->state != CTLSTATE_FAULT || code != estop->fault)
        return REFUSAL_WRONG_FAULT;
    if (estop->conditions)
        return REFUSAL_CONDITION;
    return REFUSAL_NONE;
}

enum refusal estop_motors(struct estop *estop, bool on) {
    if (!on) {
        outputs_off(estop);
        if (estop->state != CTLSTATE_FAULT)
            estop->state = CTLSTATE_IDLE;
        return REFUSAL_NONE;
    }
    enum refusal refusal = estop_motors_check(estop);
    if (refusal == REFUSAL_NONE && estop->state == CTLSTATE_IDLE) {
        hal_safety_motors(true);
        estop->state = CTLSTATE_READY;
    }
    return refusal;
}

enum refusal estop_laser(struct estop *estop, bool on) {
    if (!on) {
        hal_safety_laser(false);
        if (estop->state == CTLSTATE_LASER) {
            estop->state = CTLSTATE_READY;
            estop->laser_dark = 0;
        }
        return REFUSAL_NONE;
    }
    enum refusal refusal = estop_laser_check(estop);
    if (refusal == REFUSAL_NONE) {
        hal_safety_laser(true);
        estop->state = CTLSTATE_LASER;
    }
    return refusal;
}

enum refusal estop_clear(struct estop *estop, uint16_t code) {
    enum refusal refusal = estop_clear_check(estop, code);
    if (refusal == REFUSAL_NONE) {
        estop->state = CTLSTATE_IDLE;
        estop->fault = FAULT_NONE;
        estop->context = 0;
    }
    return refusal;
}
