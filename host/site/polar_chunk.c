#include "site/polar_chunk.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CHUNK_SAMPLES = 65536, ZSTD_LEVEL = 3 };

#define SAMPLES_MAX ((int64_t)1 << 27)

_Static_assert(sizeof(struct polar_sample) == 40, "the layout of a polar chunk");
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "polar chunks are little-endian");

enum st polar_chunk_write(struct site *site, int64_t station_id, const char *name,
                          struct vec3 origin_m, const char *meta_json,
                          const struct polar_sample *samples, size_t count, int64_t *out_stream_id,
                          struct errctx *err) {
    if (count == 0)
        return errctx_set(err, ST_INVALID, "stream %s: there are no samples", name);
    struct stream stream = {.station_id = station_id,
                            .kind = POLAR_CHUNK_KIND,
                            .format = POLAR_CHUNK_FORMAT,
                            .origin_m = origin_m,
                            .zstd_level = ZSTD_LEVEL};
    if (!site_name_is_valid(name) || (meta_json && strlen(meta_json) >= sizeof stream.meta))
        return errctx_set(err, ST_INVALID, "stream '%.80s': bad name or too long a remark", name);
    (void)snprintf(stream.name, sizeof stream.name, "%s", name);
    (void)snprintf(stream.meta, sizeof stream.meta, "%s", meta_json ? meta_json : "");
    int64_t id = 0;
    enum st st = stream_add(site, &stream, &id, err);
    for (size_t at = 0; !st && at < count; at += CHUNK_SAMPLES) {
        const size_t n = count - at < CHUNK_SAMPLES ? count - at : CHUNK_SAMPLES;
        const struct stream_chunk chunk = {.first_item = (int64_t)at,
                                           .end_item = (int64_t)(at + n),
                                           .item_count = (int64_t)n,
                                           .payload = samples + at,
                                           .size_bytes = n * sizeof *samples};
        st = stream_append(site, id, &chunk, 1, err);
    }
    if (!st && out_stream_id)
        *out_stream_id = id;
    return st;
}

static enum st read_chunks(struct stream_reader *reader, struct polar_sample *samples,
                           size_t capacity, size_t *out_count, struct errctx *err) {
    size_t count = 0;
    for (;;) {
        struct stream_chunk chunk;
        enum st st = stream_reader_next(reader, &chunk, err);
        if (st == ST_NOT_FOUND)
            break;
        if (st)
            return st;
        const size_t n = chunk.size_bytes / sizeof *samples;
        if (chunk.size_bytes % sizeof *samples || (int64_t)n != chunk.item_count ||
            n > capacity - count)
            return errctx_set(err, ST_FORMAT, "chunk %lld does not hold %lld samples",
                              (long long)chunk.sequence, (long long)chunk.item_count);
        memcpy(samples + count, chunk.payload, chunk.size_bytes);
        count += n;
    }
    *out_count = count;
    return ST_OK;
}

enum st polar_chunk_read(struct site *site, int64_t station_id, const char *name,
                         struct polar_sample **out_samples, size_t *out_count,
                         struct stream *out_stream, struct errctx *err) {
    struct stream stream;
    struct stream_state state;
    enum st st = stream_find(site, station_id, POLAR_CHUNK_KIND, name, &stream, err);
    if (st)
        return st;
    if (strcmp(stream.format, POLAR_CHUNK_FORMAT) != 0)
        return errctx_set(err, ST_FORMAT, "stream %s holds %s, not " POLAR_CHUNK_FORMAT,
                          stream.name, stream.format);
    if ((st = stream_get_state(site, stream.id, &state, err)))
        return st;
    if (state.item_count < 0 || state.item_count > SAMPLES_MAX)
        return errctx_set(err, ST_NOMEM, "stream %s: %lld samples are too many", stream.name,
                          (long long)state.item_count);
    struct polar_sample *samples = malloc(((size_t)state.item_count + 1) * sizeof *samples);
    if (!samples)
        return errctx_set(err, ST_NOMEM, "no memory for %lld samples", (long long)state.item_count);
    struct stream_reader *reader = NULL;
    st = stream_reader_open(site, stream.id, 0, &reader, err);
    if (!st)
        st = read_chunks(reader, samples, (size_t)state.item_count, out_count, err);
    stream_reader_close(reader);
    if (st) {
        free(samples);
        return errctx_prefix(err, st, "stream %s", stream.name);
    }
    *out_samples = samples;
    if (out_stream)
        *out_stream = stream;
    return ST_OK;
}
