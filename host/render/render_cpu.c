/* The portable renderer: the rasteriser, one pass a primitive, merged by depth. */
#include "render/render_impl.h"
#include "render/render_plane.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct render_cpu {
    struct renderer base;
    struct raster_scratch scratch;
    /* Buffers that grow and are reused. */
    struct tile *tiles;
    struct raster_input *inputs;
    size_t tiles_room, inputs_room;
    uint8_t *rgba[2];
    float *depth[2];
    size_t pixels_room;
};

static enum st grow_items(struct render_cpu *r, size_t count, struct errctx *err) {
    if (count <= r->tiles_room)
        return ST_OK;
    size_t room = count + count / 2 + 64;
    free(r->tiles);
    free(r->inputs);
    r->tiles = malloc(room * sizeof *r->tiles);
    r->inputs = malloc(room * sizeof *r->inputs);
    r->tiles_room = r->inputs_room = r->tiles && r->inputs ? room : 0;
    return r->tiles_room ? ST_OK : errctx_set(err, ST_NOMEM, "no memory for %zu tiles", count);
}

static enum st grow_pixels(struct render_cpu *r, size_t count, struct errctx *err) {
    if (count <= r->pixels_room)
        return ST_OK;
    r->pixels_room = count;
    for (int i = 0; i < 2; i++) {
        free(r->rgba[i]);
        free(r->depth[i]);
        r->rgba[i] = malloc(4 * count);
        r->depth[i] = malloc(count * sizeof(float));
        if (!r->rgba[i] || !r->depth[i])
            r->pixels_room = 0;
    }
    return r->pixels_room ? ST_OK : errctx_set(err, ST_NOMEM, "no memory for %zu pixels", count);
}

/* Copies the items of one primitive into inputs of the rasteriser, one a photograph. */
static size_t gather(struct render_cpu *r, const struct render_frame *frame,
                     enum render_primitive primitive) {
    size_t inputs = 0, tiles = 0;
    for (size_t i = 0; i < frame->item_count; i++) {
        const struct render_item *item = &frame->items[i];
        if (item->primitive != primitive)
            continue;
        if (!inputs || r->inputs[inputs - 1].id != item->input)
            r->inputs[inputs++] =
                (struct raster_input){.tiles = r->tiles + tiles, .id = item->input};
        r->tiles[tiles++] = *item->tile;
        r->inputs[inputs - 1].tile_count++;
    }
    return inputs;
}

/* The pixel that wins: surfaces before the unknown, then the nearer, then the larger colour. */
static bool wins(const uint8_t *rgba, float depth, const uint8_t *old_rgba, float old_depth) {
    bool mine = rgba[3] == RASTER_ALPHA_SURFACE, old = old_rgba[3] == RASTER_ALPHA_SURFACE;
    if (rgba[3] == RASTER_ALPHA_NOTHING || mine != old)
        return mine && !old ? true : rgba[3] != 0 && old_rgba[3] == 0;
    if (depth != old_depth)
        return depth > old_depth;
    return memcmp(rgba, old_rgba, 3) > 0;
}

static void merge(const struct raster_target *part, const struct raster_target *all) {
    int64_t n = (int64_t)all->width_px * all->height_px;
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < n; i++)
        if (wins(part->rgba + 4 * i, part->depth[i], all->rgba + 4 * i, all->depth[i])) {
            memcpy(all->rgba + 4 * i, part->rgba + 4 * i, 4);
            all->depth[i] = part->depth[i];
        }
}

static void draw_planes(const struct render_frame *frame, const struct raster_target *all) {
    enum { BAND_PX = 32 };
    int32_t bands = (all->height_px + BAND_PX - 1) / BAND_PX;
#pragma omp parallel for schedule(dynamic, 1)
    for (int32_t b = 0; b < bands; b++) {
        int32_t y0 = b * BAND_PX,
                y1 = y0 + BAND_PX < all->height_px ? y0 + BAND_PX : all->height_px;
        for (size_t i = 0; i < frame->item_count; i++)
            if (frame->items[i].primitive == RENDER_PLANE)
                render_plane_draw(&frame->items[i], frame->view, frame->options, y0, y1, all);
    }
}

