#include "clock_runs.h"

#include "base/clock_solve.h"
#include "base/sweep.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { BACKLOG = 8192 };
static const double pi = 3.14159265358979323846;

struct packet {
    struct head_packet packet;
    uint32_t epoch; /* on line */
    int64_t t_host_ns;
    struct clock_world_truth truth[HEAD_PACKET_MAX_SAMPLES];
};

struct clock_runs_feed {
    struct cart_clock_params params;
    double rate;
    struct clock_runs_errors error;
    double sum2, sum_sigma, ones, twos;
    /* on line: packets that wait for their events */
    struct cart_clock *clock;
    struct packet *backlog;
    size_t first, count;
    /* off line */
    struct clock_solve solve;
    size_t capacity;
    bool failed;
};

double clock_runs_mrad(double steps) {
    return steps * 2000 * pi / 28000;
}

static void judge(struct clock_runs_feed *r, const struct packet *p, unsigned i,
                  const struct sweep_place *place) {
    struct clock_runs_errors *e = &r->error;
    const struct clock_world_truth *truth = &p->truth[i];
    bool sweeping = truth->pan_rate_steps_s != 0;
    e->samples += sweeping;
    if (place->verdict != SWEEP_GOOD || !sweeping)
        return;
    e->placed++;
    if (!place->sweep) /* on its way to the start: nobody uses these */
        return;
    double counts =
        place->counts + truth->slip_counts - head_position_counts(p->packet.samples[i].position);
    e->worst_counts = fmax(e->worst_counts, fabs(remainder(counts, HEAD_ENCODER_COUNTS)));
    double off = fabs(place->pan_steps - truth->pan_steps), sigma = place->pan_sigma_steps;
    e->max_steps = fmax(e->max_steps, off);
    if (fabs(truth->pan_rate_steps_s - r->rate) > 1e-9)
        return;
    e->moving++;
    r->sum2 += off * off;
    r->sum_sigma += sigma;
    r->ones += off <= sigma;
    r->twos += off <= 2 * sigma;
}

static void finish(struct clock_runs_feed *r) {
    struct clock_runs_errors *e = &r->error;
    double n = (double)(e->moving ? e->moving : 1);
    e->rms_steps = sqrt(r->sum2 / n);
    e->mean_sigma_steps = r->sum_sigma / n;
    e->within_1 = r->ones / n;
    e->within_2 = r->twos / n;
}

/* ---- on line ---- */

/* Every seventh sample: neighbours tell nothing new. */
enum { EVERY = 7 };

static bool place_packet(struct clock_runs_feed *r, const struct packet *p, bool must) {
    struct sweep_place place;
    for (unsigned i = 0; i < p->packet.sample_count; i += EVERY) {
        cart_clock_place(r->clock, p->epoch,
                         p->packet.head_t_ns + (int64_t)i * p->packet.interval_ns,
                         head_position_counts(p->packet.samples[i].position), &place);
        if (place.verdict == SWEEP_LATER && !must)
            return false;
        judge(r, p, i, &place);
    }
    return true;
}

static void settle(struct clock_runs_feed *r, bool must) {
    while (r->count && place_packet(r, &r->backlog[r->first], must)) {
        r->first = (r->first + 1) % BACKLOG;
        r->count--;
    }
}

static void online_packet(void *ctx, const struct head_packet *packet, int64_t t_host_ns,
                          const struct clock_world_truth *truth) {
    struct clock_runs_feed *r = ctx;
    cart_clock_packet(r->clock, packet, t_host_ns);
    if (r->count == BACKLOG) {
        (void)place_packet(r, &r->backlog[r->first], true);
        r->first = (r->first + 1) % BACKLOG;
        r->count--;
    }
    struct packet *p = &r->backlog[(r->first + r->count++) % BACKLOG];
    p->packet = *packet;
    p->epoch = r->clock->head.epoch.number;
    memcpy(p->truth, truth, packet->sample_count * sizeof *truth);
}

static void online_event(void *ctx, const struct index_event *event, int64_t t_host_ns) {
    struct clock_runs_feed *r = ctx;
    cart_clock_event(r->clock, event, t_host_ns);
    settle(r, false);
}

