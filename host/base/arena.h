/* Arena: allocations from one block that the caller owns, given back all at once. An arena is a
 * checkpoint away from empty: mark before scratch work, rewind after it. Not thread-safe: one arena
 * a thread. */
#ifndef SC_BASE_ARENA_H
#define SC_BASE_ARENA_H

#include "base/st.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Alignment of every allocation: a cache line, enough for any vector register. */
enum { ARENA_ALIGN_BYTES = 64 };

struct arena {
    unsigned char *block;
    size_t size_bytes, used_bytes;
    size_t peak_bytes; /* most that was ever in use: for sizing the block */
    size_t refused;    /* allocations that did not fit */
};

/* Takes a block of any alignment; at most ARENA_ALIGN_BYTES - 1 bytes of it are lost to alignment.
 * NULL with size 0 is an arena that has no room. */
void arena_init(struct arena *arena, void *block, size_t size_bytes);

/* Room for count elements of elem_bytes each, not zeroed. NULL if it does not fit or the product
 * overflows; count or elem_bytes 0 gives a valid pointer to nothing. Constant time, real-time safe.
 */
void *arena_alloc(struct arena *arena, size_t count, size_t elem_bytes);

/* The same, zeroed. */
void *arena_zalloc(struct arena *arena, size_t count, size_t elem_bytes);

/* The same as arena_alloc() for code that reports: ST_NOMEM names what did not fit and by how much.
 */
ST_MUST_CHECK enum st arena_take(struct arena *arena, size_t count, size_t elem_bytes,
                                 const char *what, void **out_p, struct errctx *err);

/* A checkpoint, and back to it: everything allocated since is gone. Marks nest. */
struct arena_mark {
    size_t used_bytes;
};
struct arena_mark arena_mark(const struct arena *arena);
void arena_rewind(struct arena *arena, struct arena_mark mark);

/* Typed allocation: float *v = ARENA_NEW(&arena, float, n); */
#define ARENA_NEW(arena, type, count) ((type *)arena_alloc((arena), (count), sizeof(type)))

#ifdef __cplusplus
}
#endif
#endif
