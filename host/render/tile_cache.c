#include "render/tile_cache.h"

#include "base/clock.h"

#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LIST_FREE, LIST_PROBATION, LIST_PROTECTED, LIST_KEPT, LISTS };
enum { NO_SLOT = -1, DAMAGED = -2, BATCH = 32 };

struct list {
    int32_t first, last; /* most recently used first */
    int32_t count;
};

struct tile_cache {
    struct tile_source source;
    struct tile_slot *slots;
    int32_t capacity;
    int32_t *slot_of; /* [node_count]: slot, NO_SLOT or DAMAGED */
    struct list lists[LISTS];
    int64_t frame;
    int32_t kept_level; /* this level of the pyramid and coarser ones stay */
    struct tile_cache_stats stats;
};

/* ---- lists ---- */

static void unlink_slot(struct tile_cache *c, int32_t i) {
    struct tile_slot *s = &c->slots[i];
    struct list *l = &c->lists[s->list];
    if (s->before >= 0)
        c->slots[s->before].after = s->after;
    else
        l->first = s->after;
    if (s->after >= 0)
        c->slots[s->after].before = s->before;
    else
        l->last = s->before;
    l->count--;
}

static void push_front(struct tile_cache *c, int32_t i, int8_t list) {
    struct tile_slot *s = &c->slots[i];
    struct list *l = &c->lists[list];
    s->list = list;
    s->before = -1;
    s->after = l->first;
    if (l->first >= 0)
        c->slots[l->first].before = i;
    else
        l->last = i;
    l->first = i;
    l->count++;
}

static void move(struct tile_cache *c, int32_t i, int8_t list) {
    unlink_slot(c, i);
    push_front(c, i, list);
}

/* ---- life ---- */

/* Tiles of the levels counted from the coarsest: as many levels as fit an eighth of the room. */
static int32_t choose_kept_level(const struct tile_cache *c) {
    const struct tile_pack_index *index = c->source.index;
    int64_t sum = 0;
    int32_t level = TILE_PACK_MAX_LEVELS;
    while (level > 0) {
        int64_t here = 0;
        for (int32_t p = 0; p < index->photo_count; p++) {
            int32_t x, y;
            if (level - 1 >= index->photos[p].level_count)
                continue;
            tile_pack_tiles(&index->photos[p].camera, level - 1, &x, &y);
            here += (int64_t)x * y;
        }
        if (sum + here > c->capacity / 8)
            break;
        sum += here;
        level--;
    }
    return level;
}

enum st tile_cache_create(const struct tile_source *source, size_t bytes,
                          struct tile_cache **out_cache, struct errctx *err) {
    enum { CAPACITY_MIN = 256 };
    struct tile_cache *c = calloc(1, sizeof *c);
    if (!c)
        return errctx_set(err, ST_NOMEM, "no memory for a cache");
    c->source = *source;
    int64_t nodes = source->index->node_count;
    int64_t wanted = (int64_t)(bytes / sizeof(struct tile_slot));
    wanted = wanted < nodes ? wanted : nodes;
    wanted = wanted > CAPACITY_MIN ? wanted : CAPACITY_MIN;
    c->capacity = (int32_t)wanted;
    c->slots = malloc((size_t)wanted * sizeof *c->slots);
    c->slot_of = malloc((size_t)(nodes + 1) * sizeof *c->slot_of);
    if (!c->slots || !c->slot_of) {
        tile_cache_destroy(c);
        return errctx_set(err, ST_NOMEM, "no memory for a cache of %lld tiles", (long long)wanted);
    }
    for (int64_t i = 0; i < nodes; i++)
        c->slot_of[i] = NO_SLOT;
    for (int i = 0; i < LISTS; i++)
        c->lists[i].first = c->lists[i].last = -1;
    for (int32_t i = c->capacity - 1; i >= 0; i--) {
        c->slots[i].node = -1;
        c->slots[i].version = 0;
        push_front(c, i, LIST_FREE);
    }
    c->kept_level = choose_kept_level(c);
    c->stats.capacity = c->capacity;
    *out_cache = c;
    return ST_OK;
}

void tile_cache_destroy(struct tile_cache *cache) {
    if (!cache)
        return;
    free(cache->slots);
    free(cache->slot_of);
    free(cache);
}

void tile_cache_begin(struct tile_cache *cache) {
    cache->frame++;
}

struct tile_slot *tile_cache_get(struct tile_cache *c, int64_t node) {
    int32_t i = c->slot_of[node];
    if (i < 0)
        return NULL;
    struct tile_slot *s = &c->slots[i];
    if (s->frame == c->frame)
        return s;
    s->frame = c->frame;
    if (s->list == LIST_KEPT)
        return s;
    move(c, i, LIST_PROTECTED);
    struct list *protected_list = &c->lists[LIST_PROTECTED];
    if (protected_list->count > c->capacity / 5 * 4 && protected_list->last != i)
        move(c, protected_list->last, LIST_PROBATION);
    return s;
}

/* ---- loading ---- */

/* A slot to fill; -1 if every tile is needed by this frame. */
static int32_t take_slot(struct tile_cache *c) {
    static const int8_t order[3] = {LIST_FREE, LIST_PROBATION, LIST_PROTECTED};
    for (int k = 0; k < 3; k++) {
        int32_t i = c->lists[order[k]].last;
        if (i < 0 || (order[k] != LIST_FREE && c->slots[i].frame == c->frame))
            continue;
        if (c->slots[i].node >= 0) {
            c->slot_of[c->slots[i].node] = NO_SLOT;
            c->slots[i].node = -1;
            c->stats.evicted++;
            c->stats.resident--;
        }
        unlink_slot(c, i);
        return i;
    }
    return -1;
}

