/* How alike two pictures are, over the pixels that a rendering covers. */
#ifndef SC_RASTER_METRICS_H
#define SC_RASTER_METRICS_H

#include "base/st.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct metrics {
    double psnr_db;  /* 10 log10(255^2 / mean squared difference over all channels); INFINITY if
                        equal */
    double ssim;     /* mean structural similarity of luma (Wang et al. 2004) */
    double coverage; /* share of the pixels that count that is covered */
    int64_t covered_px;
};

/* Compares `rgba` (covered where alpha is 255) with `truth_rgb`, both [height][width] and tightly
 * packed. `counts` is [height][width], 0 where the truth is no picture (the rim that undistortion
 * leaves); NULL: all of it counts. PSNR and SSIM are NaN if nothing is covered.
 *
 * SSIM: 11 x 11 Gaussian window, sigma 1.5 px, K1 0.01, K2 0.03, on luma (BT.601). Windows are cut
 * by the picture's rim and by pixels that are not covered or do not count, their weights
 * renormalised; a value counts where the pixel in the middle does. On a fully covered picture this
 * is the usual figure but for the rim. Cost: about 250 operations a pixel. ST_INVALID for sizes
 * below 1, ST_NOMEM. */
ST_MUST_CHECK enum st metrics_compare(const uint8_t *rgba, const uint8_t *truth_rgb,
                                      const uint8_t *counts, int32_t width_px, int32_t height_px,
                                      struct metrics *out_metrics);

/* Marks in `out_counts` [height][width] with 0 the pixels of exactly this colour that hang together
 * (4 neighbours) with the picture's rim, with 1 the others. Returns the number of ones, or -1
 * without memory. */
int64_t metrics_rim_mask(const uint8_t *rgb, int32_t width_px, int32_t height_px,
                         const uint8_t rim_rgb[3], uint8_t *out_counts);

#ifdef __cplusplus
}
#endif
#endif
