#include "app/fuse_source.h"

#include "app/fuse_index.h"
#include "base/rig_yaml.h"
#include "site/polar_chunk.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { POLAR_BATCH = 8192, READY = RAYS_BATCH_PACKETS * HEAD_PACKET_MAX_SAMPLES };

static const double noise_floor_m = 1e-4, noise_unknown_m = 0.005;

const char *fuse_source_status_name(enum calib_status status) {
    return status == CALIB_ESTIMATED ? "estimated" : status == CALIB_TRUE ? "true" : "nominal";
}

enum st fuse_source_calibration(struct site *site, const char *kind, enum calib_status wanted,
                                struct calib *out_record, char *out_text, struct errctx *err) {
    static const enum calib_status order[] = {CALIB_ESTIMATED, CALIB_TRUE, CALIB_NOMINAL};
    enum st st = ST_NOT_FOUND;
    for (size_t i = 0; st == ST_NOT_FOUND && i < sizeof order / sizeof order[0]; i++)
        if (!wanted || order[i] == wanted)
            st = calib_find(site, kind, NULL, order[i], out_record, err);
    if (st == ST_NOT_FOUND)
        return errctx_set(err, st, "the site has no %s%scalibration of the %s",
                          wanted ? fuse_source_status_name(wanted) : "", wanted ? " " : "", kind);
    if (!st)
        st = calib_read(site, out_record->id, out_record, out_text, CALIB_MAX_BYTES + 1, err);
    return st;
}

static void add_input(struct fuse_source *s, const char *role, const uint8_t *sha256) {
    struct job_hash *input = s->inputs + s->input_count++;
    memset(input, 0, sizeof *input);
    (void)snprintf(input->role, sizeof input->role, "%s", role);
    memcpy(input->sha256, sha256, sizeof input->sha256);
}

/* ---- chunks to samples ---- */

/* Begins to read a session of the cart; polar samples have but one stream. */
static enum st begin_session(struct fuse_source *s, size_t number, struct errctx *err) {
    s->session_at = number;
    if (s->rays)
        sweep_init(&s->rays->sweep, s->session[number].index, s->session[number].index_count);
    stream_reader_close(s->reader);
    s->reader = NULL;
    return stream_reader_open(s->site, s->rays ? s->session[number].stream_id : s->stream.id, 0,
                              &s->reader, err);
}

static enum st next_chunk(struct fuse_source *s, struct errctx *err) {
    for (;;) {
        enum st st = stream_reader_next(s->reader, &s->chunk, err);
        if (st == ST_NOT_FOUND && s->rays && s->session_at + 1 < s->sessions) {
            st = begin_session(s, s->session_at + 1, err);
            if (!st)
                continue;
        }
        if (st == ST_DAMAGED) { /* the rest is as good as ever */
            s->damaged_packets++;
            continue;
        }
        s->chunk_at = 0;
        s->chunk_started = false;
        if (st) /* the end stays the end */
            memset(&s->chunk, 0, sizeof s->chunk);
        return st;
    }
}

/* Along the instrument's lines: samples follow each other in its grid. */
static void meter_polar(struct fuse_source *s, const struct polar_sample *samples, size_t count) {
    for (size_t i = 0; i < count; i++) {
        const struct polar_sample *p = samples + i;
        if (!((p->row == s->row && p->column == s->column + 1) ||
              (p->column == s->column && p->row == s->row + 1)))
            noise_meter_add(s->meter, (double)NAN, (double)NAN);
        noise_meter_add(s->meter, (double)p->range_m,
                        p->flags & SAMPLE_INTENSITY ? (double)p->intensity : (double)NAN);
        s->row = p->row;
        s->column = p->column;
    }
}

static size_t unpack_polar(struct fuse_source *s, struct scatter_sample *out) {
    static const struct scatter_noise none = {0, 0};
    struct polar_sample batch[256];
    size_t left = (s->chunk.size_bytes - s->chunk_at) / sizeof *batch, total = 0;
    while (left && total + 256 <= POLAR_BATCH) {
        size_t n = left < 256 ? left : 256;
        memcpy(batch, (const uint8_t *)s->chunk.payload + s->chunk_at, n * sizeof *batch);
        if (s->meter)
            meter_polar(s, batch, n);
        scatter_from_polar(batch, n, vec3_make(0, 0, 0), &none, out + total);
        for (size_t i = 0; i < n; i++) {
            struct scatter_sample *o = out + total + i;
            double intensity = o->flags & SAMPLE_INTENSITY ? (double)o->intensity : (double)NAN;
            o->sigma_m = (float)noise_sigma(&s->noise, intensity, (double)batch[i].range_m);
        }
        s->chunk_at += n * sizeof *batch;
        total += n;
        left -= n;
    }
    return total;
}

