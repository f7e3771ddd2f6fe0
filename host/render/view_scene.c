#include "render/view_scene.h"

#include "base/clock.h"
#include "render/render_tile.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double keep_share = 0.8; /* hysteresis: refined stays so down to this share */
static const size_t cache_default_bytes = (size_t)256 << 20;

/* A node of the pyramid that may be drawn. */
struct candidate {
    double error_px; /* of its samples on screen */
    int64_t node;
    int32_t photo, level, i, j;
    struct tile_slot *slot; /* NULL: holds nothing itself, only its children do */
};

struct view_scene {
    struct tile_source source;
    struct tile_cache *cache;
    struct mat3 *world_from_pixel; /* [photo][level]: world from cam times K^-1 */
    struct vec3 *eye_m;            /* [photo] */
    uint32_t *refined;             /* [node]: the last frame that refined it; 0: none */
    uint32_t stamp;                /* this frame */
    struct candidate *heap, *chosen;
    size_t heap_count, heap_room, chosen_count, chosen_room;
    int64_t *wanted;
    size_t wanted_count, wanted_room;
    struct render_item *items;
    size_t items_room;
    bool failed; /* no memory somewhere in this frame */
};

struct view_quality view_quality_default(void) {
    struct view_quality q = {.error_px = 1.0, .tiles_max = 8192, .load_s = 0.010};
    return q;
}

/* ---- life ---- */

static void precompute(struct view_scene *s) {
    const struct tile_pack_index *index = s->source.index;
    for (int32_t p = 0; p < index->photo_count; p++) {
        const struct tile_pack_photo *photo = &index->photos[p];
        struct pose pose = pose_compose(&photo->world_from_station, &photo->station_from_cam);
        s->eye_m[p] = pose.t_m;
        for (int32_t l = 0; l < photo->level_count; l++) {
            struct camera c = tile_pack_camera(&photo->camera, l);
            struct mat3 k = {{1.0 / c.fx_px, 0, -c.cx_px / c.fx_px, 0, 1.0 / c.fy_px,
                              -c.cy_px / c.fy_px, 0, 0, 1}};
            s->world_from_pixel[p * TILE_PACK_MAX_LEVELS + l] = mat3_mul(&pose.r, &k);
        }
    }
}

enum st view_scene_create(const struct tile_source *source, size_t cache_bytes,
                          struct view_scene **out_scene, struct errctx *err) {
    struct view_scene *s = calloc(1, sizeof *s);
    if (!s)
        return errctx_set(err, ST_NOMEM, "no memory for a scene");
    s->source = *source;
    size_t photos = (size_t)source->index->photo_count + 1;
    s->world_from_pixel = malloc(photos * TILE_PACK_MAX_LEVELS * sizeof *s->world_from_pixel);
    s->eye_m = malloc(photos * sizeof *s->eye_m);
    s->refined = calloc((size_t)source->index->node_count + 1, sizeof *s->refined);
    enum st st = ST_OK;
    if (!s->world_from_pixel || !s->eye_m || !s->refined)
        st = errctx_set(err, ST_NOMEM, "no memory for %zu photographs", photos - 1);
    if (!st)
        st = tile_cache_create(source, cache_bytes ? cache_bytes : cache_default_bytes, &s->cache,
                               err);
    if (st) {
        view_scene_destroy(s);
        return st;
    }
    precompute(s);
    *out_scene = s;
    return ST_OK;
}

void view_scene_destroy(struct view_scene *s) {
    if (!s)
        return;
    tile_cache_destroy(s->cache);
    free(s->world_from_pixel);
    free(s->eye_m);
    free(s->refined);
    free(s->heap);
    free(s->chosen);
    free(s->wanted);
    free(s->items);
    free(s);
}

/* ---- the pyramid on screen ---- */

