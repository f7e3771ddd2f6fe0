/* The safety machine: the only owner of the laser enable and of the motor enable.
 *
 * States: IDLE, READY (motors on), LASER (motors and laser on), FAULT. Every safety tick it is
 * given all that can go wrong; anything present that matters in its state switches both outputs off
 * in that same call and latches the first cause with its context. It leaves FAULT only by
 * estop_clear, with the right code and no cause left. The laser is never switched on by anything
 * but an explicit command. */
#ifndef SC_CORE_ESTOP_H
#define SC_CORE_ESTOP_H

#include "firmware/shared/faultcode.h"
#include <stdbool.h>
#include <stdint.h>

/* The world at one tick, gathered by firmware_isr_tick. */
struct estop_inputs {
    uint64_t now_us;
    uint32_t pins; /* enum hal_input */
    bool temperature_valid;
    int16_t temperature, temperature_max; /* 0.1 C */
    bool pan_limit_hit, tilt_limit_hit;   /* moving into a closed switch outside homing */
    int32_t pan_steps, tilt_steps;
    bool limit_closed; /* any limit switch */
    bool pan_homing_failed, tilt_homing_failed;
    uint8_t pan_homing, tilt_homing; /* phase, for the context */
    bool mirror_in_range, mirror_too_fast, mirror_stalled;
    uint16_t mirror_mrps;
    uint32_t host_silence_ms, host_timeout_ms;
    uint16_t stack_free, stack_min;
    bool clock_ok;
    uint32_t tick_interval_us, tick_limit_us; /* limit 0: not checked */
    uint32_t loop_stall_ms, loop_limit_ms;
    bool laser_current; /* feedback, false where there is none */
    bool commissioned;  /* values in use are stored and valid */
};

struct estop {
    enum ctlstate state;
    enum faultcode fault; /* latched */
    int32_t context;
    uint64_t fault_us;
    uint16_t fault_count;
    uint32_t conditions;      /* bit n: condition of fault n present at the last tick */
    uint8_t laser_dark;       /* ticks since the laser was switched off, saturating */
    struct estop_inputs last; /* of the last tick: what commands are judged by */
};

/* Outputs off, state IDLE; FAULT_WATCHDOG latched if `reset_cause` says so. */
void estop_init(struct estop *estop, uint16_t reset_cause);

/* The safety tick. Switches off and latches as needed. Returns true if it tripped in this call (the
 * caller then stops axes, mirror and scan). Interrupts. Budget 5 us. */
bool estop_tick(struct estop *estop, const struct estop_inputs *in);

/* Trips at once from outside the tick (clock failure interrupt, pin change). Interrupts. */
void estop_trip(struct estop *estop, enum faultcode fault, int32_t context, uint64_t now_us);

/* Commands, main loop under the interrupt lock. They return REFUSAL_NONE and act, or say why not
 * and change nothing. Switching off is never refused. */
enum refusal estop_motors(struct estop *estop, bool on);
enum refusal estop_laser(struct estop *estop, bool on);
enum refusal estop_clear(struct estop *estop, uint16_t code);

/* What estop_motors(on) and estop_laser(on) would answer. */
enum refusal estop_motors_check(const struct estop *estop);
enum refusal estop_laser_check(const struct estop *estop);
enum refusal estop_clear_check(const struct estop *estop, uint16_t code);

static inline bool estop_laser_on(const struct estop *estop) {
    return estop->state == CTLSTATE_LASER;
}
static inline bool estop_motors_on(const struct estop *estop) {
    return estop->state == CTLSTATE_READY || estop->state == CTLSTATE_LASER;
}

#endif
