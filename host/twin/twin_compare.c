#include "twin/twin_compare.h"

#include "base/edge_record.h"
#include "base/fileio.h"
#include "base/sweep.h"
#include "firmware/shared/idxevent.h"
#include "site/stream.h"
#include "twin/twin_truth.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_INDEX = 1 << 20, MAX_ERRORS = 1 << 21 };
static const size_t max_truth_bytes = (size_t)8 << 30;

struct work {
    struct site *site;
    int64_t station_id;
    struct sweep_index *index;
    size_t index_count;
    uint8_t *truth; /* records of TWIN_TRUTH_SAMPLE_BYTES */
    size_t truth_count, truth_at;
    float *errors; /* a sample of them, for quantiles */
    size_t error_count;
    double sum, sum2, radial, radial2;
};

/* ---- index events with host times ---- */

static enum st each_chunk(struct work *w, const char *kind,
                          enum st (*take)(struct work *w, const struct stream_chunk *chunk,
                                          void *ctx, struct errctx *err),
                          void *ctx, struct errctx *err) {
    struct stream stream;
    struct stream_reader *reader = NULL;
    enum st st = stream_find(w->site, w->station_id, kind, NULL, &stream, err);
    if (!st)
        st = stream_reader_open(w->site, stream.id, 0, &reader, err);
    while (!st) {
        struct stream_chunk chunk;
        struct errctx end = {0};
        st = stream_reader_next(reader, &chunk, &end);
        if (st == ST_NOT_FOUND)
            break;
        if (st)
            *err = end;
        else
            st = take(w, &chunk, ctx, err);
    }
    stream_reader_close(reader);
    return st == ST_NOT_FOUND && reader ? ST_OK : st;
}

static enum st take_events(struct work *w, const struct stream_chunk *chunk, void *ctx,
                           struct errctx *err) {
    (void)ctx;
    const uint8_t *b = chunk->payload;
    for (size_t at = 0; at + 2 * IDXEVENT_WORDS <= chunk->size_bytes; at += 2 * IDXEVENT_WORDS) {
        uint16_t words[IDXEVENT_WORDS];
        for (size_t i = 0; i < IDXEVENT_WORDS; i++)
            words[i] = (uint16_t)(b[at + 2 * i] << 8 | b[at + 2 * i + 1]);
        struct idxevent e = idxevent_decode(words);
        if ((e.flags & IDXEVENT_KIND) != IDXEVENT_INDEX)
            continue;
        if (w->index_count >= MAX_INDEX)
            return errctx_set(err, ST_FORMAT, "more than %d index events", MAX_INDEX);
        struct sweep_index one = {.revolution = e.revolution,
                                  .pan_steps = e.pan_steps + e.pan_phase / 65536.0,
                                  .tilt_steps = e.tilt_steps,
                                  .pan_direction = e.flags & IDXEVENT_PAN_POSITIVE ? 1 : -1,
                                  .sweep = (e.flags & IDXEVENT_SWEEP) != 0};
        w->index[w->index_count++] = one;
    }
    return ST_OK;
}

static enum st take_edges(struct work *w, const struct stream_chunk *chunk, void *ctx,
                          struct errctx *err) {
    (void)err;
    size_t *next = ctx;
    const uint8_t *b = chunk->payload;
    for (size_t at = 0; at + EDGE_RECORD_BYTES <= chunk->size_bytes; at += EDGE_RECORD_BYTES) {
        struct edge_record e = edge_record_decode(b + at);
        if (e.line == EDGE_RECORD_INDEX && *next < w->index_count)
            w->index[(*next)++].t_host_ns = e.t_ns;
    }
    return ST_OK;
}

static enum st read_index(struct work *w, struct errctx *err) {
    w->index = malloc(MAX_INDEX * sizeof *w->index);
    if (!w->index)
        return errctx_set(err, ST_NOMEM, "comparison: out of memory");
    size_t edges = 0;
    enum st st = each_chunk(w, "index", take_events, NULL, err);
    if (!st)
        st = each_chunk(w, "gpio", take_edges, &edges, err);
    if (!st && edges != w->index_count)
        st = errctx_set(err, ST_FORMAT, "%zu index events but %zu edges seen by the host",
                        w->index_count, edges);
    return st;
}

/* ---- samples ---- */

struct samples {
    const struct rig *rig;
    const struct pose *pose;
    struct sweep sweep;
    struct twin_compare *out;
};

