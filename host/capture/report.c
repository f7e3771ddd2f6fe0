#include "capture/report.h"

#include "base/edge_record.h"
#include "base/sweep.h"
#include "capture/event_wire.h"
#include "site/frame_row.h"
#include "site/stream.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    PAGE = 16,
    WAITING = 1 << 16,      /* samples that wait for the next index event */
    PLACED_A_SECOND = 3000, /* of the samples, evenly: enough for cells of a degree */
    CELLS_AROUND = 360,
    CELLS_UP = 180
};

static const double pi = 3.14159265358979323846;

/* Running mean and sum of squares (Welford 1962). */
struct mean {
    uint64_t n;
    double mean, m2, worst;
};

static void mean_add(struct mean *m, double x) {
    m->n++;
    double d = x - m->mean;
    m->mean += d / (double)m->n;
    m->m2 += d * (x - m->mean);
}

static double mean_sigma(const struct mean *m) {
    return m->n > 1 ? sqrt(m->m2 / (double)(m->n - 1)) : 0;
}

struct waiting {
    int64_t t_head_ns;
    uint32_t epoch;
    float counts;
    bool returned;
};

enum source { HEAD, INDEX, GPIO, SOURCES };

struct work {
    struct site *site;
    const struct rig *rig;
    struct report *out;
    struct cart_clock clock;
    struct head_ledger ledger;
    struct head_packet packet;
    /* the session's three streams, side by side */
    struct stream_reader *reader[SOURCES];
    struct stream_chunk chunk[SOURCES];
    bool has[SOURCES];
    /* placing */
    struct waiting wait[WAITING];
    size_t first, count;
    uint32_t every, number;
    uint8_t cell[CELLS_UP][CELLS_AROUND]; /* 1 looked at, 2 returned */
    /* regularity */
    struct index_event before;
    struct mean hz, step;
    double step_low, step_high;
};

/* ---- coverage ---- */

static void mark(struct work *w, const struct sweep_place *place, bool returned) {
    const double far_m = 1000; /* so that the mirror's own place does not matter */
    const struct rig *rig = w->rig;
    struct vec3 p =
        rig_point(rig, rig_mirror_angle(rig, place->counts), rig_tilt_angle(rig, place->tilt_steps),
                  rig_pan_angle(rig, place->pan_steps, place->pan_direction), far_m);
    double up = atan2(p.z, hypot(p.x, p.y)) / pi + 0.5, around = atan2(p.y, p.x) / (2 * pi) + 0.5;
    int row = (int)(up * CELLS_UP), column = (int)(around * CELLS_AROUND);
    if (!isfinite(up) || !isfinite(around))
        return;
    row = row < 0 ? 0 : row >= CELLS_UP ? CELLS_UP - 1 : row;
    column = column < 0 ? 0 : column >= CELLS_AROUND ? CELLS_AROUND - 1 : column;
    w->cell[row][column] |= returned ? 3 : 1;
}

/* Places what waits, up to the first sample whose next event has not come. */
static void place_waiting(struct work *w, bool all) {
    while (w->count) {
        struct sweep_place place;
        const struct waiting *s = &w->wait[w->first];
        memset(&place, 0, sizeof place);
        cart_clock_place(&w->clock, s->epoch, s->t_head_ns, (double)s->counts, &place);
        if (place.verdict == SWEEP_LATER && !all)
            return;
        if (place.verdict == SWEEP_GOOD && place.sweep) {
            w->out->placed += w->every;
            if (w->rig)
                mark(w, &place, s->returned);
        } else if (place.verdict != SWEEP_GOOD) {
            w->out->unplaced += w->every;
        }
        w->first = (w->first + 1) % WAITING;
        w->count--;
    }
}

