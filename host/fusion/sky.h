/* Which of the pixels without return are sky: at infinity, by decision. A dark car also returns
 * nothing, but it is small, or low, or both. */
#ifndef SC_FUSION_SKY_H
#define SC_FUSION_SKY_H

#include "base/photo.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Turns connected regions of PHOTO_NO_RETURN pixels that reach `elevation_rad` above the station's
 * horizon and cover at least 1 % of the image into sky: disparity 0, PHOTO_SKY set and
 * PHOTO_NO_RETURN cleared. NaN: never. One pass of a flood fill; 5 bytes a pixel of scratch.
 * ST_NOMEM. */
ST_MUST_CHECK enum st sky_mark(struct photo *photo, double elevation_rad, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
