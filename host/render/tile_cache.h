/* Tiles in memory: a bounded cache in front of a source (a tile pack, photographs in memory).
 *
 * Segmented least recently used: what was asked for once is on probation and goes first; what was
 * asked for again in a later frame is protected, up to four fifths of the room. The coarsest levels
 * are kept for good (up to an eighth of the room), so that there is always something to show. */
#ifndef SC_RENDER_TILE_CACHE_H
#define SC_RENDER_TILE_CACHE_H

#include "base/photo.h"
#include "base/st.h"
#include "base/tile_pack.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Where tiles come from. The index outlives the cache. */
struct tile_source {
    const struct tile_pack_index *index;
    /* Reads one node; any number of threads may call it at once. */
    enum st (*read)(const void *self, int64_t node, struct tile_samples *out_samples,
                    struct errctx *err);
    const void *self;
};

/* A tile in memory. */
struct tile_slot {
    struct tile_samples samples;
    uint8_t shaded[3 * TILE_CODE_SAMPLES]; /* colours of the layer shown */
    struct tile tile;                      /* over `samples`, its rgb over `shaded` */
    float plane[3];
    bool is_plane;
    int layer; /* that `shaded` shows; -1: none yet */
    uint32_t version;
    int64_t node;          /* -1: free */
    int64_t frame;         /* it was last asked for in */
    int32_t before, after; /* in its list */
    int8_t list;
};

struct tile_cache;

ST_MUST_CHECK enum st tile_cache_create(const struct tile_source *source, size_t bytes,
                                        struct tile_cache **out_cache, struct errctx *err);
void tile_cache_destroy(struct tile_cache *cache); /* takes NULL */

/* Begins a frame: what is asked for from now on cannot be pushed out before the next one. */
void tile_cache_begin(struct tile_cache *cache);

/* The tile if it is in memory, else NULL; counts as use. */
struct tile_slot *tile_cache_get(struct tile_cache *cache, int64_t node);

/* Reads nodes in the order given, until `budget_s` seconds are over; at least a few. Nodes that
 * cannot be read are damaged from then on: they are not asked for again. Returns how many came. */
int32_t tile_cache_load(struct tile_cache *cache, const int64_t *nodes, int32_t count,
                        double budget_s);

struct tile_cache_stats {
    int64_t resident, capacity, bytes; /* tiles, tiles, bytes of both */
    int64_t loaded, evicted, damaged;  /* since the beginning */
    char damage[200];                  /* the first thing that was wrong; "" */
};
struct tile_cache_stats tile_cache_get_stats(const struct tile_cache *cache);
/* Was the node found damaged? */
bool tile_cache_is_damaged(const struct tile_cache *cache, int64_t node);

#ifdef __cplusplus
}
#endif
#endif