static void let_wait(struct work *w) {
    const struct head_packet *p = &w->packet;
    if (!w->every && p->interval_ns)
        w->every = (uint32_t)fmax(1, 1e9 / p->interval_ns / PLACED_A_SECOND);
    for (unsigned i = 0; i < p->sample_count; i++) {
        if (p->samples[i].flags & HEAD_SAMPLE_LASER_OFF || !w->every || w->number++ % w->every)
            continue;
        if (w->count == WAITING) { /* no event for long: it is not going to come */
            w->out->unplaced += w->every;
            w->first = (w->first + 1) % WAITING;
            w->count--;
        }
        w->wait[(w->first + w->count++) % WAITING] =
            (struct waiting){p->head_t_ns + (int64_t)i * p->interval_ns, w->clock.head.epoch.number,
                             (float)head_position_counts(p->samples[i].position),
                             p->samples[i].range != HEAD_RANGE_NONE};
    }
}

static void share_of_sphere(struct work *w) {
    double looked = 0, returned = 0, whole = 0;
    for (int row = 0; row < CELLS_UP; row++) {
        double area = cos(((row + 0.5) / CELLS_UP - 0.5) * pi);
        for (int column = 0; column < CELLS_AROUND; column++) {
            whole += area;
            looked += w->cell[row][column] & 1 ? area : 0;
            returned += w->cell[row][column] & 2 ? area : 0;
        }
    }
    w->out->sphere_covered = w->rig ? looked / whole : (double)NAN;
    w->out->sphere_returned = w->rig ? returned / whole : (double)NAN;
}

/* ---- streams ---- */

static void take_head(struct work *w, const struct stream_chunk *chunk) {
    struct head_stream_stats stats = {0};
    uint64_t skipped = 0;
    size_t at = 0;
    int64_t first_head_ns = INT64_MIN;
    while (!head_stream_next(chunk->payload, chunk->size_bytes, &at, &w->packet, &stats)) {
        if (stats.bytes_skipped > skipped)
            head_ledger_damaged(&w->ledger, stats.bytes_skipped - skipped);
        skipped = stats.bytes_skipped;
        if (first_head_ns == INT64_MIN)
            first_head_ns = w->packet.head_t_ns;
        struct head_ledger_verdict v = head_ledger_packet(&w->ledger, &w->packet);
        if (!v.counts)
            continue;
        int64_t t_ns = chunk->t_first_ns + (w->packet.head_t_ns - first_head_ns);
        cart_clock_packet(&w->clock, &w->packet, t_ns < chunk->t_last_ns ? t_ns : chunk->t_last_ns);
        let_wait(w);
    }
    uint64_t rest = chunk->size_bytes - at + stats.bytes_skipped - skipped;
    if (rest)
        head_ledger_damaged(&w->ledger, rest);
}

static void regularity(struct work *w, const struct index_event *e) {
    const struct index_event *b = &w->before;
    struct report *out = w->out;
    bool both = b->flags & e->flags & INDEX_EVENT_SWEEP;
    if (e->flags & INDEX_EVENT_SWEEP) {
        out->pan_from_steps =
            fmin(isnan(out->pan_from_steps) ? e->pan_steps : out->pan_from_steps, e->pan_steps);
        out->pan_to_steps =
            fmax(isnan(out->pan_to_steps) ? e->pan_steps : out->pan_to_steps, e->pan_steps);
    }
    if (both && e->revolution == b->revolution + 1 && e->t_ns > b->t_ns) {
        double step = e->pan_steps - b->pan_steps;
        mean_add(&w->hz, 1e9 / (double)(e->t_ns - b->t_ns));
        mean_add(&w->step, step);
        w->step_low = fmin(w->step_low, step);
        w->step_high = fmax(w->step_high, step);
    }
    w->before = *e;
}

static void take_index(struct work *w, const struct stream_chunk *chunk) {
    size_t count = chunk->size_bytes / EVENT_WIRE_BYTES;
    const uint8_t *bytes = chunk->payload;
    int64_t last_ns = count ? event_wire_decode(bytes + (count - 1) * EVENT_WIRE_BYTES).t_ns : 0;
    for (size_t i = 0; i < count; i++) {
        struct index_event e = event_wire_decode(bytes + i * EVENT_WIRE_BYTES);
        cart_clock_event(&w->clock, &e, chunk->t_last_ns - (last_ns - e.t_ns));
        if (e.kind == INDEX_EVENT_INDEX)
            regularity(w, &e);
    }
    place_waiting(w, false);
}

