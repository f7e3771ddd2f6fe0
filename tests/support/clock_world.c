#include "clock_world.h"

#include "base/rng.h"

#include <assert.h>
#include <math.h>
#include <string.h>

enum { HEAD, CONTROLLER, HOST, WAITING = 256 };
static const double pi = 3.14159265358979323846;
static const double step_s = 1e-3, wander_time_s = 0.7, spin_up_s = 0.4;

struct world {
    const struct clock_world_spec *spec;
    const struct clock_world_sink *sink;
    struct clock_world_done done;
    struct rng rng;
    double phase[3][2]; /* of the clocks' wander */
    double t_s;         /* start of the step */
    double turns, hz, wander;
    double turns1, hz1; /* at its end */
    double ripple_phase;
    double slip; /* turns, by now */
    /* head */
    struct head_packet packet;
    struct clock_world_truth truth[HEAD_PACKET_MAX_SAMPLES];
    int64_t sample, sample_zero; /* by the head's clock */
    double head_zero_s, head_shift_s;
    bool reset_next, was_reset, jumped;
    double silent_until_s, last_sample_s;
    /* controller */
    double boot_s;
    bool restarted;
    uint64_t seq, revolution;
    struct index_event waiting[WAITING];
    unsigned waitings;
    double next_poll_s, next_spurious_s;
};

struct clock_world_spec clock_world_default(uint64_t seed, double duration_s) {
    return (struct clock_world_spec){.seed = seed,
                                     .duration_s = duration_s,
                                     .sample_hz = 25000,
                                     .mirror_hz = 4,
                                     .mirror_wander = 0.003,
                                     .mirror_ripple = 0.001,
                                     .encoder_noise_counts = 0.02,
                                     .blind_turns = 0.25,
                                     .drift_ppm = {50, -50, 50},
                                     .wander_us = {20, 30, 15},
                                     .offset_s = {12.75, 3.5, 1000},
                                     .capture_jitter_us = 0.3,
                                     .latency_us = 1000,
                                     .poll_s = 0.2,
                                     .late_share = 0.01,
                                     .late_s = 0.02,
                                     .missing = 0.01,
                                     .missing_edges = 0.01,
                                     .pan_start_s = 3.1,
                                     .pan_stop_s = duration_s - 2.2,
                                     .pan_rate_steps_s = 16,
                                     .pan_acceleration_steps_s2 = 4667};
}

/* ---- what is true ---- */

static double clock_s(const struct world *w, int which, double t_s) {
    double slow = sin(2 * pi * t_s / 41 + w->phase[which][0]);
    double slower = sin(2 * pi * t_s / 97 + w->phase[which][1]);
    return w->spec->offset_s[which] + t_s * (1 + 1e-6 * w->spec->drift_ppm[which]) +
           1e-6 * w->spec->wander_us[which] * (slow + slower);
}

static double host_s(const struct world *w, double t_s) {
    bool jumped = w->spec->host_jump_at_s > 0 && t_s >= w->spec->host_jump_at_s;
    return clock_s(w, HOST, t_s) + (jumped ? w->spec->host_jump_s : 0);
}

static double pan_steps(const struct clock_world_spec *s, double t_s, double *out_rate) {
    double v = s->pan_rate_steps_s, ramp_s = fabs(v) / s->pan_acceleration_steps_s2;
    double t = t_s - s->pan_start_s, end = s->pan_stop_s - s->pan_start_s;
    double ramp = 0.5 * v * ramp_s; /* steps in a ramp */
    *out_rate = 0;
    if (t <= 0)
        return 0;
    if (t < ramp_s) {
        *out_rate = v * t / ramp_s;
        return ramp * (t / ramp_s) * (t / ramp_s);
    }
    if (t < end) {
        *out_rate = v;
        return ramp + v * (t - ramp_s);
    }
    double left = fmax(end + ramp_s - t, 0) / ramp_s;
    *out_rate = v * left;
    return ramp + v * (end - ramp_s) + ramp * (1 - left * left);
}

static double turns_at(const struct world *w, double x) {
    double smooth = w->turns + step_s * x * (w->hz + 0.5 * x * (w->hz1 - w->hz));
    double ripple = w->spec->mirror_ripple / (2 * pi);
    return smooth + ripple * sin(2 * pi * smooth + w->ripple_phase);
}

