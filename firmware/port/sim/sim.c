/* The simulated port: instances, virtual time, and the order in which things happen. */
#include "firmware/port/sim/sim.h"
#include "firmware/port/sim/simstate.h"
#include "firmware/shared/faultcode.h"
#include "firmware/shared/mbframe.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

_Thread_local struct sim *simstate_current;

double simstate_uniform(struct sim *sim) {
    /* splitmix64 (Steele, Lea, Flood 2014) */
    uint64_t z = sim->random += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    z ^= z >> 31;
    return (double)(z >> 11) * 0x1p-53;
}

double simstate_normal(struct sim *sim) {
    double sum = -6;
    for (int i = 0; i < 12; i++)
        sum += simstate_uniform(sim);
    return sum;
}

struct sim_config sim_config_default(void) {
    struct sim_config config = {
        .mirror_gain_rps = 20,
        .mirror_tau_s = 0.8,
        .mirror_start_rev = 0.25,
        .encoder_counts = 4096,
        .camera_delay_s = 0.012,
        .temperature_c = 25,
        .baud = 115200,
        .poll_us = 100,
        .flash_us = 30000,
        .pin_interrupts = false,
        .encoder = true,
        .seed = 1,
        .serial = 1,
    };
    config.axis[HAL_PAN] = (struct sim_axis_config){.travel_min = -14600,
                                                    .travel_max = 14600,
                                                    .limit_min = -14200,
                                                    .limit_max = 14200,
                                                    .home_edge = -13800,
                                                    .backlash = 25,
                                                    .stall_velocity = 30000};
    config.axis[HAL_TILT] = (struct sim_axis_config){.travel_min = -4000,
                                                     .travel_max = 4000,
                                                     .limit_min = -3700,
                                                     .limit_max = 3700,
                                                     .home_edge = -3300,
                                                     .backlash = 25,
                                                     .stall_velocity = 30000};
    return config;
}

static bool sensible(const struct sim_config *c) {
    for (int i = 0; i < HAL_AXES; i++) {
        const struct sim_axis_config *a = &c->axis[i];
        if (!(a->travel_min < a->travel_max) || !(a->backlash >= 0) || !(a->stall_velocity > 0) ||
            !(a->start >= a->travel_min && a->start <= a->travel_max))
            return false;
    }
    return c->mirror_gain_rps > 0 && c->mirror_tau_s > 0.001 && c->mirror_jitter >= 0 &&
           c->encoder_counts > 0 && c->baud > 0 && c->poll_us > 0 && c->camera_delay_s >= 0 &&
           c->camera_jitter_s >= 0 && isfinite(c->temperature_c) && isfinite(c->mirror_start_rev) &&
           c->mirror_ripple >= 0 && c->mirror_ripple < 0.9 &&
           isfinite(c->mirror_ripple_phase_rad) && c->capture_jitter_us >= 0;
}

/* Interrupt and reset state of the controller; the plant stays as it is. */
static void boot(struct sim *sim, uint16_t reset_cause) {
    simstate_current = sim;
    /* Garbage, as in a RAM after power-up: nothing may rely on zeros. */
    memset(&sim->firmware, 0xa5, sizeof sim->firmware);
    sim->board.reset_cause = reset_cause;
    sim->boot_us = sim->now_us;
    sim->alarm_us = SIMSTATE_NEVER;
    sim->alarm_slip_us = 0;
    sim->next_tick = sim->now_us + HAL_TICK_US;
    sim->next_poll = sim->now_us + sim->config.poll_us;
    sim->tx_end_us = sim->now_us;
    sim->locked = 0;
    hal_safety_laser(false);
    hal_safety_motors(false);
    sim->drive = 0;
    firmware_init();
}

struct sim *sim_create(const struct sim_config *config) {
    if (!sensible(config))
        return NULL;
    struct sim *sim = calloc(1, sizeof *sim);
    if (!sim)
        return NULL;
    sim->config = *config;
    sim->random = config->seed;
    uint32_t gap_us = config->frame_gap_us ? config->frame_gap_us : mbframe_gap_us(config->baud);
    unsigned caps = HAL_CAP_LASER_CURRENT | (config->encoder ? HAL_CAP_ENCODER : 0u);
    sim->board = (struct hal_board){.name = "sim",
                                    .board_id = 3,
                                    .serial = config->serial,
                                    .baud = config->baud,
                                    .frame_gap_us = gap_us,
                                    .caps = (uint16_t)caps,
                                    .stack_min = 256};
    memset(sim->flash, 0xff, sizeof sim->flash);
    simplant_init(sim);
    boot(sim, RESETCAUSE_POWER);
    return sim;
}

