/* A tile seen from somewhere: its matrix, how large its samples get, whether it can be seen. */
#ifndef SC_RENDER_RENDER_TILE_H
#define SC_RENDER_RENDER_TILE_H

#include "base/photo.h"
#include "raster/raster.h"

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

struct render_projection {
    double c[16];  /* rows x, y, d, w: [x y d w] = C [u v 1 delta], pixel (x/w, y/w), depth d/w */
    double lin_px; /* side of a projected sample = lin_px / w */
};

/* C = P V M with the tile's origin relative to the eye, in double (Nyland et al. 1999, eq. 1). */
struct render_projection render_tile_project(const struct raster_view *view,
                                             const struct tile *tile);

/* Splat radius before its bounds = this / w. */
double render_tile_radius_px(const struct raster_view *view, const struct tile *tile,
                             const struct raster_options *options);

/* The same projection for a tile of which only the index is known: its matrix, size and disparity
 * bounds. */
struct render_bounds {
    double u_hi, v_hi, d_lo, d_hi; /* u and v begin at 0 */
};

/* What a bounding volume comes to on screen. */
struct render_extent {
    bool visible;         /* false: certainly not in the picture */
    double sample_px;     /* the largest side that one of its samples is drawn with; INFINITY if it
                             reaches the eye */
    double sample_min_px; /* the smallest */
};

/* margin_px: how far beyond its centre a sample may reach. */
struct render_extent render_tile_extent(const struct raster_view *view,
                                        const struct render_projection *projection,
                                        const struct render_bounds *bounds, double margin_px);

#ifdef __cplusplus
}
#endif
#endif