static void take_gpio(struct work *w, const struct stream_chunk *chunk) {
    const uint8_t *bytes = chunk->payload;
    for (size_t at = 0; at + EDGE_RECORD_BYTES <= chunk->size_bytes; at += EDGE_RECORD_BYTES) {
        struct edge_record edge = edge_record_decode(bytes + at);
        if (edge.line == EDGE_RECORD_INDEX && edge.rising)
            cart_clock_edge(&w->clock, edge.t_ns);
    }
}

static enum st next_chunk(struct work *w, int source, struct errctx *err) {
    enum st st = ST_DAMAGED;
    while (st == ST_DAMAGED) /* the others are as good as ever */
        st = stream_reader_next(w->reader[source], &w->chunk[source], err);
    w->has[source] = !st;
    return st == ST_NOT_FOUND ? ST_OK : st;
}

/* All chunks of a session in the order in which they began. */
static enum st take_all(struct work *w, struct errctx *err) {
    static void (*const take[SOURCES])(struct work *, const struct stream_chunk *) = {
        take_head, take_index, take_gpio};
    enum st st = ST_OK;
    for (int i = 0; i < SOURCES && !st; i++)
        st = w->reader[i] ? next_chunk(w, i, err) : ST_OK;
    while (!st && (w->has[HEAD] || w->has[INDEX] || w->has[GPIO])) {
        int first = -1;
        for (int i = 0; i < SOURCES; i++)
            if (w->has[i] && (first < 0 || w->chunk[i].t_first_ns < w->chunk[first].t_first_ns))
                first = i;
        take[first](w, &w->chunk[first]);
        st = next_chunk(w, first, err);
    }
    place_waiting(w, true);
    return st;
}

static enum st open_reader(struct work *w, int source, const struct stream *head, const char *kind,
                           struct errctx *err) {
    struct stream stream;
    enum st st = stream_find(w->site, head->station_id, kind, head->name, &stream, err);
    if (st == ST_NOT_FOUND)
        return ST_OK;
    return st ? st : stream_reader_open(w->site, stream.id, 0, &w->reader[source], err);
}

/* The worse of two sessions' clocks, by their residuals. */
static void keep_clock(struct work *w) {
    struct cart_clock_report r;
    cart_clock_report(&w->clock, &r);
    if (!w->out->has_clock || r.head.rms_ns > w->out->clock.head.rms_ns)
        w->out->clock = r;
    w->out->has_clock = true;
}

static void add_totals(struct head_ledger_totals *sum, const struct head_ledger_totals *t) {
    for (int i = 0; i < HEAD_LEDGER_REASONS; i++) {
        sum->lost_packets[i] += t->lost_packets[i];
        sum->lost_samples[i] += t->lost_samples[i];
    }
    sum->packets += t->packets;
    sum->samples += t->samples;
    sum->not_sent += t->not_sent;
    sum->overruns += t->overruns;
    sum->resets += t->resets;
    sum->repeated += t->repeated;
    sum->sequence += t->sequence;
    sum->damaged_bytes += t->damaged_bytes;
    sum->returns += t->returns;
    sum->no_returns += t->no_returns;
    sum->dropped += t->dropped;
    sum->saturated += t->saturated;
    sum->laser_off += t->laser_off;
}

