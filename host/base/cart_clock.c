#include "base/cart_clock.h"

#include "base/cart_lock.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double gate = 6;             /* sigmas beyond which a pair is not believed */
static const double gate_floor_ns = 3000; /* and never less than this */
static const double near_turn = 1.0 / 8;  /* an event belongs to a pass within so much of a turn */
static const double near_edge_turn = 1.0 / 3, near_edge_ns = 3e7;
static const unsigned steps_in_a_row = 3;     /* pairs that are off alike: something moved */
static const double half_latch = 0.5 / 65536; /* steps: the part of a step is truncated to this */
static const uint64_t warm_pairs = 10;        /* residuals count from then on */
static const uint64_t bias_turns = 40; /* over so many turns what is common is told from chance */
static const unsigned most_lock = 32;  /* passes and events that the search looks at */

struct cart_clock_params cart_clock_params_default(void) {
    return (struct cart_clock_params){
        .max_drift_ppm = 200, .lock_turns = 6, .capture_ns = 500, .wake_ns = 500000};
}

const char *cart_clock_kind_text(enum cart_clock_kind kind) {
    static const char *const text[CART_CLOCK_KINDS] = {
        "the head's turns and the controller's events are matched",
        "the mirror turns too evenly: only arrival times told one turn from the next",
        "packets of the head were lost",
        "the head began anew",
        "the head's clock jumped",
        "the mirror's encoder slipped",
        "the mirror fell below half its speed",
        "index pulses come at another place of the encoder",
        "events of the controller were lost",
        "the controller began anew",
        "the host's clock jumped"};
    return kind < CART_CLOCK_KINDS ? text[kind] : "";
}

void cart_clock_init(struct cart_clock *clock, const struct cart_clock_params *params) {
    memset(clock, 0, sizeof *clock);
    clock->params = *params;
    clock->log = 1;
    head_turns_init(&clock->head);
}

static void incident(struct cart_clock *c, enum cart_clock_kind kind, int64_t t_head_ns,
                     int64_t t_host_ns, double value) {
    c->report.incidents[kind]++;
    c->incident[c->incident_count++ % CART_CLOCK_INCIDENTS] =
        (struct cart_clock_incident){kind, c->epoch, t_head_ns, t_host_ns, value};
}

/* ---- queues ---- */

static void pop(void *items, size_t size, unsigned *count, unsigned n) {
    char *bytes = items;
    *count -= n;
    memmove(bytes, bytes + n * size, *count * size);
}

static void pop_turn(struct cart_clock *c) {
    c->last_run = c->turn[0].run;
    c->last_turn = c->turn[0].turn;
    c->had_turn = true;
    pop(c->turn, sizeof c->turn[0], &c->turns, 1);
}

static void pop_event(struct cart_clock *c) {
    if (c->recents == 2)
        pop(c->recent, sizeof c->recent[0], &c->recents, 1);
    c->recent[c->recents++] = c->event[0];
    pop(c->event, sizeof c->event[0], &c->events, 1);
}

/* ---- spans: mean drifts ---- */

static void span_add(struct cart_clock_span *span, const struct clock_track *track) {
    struct clock_track_state s = clock_track_at(track, track->at_ns);
    double d_ns = (double)s.base_ns + s.d_ns;
    span->pairs++;
    if (span->pairs <= warm_pairs) {
        span->first_ns = s.at_ns;
        span->first_d_ns = d_ns;
        span->first_sigma_ns = s.sigma_ns;
        return;
    }
    double time_s = (double)(s.at_ns - span->first_ns) * 1e-9;
    span->last_ns = s.at_ns;
    if (!(time_s >= span->span_s) || !(time_s > 0))
        return;
    span->span_s = time_s;
    span->drift_ppm = (d_ns - span->first_d_ns) / time_s * 1e-3;
    span->sigma_ppm = hypot(s.sigma_ns, span->first_sigma_ns) / time_s * 1e-3;
}

static void span_end(struct cart_clock_span *span) {
    span->pairs = 0; /* what the longest one said stays */
}

/* ---- knots: events with head times ---- */

static double slip_until(const struct cart_clock *c, uint32_t epoch, int64_t t_head_ns) {
    double counts = 0;
    for (unsigned i = 0; i < c->slips; i++)
        if (c->slip[i].epoch == epoch && c->slip[i].t_head_ns <= t_head_ns)
            counts = c->slip[i].counts;
    return counts;
}

