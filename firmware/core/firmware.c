#include "firmware/core/firmware.h"
#include "firmware/core/cregs.h"
#include "firmware/core/ctlcmd.h"
#include "firmware/core/stepsched.h"
#include "firmware/core/timebase.h"
#include "firmware/hal/hal_board.h"
#include "firmware/hal/hal_capture.h"
#include "firmware/hal/hal_safety.h"
#include "firmware/hal/hal_time.h"

/* A tick this late trips FAULT_CLOCK: an interrupt hung, or the clock is not what it was. */
#define TICK_LIMIT_US (HAL_TICK_US + HAL_TICK_US / 2)

void firmware_init(void) {
    struct firmware *fw = hal_firmware();
    const struct hal_board *board = hal_board();
    fw->time_us = hal_time_now();
    estop_init(&fw->estop, board->reset_cause);
    for (unsigned i = 0; i < HAL_AXES; i++)
        axis_init(&fw->axis[i], (enum hal_axis)i);
    mirrorctl_init(&fw->mirror, &(struct mirrorctl_params){.safe_mrps = 1});
    encunwrap_init(&fw->encoder, hal_capture_encoder().count);
    strobe_init(&fw->strobe);
    scanprog_init(&fw->scan);
    evring_init(&fw->events);
    idxfilter_init(&fw->index);
    fw->revolution = 0;
    fw->index_missed = 0;
    fw->index_rejected = 0;
    fw->pins = hal_safety_inputs();
    fw->temperature = 0;
    fw->stack_free = UINT16_MAX;
    fw->ticked = false;
    fw->halted = false;
    fw->tick_max_us = 0;
    fw->step_slips = 0;
    fw->heard_us = fw->time_us;
    fw->loop_us = fw->time_us;
    fw->flash_busy = false;
    fw->ticks = 0;
    fw->refusal = REFUSAL_NONE;
    fw->refusal_address = 0;
    fw->host_age_ms = 0;
    fw->loop_max_us = 0;
    fw->kicked_tick = 0;
    cregs_init(fw);
    mblink_init(&fw->link, board->frame_gap_us);
    mbslave_init(&fw->slave, (uint8_t)fw->holding.unit_address, &cregs_model, fw);
    hal_axis_mirror_drive(0);
    hal_time_alarm_off();
}

/* The tick watches the loop; the loop watches the tick. Under the interrupt lock. */
static void watch_tick(struct firmware *fw) {
    uint32_t since_us = (uint32_t)fw->time_us - fw->tick_us;
    if (!fw->ticked || since_us <= TICK_LIMIT_US || hal_board()->caps & HAL_CAP_CLOCK_LAX)
        return;
    estop_trip(&fw->estop, FAULT_CLOCK, (int32_t)since_us, fw->time_us);
    firmware_halt(fw);
}

void firmware_poll(void) {
    struct firmware *fw = hal_firmware();
    uint32_t saved = hal_irq_save();
    fw->loop_us = timebase_now(fw);
    uint32_t ticks = fw->ticks;
    watch_tick(fw);
    hal_irq_restore(saved);
    uint32_t began_us = (uint32_t)fw->loop_us;
    (void)mblink_poll(&fw->link, &fw->slave);
    if (ticks != fw->kicked_tick) { /* only while the safety tick lives */
        fw->kicked_tick = ticks;
        hal_safety_watchdog_kick();
    }
    uint32_t took_us = hal_time_now() - began_us;
    if (took_us > fw->loop_max_us)
        fw->loop_max_us = took_us > UINT16_MAX ? UINT16_MAX : (uint16_t)took_us;
}

void firmware_halt(struct firmware *fw) {
    for (unsigned i = 0; i < HAL_AXES; i++)
        axis_abort(&fw->axis[i]);
    stepsched_arm(fw);
    mirrorctl_abort(&fw->mirror);
    hal_axis_mirror_drive(0);
    scanprog_end(&fw->scan);
    strobe_disarm(&fw->strobe);
}

/* --- the safety tick ------------------------------------------------------------------------- */

