/* Depths as pictures: in colour for people, in 16 bits for programs. */
#ifndef SC_RASTER_DEPTH_PICTURE_H
#define SC_RASTER_DEPTH_PICTURE_H

#include "base/st.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Where the colour scale begins and ends, in depth as raster.h defines it (larger is nearer). */
struct depth_range {
    float far_depth, near_depth;
};

/* The range that holds all but the outermost half percent on each side; 0..1 if there is no depth.
 * Sorts a sample of at most 65 536 depths: ST_NOMEM. NaN means none. */
ST_MUST_CHECK enum st depth_picture_range(const float *depth, size_t count,
                                          struct depth_range *out_range);

/* Colours near (light yellow) to far (dark violet), evenly in depth, that is in disparity;
 * brightness falls steadily, so it survives grey printing. NaN is mid grey. out_rgb is [count][3].
 */
void depth_picture_colour(const float *depth, size_t count, struct depth_range range,
                          uint8_t *out_rgb);

/* Distance along the optical axis in steps of unit_m: round(1 / (depth unit_m)), 0 where there is
 * none, 65535 from there on and for infinity. For depths of a pinhole view. */
void depth_picture_u16(const float *depth, size_t count, double unit_m, uint16_t *out_steps);

#ifdef __cplusplus
}
#endif
#endif