/* The truth of a sequence number; they come in order, with gaps. NULL: none. */
static const uint8_t *truth_of(struct work *w, uint32_t seq) {
    while (w->truth_at < w->truth_count) {
        const uint8_t *b = w->truth + w->truth_at * TWIN_TRUTH_SAMPLE_BYTES;
        uint32_t is = twin_truth_decode(b).seq;
        if (is == seq)
            return b;
        if (is > seq)
            return NULL;
        w->truth_at++;
    }
    return NULL;
}

static void compare(struct work *w, struct samples *s, const struct sweep_place *place,
                    const struct head_sample *sample, uint32_t seq) {
    s->out->samples++;
    const uint8_t *record = truth_of(w, seq);
    if (!record || place->verdict != SWEEP_GOOD || sample->range == HEAD_RANGE_NONE)
        return;
    s->out->placed++;
    struct twin_truth_sample truth = twin_truth_decode(record);
    if (truth.mixed) {
        s->out->mixed++;
        return;
    }
    struct vec3 p = pose_apply(s->pose, sweep_point(s->rig, place, sample));
    struct vec3 q =
        vec3_make((double)truth.point_m[0], (double)truth.point_m[1], (double)truth.point_m[2]);
    struct vec3 d = vec3_sub(p, q);
    double error = vec3_norm(d);
    if (!(error < 1)) {
        s->out->outliers++;
        return;
    }
    double along = vec3_dot(d, vec3_unit(vec3_sub(q, s->pose->t_m)));
    w->sum += error;
    w->sum2 += error * error;
    w->radial += along;
    w->radial2 += along * along;
    s->out->compared++;
    size_t slot = (size_t)(s->out->compared - 1) % MAX_ERRORS; /* the newest two million */
    w->errors[slot] = (float)error;
    w->error_count = w->error_count < MAX_ERRORS ? slot + 1 : MAX_ERRORS;
}

static enum st take_packets(struct work *w, const struct stream_chunk *chunk, void *ctx,
                            struct errctx *err) {
    (void)err;
    struct samples *s = ctx;
    struct head_stream_stats stats = {0};
    struct head_packet packet;
    struct sweep_place place[HEAD_PACKET_MAX_SAMPLES];
    size_t offset = 0;
    double span = (double)(chunk->t_last_ns - chunk->t_first_ns);
    while (head_stream_next(chunk->payload, chunk->size_bytes, &offset, &packet, &stats) == ST_OK) {
        /* Packets come evenly: good to a few ms, and half a turn is enough. */
        int64_t t_ns =
            chunk->t_first_ns + (int64_t)(span * (double)offset / (double)chunk->size_bytes);
        sweep_packet(&s->sweep, &packet, t_ns, place);
        for (unsigned i = 0; i < packet.sample_count; i++)
            compare(w, s, &place[i], &packet.samples[i], packet.first_sample_seq + i);
    }
    return ST_OK;
}

static int by_value(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static void finish(struct work *w, struct twin_compare *out) {
    double n = (double)out->compared;
    if (!out->compared)
        return;
    out->mean_m = w->sum / n;
    out->rms_m = sqrt(w->sum2 / n);
    out->radial_mean_m = w->radial / n;
    out->radial_sigma_m = sqrt(fmax(0, w->radial2 / n - out->radial_mean_m * out->radial_mean_m));
    qsort(w->errors, w->error_count, sizeof *w->errors, by_value);
    out->median_m = (double)w->errors[w->error_count / 2];
    out->p95_m = (double)w->errors[(size_t)((double)w->error_count * 0.95)];
}

enum st twin_compare_station(struct site *site, int64_t station_id, const char *samples_path,
                             const struct rig *rig, const struct pose *world_from_station,
                             struct twin_compare *out_result, struct errctx *err) {
    struct work w;
    memset(&w, 0, sizeof w);
    w.site = site;
    w.station_id = station_id;
    struct twin_compare result;
    memset(&result, 0, sizeof result);
    struct samples samples = {.rig = rig, .pose = world_from_station, .out = &result};
    size_t size = 0;
    w.errors = malloc(MAX_ERRORS * sizeof *w.errors);
    enum st st = w.errors ? fileio_read(samples_path, max_truth_bytes, &w.truth, &size, err)
                          : errctx_set(err, ST_NOMEM, "comparison: out of memory");
    w.truth_count = size / TWIN_TRUTH_SAMPLE_BYTES;
    if (!st)
        st = read_index(&w, err);
    if (!st) {
        sweep_init(&samples.sweep, w.index, w.index_count);
        st = each_chunk(&w, "head", take_packets, &samples, err);
    }
    if (!st) {
        finish(&w, &result);
        *out_result = result;
    }
    free(w.index);
    free(w.truth);
    free(w.errors);
    return st;
}