/* What the encoder had slipped at a knot, and does until the next. */
static void knot_slips(const struct cart_clock *c, struct sweep_index *knot) {
    knot->slip_counts = slip_until(c, knot->head_epoch, knot->t_head_ns);
    knot->slip_t_head_ns = 0;
    for (unsigned i = 0; i < c->slips && !knot->slip_t_head_ns; i++)
        if (c->slip[i].epoch == knot->head_epoch && c->slip[i].t_head_ns > knot->t_head_ns) {
            knot->slip_t_head_ns = c->slip[i].t_head_ns;
            knot->slip_after_counts = c->slip[i].counts;
        }
}

/* What does not average out: where the pulses come on the encoder, and what every gap hides alike.
 */
static double common_ns(const struct cart_clock *c) {
    return hypot(c->shift_sigma_ns, c->bias_ns);
}

/* The noise of logged positions, from the last ones; in a sweep, from those of the sweep. */
static void measure_noise(struct cart_clock *c) {
    enum { WINDOW = 16 };
    if (c->knots < WINDOW || c->knots % WINDOW)
        return;
    const struct sweep_index *window = c->knot + c->knots - WINDOW;
    double noise = pan_curve_noise(window, WINDOW);
    bool sweeps = window[0].sweep && window[WINDOW - 1].sweep;
    if (noise < 0 || (c->noise_of_sweep && !sweeps))
        return;
    bool anew = !c->noise_at++ || sweeps != c->noise_of_sweep;
    c->noise_steps = anew ? noise : 0.8 * c->noise_steps + 0.2 * noise;
    c->noise_of_sweep = sweeps;
}

/* Keeps the newest half when full; places among them are searched by time. */
static void add_knot(struct cart_clock *c, const struct cart_clock_event *event) {
    if (c->knots == CART_CLOCK_KNOTS) {
        c->knots /= 2;
        memmove(c->knot, c->knot + c->knots, c->knots * sizeof c->knot[0]);
    }
    struct sweep_index *k = &c->knot[c->knots];
    *k = event->index;
    struct clock_track_state state = clock_track_at(&c->head_track, c->head_track.at_ns);
    k->head_epoch = c->epoch;
    k->t_head_ns = clock_track_invert(&state, k->t_controller_ns, &k->t_sigma_ns);
    k->t_sigma_ns = hypot(k->t_sigma_ns, common_ns(c));
    if (c->knots && k[-1].head_epoch == k->head_epoch && k[-1].t_head_ns >= k->t_head_ns)
        return; /* it is there already */
    k->t_host_ns = 0;
    if (c->host_locked) {
        struct clock_track_state host = clock_track_at(&c->host_track, c->host_track.at_ns);
        k->t_host_ns = clock_track_apply(&host, k->t_controller_ns, NULL);
    }
    knot_slips(c, k);
    c->knots++;
    measure_noise(c);
}

/* ---- host: edges ---- */

static void host_step(struct cart_clock *c, const struct cart_clock_expected *e, int64_t edge_ns) {
    double off = (double)(edge_ns - e->t_host_ns), sigma = 0;
    if (c->host_locked) {
        off = clock_track_innovation(&c->host_track, e->t_controller_ns, edge_ns, c->params.wake_ns,
                                     &sigma);
        if (fabs(off) <= gate * sigma + gate_floor_ns) {
            c->host_offs = 0;
            clock_track_update(&c->host_track, e->t_controller_ns, edge_ns, c->params.wake_ns);
            span_add(&c->host_span, &c->host_track);
            c->report.host.pairs++;
            if (c->host_span.pairs > warm_pairs) {
                c->sum_host += off * off;
                c->n_host++;
                c->report.host.max_ns = fmax(c->report.host.max_ns, fabs(off));
            }
            return;
        }
        c->report.host.outliers++;
        bool alike = c->host_offs && fabs(off - c->host_off_ns) < gate * sigma + gate_floor_ns;
        c->host_offs = alike ? c->host_offs + 1 : 1;
        c->host_off_ns = off;
        if (c->host_offs < steps_in_a_row)
            return;
        incident(c, CART_CLOCK_HOST_JUMP, 0, edge_ns, off * 1e-9);
    }
    clock_track_start(&c->host_track, e->t_controller_ns, edge_ns, c->params.wake_ns,
                      c->params.max_drift_ppm);
    c->host_locked = true;
    c->host_offs = 0;
    c->report.host.segments++;
    c->report.host.pairs++;
    span_end(&c->host_span);
}

/* The edge of a pulse: near where the clocks expect it, if the head's packets came at about that
 * time, too. -1: none. */
