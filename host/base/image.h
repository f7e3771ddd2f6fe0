/* Image views and images. A view points at somebody's pixels; an image owns them. Rows are top to
 * bottom, samples interleaved. */
#ifndef SC_BASE_IMAGE_H
#define SC_BASE_IMAGE_H

#include "base/st.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { IMAGE_MAX_SIDE_PX = 65536 };
/* Pixels in one image at the most: every size from outside is checked against it. */
#define IMAGE_MAX_PIXELS ((int64_t)1 << 28)

/* 8-bit image: channels 1 (grey), 3 (RGB) or 4 (RGBA). */
struct image_u8 {
    uint8_t *px; /* [height][width][channels] */
    int32_t width_px, height_px, channels;
    size_t stride_bytes; /* from row to row */
};

/* 16-bit image, in the machine's byte order: range, depth or disparity as integers; channels 1
 * or 3. */
struct image_u16 {
    uint16_t *px; /* [height][width][channels] */
    int32_t width_px, height_px, channels;
    size_t stride_elem; /* samples from row to row */
};

/* Float image, 1 channel unless said otherwise. NaN is "no value". */
struct image_f32 {
    float *px; /* [height][width][channels] */
    int32_t width_px, height_px, channels;
    size_t stride_elem; /* floats from row to row */
};

/* Allocates zeroed pixels; ST_INVALID for sizes below 0 or channels not 1..4, ST_NOMEM above the
 * bounds. An image of 0 pixels is valid and has px NULL. */
ST_MUST_CHECK enum st image_u8_create(struct image_u8 *out_im, int32_t width_px, int32_t height_px,
                                      int32_t channels);
ST_MUST_CHECK enum st image_u16_create(struct image_u16 *out_im, int32_t width_px,
                                       int32_t height_px, int32_t channels);
ST_MUST_CHECK enum st image_f32_create(struct image_f32 *out_im, int32_t width_px,
                                       int32_t height_px, int32_t channels);

/* Frees the pixels and zeroes the struct; takes a zeroed one or NULL. */
void image_u8_destroy(struct image_u8 *im);
void image_u16_destroy(struct image_u16 *im);
void image_f32_destroy(struct image_f32 *im);

static inline uint8_t *image_u8_at(const struct image_u8 *im, int32_t x_px, int32_t y_px) {
    return im->px + (size_t)y_px * im->stride_bytes + (size_t)x_px * (size_t)im->channels;
}
static inline uint16_t *image_u16_at(const struct image_u16 *im, int32_t x_px, int32_t y_px) {
    return im->px + (size_t)y_px * im->stride_elem + (size_t)x_px * (size_t)im->channels;
}
static inline float *image_f32_at(const struct image_f32 *im, int32_t x_px, int32_t y_px) {
    return im->px + (size_t)y_px * im->stride_elem + (size_t)x_px * (size_t)im->channels;
}

#ifdef __cplusplus
}
#endif
#endif
