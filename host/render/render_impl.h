/* Private to the renderers: what each of them implements. */
#ifndef SC_RENDER_RENDER_IMPL_H
#define SC_RENDER_RENDER_IMPL_H

#include "render/render.h"

/* All are required and called on the renderer's thread. */
struct render_ops {
    enum st (*draw)(struct renderer *renderer, const struct render_frame *frame,
                    const struct raster_target *target, struct render_stats *stats,
                    struct errctx *err);
    void (*lose_context)(struct renderer *renderer);
    void (*destroy)(struct renderer *renderer); /* frees the renderer itself */
};

struct renderer {
    const struct render_ops *ops;
    enum render_kind kind;
    char description[160];
};

enum st render_cpu_create(struct renderer **out_renderer, struct errctx *err);
enum st render_gles_create(enum render_kind kind, const struct render_params *params,
                           struct renderer **out_renderer, struct errctx *err);

#endif
