/* Any bytes as calib.txt of a camera beside a spinning laser. */
#include "import/kitti_calib.h"

#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct camera camera;
    struct pose pose;
    struct errctx err = {0};
    if (kitti_calib_parse(data, size, 1000, 400, &camera, &pose, &err)) {
        if (!err.text[0])
            abort();
        return 0;
    }
    if (camera_check(&camera, &err) || !(pose_orthonormality_error(&pose.r) < 1e-9))
        abort();
    return 0;
}
