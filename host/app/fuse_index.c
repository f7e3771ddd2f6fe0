#include "app/fuse_index.h"

#include "base/clock_fit.h"
#include "base/clock_solve.h"
#include "base/edge_record.h"
#include "firmware/shared/idxevent.h"
#include "site/stream.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Index pulses of one scan at the most: a day at 50 Hz. */
enum { MAX_EVENTS = 1 << 22, EVENT_BYTES = 2 * IDXEVENT_WORDS };

struct events {
    struct idxevent *events;
    size_t count, capacity;
    int64_t *from_ns, *to_ns; /* pairs of controller and host time */
    size_t pair_count, pair_capacity;
};

static void events_fini(struct events *e) {
    free(e->events);
    free(e->from_ns);
    free(e->to_ns);
    memset(e, 0, sizeof *e);
}

static enum st add_event(struct events *e, const struct idxevent *event) {
    if (e->count == e->capacity) {
        size_t capacity = e->capacity ? 2 * e->capacity : 1024;
        struct idxevent *grown =
            capacity <= MAX_EVENTS ? realloc(e->events, capacity * sizeof *grown) : NULL;
        if (!grown)
            return ST_NOMEM;
        e->events = grown;
        e->capacity = capacity;
    }
    e->events[e->count++] = *event;
    return ST_OK;
}

static enum st add_pair(struct events *e, int64_t from_ns, int64_t to_ns) {
    if (e->pair_count == e->pair_capacity) {
        size_t capacity = e->pair_capacity ? 2 * e->pair_capacity : 1024;
        int64_t *from = realloc(e->from_ns, capacity * sizeof *from);
        if (from)
            e->from_ns = from;
        int64_t *to = from ? realloc(e->to_ns, capacity * sizeof *to) : NULL;
        if (!to)
            return ST_NOMEM;
        e->to_ns = to;
        e->pair_capacity = capacity;
    }
    e->from_ns[e->pair_count] = from_ns;
    e->to_ns[e->pair_count++] = to_ns;
    return ST_OK;
}

static struct idxevent event_at(const uint8_t *bytes) {
    uint16_t words[IDXEVENT_WORDS];
    for (int i = 0; i < IDXEVENT_WORDS; i++) /* as on the controller's line: high byte first */
        words[i] = (uint16_t)(bytes[2 * i] << 8 | bytes[2 * i + 1]);
    return idxevent_decode(words);
}

static int64_t event_ns(const struct idxevent *event) {
    return (int64_t)event->time_us * 1000;
}

/* All events of a chunk; its first and last arrival pair the clocks. */
static enum st take_chunk(struct events *e, const struct stream_chunk *chunk) {
    size_t n = chunk->size_bytes / EVENT_BYTES;
    const uint8_t *bytes = chunk->payload;
    enum st st = ST_OK;
    for (size_t i = 0; !st && i < n; i++) {
        struct idxevent event = event_at(bytes + i * EVENT_BYTES);
        if (i == 0)
            st = add_pair(e, event_ns(&event), chunk->t_first_ns);
        if (!st && i == n - 1 && n > 1)
            st = add_pair(e, event_ns(&event), chunk->t_last_ns);
        if (!st && (event.flags & IDXEVENT_KIND) == IDXEVENT_INDEX)
            st = add_event(e, &event);
    }
    return st;
}

static enum st read_events(struct site *site, const struct stream *stream, struct events *e,
                           struct errctx *err) {
    struct stream_reader *reader = NULL;
    enum st st = stream_reader_open(site, stream->id, 0, &reader, err);
    while (!st) {
        struct stream_chunk chunk;
        st = stream_reader_next(reader, &chunk, err);
        if (st == ST_DAMAGED) { /* the others are as good as ever */
            st = ST_OK;
            continue;
        }
        if (!st && (st = take_chunk(e, &chunk)))
            (void)errctx_set(err, st, "station has too many index events");
    }
    stream_reader_close(reader);
    return st == ST_NOT_FOUND ? ST_OK : st;
}

static int by_value(const void *a, const void *b) {
    int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}

