/* Sub-pixel values for a map that was stored in whole steps.
 *
 * A disparity map kept as whole pixels says of every pixel only that its value lies in an interval
 * one step wide. A slanted surface becomes a staircase, which a renderer shows as contour lines.
 * Inside that interval the data say nothing; what a scene usually is does: surfaces are locally
 * affine in disparity (a plane exactly so). Hence the estimate
 *
 *   D = argmin  sum (D_uu)^2 + 2 (D_uv)^2 + (D_vv)^2     subject to  |D - d| <= step / 2  at each
 * pixel,
 *
 * the discrete thin plate energy, where a second difference counts only if none of its pixels is
 * unknown and no two neighbours in it differ by more than one step: nothing is smoothed across a
 * jump, and a pixel without such neighbours keeps its value. It is convex, the result obeys every
 * interval, so no pixel moves by more than half a step: a stored fact is never overruled.
 *
 * Method: accelerated projected gradient (Beck and Teboulle 2009) from coarse to fine. */
#ifndef SC_IMPORT_DEQUANTISE_H
#define SC_IMPORT_DEQUANTISE_H

#include "base/image.h"
#include "base/st.h"

#ifdef __cplusplus
extern "C" {
#endif

struct dequantise_options {
    float step;         /* quantisation step in the map's unit, > 0 */
    int32_t iterations; /* at full size, twice as many at half size...; 0: the default, 120 */
};

/* map: one channel, NaN where unknown. out_map: same size, the estimate, NaN where unknown; may be
 * the same image. out_sigma: NULL or same size: standard deviation in the map's unit, NaN where
 * unknown: step / sqrt(12) for a pixel without neighbours on its surface, else from step / 8 where
 * the surface climbs to step / sqrt(6) on wide plateaus (see sigma_steps() for where these come
 * from). The map's own errors, beyond being rounded, are not in it. ST_INVALID for sizes that
 * differ, more than one channel or a step that is not positive; ST_NOMEM. Cost: about 2 *
 * iterations * 25 operations a pixel, 34 bytes of scratch a pixel. Same result for any number of
 * threads. */
ST_MUST_CHECK enum st dequantise(const struct image_f32 *map,
                                 const struct dequantise_options *options,
                                 struct image_f32 *out_map, struct image_f32 *out_sigma,
                                 struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
