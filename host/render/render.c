#include "render/render_impl.h"

#include "base/clock.h"

#include <math.h>
#include <string.h>

const char *render_kind_name(enum render_kind kind) {
    switch (kind) {
    case RENDER_CPU:
        return "cpu";
    case RENDER_GLES30:
        return "gles30";
    case RENDER_GLES31:
        return "gles31";
    }
    return "?";
}

enum st render_create(enum render_kind kind, const struct render_params *params,
                      struct renderer **out_renderer, struct errctx *err) {
    struct render_params all = {.gpu_bytes = (size_t)128 << 20};
    if (params && params->gpu_bytes)
        all = *params;
    if (kind == RENDER_CPU)
        return render_cpu_create(out_renderer, err);
    return render_gles_create(kind, &all, out_renderer, err);
}

void render_destroy(struct renderer *renderer) {
    if (renderer)
        renderer->ops->destroy(renderer);
}

const char *render_describe(const struct renderer *renderer) {
    return renderer->description;
}

enum render_kind render_kind_of(const struct renderer *renderer) {
    return renderer->kind;
}

static enum st check(const struct render_frame *frame, const struct raster_target *target,
                     struct errctx *err) {
    if (target->width_px != frame->view->width_px || target->height_px != frame->view->height_px ||
        target->width_px < 1 || target->height_px < 1)
        return errctx_set(err, ST_INVALID, "a target of %dx%d pixels for a view of %dx%d",
                          (int)target->width_px, (int)target->height_px, (int)frame->view->width_px,
                          (int)frame->view->height_px);
    if (target->item || target->count)
        return errctx_set(err, ST_INVALID, "renderers give colours and depths only");
    return ST_OK;
}

enum st render_draw(struct renderer *renderer, const struct render_frame *frame,
                    const struct raster_target *target, struct render_stats *out_stats,
                    struct errctx *err) {
    int64_t start_ns = clock_now_ns();
    struct render_stats stats;
    memset(&stats, 0, sizeof stats);
    enum st st = check(frame, target, err);
    if (!st)
        st = renderer->ops->draw(renderer, frame, target, &stats, err);
    stats.total_s = 1e-9 * (double)(clock_now_ns() - start_ns);
    if (!st && out_stats)
        *out_stats = stats;
    return st;
}

void render_lose_context(struct renderer *renderer) {
    renderer->ops->lose_context(renderer);
}

size_t render_items_of_inputs(const struct raster_input *inputs, size_t input_count,
                              enum render_primitive primitive, struct render_item *out_items) {
    size_t n = 0;
    for (size_t i = 0; i < input_count; i++)
        for (size_t k = 0; k < inputs[i].tile_count; k++) {
            const struct tile *tile = &inputs[i].tiles[k];
            if (!(tile->disparity_min_per_m <= tile->disparity_max_per_m))
                continue;
            out_items[n++] = (struct render_item){.tile = tile,
                                                  .key = (uint64_t)i << 32 | k,
                                                  .version = 1,
                                                  .input = (uint32_t)i,
                                                  .primitive = primitive};
        }
    return n;
}
