/* The renderer's interface: one frame's worth of tiles to a picture, by GL or without.
 *
 * Three implementations, chosen at run time, draw the same picture: RENDER_CPU (host/raster, always
 * there), RENDER_GLES30 (OpenGL ES 3.0: samples pulled from texture arrays by gl_VertexID, reversed
 * depth in 32-bit float) and RENDER_GLES31 (the same, with points and splats in a compute shader).
 * All are off-screen: the picture comes back to memory, and whoever has a window shows it there.
 *
 * View, options and the meaning of depth are the rasteriser's (raster/raster.h); only the primitive
 * is each item's own. Where depths and colours differ between implementations it is by the last
 * bits of a float: at most 0.5 % of a picture's pixels by more than 2/255.
 *
 * A renderer belongs to one thread: the one that created it. */
#ifndef SC_RENDER_RENDER_H
#define SC_RENDER_RENDER_H

#include "base/photo.h"
#include "base/st.h"
#include "raster/raster.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum render_kind { RENDER_CPU, RENDER_GLES30, RENDER_GLES31 };
enum { RENDER_KINDS = 3 };

/* "cpu", "gles30", "gles31". */
const char *render_kind_name(enum render_kind kind);

enum render_primitive {
    RENDER_POINTS,
    RENDER_SPLATS,
    RENDER_MESH,
    RENDER_PLANE /* a quadrilateral: all disparities of the tile are plane . (1, u, v) */
};
enum { RENDER_PRIMITIVES = 4 };

/* One tile to draw. */
struct render_item {
    const struct tile *tile; /* sample planes must live until render_draw() returns */
    /* Identity of the samples, so that what the GPU has is not sent again: same key and version,
     * same bytes. */
    uint64_t key;
    uint32_t version;
    uint32_t input; /* photograph: what one calls unknown yields to what another saw */
    enum render_primitive primitive;
    float plane[3]; /* RENDER_PLANE: c0, cu, cv */
};

struct render_frame {
    const struct render_item *items; /* items of one input follow each other */
    size_t item_count;
    const struct raster_view *view;
    const struct raster_options *options; /* .primitive is not looked at */
};

struct render_stats {
    int64_t tiles_drawn, samples_drawn; /* samples of the tiles that were not rejected */
    int64_t tiles_by_primitive[RENDER_PRIMITIVES];
    int64_t bytes_sent; /* to the GPU for this frame */
    double total_s;     /* wall clock, with reading the picture back */
};

struct renderer;

struct render_params {
    size_t gpu_bytes; /* for tiles on the GPU, at least one array layer (3.4 MB); 0: 128 MB */
};

/* params may be NULL. ST_UNSUPPORTED with one line why: no EGL, GLES 2 only, no float depth.
 * RENDER_CPU cannot fail but for memory. */
ST_MUST_CHECK enum st render_create(enum render_kind kind, const struct render_params *params,
                                    struct renderer **out_renderer, struct errctx *err);
void render_destroy(struct renderer *renderer); /* takes NULL */

/* Which path this is and what it runs on: "gles30: llvmpipe (LLVM 15.0.6, 256 bits)". */
const char *render_describe(const struct renderer *renderer);
enum render_kind render_kind_of(const struct renderer *renderer);

/* Draws into target->rgba and, where wanted, target->depth (item and count must be NULL; depth with
 * push-back and fall-off, NaN where nothing is). out_stats may be NULL. Errors as raster_draw();
 * ST_UNSUPPORTED for RASTER_FILTER_CUBIC with GL and for pictures larger than the GPU takes;
 * ST_DEVICE if the context was lost: the next call begins with a new one. */
ST_MUST_CHECK enum st render_draw(struct renderer *renderer, const struct render_frame *frame,
                                  const struct raster_target *target,
                                  struct render_stats *out_stats, struct errctx *err);

/* Throws the GPU's state away as a lost context would; the next frame restores it. For tests and
 * for a laptop that wakes up. */
void render_lose_context(struct renderer *renderer);

/* Items for whole photographs, each with one primitive: what a single picture needs. out_items has
 * room for all tiles of all inputs; returns how many were made (tiles that hold nothing are left
 * out). */
size_t render_items_of_inputs(const struct raster_input *inputs, size_t input_count,
                              enum render_primitive primitive, struct render_item *out_items);

#ifdef __cplusplus
}
#endif
#endif
