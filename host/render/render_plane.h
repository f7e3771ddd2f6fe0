/* Plane tiles without a GPU: a tile whose disparity is affine in (u, v) is one quadrilateral, so a
 * pixel of the picture finds its (u, v) by one homography. */
#ifndef SC_RENDER_RENDER_PLANE_H
#define SC_RENDER_RENDER_PLANE_H

#include "render/render.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Draws a RENDER_PLANE item over what `target` (rgba and depth) holds: the larger (depth, colour)
 * stays. Rows y0..y1 - 1 only, so that threads can share a picture. Cost: some 30 operations a
 * pixel of the quadrilateral's bounding box. */
void render_plane_draw(const struct render_item *item, const struct raster_view *view,
                       const struct raster_options *options, int32_t y0_px, int32_t y1_px,
                       const struct raster_target *target);

/* Confidence push-back of a sample, as raster.h defines it; area_px is the projected sample's. */
float render_plane_push(const struct raster_options *options, float gain, uint8_t confidence,
                        float inv_w, float lin_px);

#ifdef __cplusplus
}
#endif
#endif
