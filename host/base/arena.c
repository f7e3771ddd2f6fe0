#include "base/arena.h"

#include <assert.h>
#include <string.h>

void arena_init(struct arena *arena, void *block, size_t size_bytes) {
    *arena = (struct arena){.block = block, .size_bytes = block ? size_bytes : 0};
}

void *arena_alloc(struct arena *arena, size_t count, size_t elem_bytes) {
    size_t bytes;
    if (!arena->block || __builtin_mul_overflow(count, elem_bytes, &bytes)) {
        arena->refused++;
        return NULL;
    }
    uintptr_t at = (uintptr_t)arena->block + arena->used_bytes;
    size_t pad = (size_t)(-at & (ARENA_ALIGN_BYTES - 1));
    size_t left = arena->size_bytes - arena->used_bytes;
    if (pad > left || bytes > left - pad) {
        arena->refused++;
        return NULL;
    }
    void *p = arena->block + arena->used_bytes + pad;
    arena->used_bytes += pad + bytes;
    if (arena->used_bytes > arena->peak_bytes)
        arena->peak_bytes = arena->used_bytes;
    return p;
}

void *arena_zalloc(struct arena *arena, size_t count, size_t elem_bytes) {
    void *p = arena_alloc(arena, count, elem_bytes);
    if (p)
        memset(p, 0, count * elem_bytes);
    return p;
}

enum st arena_take(struct arena *arena, size_t count, size_t elem_bytes, const char *what,
                   void **out_p, struct errctx *err) {
    void *p = arena_alloc(arena, count, elem_bytes);
    if (!p)
        return errctx_set(err, ST_NOMEM, "no room for %s: %zu x %zu bytes asked, %zu of %zu left",
                          what, count, elem_bytes, arena->size_bytes - arena->used_bytes,
                          arena->size_bytes);
    *out_p = p;
    return ST_OK;
}

struct arena_mark arena_mark(const struct arena *arena) {
    struct arena_mark mark = {arena->used_bytes};
    return mark;
}

void arena_rewind(struct arena *arena, struct arena_mark mark) {
    assert(mark.used_bytes <= arena->used_bytes); /* an outer mark was rewound before this one */
    arena->used_bytes = mark.used_bytes;
}