static enum st take_session(struct work *w, const struct stream *head, struct errctx *err) {
    struct cart_clock_params params = cart_clock_params_default();
    struct head_ledger_gap gaps[HEAD_LEDGER_MAX_GAPS];
    cart_clock_init(&w->clock, &params);
    head_ledger_init(&w->ledger);
    memset(&w->before, 0, sizeof w->before);
    w->out->sessions++;
    enum st st = open_reader(w, HEAD, head, "head", err);
    if (!st)
        st = open_reader(w, INDEX, head, "index", err);
    if (!st)
        st = open_reader(w, GPIO, head, "gpio", err);
    if (!st)
        st = take_all(w, err);
    for (int i = 0; i < SOURCES; i++) {
        stream_reader_close(w->reader[i]);
        w->reader[i] = NULL;
        w->has[i] = false;
    }
    (void)head_ledger_end(&w->ledger, gaps);
    add_totals(&w->out->head, &w->ledger.totals);
    if (w->ledger.totals.packets)
        keep_clock(w);
    return st;
}

/* ---- ledger and frames ---- */

static void add_loss(struct report *out, const struct stream_ledger *entry) {
    size_t i = 0;
    while (i < out->losses && strcmp(out->loss[i].reason, entry->reason) != 0)
        i++;
    if (i == REPORT_REASONS)
        return;
    if (i == out->losses)
        memcpy(out->loss[out->losses++].reason, entry->reason, sizeof entry->reason);
    out->loss[i].entries++;
    out->loss[i].items += entry->end_item - entry->first_item;
}

static enum st take_ledger(struct work *w, const struct stream *stream, struct errctx *err) {
    struct stream_ledger entries[PAGE];
    struct stream_state state;
    size_t count = PAGE;
    int64_t after = 0;
    enum st st = stream_get_state(w->site, stream->id, &state, err);
    while (!st && count == PAGE) {
        st = stream_ledger_list(w->site, stream->id, after, entries, PAGE, &count, err);
        for (size_t i = 0; i < count && !st; i++) {
            after = entries[i].id;
            add_loss(w->out, &entries[i]);
        }
    }
    if (st)
        return st;
    w->out->payload_bytes += state.payload_bytes;
    w->out->stored_bytes += state.stored_bytes;
    if (!strcmp(stream->kind, "head")) {
        w->out->ledger_packets += state.missing_count;
    } else if (!strcmp(stream->kind, "index")) {
        w->out->index_events += state.item_count;
        w->out->index_missing += state.missing_count;
    } else if (!strcmp(stream->kind, "gpio")) {
        w->out->edges += state.item_count;
    }
    return ST_OK;
}

static enum st visit_frame(void *ctx, const struct frame_row *row, struct errctx *err) {
    struct work *w = ctx;
    (void)row;
    (void)err;
    w->out->frames++;
    return ST_OK;
}

/* ---- the whole ---- */

static enum st visit_stream(void *ctx, const struct stream *stream, struct errctx *err) {
    struct work *w = ctx;
    enum st st = take_ledger(w, stream, err);
    return st || strcmp(stream->kind, "head") != 0 ? st : take_session(w, stream, err);
}

enum st report_make(struct site *site, int64_t station_id, const struct rig *rig,
                    struct report *out_report, struct errctx *err) {
    struct work *w = calloc(1, sizeof *w);
    if (!w)
        return errctx_set(err, ST_NOMEM, "no memory for the report");
    memset(out_report, 0, sizeof *out_report);
    out_report->pan_from_steps = out_report->pan_to_steps = (double)NAN;
    w->site = site;
    w->rig = rig;
    w->out = out_report;
    w->step_low = INFINITY;
    w->step_high = -INFINITY;
    enum st st = stream_each(site, station_id, visit_stream, w, err);
    if (!st)
        st = frame_row_each(site, station_id, visit_frame, w, err);
    if (!st && !out_report->sessions)
        st = errctx_set(err, ST_NOT_FOUND, "nothing has been scanned from this station");
    share_of_sphere(w);
    out_report->turns = w->step.n;
    out_report->mirror_hz = w->hz.mean;
    out_report->mirror_hz_sigma = mean_sigma(&w->hz);
    out_report->pan_step = w->step.mean;
    out_report->pan_step_sigma = mean_sigma(&w->step);
    out_report->pan_step_worst =
        w->step.n ? fmax(w->step_high - w->step.mean, w->step.mean - w->step_low) : 0;
    free(w);
    return st;
}
