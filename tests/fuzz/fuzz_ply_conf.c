/* Any bytes as a Stanford .conf: an answer, and a rotation. */
#include "import/ply_grid.h"

#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct pose pose;
    struct errctx err = {0};
    const enum st st = ply_grid_conf_pose(data, size, "a.ply", &pose, &err);
    if (st ? !err.text[0] : !(pose_orthonormality_error(&pose.r) < 1e-9))
        abort();
    return 0;
}
