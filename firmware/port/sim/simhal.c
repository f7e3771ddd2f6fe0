/* The functions of firmware/hal on the simulated plant. */
#include "firmware/hal/hal_axis.h"
#include "firmware/hal/hal_board.h"
#include "firmware/hal/hal_capture.h"
#include "firmware/hal/hal_flash.h"
#include "firmware/hal/hal_safety.h"
#include "firmware/hal/hal_time.h"
#include "firmware/hal/hal_uart.h"
#include "firmware/port/sim/simstate.h"
#include <assert.h>
#include <math.h>
#include <string.h>

static uint32_t clock_at(const struct sim *sim, uint64_t t_us) {
    return (uint32_t)(t_us - sim->boot_us + sim->config.clock_start);
}

/* --- time ------------------------------------------------------------------------------------ */

uint32_t hal_time_now(void) {
    return clock_at(simstate_current, simstate_current->now_us);
}

void hal_time_alarm(uint32_t at_us) {
    struct sim *sim = simstate_current;
    int32_t ahead = (int32_t)(at_us - hal_time_now());
    sim->alarm_us = sim->now_us + (ahead > 0 ? (uint64_t)ahead : 0) + sim->alarm_slip_us;
    sim->alarm_slip_us = 0;
}

void hal_time_alarm_off(void) {
    simstate_current->alarm_us = SIMSTATE_NEVER;
}

uint32_t hal_irq_save(void) {
    return simstate_current->locked++;
}

void hal_irq_restore(uint32_t saved) {
    struct sim *sim = simstate_current;
    assert(sim->locked == saved + 1); /* locks nest */
    sim->locked = saved;
    if (!saved && sim->in_poll && !sim->in_interrupt && sim->config.poll_slip_us)
        simstate_interrupts_until(sim, sim->now_us + sim->config.poll_slip_us);
}

/* --- line ------------------------------------------------------------------------------------ */

void hal_uart_send(const uint8_t *bytes, unsigned count) {
    struct sim *sim = simstate_current;
    assert(count >= 1 && count <= 256 && !hal_uart_sending());
    double byte_us = sim->config.lossless_line ? 0 : 11e6 / sim->config.baud;
    for (unsigned i = 0; i < count && !sim->line_cut; i++) {
        uint64_t t_us = sim->now_us + (uint64_t)ceil((i + 1) * byte_us);
        if (sim->tx_head - sim->tx_tail == SIMSTATE_TX)
            sim->tx_tail++; /* nobody collects: the oldest goes */
        sim->tx[sim->tx_head++ % SIMSTATE_TX] = (struct simline_byte){t_us, bytes[i]};
    }
    sim->tx_end_us = sim->now_us + (uint64_t)ceil(count * byte_us);
}

bool hal_uart_sending(void) {
    return simstate_current->now_us < simstate_current->tx_end_us;
}

/* --- axes and mirror ------------------------------------------------------------------------- */

void hal_axis_step(enum hal_axis axis) {
    simplant_pulse(simstate_current, axis);
}

void hal_axis_direction(enum hal_axis axis, bool positive) {
    simstate_current->axis[axis].positive = positive;
}

void hal_axis_mirror_drive(uint16_t drive) {
    assert(drive <= 10000);
    simstate_current->drive = drive;
}

struct hal_encoder hal_capture_encoder(void) {
    struct sim *sim = simstate_current;
    double now = (double)sim->now_us;
    struct hal_encoder encoder = {.now_us = hal_time_now(), .edge_us = hal_time_now()};
    if (!sim->config.encoder)
        return encoder;
    encoder.count = simplant_encoder(sim, now);
    double rps = simplant_rps(sim, now);
    if (rps > 0.01) {
        double counts = simplant_rev(sim, now) * sim->config.encoder_counts + 0.5;
        double since_us = (counts - floor(counts)) / (rps * sim->config.encoder_counts) * 1e6;
        encoder.edge_us = encoder.now_us - (uint32_t)since_us;
    }
    return encoder;
}

void hal_capture_trigger(uint16_t length_us) {
    struct sim *sim = simstate_current;
    sim->trigger_end_us = sim->now_us + length_us;
    if (sim->observer && sim->observer->trigger)
        sim->observer->trigger(sim->observer_ctx, sim->now_us);
    double jitter_s = sim->config.camera_jitter_s;
    double delay_s =
        sim->config.camera_delay_s + (jitter_s > 0 ? jitter_s * simstate_uniform(sim) : 0);
    if (!isfinite(sim->strobe_us)) /* still busy with the last: that trigger gives no picture */
        sim->strobe_us = (double)sim->now_us + delay_s * 1e6 + 0.5;
}

/* --- safety ---------------------------------------------------------------------------------- */

void hal_safety_laser(bool on) {
    struct sim *sim = simstate_current;
    if (on != sim->laser && sim->observer && sim->observer->laser)
        sim->observer->laser(sim->observer_ctx, sim->now_us, on);
    sim->laser = on;
}

void hal_safety_motors(bool on) {
    struct sim *sim = simstate_current;
    if (on != sim->motors && sim->observer && sim->observer->motors)
        sim->observer->motors(sim->observer_ctx, sim->now_us, on);
    sim->motors = on;
}

uint32_t hal_safety_inputs(void) {
    return simplant_inputs(simstate_current);
}

bool hal_safety_temperature(int16_t *out_decidegrees) {
    const struct sim *sim = simstate_current;
    if (sim->temp_broken)
        return false;
    *out_decidegrees = (int16_t)lround(sim->temperature_c * 10);
    return true;
}

uint16_t hal_safety_stack_free(void) {
    return simstate_current->stack_free;
}

bool hal_safety_clock_ok(void) {
    return !simstate_current->clock_bad;
}

void hal_safety_watchdog_kick(void) {
}

/* --- flash and board ------------------------------------------------------------------------- */

void hal_flash_read(uint8_t *out_bytes, unsigned count) {
    assert(count <= HAL_FLASH_SIZE);
    memcpy(out_bytes, simstate_current->flash, count);
}

bool hal_flash_write(const uint8_t *bytes, unsigned count) {
    struct sim *sim = simstate_current;
    assert(count <= HAL_FLASH_SIZE);
    simstate_interrupts_until(sim, sim->now_us + sim->config.flash_us);
    if (sim->flash_bad)
        return false;
    memset(sim->flash, 0xff, sizeof sim->flash);
    memcpy(sim->flash, bytes, count);
    return true;
}

const struct hal_board *hal_board(void) {
    return &simstate_current->board;
}

struct firmware *hal_firmware(void) {
    return &simstate_current->firmware;
}