/* Rounded up, so that a limit in ms is exceeded as soon as it is passed. */
static uint32_t milliseconds(uint64_t now_us, uint64_t then_us) {
    uint64_t ms = (now_us - then_us + 999) / 1000;
    return ms > INT32_MAX ? INT32_MAX : (uint32_t)ms;
}

/* The interval since the last tick, 0 for the first one and while flash is written. */
static uint32_t tick_interval(struct firmware *fw) {
    uint32_t now = (uint32_t)fw->time_us;
    uint32_t interval = fw->ticked && !fw->flash_busy ? now - fw->tick_us : 0;
    fw->tick_us = now;
    fw->ticked = true;
    if (interval > fw->tick_max_us)
        fw->tick_max_us = interval > UINT16_MAX ? UINT16_MAX : (uint16_t)interval;
    return interval;
}

static struct estop_inputs gather(struct firmware *fw, uint32_t interval_us) {
    const struct hal_board *board = hal_board();
    const uint32_t limits =
        HAL_IN_PAN_LIMIT_MIN | HAL_IN_PAN_LIMIT_MAX | HAL_IN_TILT_LIMIT_MIN | HAL_IN_TILT_LIMIT_MAX;
    struct axis *pan = &fw->axis[HAL_PAN], *tilt = &fw->axis[HAL_TILT];
    fw->pins = hal_safety_inputs();
    fw->stack_free = hal_safety_stack_free();
    struct estop_inputs in = {.now_us = fw->time_us, .pins = fw->pins};
    in.temperature_valid = hal_safety_temperature(&fw->temperature);
    in.temperature = fw->temperature;
    in.temperature_max = fw->temperature_max;
    in.pan_limit_hit = axis_switches(pan, stepsched_switches(fw->pins, HAL_PAN));
    in.tilt_limit_hit = axis_switches(tilt, stepsched_switches(fw->pins, HAL_TILT));
    in.limit_closed = (fw->pins & limits) != 0;
    in.pan_steps = pan->position;
    in.tilt_steps = tilt->position;
    in.pan_homing = pan->homing;
    in.tilt_homing = tilt->homing;
    in.pan_homing_failed = pan->homing == AXIS_HOMING_FAILED;
    in.tilt_homing_failed = tilt->homing == AXIS_HOMING_FAILED;
    in.mirror_in_range = fw->mirror.in_range;
    in.mirror_too_fast = fw->mirror.too_fast;
    in.mirror_stalled = mirrorctl_stalled(&fw->mirror, fw->time_us);
    in.mirror_mrps = fw->mirror.speed_mrps;
    in.host_silence_ms = milliseconds(fw->time_us, fw->heard_us);
    in.host_timeout_ms = fw->host_timeout_ms;
    in.stack_free = fw->stack_free;
    in.stack_min = board->stack_min;
    in.clock_ok = hal_safety_clock_ok();
    in.tick_interval_us = interval_us;
    in.tick_limit_us = board->caps & HAL_CAP_CLOCK_LAX ? 0 : TICK_LIMIT_US;
    in.loop_stall_ms = fw->flash_busy ? 0 : milliseconds(fw->time_us, fw->loop_us);
    in.loop_limit_ms = FIRMWARE_LOOP_LIMIT_MS;
    in.laser_current =
        board->caps & HAL_CAP_LASER_CURRENT && (fw->pins & HAL_IN_LASER_CURRENT) != 0;
    in.commissioned = fw->commissioned;
    return in;
}

static void judge(struct firmware *fw, uint32_t interval_us) {
    struct estop_inputs in = gather(fw, interval_us);
    (void)estop_tick(&fw->estop, &in);
    bool faulted = fw->estop.state == CTLSTATE_FAULT;
    if (faulted &&
        !fw->halted) /* tripped here, or by firmware_isr_clock_failure since the last tick */
        firmware_halt(fw);
    fw->halted = faulted;
}

void firmware_isr_tick(void) {
    struct firmware *fw = hal_firmware();
    uint64_t now_us = timebase_now(fw);
    struct hal_encoder encoder = hal_capture_encoder();
    fw->ticks++;
    (void)encunwrap_update(&fw->encoder, encoder.count);
    mirrorctl_tick(&fw->mirror, now_us, encoder.count, encoder.now_us);
    judge(fw, tick_interval(fw));
}

