#include "capture/resume.h"

#include "capture/event_wire.h"
#include "capture/scan_plan_json.h"
#include "site/frame_row.h"
#include "site/stream.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const double overlap_turns = 2;    /* the rest begins that much before the first gap */
static const double end_turns = 1.75;     /* what may be missing at either end, see below */
static const uint32_t missed_pulses = 12; /* between two events that belong together, */
static const double even = 0.2;           /* where the pan went on as before, within this part */
static const int64_t late_ns = 5000000;   /* an event may be that much behind the last packet */

bool resume_add_span(struct resume_span *spans, size_t *count, size_t capacity,
                     struct resume_span span, double near) {
    size_t at = 0, end;
    while (at < *count && spans[at].to_steps + near < span.from_steps)
        at++;
    for (end = at; end < *count && spans[end].from_steps <= span.to_steps + near; end++) {
        span.from_steps = fmin(span.from_steps, spans[end].from_steps);
        span.to_steps = fmax(span.to_steps, spans[end].to_steps);
    }
    if (at == end && *count == capacity)
        return false;
    memmove(&spans[at + 1], &spans[end], (*count - end) * sizeof *spans);
    spans[at] = span;
    *count = *count - (end - at) + 1;
    return true;
}

void resume_next_device(const struct resume *resume, char out_name[SITE_NAME_MAX]) {
    if (resume->sessions)
        (void)snprintf(out_name, SITE_NAME_MAX, "%.50s.%u", resume->device, resume->sessions + 1);
}

/* Do two events that many turns apart bound a part of the sweep? */
static bool together(const struct resume_span *span, uint64_t turns, double steps_a_turn) {
    double way = span->to_steps - span->from_steps, usual = (double)turns * steps_a_turn;
    if (turns > missed_pulses + 1 || way < 0)
        return false;
    return turns < 3 ? way <= 4 * steps_a_turn : fabs(way - usual) <= even * usual;
}

/* Has the pan come to rest where the sweep was to end, while the head was still measuring? */
static bool is_end(const struct index_event *e, const struct scan_plan *plan) {
    const double rounding_steps = 1;
    return !(e->flags & INDEX_EVENT_SWEEP) && e->flags & INDEX_EVENT_LASER &&
           e->pan_steps >= plan->pan_to_steps - rounding_steps;
}

/* Spans between the events of one session, none later than the head's last packet. */
static enum st cover(struct site *site, const struct stream *index, int64_t head_end_ns,
                     struct resume *r, struct errctx *err) {
    struct stream_reader *reader = NULL;
    struct stream_chunk chunk;
    struct index_event before = {0};
    const unsigned swept = INDEX_EVENT_SWEEP | INDEX_EVENT_LASER;
    enum st st = stream_reader_open(site, index->id, 0, &reader, err);
    while (!st) {
        st = stream_reader_next(reader, &chunk, err);
        size_t count = st ? 0 : chunk.size_bytes / EVENT_WIRE_BYTES;
        const uint8_t *bytes = st ? NULL : chunk.payload;
        int64_t last_ns =
            count ? event_wire_decode(bytes + (count - 1) * EVENT_WIRE_BYTES).t_ns : 0;
        for (size_t i = 0; i < count && !st; i++) {
            struct index_event e = event_wire_decode(bytes + i * EVENT_WIRE_BYTES);
            int64_t t_ns = chunk.t_last_ns - (last_ns - e.t_ns);
            if (e.kind != INDEX_EVENT_INDEX || t_ns > head_end_ns + late_ns)
                continue;
            if ((e.flags & swept) != swept) {
                r->end_seen = r->end_seen || (before.flags && is_end(&e, &r->plan));
                continue;
            }
            struct resume_span span = {before.pan_steps, e.pan_steps};
            uint64_t turns = e.revolution - before.revolution;
            if (before.flags && together(&span, turns, r->plan.steps_per_revolution) &&
                !resume_add_span(r->span, &r->spans, RESUME_MAX_SPANS, span, 1e-6))
                st = errctx_set(err, ST_FULL, "the sweep is in more than %d pieces",
                                RESUME_MAX_SPANS);
            before = e;
        }
    }
    stream_reader_close(reader);
    return st == ST_NOT_FOUND ? ST_OK : st;
}

/* What is visited of a site. */
struct visit {
    struct site *site;
    struct resume *resume;
};

