#include "capture/tape.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum st tape_open(struct tape *tape, struct site *site, const struct stream *stream,
                  size_t capacity, struct errctx *err) {
    memset(tape, 0, sizeof *tape);
    tape->bytes = malloc(capacity);
    if (!tape->bytes)
        return errctx_set(err, ST_NOMEM, "no memory to record '%s'", stream->kind);
    tape->capacity = capacity;
    memset(tape->bytes, 0, capacity); /* the pages are there before they are needed */
    return stream_add(site, stream, &tape->stream_id, err);
}

void tape_fini(struct tape *tape) {
    free(tape->bytes);
    free(tape->ledger);
    memset(tape, 0, sizeof *tape);
}

/* The chunk that takes `size` bytes more; NULL: there is none left. */
static struct stream_chunk *chunk_for(struct tape *t, size_t size, int64_t item, int64_t t_ns) {
    struct stream_chunk *last = t->chunks ? &t->chunk[t->chunks - 1] : NULL;
    if (last && last->size_bytes + size <= TAPE_CHUNK_BYTES)
        return last;
    if (t->chunks == TAPE_CHUNKS)
        return NULL;
    t->chunk_at[t->chunks] = t->cut;
    struct stream_chunk *fresh = &t->chunk[t->chunks++];
    memset(fresh, 0, sizeof *fresh);
    fresh->first_item = fresh->end_item = last ? last->end_item : item;
    fresh->t_first_ns = fresh->t_last_ns = t_ns;
    return fresh;
}

bool tape_cut(struct tape *tape, size_t size, int64_t item, int64_t items, int64_t t_ns) {
    struct stream_chunk *c = chunk_for(tape, size, item, t_ns);
    if (!c)
        return false;
    c->size_bytes += size;
    c->t_first_ns = t_ns < c->t_first_ns ? t_ns : c->t_first_ns;
    c->t_last_ns = t_ns > c->t_last_ns ? t_ns : c->t_last_ns;
    c->item_count += items;
    if (items && item + items > c->end_item)
        c->end_item = item + items;
    if (c->end_item > tape->next_item)
        tape->next_item = c->end_item;
    tape->cut += size;
    return true;
}

bool tape_put(struct tape *tape, const void *bytes, size_t size, int64_t item, int64_t t_ns) {
    if (tape->cut + size > tape->capacity)
        return false;
    memcpy(tape->bytes + tape->cut, bytes, size);
    if (!tape_cut(tape, size, item, 1, t_ns))
        return false;
    tape->size = tape->cut;
    return true;
}

enum st tape_miss(struct tape *tape, int64_t first_item, int64_t end_item, int64_t t_ns,
                  const char *reason) {
    struct stream_ledger *last = tape->entries ? &tape->ledger[tape->entries - 1] : NULL;
    if (end_item > tape->next_item)
        tape->next_item = end_item;
    if (last && last->end_item == first_item && !strcmp(last->reason, reason)) {
        last->end_item = end_item;
        return ST_OK;
    }
    if (tape->entries == tape->entry_capacity) {
        size_t capacity = tape->entry_capacity ? 2 * tape->entry_capacity : 64;
        struct stream_ledger *grown = realloc(tape->ledger, capacity * sizeof *grown);
        if (!grown)
            return ST_NOMEM;
        tape->ledger = grown;
        tape->entry_capacity = capacity;
    }
    struct stream_ledger *entry = &tape->ledger[tape->entries++];
    memset(entry, 0, sizeof *entry);
    entry->stream_id = tape->stream_id;
    entry->first_item = first_item;
    entry->end_item = end_item;
    entry->t_ns = t_ns;
    (void)snprintf(entry->reason, sizeof entry->reason, "%s", reason);
    return ST_OK;
}

enum st tape_store(struct tape *tape, struct site *site, struct errctx *err) {
    enum st st = ST_OK;
    for (size_t i = 0; i < tape->entries && !st; i++)
        st = stream_ledger_add(site, &tape->ledger[i], err);
    for (size_t i = 0; i < tape->chunks; i++)
        tape->chunk[i].payload = tape->bytes + tape->chunk_at[i];
    if (!st && tape->chunks)
        st = stream_append(site, tape->stream_id, tape->chunk, tape->chunks, err);
    return st;
}

size_t tape_bytes(const struct tape *tape) {
    return tape->cut;
}

void tape_clear(struct tape *tape) {
    memmove(tape->bytes, tape->bytes + tape->cut, tape->size - tape->cut);
    tape->size -= tape->cut;
    tape->cut = 0;
    tape->chunks = 0;
    tape->entries = 0;
}
