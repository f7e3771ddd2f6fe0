#include "site/stream.h"

#include "site/batch.h"
#include "site/chunk_row.h"
#include "site/store.h"

#include <stdlib.h>
#include <string.h>
#include <zstd.h>

/* Columns: id station_id kind name format meta origin zstd_level created_utc_ns. */
static enum st read_stream(sqlite3_stmt *stmt, struct stream *out_stream, struct errctx *err) {
    struct stream stream = {.id = sqlite3_column_int64(stmt, 0),
                            .station_id = sqlite3_column_int64(stmt, 1),
                            .created_utc_ns = sqlite3_column_int64(stmt, 8)};
    double origin[3] = {0};
    enum st st = row_get_text(stmt, 2, stream.kind, sizeof stream.kind, err);
    if (!st)
        st = row_get_text(stmt, 3, stream.name, sizeof stream.name, err);
    if (!st)
        st = row_get_text(stmt, 4, stream.format, sizeof stream.format, err);
    if (!st)
        st = row_get_text(stmt, 5, stream.meta, sizeof stream.meta, err);
    if (!st)
        st = row_get_doubles(stmt, 6, origin, 3, err);
    if (!st)
        st = row_get_int32(stmt, 7, &stream.zstd_level, err);
    if (st)
        return st;
    stream.origin_m = vec3_make(origin[0], origin[1], origin[2]);
    *out_stream = stream;
    return ST_OK;
}

static enum st check_stream(const struct stream *stream, struct errctx *err) {
    enum { ZSTD_LEVEL_MAX = 19 };
    if (!site_kind_is_valid(stream->kind) || !site_kind_is_valid(stream->format))
        return errctx_set(err, ST_INVALID,
                          "stream: '%.40s' or '%.40s' cannot be its kind or format", stream->kind,
                          stream->format);
    if (!site_name_is_valid(stream->name))
        return errctx_set(err, ST_INVALID, "stream: '%.80s' cannot be its name", stream->name);
    if (stream->zstd_level < 0 || stream->zstd_level > ZSTD_LEVEL_MAX)
        return errctx_set(err, ST_INVALID, "stream: compression level %d is not in 0..%d",
                          (int)stream->zstd_level, ZSTD_LEVEL_MAX);
    if (!vec3_is_finite(stream->origin_m))
        return errctx_set(err, ST_INVALID, "stream: its origin is not finite");
    return row_check_json(stream->meta, "description of a stream", err);
}

/* ST_NOT_FOUND without a message. */
static enum st find_stream(struct site *site, int64_t station_id, const char *kind,
                           const char *name, struct stream *out_stream, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    struct row_value kind_value = row_text(kind);
    struct row_value name_value = name ? row_text(name) : row_null();
    enum st st = store_query(site,
                             "SELECT * FROM stream WHERE station_id = ?1 AND kind = ?2 AND"
                             " (?3 IS NULL OR name = ?3) ORDER BY id LIMIT 1",
                             &station_id, 1, &stmt, err);
    if (!st)
        st = row_bind(stmt, 2, &kind_value);
    if (!st)
        st = row_bind(stmt, 3, &name_value);
    if (!st)
        st = store_fetch(site, stmt, STORE_STREAM, err);
    if (st)
        return st;
    st = read_stream(stmt, out_stream, err);
    (void)sqlite3_reset(stmt);
    return st;
}

enum st stream_add(struct site *site, const struct stream *stream, int64_t *out_id,
                   struct errctx *err) {
    enum st st = check_stream(stream, err);
    if (!st)
        st = batch_begin(site, err);
    if (st)
        return st;
    int64_t id = 0;
    struct stream same;
    st = store_require(site, STORE_STATION, stream->station_id, err);
    if (!st) {
        st = find_stream(site, stream->station_id, stream->kind, stream->name, &same, err);
        st = st == ST_NOT_FOUND ? ST_OK
             : st               ? st
                  : errctx_set(err, ST_EXISTS, "station %lld has a stream %s '%s' already",
                               (long long)stream->station_id, stream->kind, stream->name);
    }
    const double origin[3] = {stream->origin_m.x, stream->origin_m.y, stream->origin_m.z};
    uint8_t origin_bytes[sizeof origin];
    row_put_doubles(origin_bytes, origin, 3);
    struct row_value values[] = {row_int(0),
                                 row_int(stream->station_id),
                                 row_text(stream->kind),
                                 row_text(stream->name),
                                 row_text(stream->format),
                                 row_text(stream->meta),
                                 row_blob(origin_bytes, sizeof origin_bytes),
                                 row_int(stream->zstd_level),
                                 row_int(store_now_utc_ns(site))};
    if (!st)
        st = store_insert(site, STORE_STREAM, values, 9, NULL, &id, err);
    st = batch_end(site, st, err);
    if (!st)
        *out_id = id;
    return st;
}

