/* Points and splats by compute shader (OpenGL ES 3.1): each sample raises the depths of its pixels
 * with atomics, then those that won give their colour. The order of samples does not matter. */
#ifndef SC_RENDER_GLES_GLES_COMPUTE_H
#define SC_RENDER_GLES_GLES_COMPUTE_H

#include "base/st.h"
#include "render/gles/gles_program.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    GLES_COMPUTE_PASSES = 2, /* depths, then colours */
    GLES_COMPUTE_TILES = 2   /* binding of the tile records */
};

struct gles_compute {
    const struct gl_api *gl;
    bool ready; /* false: this renderer does without */
    struct gles_program pass[GLES_COMPUTE_PASSES], image, resolve;
    GLuint buffers[2], images[2]; /* depths and colours */
    int32_t width_px, height_px;
};

ST_MUST_CHECK enum st gles_compute_init(struct gles_compute *compute, const struct gl_api *gl,
                                        struct errctx *err);
ST_MUST_CHECK enum st gles_compute_size(struct gles_compute *compute, int32_t width_px,
                                        int32_t height_px, struct errctx *err);

/* One pass over the tiles in the bound record buffer; its uniforms are set. */
void gles_compute_pass(struct gles_compute *compute, int pass, bool points, int tile_count);
/* Buffers to images, after both passes; the buffers are clear again. */
void gles_compute_image(struct gles_compute *compute);
/* Puts the result into the bound framebuffer by depth; uniforms of `resolve` are set. */
void gles_compute_resolve(struct gles_compute *compute);

#ifdef __cplusplus
}
#endif
#endif