/* Up to a batch of packets; the host's time of each from the chunk's first and the head's own
 * clock. */
static size_t unpack_head(struct fuse_source *s, struct scatter_sample *out) {
    static struct head_packet packets[RAYS_BATCH_PACKETS];
    int64_t t_ns[RAYS_BATCH_PACKETS];
    struct head_stream_stats stats = {0};
    size_t n = 0;
    while (n < RAYS_BATCH_PACKETS && !head_stream_next(s->chunk.payload, s->chunk.size_bytes,
                                                       &s->chunk_at, &packets[n], &stats)) {
        if (!s->chunk_started) {
            s->chunk_head_t_ns = packets[n].head_t_ns;
            s->chunk_started = true;
        }
        t_ns[n] = s->chunk.t_first_ns + (packets[n].head_t_ns - s->chunk_head_t_ns);
        for (unsigned i = 0; s->meter && i < packets[n].sample_count; i++)
            noise_meter_add(s->meter, head_range_m(packets[n].samples[i].range),
                            packets[n].samples[i].intensity / 65535.0);
        n++;
    }
    s->damaged_packets += (int64_t)stats.damaged;
    return n ? rays_packets(s->rays, packets, t_ns, n, out) : 0;
}

static enum st source_rewind(void *context, struct errctx *err) {
    struct fuse_source *s = context;
    s->ready_at = s->ready_count = 0;
    s->damaged_packets = 0;
    memset(&s->chunk, 0, sizeof s->chunk);
    s->chunk_at = 0;
    if (s->rays)
        memset(&s->rays->counts, 0, sizeof s->rays->counts);
    return begin_session(s, 0, err);
}

/* Fills the buffer of unpacked samples; 0 left in it is the end. */
static enum st refill(struct fuse_source *s, struct errctx *err) {
    s->ready_at = s->ready_count = 0;
    while (!s->ready_count) {
        size_t before = s->chunk_at;
        if (s->chunk.payload && s->chunk_at < s->chunk.size_bytes)
            s->ready_count = s->rays ? unpack_head(s, s->ready) : unpack_polar(s, s->ready);
        if (s->ready_count || (s->chunk.payload && s->chunk_at > before))
            continue;
        enum st st = next_chunk(s, err);
        if (st)
            return st == ST_NOT_FOUND ? ST_OK : st;
    }
    return ST_OK;
}

static enum st source_next(void *context, struct scatter_sample *out_samples, size_t capacity,
                           size_t *out_count, struct errctx *err) {
    struct fuse_source *s = context;
    size_t total = 0;
    while (total < capacity) {
        if (s->ready_at == s->ready_count) {
            enum st st = refill(s, err);
            if (st)
                return st;
            if (!s->ready_count)
                break;
        }
        size_t n = s->ready_count - s->ready_at;
        n = n < capacity - total ? n : capacity - total;
        memcpy(out_samples + total, s->ready + s->ready_at, n * sizeof *out_samples);
        s->ready_at += n;
        total += n;
    }
    if (s->rays)
        s->counts = s->rays->counts;
    *out_count = total;
    return ST_OK;
}

/* ---- noise ---- */

/* Sigmas that were made with an assumed model, made with the measured one. What else went into them
 * stays. */
static void renew_sigmas(struct scatter_sample *samples, size_t count,
                         const struct noise_model *assumed, const struct noise_model *measured) {
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < count; i++) {
        struct scatter_sample *s = samples + i;
        if (s->flags & (SAMPLE_NO_RETURN | SAMPLE_DROPPED))
            continue;
        struct vec3 p = {(double)s->p_m[0], (double)s->p_m[1], (double)s->p_m[2]};
        double intensity = s->flags & SAMPLE_INTENSITY ? (double)s->intensity : (double)NAN;
        double range_m = vec3_norm(p), old = (double)s->sigma_m;
        double was = noise_sigma(assumed, intensity, range_m);
        double is = noise_sigma(measured, intensity, range_m);
        s->sigma_m = (float)sqrt(fmax(old * old - was * was, 0.0) + is * is);
    }
}

