/* Several photographs of one surface, mixed: for comparison with the best-sampled one, which
 * push-back in a single pass gives (raster_options.push_sigma), and with the nearest (push 0). */
#ifndef SC_RENDER_RENDER_BLEND_H
#define SC_RENDER_RENDER_BLEND_H

#include "render/render.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Draws like render_draw(), but a pixel's colour is the mean over all photographs that show the
 * surface seen there, each weighted by 1 / (sigma octaves)^2, what push-back takes for its quality
 * (raster.h). "The same surface": no farther behind the nearest than twice that push-back at one
 * sigma, and 1e-4 of the distance. target->rgba is required, depth (NULL: not wanted) is the
 * nearest's. Sums are integers: the order of the photographs does not matter. Cost: two pictures a
 * photograph and one of all; 24 bytes a pixel are allocated meanwhile. Errors as render_draw(). */
ST_MUST_CHECK enum st render_blend_draw(struct renderer *renderer, const struct render_frame *frame,
                                        const struct raster_target *target,
                                        struct render_stats *out_stats, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
