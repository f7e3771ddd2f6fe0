/* A scan as one picture of equal angles, as seen from the stand: left to right is clockwise from
 * above. */
#ifndef SC_BASE_PANORAMA_H
#define SC_BASE_PANORAMA_H

#include "base/image.h"
#include "base/sample.h"
#include "base/sample_shade.h"
#include "base/st.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct panorama_options {
    enum sample_shade_style style;
    int32_t width_px;     /* of the scene; 0: three pixels a sample, at most 4096 */
    double range_sigma_m; /* of one sample; 0: 0.01 */
    double near_m, far_m; /* colour scale; 0: from the samples */
    bool legend;          /* below the scene: the scale, and what has no surface */
};

/* What was drawn, for captions. */
struct panorama_info {
    double left_rad, right_rad, bottom_rad, top_rad; /* azimuth falls from left to right */
    double near_m, far_m;
    size_t surfaces, no_returns, dropped; /* samples */
};

/* Draws samples whose row and column are places in the instrument's grid: neighbours there are
 * neighbours in direction. The picture spans the directions that were looked at. out_info may be
 * NULL. ST_INVALID for no samples; without a font the legend has no text. Cost as
 * sample_grid_draw(). */
ST_MUST_CHECK enum st panorama_render(const struct polar_sample *samples, size_t count,
                                      const struct panorama_options *options,
                                      struct image_u8 *out_image, struct panorama_info *out_info,
                                      struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