static const enum raster_primitive raster_of[3] = {RASTER_POINTS, RASTER_SPLATS, RASTER_MESH};

static enum st draw_pass(struct render_cpu *r, const struct render_frame *frame,
                         enum render_primitive primitive, const struct raster_target *target,
                         struct render_stats *stats, struct errctx *err) {
    struct raster_options options = *frame->options;
    struct raster_stats drawn;
    options.primitive = raster_of[primitive];
    size_t inputs = gather(r, frame, primitive);
    enum st st =
        raster_draw(r->inputs, inputs, frame->view, &options, target, &r->scratch, &drawn, err);
    if (st)
        return st;
    stats->tiles_drawn += drawn.tiles_total - drawn.tiles_rejected;
    stats->tiles_by_primitive[primitive] += drawn.tiles_total - drawn.tiles_rejected;
    stats->samples_drawn += drawn.samples_drawn;
    return ST_OK;
}

static void count_items(const struct render_frame *frame, size_t count[RENDER_PRIMITIVES]) {
    for (size_t i = 0; i < frame->item_count; i++)
        count[frame->items[i].primitive]++;
}

static enum st cpu_draw(struct renderer *renderer, const struct render_frame *frame,
                        const struct raster_target *target, struct render_stats *stats,
                        struct errctx *err) {
    struct render_cpu *r = (struct render_cpu *)renderer;
    size_t count[RENDER_PRIMITIVES] = {0};
    size_t n = (size_t)target->width_px * (size_t)target->height_px;
    count_items(frame, count);
    enum st st = grow_items(r, frame->item_count + 1, err);
    int passes = (count[RENDER_POINTS] > 0) + (count[RENDER_SPLATS] > 0) + (count[RENDER_MESH] > 0);
    bool merging = passes > 1 || count[RENDER_PLANE] > 0;
    struct raster_target all = *target, part = all;
    if (!st && merging) {
        st = grow_pixels(r, n, err);
        all.rgba = target->rgba ? target->rgba : r->rgba[1];
        all.depth = target->depth ? target->depth : r->depth[1];
        part.rgba = r->rgba[0];
        part.depth = r->depth[0];
    }
    bool first = true;
    for (int p = RENDER_POINTS; !st && p <= RENDER_MESH; p++) {
        bool clears = first && (p == RENDER_MESH || count[p]); /* an empty pass clears, too */
        if (!count[p] && !clears)
            continue;
        st = draw_pass(r, frame, (enum render_primitive)p, first ? &all : &part, stats, err);
        if (!st && !first)
            merge(&part, &all);
        first = false;
    }
    if (st || !count[RENDER_PLANE])
        return st;
    if (frame->options->skins != RASTER_SKINS_ONLY) {
        draw_planes(frame, &all);
        stats->tiles_drawn += (int64_t)count[RENDER_PLANE];
        stats->tiles_by_primitive[RENDER_PLANE] += (int64_t)count[RENDER_PLANE];
    }
    return ST_OK;
}

static void cpu_lose_context(struct renderer *renderer) {
    (void)renderer; /* has none */
}

static void cpu_destroy(struct renderer *renderer) {
    struct render_cpu *r = (struct render_cpu *)renderer;
    raster_scratch_fini(&r->scratch);
    free(r->tiles);
    free(r->inputs);
    for (int i = 0; i < 2; i++) {
        free(r->rgba[i]);
        free(r->depth[i]);
    }
    free(r);
}

static const struct render_ops cpu_ops = {cpu_draw, cpu_lose_context, cpu_destroy};

enum st render_cpu_create(struct renderer **out_renderer, struct errctx *err) {
    struct render_cpu *r = calloc(1, sizeof *r);
    if (!r)
        return errctx_set(err, ST_NOMEM, "no memory for a renderer");
    r->base = (struct renderer){.ops = &cpu_ops, .kind = RENDER_CPU};
    (void)snprintf(r->base.description, sizeof r->base.description, "cpu: portable rasteriser");
    *out_renderer = &r->base;
    return ST_OK;
}
