#include "site/chunk_row.h"

#include <stdlib.h>
#include <string.h>
#include <zstd.h>

enum st chunk_row_read(sqlite3_stmt *stmt, struct chunk_row *out_row, struct errctx *err) {
    int64_t n[12];
    bool good = true;
    for (int c = 0; c < 12; c++) {
        good = good && sqlite3_column_type(stmt, c) == SQLITE_INTEGER;
        n[c] = sqlite3_column_int64(stmt, c);
    }
    struct chunk_row row = {.id = n[0],
                            .stream_id = n[1],
                            .chunk = {.sequence = n[2],
                                      .t_first_ns = n[3],
                                      .t_last_ns = n[4],
                                      .first_item = n[5],
                                      .end_item = n[6],
                                      .item_count = n[7]},
                            .stored_bytes = n[9],
                            .codec = (int32_t)(n[10] & 0x7f),
                            .crc32c = (uint32_t)(n[11] & 0xffffffff)};
    good = good && n[2] >= 0 && n[2] < INT64_MAX && n[5] >= 0 && n[6] >= n[5] && n[7] >= 0 &&
           n[7] <= n[6] - n[5] && n[8] >= 1 && n[8] <= STREAM_CHUNK_MAX_BYTES && n[9] >= 1 &&
           n[9] <= n[8] && (n[10] == CHUNK_ROW_RAW || n[10] == CHUNK_ROW_ZSTD) && n[11] >= 0 &&
           n[11] <= UINT32_MAX;
    if (!good || row_get_blob(stmt, 12, row.chunk.chain, sizeof row.chunk.chain, NULL))
        return errctx_set(err, ST_DAMAGED, "site.db: table chunk, row %lld makes no sense",
                          (long long)n[0]);
    row.chunk.size_bytes = (size_t)n[8];
    *out_row = row;
    return ST_OK;
}

void chunk_row_buffer_fini(struct chunk_row_buffer *buffer) {
    free(buffer->bytes);
    *buffer = (struct chunk_row_buffer){0};
}

enum st chunk_row_unpack(const struct chunk_row *row, const void *stored, size_t stored_bytes,
                         struct chunk_row_buffer *buffer, struct errctx *err) {
    size_t size = row->chunk.size_bytes;
    if (!stored || stored_bytes != (size_t)row->stored_bytes ||
        (row->codec == CHUNK_ROW_RAW && stored_bytes != size))
        return errctx_set(err, ST_DAMAGED, "the payload has %zu bytes, not %lld", stored_bytes,
                          (long long)row->stored_bytes);
    if (hash_crc32c(0, stored, stored_bytes) != row->crc32c)
        return errctx_set(err, ST_DAMAGED, "the payload does not match its CRC");
    if (buffer->capacity < size) {
        uint8_t *grown = realloc(buffer->bytes, size);
        if (!grown)
            return errctx_set(err, ST_NOMEM, "no memory for a chunk of %zu bytes", size);
        buffer->bytes = grown;
        buffer->capacity = size;
    }
    if (row->codec == CHUNK_ROW_RAW)
        memcpy(buffer->bytes, stored, size);
    else if (ZSTD_decompress(buffer->bytes, size, stored, stored_bytes) != size)
        return errctx_set(err, ST_DAMAGED, "the payload does not decompress");
    return ST_OK;
}

enum st chunk_row_first(const uint8_t stream_row_sha256[HASH_SHA256_BYTES],
                        uint8_t out_link[HASH_SHA256_BYTES]) {
    static const char label[] = "scancart/stream/1";
    uint8_t bytes[sizeof label + HASH_SHA256_BYTES];
    memcpy(bytes, label, sizeof label);
    memcpy(bytes + sizeof label, stream_row_sha256, HASH_SHA256_BYTES);
    return hash_sha256(bytes, sizeof bytes, out_link);
}

enum st chunk_row_link(const uint8_t before[HASH_SHA256_BYTES], const struct stream_chunk *chunk,
                       uint8_t out_link[HASH_SHA256_BYTES]) {
    const int64_t numbers[7] = {chunk->sequence,           chunk->t_first_ns, chunk->t_last_ns,
                                chunk->first_item,         chunk->end_item,   chunk->item_count,
                                (int64_t)chunk->size_bytes};
    uint8_t header[sizeof numbers];
    for (size_t i = 0; i < 7; i++)
        row_put_i64(header + 8 * i, numbers[i]);
    struct hash_sha256 hash = {0};
    enum st st = hash_sha256_init(&hash);
    if (!st)
        st = hash_sha256_update(&hash, before, HASH_SHA256_BYTES);
    if (!st)
        st = hash_sha256_update(&hash, header, sizeof header);
    if (!st)
        st = hash_sha256_update(&hash, chunk->payload, chunk->size_bytes);
    if (!st)
        st = hash_sha256_final(&hash, out_link);
    hash_sha256_fini(&hash);
    return st;
}
