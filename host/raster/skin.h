/* Skins by a first heuristic: which mesh cells bridge a depth discontinuity.
 *
 * Over a plane the disparity is affine in (u, v), and over a smooth surface nearly so. A step
 * between two neighbours is a discontinuity when it is more than noise, more than a surface seen at
 * a grazing angle would give (|d delta / du| = delta tan(theta) / f), and neither side's affine
 * continuation foretells it. */
#ifndef SC_RASTER_SKIN_H
#define SC_RASTER_SKIN_H

#include "base/photo.h"

#ifdef __cplusplus
extern "C" {
#endif

struct skin_params {
    double sigmas;           /* steps below so many sigmas of their own noise are noise */
    double grazing_rad;      /* angle of incidence up to which a step alone proves nothing */
    double sigma_unknown_px; /* noise of a disparity of unknown confidence, as a share of one pixel
                                of parallax: sigma = sigma_unknown_px * delta / f */
};
struct skin_params skin_params_default(void);

/* Sets PHOTO_SKIN on each pixel whose cell (it, right, below, right-below) bridges a discontinuity,
 * PHOTO_SILHOUETTE on the pixels on both sides of one, and PHOTO_MIXED on the farther of the two: a
 * camera's pixel there has some of the nearer surface's colour. Clears the first two elsewhere.
 * Cells with a missing disparity are not skins. Returns the number of skin cells. One pass; no
 * allocation. */
int64_t skin_mark(struct photo *photo, const struct skin_params *params);

/* Closes cracks: a run of at most SKIN_CRACK_PX pixels without disparity, along a row or a column,
 * whose two ends lie on one surface (no break between them by the rule above, steps allowed to grow
 * with the distance) gets disparities interpolated between them, PHOTO_FILLED, and the worse of the
 * two confidences. Pixels with PHOTO_NO_RETURN stay. Rows first. For a photograph in memory that is
 * to be drawn; before skin_mark(). Returns the number of pixels filled. One pass each way; no
 * allocation. */
enum { SKIN_CRACK_PX = 3 };
int64_t skin_fill_cracks(struct photo *photo, const struct skin_params *params);

/* Bounds the unknown: gives each pixel without disparity that lies in a block of 3 x 3 such pixels
 * (a narrower hole hides nothing worth the name), unless it is PHOTO_NO_RETURN, the smallest
 * disparity of the nearest pixels that have one to its left, right, top and bottom (the farthest,
 * so that no more is claimed to be unknown than must be), flags it PHOTO_DROPPED | PHOTO_FILLED and
 * the cells it makes PHOTO_SKIN. Drawn with RASTER_SKINS_UNKNOWN it hides what only seems to be
 * visible through a place where nobody looked. For a photograph in memory that is to be drawn,
 * after skin_mark(); never for one that is stored. Returns the number of pixels. A few passes;
 * allocates 5 bytes a pixel: ST_NOMEM. */
ST_MUST_CHECK enum st skin_bound_unknown(struct photo *photo, int64_t *out_count);

#ifdef __cplusplus
}
#endif
#endif