void sim_destroy(struct sim *sim) {
    if (simstate_current == sim)
        simstate_current = NULL;
    free(sim);
}

void sim_reset(struct sim *sim, uint16_t reset_cause) {
    boot(sim, reset_cause);
}

uint64_t sim_now_us(const struct sim *sim) {
    return sim->now_us;
}

void sim_observe(struct sim *sim, const struct sim_observer *observer, void *ctx) {
    sim->observer = observer;
    sim->observer_ctx = ctx;
}

const struct firmware *sim_firmware(const struct sim *sim) {
    return &sim->firmware;
}

struct sim_truth sim_truth(const struct sim *sim) {
    struct sim_truth truth = {.t_us = sim->now_us,
                              .mirror_rev = simplant_rev(sim, (double)sim->now_us),
                              .mirror_rps = simplant_rps(sim, (double)sim->now_us),
                              .laser = sim->laser,
                              .motors = sim->motors,
                              .inputs = simplant_inputs(sim),
                              .trigger = sim->now_us < sim->trigger_end_us};
    for (int i = 0; i < HAL_AXES; i++) {
        truth.head_steps[i] = sim->axis[i].head;
        truth.motor_steps[i] = sim->axis[i].motor;
        truth.pulses[i] = sim->axis[i].pulses;
    }
    return truth;
}

struct sim_step sim_step(const struct sim *sim, enum hal_axis id) {
    const struct axis *axis = &sim->firmware.axis[id];
    double ahead_us = (double)sim->boot_us - (double)sim->config.clock_start;
    return (struct sim_step){.pending = axis->ramp.pending,
                             .positive = axis->positive,
                             .since_us = (double)axis->last_step_us + ahead_us,
                             .due_us = (double)ramp_due_us(&axis->ramp) + ahead_us,
                             .counted = axis->position};
}

static const double two_pi = 6.28318530717958647693;

double sim_ripple(const struct sim_config *config, double rev) {
    if (config->mirror_ripple == 0)
        return rev;
    double angle = two_pi * (rev - floor(rev)) + config->mirror_ripple_phase_rad;
    return rev + config->mirror_ripple / two_pi * sin(angle);
}

double sim_mirror_rev_at(const struct sim *sim, double t_us) {
    return simplant_rev(sim, t_us);
}

/* --- what happens next ----------------------------------------------------------------------- */

/* In this order if at the same time. */
enum source {
    SOURCE_FAULT,
    SOURCE_PLANT,
    SOURCE_RX,
    SOURCE_INDEX,
    SOURCE_STROBE,
    SOURCE_ALARM,
    SOURCE_TICK,
    SOURCE_POLL,
    SOURCES
};

/* First whole microsecond at or after an edge: when its interrupt runs. */
static uint64_t edge_time(double exact_us) {
    return isfinite(exact_us) ? (uint64_t)ceil(exact_us) : SIMSTATE_NEVER;
}

static uint64_t source_time(const struct sim *sim, enum source source) {
    switch (source) {
    case SOURCE_FAULT:
        return sim->fault_next_us;
    case SOURCE_PLANT:
        return sim->next_plant;
    case SOURCE_RX:
        return sim->rx_tail == sim->rx_head ? SIMSTATE_NEVER
                                            : sim->rx[sim->rx_tail % SIMSTATE_RX].t_us;
    case SOURCE_INDEX:
        return edge_time(sim->index_us);
    case SOURCE_STROBE:
        return edge_time(sim->strobe_us);
    case SOURCE_ALARM:
        return sim->alarm_us;
    case SOURCE_TICK:
        return sim->next_tick;
    case SOURCE_POLL:
        return sim->next_poll;
    case SOURCES:
        break;
    }
    return SIMSTATE_NEVER;
}

