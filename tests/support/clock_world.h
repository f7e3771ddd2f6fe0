/* A small cart of its own, for tests of the clocks alone: a mirror that varies, a pan that starts
 * and stops, three clocks that drift and wander, and everything that can go wrong with them, in a
 * few hundred lines that share nothing with the simulated cart of host/twin. */
#ifndef SC_TESTS_CLOCK_WORLD_H
#define SC_TESTS_CLOCK_WORLD_H

#include "base/head_packet.h"
#include "base/index_event.h"

#include <stdbool.h>
#include <stdint.h>

struct clock_world_spec {
    uint64_t seed;
    double duration_s, sample_hz, mirror_hz;
    double mirror_wander, mirror_ripple; /* relative deviations of its speed */
    double encoder_noise_counts, blind_turns;
    double drift_ppm[3], wander_us[3]; /* head, controller, host */
    double offset_s[3];
    double capture_jitter_us, latency_us, poll_s;
    double late_share, late_s; /* edges that are noticed much too late */
    double missing, missing_edges, spurious_hz, packet_loss; /* shares, and a rate */
    double pan_start_s, pan_stop_s, pan_rate_steps_s, pan_acceleration_steps_s2;
    /* one of each; at 0: never */
    double reset_at_s, reset_silence_s;
    double head_jump_at_s, head_jump_s;
    double host_jump_at_s, host_jump_s;
    double slip_at_s, slip_counts;
    bool slip_moves_index; /* the disc slips with its index; else counts are lost */
    double stall_at_s, stall_s;
    double restart_at_s;
    double silent_at_s, silent_s; /* packets are lost all along */
};

/* 4 Hz, 25 kHz, 50 ppm, 1 ms, 1 % missing: what the clocks must bear. */
struct clock_world_spec clock_world_default(uint64_t seed, double duration_s);

struct clock_world_truth {
    double pan_steps, pan_rate_steps_s; /* of each sample */
    double slip_counts;                 /* of the encoder since the start */
};

struct clock_world_sink {
    void *ctx;
    void (*packet)(void *ctx, const struct head_packet *packet, int64_t t_host_ns,
                   const struct clock_world_truth *truth);
    void (*event)(void *ctx, const struct index_event *event, int64_t t_host_ns);
    void (*edge)(void *ctx, int64_t t_host_ns);
};

/* What was done to the streams. */
struct clock_world_done {
    uint64_t pulses, missing_events, spurious, missing_edges, lost_packets;
};

struct clock_world_done clock_world_run(const struct clock_world_spec *spec,
                                        const struct clock_world_sink *sink);

#endif
