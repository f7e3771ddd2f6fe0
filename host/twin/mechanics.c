#include "twin/mechanics.h"

#include <math.h>
#include <string.h>

static const double pi = 3.14159265358979323846;
static const double wander_s = 0.7; /* correlation time of the mirror's speed */
static const double brake_s = 0.08; /* time constant of a seizing bearing */
static const double step_s = MECHANICS_STEP_NS * 1e-9;

static struct mechanics_axis axis_at(double motor_steps, double play_steps, double acceleration) {
    struct mechanics_axis axis = {.motor_steps = motor_steps,
                                  .target_steps = motor_steps,
                                  .acceleration_steps_s2 = acceleration,
                                  .play_steps = play_steps,
                                  .load_steps = motor_steps - play_steps / 2,
                                  .direction = 1};
    return axis;
}

void mechanics_init(struct mechanics *m, const struct twin_config *config,
                    const struct faults *faults, uint64_t seed) {
    memset(m, 0, sizeof *m);
    m->rig = twin_config_rig(config, true);
    m->spin_up_s = twin_config_real(config, TWIN_CONFIG_MIRROR_SPIN_UP);
    m->wander = twin_config_real(config, TWIN_CONFIG_MIRROR_WANDER);
    m->ripple = twin_config_real(config, TWIN_CONFIG_MIRROR_RIPPLE);
    m->faults = faults;
    m->rng = rng_make(seed);
    m->ripple_phase_rad = rng_range(&m->rng, 0, 2 * pi);
    m->mirror_rad = -pi / 2 + rng_range(&m->rng, 0, 1);
    m->wander_state = m->wander * rng_normal(&m->rng);
    double steps_a_deg = m->rig.pan_steps_per_turn / 360;
    double acceleration = twin_config_real(config, TWIN_CONFIG_PAN_ACCELERATION) * steps_a_deg;
    m->pan =
        axis_at(0, m->rig.pan_backlash_rad / (2 * pi) * m->rig.pan_steps_per_turn, acceleration);
    m->tilt = axis_at(0, 0, acceleration);
}

void mechanics_mirror(struct mechanics *m, double speed_hz) {
    m->mirror_target_rad_s = 2 * pi * speed_hz;
}

void mechanics_move(struct mechanics_axis *axis, double target_steps, double rate_steps_s) {
    axis->target_steps = target_steps;
    axis->rate_steps_s = rate_steps_s;
}

bool mechanics_at_rest(const struct mechanics_axis *axis) {
    return fabs(axis->motor_steps - axis->target_steps) < 1e-9 &&
           fabs(axis->velocity_steps_s) < 1e-9;
}

static double sign(double x) {
    return x > 0 ? 1 : x < 0 ? -1 : 0;
}

/* One step of a motor towards its target, and of the load behind its play. */
static void advance_axis(struct mechanics_axis *axis, bool stalled) {
    double way = axis->target_steps - axis->motor_steps, before = axis->motor_steps;
    double dv = axis->acceleration_steps_s2 * step_s;
    double wanted = fmin(axis->rate_steps_s, sqrt(2 * axis->acceleration_steps_s2 * fabs(way)));
    wanted *= sign(way);
    double v = axis->velocity_steps_s;
    v += fmax(-dv, fmin(dv, wanted - v));
    double move = v * step_s;
    if (fabs(way) <= fabs(move) + 1e-9 || (fabs(way) < dv * step_s && fabs(v) <= 2 * dv)) {
        move = way; /* arrives */
        v = 0;
    }
    axis->motor_steps += move;
    axis->velocity_steps_s = v;
    if (fabs(move) > 1e-12)
        axis->direction = move > 0 ? 1 : -1;
    if (stalled)
        axis->lost_steps += axis->motor_steps - before;
    double turned = axis->motor_steps - axis->lost_steps, half = axis->play_steps / 2;
    axis->load_steps = fmax(turned - half, fmin(turned + half, axis->load_steps));
}

static void advance_mirror(struct mechanics *m) {
    const struct faults *f = m->faults;
    double target = m->mirror_target_rad_s * (1 + m->wander_state), tau_s = m->spin_up_s;
    if (f && faults_at(f, FAULTS_MIRROR_STALL, m->t_ns, MECHANICS_STEP_NS)) {
        target = 0;
        tau_s = brake_s;
    }
    const struct fault *surge =
        f ? faults_at(f, FAULTS_MIRROR_SURGE, m->t_ns, MECHANICS_STEP_NS) : NULL;
    if (surge) {
        target *= surge->value;
        tau_s = brake_s;
    }
    double before = m->mirror_rad_s, gain = 1 - exp(-step_s / tau_s);
    /* near its speed the drive holds it: the wander is what the control leaves */
    if (fabs(before - m->mirror_target_rad_s) < 0.05 * m->mirror_target_rad_s && !surge)
        gain = target > 0 ? 1 - exp(-step_s / 0.05) : gain;
    m->mirror_rad_s = before + gain * (target - before);
    if (m->mirror_rad_s < 1e-4 && target <= 0)
        m->mirror_rad_s = 0;
    m->mirror_rad += 0.5 * (before + m->mirror_rad_s) * step_s;
    double keep = exp(-step_s / wander_s);
    if (m->wander > 0)
        m->wander_state =
            keep * m->wander_state + m->wander * sqrt(1 - keep * keep) * rng_normal(&m->rng);
}

