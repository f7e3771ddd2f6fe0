/* The off-screen picture: colours, depths as bits, a 32-bit float depth buffer with stencil, and a
 * depth texture for the skins of one photograph. */
#ifndef SC_RENDER_GLES_GLES_TARGET_H
#define SC_RENDER_GLES_GLES_TARGET_H

#include "raster/raster.h"
#include "render/gles/gl_api.h"

#ifdef __cplusplus
extern "C" {
#endif

struct gles_target {
    const struct gl_api *gl;
    int32_t width_px, height_px;
    GLuint frame, colour, bits, depth; /* renderbuffers behind a framebuffer */
    GLuint skin_frame, skin_depth;     /* depth texture */
};

/* Makes it that large; keeps what fits. ST_UNSUPPORTED if the GPU does not take the size or a float
 * depth buffer. */
ST_MUST_CHECK enum st gles_target_size(struct gles_target *target, const struct gl_api *gl,
                                       int32_t width_px, int32_t height_px, struct errctx *err);
void gles_target_fini(struct gles_target *target); /* takes a zeroed one; needs its context */

/* Clears everything and draws there from now on; depths as bits are written only if asked for. */
void gles_target_begin(struct gles_target *target, const uint8_t background_rgb[3],
                       bool with_depth);
/* Draws the depths of skins from now on, beginning with none; gles_target_surface() goes back. */
void gles_target_skins(struct gles_target *target);
void gles_target_surface(struct gles_target *target);

/* Reads the picture into what `out` wants (rgba, depth). */
void gles_target_read(struct gles_target *target, const struct raster_target *out);

#ifdef __cplusplus
}
#endif
#endif
