/* calib.txt of KITTI's object benchmark (Geiger, Lenz, Stiller, Urtasun 2013, eq. 7): lines "NAME:
 * numbers". A point of the laser is seen at  P2 R0_rect Tr_velo_to_cam x,  P2 = K [1 | t]:
 *
 *   P2:              3 x 4 projection of the rectified colour camera, row by row
 *   R0_rect:         3 x 3 rotation that rectifies
 *   Tr_velo_to_cam:  3 x 4 from the laser to the reference camera
 *
 * Other lines are passed over. */
#ifndef SC_IMPORT_KITTI_CALIB_H
#define SC_IMPORT_KITTI_CALIB_H

#include "base/camera.h"
#include "base/pose.h"
#include "base/st.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The camera of an image of that size and its pose in the laser's frame. Rotations given to a few
 * digits are made exact. Which size the image has the file does not say; an image whose middle is
 * so far from the principal point that this lies outside its middle half, either way, is not the
 * one that was calibrated. ST_FORMAT: a line is missing, given twice or does not hold its numbers;
 * no rotation (to 1e-3); a P2 that is no pinhole with square axes. ST_INVALID: another image. */
ST_MUST_CHECK enum st kitti_calib_parse(const void *data, size_t size, int32_t width_px,
                                        int32_t height_px, struct camera *out_camera,
                                        struct pose *out_velo_from_cam, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