static struct tile bare_tile(const struct view_scene *s, const struct candidate *c) {
    const struct mat3 *r = &s->world_from_pixel[c->photo * TILE_PACK_MAX_LEVELS + c->level];
    struct tile t;
    memset(&t, 0, sizeof t);
    double u0 = c->i * (double)PHOTO_TILE_PX, v0 = c->j * (double)PHOTO_TILE_PX;
    for (int row = 0; row < 3; row++) {
        const double *k = r->m + 3 * row;
        t.m.m[4 * row] = k[0];
        t.m.m[4 * row + 1] = k[1];
        t.m.m[4 * row + 2] = k[0] * u0 + k[1] * v0 + k[2];
    }
    t.m.m[15] = 1.0;
    t.origin_m = s->eye_m[c->photo];
    return t;
}

/* Fills error_px; false: the view cannot see it. A node that holds nothing itself is looked into.
 */
static bool look(const struct view_scene *s, const struct raster_view *view, struct candidate *c) {
    const struct tile_pack_node *node = &s->source.index->nodes[c->node];
    if (node->kind == TILE_PACK_NONE) {
        c->error_px = INFINITY;
        return c->level > 0 && node->flags & TILE_PACK_CULLED;
    }
    struct tile tile = bare_tile(s, c);
    struct render_projection p = render_tile_project(view, &tile);
    struct render_bounds b = {PHOTO_TILE_PX, PHOTO_TILE_PX, (double)node->disparity_min_per_m,
                              (double)node->disparity_max_per_m};
    struct render_extent extent = render_tile_extent(view, &p, &b, 2.0);
    if (node->flags & TILE_PACK_SKY) { /* apart: what lies between surface and sky is not there */
        b.d_lo = b.d_hi = 0.0;
        struct render_extent sky = render_tile_extent(view, &p, &b, 2.0);
        extent.visible = extent.visible || sky.visible;
        extent.sample_px = fmax(extent.sample_px, sky.sample_px);
    }
    c->error_px = extent.sample_px;
    return extent.visible;
}

/* ---- growing arrays ---- */

static bool room(void **array, size_t *have, size_t wanted, size_t each) {
    if (wanted <= *have)
        return true;
    size_t n = wanted + wanted / 2 + 256;
    void *p = realloc(*array, n * each);
    if (!p)
        return false;
    *array = p;
    *have = n;
    return true;
}

static void heap_push(struct view_scene *s, const struct candidate *c) {
    void *heap = s->heap;
    if (!room(&heap, &s->heap_room, s->heap_count + 1, sizeof *s->heap)) {
        s->failed = true;
        return;
    }
    s->heap = heap;
    size_t at = s->heap_count++;
    while (at > 0 && s->heap[(at - 1) / 2].error_px < c->error_px) {
        s->heap[at] = s->heap[(at - 1) / 2];
        at = (at - 1) / 2;
    }
    s->heap[at] = *c;
}

static struct candidate heap_pop(struct view_scene *s) {
    struct candidate top = s->heap[0], last = s->heap[--s->heap_count];
    size_t at = 0;
    for (;;) {
        size_t child = 2 * at + 1;
        if (child >= s->heap_count)
            break;
        if (child + 1 < s->heap_count && s->heap[child + 1].error_px > s->heap[child].error_px)
            child++;
        if (!(s->heap[child].error_px > last.error_px))
            break;
        s->heap[at] = s->heap[child];
        at = child;
    }
    s->heap[at] = last;
    return top;
}

static void want(struct view_scene *s, const struct candidate *c) {
    void *nodes = s->wanted;
    if (!room(&nodes, &s->wanted_room, s->wanted_count + 1, sizeof *s->wanted)) {
        s->failed = true;
        return;
    }
    s->wanted = nodes;
    s->wanted[s->wanted_count++] = c->node;
}

static void choose(struct view_scene *s, const struct candidate *c) {
    void *chosen = s->chosen;
    if (!c->slot)
        return;
    if (!room(&chosen, &s->chosen_room, s->chosen_count + 1, sizeof *s->chosen)) {
        s->failed = true;
        return;
    }
    s->chosen = chosen;
    s->chosen[s->chosen_count++] = *c;
}