/* One head stream and the index stream of the same name. */
static enum st take_session(struct site *site, const struct stream *head, struct resume *r,
                            struct errctx *err) {
    struct stream_state state;
    struct stream index;
    enum st st = stream_get_state(site, head->id, &state, err);
    if (st)
        return st;
    r->sessions++;
    r->last_stream_id = head->id;
    if (r->sessions == 1) {
        (void)snprintf(r->device, sizeof r->device, "%s", head->name);
        st = scan_plan_json_read(head->meta, &r->plan, err);
    }
    if (st || !state.chunk_count)
        return st;
    st = stream_find(site, head->station_id, "index", head->name, &index, err);
    if (st == ST_NOT_FOUND)
        return ST_OK;
    return st ? st : cover(site, &index, state.t_last_ns, r, err);
}

static enum st visit_stream(void *ctx, const struct stream *stream, struct errctx *err) {
    struct visit *v = ctx;
    return strcmp(stream->kind, "head") != 0 ? ST_OK
                                             : take_session(v->site, stream, v->resume, err);
}

/* ---- photographs ---- */

static void take_photo(const struct frame_row *row, struct resume *r) {
    const double near_rad = 0.01;
    const double turn_rad = 2 * 3.14159265358979323846;
    const struct scan_plan *plan = &r->plan;
    for (uint32_t p = 0; p < plan->pass_count; p++)
        for (uint32_t i = 0; i < plan->pass[p].count; i++) {
            double pan = plan->pass[p].pan_steps[i] * turn_rad / plan->pan_steps_per_turn;
            double tilt = plan->pass[p].tilt_steps * turn_rad / plan->tilt_steps_per_turn;
            if (fabs(row->pan_rad - pan) > near_rad || fabs(row->tilt_rad - tilt) > near_rad ||
                r->photo[p][i])
                continue;
            r->photo[p][i] = true;
            r->photos++;
        }
}

static enum st visit_frame(void *ctx, const struct frame_row *row, struct errctx *err) {
    struct visit *v = ctx;
    (void)err;
    take_photo(row, v->resume);
    return ST_OK;
}

/* ---- what is left ---- */

/* A sweep's first event comes up to a turn behind its start, and its last one up to a turn before
 * its end: that much is never covered, also in a scan that nothing disturbed. Where a session died
 * so near to the end that this may be why, only an event behind the end tells that it was there. */
static void find_rest(struct resume *r) {
    const struct scan_plan *plan = &r->plan;
    double turn = plan->steps_per_revolution, from = plan->pan_from_steps, to = plan->pan_to_steps;
    double first = from, last = to, covered = 0;
    double at = from + end_turns * turn; /* what comes before needs no cover */
    bool begun = false;
    double near_end = r->end_seen ? to - end_turns * turn : to;
    for (size_t i = 0; i < r->spans; i++) {
        const struct resume_span *s = &r->span[i];
        covered += fmax(0, fmin(s->to_steps, to) - fmax(s->from_steps, from));
        if (!begun && s->from_steps <= at && s->to_steps >= at)
            at = first = s->to_steps;
        else if (s->from_steps > at)
            begun = true;
    }
    if (r->spans && r->span[r->spans - 1].to_steps >= near_end &&
        r->span[r->spans - 1].from_steps > first)
        last = r->span[r->spans - 1].from_steps + overlap_turns * turn;
    r->rest = *plan;
    if (first >= near_end || to <= from) {
        r->rest.pan_from_steps = r->rest.pan_to_steps = plan->pan_to_steps;
    } else {
        double start = first > from ? floor(first - overlap_turns * turn) : from;
        r->rest.pan_from_steps = (int32_t)fmax(start, from);
        r->rest.pan_to_steps = (int32_t)fmin(ceil(last), to);
    }
    bool swept = r->rest.pan_from_steps == r->rest.pan_to_steps;
    r->covered = swept ? 1 : fmin(1, covered / (to - from));
    uint32_t left = 0;
    for (uint32_t p = 0; p < plan->pass_count; p++) {
        struct scan_plan_pass *pass = &r->rest.pass[p];
        pass->count = 0;
        for (uint32_t i = 0; i < plan->pass[p].count; i++)
            if (!r->photo[p][i])
                pass->pan_steps[pass->count++] = plan->pass[p].pan_steps[i];
        left += pass->count;
    }
    r->complete = !left && swept;
}

enum st resume_find(struct site *site, int64_t station_id, struct resume *out_resume,
                    struct errctx *err) {
    struct resume *r = out_resume;
    memset(r, 0, sizeof *r);
    struct visit visit = {site, r};
    enum st st = stream_each(site, station_id, visit_stream, &visit, err);
    if (!st && !r->sessions)
        return errctx_set(err, ST_NOT_FOUND, "nothing has been scanned from this station");
    if (!st)
        st = frame_row_each(site, station_id, visit_frame, &visit, err);
    if (!st)
        find_rest(r);
    return st;
}
