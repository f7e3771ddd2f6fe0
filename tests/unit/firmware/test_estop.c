/* The safety machine alone, against a stub of its two outputs. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "firmware/core/estop.h"
#include "firmware/hal/hal_safety.h"
#include <string.h>

static bool laser_out, motors_out;

void hal_safety_laser(bool on) {
    laser_out = on;
}

void hal_safety_motors(bool on) {
    motors_out = on;
}

/* A world with nothing wrong in it. */
static struct estop_inputs healthy(void) {
    return (struct estop_inputs){
        .now_us = 1000,
        .pins = HAL_IN_ESTOP_CLOSED | HAL_IN_INTERLOCK_CLOSED | HAL_IN_DOOR_CLOSED,
        .temperature_valid = true,
        .temperature = 300,
        .temperature_max = 700,
        .pan_steps = 11,
        .tilt_steps = 22,
        .pan_homing = 3,
        .tilt_homing = 4,
        .mirror_in_range = true,
        .mirror_mrps = 4000,
        .host_silence_ms = 10,
        .host_timeout_ms = 1000,
        .stack_free = 1000,
        .stack_min = 256,
        .clock_ok = true,
        .tick_interval_us = 500,
        .tick_limit_us = 750,
        .loop_stall_ms = 1,
        .loop_limit_ms = 50,
        .commissioned = true,
    };
}

/* A machine in the state asked for; the outputs agree with it. */
static struct estop machine(enum ctlstate state) {
    struct estop estop;
    struct estop_inputs in = healthy();
    estop_init(&estop, RESETCAUSE_POWER);
    assert_false(estop_tick(&estop, &in));
    for (int i = 0; i < 10; i++) /* the laser has long been dark */
        (void)estop_tick(&estop, &in);
    if (state == CTLSTATE_READY || state == CTLSTATE_LASER)
        assert_int_equal(estop_motors(&estop, true), REFUSAL_NONE);
    if (state == CTLSTATE_LASER)
        assert_int_equal(estop_laser(&estop, true), REFUSAL_NONE);
    if (state == CTLSTATE_FAULT)
        estop_trip(&estop, FAULT_ESTOP, 0, 1);
    assert_int_equal(estop.state, state);
    return estop;
}

struct cause {
    enum faultcode fault;
    enum ctlstate least; /* lowest state in which it trips: IDLE always, READY, LASER */
    int32_t context;
};

static const struct cause causes[] = {
    {FAULT_ESTOP, CTLSTATE_IDLE, HAL_IN_INTERLOCK_CLOSED | HAL_IN_DOOR_CLOSED},
    {FAULT_INTERLOCK, CTLSTATE_IDLE, HAL_IN_ESTOP_CLOSED | HAL_IN_DOOR_CLOSED},
    {FAULT_DOOR, CTLSTATE_IDLE, HAL_IN_ESTOP_CLOSED | HAL_IN_INTERLOCK_CLOSED},
    {FAULT_OVER_TEMP, CTLSTATE_IDLE, 701},
    {FAULT_TEMP_SENSOR, CTLSTATE_IDLE, 0},
    {FAULT_PAN_LIMIT, CTLSTATE_IDLE, 11},
    {FAULT_TILT_LIMIT, CTLSTATE_IDLE, 22},
    {FAULT_MIRROR_SLOW, CTLSTATE_LASER, 1999},
    {FAULT_MIRROR_FAST, CTLSTATE_IDLE, 16000},
    {FAULT_MIRROR_STALL, CTLSTATE_READY, 4000},
    {FAULT_HOST_SILENT, CTLSTATE_READY, 1001},
    {FAULT_STACK, CTLSTATE_IDLE, 255},
    {FAULT_CLOCK, CTLSTATE_IDLE, 751},
    {FAULT_LOOP, CTLSTATE_IDLE, 51},
    {FAULT_PAN_HOMING, CTLSTATE_IDLE, 3},
    {FAULT_TILT_HOMING, CTLSTATE_IDLE, 4},
    {FAULT_LASER_STUCK, CTLSTATE_IDLE, 0},
};

