#include "base/image.h"

#include <stdlib.h>
#include <string.h>

/* ST_OK if an image of that size may be allocated. */
static enum st size_check(int32_t width_px, int32_t height_px, int32_t channels) {
    if (width_px < 0 || height_px < 0 || channels < 1 || channels > 4)
        return ST_INVALID;
    if (width_px > IMAGE_MAX_SIDE_PX || height_px > IMAGE_MAX_SIDE_PX ||
        (int64_t)width_px * height_px > IMAGE_MAX_PIXELS)
        return ST_NOMEM;
    return ST_OK;
}

enum st image_u8_create(struct image_u8 *out_im, int32_t width_px, int32_t height_px,
                        int32_t channels) {
    enum st st = size_check(width_px, height_px, channels);
    if (st)
        return st;
    size_t stride = (size_t)width_px * (size_t)channels;
    uint8_t *px = NULL;
    if (width_px > 0 && height_px > 0) {
        px = calloc((size_t)height_px, stride);
        if (!px)
            return ST_NOMEM;
    }
    *out_im = (struct image_u8){px, width_px, height_px, channels, stride};
    return ST_OK;
}

enum st image_u16_create(struct image_u16 *out_im, int32_t width_px, int32_t height_px,
                         int32_t channels) {
    enum st st = size_check(width_px, height_px, channels);
    if (st)
        return st;
    size_t stride = (size_t)width_px * (size_t)channels;
    uint16_t *px = NULL;
    if (width_px > 0 && height_px > 0) {
        px = calloc((size_t)height_px, stride * sizeof *px);
        if (!px)
            return ST_NOMEM;
    }
    *out_im = (struct image_u16){px, width_px, height_px, channels, stride};
    return ST_OK;
}

enum st image_f32_create(struct image_f32 *out_im, int32_t width_px, int32_t height_px,
                         int32_t channels) {
    enum st st = size_check(width_px, height_px, channels);
    if (st)
        return st;
    size_t stride = (size_t)width_px * (size_t)channels;
    float *px = NULL;
    if (width_px > 0 && height_px > 0) {
        px = calloc((size_t)height_px, stride * sizeof *px);
        if (!px)
            return ST_NOMEM;
    }
    *out_im = (struct image_f32){px, width_px, height_px, channels, stride};
    return ST_OK;
}

void image_u8_destroy(struct image_u8 *im) {
    if (!im)
        return;
    free(im->px);
    memset(im, 0, sizeof *im);
}

void image_u16_destroy(struct image_u16 *im) {
    if (!im)
        return;
    free(im->px);
    memset(im, 0, sizeof *im);
}

void image_f32_destroy(struct image_f32 *im) {
    if (!im)
        return;
    free(im->px);
    memset(im, 0, sizeof *im);
}
