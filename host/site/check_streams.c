#include "site/check_streams.h"

#include <stdlib.h>
#include <string.h>

enum st check_streams_add(struct check_streams *streams, sqlite3_stmt *stmt) {
    if (streams->count == streams->capacity) {
        size_t capacity = streams->capacity ? 2 * streams->capacity : 64;
        struct check_streams_one *grown =
            realloc(streams->streams, capacity * sizeof streams->streams[0]);
        if (!grown)
            return ST_NOMEM;
        streams->streams = grown;
        streams->capacity = capacity;
    }
    struct check_streams_one one = {.id = sqlite3_column_int64(stmt, 0)};
    uint8_t row[HASH_SHA256_BYTES];
    if (row_get_blob(stmt, store_hashed_columns(STORE_STREAM), row, sizeof row, NULL) ||
        chunk_row_first(row, one.chain))
        return ST_NOMEM;
    streams->streams[streams->count++] = one;
    return ST_OK;
}

static struct check_streams_one *find(struct check_streams *streams, int64_t id) {
    size_t low = 0, high = streams->count;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (streams->streams[middle].id < id)
            low = middle + 1;
        else
            high = middle;
    }
    return low < streams->count && streams->streams[low].id == id ? &streams->streams[low] : NULL;
}

static void follow_chain(struct check_streams_one *stream, struct check_walk *walk,
                         const struct chunk_row *row) {
    uint8_t link[HASH_SHA256_BYTES];
    const struct stream_chunk *chunk = &row->chunk;
    if (chunk->sequence != stream->next_sequence)
        check_walk_row(walk, STORE_CHUNK, row->id,
                       "stream %lld goes on with chunk %lld after chunk %lld: chunks are missing",
                       (long long)row->stream_id, (long long)chunk->sequence,
                       (long long)stream->next_sequence - 1);
    else if (chunk->payload && !stream->lost &&
             (chunk_row_link(stream->chain, chunk, link) ||
              memcmp(link, chunk->chain, sizeof link) != 0))
        check_walk_row(walk, STORE_CHUNK, row->id,
                       "stream %lld, chunk %lld: does not fit the chain of hashes",
                       (long long)row->stream_id, (long long)chunk->sequence);
    memcpy(stream->chain, chunk->chain, sizeof stream->chain);
    stream->next_sequence = chunk->sequence + 1;
    stream->lost = false;
}

enum st check_streams_chunk(struct check_streams *streams, struct check_walk *walk,
                            sqlite3_stmt *stmt) {
    struct chunk_row row;
    struct errctx why = {0};
    int64_t id = sqlite3_column_int64(stmt, 0);
    walk->result.chunks++;
    if (chunk_row_read(stmt, &row, &why)) {
        check_walk_row(walk, STORE_CHUNK, id, "makes no sense");
        struct check_streams_one *lost = find(streams, sqlite3_column_int64(stmt, 1));
        if (lost)
            lost->lost = true;
        return ST_OK;
    }
    struct check_streams_one *stream = find(streams, row.stream_id);
    if (!stream) {
        check_walk_row(walk, STORE_CHUNK, id, "its stream %lld is missing or damaged",
                       (long long)row.stream_id);
        return ST_OK;
    }
    struct row_value stored = row_read(stmt, CHUNK_ROW_PAYLOAD);
    enum st st = chunk_row_unpack(&row, stored.data, stored.size, &streams->buffer, &why);
    if (st == ST_NOMEM)
        return st;
    if (st)
        check_walk_row(walk, STORE_CHUNK, id, "stream %lld, chunk %lld: %.150s",
                       (long long)row.stream_id, (long long)row.chunk.sequence, why.text);
    else
        row.chunk.payload = streams->buffer.bytes;
    follow_chain(stream, walk, &row);
    return ST_OK;
}

/* Two sorted lists side by side: the chunks of a stream and its ledger. */
struct balance {
    sqlite3_stmt *ledger;
    bool has_entry;
    int64_t entry_id, entry_first, entry_end; /* what is left of the current entry */
    int64_t last_end;                         /* of the entry before */
};

static void next_entry(struct balance *b, struct check_walk *walk) {
    b->has_entry = sqlite3_step(b->ledger) == SQLITE_ROW;
    if (!b->has_entry)
        return;
    b->entry_id = sqlite3_column_int64(b->ledger, 0);
    b->entry_first = sqlite3_column_int64(b->ledger, 1);
    b->entry_end = sqlite3_column_int64(b->ledger, 2);
    if (b->entry_first < 0 || b->entry_end <= b->entry_first) {
        check_walk_row(walk, STORE_LEDGER, b->entry_id, "is no range of items");
        b->has_entry = false;
    } else if (b->entry_first < b->last_end)
        check_walk_row(walk, STORE_LEDGER, b->entry_id, "counts items that an entry before counts");
    b->last_end = b->entry_end;
}

/* Items of the ledger below `end`; takes them off. */
static int64_t take_below(struct balance *b, struct check_walk *walk, int64_t end) {
    int64_t taken = 0;
    while (b->has_entry && b->entry_first < end) {
        int64_t upto = b->entry_end < end ? b->entry_end : end;
        taken += upto - b->entry_first;
        b->entry_first = upto;
        if (b->entry_first == b->entry_end)
            next_entry(b, walk);
    }
    return taken;
}

static enum st balance_stream(struct check_walk *walk, int64_t id) {
    struct balance b = {0};
    sqlite3_stmt *chunks = NULL;
    struct errctx why = {0};
    if (store_query(walk->site,
                    "SELECT id, first_item, end_item, item_count FROM chunk WHERE stream_id = ?1"
                    " ORDER BY sequence",
                    &id, 1, &chunks, &why) ||
        store_query(walk->site,
                    "SELECT id, first_item, end_item FROM ledger WHERE stream_id = ?1"
                    " ORDER BY first_item",
                    &id, 1, &b.ledger, &why)) {
        check_walk_error(walk, "site.db: table ledger", "%.200s", why.text);
        return ST_OK;
    }
    next_entry(&b, walk);
    int64_t end_before = 0;
    while (sqlite3_step(chunks) == SQLITE_ROW) {
        int64_t row = sqlite3_column_int64(chunks, 0), first = sqlite3_column_int64(chunks, 1);
        int64_t end = sqlite3_column_int64(chunks, 2), count = sqlite3_column_int64(chunks, 3);
        if (first < end_before || end < first || count < 0 || count > end - first) {
            check_walk_row(walk, STORE_CHUNK, row, "its items overlap those before it");
            break;
        }
        int64_t missing = end - end_before - count, told = take_below(&b, walk, end);
        if (missing != told)
            check_walk_row(walk, STORE_CHUNK, row,
                           "%lld items are missing up to here, the ledger tells of %lld",
                           (long long)missing, (long long)told);
        end_before = end;
    }
    (void)sqlite3_reset(chunks);
    (void)sqlite3_reset(b.ledger);
    return check_walk_progress(walk, 0);
}

enum st check_streams_ledger(struct check_streams *streams, struct check_walk *walk) {
    enum st st = ST_OK;
    for (size_t i = 0; i < streams->count && !st; i++)
        st = balance_stream(walk, streams->streams[i].id);
    return st;
}

void check_streams_fini(struct check_streams *streams) {
    free(streams->streams);
    chunk_row_buffer_fini(&streams->buffer);
    *streams = (struct check_streams){0};
}