static struct estop_inputs world_with(enum faultcode fault) {
    struct estop_inputs in = healthy();
    switch (fault) {
    case FAULT_ESTOP:
        in.pins &= ~(uint32_t)HAL_IN_ESTOP_CLOSED;
        break;
    case FAULT_INTERLOCK:
        in.pins &= ~(uint32_t)HAL_IN_INTERLOCK_CLOSED;
        break;
    case FAULT_DOOR:
        in.pins &= ~(uint32_t)HAL_IN_DOOR_CLOSED;
        break;
    case FAULT_OVER_TEMP:
        in.temperature = 701;
        break;
    case FAULT_TEMP_SENSOR:
        in.temperature_valid = false;
        break;
    case FAULT_PAN_LIMIT:
        in.pan_limit_hit = true;
        break;
    case FAULT_TILT_LIMIT:
        in.tilt_limit_hit = true;
        break;
    case FAULT_MIRROR_SLOW:
        in.mirror_in_range = false;
        in.mirror_mrps = 1999;
        break;
    case FAULT_MIRROR_FAST:
        in.mirror_too_fast = true; /* then it is not in range either, but FAST says more */
        in.mirror_in_range = false;
        in.mirror_mrps = 16000;
        break;
    case FAULT_MIRROR_STALL:
        in.mirror_stalled = true;
        break;
    case FAULT_HOST_SILENT:
        in.host_silence_ms = 1001;
        break;
    case FAULT_STACK:
        in.stack_free = 255;
        break;
    case FAULT_CLOCK:
        in.tick_interval_us = 751;
        break;
    case FAULT_LOOP:
        in.loop_stall_ms = 51;
        break;
    case FAULT_PAN_HOMING:
        in.pan_homing_failed = true;
        break;
    case FAULT_TILT_HOMING:
        in.tilt_homing_failed = true;
        break;
    case FAULT_LASER_STUCK:
        in.laser_current = true;
        break;
    case FAULT_NONE:
    case FAULT_WATCHDOG:
    case FAULT_COUNT_:
        fail();
    }
    return in;
}

static void starts_with_both_outputs_off(void **state) {
    (void)state;
    laser_out = motors_out = true;
    struct estop estop;
    estop_init(&estop, RESETCAUSE_POWER);
    assert_false(laser_out);
    assert_false(motors_out);
    assert_int_equal(estop.state, CTLSTATE_IDLE);
    assert_int_equal(estop.fault, FAULT_NONE);
}

static void watchdog_reset_starts_latched(void **state) {
    (void)state;
    struct estop estop;
    struct estop_inputs in = healthy();
    estop_init(&estop, RESETCAUSE_WATCHDOG);
    assert_int_equal(estop.state, CTLSTATE_FAULT);
    assert_int_equal(estop.fault, FAULT_WATCHDOG);
    assert_false(estop_tick(&estop, &in));
    assert_int_equal(estop_motors(&estop, true), REFUSAL_FAULTED);
    assert_int_equal(estop_clear(&estop, FAULT_WATCHDOG), REFUSAL_NONE);
    assert_int_equal(estop.state, CTLSTATE_IDLE);
}

static void every_cause_trips_in_its_states_and_only_there(void **state) {
    (void)state;
    const enum ctlstate states[] = {CTLSTATE_IDLE, CTLSTATE_READY, CTLSTATE_LASER};
    for (size_t c = 0; c < sizeof causes / sizeof causes[0]; c++) {
        for (size_t s = 0; s < 3; s++) {
            struct estop estop = machine(states[s]);
            struct estop_inputs in = world_with(causes[c].fault);
            in.now_us = 77;
            bool lit = causes[c].fault == FAULT_LASER_STUCK && states[s] == CTLSTATE_LASER;
            bool trips = states[s] >= causes[c].least && !lit;
            assert_int_equal(estop_tick(&estop, &in), trips);
            if (!trips) {
                assert_int_equal(estop.state, states[s]);
                continue;
            }
            assert_false(laser_out);
            assert_false(motors_out);
            assert_int_equal(estop.state, CTLSTATE_FAULT);
            assert_int_equal(estop.fault, causes[c].fault);
            assert_int_equal(estop.context, causes[c].context);
            assert_int_equal(estop.fault_us, 77);
            assert_int_equal(estop.fault_count, 1);
        }
    }
}