enum st stream_get(struct site *site, int64_t id, struct stream *out_stream, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    enum st st = store_fetch_id(site, STORE_STREAM, id, &stmt, err);
    if (st)
        return st;
    st = read_stream(stmt, out_stream, err);
    (void)sqlite3_reset(stmt);
    return st;
}

enum st stream_find(struct site *site, int64_t station_id, const char *kind, const char *name,
                    struct stream *out_stream, struct errctx *err) {
    enum st st = find_stream(site, station_id, kind, name, out_stream, err);
    return st == ST_NOT_FOUND
               ? errctx_set(err, st, "%s: station %lld has no stream %.40s%s%.80s", site->path,
                            (long long)station_id, kind, name ? " of " : "", name ? name : "")
               : st;
}

static enum st list_read_stream(struct site *site, sqlite3_stmt *stmt, void *out_row,
                                struct errctx *err) {
    (void)site;
    return read_stream(stmt, out_row, err);
}

enum st stream_list(struct site *site, int64_t station_id, int64_t after_id,
                    struct stream *out_streams, size_t capacity, size_t *out_count,
                    struct errctx *err) {
    const int64_t numbers[2] = {after_id, station_id};
    return store_list(
        site, "SELECT * FROM stream WHERE id > ?1 AND (?2 = 0 OR station_id = ?2) ORDER BY id",
        numbers, 2, STORE_STREAM, list_read_stream, out_streams, sizeof *out_streams, capacity,
        out_count, err);
}

enum st stream_each(struct site *site, int64_t station_id,
                    enum st (*visit)(void *ctx, const struct stream *stream, struct errctx *err),
                    void *ctx, struct errctx *err) {
    enum { PAGE = 16 };
    struct stream *page = calloc(PAGE, sizeof *page); /* too large for the stack */
    if (!page)
        return errctx_set(err, ST_NOMEM, "no memory for the list of streams");
    size_t count = PAGE;
    int64_t after = 0;
    enum st st = ST_OK;
    while (!st && count == PAGE) {
        st = stream_list(site, station_id, after, page, PAGE, &count, err);
        for (size_t i = 0; i < count && !st; i++) {
            after = page[i].id;
            st = visit(ctx, &page[i], err);
        }
    }
    free(page);
    return st;
}

/* Where a stream stands: the newest chunk's header; before the first, sequence -1, end 0 and link
 * 0. */
struct head {
    struct stream_chunk last;
    int32_t zstd_level;
};

static enum st read_head(struct site *site, int64_t id, struct head *out_head, struct errctx *err) {
    struct head head = {.last = {.sequence = -1}};
    struct chunk_row row;
    uint8_t stream_row[HASH_SHA256_BYTES];
    sqlite3_stmt *stmt = NULL;
    enum st st = store_fetch_id(site, STORE_STREAM, id, &stmt, err);
    if (st)
        return st;
    st = row_get_int32(stmt, 7, &head.zstd_level, err);
    if (!st)
        st = row_get_blob(stmt, 9, stream_row, sizeof stream_row, err);
    (void)sqlite3_reset(stmt);
    if (!st)
        st = store_query(site,
                         "SELECT " CHUNK_ROW_HEADER " FROM chunk WHERE stream_id = ?1"
                         " ORDER BY sequence DESC LIMIT 1",
                         &id, 1, &stmt, err);
    if (!st)
        st = store_fetch(site, stmt, STORE_CHUNK, err);
    if (st == ST_NOT_FOUND) {
        st = chunk_row_first(stream_row, head.last.chain);
    } else if (!st) {
        st = chunk_row_read(stmt, &row, err);
        (void)sqlite3_reset(stmt);
        if (!st)
            head.last = row.chunk;
    }
    if (!st)
        *out_head = head;
    return st;
}