static int find_edge(const struct cart_clock *c, const struct cart_clock_expected *e) {
    double near = fmin(near_edge_turn * e->turn_ns, near_edge_ns), least = near;
    int64_t want = e->t_host_ns;
    int best = -1;
    if (c->host_locked) {
        struct clock_track_state s = clock_track_at(&c->host_track, e->t_controller_ns);
        int64_t told = clock_track_apply(&s, e->t_controller_ns, NULL);
        if (fabs((double)(told - want)) < near) /* else the host's clock has jumped */
            want = told;
    }
    for (unsigned i = 0; i < c->edges; i++)
        if (fabs((double)(c->edge_ns[i] - want)) < least) {
            least = fabs((double)(c->edge_ns[i] - want));
            best = (int)i;
        }
    return best;
}

static void match_edges(struct cart_clock *c) {
    while (c->expecteds && c->report.edges) {
        const struct cart_clock_expected *e = &c->expected[0];
        double near = fmin(near_edge_turn * e->turn_ns, near_edge_ns);
        bool there = c->edges && (double)(c->edge_ns[c->edges - 1] - e->t_host_ns) > near;
        if (!there && c->expecteds < CART_CLOCK_QUEUE / 4)
            return; /* it may still come */
        int at = find_edge(c, e);
        if (at < 0) {
            c->report.missing_edges++;
        } else {
            c->report.spurious_edges += c->host_locked ? (unsigned)at : 0;
            if (e->has_event)
                host_step(c, e, c->edge_ns[at]);
            pop(c->edge_ns, sizeof c->edge_ns[0], &c->edges, (unsigned)at + 1);
        }
        pop(c->expected, sizeof c->expected[0], &c->expecteds, 1);
    }
}

static void expect_edge(struct cart_clock *c, int64_t t_controller_ns, const struct head_turn *turn,
                        bool has_event) {
    if (c->expecteds == CART_CLOCK_QUEUE)
        pop(c->expected, sizeof c->expected[0], &c->expecteds, 1);
    c->expected[c->expecteds++] = (struct cart_clock_expected){t_controller_ns, turn->t_host_ns,
                                                               1e9 / turn->rate_hz, has_event};
    match_edges(c);
}

void cart_clock_edge(struct cart_clock *clock, int64_t t_host_ns) {
    struct cart_clock *c = clock;
    c->report.edges++;
    if (c->edges == CART_CLOCK_QUEUE) {
        c->report.spurious_edges += c->host_locked;
        pop(c->edge_ns, sizeof c->edge_ns[0], &c->edges, 1);
    }
    c->edge_ns[c->edges++] = t_host_ns;
    match_edges(c);
}

/* ---- head: passes and events ---- */

/* Head time of the index pulse of a pass. */
static int64_t pulse_ns(const struct cart_clock *c, const struct head_turn *turn) {
    double counts_ns = turn->rate_hz * HEAD_ENCODER_COUNTS * 1e-9;
    return turn->t_head_ns + (int64_t)llround(c->shift_counts / counts_ns);
}

static int64_t event_ns(const struct cart_clock *c, const struct cart_clock_event *event) {
    return event->index.t_controller_ns + (int64_t)c->params.capture_ns;
}

static double pair_sigma(const struct head_turn *turn) {
    const double capture_ns = 500;
    return hypot(turn->sigma_ns, capture_ns);
}

static void take_pair(struct cart_clock *c, const struct head_turn *turn, double off) {
    int64_t from = pulse_ns(c, turn), to = event_ns(c, &c->event[0]);
    double sigma = pair_sigma(turn);
    uint64_t n = c->head_span.pairs; /* the first ones may lie in the mirror's spin-up */
    double part = 1.0 / (double)(n > warm_pairs + bias_turns ? bias_turns
                                 : n > warm_pairs            ? n - warm_pairs
                                                             : 1);
    c->bias_ns += part * (turn->bias_ns - c->bias_ns);
    if (c->head_track.used)
        clock_track_update(&c->head_track, from, to, sigma);
    else
        clock_track_start(&c->head_track, from, to, sigma, c->params.max_drift_ppm);
    c->offs = 0;
    span_add(&c->head_span, &c->head_track);
    c->report.head.pairs++;
    if (c->head_span.pairs > warm_pairs) {
        c->sum_head += off * off;
        c->n_head++;
        c->report.head.max_ns = fmax(c->report.head.max_ns, fabs(off));
    }
    if (c->on_match) {
        struct cart_clock_match match = {c->epoch, c->event[0].index.log, from, to,
                                         sigma,    common_ns(c)};
        c->on_match(c->on_match_ctx, &match);
    }
}