/* ---- selection ---- */

/* The children that the view can see; their slots where they are in memory. */
static int children_of(struct view_scene *s, const struct raster_view *view,
                       const struct candidate *parent, struct candidate out[4], int *out_missing) {
    const struct tile_pack_photo *photo = &s->source.index->photos[parent->photo];
    int32_t nx = 0, ny = 0, count = 0;
    tile_pack_tiles(&photo->camera, parent->level - 1, &nx, &ny);
    *out_missing = 0;
    for (int k = 0; k < 4; k++) {
        struct candidate c = {.photo = parent->photo,
                              .level = parent->level - 1,
                              .i = 2 * parent->i + (k & 1),
                              .j = 2 * parent->j + (k >> 1)};
        if (c.i >= nx || c.j >= ny)
            continue;
        c.node = tile_pack_node_at(photo, c.level, c.i, c.j);
        if (!look(s, view, &c))
            continue;
        bool holds = s->source.index->nodes[c.node].kind != TILE_PACK_NONE;
        if (holds && tile_cache_is_damaged(s->cache, c.node)) {
            *out_missing += parent->slot ? 1000 : 0; /* the parent stands in for good */
            continue;
        }
        c.slot = holds ? tile_cache_get(s->cache, c.node) : NULL;
        *out_missing += holds && !c.slot;
        out[count++] = c;
    }
    return count;
}

static void refine(struct view_scene *s, const struct raster_view *view,
                   const struct view_quality *quality, struct candidate *c,
                   struct view_scene_stats *stats) {
    uint32_t before = s->refined[c->node];
    bool was = before && s->stamp - before <= 1;
    double limit = was ? keep_share * quality->error_px : quality->error_px;
    size_t tiles = s->chosen_count + s->heap_count;
    bool must = !c->slot && c->level > 0; /* only its children hold something */
    if (!must &&
        (c->level == 0 || !(c->error_px > limit) || tiles + 4 > (size_t)quality->tiles_max)) {
        choose(s, c);
        stats->error_px = fmax(stats->error_px, c->level ? c->error_px : 0.0);
        return;
    }
    struct candidate child[4];
    int missing = 0, count = children_of(s, view, c, child, &missing);
    stats->visited += 4;
    if (missing && c->slot) {
        for (int k = 0; k < count; k++)
            if (!child[k].slot && s->source.index->nodes[child[k].node].kind != TILE_PACK_NONE)
                want(s, &child[k]);
        choose(s, c);
        stats->error_px = fmax(stats->error_px, c->error_px);
        return;
    }
    s->refined[c->node] = s->stamp;
    for (int k = 0; k < count; k++) {
        bool holds = s->source.index->nodes[child[k].node].kind != TILE_PACK_NONE;
        if (holds && !child[k].slot)
            want(s, &child[k]);
        else
            heap_push(s, &child[k]);
    }
}

static void roots(struct view_scene *s, const struct raster_view *view,
                  struct view_scene_stats *stats) {
    const struct tile_pack_index *index = s->source.index;
    for (int32_t p = 0; p < index->photo_count; p++) {
        int32_t level = index->photos[p].level_count - 1, nx = 0, ny = 0;
        tile_pack_tiles(&index->photos[p].camera, level, &nx, &ny);
        for (int32_t k = 0; k < nx * ny; k++) {
            struct candidate c = {.photo = p, .level = level, .i = k % nx, .j = k / nx};
            c.node = tile_pack_node_at(&index->photos[p], level, c.i, c.j);
            stats->visited++;
            if (!look(s, view, &c))
                continue;
            bool holds = index->nodes[c.node].kind != TILE_PACK_NONE;
            c.slot = holds ? tile_cache_get(s->cache, c.node) : NULL;
            if (holds && !c.slot && !tile_cache_is_damaged(s->cache, c.node))
                want(s, &c);
            else if (c.slot || c.level > 0)
                heap_push(s, &c);
        }
    }
}