enum st stream_get_state(struct site *site, int64_t id, struct stream_state *out_state,
                         struct errctx *err) {
    struct head head;
    struct stream_state state = {0};
    sqlite3_stmt *stmt = NULL;
    enum st st = read_head(site, id, &head, err);
    if (!st)
        st = store_query(
            site,
            "SELECT count(*), coalesce(sum(item_count), 0), coalesce(sum(size_bytes), 0),"
            " coalesce(sum(stored_bytes), 0), coalesce(min(t_first_ns), 0),"
            " coalesce(max(t_last_ns), 0) FROM chunk WHERE stream_id = ?1",
            &id, 1, &stmt, err);
    if (!st && sqlite3_step(stmt) != SQLITE_ROW)
        st = store_error(site, err, "read");
    if (st)
        return st;
    state.chunk_count = sqlite3_column_int64(stmt, 0);
    state.item_count = sqlite3_column_int64(stmt, 1);
    state.payload_bytes = sqlite3_column_int64(stmt, 2);
    state.stored_bytes = sqlite3_column_int64(stmt, 3);
    state.t_first_ns = sqlite3_column_int64(stmt, 4);
    state.t_last_ns = sqlite3_column_int64(stmt, 5);
    state.end_item = head.last.end_item;
    memcpy(state.chain, head.last.chain, sizeof state.chain);
    (void)sqlite3_reset(stmt);
    st = store_query(site,
                     "SELECT count(*), coalesce(sum(end_item - first_item), 0) FROM ledger"
                     " WHERE stream_id = ?1",
                     &id, 1, &stmt, err);
    if (!st && sqlite3_step(stmt) != SQLITE_ROW)
        st = store_error(site, err, "read");
    if (st)
        return st;
    state.ledger_count = sqlite3_column_int64(stmt, 0);
    state.missing_count = sqlite3_column_int64(stmt, 1);
    (void)sqlite3_reset(stmt);
    *out_state = state;
    return ST_OK;
}

static enum st check_chunk(const struct stream_chunk *c, int64_t end_before, struct errctx *err) {
    if (!c->payload || c->size_bytes < 1 || c->size_bytes > STREAM_CHUNK_MAX_BYTES)
        return errctx_set(err, ST_INVALID, "a chunk of %zu bytes; 1 to %d fit", c->size_bytes,
                          STREAM_CHUNK_MAX_BYTES);
    if (c->first_item < end_before || c->end_item < c->first_item || c->item_count < 0 ||
        c->item_count > c->end_item - c->first_item || c->t_last_ns < c->t_first_ns)
        return errctx_set(
            err, ST_INVALID,
            "a chunk of %lld items numbered %lld up to %lld does not follow number %lld",
            (long long)c->item_count, (long long)c->first_item, (long long)c->end_item,
            (long long)end_before);
    return ST_OK;
}

/* A compressor and its output, made when first needed. */
struct packer {
    ZSTD_CCtx *context;
    struct chunk_row_buffer buffer;
};

/* The payload as it is stored: compressed if the stream asks for it and it is smaller. */
static enum st pack(struct packer *packer, int32_t level, const struct stream_chunk *chunk,
                    struct row_value *out_stored, enum chunk_row_codec *out_codec,
                    struct errctx *err) {
    *out_stored = row_blob(chunk->payload, chunk->size_bytes);
    *out_codec = CHUNK_ROW_RAW;
    if (level == 0)
        return ST_OK;
    size_t bound = ZSTD_compressBound(chunk->size_bytes);
    if (!packer->context)
        packer->context = ZSTD_createCCtx();
    if (packer->buffer.capacity < bound) {
        uint8_t *grown = realloc(packer->buffer.bytes, bound);
        if (grown) {
            packer->buffer.bytes = grown;
            packer->buffer.capacity = bound;
        }
    }
    if (!packer->context || packer->buffer.capacity < bound)
        return errctx_set(err, ST_NOMEM, "no memory to compress a chunk");
    size_t size = ZSTD_compressCCtx(packer->context, packer->buffer.bytes, packer->buffer.capacity,
                                    chunk->payload, chunk->size_bytes, level);
    if (ZSTD_isError(size))
        return errctx_set(err, ST_INTERNAL, "cannot compress a chunk: %s", ZSTD_getErrorName(size));
    if (size < chunk->size_bytes) {
        *out_stored = row_blob(packer->buffer.bytes, size);
        *out_codec = CHUNK_ROW_ZSTD;
    }
    return ST_OK;
}