/* Rising index edges of the "gpio" stream, sorted; none is no failure. */
static enum st read_edges(struct site *site, int64_t station_id, const char *name,
                          int64_t **out_edges, size_t *out_count, struct errctx *err) {
    struct stream stream;
    struct stream_reader *reader = NULL;
    int64_t *edges = NULL;
    size_t count = 0, capacity = 0;
    *out_edges = NULL;
    *out_count = 0;
    enum st st = stream_find(site, station_id, "gpio", name, &stream, err);
    if (st == ST_NOT_FOUND)
        return ST_OK;
    if (!st)
        st = stream_reader_open(site, stream.id, 0, &reader, err);
    struct stream_chunk chunk;
    while (!st) {
        st = stream_reader_next(reader, &chunk, err);
        if (st == ST_DAMAGED) {
            st = ST_OK;
            continue;
        }
        for (size_t at = 0; !st && at + EDGE_RECORD_BYTES <= chunk.size_bytes;
             at += EDGE_RECORD_BYTES) {
            struct edge_record edge = edge_record_decode((const uint8_t *)chunk.payload + at);
            if (edge.line != EDGE_RECORD_INDEX || !edge.rising)
                continue;
            if (count == capacity) {
                capacity = capacity ? 2 * capacity : 1024;
                int64_t *grown =
                    capacity <= MAX_EVENTS ? realloc(edges, capacity * sizeof *grown) : NULL;
                if (!grown) {
                    st = errctx_set(err, ST_NOMEM, "station has too many index edges");
                    break;
                }
                edges = grown;
            }
            edges[count++] = edge.t_ns;
        }
    }
    stream_reader_close(reader);
    if (st && st != ST_NOT_FOUND) {
        free(edges);
        return st;
    }
    if (count)
        qsort(edges, count, sizeof *edges, by_value);
    *out_edges = edges;
    *out_count = count;
    return ST_OK;
}

static int64_t nearest_edge(const int64_t *edges, size_t count, int64_t t_ns) {
    size_t lo = 0, hi = count;
    while (lo < hi) {
        size_t mid = (lo + hi) / 2;
        if (edges[mid] < t_ns)
            lo = mid + 1;
        else
            hi = mid;
    }
    if (lo == count)
        return edges[count - 1];
    return lo > 0 && t_ns - edges[lo - 1] < edges[lo] - t_ns ? edges[lo - 1] : edges[lo];
}

/* Pairs each event with the edge nearest to where the rough fit expects it, within a fifth of a
 * turn. */
static enum st refine(struct events *e, const int64_t *edges, size_t edge_count,
                      struct clock_fit *fit) {
    if (!edge_count || e->count < 3)
        return ST_OK;
    int64_t span = event_ns(&e->events[e->count - 1]) - event_ns(&e->events[0]);
    int64_t near_ns = span / (int64_t)(e->count - 1) / 5;
    e->pair_count = 0;
    for (size_t i = 0; i < e->count; i++) {
        int64_t t_ns = event_ns(&e->events[i]), want = clock_fit_apply(fit, t_ns);
        int64_t edge = nearest_edge(edges, edge_count, want), off = edge - want;
        enum st st = off < near_ns && off > -near_ns ? add_pair(e, t_ns, edge) : ST_OK;
        if (st)
            return st;
    }
    struct clock_fit better;
    if (e->pair_count * 2 > e->count &&
        !clock_fit_make(e->from_ns, e->to_ns, e->pair_count, &better))
        *fit = better;
    return ST_OK;
}

static int by_revolution(const void *a, const void *b) {
    const struct sweep_index *x = a, *y = b;
    return (x->revolution > y->revolution) - (x->revolution < y->revolution);
}

static enum st to_sweep(const struct events *e, const struct clock_fit *fit,
                        struct sweep_index **out_index, size_t *out_count) {
    struct sweep_index *index = malloc((e->count + 1) * sizeof *index);
    if (!index)
        return ST_NOMEM;
    for (size_t i = 0; i < e->count; i++) {
        const struct idxevent *event = &e->events[i];
        bool taken_up = (event->flags & IDXEVENT_PAN_TAKEN_UP) != 0;
        bool positive = (event->flags & IDXEVENT_PAN_POSITIVE) != 0;
        double part = event->pan_phase / 65536.0;
        index[i] =
            (struct sweep_index){.t_host_ns = clock_fit_apply(fit, event_ns(event)),
                                 .revolution = event->revolution,
                                 .pan_steps = (double)event->pan_steps + (positive ? part : -part),
                                 .tilt_steps = (double)event->tilt_steps,
                                 .pan_direction = (int8_t)(!taken_up  ? 0
                                                           : positive ? 1
                                                                      : -1),
                                 .sweep = (event->flags & IDXEVENT_SWEEP) != 0};
    }
    qsort(index, e->count, sizeof *index, by_revolution);
    size_t n = 0;
    for (size_t i = 0; i < e->count; i++) /* a repeated event says nothing new */
        if (!n || index[i].revolution != index[n - 1].revolution)
            index[n++] = index[i];
    *out_index = index;
    *out_count = n;
    return ST_OK;
}

