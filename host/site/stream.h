/* Streams: what one device of a station sent, in chunks of raw bytes, and the ledger of what is
 * missing.
 *
 * An item is the device's own unit (a packet, a sample, an event), numbered by the device from 0
 * on. A chunk covers the numbers [first_item, end_item) and holds item_count of them; what it does
 * not hold, and what lies between two chunks, stands in the ledger with the reason. stored + ledger
 * = sent, and site_check() proves it.
 *
 * Chain (all integers little-endian):
 *   chain_0   = SHA-256("scancart/stream/1" 0 row hash of the stream's own row)
 *   chain_n+1 = SHA-256(chain_n | sequence i64 | t_first_ns i64 | t_last_ns i64 | first_item i64 |
 *                       end_item i64 | item_count i64 | size u64 | payload)
 * over the payload as the device sent it, compressed in the database or not. A CRC-32C of the bytes
 * as stored finds damage without the chain. */
#ifndef SC_SITE_STREAM_H
#define SC_SITE_STREAM_H

#include "base/hash.h"
#include "base/st.h"
#include "base/vec.h"
#include "site/site.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { STREAM_CHUNK_MAX_BYTES = 8 << 20, STREAM_BATCH_MAX_CHUNKS = 4096 };

struct stream {
    int64_t id, station_id;
    char kind[SITE_KIND_MAX];   /* "head", "index", "gpio", "polar", "modbus", ... */
    char name[SITE_NAME_MAX];   /* the device; (station, kind, name) is unique */
    char format[SITE_KIND_MAX]; /* layout of an item with its version: "polar_sample.1",
                                   "head_packet.1" */
    char meta[SITE_TEXT_MAX];   /* JSON: rates, ids, what a reader needs; or "" */
    struct vec3 origin_m;   /* where the rays start in the station frame, for kinds that have it */
    int32_t zstd_level;     /* 0: stored as sent; 1..19: compressed where that is smaller */
    int64_t created_utc_ns; /* output only */
};

/* What the stream holds so far. */
struct stream_state {
    int64_t chunk_count, item_count;  /* stored */
    int64_t end_item;                 /* one past the highest item number seen */
    int64_t payload_bytes;            /* as sent */
    int64_t stored_bytes;             /* after compression */
    int64_t t_first_ns, t_last_ns;    /* host monotonic; 0 without a chunk */
    uint8_t chain[HASH_SHA256_BYTES]; /* newest link: what a job names as its input */
    int64_t ledger_count;             /* entries */
    int64_t missing_count;            /* items in the ledger */
};

struct stream_chunk {
    int64_t sequence; /* 0, 1, 2, ...; output only, append gives it */
    int64_t t_first_ns,
        t_last_ns; /* host monotonic time of the first and last item, first <= last */
    int64_t first_item, end_item; /* item numbers covered, first <= end */
    int64_t item_count;           /* held, <= end - first */
    const void *payload;
    size_t size_bytes;                /* 1..STREAM_CHUNK_MAX_BYTES; 64 KiB to 4 MiB is efficient */
    uint8_t chain[HASH_SHA256_BYTES]; /* output only */
};

/* Items [first_item, end_item) that are not in the stream, and why. */
struct stream_ledger {
    int64_t id, stream_id;
    int64_t first_item, end_item;
    int64_t t_ns;               /* host monotonic, when it was noticed */
    char reason[SITE_NAME_MAX]; /* "usb_lost", "crc", "ring_full", "power_loss", ... */
};

/* Adds an empty stream; of `stream` all but the output fields is used. ST_NOT_FOUND without the
 * station, ST_EXISTS if it has such a stream, ST_INVALID. */
ST_MUST_CHECK enum st stream_add(struct site *site, const struct stream *stream, int64_t *out_id,
                                 struct errctx *err);

/* ST_NOT_FOUND without it. `name` may be NULL: the first of that kind. */
ST_MUST_CHECK enum st stream_get(struct site *site, int64_t id, struct stream *out_stream,
                                 struct errctx *err);
ST_MUST_CHECK enum st stream_find(struct site *site, int64_t station_id, const char *kind,
                                  const char *name, struct stream *out_stream, struct errctx *err);

/* Pages through the streams of a station (0: of all), see station_list(). */
ST_MUST_CHECK enum st stream_list(struct site *site, int64_t station_id, int64_t after_id,
                                  struct stream *out_streams, size_t capacity, size_t *out_count,
                                  struct errctx *err);

/* Calls `visit` for each of them in turn, until one fails; its failure is returned. ST_NOMEM. */
ST_MUST_CHECK enum st stream_each(struct site *site, int64_t station_id,
                                  enum st (*visit)(void *ctx, const struct stream *stream,
                                                   struct errctx *err),
                                  void *ctx, struct errctx *err);

/* Reads the chunk headers, not the payloads. */
ST_MUST_CHECK enum st stream_get_state(struct site *site, int64_t id,
                                       struct stream_state *out_state, struct errctx *err);

/* Appends chunks, all or none: within the open batch, or as one batch. The chunks must follow what
 * is there (first_item at or after the end so far); ST_INVALID otherwise. ST_FULL: disk full,
 * nothing of the batch is stored, the site stays good. Cost: one SHA-256 and one CRC of the
 * payload, one copy into the log. */
ST_MUST_CHECK enum st stream_append(struct site *site, int64_t id,
                                    const struct stream_chunk *chunks, size_t count,
                                    struct errctx *err);

/* Writes into the ledger. `entry`: all but id. Empty or negative ranges are ST_INVALID. */
ST_MUST_CHECK enum st stream_ledger_add(struct site *site, const struct stream_ledger *entry,
                                        struct errctx *err);
ST_MUST_CHECK enum st stream_ledger_list(struct site *site, int64_t stream_id, int64_t after_id,
                                         struct stream_ledger *out_entries, size_t capacity,
                                         size_t *out_count, struct errctx *err);

/* Reads the chunks of a stream in order, from sequence number `first_sequence` on. Many readers may
 * be open at once; close them before the site. Chunks committed meanwhile are seen, also after the
 * end was reached. */
struct stream_reader;
ST_MUST_CHECK enum st stream_reader_open(struct site *site, int64_t id, int64_t first_sequence,
                                         struct stream_reader **out_reader, struct errctx *err);
/* The next chunk; its payload is valid until the next call. ST_NOT_FOUND at the end. ST_DAMAGED,
 * with the chunk named, if the CRC does not match or the bytes do not decompress; the call after
 * that goes on with the next chunk. */
ST_MUST_CHECK enum st stream_reader_next(struct stream_reader *reader,
                                         struct stream_chunk *out_chunk, struct errctx *err);
void stream_reader_close(struct stream_reader *reader); /* takes NULL */

#ifdef __cplusplus
}
#endif
#endif