static enum st append_one(struct site *site, int64_t id, struct head *head, struct packer *packer,
                          const struct stream_chunk *chunk, struct errctx *err) {
    enum st st = check_chunk(chunk, head->last.end_item, err);
    struct stream_chunk next = *chunk;
    next.sequence = head->last.sequence + 1;
    struct row_value stored = {0};
    enum chunk_row_codec codec = CHUNK_ROW_RAW;
    if (!st)
        st = pack(packer, head->zstd_level, chunk, &stored, &codec, err);
    if (!st && chunk_row_link(head->last.chain, &next, next.chain))
        st = errctx_set(err, ST_NOMEM, "cannot hash a chunk");
    if (st)
        return st;
    struct row_value values[] = {row_int(0),
                                 row_int(id),
                                 row_int(next.sequence),
                                 row_int(next.t_first_ns),
                                 row_int(next.t_last_ns),
                                 row_int(next.first_item),
                                 row_int(next.end_item),
                                 row_int(next.item_count),
                                 row_int((int64_t)next.size_bytes),
                                 row_int((int64_t)stored.size),
                                 row_int((int64_t)codec),
                                 row_int(hash_crc32c(0, stored.data, stored.size)),
                                 row_blob(next.chain, sizeof next.chain)};
    st = store_insert(site, STORE_CHUNK, values, 13, &stored, NULL, err);
    if (!st)
        head->last = next;
    return st;
}

enum st stream_append(struct site *site, int64_t id, const struct stream_chunk *chunks,
                      size_t count, struct errctx *err) {
    if (count > STREAM_BATCH_MAX_CHUNKS)
        return errctx_set(err, ST_INVALID, "%zu chunks at once; at most %d", count,
                          STREAM_BATCH_MAX_CHUNKS);
    enum st st = batch_begin(site, err);
    if (st)
        return st;
    struct head head;
    struct packer packer = {0};
    st = read_head(site, id, &head, err);
    for (size_t i = 0; i < count && !st; i++)
        st = append_one(site, id, &head, &packer, &chunks[i], err);
    (void)ZSTD_freeCCtx(packer.context);
    chunk_row_buffer_fini(&packer.buffer);
    return batch_end(site, st, err);
}

enum st stream_ledger_add(struct site *site, const struct stream_ledger *entry,
                          struct errctx *err) {
    if (entry->first_item < 0 || entry->end_item <= entry->first_item)
        return errctx_set(err, ST_INVALID, "ledger: items %lld up to %lld are no range",
                          (long long)entry->first_item, (long long)entry->end_item);
    if (!site_name_is_valid(entry->reason))
        return errctx_set(err, ST_INVALID, "ledger: '%.80s' is no reason", entry->reason);
    enum st st = batch_begin(site, err);
    if (st)
        return st;
    st = store_require(site, STORE_STREAM, entry->stream_id, err);
    struct row_value values[] = {row_int(0),
                                 row_int(entry->stream_id),
                                 row_int(entry->first_item),
                                 row_int(entry->end_item),
                                 row_int(entry->t_ns),
                                 row_text(entry->reason)};
    if (!st)
        st = store_insert(site, STORE_LEDGER, values, 6, NULL, NULL, err);
    return batch_end(site, st, err);
}

static enum st list_ledger(struct site *site, sqlite3_stmt *stmt, void *out_row,
                           struct errctx *err) {
    (void)site;
    struct stream_ledger *entry = out_row;
    *entry = (struct stream_ledger){.id = sqlite3_column_int64(stmt, 0),
                                    .stream_id = sqlite3_column_int64(stmt, 1),
                                    .first_item = sqlite3_column_int64(stmt, 2),
                                    .end_item = sqlite3_column_int64(stmt, 3),
                                    .t_ns = sqlite3_column_int64(stmt, 4)};
    return row_get_text(stmt, 5, entry->reason, sizeof entry->reason, err);
}

enum st stream_ledger_list(struct site *site, int64_t stream_id, int64_t after_id,
                           struct stream_ledger *out_entries, size_t capacity, size_t *out_count,
                           struct errctx *err) {
    const int64_t numbers[2] = {stream_id, after_id};
    return store_list(site, "SELECT * FROM ledger WHERE stream_id = ?1 AND id > ?2 ORDER BY id",
                      numbers, 2, STORE_LEDGER, list_ledger, out_entries, sizeof *out_entries,
                      capacity, out_count, err);
}