/* Captures by hardware: the counter's value at the edge, whole microseconds. */
static uint32_t capture(struct sim *sim, double exact_us) {
    if (sim->config.capture_jitter_us > 0)
        exact_us += sim->config.capture_jitter_us * simstate_normal(sim);
    return (uint32_t)((uint64_t)floor(exact_us) - sim->boot_us + sim->config.clock_start);
}

static uint32_t clock_now(const struct sim *sim) {
    return (uint32_t)(sim->now_us - sim->boot_us + sim->config.clock_start);
}

static void run_rx(struct sim *sim) {
    uint8_t byte = sim->rx[sim->rx_tail++ % SIMSTATE_RX].byte;
    if (sim->line_noise > 0 && simstate_uniform(sim) < sim->line_noise)
        byte ^= (uint8_t)(1u << (unsigned)(simstate_uniform(sim) * 8));
    if (!sim->line_cut)
        firmware_isr_rx(byte, clock_now(sim));
}

static void run_index(struct sim *sim) {
    double exact_us = sim->index_us;
    bool extra = sim->index_extra;
    sim->index_us = INFINITY;
    sim->index_extra = false;
    if (!extra) {
        uint64_t turn = (uint64_t)llround(simplant_rev(sim, exact_us));
        if (sim->observer && sim->observer->index)
            sim->observer->index(sim->observer_ctx, exact_us, turn);
        if (sim->index_skip) {
            sim->index_skip--;
            return;
        }
    }
    if (sim->observer && sim->observer->pulse)
        sim->observer->pulse(sim->observer_ctx, exact_us);
    firmware_isr_index(capture(sim, exact_us), simplant_encoder(sim, exact_us));
    if (extra)
        simplant_cut(sim); /* the true edge may still be ahead */
}

static void run_strobe(struct sim *sim) {
    double exact_us = sim->strobe_us;
    sim->strobe_us = INFINITY;
    if (sim->strobe_skip) {
        sim->strobe_skip--;
        return;
    }
    if (sim->observer && sim->observer->strobe)
        sim->observer->strobe(sim->observer_ctx, exact_us);
    firmware_isr_strobe(capture(sim, exact_us));
}

static void run_source(struct sim *sim, enum source source) {
    switch (source) {
    case SOURCE_FAULT:
        simfault_run(sim);
        break;
    case SOURCE_PLANT:
        simplant_step(sim);
        break;
    case SOURCE_RX:
        run_rx(sim);
        break;
    case SOURCE_INDEX:
        run_index(sim);
        break;
    case SOURCE_STROBE:
        run_strobe(sim);
        break;
    case SOURCE_ALARM:
        sim->alarm_us = SIMSTATE_NEVER;
        firmware_isr_alarm();
        break;
    case SOURCE_TICK:
        sim->next_tick += HAL_TICK_US;
        firmware_isr_tick();
        break;
    case SOURCE_POLL:
        sim->next_poll = sim->now_us + sim->config.poll_us;
        sim->in_poll = true;
        firmware_poll();
        sim->in_poll = false;
        break;
    case SOURCES:
        break;
    }
}

/* Runs what is due until t_us, sources below `limit` only. Time never goes backwards: what comes
 * late, comes now. */
static void run_until(struct sim *sim, uint64_t t_us, enum source limit) {
    simstate_current = sim;
    for (;;) {
        enum source first = SOURCES;
        uint64_t at = SIMSTATE_NEVER;
        for (enum source s = SOURCE_FAULT; s < limit; s++) {
            uint64_t t = source_time(sim, s);
            if (t < at) {
                at = t;
                first = s;
            }
        }
        if (first == SOURCES || at > t_us)
            break;
        if (at > sim->now_us)
            sim->now_us = at;
        run_source(sim, first);
    }
    if (t_us > sim->now_us)
        sim->now_us = t_us;
}

void simstate_interrupts_until(struct sim *sim, uint64_t t_us) {
    if (sim->in_interrupt)
        return;
    sim->in_interrupt = true;
    run_until(sim, t_us, SOURCE_POLL);
    sim->in_interrupt = false;
}

void sim_advance_to(struct sim *sim, uint64_t t_us) {
    if (t_us > sim->now_us)
        run_until(sim, t_us, SOURCES);
}

void sim_advance(struct sim *sim, uint64_t us) {
    sim_advance_to(sim, sim->now_us + us);
}