/* The cheapest primitive that is as close to the truth as any at that size on screen. Measured
 * (docs/viewer.md): up to splats_px a splat beats the mesh in both, since it closes the gaps beside
 * silhouettes; above it costs more pixels than two triangles and looks coarser. */
static enum render_primitive primitive_of(const struct candidate *c,
                                          const struct view_quality *quality) {
    static const double points_px = 0.35, splats_px = 4.0;
    bool plane = c->slot->is_plane && !quality->skins;
    switch (quality->primitive) {
    case VIEW_POINTS:
        return RENDER_POINTS;
    case VIEW_SPLATS:
        return RENDER_SPLATS;
    case VIEW_MESH:
        return RENDER_MESH;
    case VIEW_PLANES:
        return plane ? RENDER_PLANE : RENDER_MESH;
    case VIEW_AUTO:
        break;
    }
    if (quality->skins)
        return RENDER_MESH;
    if (c->error_px <= points_px)
        return RENDER_POINTS;
    if (c->error_px <= splats_px)
        return RENDER_SPLATS;
    return plane && quality->planes_pay ? RENDER_PLANE : RENDER_MESH;
}

static int by_photo(const void *a, const void *b) {
    const struct candidate *x = a, *y = b;
    if (x->photo != y->photo)
        return x->photo < y->photo ? -1 : 1;
    return x->node < y->node ? -1 : x->node > y->node;
}

static bool make_items(struct view_scene *s, const struct view_quality *quality,
                       struct view_scene_stats *stats) {
    void *items = s->items;
    if (!room(&items, &s->items_room, s->chosen_count + 1, sizeof *s->items))
        return false;
    s->items = items;
    if (s->chosen_count)
        qsort(s->chosen, s->chosen_count, sizeof *s->chosen, by_photo);
    for (size_t i = 0; i < s->chosen_count; i++) {
        const struct candidate *c = &s->chosen[i];
        struct tile_slot *slot = c->slot;
        if (slot->layer != (int)quality->layer) {
            view_layer_shade(quality->layer, &slot->tile, slot->samples.rgb, slot->samples.width,
                             slot->samples.height, slot->shaded);
            slot->layer = (int)quality->layer;
            slot->version++;
        }
        s->items[i] = (struct render_item){.tile = &slot->tile,
                                           .key = (uint64_t)c->node,
                                           .version = slot->version,
                                           .input = (uint32_t)c->photo,
                                           .primitive = primitive_of(c, quality)};
        memcpy(s->items[i].plane, slot->plane, sizeof slot->plane);
        stats->samples += slot->tile.valid_count;
    }
    stats->tiles = (int64_t)s->chosen_count;
    return true;
}

static void select_once(struct view_scene *s, const struct raster_view *view,
                        const struct view_quality *quality, struct view_scene_stats *stats) {
    s->heap_count = s->chosen_count = s->wanted_count = 0;
    stats->error_px = 0.0;
    roots(s, view, stats);
    while (s->heap_count && !s->failed) {
        struct candidate c = heap_pop(s);
        refine(s, view, quality, &c, stats);
    }
}