static void clock_source_failure_trips_whatever_the_tick_interval(void **state) {
    (void)state;
    struct estop estop = machine(CTLSTATE_LASER);
    struct estop_inputs in = healthy();
    in.clock_ok = false;
    assert_true(estop_tick(&estop, &in));
    assert_int_equal(estop.fault, FAULT_CLOCK);
}

static void late_tick_is_no_fault_where_the_clock_is_lax(void **state) {
    (void)state;
    struct estop estop = machine(CTLSTATE_LASER);
    struct estop_inputs in = healthy();
    in.tick_limit_us = 0;
    in.tick_interval_us = 100000;
    assert_false(estop_tick(&estop, &in));
    assert_true(laser_out);
}

static void fault_stays_when_its_cause_goes_and_no_command_gets_through(void **state) {
    (void)state;
    struct estop estop = machine(CTLSTATE_LASER);
    struct estop_inputs in = world_with(FAULT_DOOR), well = healthy();
    assert_true(estop_tick(&estop, &in));
    assert_int_equal(estop_clear(&estop, FAULT_DOOR), REFUSAL_CONDITION);
    assert_false(estop_tick(&estop, &well));
    assert_int_equal(estop.state, CTLSTATE_FAULT);
    assert_int_equal(estop_motors(&estop, true), REFUSAL_FAULTED);
    assert_int_equal(estop_laser(&estop, true), REFUSAL_FAULTED);
    assert_int_equal(estop_motors(&estop, false), REFUSAL_NONE);
    assert_int_equal(estop_laser(&estop, false), REFUSAL_NONE);
    assert_int_equal(estop.state, CTLSTATE_FAULT);
    assert_false(laser_out || motors_out);
}

static void only_the_latched_code_clears(void **state) {
    (void)state;
    struct estop estop = machine(CTLSTATE_LASER);
    struct estop_inputs in = world_with(FAULT_DOOR), well = healthy();
    (void)estop_tick(&estop, &in);
    (void)estop_tick(&estop, &well);
    assert_int_equal(estop_clear(&estop, FAULT_ESTOP), REFUSAL_WRONG_FAULT);
    assert_int_equal(estop.state, CTLSTATE_FAULT);
    assert_int_equal(estop_clear(&estop, FAULT_DOOR), REFUSAL_NONE);
    assert_int_equal(estop.state, CTLSTATE_IDLE);
    assert_false(laser_out || motors_out);
    assert_int_equal(estop_clear(&estop, FAULT_DOOR), REFUSAL_WRONG_FAULT);
}

static void first_cause_wins_and_a_second_one_does_not_overwrite_it(void **state) {
    (void)state;
    struct estop estop = machine(CTLSTATE_LASER);
    struct estop_inputs in = world_with(FAULT_OVER_TEMP), later = world_with(FAULT_ESTOP);
    (void)estop_tick(&estop, &in);
    assert_false(estop_tick(&estop, &later));
    assert_int_equal(estop.fault, FAULT_OVER_TEMP);
    assert_int_equal(estop.conditions, 1u << FAULT_ESTOP);
    estop_trip(&estop, FAULT_CLOCK, 5, 9);
    assert_int_equal(estop.fault, FAULT_OVER_TEMP);
    assert_int_equal(estop.fault_count, 1);
}

static void outputs_are_driven_off_again_at_each_tick_of_a_fault(void **state) {
    (void)state;
    struct estop estop = machine(CTLSTATE_FAULT);
    struct estop_inputs in = healthy();
    laser_out = motors_out = true; /* an upset port pin */
    (void)estop_tick(&estop, &in);
    assert_false(laser_out || motors_out);
}

static void trip_from_outside_the_tick_acts_at_once(void **state) {
    (void)state;
    struct estop estop = machine(CTLSTATE_LASER);
    estop_trip(&estop, FAULT_CLOCK, -3, 42);
    assert_false(laser_out || motors_out);
    assert_int_equal(estop.fault, FAULT_CLOCK);
    assert_int_equal(estop.context, -3);
    assert_int_equal(estop.fault_us, 42);
}

static void motors_need_a_host_that_speaks(void **state) {
    (void)state;
    struct estop estop = machine(CTLSTATE_IDLE);
    struct estop_inputs in = world_with(FAULT_HOST_SILENT);
    assert_false(estop_tick(&estop, &in));
    assert_int_equal(estop_motors(&estop, true), REFUSAL_HOST);
    assert_false(motors_out);
}

