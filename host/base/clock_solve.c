#include "base/clock_solve.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

static const size_t most = (size_t)1 << 24;
enum { BESIDE = 2 }; /* events before the first pair and after the last that get head times, too */

/* Makes room for one more; false: no memory. */
static bool room(void **items, size_t size, size_t count, size_t *capacity) {
    if (count < *capacity)
        return true;
    size_t wanted = *capacity ? 2 * *capacity : 256;
    void *grown = wanted <= most ? realloc(*items, wanted * size) : NULL;
    if (!grown)
        return false;
    *items = grown;
    *capacity = wanted;
    return true;
}

/* A void * that a typed array lends to room(). */
#define ROOM(array, count, capacity)                                                               \
    (lent = (array), ok = room(&lent, sizeof *(array), (count), &(capacity)), (array) = lent, ok)

/* ---- collecting ---- */

enum st clock_solve_packet(struct clock_solve *solve, const struct head_packet *packet,
                           int64_t t_host_ns) {
    struct clock_solve *s = solve;
    void *lent;
    bool ok;
    head_turns_packet(&s->head, packet, t_host_ns);
    for (unsigned i = 0; i < s->head.turn_count; i++) {
        if (!ROOM(s->turns, s->turn_count, s->turn_capacity))
            return ST_NOMEM;
        s->turns[s->turn_count++] = s->head.turn[i];
    }
    for (unsigned i = 0; i < s->head.incident_count; i++) {
        if (!ROOM(s->incidents, s->incident_count, s->incident_capacity))
            return ST_NOMEM;
        s->incidents[s->incident_count++] = s->head.incident[i];
    }
    return ST_OK;
}

enum st clock_solve_event(struct clock_solve *solve, const struct index_event *event,
                          int64_t t_host_ns) {
    void *lent;
    bool ok;
    if (!ROOM(solve->events, solve->event_count, solve->event_capacity))
        return ST_NOMEM;
    solve->events[solve->event_count++] = (struct clock_solve_event){*event, t_host_ns};
    return ST_OK;
}

enum st clock_solve_edge(struct clock_solve *solve, int64_t t_host_ns) {
    void *lent;
    bool ok;
    if (!ROOM(solve->edges_ns, solve->edge_count, solve->edge_capacity))
        return ST_NOMEM;
    solve->edges_ns[solve->edge_count++] = t_host_ns;
    return ST_OK;
}

void clock_solve_fini(struct clock_solve *solve) {
    free(solve->turns);
    free(solve->incidents);
    free(solve->events);
    free(solve->edges_ns);
    memset(solve, 0, sizeof *solve);
}

void clock_solution_fini(struct clock_solution *solution) {
    free(solution->index);
    free(solution->incidents);
    memset(solution, 0, sizeof *solution);
}

/* ---- matching ---- */

struct work {
    const struct clock_solve *in;
    struct clock_solution *out;
    struct cart_clock *clock;
    struct cart_clock_match *match;
    struct sweep_index *event; /* index pulses only, repetitions left out */
    size_t matches, match_capacity, events, index_capacity, incident_capacity;
    size_t longest; /* pairs of the longest stretch smoothed */
    double sum_off2, sum_weight, max_off;
    bool out_of_memory;
};

static void keep_match(void *ctx, const struct cart_clock_match *match) {
    struct work *w = ctx;
    void *lent;
    bool ok;
    if (ROOM(w->match, w->matches, w->match_capacity))
        w->match[w->matches++] = *match;
    else
        w->out_of_memory = true;
}

static void keep_incidents(struct work *w, uint64_t *done) {
    for (; *done < w->clock->incident_count; ++*done) {
        void *lent;
        bool ok;
        if (!ROOM(w->out->incidents, w->out->incident_count, w->incident_capacity)) {
            w->out_of_memory = true;
            return;
        }
        w->out->incidents[w->out->incident_count++] =
            w->clock->incident[*done % CART_CLOCK_INCIDENTS];
    }
}

/* Arrival of an event for the order of things; unknown ones come with the one before. */
static int64_t arrival(const struct work *w, size_t i, int64_t before_ns) {
    int64_t t_ns = w->in->events[i].t_host_ns;
    return t_ns == CART_CLOCK_NO_ARRIVAL ? before_ns : t_ns;
}

