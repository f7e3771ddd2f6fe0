#include "capture/source.h"

#include <stdlib.h>
#include <string.h>

enum {
    TRANSFERS_MIN = 1 << 12,
    TRANSFER_BYTES = 512, /* a ring full of packets that came one by one has room for all */
    RING_MIN_BYTES = 1 << 18,
    RING_MAX_BYTES = 1 << 28
};

/* ---- the head: real-time path ---- */

/* Copies into the ring's room, which is large enough. */
static void fill(struct ring_regions room, const uint8_t *bytes, size_t size) {
    size_t first = size < room.first_count ? size : room.first_count;
    memcpy(room.first, bytes, first);
    if (size > first)
        memcpy(room.second, bytes + first, size - first);
}

static void take_bytes(void *ctx, const uint8_t *bytes, size_t size, int64_t t_host_ns) {
    struct source_head *s = ctx;
    struct ring_regions room = ring_room(&s->bytes), records = ring_room(&s->transfers);
    if (!size)
        return;
    s->transfers_total++;
    if (size > room.first_count + room.second_count || !records.first_count) {
        s->refused++;
        s->refused_total++;
        return;
    }
    struct source_transfer *record = records.first;
    *record = (struct source_transfer){t_host_ns, (uint32_t)size, s->refused};
    s->refused = 0;
    fill(room, bytes, size);
    ring_publish(&s->bytes, size);
    ring_publish(&s->transfers, 1);
}

/* ---- the lines: real-time path ---- */

static void take_edge(void *ctx, const struct edge_record *edge) {
    struct source_lines *s = ctx;
    (void)ring_push(&s->edges, edge, 1); /* the ring counts what it refuses */
}

/* ---- the recorder's side ---- */

bool source_head_take(struct source_head *source, uint8_t *out_bytes, size_t capacity,
                      struct source_transfer *out_transfer) {
    memset(out_transfer, 0, sizeof *out_transfer);
    struct ring_regions records = ring_waiting(&source->transfers);
    if (!records.first_count)
        return false;
    memcpy(out_transfer, records.first, sizeof *out_transfer);
    if (out_transfer->size > capacity)
        return false;
    size_t got = ring_pop(&source->bytes, out_bytes, out_transfer->size);
    ring_release(&source->transfers, 1);
    return got == out_transfer->size;
}

uint32_t source_head_refused_at_end(const struct source_head *source) {
    return source->refused;
}

double source_head_peak(const struct source_head *source) {
    return (double)ring_peak(&source->bytes) / ((double)source->bytes.mask + 1);
}

/* ---- before and after ---- */

static size_t power_of_two(double at_least) {
    size_t size = RING_MIN_BYTES;
    while ((double)size < at_least && size < RING_MAX_BYTES)
        size *= 2;
    return size;
}

enum st source_head_init(struct source_head *source, double bytes_per_s, double seconds,
                         struct errctx *err) {
    memset(source, 0, sizeof *source);
    size_t size = power_of_two(bytes_per_s * seconds);
    size_t count = size / TRANSFER_BYTES > TRANSFERS_MIN ? size / TRANSFER_BYTES : TRANSFERS_MIN;
    size_t records = count * sizeof(struct source_transfer);
    source->memory = malloc(size + records);
    if (!source->memory)
        return errctx_set(err, ST_NOMEM, "no memory for the head's ring of %zu bytes", size);
    memset(source->memory, 0, size + records); /* the pages are there before the first packet */
    enum st st =
        ring_init(&source->transfers, source->memory, count, sizeof(struct source_transfer));
    if (!st)
        st = ring_init(&source->bytes, (uint8_t *)source->memory + records, size, 1);
    source->sink = (struct head_sink){source, take_bytes};
    return st ? errctx_set(err, ST_INTERNAL, "the head's ring cannot be made") : ST_OK;
}

void source_head_fini(struct source_head *source) {
    free(source->memory);
    memset(source, 0, sizeof *source);
}

enum st source_lines_init(struct source_lines *source, size_t capacity, struct errctx *err) {
    memset(source, 0, sizeof *source);
    source->memory = calloc(capacity, sizeof(struct edge_record));
    if (!source->memory)
        return errctx_set(err, ST_NOMEM, "no memory for the ring of line edges");
    source->sink = (struct lines_sink){source, take_edge};
    return ring_init(&source->edges, source->memory, capacity, sizeof(struct edge_record))
               ? errctx_set(err, ST_INTERNAL, "the ring of line edges cannot be made")
               : ST_OK;
}

void source_lines_fini(struct source_lines *source) {
    free(source->memory);
    memset(source, 0, sizeof *source);
}