/* An event near a pass, but not where the clocks say. Three alike: pulses now come at another place
 * of the encoder (clocks that jump are noticed elsewhere). */
static void off_pair(struct cart_clock *c, const struct head_turn *turn, double off, double slack) {
    c->report.head.outliers++;
    bool alike = c->offs && fabs(off - c->off_ns) < slack;
    c->offs = alike ? c->offs + 1 : 1;
    c->off_ns = alike ? c->off_ns + (off - c->off_ns) / c->offs : off;
    if (c->offs < steps_in_a_row)
        return;
    double counts = c->off_ns * turn->rate_hz * HEAD_ENCODER_COUNTS * 1e-9;
    double sigma = slack / gate / sqrt((double)steps_in_a_row);
    c->shift_sigma_ns = hypot(c->shift_sigma_ns, sigma);
    c->shift_counts += counts;
    c->offs = 0;
    c->report.head.segments++;
    incident(c, CART_CLOCK_INDEX_SHIFT, turn->t_head_ns, turn->t_host_ns, counts);
}

/* An event that no pass belongs to. */
static void lone_event(struct cart_clock *c) {
    const struct head_turn *next = c->turns ? &c->turn[0] : NULL;
    bool looked = next && c->had_turn && next->run == c->last_run &&
                  next->turn == c->last_turn + 1 && next->epoch == c->epoch;
    if (looked)
        c->report.spurious_events++;
    else
        c->report.unseen_turns++;
    add_knot(c, &c->event[0]);
    if (c->host_locked && next) { /* the host may have seen it all the same */
        struct head_turn like = *next;
        struct clock_track_state s = clock_track_at(&c->host_track, c->host_track.at_ns);
        like.t_host_ns = clock_track_apply(&s, event_ns(c, &c->event[0]), NULL);
        expect_edge(c, event_ns(c, &c->event[0]), &like, false);
    }
    pop_event(c);
}

static void lone_turn(struct cart_clock *c, int64_t expected_ns) {
    c->report.missing_events++;
    expect_edge(c, expected_ns, &c->turn[0], false);
    pop_turn(c);
}

static void release(struct cart_clock *c) {
    for (unsigned i = 0; i < c->events && i < 2; i++) /* samples may lie before them */
        add_knot(c, &c->event[i]);
    c->locked = false;
    c->shift_counts = c->shift_sigma_ns = c->bias_ns = 0;
    c->offs = 0;
    c->had_turn = false;
    c->head_track.used = 0;
    span_end(&c->head_span);
}

/* Of the first passes, those of one epoch. */
static unsigned of_one_epoch(struct cart_clock *c) {
    unsigned n = 0;
    while (n < c->turns && n < most_lock && c->turn[n].epoch == c->turn[0].epoch)
        n++;
    return n;
}

static bool lock(struct cart_clock *c) {
    struct cart_lock found;
    unsigned n = of_one_epoch(c), m = c->events < most_lock ? c->events : most_lock;
    if (!cart_lock_find(&c->params, c->turn, n, c->event, m, &found)) {
        /* A dead end: passes of an epoch that is over, or more than the search can use. */
        if (n < c->turns && n < most_lock)
            pop(c->turn, sizeof c->turn[0], &c->turns, n);
        else if (n == most_lock)
            pop(c->turn, sizeof c->turn[0], &c->turns, most_lock / 2);
        if (m == most_lock)
            pop(c->event, sizeof c->event[0], &c->events, most_lock / 2);
        return false;
    }
    c->locked = true;
    c->epoch = c->turn[0].epoch;
    const struct head_turn *first = &c->turn[found.first_turn];
    clock_track_start(&c->head_track, pulse_ns(c, first), event_ns(c, &c->event[found.first_event]),
                      pair_sigma(first), c->params.max_drift_ppm);
    c->head_track.used = 0; /* the pair itself comes below */
    for (unsigned i = 0; i < c->recents; i++)
        if (c->recent[i].index.log == c->event[0].index.log)
            add_knot(c, &c->recent[i]);
    for (unsigned i = 0; i < found.first_event; i++) {
        add_knot(c, &c->event[0]);
        pop_event(c);
    }
    for (unsigned i = 0; i < found.first_turn; i++)
        pop_turn(c);
    c->report.head.segments++;
    incident(c, CART_CLOCK_LOCKED, first->t_head_ns, first->t_host_ns, found.scatter_ns * 1e-3);
    if (found.ambiguous)
        incident(c, CART_CLOCK_AMBIGUOUS, first->t_head_ns, first->t_host_ns, 0);
    return true;
}

