/* Any bytes as a .pose file: an answer, and a rotation. */
#include "import/scan_3dtk.h"

#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct pose pose;
    struct errctx err = {0};
    const enum st st = scan_3dtk_parse_pose(data, size, &pose, &err);
    if (st ? !err.text[0] : !(pose_orthonormality_error(&pose.r) < 1e-9))
        abort();
    return 0;
}
