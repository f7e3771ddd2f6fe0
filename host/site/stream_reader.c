#include "site/chunk_row.h"
#include "site/store.h"
#include "site/stream.h"

#include <stdlib.h>

/* Has its own statements, so that readers do not disturb each other, and copies the payload, so
 * that it holds no read transaction between calls: one that stays open would keep the write-ahead
 * log from ending. */
struct stream_reader {
    struct site *site;
    sqlite3_stmt *find, *fetch; /* the next sequence number there is; its row */
    int64_t stream_id, next_sequence;
    struct chunk_row_buffer buffer;
    bool ended; /* the table cannot be read further */
};

enum st stream_reader_open(struct site *site, int64_t id, int64_t first_sequence,
                           struct stream_reader **out_reader, struct errctx *err) {
    static const char find[] = "SELECT min(sequence) FROM chunk WHERE stream_id = ?1"
                               " AND sequence >= ?2";
    static const char fetch[] = "SELECT * FROM chunk WHERE stream_id = ?1 AND sequence = ?2";
    enum st st = store_require(site, STORE_STREAM, id, err);
    if (st)
        return st;
    if (first_sequence < 0)
        return errctx_set(err, ST_INVALID, "chunk %lld", (long long)first_sequence);
    struct stream_reader *reader = calloc(1, sizeof *reader);
    if (!reader)
        return errctx_set(err, ST_NOMEM, "no memory to read a stream");
    *reader =
        (struct stream_reader){.site = site, .stream_id = id, .next_sequence = first_sequence};
    if (sqlite3_prepare_v2(site->db, find, -1, &reader->find, NULL) != SQLITE_OK ||
        sqlite3_prepare_v2(site->db, fetch, -1, &reader->fetch, NULL) != SQLITE_OK) {
        st = store_error(site, err, "read");
        stream_reader_close(reader);
        return st;
    }
    *out_reader = reader;
    return ST_OK;
}

static enum st bind_numbers(struct stream_reader *reader, sqlite3_stmt *stmt, int64_t sequence,
                            struct errctx *err) {
    if (sqlite3_bind_int64(stmt, 1, reader->stream_id) != SQLITE_OK ||
        sqlite3_bind_int64(stmt, 2, sequence) != SQLITE_OK)
        return store_error(reader->site, err, "read");
    return ST_OK;
}

/* The sequence number of the next chunk that is there, and the reader set behind it, so that it
 * comes to an end whatever the rows hold. */
static enum st find_next(struct stream_reader *reader, int64_t *out_sequence, struct errctx *err) {
    enum st st = bind_numbers(reader, reader->find, reader->next_sequence, err);
    if (st)
        return st;
    if (sqlite3_step(reader->find) != SQLITE_ROW) {
        reader->ended = true;
        st = store_error(reader->site, err, "read");
    } else if (sqlite3_column_type(reader->find, 0) == SQLITE_NULL)
        st = ST_NOT_FOUND;
    int64_t sequence = sqlite3_column_int64(reader->find, 0);
    (void)sqlite3_reset(reader->find);
    if (st)
        return st;
    reader->ended = sequence == INT64_MAX;
    reader->next_sequence = reader->ended ? sequence : sequence + 1;
    *out_sequence = sequence;
    return ST_OK;
}

static enum st read_chunk(struct stream_reader *reader, struct stream_chunk *out_chunk,
                          struct errctx *err) {
    struct chunk_row row;
    int64_t wanted = reader->next_sequence, sequence = 0;
    enum st st = find_next(reader, &sequence, err);
    if (st)
        return st;
    if (sequence != wanted) {
        reader->next_sequence = sequence; /* the next call gives it */
        reader->ended = false;
        return errctx_set(err, ST_DAMAGED, "%s/site.db: stream %lld: chunk %lld is missing",
                          site_path(reader->site), (long long)reader->stream_id, (long long)wanted);
    }
    st = bind_numbers(reader, reader->fetch, sequence, err);
    if (!st)
        st = store_fetch(reader->site, reader->fetch, STORE_CHUNK, err);
    if (st == ST_NOT_FOUND) /* the index says otherwise */
        return errctx_set(
            err, ST_DAMAGED, "%s/site.db: stream %lld: chunk %lld is not in its table",
            site_path(reader->site), (long long)reader->stream_id, (long long)sequence);
    if (!st)
        st = chunk_row_read(reader->fetch, &row, err);
    if (st)
        return st;
    struct row_value stored = row_read(reader->fetch, CHUNK_ROW_PAYLOAD);
    st = chunk_row_unpack(&row, stored.data, stored.size, &reader->buffer, err);
    if (st)
        return errctx_prefix(err, st, "%s/site.db: stream %lld, chunk %lld",
                             site_path(reader->site), (long long)reader->stream_id,
                             (long long)sequence);
    *out_chunk = row.chunk;
    out_chunk->payload = reader->buffer.bytes;
    return ST_OK;
}

enum st stream_reader_next(struct stream_reader *reader, struct stream_chunk *out_chunk,
                           struct errctx *err) {
    if (reader->ended)
        return ST_NOT_FOUND;
    enum st st = read_chunk(reader, out_chunk, err);
    (void)sqlite3_reset(reader->fetch);
    return st;
}

void stream_reader_close(struct stream_reader *reader) {
    if (!reader)
        return;
    (void)sqlite3_finalize(reader->find);
    (void)sqlite3_finalize(reader->fetch);
    chunk_row_buffer_fini(&reader->buffer);
    free(reader);
}
