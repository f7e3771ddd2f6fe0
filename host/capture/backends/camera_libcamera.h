/* A camera by libcamera, for sensors that have no plain V4L2 node. camera_libcamera.cpp is built
 * where libcamera is installed, else camera_libcamera_none.c, which says so. */
#ifndef SC_CAPTURE_CAMERA_LIBCAMERA_H
#define SC_CAPTURE_CAMERA_LIBCAMERA_H

#include "device/camera_device.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Opens the camera of that libcamera id (`cam --list`), or the first if `name` is NULL or empty.
 * ST_NOT_FOUND; ST_BUSY; ST_UNSUPPORTED (built without libcamera); ST_NOMEM. White balance is held
 * where it is at the start: libcamera sets no colour temperature. */
ST_MUST_CHECK enum st camera_libcamera_open(const char *name, struct camera_device **out_camera,
                                            struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
