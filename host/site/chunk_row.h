/* Rows of table chunk: header, payload as stored, payload as sent, link of the chain. Only for
 * host/site. */
#ifndef SC_SITE_CHUNK_ROW_H
#define SC_SITE_CHUNK_ROW_H

#include "base/hash.h"
#include "base/st.h"
#include "site/store.h"
#include "site/stream.h"

#include <stddef.h>
#include <stdint.h>

/* The columns of a header, in the order of the table, then its row hash. */
#define CHUNK_ROW_HEADER                                                                           \
    "id, stream_id, sequence, t_first_ns, t_last_ns, first_item, end_item, item_count, "           \
    "size_bytes, stored_bytes, codec, crc32c, chain, row_sha256"

enum chunk_row_codec { CHUNK_ROW_RAW = 0, CHUNK_ROW_ZSTD = 1 };

enum { CHUNK_ROW_PAYLOAD = 14 /* column of the payload */ };

struct chunk_row {
    int64_t id, stream_id;
    struct stream_chunk chunk; /* payload NULL */
    int64_t stored_bytes;
    int32_t codec;
    uint32_t crc32c;
};

/* ST_DAMAGED unless the header makes sense by itself. */
ST_MUST_CHECK enum st chunk_row_read(sqlite3_stmt *stmt, struct chunk_row *out_row,
                                     struct errctx *err);

/* Room for a payload as sent; grows as needed. */
struct chunk_row_buffer {
    uint8_t *bytes;
    size_t capacity;
};
void chunk_row_buffer_fini(struct chunk_row_buffer *buffer); /* takes a zeroed one */

/* Checks the stored payload's size and CRC and unpacks it into `buffer`: row->chunk.payload then
 * points there. ST_DAMAGED with the reason. */
ST_MUST_CHECK enum st chunk_row_unpack(const struct chunk_row *row, const void *stored,
                                       size_t stored_bytes, struct chunk_row_buffer *buffer,
                                       struct errctx *err);

/* Link 0 from the row hash of the stream's own row; link n + 1 from link n and the chunk. */
ST_MUST_CHECK enum st chunk_row_first(const uint8_t stream_row_sha256[HASH_SHA256_BYTES],
                                      uint8_t out_link[HASH_SHA256_BYTES]);
ST_MUST_CHECK enum st chunk_row_link(const uint8_t before[HASH_SHA256_BYTES],
                                     const struct stream_chunk *chunk,
                                     uint8_t out_link[HASH_SHA256_BYTES]);

#endif