static void note_knot(struct mechanics *m, int k) {
    struct mechanics_state *s = &m->knot[k];
    /* Ripple is a small modulation of the angle itself: d(theta)/dt = omega (1 + ripple cos(theta +
     * phase)). */
    s->mirror_rad = m->mirror_rad;
    s->mirror_rad_s = m->mirror_rad_s;
    s->pan_rad = rig_pan_angle(&m->rig, m->pan.load_steps, 0);
    s->tilt_rad = rig_tilt_angle(&m->rig, m->tilt.load_steps);
    s->pan_motor_steps = m->pan.motor_steps;
    s->tilt_motor_steps = m->tilt.motor_steps;
    m->knot_slip_counts[k] = m->slip_counts;
}

void mechanics_advance(struct mechanics *m, int steps) {
    m->block_t_ns = m->t_ns;
    m->knot_count = steps + 1;
    note_knot(m, 0);
    for (int k = 1; k <= steps; k++) {
        const struct faults *f = m->faults;
        const struct fault *lost =
            f ? faults_at(f, FAULTS_MISSED_STEPS, m->t_ns, MECHANICS_STEP_NS) : NULL;
        const struct fault *slip =
            f ? faults_at(f, FAULTS_ENCODER_SLIP, m->t_ns, MECHANICS_STEP_NS) : NULL;
        if (lost && lost->start_ns >= m->t_ns)
            m->pan.lost_steps += lost->value;
        if (slip && slip->start_ns >= m->t_ns)
            m->slip_counts += slip->value;
        advance_mirror(m);
        advance_axis(&m->pan, f && faults_at(f, FAULTS_PAN_STALL, m->t_ns, MECHANICS_STEP_NS));
        advance_axis(&m->tilt, false);
        m->t_ns += MECHANICS_STEP_NS;
        note_knot(m, k);
    }
}

struct mechanics_state mechanics_at(const struct mechanics *m, double t_ns) {
    double at = (t_ns - (double)m->block_t_ns) / MECHANICS_STEP_NS;
    at = at < 0 ? 0 : at > m->knot_count - 1 ? m->knot_count - 1 : at;
    int k = (int)at;
    k = k > m->knot_count - 2 ? m->knot_count - 2 : k;
    const struct mechanics_state *a = &m->knot[k], *b = &m->knot[k + 1];
    double x = at - k, y = 1 - x;
    struct mechanics_state s = {.mirror_rad_s = y * a->mirror_rad_s + x * b->mirror_rad_s,
                                .pan_rad = y * a->pan_rad + x * b->pan_rad,
                                .tilt_rad = y * a->tilt_rad + x * b->tilt_rad,
                                .pan_motor_steps = y * a->pan_motor_steps + x * b->pan_motor_steps,
                                .tilt_motor_steps =
                                    y * a->tilt_motor_steps + x * b->tilt_motor_steps};
    double phase = a->mirror_rad +
                   step_s * x * (a->mirror_rad_s + 0.5 * x * (b->mirror_rad_s - a->mirror_rad_s));
    s.mirror_rad = phase + m->ripple * sin(phase + m->ripple_phase_rad);
    return s;
}

double mechanics_counts(const struct mechanics *m, const struct mechanics_state *state,
                        double t_ns) {
    int k = (int)((t_ns - (double)m->block_t_ns) / MECHANICS_STEP_NS);
    k = k < 0 ? 0 : k > m->knot_count - 1 ? m->knot_count - 1 : k;
    return rig_encoder_counts(&m->rig, state->mirror_rad) + m->knot_slip_counts[k];
}

static double turns_at(const struct mechanics *m, double t_ns) {
    struct mechanics_state s = mechanics_at(m, t_ns);
    return mechanics_counts(m, &s, t_ns) / m->rig.encoder_counts_per_turn;
}

int mechanics_index(const struct mechanics *m, int64_t *out_t_ns, int capacity) {
    int count = 0;
    for (int k = 0; k + 1 < m->knot_count && count < capacity; k++) {
        double lo = (double)m->block_t_ns + (double)k * MECHANICS_STEP_NS,
               hi = lo + MECHANICS_STEP_NS;
        double turn = floor(turns_at(m, hi - 1e-3));
        if (!(turn > floor(turns_at(m, lo - 1e-3))))
            continue;
        for (int i = 0; i < 30; i++) { /* bisection to 1 ps */
            double middle = 0.5 * (lo + hi);
            if (turns_at(m, middle) >= turn)
                hi = middle;
            else
                lo = middle;
        }
        out_t_ns[count++] = (int64_t)llround(hi);
    }
    return count;
}
