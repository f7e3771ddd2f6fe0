/* What the clocks buy: sigma of the pan error by missing events, mirror and faults, on line, off
 * line, and by the encoder's phase with the arrival of polled events, as it is without a fit of the
 * clocks. The table goes to stderr, figures as JSON to stdout. */
#include "base/sweep.h"
#include "clock_runs.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { EVENTS = 4096, SEEDS = 3 };

/* ---- by the phase alone: events with the time of their arrival ---- */

struct phase {
    struct sweep sweep;
    struct sweep_index index[EVENTS];
    size_t count;
    uint64_t moving;
    double sum2;
};

static void phase_event(void *ctx, const struct index_event *event, int64_t t_host_ns) {
    struct phase *p = ctx;
    if (p->count < EVENTS) {
        p->index[p->count] = cart_clock_index(event, 0);
        p->index[p->count++].t_host_ns = t_host_ns;
    }
}

static void phase_first(void *ctx, const struct head_packet *packet, int64_t t_host_ns,
                        const struct clock_world_truth *truth) {
    (void)ctx, (void)packet, (void)t_host_ns, (void)truth;
}

static void phase_packet(void *ctx, const struct head_packet *packet, int64_t t_host_ns,
                         const struct clock_world_truth *truth) {
    struct phase *p = ctx;
    struct sweep_place place[HEAD_PACKET_MAX_SAMPLES];
    sweep_packet(&p->sweep, packet, t_host_ns, place);
    for (unsigned i = 0; i < packet->sample_count; i++) {
        if (place[i].verdict != SWEEP_GOOD || truth[i].pan_rate_steps_s == 0)
            continue;
        double off = place[i].pan_steps - truth[i].pan_steps;
        p->sum2 += off * off;
        p->moving++;
    }
}

static void no_event(void *ctx, const struct index_event *event, int64_t t_host_ns) {
    (void)ctx, (void)event, (void)t_host_ns;
}

static void no_edge(void *ctx, int64_t t_host_ns) {
    (void)ctx, (void)t_host_ns;
}

/* The same world twice: once for its events, once for its packets. */
static double by_phase(const struct clock_world_spec *spec) {
    struct phase *p = calloc(1, sizeof *p);
    if (!p)
        return (double)NAN;
    struct clock_world_sink first = {p, phase_first, phase_event, no_edge};
    struct clock_world_sink second = {p, phase_packet, no_event, no_edge};
    (void)clock_world_run(spec, &first);
    sweep_init(&p->sweep, p->index, p->count);
    (void)clock_world_run(spec, &second);
    double rms = sqrt(p->sum2 / (double)(p->moving ? p->moving : 1));
    free(p);
    return clock_runs_mrad(rms);
}

/* ---- the table ---- */

static void row(const char *name, const struct clock_world_spec *like) {
    static int number = 0;
    static const char *const ways[] = {"online", "offline", "by_phase"};
    uint64_t seeds = getenv("BENCH_QUICK") && *getenv("BENCH_QUICK") ? 1 : SEEDS;
    struct cart_clock_params params = cart_clock_params_default();
    double rms[3] = {0}, one[2] = {0};
    for (uint64_t seed = 1; seed <= seeds; seed++) {
        struct clock_world_spec s = *like;
        s.seed = seed;
        for (int i = 0; i < 2; i++) {
            struct clock_runs r =
                i ? clock_runs_offline(&s, &params) : clock_runs_online(&s, &params);
            double mrad = clock_runs_mrad(r.error.rms_steps);
            rms[i] += mrad * mrad / (double)seeds;
            one[i] += 100 * r.error.within_1 / (double)seeds;
        }
        double mrad = by_phase(&s);
        rms[2] += mrad * mrad / (double)seeds;
    }
    (void)fprintf(stderr, "%-40s %9.1e %5.1f%% %9.1e %5.1f%% %9.1e\n", name, sqrt(rms[0]), one[0],
                  sqrt(rms[1]), one[1], sqrt(rms[2]));
    for (int i = 0; i < 3; i++)
        (void)printf("%s{\"name\": \"clocks_%d_%s\", \"value\": %.3e, \"unit\": \"mrad\"}",
                     number || i ? ",\n " : "[", number, ways[i], sqrt(rms[i]));
    number++;
}

static struct clock_world_spec base(void) {
    struct clock_world_spec s = clock_world_default(1, 40);
    s.sample_hz = 5000;
    s.pan_start_s = -1; /* ramps apart */
    s.pan_stop_s = 1000;
    return s;
}

int main(void) {
    (void)fprintf(
        stderr,
        "sigma of the pan, mrad, and share of errors below one stated sigma; asked: 0.05, "
        "60 to 76 %%\n%-40s %16s %16s %9s\n",
        "", "on line", "off line", "by phase");
    static const double missing[] = {0, 0.01, 0.1, 0.3}, latency_ms[] = {0.06, 1, 5};
    static const double drift[] = {0, 50, 150}, wander[] = {3e-4, 3e-3, 3e-2};
    char name[64];
    for (int i = 0; i < 4; i++) {
        struct clock_world_spec s = base();
        s.missing = missing[i];
        (void)snprintf(name, sizeof name, "missing events %.0f %%", 100 * missing[i]);
        row(name, &s);
    }
    for (int i = 0; i < 3; i++) {
        struct clock_world_spec s = base();
        s.latency_us = 1000 * latency_ms[i];
        (void)snprintf(name, sizeof name, "host late by %.2f ms", latency_ms[i]);
        row(name, &s);
    }
    for (int i = 0; i < 3; i++) {
        struct clock_world_spec s = base();
        s.drift_ppm[0] = drift[i], s.drift_ppm[1] = -drift[i];
        (void)snprintf(name, sizeof name, "drift of head and controller %.0f ppm", 2 * drift[i]);
        row(name, &s);
    }
    for (int i = 0; i < 3; i++) {
        struct clock_world_spec s = base();
        s.mirror_wander = wander[i];
        (void)snprintf(name, sizeof name, "mirror varies by %.2f %%", 100 * wander[i]);
        row(name, &s);
    }
    struct clock_world_spec s = base();
    s.mirror_hz = 40, s.pan_rate_steps_s = 160;
    row("mirror at 40 Hz", &s);
    s = base();
    s.spurious_hz = 0.4;
    row("one spurious event in ten", &s);
    s = base();
    s.packet_loss = 0.03, s.silent_at_s = 20, s.silent_s = 1;
    row("packets lost", &s);
    s = base();
    s.host_jump_at_s = 20, s.host_jump_s = 0.25, s.reset_at_s = 25, s.reset_silence_s = 0.4;
    row("host jump, then head reset", &s);
    s = base();
    s.stall_at_s = 20, s.stall_s = 1.5;
    row("mirror stalls", &s);
    (void)printf("]\n");
    return 0;
}