/* ---- by the clocks ---- */

static uint16_t flags_of(uint16_t wire) {
    static const struct {
        unsigned wire, flag;
    } same[] = {{IDXEVENT_PAN_MOVING, INDEX_EVENT_PAN_MOVING},
                {IDXEVENT_TILT_MOVING, INDEX_EVENT_TILT_MOVING},
                {IDXEVENT_PAN_POSITIVE, INDEX_EVENT_PAN_POSITIVE},
                {IDXEVENT_PAN_TAKEN_UP, INDEX_EVENT_PAN_TAKEN_UP},
                {IDXEVENT_SWEEP, INDEX_EVENT_SWEEP}};
    unsigned flags = 0;
    for (size_t i = 0; i < sizeof same / sizeof same[0]; i++)
        flags |= wire & same[i].wire ? same[i].flag : 0u;
    return (uint16_t)flags;
}

static struct index_event index_event_of(const struct idxevent *e) {
    double part = e->pan_phase / 65536.0;
    return (struct index_event){.seq = e->seq,
                                .t_ns = event_ns(e),
                                .revolution = e->revolution,
                                .pan_steps = (double)e->pan_steps +
                                             (e->flags & IDXEVENT_PAN_POSITIVE ? part : -part),
                                .tilt_steps = e->tilt_steps,
                                .kind = e->flags & IDXEVENT_KIND,
                                .flags = flags_of(e->flags)};
}

/* Events between the first and the last of a chunk came about as late as the first. */
static enum st solve_events(struct clock_solve *solve, const struct stream_chunk *chunk) {
    size_t n = chunk->size_bytes / EVENT_BYTES;
    int64_t first_ns = 0;
    enum st st = ST_OK;
    for (size_t i = 0; !st && i < n; i++) {
        struct idxevent event = event_at((const uint8_t *)chunk->payload + i * EVENT_BYTES);
        struct index_event e = index_event_of(&event);
        first_ns = i ? first_ns : e.t_ns;
        int64_t t_ns = chunk->t_first_ns + (e.t_ns - first_ns);
        t_ns = i + 1 == n || t_ns > chunk->t_last_ns ? chunk->t_last_ns : t_ns;
        st = clock_solve_event(solve, &e, t_ns < chunk->t_first_ns ? chunk->t_first_ns : t_ns);
    }
    return st;
}

static enum st solve_edges(struct clock_solve *solve, const struct stream_chunk *chunk) {
    enum st st = ST_OK;
    for (size_t at = 0; !st && at + EDGE_RECORD_BYTES <= chunk->size_bytes;
         at += EDGE_RECORD_BYTES) {
        struct edge_record edge = edge_record_decode((const uint8_t *)chunk->payload + at);
        if (edge.line == EDGE_RECORD_INDEX && edge.rising)
            st = clock_solve_edge(solve, edge.t_ns);
    }
    return st;
}

/* Head time of the last packet of a chunk. */
static int64_t last_head_ns(const struct stream_chunk *chunk, size_t at) {
    struct head_stream_stats stats = {0};
    struct head_packet packet;
    int64_t t_ns = 0;
    while (!head_stream_next(chunk->payload, chunk->size_bytes, &at, &packet, &stats))
        t_ns = packet.head_t_ns + (int64_t)packet.sample_count * packet.interval_ns;
    return t_ns;
}

/* The host's time of each packet: from the chunk's first and the head's own clock; from its last
 * after a reset. */
static enum st solve_packets(struct clock_solve *solve, const struct stream_chunk *chunk) {
    struct head_stream_stats stats = {0};
    struct head_packet packet;
    int64_t ahead_ns = 0;
    size_t at = 0;
    bool first = true;
    enum st st = ST_OK;
    while (!st && !head_stream_next(chunk->payload, chunk->size_bytes, &at, &packet, &stats)) {
        if (first)
            ahead_ns = chunk->t_first_ns - packet.head_t_ns;
        else if (packet.flags & HEAD_PACKET_RESET)
            ahead_ns = chunk->t_last_ns - last_head_ns(chunk, at);
        first = false;
        st = clock_solve_packet(solve, &packet, packet.head_t_ns + ahead_ns);
    }
    return st;
}