static void move_mirror(struct world *w) {
    const struct clock_world_spec *s = w->spec;
    bool stalled =
        s->stall_at_s > 0 && w->t_s >= s->stall_at_s && w->t_s < s->stall_at_s + s->stall_s;
    double keep = exp(-step_s / wander_time_s);
    w->wander = keep * w->wander + s->mirror_wander * sqrt(1 - keep * keep) * rng_normal(&w->rng);
    double target = stalled ? 0 : s->mirror_hz;
    w->hz = w->hz1;
    w->turns = w->turns1;
    double quick = stalled ? 0.05 : fabs(w->hz - target) < 0.05 * target ? 0.05 : spin_up_s;
    w->hz1 = w->hz + (1 - exp(-step_s / quick)) * (target * (1 + w->wander) - w->hz);
    w->turns1 = w->turns + 0.5 * step_s * (w->hz + w->hz1);
}

/* ---- head ---- */

static void flush(struct world *w) {
    const struct clock_world_spec *s = w->spec;
    struct head_packet *p = &w->packet;
    if (!p->sample_count)
        return;
    p->flags = w->reset_next ? HEAD_PACKET_RESET : 0;
    bool lost = rng_uniform(&w->rng) < s->packet_loss ||
                (s->silent_at_s > 0 && w->last_sample_s > s->silent_at_s &&
                 w->last_sample_s < s->silent_at_s + s->silent_s);
    double late_s = -1e-6 * s->latency_us * log(1 - rng_uniform(&w->rng));
    if (lost)
        w->done.lost_packets++;
    else
        w->sink->packet(w->sink->ctx, p,
                        (int64_t)llround(1e9 * host_s(w, w->last_sample_s + 125e-6 + late_s)),
                        w->truth);
    w->reset_next = w->reset_next && lost;
    p->packet_seq++;
    p->sample_count = 0;
}

static void head_faults(struct world *w, double t_s) {
    const struct clock_world_spec *s = w->spec;
    double interval_s = 1e-9 * w->packet.interval_ns;
    if (s->reset_at_s > 0 && t_s >= s->reset_at_s && !w->was_reset) {
        w->packet.sample_count = 0;
        w->packet.packet_seq = 0;
        w->was_reset = w->reset_next = true;
        w->sample_zero = w->sample;
        w->head_zero_s = (double)w->sample * interval_s;
        w->silent_until_s = t_s + s->reset_silence_s;
    }
    if (s->head_jump_at_s > 0 && t_s >= s->head_jump_at_s && !w->jumped) {
        flush(w);
        w->jumped = true;
        w->head_shift_s = s->head_jump_s;
    }
}

static void take_sample(struct world *w, double t_s) {
    const struct clock_world_spec *s = w->spec;
    struct head_packet *p = &w->packet;
    int64_t number = w->sample++;
    head_faults(w, t_s);
    double turn = turns_at(w, (t_s - w->t_s) / step_s) + w->slip;
    double away = fabs(turn - floor(turn + 0.5));
    if (t_s < w->silent_until_s)
        return;
    if (away < 0.5 * s->blind_turns) {
        flush(w);
        return;
    }
    double noise = s->encoder_noise_counts * rng_normal(&w->rng);
    if (!p->sample_count) {
        p->first_sample_seq = (uint32_t)(number - w->sample_zero);
        p->head_t_ns = number * (int64_t)p->interval_ns -
                       (int64_t)llround(1e9 * (w->head_zero_s - w->head_shift_s));
    }
    struct clock_world_truth *truth = &w->truth[p->sample_count];
    truth->pan_steps = pan_steps(s, t_s, &truth->pan_rate_steps_s);
    truth->slip_counts = w->slip * HEAD_ENCODER_COUNTS;
    p->samples[p->sample_count++].position =
        head_position_from_counts(turn * HEAD_ENCODER_COUNTS + noise);
    w->last_sample_s = t_s;
    if (p->sample_count == HEAD_PACKET_MAX_SAMPLES)
        flush(w);
}

/* Samples whose head time falls into the step. */
static void take_samples(struct world *w) {
    double a = clock_s(w, HEAD, w->t_s), b = clock_s(w, HEAD, w->t_s + step_s);
    double interval_s = 1e-9 * w->packet.interval_ns;
    while ((double)w->sample * interval_s < b)
        take_sample(w, w->t_s + step_s * ((double)w->sample * interval_s - a) / (b - a));
}

/* ---- controller and host ---- */