/* One pass or event leaves the queue; false: more must come first. */
static bool step(struct cart_clock *c) {
    if (!c->turns || !c->events)
        return false;
    if (!c->locked || c->turn[0].epoch != c->epoch) {
        if (c->locked)
            release(c);
        return lock(c);
    }
    const struct head_turn turn = c->turn[0];
    double turn_ns = 1e9 / turn.rate_hz, near = fmin(near_turn * turn_ns, near_edge_ns);
    struct clock_track_state state = clock_track_at(&c->head_track, pulse_ns(c, &turn));
    int64_t want = clock_track_apply(&state, pulse_ns(c, &turn), NULL);
    double sigma, off = (double)(event_ns(c, &c->event[0]) - want);
    (void)clock_track_innovation(&c->head_track, pulse_ns(c, &turn), want, pair_sigma(&turn),
                                 &sigma);
    double slack = gate * sigma + gate_floor_ns;
    if (fabs(off) > near) {
        if (off < 0)
            lone_event(c);
        else
            lone_turn(c, want);
        return true;
    }
    if (fabs(off) > slack && off < 0) { /* does the next one fit better? */
        if (c->events < 2)
            return false;
        if (fabs((double)(event_ns(c, &c->event[1]) - want)) <= slack) {
            lone_event(c);
            return true;
        }
    }
    bool fits = fabs(off) <= slack || !c->head_track.used;
    if (fits)
        take_pair(c, &turn, off);
    else
        off_pair(c, &turn, off, slack);
    expect_edge(c, event_ns(c, &c->event[0]), &turn, fits);
    add_knot(c, &c->event[0]);
    pop_turn(c);
    pop_event(c);
    return true;
}

static void advance(struct cart_clock *c) {
    while (step(c)) {
    }
}

void cart_clock_turn(struct cart_clock *clock, const struct head_turn *turn) {
    struct cart_clock *c = clock;
    c->report.turns++;
    if (c->turns == CART_CLOCK_QUEUE) { /* the controller says nothing */
        c->report.missing_events += c->locked;
        pop_turn(c);
    }
    c->turn[c->turns++] = *turn;
    advance(c);
}

void cart_clock_head_incident(struct cart_clock *clock, const struct head_turns_incident *in) {
    static const enum cart_clock_kind kind[HEAD_TURNS_KINDS] = {
        [HEAD_TURNS_LOST] = CART_CLOCK_PACKETS_LOST,
        [HEAD_TURNS_RESET] = CART_CLOCK_HEAD_RESET,
        [HEAD_TURNS_TIME_JUMP] = CART_CLOCK_HEAD_JUMP,
        [HEAD_TURNS_SLIP] = CART_CLOCK_ENCODER_SLIP,
        [HEAD_TURNS_SLOW] = CART_CLOCK_MIRROR_SLOW};
    struct cart_clock *c = clock;
    incident(c, kind[in->kind], in->t_head_ns, in->t_host_ns, in->value);
    if (in->kind != HEAD_TURNS_SLIP)
        return;
    double before = slip_until(c, in->epoch, in->t_head_ns);
    if (c->slips == CART_CLOCK_SLIPS)
        pop(c->slip, sizeof c->slip[0], &c->slips, 1);
    c->slip[c->slips].epoch = in->epoch;
    c->slip[c->slips].t_head_ns = in->t_head_ns;
    c->slip[c->slips++].counts = before + in->value;
    for (size_t i = c->knots < 8 ? 0 : c->knots - 8; i < c->knots; i++)
        knot_slips(c, &c->knot[i]);
}

void cart_clock_packet(struct cart_clock *clock, const struct head_packet *packet,
                       int64_t t_host_ns) {
    struct head_turns *head = &clock->head;
    head_turns_packet(head, packet, t_host_ns);
    for (unsigned i = 0; i < head->incident_count; i++)
        cart_clock_head_incident(clock, &head->incident[i]);
    for (unsigned i = 0; i < head->turn_count; i++)
        cart_clock_turn(clock, &head->turn[i]);
}

/* ---- controller ---- */

static void restart(struct cart_clock *c, int64_t t_host_ns) {
    incident(c, CART_CLOCK_CONTROLLER_RESTART, 0, t_host_ns, 0);
    c->log++;
    if (c->locked)
        release(c);
    c->events = c->recents = c->expecteds = 0;
    c->host_locked = false;
    c->host_offs = 0;
    span_end(&c->host_span);
}