void firmware_isr_pins(void) {
    struct firmware *fw = hal_firmware();
    (void)timebase_now(fw);
    judge(fw, 0);
}

void firmware_isr_clock_failure(void) {
    struct firmware *fw = hal_firmware();
    estop_trip(&fw->estop, FAULT_CLOCK, 0, fw->time_us);
}

/* --- the other interrupts -------------------------------------------------------------------- */

void firmware_isr_alarm(void) {
    stepsched_alarm(hal_firmware());
}

static struct idxevent event_now(const struct firmware *fw, enum idxevent_kind kind,
                                 uint64_t t_us) {
    const struct axis *pan = &fw->axis[HAL_PAN], *tilt = &fw->axis[HAL_TILT];
    unsigned pan_flags = axis_flags(pan);
    unsigned flags = kind;
    flags |= pan->active ? IDXEVENT_PAN_MOVING : 0u;
    flags |= tilt->active ? IDXEVENT_TILT_MOVING : 0u;
    flags |= pan->homed ? IDXEVENT_PAN_HOMED : 0u;
    flags |= tilt->homed ? IDXEVENT_TILT_HOMED : 0u;
    flags |= pan->positive ? IDXEVENT_PAN_POSITIVE : 0u;
    flags |= pan_flags & AXIS_TAKEN_UP ? IDXEVENT_PAN_TAKEN_UP : 0u;
    flags |= estop_laser_on(&fw->estop) ? IDXEVENT_LASER : 0u;
    flags |= fw->scan.state == SCANSTATE_SWEEP ? IDXEVENT_SWEEP : 0u;
    flags |= fw->mirror.in_range ? IDXEVENT_MIRROR_OK : 0u;
    return (struct idxevent){.time_us = t_us,
                             .revolution = fw->revolution,
                             .pan_steps = pan->position,
                             .tilt_steps = tilt->position,
                             .pan_phase = axis_phase(pan, t_us),
                             .flags = (uint16_t)flags};
}

void firmware_isr_index(uint32_t capture_us, uint16_t encoder_count) {
    struct firmware *fw = hal_firmware();
    (void)timebase_now(fw);
    uint64_t t_us = timebase_extend(fw, capture_us);
    uint32_t counts = encunwrap_update(&fw->encoder, encoder_count);
    const struct mirrorctl_params *params = &fw->mirror.params;
    uint16_t turns =
        idxfilter_turns(&fw->index, counts, params->has_encoder ? params->encoder_counts : 0);
    if (!turns || !mirrorctl_index(&fw->mirror, t_us, turns)) {
        fw->index_rejected++;
        return;
    }
    hal_axis_mirror_drive(fw->mirror.drive);
    fw->index_missed = (uint16_t)(fw->index_missed + turns - 1);
    fw->revolution += turns;
    struct idxevent event = event_now(fw, IDXEVENT_INDEX, t_us);
    scanprog_index(&fw->scan, &fw->axis[HAL_PAN], fw->time_us);
    event.flags |= turns > 1 ? IDXEVENT_AFTER_MISSED : 0u;
    event.flags |= fw->scan.overran ? IDXEVENT_OVERRUN : 0u;
    evring_add(&fw->events, &event);
    stepsched_arm(fw);
}

void firmware_isr_strobe(uint32_t capture_us) {
    struct firmware *fw = hal_firmware();
    (void)timebase_now(fw);
    uint64_t t_us = timebase_extend(fw, capture_us);
    struct idxevent event = event_now(fw, IDXEVENT_STROBE, t_us);
    strobe_seen(&fw->strobe, event.pan_steps, t_us);
    evring_add(&fw->events, &event);
}

void firmware_isr_rx(uint8_t byte, uint32_t now_us) {
    mblink_rx(&hal_firmware()->link, byte, now_us);
}

void firmware_isr_rx_error(uint32_t now_us) {
    mblink_rx_error(&hal_firmware()->link, now_us);
}

void firmware_isr_rx_idle(void) {
    mblink_rx_idle(&hal_firmware()->link);
}