/* Reads the stream once for its noise alone. */
static enum st measure_noise(struct fuse_source *s, struct errctx *err) {
    enum st st = source_rewind(s, err);
    size_t got = 1;
    struct scatter_sample *ignored = malloc(READY * sizeof *ignored);
    if (!ignored)
        return errctx_set(err, ST_NOMEM, "no memory to measure the noise");
    while (!st && got)
        st = source_next(s, ignored, READY, &got, err);
    free(ignored);
    return st;
}

/* ---- opening ---- */

/* Adds a session with its index pulses. One that died before two of them says nothing. */
static enum st add_session(struct fuse_source *s, const struct stream *head, struct errctx *err) {
    struct job_hash index_input;
    struct stream_state state;
    struct cart_clock_report clock;
    struct fuse_source_session *session = &s->session[s->sessions];
    if (s->sessions == FUSE_SOURCE_SESSIONS)
        return errctx_set(err, ST_NOMEM, "a station of more than %d sessions",
                          FUSE_SOURCE_SESSIONS);
    enum st st = stream_get_state(s->site, head->id, &state, err);
    if (!st)
        st = fuse_index_read(s->site, head->station_id, head->name, &session->index,
                             &session->index_count, &index_input, &clock, err);
    if (st)
        return st;
    session->stream_id = head->id;
    if (!s->sessions++)
        s->clock = clock;
    add_input(s, "stream", state.chain);
    add_input(s, "index", index_input.sha256);
    return ST_OK;
}

/* A session that has nothing to place its samples by is none. */
static enum st visit_stream(void *ctx, const struct stream *stream, struct errctx *err) {
    if (strcmp(stream->kind, "head") != 0)
        return ST_OK;
    const enum st st = add_session(ctx, stream, err);
    return st == ST_NOT_FOUND ? ST_OK : st;
}

static enum st add_sessions(struct fuse_source *s, int64_t station_id, struct errctx *err) {
    const enum st st = stream_each(s->site, station_id, visit_stream, s, err);
    return st || s->sessions ? st : ST_NOT_FOUND; /* the text is the last session's */
}

static enum st open_head(struct fuse_source *s, int64_t station_id,
                         const struct fuse_source_options *o, struct errctx *err) {
    struct stream index_stream;
    if (!stream_find(s->site, station_id, "index", NULL, &index_stream, err) &&
        strcmp(index_stream.format, "idxevent.1") != 0)
        return errctx_set(err, ST_UNSUPPORTED, "index events of format %s are not known here",
                          index_stream.format);
    struct calib record;
    char *text = malloc(CALIB_MAX_BYTES + 1);
    enum st st = text ? ST_OK : errctx_set(err, ST_NOMEM, "no memory for a calibration");
    if (!st)
        st = fuse_source_calibration(s->site, "rig", o->calibration, &record, text, err);
    if (!st)
        st = rig_yaml_read(text, record.size_bytes, record.name, &s->rig, err);
    free(text);
    if (!st)
        st = add_sessions(s, station_id, err);
    if (st)
        return st;
    s->calibration = fuse_source_status_name(record.status);
    add_input(s, "rig", record.sha256);
    s->rays = malloc(sizeof *s->rays);
    if (!s->rays)
        return errctx_set(err, ST_NOMEM, "no memory for the rig model");
    struct rays_params params = rays_params_default();
    return rays_init(s->rays, &s->rig, &params, &s->noise, s->session[0].index,
                     s->session[0].index_count, err);
}

/* Keeps the stream in memory if it fits: photographs then do not read it again. */
static enum st fill_cache(struct fuse_source *s, size_t limit, struct errctx *err) {
    size_t capacity = 0, count = 0, got = 0;
    struct scatter_sample *cache = NULL;
    enum st st = source_rewind(s, err);
    while (!st) {
        if (count + READY > capacity) {
            capacity = capacity ? capacity + capacity / 2 : 16 * (size_t)READY;
            struct scatter_sample *grown =
                count < limit ? realloc(cache, capacity * sizeof *cache) : NULL;
            if (!grown) { /* too long to keep: it streams */
                free(cache);
                return ST_OK;
            }
            cache = grown;
        }
        st = source_next(s, cache + count, READY, &got, err);
        count += got;
        if (!got)
            break;
    }
    if (st) {
        free(cache);
        return st;
    }
    s->cache = cache;
    s->cache_count = count;
    s->source = scatter_source_array(&s->cached, cache, count);
    return ST_OK;
}

