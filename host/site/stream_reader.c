#include "site/chunk_row.h"
#include "site/store.h"
#include "site/stream.h"

#include <stdlib.h>

/* Has its own statement, so that readers do not disturb each other, and copies the payload, so that
 * it holds no read transaction between calls: one that stays open would keep the write-ahead log
 * from ending. */
struct stream_reader {
    struct site *site;
    sqlite3_stmt *stmt;
    int64_t stream_id, next_sequence;
    struct chunk_row_buffer buffer;
    bool ended; /* the table cannot be read further */
};

enum st stream_reader_open(struct site *site, int64_t id, int64_t first_sequence,
                           struct stream_reader **out_reader, struct errctx *err) {
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
    if (sqlite3_prepare_v2(site->db,
                           "SELECT * FROM chunk WHERE stream_id = ?1 AND sequence >= ?2"
                           " ORDER BY sequence LIMIT 1",
                           -1, &reader->stmt, NULL) != SQLITE_OK) {
        st = store_error(site, err, "read");
        stream_reader_close(reader);
        return st;
    }
    *out_reader = reader;
    return ST_OK;
}

static enum st read_chunk(struct stream_reader *reader, struct stream_chunk *out_chunk,
                          struct errctx *err) {
    struct chunk_row row;
    int64_t wanted = reader->next_sequence;
    if (sqlite3_bind_int64(reader->stmt, 1, reader->stream_id) != SQLITE_OK ||
        sqlite3_bind_int64(reader->stmt, 2, wanted) != SQLITE_OK)
        return store_error(reader->site, err, "read");
    enum st st = store_fetch(reader->site, reader->stmt, STORE_CHUNK, err);
    if (st == ST_DAMAGED) {
        int code = sqlite3_errcode(reader->site->db);
        reader->ended = code != SQLITE_OK && code != SQLITE_ROW;
        reader->next_sequence++;
    }
    if (!st)
        st = chunk_row_read(reader->stmt, &row, err);
    if (st)
        return st;
    if (row.chunk.sequence != wanted) {
        reader->next_sequence = row.chunk.sequence;
        return errctx_set(err, ST_DAMAGED, "%s/site.db: stream %lld: chunk %lld is missing",
                          site_path(reader->site), (long long)reader->stream_id, (long long)wanted);
    }
    reader->next_sequence++;
    struct row_value stored = row_read(reader->stmt, CHUNK_ROW_PAYLOAD);
    st = chunk_row_unpack(&row, stored.data, stored.size, &reader->buffer, err);
    if (st)
        return errctx_prefix(err, st, "%s/site.db: stream %lld, chunk %lld",
                             site_path(reader->site), (long long)reader->stream_id,
                             (long long)wanted);
    *out_chunk = row.chunk;
    out_chunk->payload = reader->buffer.bytes;
    return ST_OK;
}

enum st stream_reader_next(struct stream_reader *reader, struct stream_chunk *out_chunk,
                           struct errctx *err) {
    if (reader->ended)
        return ST_NOT_FOUND;
    enum st st = read_chunk(reader, out_chunk, err);
    (void)sqlite3_reset(reader->stmt);
    return st;
}

void stream_reader_close(struct stream_reader *reader) {
    if (!reader)
        return;
    (void)sqlite3_finalize(reader->stmt);
    chunk_row_buffer_fini(&reader->buffer);
    free(reader);
}
