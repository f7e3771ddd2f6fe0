#include "render/render_blend.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double same_pushes = 2.0, same_share = 1e-4;

struct sum {
    uint64_t weight, rgb[3];
};

struct blend {
    int32_t width_px, height_px;
    size_t pixels;
    uint8_t *rgba;
    float *plain, *pushed, *nearest; /* depths: of one photograph without and with push, of all */
    struct sum *sums;
};

static enum st blend_init(struct blend *b, const struct raster_target *target, struct errctx *err) {
    size_t n = (size_t)target->width_px * (size_t)target->height_px;
    *b = (struct blend){
        target->width_px,          target->height_px,         n,    malloc(4 * n),
        malloc(n * sizeof(float)), malloc(n * sizeof(float)), NULL, calloc(n, sizeof(struct sum))};
    b->nearest = target->depth ? target->depth : malloc(n * sizeof(float));
    if (b->rgba && b->plain && b->pushed && b->nearest && b->sums)
        return ST_OK;
    return errctx_set(err, ST_NOMEM, "no memory to mix photographs in %zu pixels", n);
}

static void blend_fini(struct blend *b, const struct raster_target *target) {
    free(b->rgba);
    free(b->plain);
    free(b->pushed);
    if (b->nearest != target->depth)
        free(b->nearest);
    free(b->sums);
}

/* How much a sample counts, from what one sigma of push-back takes off its depth: an integer, so
 * that sums do not depend on their order. */
static uint32_t weight_of(double depth, double push) {
    static const double most = 16777216.0;
    double relative = push / depth;
    double w = 1.0 / (relative * relative);
    return w < most ? (uint32_t)fmax(w, 1.0) : (uint32_t)most;
}

static void add(struct blend *b) {
#pragma omp parallel for schedule(static)
    for (int64_t i = 0; i < (int64_t)b->pixels; i++) {
        double near = (double)b->nearest[i], depth = (double)b->plain[i];
        double push = depth - (double)b->pushed[i];
        if (b->rgba[4 * i + 3] != RASTER_ALPHA_SURFACE || !(depth > 0.0) || !(push >= 0.0) ||
            near - depth > same_pushes * push + same_share * near)
            continue;
        uint32_t w = weight_of(depth, push);
        b->sums[i].weight += w;
        for (int k = 0; k < 3; k++)
            b->sums[i].rgb[k] += (uint64_t)w * b->rgba[4 * i + k];
    }
}

/* One photograph by itself, twice: what differs is its push-back. */
static enum st draw_one(struct blend *b, struct renderer *renderer,
                        const struct render_frame *frame, struct errctx *err) {
    struct raster_options options = *frame->options;
    struct render_frame one = *frame;
    struct raster_target target = {
        .width_px = b->width_px, .height_px = b->height_px, .rgba = b->rgba, .depth = b->pushed};
    one.options = &options;
    options.skins = RASTER_SKINS_LEAVE_OUT;
    options.push_sigma = 1.0;
    enum st st = render_draw(renderer, &one, &target, NULL, err);
    options.push_sigma = 0.0;
    target.depth = b->plain;
    if (!st)
        st = render_draw(renderer, &one, &target, NULL, err);
    if (!st)
        add(b);
    return st;
}

static void mix(const struct blend *b, const struct raster_target *target) {
    for (size_t i = 0; i < b->pixels; i++) {
        const struct sum *s = &b->sums[i];
        if (target->rgba[4 * i + 3] != RASTER_ALPHA_SURFACE || !s->weight)
            continue;
        for (size_t k = 0; k < 3; k++)
            target->rgba[4 * i + k] = (uint8_t)((s->rgb[k] + s->weight / 2) / s->weight);
    }
}

enum st render_blend_draw(struct renderer *renderer, const struct render_frame *frame,
                          const struct raster_target *target, struct render_stats *out_stats,
                          struct errctx *err) {
    struct blend b;
    struct raster_options options = *frame->options;
    struct render_frame all = *frame;
    enum st st = blend_init(&b, target, err);
    struct raster_target near = *target;
    near.depth = b.nearest;
    options.push_sigma = 0.0;
    all.options = &options;
    if (!st)
        st = render_draw(renderer, &all, &near, out_stats, err);
    for (size_t first = 0; !st && first < frame->item_count;) {
        size_t end = first + 1;
        while (end < frame->item_count && frame->items[end].input == frame->items[first].input)
            end++;
        struct render_frame one = *frame;
        one.items = frame->items + first;
        one.item_count = end - first;
        st = draw_one(&b, renderer, &one, err);
        first = end;
    }
    if (!st)
        mix(&b, target);
    blend_fini(&b, target);
    return st;
}
