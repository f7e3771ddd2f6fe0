/* A camera frame as a photograph's colour: distortion removed by resampling (Nyland et al. 1999,
 * section 4.3, bilinear), and the pinhole that it then is. */
#ifndef SC_FUSION_FRAME_H
#define SC_FUSION_FRAME_H

#include "base/camera.h"
#include "base/image.h"
#include "base/photo.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The pinhole of width_px x height_px with the focal length and principal point of `camera` scaled
 * to that size; every pixel of it whose ray the camera has is seen. width_px or height_px 0: the
 * camera's size. */
struct camera frame_pinhole(const struct camera *camera, int32_t width_px, int32_t height_px);

/* Fills photo->rgb from `frame` (3 channels, or 1: grey), which the distorted `camera` took:
 * bilinear, and averaged over the pixel where the photograph is coarser. Pixels that the camera did
 * not see become black and their count is returned through out_unseen (may be NULL). ST_INVALID if
 * sizes disagree. */
ST_MUST_CHECK enum st frame_undistort(const struct image_u8 *frame, const struct camera *camera,
                                      struct photo *photo, int64_t *out_unseen, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
