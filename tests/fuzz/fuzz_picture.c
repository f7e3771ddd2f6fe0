/* Any bytes as a picture: PGM, PPM and PFM are our own parser; PNG and JPEG run along. */
#include "base/picture.h"

#include <stdint.h>
#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct picture picture = {0};
    struct errctx err = {0};
    if (picture_decode(data, size, "fuzz", &picture, &err)) {
        if (picture.px || !err.text[0])
            abort(); /* a failure leaves nothing and says why */
        return 0;
    }
    struct image_u8 rgb = {0};
    struct image_f32 numbers = {0};
    if (!picture_to_rgb(&picture, &rgb, NULL))
        image_u8_destroy(&rgb);
    if (!picture_to_f32(&picture, &numbers, NULL))
        image_f32_destroy(&numbers);
    picture_destroy(&picture);
    return 0;
}