static void pulse(struct world *w, double t_s, bool real) {
    const struct clock_world_spec *s = w->spec;
    bool missing = real && rng_uniform(&w->rng) < s->missing;
    bool no_edge = rng_uniform(&w->rng) < s->missing_edges;
    double rate, jitter_s = 1e-6 * s->capture_jitter_us * rng_normal(&w->rng);
    w->done.pulses += real;
    w->done.missing_events += missing;
    w->done.missing_edges += no_edge;
    w->revolution += real;
    if (!missing && w->waitings < WAITING) {
        double exact_us = 1e6 * (clock_s(w, CONTROLLER, t_s) - w->boot_s + jitter_s);
        double us = floor(exact_us); /* and the position is told for the time that is told */
        double steps = pan_steps(s, t_s + jitter_s - 1e-6 * (exact_us - us), &rate);
        w->waiting[w->waitings++] =
            (struct index_event){.seq = w->seq++,
                                 .t_ns = (int64_t)us * 1000,
                                 .revolution = w->revolution,
                                 .pan_steps = rate != 0 ? floor(steps * 65536) / 65536 : steps,
                                 .tilt_steps = 12,
                                 .kind = INDEX_EVENT_INDEX,
                                 .flags = (uint16_t)(INDEX_EVENT_SWEEP | INDEX_EVENT_PAN_TAKEN_UP |
                                                     INDEX_EVENT_PAN_POSITIVE |
                                                     (rate != 0 ? INDEX_EVENT_PAN_MOVING : 0))};
    }
    double late_s = -1e-6 * s->latency_us * log(1 - rng_uniform(&w->rng));
    if (rng_uniform(&w->rng) < s->late_share)
        late_s += s->late_s;
    if (!no_edge)
        w->sink->edge(w->sink->ctx, (int64_t)llround(1e9 * host_s(w, t_s + late_s)));
}

/* Index pulses of the step: where the turns pass a whole number. */
static void pulses(struct world *w) {
    if (w->spec->spurious_hz > 0 && w->t_s >= w->next_spurious_s) {
        w->done.spurious++;
        pulse(w, w->t_s, false);
        w->next_spurious_s = w->t_s - log(1 - rng_uniform(&w->rng)) / w->spec->spurious_hz;
    }
    double index = w->spec->slip_moves_index ? w->slip : 0;
    double to = floor(turns_at(w, 1) + index);
    if (to > floor(turns_at(w, 0) + index)) {
        double lo = 0, hi = 1;
        for (int i = 0; i < 50; i++) {
            double x = 0.5 * (lo + hi);
            *(turns_at(w, x) + index < to ? &lo : &hi) = x;
        }
        pulse(w, w->t_s + step_s * hi, true);
    }
}

static void poll(struct world *w) {
    if (w->t_s < w->next_poll_s)
        return;
    w->next_poll_s = w->t_s + w->spec->poll_s * rng_range(&w->rng, 0.7, 1.3);
    double late_s = 0.02 + 0.005 * rng_uniform(&w->rng);
    for (unsigned i = 0; i < w->waitings; i++)
        w->sink->event(w->sink->ctx, &w->waiting[i],
                       (int64_t)llround(1e9 * host_s(w, w->t_s + late_s)));
    w->waitings = 0;
}

struct clock_world_done clock_world_run(const struct clock_world_spec *spec,
                                        const struct clock_world_sink *sink) {
    struct world w = {.spec = spec, .sink = sink, .rng = rng_make(spec->seed)};
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 2; k++)
            w.phase[i][k] = rng_range(&w.rng, 0, 2 * pi);
    w.ripple_phase = rng_range(&w.rng, 0, 2 * pi);
    w.turns1 = rng_uniform(&w.rng);
    w.packet.interval_ns = (uint32_t)llround(1e9 / spec->sample_hz);
    w.sample = (int64_t)(clock_s(&w, HEAD, 0) * 1e9 / w.packet.interval_ns) + 1;
    w.sample_zero = w.sample;
    w.reset_next = true;
    w.next_spurious_s = spec->pan_start_s;
    for (int64_t i = 0; (double)i * step_s < spec->duration_s; i++) {
        w.t_s = (double)i * step_s;
        if (spec->slip_at_s > 0 && w.t_s >= spec->slip_at_s)
            w.slip = spec->slip_counts / HEAD_ENCODER_COUNTS;
        if (spec->restart_at_s > 0 && w.t_s >= spec->restart_at_s && !w.restarted) {
            w.restarted = true;
            w.boot_s = clock_s(&w, CONTROLLER, w.t_s);
            w.seq = w.revolution = w.waitings = 0;
        }
        move_mirror(&w);
        pulses(&w);
        take_samples(&w);
        poll(&w);
    }
    return w.done;
}