static void online_edge(void *ctx, int64_t t_host_ns) {
    struct clock_runs_feed *r = ctx;
    cart_clock_edge(r->clock, t_host_ns);
}

/* ---- off line ---- */

static void offline_packet(void *ctx, const struct head_packet *packet, int64_t t_host_ns,
                           const struct clock_world_truth *truth) {
    struct clock_runs_feed *r = ctx;
    r->failed |= clock_solve_packet(&r->solve, packet, t_host_ns) != ST_OK;
    if (r->count == r->capacity) {
        r->capacity = r->capacity ? 2 * r->capacity : 1024;
        struct packet *grown = realloc(r->backlog, r->capacity * sizeof *grown);
        assert(grown);
        r->backlog = grown;
    }
    struct packet *p = &r->backlog[r->count++];
    p->packet = *packet;
    p->t_host_ns = t_host_ns;
    memcpy(p->truth, truth, packet->sample_count * sizeof *truth);
}

static void offline_event(void *ctx, const struct index_event *event, int64_t t_host_ns) {
    struct clock_runs_feed *r = ctx;
    r->failed |= clock_solve_event(&r->solve, event, t_host_ns) != ST_OK;
}

static void offline_edge(void *ctx, int64_t t_host_ns) {
    struct clock_runs_feed *r = ctx;
    r->failed |= clock_solve_edge(&r->solve, t_host_ns) != ST_OK;
}

/* Second pass of the off line run: places what was kept. */
static void place_all(struct clock_runs_feed *r, struct cart_clock_report *out_report) {
    struct clock_solution solution;
    enum st st = clock_solve_make(&r->solve, &r->params, &solution);
    assert(!st && !r->failed);
    (void)st;
    struct sweep sweep;
    struct sweep_place places[HEAD_PACKET_MAX_SAMPLES];
    sweep_init(&sweep, solution.index, solution.count);
    for (size_t i = 0; i < r->count; i++) {
        sweep_packet(&sweep, &r->backlog[i].packet, r->backlog[i].t_host_ns, places);
        for (unsigned k = 0; k < r->backlog[i].packet.sample_count; k += EVERY)
            judge(r, &r->backlog[i], k, &places[k]);
    }
    *out_report = solution.report;
    clock_solution_fini(&solution);
    clock_solve_fini(&r->solve);
}

/* ---- runs ---- */

struct clock_runs_feed *clock_runs_open(bool online, const struct cart_clock_params *params,
                                        double pan_rate_steps_s) {
    struct clock_runs_feed *r = calloc(1, sizeof *r);
    assert(r);
    r->params = *params;
    r->rate = pan_rate_steps_s;
    if (!online)
        return r;
    r->clock = malloc(sizeof *r->clock);
    r->backlog = malloc(BACKLOG * sizeof *r->backlog);
    assert(r->clock && r->backlog);
    cart_clock_init(r->clock, params);
    return r;
}

struct clock_world_sink clock_runs_sink(struct clock_runs_feed *feed) {
    return feed->clock
               ? (struct clock_world_sink){feed, online_packet, online_event, online_edge}
               : (struct clock_world_sink){feed, offline_packet, offline_event, offline_edge};
}

void clock_runs_close(struct clock_runs_feed *feed, struct clock_runs *out) {
    if (feed->clock) {
        settle(feed, true);
        cart_clock_report(feed->clock, &out->report);
    } else {
        place_all(feed, &out->report);
    }
    finish(feed);
    out->error = feed->error;
    free(feed->clock);
    free(feed->backlog);
    free(feed);
}

static struct clock_runs run(bool online, const struct clock_world_spec *spec,
                             const struct cart_clock_params *params) {
    struct clock_runs out;
    memset(&out, 0, sizeof out);
    struct clock_runs_feed *feed = clock_runs_open(online, params, spec->pan_rate_steps_s);
    struct clock_world_sink sink = clock_runs_sink(feed);
    out.done = clock_world_run(spec, &sink);
    clock_runs_close(feed, &out);
    return out;
}

struct clock_runs clock_runs_online(const struct clock_world_spec *spec,
                                    const struct cart_clock_params *params) {
    return run(true, spec, params);
}

struct clock_runs clock_runs_offline(const struct clock_world_spec *spec,
                                     const struct cart_clock_params *params) {
    return run(false, spec, params);
}