/* Hands the recording to cart_clock in the order in which it came. */
static void replay(struct work *w) {
    const struct clock_solve *in = w->in;
    size_t turn = 0, incident = 0, event = 0, edge = 0;
    int64_t event_ns = in->event_count ? arrival(w, 0, INT64_MIN) : 0;
    uint64_t done = 0;
    for (;;) {
        int64_t t_turn = turn < in->turn_count ? in->turns[turn].t_host_ns : INT64_MAX;
        int64_t t_event = event < in->event_count ? event_ns : INT64_MAX;
        int64_t t_edge = edge < in->edge_count ? in->edges_ns[edge] : INT64_MAX;
        int64_t t_wrong =
            incident < in->incident_count ? in->incidents[incident].t_host_ns : INT64_MAX;
        if (t_turn == INT64_MAX && t_event == INT64_MAX && t_edge == INT64_MAX &&
            t_wrong == INT64_MAX)
            return;
        if (t_wrong <= t_turn && t_wrong <= t_event && t_wrong <= t_edge) {
            cart_clock_head_incident(w->clock, &in->incidents[incident++]);
        } else if (t_edge <= t_turn && t_edge <= t_event) {
            cart_clock_edge(w->clock, in->edges_ns[edge++]);
        } else if (t_turn <= t_event) {
            cart_clock_turn(w->clock, &in->turns[turn++]);
        } else {
            uint64_t before = w->clock->report.events;
            const struct index_event *e = &in->events[event].event;
            cart_clock_event(w->clock, e, in->events[event].t_host_ns);
            if (w->clock->report.events > before)
                w->event[w->events++] = cart_clock_index(e, w->clock->log);
            if (++event < in->event_count)
                event_ns = arrival(w, event, event_ns);
        }
        keep_incidents(w, &done);
    }
}

/* ---- smoothing ---- */

struct stretch { /* pairs of one epoch and one log */
    const struct cart_clock_match *match;
    size_t count;
    struct clock_track_state *state;
};

/* Head time of an instant of the controller, between the states around it. */
static int64_t head_time(const struct stretch *s, size_t *at, int64_t t_controller_ns,
                         double *out_sigma_ns) {
    while (*at + 1 < s->count && s->match[*at + 1].t_controller_ns <= t_controller_ns)
        ++*at;
    const struct cart_clock_match *a = &s->match[*at], *b = a + 1;
    double sigma0, sigma1;
    int64_t h0 = clock_track_invert(&s->state[*at], t_controller_ns, &sigma0);
    *out_sigma_ns = sigma0;
    if (t_controller_ns < a->t_controller_ns || *at + 1 == s->count)
        return h0;
    int64_t h1 = clock_track_invert(&s->state[*at + 1], t_controller_ns, &sigma1);
    double x = (double)(t_controller_ns - a->t_controller_ns) /
               (double)(b->t_controller_ns - a->t_controller_ns);
    *out_sigma_ns = fmin(sigma0, sigma1);
    if (*out_sigma_ns > 0) /* both see the same clock: between pairs the doubt is between theirs */
        *out_sigma_ns =
            s->state[*at].sigma_ns + x * (s->state[*at + 1].sigma_ns - s->state[*at].sigma_ns);
    return h0 + (int64_t)llround(x * (double)(h1 - h0));
}

static void add_index(struct work *w, const struct sweep_index *event, uint32_t epoch,
                      int64_t t_head_ns, double sigma_ns) {
    struct clock_solution *out = w->out;
    void *lent;
    bool ok;
    const struct sweep_index *last = out->count ? &out->index[out->count - 1] : NULL;
    if (last && last->head_epoch == epoch && last->t_head_ns >= t_head_ns)
        return;
    if (!ROOM(out->index, out->count, w->index_capacity)) {
        w->out_of_memory = true;
        return;
    }
    struct sweep_index *k = &out->index[out->count++];
    *k = *event;
    k->head_epoch = epoch;
    k->t_head_ns = t_head_ns;
    k->t_sigma_ns = sigma_ns;
}

/* Head times for the events of a stretch and for some beside it. */
static void index_stretch(struct work *w, const struct stretch *s) {
    size_t first = 0, end, at = 0;
    while (first < w->events && (w->event[first].log < s->match[0].log ||
                                 (w->event[first].log == s->match[0].log &&
                                  w->event[first].t_controller_ns < s->match[0].t_controller_ns)))
        first++;
    for (end = first; end < w->events && w->event[end].log == s->match[0].log &&
                      w->event[end].t_controller_ns <= s->match[s->count - 1].t_controller_ns;)
        end++;
    for (size_t i = 0; i < BESIDE && first && w->event[first - 1].log == s->match[0].log; i++)
        first--;
    for (size_t i = 0; i < BESIDE && end < w->events && w->event[end].log == s->match[0].log; i++)
        end++;
    for (size_t i = first; i < end; i++) {
        double sigma;
        int64_t t_ns = head_time(s, &at, w->event[i].t_controller_ns, &sigma);
        sigma = hypot(sigma, s->match[at].common_ns);
        add_index(w, &w->event[i], s->match[0].head_epoch, t_ns, sigma);
    }
}

