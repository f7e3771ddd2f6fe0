/* Any bytes as a 3D photograph: an answer, and what is accepted can be written again. */
#include "site/photo_tiff.h"

#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct photo photo = {0};
    struct errctx err = {0};
    struct photo_tiff_info info;
    uint8_t *again = NULL;
    size_t again_size = 0;
    const enum st st = photo_tiff_decode(data, size, &photo, &info, &err);
    if (st && !err.text[0])
        abort(); /* a refusal without a reason */
    if (!st && (int64_t)photo.camera.width_px * photo.camera.height_px < 65536) {
        if (photo_tiff_encode(&photo, &info, &again, &again_size, &err))
            abort();
        free(again);
    }
    photo_destroy(&photo);
    return 0;
}
