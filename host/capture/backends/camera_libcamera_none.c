#include "capture/backends/camera_libcamera.h"

enum st camera_libcamera_open(const char *name, struct camera_device **out_camera,
                              struct errctx *err) {
    (void)name;
    (void)out_camera;
    return errctx_set(err, ST_UNSUPPORTED,
                      "this program was built without libcamera: install libcamera-dev and build "
                      "again, or use camera.driver: v4l2");
}
