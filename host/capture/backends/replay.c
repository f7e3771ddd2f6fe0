#include "capture/backends/replay.h"

#include "base/clock.h"
#include "site/station.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LEAD_NS = 500000000 }; /* the time begins that much before the first record */

/* --- the time --------------------------------------------------------------------------------- */

int64_t replay_now_ns(const struct replay *replay) {
    return replay->real_time ? clock_now_ns() + atomic_load(&replay->offset_ns)
                             : atomic_load(&replay->now_ns);
}

void replay_skip_to(struct replay *replay, int64_t t_ns) {
    if (replay->real_time) {
        int64_t offset_ns = t_ns - clock_now_ns();
        if (offset_ns > atomic_load(&replay->offset_ns))
            atomic_store(&replay->offset_ns, offset_ns);
    } else if (t_ns > atomic_load(&replay->now_ns)) {
        atomic_store(&replay->now_ns, t_ns);
    }
}

void replay_wait_until(struct replay *replay, int64_t t_ns) {
    if (replay->real_time)
        (void)hosttime_wait_until(&hosttime_real, t_ns - atomic_load(&replay->offset_ns), NULL);
    else
        replay_skip_to(replay, t_ns);
}

static int64_t time_now(void *ctx) {
    return replay_now_ns(ctx);
}

static enum st time_wait(void *ctx, int64_t t_ns, struct errctx *err) {
    (void)err;
    replay_wait_until(ctx, t_ns);
    return ST_OK;
}

/* --- the recording ---------------------------------------------------------------------------- */

static enum st find_station(struct site *site, const char *name, struct station *out_station,
                            struct errctx *err) {
    if (name)
        return station_find(site, name, out_station, err);
    size_t count = 0;
    enum st st = station_list(site, 0, out_station, 1, &count, err);
    return st || count
               ? st
               : errctx_set(err, ST_NOT_FOUND, "%s has no station to play back", site_path(site));
}

static void widen(struct replay *r, int64_t first_ns, int64_t last_ns) {
    r->first_ns = first_ns < r->first_ns ? first_ns : r->first_ns;
    r->last_ns = last_ns > r->last_ns ? last_ns : r->last_ns;
}

/* From when to when there is something. */
static enum st measure(struct replay *r, struct site *site, struct errctx *err) {
    static const char *const kinds[] = {"head", "index", "gpio"};
    r->first_ns = INT64_MAX;
    r->last_ns = INT64_MIN;
    for (int i = 0; i < 3; i++) {
        struct stream stream;
        struct stream_state state;
        enum st st = stream_find(site, r->station_id, kinds[i], NULL, &stream, err);
        if (st == ST_NOT_FOUND && i)
            continue;
        if (!st)
            st = stream_get_state(site, stream.id, &state, err);
        if (st)
            return st;
        if (!state.chunk_count)
            continue;
        widen(r, state.t_first_ns, state.t_last_ns);
        if (!i) {
            r->head_first_ns = state.t_first_ns;
            r->head_last_ns = state.t_last_ns;
        }
    }
    return r->head_last_ns ? ST_OK
                           : errctx_set(err, ST_NOT_FOUND, "the station has no sample of a head");
}

enum st replay_open(const char *site_path, const char *station, bool real_time,
                    struct replay **out_replay, struct errctx *err) {
    struct replay *r = calloc(1, sizeof *r);
    struct site *site = NULL;
    struct station found;
    if (!r)
        return errctx_set(err, ST_NOMEM, "no memory for a recording");
    enum st st = strlen(site_path) < sizeof r->site_path
                     ? site_open(site_path, SITE_READ, &site, err)
                     : errctx_set(err, ST_INVALID, "the path of the recording is too long");
    if (!st)
        st = find_station(site, station, &found, err);
    if (!st) {
        memcpy(r->site_path, site_path, strlen(site_path) + 1);
        r->station_id = found.id;
        r->real_time = real_time;
        st = measure(r, site, err);
    }
    (void)site_close(site, NULL);
    if (st) {
        free(r);
        return errctx_prefix(err, st, "recording");
    }
    r->hosttime = (struct hosttime){
        .ctx = r, .now_ns = time_now, .wait_until = time_wait, .is_virtual = !real_time};
    atomic_init(&r->now_ns, r->first_ns - LEAD_NS);
    atomic_init(&r->offset_ns, r->first_ns - LEAD_NS - clock_now_ns());
    *out_replay = r;
    return ST_OK;
}

void replay_close(struct replay *replay) {
    free(replay);
}

/* --- one stream ------------------------------------------------------------------------------- */

enum st replay_reader_open(struct replay_reader *reader, const struct replay *replay,
                           const char *kind, const char *format, struct errctx *err) {
    struct stream stream;
    memset(reader, 0, sizeof *reader);
    enum st st = site_open(replay->site_path, SITE_READ, &reader->site, err);
    if (!st)
        st = stream_find(reader->site, replay->station_id, kind, NULL, &stream, err);
    if (!st && strcmp(stream.format, format))
        st = errctx_set(err, ST_UNSUPPORTED, "stream '%s' has the format %s, not %s", kind,
                        stream.format, format);
    if (!st)
        st = stream_reader_open(reader->site, stream.id, 0, &reader->reader, err);
    if (st)
        replay_reader_close(reader);
    return st ? errctx_prefix(err, st, "recording") : ST_OK;
}

void replay_reader_close(struct replay_reader *reader) {
    stream_reader_close(reader->reader);
    (void)site_close(reader->site, NULL);
    memset(reader, 0, sizeof *reader);
}

enum st replay_reader_peek(struct replay_reader *reader, size_t max_bytes,
                           const uint8_t **out_bytes, size_t *out_size, int64_t *out_t_ns,
                           struct errctx *err) {
    if (reader->ended)
        return ST_NOT_FOUND;
    if (!reader->any || reader->at == reader->chunk.size_bytes) {
        enum st st = stream_reader_next(reader->reader, &reader->chunk, err);
        reader->ended = st == ST_NOT_FOUND;
        if (st)
            return st;
        reader->any = true;
        reader->at = 0;
    }
    const struct stream_chunk *c = &reader->chunk;
    size_t rest = c->size_bytes - reader->at, size = rest < max_bytes ? rest : max_bytes;
    /* all of a piece has come when its last byte has */
    double part = (double)(reader->at + size) / (double)c->size_bytes;
    *out_bytes = (const uint8_t *)c->payload + reader->at;
    *out_size = size;
    *out_t_ns = c->t_first_ns + (int64_t)(part * (double)(c->t_last_ns - c->t_first_ns));
    return ST_OK;
}

void replay_reader_take(struct replay_reader *reader, size_t size) {
    reader->at += size;
}
