/* The cart around the controller: mirror with inertia, encoder and index, two axes with switches
 * and backlash. */
#include "firmware/port/sim/simstate.h"
#include <math.h>

/* The mirror's motion is exact over one plant step; its torque changes between steps. */
#define PLANT_STEP_US 500u

static const double two_pi = 6.28318530717958647693;

/* The mirror without its ripple. */
static double smooth_rev(const struct sim *sim, double t_us) {
    const struct simplant_segment *seg = &sim->mirror;
    double s = (t_us - seg->t0_us) * 1e-6;
    return seg->rev0 + s * (seg->rps0 + 0.5 * seg->acceleration * s);
}

static double smooth_rps(const struct sim *sim, double t_us) {
    const struct simplant_segment *seg = &sim->mirror;
    return seg->rps0 + (t_us - seg->t0_us) * 1e-6 * seg->acceleration;
}

double simplant_rev(const struct sim *sim, double t_us) {
    return sim_ripple(&sim->config, smooth_rev(sim, t_us));
}

double simplant_rps(const struct sim *sim, double t_us) {
    double rps = smooth_rps(sim, t_us);
    if (sim->config.mirror_ripple == 0)
        return rps;
    double rev = smooth_rev(sim, t_us);
    double angle = two_pi * (rev - floor(rev)) + sim->config.mirror_ripple_phase_rad;
    return rps * (1 + sim->config.mirror_ripple * cos(angle));
}

uint16_t simplant_encoder(const struct sim *sim, double t_us) {
    if (sim->encoder_dead)
        return sim->encoder_frozen;
    /* The index lies in the middle of a count, so that both captures of one edge agree. */
    double counts = floor(simplant_rev(sim, t_us) * sim->config.encoder_counts + 0.5);
    return (uint16_t)((uint64_t)counts + (uint64_t)(int64_t)sim->encoder_slip);
}

/* Time within this segment at which the mirror passes its next whole turn after t_us; INFINITY if
 * not in it. */
static double next_index(const struct sim *sim, double t_us, double end_us) {
    double turn = floor(simplant_rev(sim, t_us)) + 1;
    if (simplant_rev(sim, end_us) < turn)
        return INFINITY;
    double low = t_us, high = end_us; /* the speed is never negative: bisection is safe */
    for (int i = 0; i < 60; i++) {
        double middle = 0.5 * (low + high);
        if (simplant_rev(sim, middle) < turn)
            low = middle;
        else
            high = middle;
    }
    return high;
}

static void new_segment(struct sim *sim, double rev, double rps) {
    double now_us = (double)sim->now_us, dt_s = PLANT_STEP_US * 1e-6;
    double drive = sim->motors ? sim->drive / 10000.0 : 0;
    double goal_rps = sim->config.mirror_gain_rps * sim->mirror_gain * drive;
    double acceleration = (goal_rps - rps) / sim->config.mirror_tau_s;
    if (sim->config.mirror_jitter > 0)
        acceleration += sim->config.mirror_jitter * simstate_normal(sim) / sqrt(dt_s);
    if (sim->mirror_blocked) {
        rps = 0;
        acceleration = 0;
    }
    if (rps + acceleration * dt_s < 0) /* it never turns back */
        acceleration = -rps / dt_s;
    sim->mirror = (struct simplant_segment){now_us, rev, rps, acceleration};
    double index_us = next_index(sim, now_us, (double)sim->next_plant);
    bool edge_waits = sim->index_us <= now_us; /* its interrupt comes in this very microsecond */
    if (!sim->index_extra && !edge_waits)
        sim->index_us = index_us;
    if (sim->observer && sim->observer->mirror)
        sim->observer->mirror(sim->observer_ctx, sim->now_us, sim->next_plant, rev, rps,
                              acceleration);
}

void simplant_step(struct sim *sim) {
    double end_us = (double)sim->next_plant;
    sim->next_plant += PLANT_STEP_US;
    new_segment(sim, smooth_rev(sim, end_us), fmax(smooth_rps(sim, end_us), 0));
}

void simplant_cut(struct sim *sim) {
    double now_us = (double)sim->now_us;
    new_segment(sim, smooth_rev(sim, now_us), fmax(smooth_rps(sim, now_us), 0));
}

void simplant_init(struct sim *sim) {
    sim->mirror_gain = 1;
    sim->fault_next_us = SIMSTATE_NEVER;
    sim->index_us = INFINITY;
    sim->strobe_us = INFINITY;
    sim->chains = HAL_IN_ESTOP_CLOSED | HAL_IN_INTERLOCK_CLOSED | HAL_IN_DOOR_CLOSED;
    sim->temperature_c = sim->config.temperature_c;
    sim->stack_free = 4096;
    sim->next_plant = PLANT_STEP_US;
    sim->mirror.rev0 = sim->config.mirror_start_rev;
    for (int i = 0; i < HAL_AXES; i++) {
        sim->axis[i].motor = sim->config.axis[i].start;
        sim->axis[i].head = sim->config.axis[i].start;
        sim->axis[i].positive = true;
    }
}

/* A step pulse moves the motor if it has power, is free and not too fast; the head follows with the
 * gears' play: pushed by the motor in positive direction, `backlash` behind it in negative
 * direction. */
static void move_motor(const struct sim *sim, struct simplant_axis *axis,
                       const struct sim_axis_config *config) {
    double interval_us = (double)(sim->now_us - axis->last_pulse_us);
    bool lost = !sim->motors || axis->blocked || interval_us * config->stall_velocity < 1e6;
    axis->last_pulse_us = sim->now_us;
    if (axis->lose) {
        axis->lose--;
        lost = true;
    }
    double motor = axis->motor + (axis->positive ? 1 : -1);
    if (lost || motor < config->travel_min || motor > config->travel_max)
        return;
    axis->motor = motor;
    axis->head = fmin(fmax(axis->head, motor), motor + config->backlash);
}

void simplant_pulse(struct sim *sim, enum hal_axis id) {
    struct simplant_axis *axis = &sim->axis[id];
    axis->pulses += axis->positive ? 1 : -1;
    move_motor(sim, axis, &sim->config.axis[id]);
    if (sim->observer && sim->observer->step)
        sim->observer->step(sim->observer_ctx, sim->now_us, id, axis->positive);
}

static uint32_t switches(const struct sim *sim, enum hal_axis id) {
    const struct sim_axis_config *config = &sim->config.axis[id];
    double head = sim->axis[id].head;
    uint32_t bits = 0;
    bits |= head < config->limit_min ? HAL_IN_PAN_LIMIT_MIN : 0u;
    bits |= head > config->limit_max ? HAL_IN_PAN_LIMIT_MAX : 0u;
    bits |= head < config->home_edge && !sim->home_dead ? HAL_IN_PAN_HOME : 0u;
    return id == HAL_PAN ? bits : bits << 3;
}

uint32_t simplant_inputs(const struct sim *sim) {
    uint32_t bits = sim->chains | sim->forced | switches(sim, HAL_PAN) | switches(sim, HAL_TILT);
    return bits | (sim->laser || sim->laser_stuck ? HAL_IN_LASER_CURRENT : 0u);
}
