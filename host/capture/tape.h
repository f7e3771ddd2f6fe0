/* What one stream has got since the last batch: its bytes, cut into chunks, and its new ledger
 * entries. Stays until the batch that holds it is on the disk. Below the recorder; one thread. */
#ifndef SC_CAPTURE_TAPE_H
#define SC_CAPTURE_TAPE_H

#include "base/st.h"
#include "site/stream.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { TAPE_CHUNKS = 256, TAPE_CHUNK_BYTES = 1 << 20 };

struct tape {
    int64_t stream_id;
    uint8_t *bytes; /* [capacity] */
    size_t size, capacity;
    size_t cut; /* bytes before it belong to chunks, those behind it wait */
    struct stream_chunk chunk[TAPE_CHUNKS];
    size_t chunk_at[TAPE_CHUNKS]; /* where in bytes */
    size_t chunks;
    int64_t next_item;            /* lowest number that the next item may have */
    struct stream_ledger *ledger; /* malloc'ed, grows */
    size_t entries, entry_capacity;
};

/* Adds the stream to the site. */
ST_MUST_CHECK enum st tape_open(struct tape *tape, struct site *site, const struct stream *stream,
                                size_t capacity, struct errctx *err);
void tape_fini(struct tape *tape); /* takes a zeroed one */

/* The `size` bytes at `cut` are `items` items (0 or 1) with number `item`, host time t. They go
 * into the last chunk, or a new one if that is full. False: no more chunks, commit first. */
bool tape_cut(struct tape *tape, size_t size, int64_t item, int64_t items, int64_t t_ns);

/* Copies an item in and cuts it; false if there is no room. */
bool tape_put(struct tape *tape, const void *bytes, size_t size, int64_t item, int64_t t_ns);

/* Items [first, end) are missing. Joined with the entry before where both are one range. */
ST_MUST_CHECK enum st tape_miss(struct tape *tape, int64_t first_item, int64_t end_item,
                                int64_t t_ns, const char *reason);

/* Adds all to the open batch; tape_clear() once it is committed. */
ST_MUST_CHECK enum st tape_store(struct tape *tape, struct site *site, struct errctx *err);
/* Payload that tape_store() would store. */
size_t tape_bytes(const struct tape *tape);
void tape_clear(struct tape *tape);

#ifdef __cplusplus
}
#endif
#endif
