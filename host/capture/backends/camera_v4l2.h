/* A camera by Video4Linux 2: memory-mapped streaming of JPEG, YUYV or RGB frames, with the controls
 * locked through extended controls, as far as the device has them.
 *
 * V4L2 fixes no unit for gain and focus: gain is the control's value over its least value, or,
 * where that is 0, 1 plus the steps above it; focus runs from the least value (infinity) to the
 * largest (10 diopters). Both are reproducible, neither is calibrated.
 *
 * Frame times are the driver's, monotonic; if it stamps the end of a frame, exposure and half a
 * frame interval are taken off, and t_sigma_ns says how little is known. */
#ifndef SC_CAPTURE_CAMERA_V4L2_H
#define SC_CAPTURE_CAMERA_V4L2_H

#include "device/camera_device.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Opens /dev/videoN or a link to one. ST_NOT_FOUND; ST_PERMISSION (the text names the udev rule);
 * ST_UNSUPPORTED it is no camera that streams; ST_IO, ST_NOMEM. */
ST_MUST_CHECK enum st camera_v4l2_open(const char *device, struct camera_device **out_camera,
                                       struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