struct sweep_index cart_clock_index(const struct index_event *event, uint32_t log) {
    const struct index_event *e = event;
    bool positive = (e->flags & INDEX_EVENT_PAN_POSITIVE) != 0;
    bool taken_up = (e->flags & INDEX_EVENT_PAN_TAKEN_UP) != 0;
    bool moving = (e->flags & INDEX_EVENT_PAN_MOVING) != 0;
    double latch = !moving ? 0 : positive ? half_latch : -half_latch; /* what truncation took */
    return (struct sweep_index){.revolution = (uint32_t)e->revolution,
                                .pan_steps = e->pan_steps + latch,
                                .tilt_steps = (double)e->tilt_steps,
                                .pan_direction = (int8_t)(!taken_up  ? 0
                                                          : positive ? 1
                                                                     : -1),
                                .sweep = (e->flags & INDEX_EVENT_SWEEP) != 0,
                                .pan_moving = moving,
                                .tilt_moving = (e->flags & INDEX_EVENT_TILT_MOVING) != 0,
                                .log = log,
                                .t_controller_ns = e->t_ns};
}

void cart_clock_event(struct cart_clock *clock, const struct index_event *event,
                      int64_t t_host_ns) {
    struct cart_clock *c = clock;
    int64_t *seen_ns = &c->seen_ns[event->seq % CART_CLOCK_SEEN];
    if (event->seq < c->next_seq) {
        if (event->seq + CART_CLOCK_SEEN >= c->next_seq && *seen_ns == event->t_ns) {
            c->report.repeated_events++;
            return;
        }
        restart(c, t_host_ns);
    } else if (event->seq > c->next_seq && c->next_seq) {
        c->report.lost_events += event->seq - c->next_seq;
        incident(c, CART_CLOCK_EVENTS_LOST, 0, t_host_ns, (double)(event->seq - c->next_seq));
    }
    *seen_ns = event->t_ns;
    c->next_seq = event->seq + 1;
    if (event->kind != INDEX_EVENT_INDEX)
        return;
    c->report.events++;
    if (c->events == CART_CLOCK_QUEUE) { /* the head says nothing */
        if (c->locked)
            lone_event(c);
        else
            pop_event(c);
    }
    c->event[c->events++] = (struct cart_clock_event){cart_clock_index(event, c->log), t_host_ns};
    advance(c);
}

/* ---- answers ---- */

void cart_clock_place(const struct cart_clock *clock, uint32_t head_epoch, int64_t t_head_ns,
                      double counts, struct sweep_place *out_place) {
    const struct cart_clock *c = clock;
    struct sweep_cursor cursor = {
        .at = c->knots,
        .params = {.noise_steps = c->noise_steps,
                   .acceleration_steps_s2 = c->params.acceleration_steps_s2}};
    sweep_at(&cursor, c->knot, c->knots, head_epoch, t_head_ns, counts, out_place);
    if (out_place->verdict == SWEEP_GOOD) { /* a ramp: two events after it tell how it went on */
        if (cursor.curve.shape == PAN_CURVE_CUBIC && cursor.at + 4 > c->knots)
            out_place->verdict = SWEEP_LATER;
        return;
    }
    const struct sweep_index *last = c->knots ? &c->knot[c->knots - 1] : NULL;
    bool newer = !last || head_epoch > last->head_epoch ||
                 (head_epoch == last->head_epoch && t_head_ns >= last->t_head_ns);
    if (newer && head_epoch == c->head.epoch.number)
        out_place->verdict = SWEEP_LATER;
}

static void finish(struct cart_clock_pair *pair, const struct cart_clock_span *span, double sum,
                   uint64_t n) {
    pair->rms_ns = n ? sqrt(sum / (double)n) : (double)NAN;
    pair->drift_ppm = span->span_s > 0 ? span->drift_ppm : (double)NAN;
    pair->drift_sigma_ppm = span->span_s > 0 ? span->sigma_ppm : (double)NAN;
}

void cart_clock_report(const struct cart_clock *clock, struct cart_clock_report *out_report) {
    struct cart_clock_report r = clock->report;
    finish(&r.head, &clock->head_span, clock->sum_head, clock->n_head);
    finish(&r.host, &clock->host_span, clock->sum_host, clock->n_host);
    r.pan_noise_steps = clock->noise_at ? clock->noise_steps : -1;
    *out_report = r;
}