/* What the stream says that its ranges are good to. The meter follows one laser; where many took
 * turns it cannot see by how much they disagree, and what it reads is too small. */
static double least_noise_m(const struct fuse_source *s) {
    cJSON *meta = s->stream.meta[0] ? cJSON_Parse(s->stream.meta) : NULL;
    const cJSON *sigma = cJSON_GetObjectItemCaseSensitive(meta, "range_sigma_m");
    const double said_m = cJSON_IsNumber(sigma) ? sigma->valuedouble : 0.0;
    cJSON_Delete(meta);
    return said_m > noise_floor_m && said_m < 1.0 ? said_m : noise_floor_m;
}

/* One pass that fills the cache and measures the noise; another for the noise where the cache is
 * too small. */
static enum st read_once(struct fuse_source *s, const struct fuse_source_options *options,
                         struct errctx *err) {
    struct noise_model assumed = s->noise;
    s->meter = options->sigma_m > 0 ? NULL : malloc(sizeof *s->meter);
    if (!s->meter && !(options->sigma_m > 0))
        return errctx_set(err, ST_NOMEM, "no memory to measure the noise");
    if (s->meter)
        noise_meter_init(s->meter);
    enum st st = fill_cache(s, options->cache_samples, err);
    if (!st && s->meter && !s->cache) {
        noise_meter_init(s->meter);
        st = measure_noise(s, err);
    }
    const double least_m = least_noise_m(s);
    if (!st && s->meter && noise_meter_read(s->meter, least_m, &s->noise)) {
        /* what the report shows is then what the stream says, not what was measured */
        s->noise.measured = !(least_m > noise_floor_m && s->noise.sigma_m[0] <= least_m);
        if (s->cache)
            renew_sigmas(s->cache, s->cache_count, &assumed, &s->noise);
    }
    free(s->meter);
    s->meter = NULL;
    if (s->rays)
        s->rays->noise = s->noise;
    return st;
}

enum st fuse_source_open(struct site *site, int64_t station_id,
                         const struct fuse_source_options *options, struct fuse_source *out_source,
                         struct errctx *err) {
    struct fuse_source *s = out_source;
    struct stream_state state;
    memset(s, 0, sizeof *s);
    s->site = site;
    s->calibration = "none";
    s->noise = noise_model_constant(options->sigma_m > 0 ? options->sigma_m : noise_unknown_m, 0);
    s->source = (struct scatter_source){s, source_rewind, source_next};
    enum st st = stream_find(site, station_id, "head", NULL, &s->stream, err);
    bool head = !st;
    if (st == ST_NOT_FOUND)
        st = stream_find(site, station_id, POLAR_CHUNK_KIND, NULL, &s->stream, err);
    if (st)
        return st;
    const char *format = head ? "head_packet.1" : POLAR_CHUNK_FORMAT;
    if (strcmp(s->stream.format, format) != 0)
        return errctx_set(err, ST_UNSUPPORTED, "samples of format %s are not known here",
                          s->stream.format);
    if (!head)
        s->origin_m = s->stream.origin_m;
    if (!head && !(options->sigma_m > 0)) /* until it is measured */
        s->noise = noise_model_constant(fmax(least_noise_m(s), noise_unknown_m), 0);
    st = stream_get_state(site, s->stream.id, &state, err);
    if (!st && !head)
        add_input(s, "stream", state.chain);
    s->ready = malloc((size_t)(READY > POLAR_BATCH ? READY : POLAR_BATCH) * sizeof *s->ready);
    if (!st && !s->ready)
        st = errctx_set(err, ST_NOMEM, "no memory to read samples");
    if (!st && head)
        st = open_head(s, station_id, options, err);
    if (!st)
        st = read_once(s, options, err);
    if (st)
        fuse_source_close(s);
    return st;
}

void fuse_source_close(struct fuse_source *s) {
    stream_reader_close(s->reader);
    free(s->rays);
    for (size_t i = 0; i < s->sessions; i++)
        free(s->session[i].index);
    free(s->ready);
    free(s->cache);
    memset(s, 0, sizeof *s);
}