enum st view_scene_select(struct view_scene *s, const struct raster_view *view,
                          const struct view_quality *quality, const struct render_item **out_items,
                          size_t *out_count, struct view_scene_stats *out_stats,
                          struct errctx *err) {
    int64_t start_ns = clock_now_ns();
    struct view_scene_stats stats;
    memset(&stats, 0, sizeof stats);
    s->failed = false;
    s->stamp++;
    tile_cache_begin(s->cache);
    select_once(s, view, quality, &stats);
    int64_t selected_ns = clock_now_ns();
    int64_t end_ns = selected_ns + (int64_t)(quality->load_s * 1e9);
    /* What has come is used at once: level by level, as long as time is left. */
    while (s->wanted_count && !s->failed) {
        double left_s = 1e-9 * (double)(end_ns - clock_now_ns());
        int32_t came = tile_cache_load(s->cache, s->wanted, (int32_t)s->wanted_count, left_s);
        stats.missing = (int64_t)s->wanted_count - came;
        if (!came)
            break;
        select_once(s, view, quality, &stats);
        stats.missing = (int64_t)s->wanted_count;
        if (clock_now_ns() >= end_ns)
            break;
    }
    stats.load_s = 1e-9 * (double)(clock_now_ns() - selected_ns);
    if (s->failed || !make_items(s, quality, &stats))
        return errctx_set(err, ST_NOMEM, "no memory for the tiles of a frame");
    stats.complete = s->wanted_count == 0;
    stats.select_s = 1e-9 * (double)(clock_now_ns() - start_ns) - stats.load_s;
    stats.cache = tile_cache_get_stats(s->cache);
    *out_items = s->items;
    *out_count = s->chosen_count;
    if (out_stats)
        *out_stats = stats;
    return ST_OK;
}

/* ---- where it is ---- */

static void stretch(const struct view_scene *s, const struct candidate *c, struct vec3 *lo,
                    struct vec3 *hi) {
    const struct tile_pack_node *n = &s->source.index->nodes[c->node];
    struct tile t = bare_tile(s, c);
    const double *m = t.m.m;
    /* Within the nearest hundred metres: a far wall does not say where the site is. */
    double d = fmax((double)n->disparity_min_per_m, 0.01);
    if (n->kind == TILE_PACK_NONE || !(n->disparity_min_per_m <= n->disparity_max_per_m))
        return;
    for (int k = 0; k < 4; k++) {
        double u = k & 1 ? PHOTO_TILE_PX : 0, v = k & 2 ? PHOTO_TILE_PX : 0;
        struct vec3 p =
            vec3_make((m[0] * u + m[1] * v + m[2]) / d, (m[4] * u + m[5] * v + m[6]) / d,
                      (m[8] * u + m[9] * v + m[10]) / d);
        p = vec3_add(p, t.origin_m);
        *lo = vec3_make(fmin(lo->x, p.x), fmin(lo->y, p.y), fmin(lo->z, p.z));
        *hi = vec3_make(fmax(hi->x, p.x), fmax(hi->y, p.y), fmax(hi->z, p.z));
    }
}

void view_scene_place(struct view_scene *s, struct vec3 *out_centre_m, double *out_radius_m) {
    const struct tile_pack_index *index = s->source.index;
    struct vec3 lo = {INFINITY, INFINITY, INFINITY}, hi = {-INFINITY, -INFINITY, -INFINITY};
    for (int32_t p = 0; p < index->photo_count; p++) {
        const struct tile_pack_photo *photo = &index->photos[p];
        struct vec3 e = s->eye_m[p];
        lo = vec3_make(fmin(lo.x, e.x), fmin(lo.y, e.y), fmin(lo.z, e.z));
        hi = vec3_make(fmax(hi.x, e.x), fmax(hi.y, e.y), fmax(hi.z, e.z));
        int32_t level = photo->level_count > 2 ? photo->level_count - 3 : 0, nx = 0, ny = 0;
        tile_pack_tiles(&photo->camera, level, &nx, &ny);
        for (int32_t k = 0; k < nx * ny; k++) {
            struct candidate c = {.photo = p, .level = level, .i = k % nx, .j = k / nx};
            c.node = tile_pack_node_at(photo, level, c.i, c.j);
            stretch(s, &c, &lo, &hi);
        }
    }
    if (!(lo.x <= hi.x)) {
        *out_centre_m = vec3_make(0, 0, 0);
        *out_radius_m = 1.0;
        return;
    }
    *out_centre_m = vec3_scale(vec3_add(lo, hi), 0.5);
    *out_radius_m = fmax(0.5 * vec3_norm(vec3_sub(hi, lo)), 0.1);
}