/* The photograph, level and place of a node. */
struct place {
    const struct tile_pack_photo *photo;
    int32_t level, i, j;
};

static struct place place_of(const struct tile_pack_index *index, int64_t node) {
    int32_t lo = 0, hi = index->photo_count - 1;
    struct place out = {index->photos, 0, 0, 0};
    while (lo < hi) { /* photographs are in the order of their first nodes */
        int32_t mid = (lo + hi + 1) / 2;
        if (index->photos[mid].first_node[0] <= node)
            lo = mid;
        else
            hi = mid - 1;
    }
    out.photo = &index->photos[lo];
    while (out.level + 1 < out.photo->level_count && out.photo->first_node[out.level + 1] <= node)
        out.level++;
    int32_t x = 1, y = 1;
    tile_pack_tiles(&out.photo->camera, out.level, &x, &y);
    int64_t at = node - out.photo->first_node[out.level];
    out.i = (int32_t)(at % x);
    out.j = (int32_t)(at / x);
    return out;
}

/* Skins between a surface and the sky reach to infinity and would hide everything: they are taken
 * for seen through. What hides behind a surface in front of another one stays unknown. */
static void drop_sky_skins(struct tile_samples *t) {
    for (int32_t v = 0; v + 1 < t->height; v++)
        for (int32_t u = 0; u + 1 < t->width; u++) {
            int32_t at = v * t->width + u;
            const float *a = t->disparity_per_m + at, *b = a + t->width;
            if (t->flags[at] & PHOTO_SKIN &&
                (a[0] == 0.0f || a[1] == 0.0f || b[0] == 0.0f || b[1] == 0.0f))
                t->flags[at] |= PHOTO_SKIN_DISPROVED;
        }
}

static void slot_ready(struct tile_cache *c, int32_t i, int64_t node) {
    struct tile_slot *s = &c->slots[i];
    const struct tile_pack_index *index = c->source.index;
    struct place p = place_of(index, node);
    drop_sky_skins(&s->samples);
    s->tile = tile_pack_tile(p.photo, p.level, p.i, p.j, &s->samples);
    s->tile.rgb = s->shaded;
    double chi2, worst;
    s->is_plane = index->nodes[node].kind == TILE_PACK_PLANE &&
                  tile_code_plane(&s->samples, s->plane, &chi2, &worst) > 2;
    s->layer = -1;
    s->version++;
    s->node = node;
    s->frame = c->frame;
    c->slot_of[node] = i;
    push_front(c, i, p.level >= c->kept_level ? LIST_KEPT : LIST_PROBATION);
    c->stats.loaded++;
    c->stats.resident++;
}

struct fetch {
    int32_t slot;
    int64_t node;
    enum st st;
    struct errctx err;
};

static int32_t fetch_batch(struct tile_cache *c, struct fetch *fetches, int32_t count) {
    int32_t came = 0;
#pragma omp parallel for schedule(dynamic, 1) if (count > 4)
    for (int32_t k = 0; k < count; k++)
        fetches[k].st = c->source.read(c->source.self, fetches[k].node,
                                       &c->slots[fetches[k].slot].samples, &fetches[k].err);
    for (int32_t k = 0; k < count; k++) {
        if (!fetches[k].st) {
            slot_ready(c, fetches[k].slot, fetches[k].node);
            came++;
            continue;
        }
        push_front(c, fetches[k].slot, LIST_FREE);
        c->slot_of[fetches[k].node] = DAMAGED;
        if (!c->stats.damaged++)
            (void)snprintf(c->stats.damage, sizeof c->stats.damage, "%.190s", fetches[k].err.text);
    }
    return came;
}

int32_t tile_cache_load(struct tile_cache *c, const int64_t *nodes, int32_t count,
                        double budget_s) {
    int64_t end_ns = clock_now_ns() + (int64_t)(budget_s * 1e9);
    struct fetch fetches[BATCH];
    int32_t came = 0, at = 0;
    while (at < count && (at == 0 || clock_now_ns() < end_ns)) {
        int32_t n = 0;
        bool full = false;
        for (; n < BATCH && at < count && !full; at++) {
            if (c->slot_of[nodes[at]] != NO_SLOT)
                continue;
            int32_t slot = take_slot(c);
            full = slot < 0;
            if (!full) {
                memset(&fetches[n].err, 0, sizeof fetches[n].err);
                fetches[n].slot = slot;
                fetches[n++].node = nodes[at];
            }
        }
        came += fetch_batch(c, fetches, n);
        if (full)
            break;
    }
    return came;
}

struct tile_cache_stats tile_cache_get_stats(const struct tile_cache *cache) {
    struct tile_cache_stats stats = cache->stats;
    stats.bytes = (int64_t)cache->capacity * (int64_t)sizeof(struct tile_slot) +
                  cache->source.index->node_count * (int64_t)sizeof *cache->slot_of;
    return stats;
}

bool tile_cache_is_damaged(const struct tile_cache *cache, int64_t node) {
    return cache->slot_of[node] == DAMAGED;
}