static void laser_needs_motors_mirror_limits_and_commissioning(void **state) {
    (void)state;
    struct estop idle = machine(CTLSTATE_IDLE);
    assert_int_equal(estop_laser(&idle, true), REFUSAL_MOTORS_OFF);
    struct estop estop = machine(CTLSTATE_READY);
    struct estop_inputs in = healthy();
    in.mirror_in_range = false;
    (void)estop_tick(&estop, &in);
    assert_int_equal(estop_laser(&estop, true), REFUSAL_MIRROR);
    in.limit_closed = true;
    (void)estop_tick(&estop, &in);
    assert_int_equal(estop_laser(&estop, true), REFUSAL_LIMIT);
    in.commissioned = false;
    (void)estop_tick(&estop, &in);
    assert_int_equal(estop_laser(&estop, true), REFUSAL_UNCOMMISSIONED);
    assert_false(laser_out);
    in = healthy();
    (void)estop_tick(&estop, &in);
    assert_int_equal(estop_laser(&estop, true), REFUSAL_NONE);
    assert_true(laser_out);
    assert_int_equal(estop_laser(&estop, true), REFUSAL_NONE);
}

static void laser_off_leaves_the_motors_on_and_motors_off_takes_both(void **state) {
    (void)state;
    struct estop estop = machine(CTLSTATE_LASER);
    assert_int_equal(estop_laser(&estop, false), REFUSAL_NONE);
    assert_int_equal(estop.state, CTLSTATE_READY);
    assert_false(laser_out);
    assert_true(motors_out);
    assert_int_equal(estop_motors(&estop, true), REFUSAL_NONE);
    assert_int_equal(estop.state, CTLSTATE_READY);
    assert_int_equal(estop_laser(&estop, true), REFUSAL_NONE);
    assert_int_equal(estop_motors(&estop, true), REFUSAL_NONE);
    assert_true(laser_out); /* asking for motors again changes nothing */
    assert_int_equal(estop_motors(&estop, false), REFUSAL_NONE);
    assert_int_equal(estop.state, CTLSTATE_IDLE);
    assert_false(laser_out || motors_out);
}

static void current_that_falls_within_four_ticks_is_not_stuck(void **state) {
    (void)state;
    struct estop estop = machine(CTLSTATE_LASER);
    struct estop_inputs in = healthy();
    assert_int_equal(estop_laser(&estop, false), REFUSAL_NONE);
    in.laser_current = true;
    for (int i = 0; i < 3; i++)
        assert_false(estop_tick(&estop, &in));
    assert_true(estop_tick(&estop, &in));
    assert_int_equal(estop.fault, FAULT_LASER_STUCK);
}

static void fault_count_saturates(void **state) {
    (void)state;
    struct estop estop = machine(CTLSTATE_IDLE);
    estop.fault_count = UINT16_MAX;
    estop_trip(&estop, FAULT_LOOP, 0, 0);
    assert_int_equal(estop.fault_count, UINT16_MAX);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(starts_with_both_outputs_off),
        cmocka_unit_test(watchdog_reset_starts_latched),
        cmocka_unit_test(every_cause_trips_in_its_states_and_only_there),
        cmocka_unit_test(clock_source_failure_trips_whatever_the_tick_interval),
        cmocka_unit_test(late_tick_is_no_fault_where_the_clock_is_lax),
        cmocka_unit_test(fault_stays_when_its_cause_goes_and_no_command_gets_through),
        cmocka_unit_test(only_the_latched_code_clears),
        cmocka_unit_test(first_cause_wins_and_a_second_one_does_not_overwrite_it),
        cmocka_unit_test(outputs_are_driven_off_again_at_each_tick_of_a_fault),
        cmocka_unit_test(trip_from_outside_the_tick_acts_at_once),
        cmocka_unit_test(motors_need_a_host_that_speaks),
        cmocka_unit_test(laser_needs_motors_mirror_limits_and_commissioning),
        cmocka_unit_test(laser_off_leaves_the_motors_on_and_motors_off_takes_both),
        cmocka_unit_test(current_that_falls_within_four_ticks_is_not_stuck),
        cmocka_unit_test(fault_count_saturates),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
