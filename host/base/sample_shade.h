/* Colours for a drawn scan that brought none. By range: near to far from light to dark blue, shaded
 * by the angle at which the beam met the surface, edges a little darker. As clay: one colour under
 * a fixed light of the world, so that scans from several stands agree. What has no surface says
 * why: no return is a pale sky, dropped is magenta, where nobody looked is dark grey. */
#ifndef SC_BASE_SAMPLE_SHADE_H
#define SC_BASE_SAMPLE_SHADE_H

#include "base/sample_grid.h"
#include "base/st.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum sample_shade_style {
    SAMPLE_SHADE_RANGE,     /* colour by range, shaded */
    SAMPLE_SHADE_CLAY,      /* shaded by the fixed light */
    SAMPLE_SHADE_INTENSITY, /* grey by intensity, square root so that dark things show; else clay */
    SAMPLE_SHADE_COLOUR     /* the samples' own colour; else by intensity, else clay */
};

extern const uint8_t sample_shade_no_return_rgb[3], sample_shade_dropped_rgb[3],
    sample_shade_unseen_rgb[3];

/* Bounds of the colour scale, m: ranges are placed on it by their logarithm. */
struct sample_shade_scale {
    double near_m, far_m;
};

/* The scale that holds all but the nearest and farthest 4 % of the grid's ranges; 1 to 10 m if it
 * has none. Allocates scratch. */
ST_MUST_CHECK enum st sample_shade_auto_scale(const struct sample_grid *grid,
                                              struct sample_shade_scale *out_scale);

/* Unshaded colour of a range. */
void sample_shade_range_rgb(const struct sample_shade_scale *scale, double range_m,
                            uint8_t out_rgb[3]);

/* Colours [height][width][3] of a picture that sample_grid_draw() made (all its planes). The light
 * of clay is the world's; world_from_station NULL: the station's. Cost: a 5 x 5 window a pixel. */
void sample_shade(const struct sample_grid *grid, const struct sample_view *view,
                  const struct sample_picture *picture, const struct sample_shade_scale *scale,
                  enum sample_shade_style style, const struct mat3 *world_from_station,
                  uint8_t *out_rgb);

#ifdef __cplusplus
}
#endif
#endif