/* Weighted: a pass in a wide gap says little, and its residual as little. */
static void residuals(struct work *w, const struct stretch *s) {
    for (size_t i = 0; i < s->count; i++) {
        const struct cart_clock_match *m = &s->match[i];
        double off =
            (double)(m->t_controller_ns - clock_track_apply(&s->state[i], m->t_head_ns, NULL));
        double weight = 1 / (m->sigma_ns * m->sigma_ns);
        w->sum_off2 += weight * off * off;
        w->sum_weight += weight;
        w->max_off = fmax(w->max_off, fabs(off));
    }
    struct cart_clock_pair *pair = &w->out->report.head;
    const struct clock_track_state *a = &s->state[0], *b = &s->state[s->count - 1];
    double span_s = (double)(b->at_ns - a->at_ns) * 1e-9;
    if (s->count <= w->longest || !(span_s > 0))
        return;
    w->longest = s->count;
    pair->drift_ppm = ((double)(b->base_ns - a->base_ns) + b->d_ns - a->d_ns) / span_s * 1e-3;
    pair->drift_sigma_ppm = hypot(a->sigma_ns, b->sigma_ns) / span_s * 1e-3;
}

static enum st smooth_stretch(struct work *w, struct stretch *s, double max_drift_ppm) {
    int64_t *time = malloc(2 * s->count * sizeof *time);
    double *sigma = malloc(s->count * sizeof *sigma);
    s->state = malloc(s->count * sizeof *s->state);
    enum st st = time && sigma && s->state ? ST_OK : ST_NOMEM;
    for (size_t i = 0; !st && i < s->count; i++) {
        time[i] = s->match[i].t_head_ns;
        time[s->count + i] = s->match[i].t_controller_ns;
        sigma[i] = s->match[i].sigma_ns;
    }
    struct clock_track_pairs pairs = {s->count, time, time ? time + s->count : NULL, sigma};
    if (!st)
        st = clock_track_smooth(&pairs, max_drift_ppm, s->state);
    if (!st) {
        index_stretch(w, s);
        residuals(w, s);
    }
    free(time);
    free(sigma);
    free(s->state);
    return st;
}

/* Slips of the encoder, to the events around them. */
static void apply_slips(struct work *w) {
    const struct clock_solve *in = w->in;
    size_t next = 0;
    uint32_t epoch = 0;
    double counts = 0;
    for (size_t i = 0; i < w->out->count; i++) {
        struct sweep_index *k = &w->out->index[i];
        if (k->head_epoch != epoch)
            counts = 0;
        epoch = k->head_epoch;
        for (; next < in->incident_count; next++) {
            const struct head_turns_incident *slip = &in->incidents[next];
            if (slip->epoch > epoch || (slip->epoch == epoch && slip->t_head_ns > k->t_head_ns &&
                                        slip->kind == HEAD_TURNS_SLIP))
                break;
            if (slip->kind == HEAD_TURNS_SLIP && slip->epoch == epoch)
                counts += slip->value;
        }
        k->slip_counts = counts;
        if (next < in->incident_count && in->incidents[next].epoch == epoch &&
            in->incidents[next].kind == HEAD_TURNS_SLIP) {
            k->slip_t_head_ns = in->incidents[next].t_head_ns;
            k->slip_after_counts = counts + in->incidents[next].value;
        }
    }
}

static enum st smooth(struct work *w, const struct cart_clock_params *params) {
    enum st st = ST_OK;
    for (size_t i = 0; !st && i < w->matches;) {
        struct stretch s = {.match = &w->match[i]};
        while (i + s.count < w->matches && s.match[s.count].head_epoch == s.match[0].head_epoch &&
               s.match[s.count].log == s.match[0].log)
            s.count++;
        st = smooth_stretch(w, &s, params->max_drift_ppm);
        i += s.count;
    }
    apply_slips(w);
    struct cart_clock_report *r = &w->out->report;
    r->head.rms_ns = w->matches ? sqrt(w->sum_off2 / w->sum_weight) : (double)NAN;
    r->head.max_ns = w->max_off;
    r->pan_noise_steps = pan_curve_noise(w->out->index, w->out->count);
    return st;
}

enum st clock_solve_make(const struct clock_solve *solve, const struct cart_clock_params *params,
                         struct clock_solution *out_solution) {
    struct clock_solution out;
    memset(&out, 0, sizeof out);
    struct work w = {.in = solve, .out = &out, .clock = malloc(sizeof *w.clock)};
    w.event = malloc((solve->event_count + 1) * sizeof *w.event);
    enum st st = w.clock && w.event ? ST_OK : ST_NOMEM;
    if (!st) {
        cart_clock_init(w.clock, params);
        w.clock->on_match = keep_match;
        w.clock->on_match_ctx = &w;
        replay(&w);
        cart_clock_report(w.clock, &out.report);
        st = smooth(&w, params);
    }
    if (!st && w.out_of_memory)
        st = ST_NOMEM;
    free(w.clock);
    free(w.event);
    free(w.match);
    if (st)
        clock_solution_fini(&out);
    else
        *out_solution = out;
    return st;
}