/* All chunks of a kind of stream; none is no failure. */
static enum st
solve_stream(struct site *site, int64_t station_id, const char *kind, const char *name,
             enum st (*take)(struct clock_solve *solve, const struct stream_chunk *chunk),
             struct clock_solve *solve, struct errctx *err) {
    struct stream stream;
    struct stream_reader *reader = NULL;
    enum st st = stream_find(site, station_id, kind, name, &stream, err);
    if (!st)
        st = stream_reader_open(site, stream.id, 0, &reader, err);
    while (!st) {
        struct stream_chunk chunk;
        st = stream_reader_next(reader, &chunk, err);
        if (st == ST_DAMAGED) { /* the others are as good as ever */
            st = ST_OK;
            continue;
        }
        if (!st && (st = take(solve, &chunk)))
            (void)errctx_set(err, st, "no memory for the clocks of the station");
    }
    stream_reader_close(reader);
    return st == ST_NOT_FOUND ? ST_OK : st;
}

static enum st by_clocks(struct site *site, int64_t station_id, const char *name,
                         struct clock_solution *out, struct errctx *err) {
    struct clock_solve *solve = calloc(1, sizeof *solve);
    struct cart_clock_params params = cart_clock_params_default();
    if (!solve)
        return errctx_set(err, ST_NOMEM, "no memory for the clocks of the station");
    enum st st = solve_stream(site, station_id, "index", name, solve_events, solve, err);
    if (!st)
        st = solve_stream(site, station_id, "gpio", name, solve_edges, solve, err);
    if (!st)
        st = solve_stream(site, station_id, "head", name, solve_packets, solve, err);
    if (!st && (st = clock_solve_make(solve, &params, out)))
        (void)errctx_set(err, st, "no memory for the clocks of the station");
    clock_solve_fini(solve);
    free(solve);
    return st;
}

/* ---- by arrival alone ---- */

static enum st by_arrival(struct site *site, int64_t station_id, const char *name, struct events *e,
                          struct sweep_index **out_index, size_t *out_count, struct errctx *err) {
    int64_t *edges = NULL;
    size_t edge_count = 0;
    struct clock_fit fit;
    enum st st = clock_fit_make(e->from_ns, e->to_ns, e->pair_count, &fit);
    if (st)
        return errctx_set(err, st, "the controller's clock does not fit the host's");
    st = read_edges(site, station_id, name, &edges, &edge_count, err);
    if (!st)
        st = refine(e, edges, edge_count, &fit);
    if (!st && (st = to_sweep(e, &fit, out_index, out_count)))
        (void)errctx_set(err, st, "no memory for %zu index events", e->count);
    free(edges);
    return st;
}

enum st fuse_index_read(struct site *site, int64_t station_id, const char *name,
                        struct sweep_index **out_index, size_t *out_count,
                        struct job_hash *out_input, struct cart_clock_report *out_report,
                        struct errctx *err) {
    struct stream stream;
    struct stream_state state;
    struct events e = {0};
    struct clock_solution solution = {0};
    enum st st = stream_find(site, station_id, "index", name, &stream, err);
    if (!st)
        st = stream_get_state(site, stream.id, &state, err);
    if (!st)
        st = read_events(site, &stream, &e, err);
    if (!st && e.count < 2)
        st = errctx_set(err, ST_NOT_FOUND,
                        "the station has %zu index pulses: no sample can be placed", e.count);
    if (!st)
        st = by_clocks(site, station_id, name, &solution, err);
    if (!st && !solution.count)
        st = by_arrival(site, station_id, name, &e, &solution.index, &solution.count, err);
    if (!st) {
        *out_index = solution.index;
        *out_count = solution.count;
        *out_report = solution.report;
        solution.index = NULL;
        memset(out_input, 0, sizeof *out_input);
        (void)snprintf(out_input->role, sizeof out_input->role, "index");
        memcpy(out_input->sha256, state.chain, sizeof out_input->sha256);
    }
    clock_solution_fini(&solution);
    events_fini(&e);
    return st;
}
