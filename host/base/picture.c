#include "base/picture.h"

#include "base/fileio.h"
#include "base/picture_codec.h"

#include <stdlib.h>
#include <string.h>

static size_t sample_bytes(enum picture_sample sample) {
    return sample == PICTURE_U8 ? 1 : sample == PICTURE_U16 ? 2 : 4;
}

static size_t pixel_count(const struct picture *picture) {
    return (size_t)picture->width_px * (size_t)picture->height_px;
}

enum st picture_allocate(struct picture *picture, const char *name, struct errctx *err) {
    int64_t w = picture->width_px, h = picture->height_px;
    if (w < 1 || h < 1)
        return errctx_set(err, ST_FORMAT, "%s: picture of %lldx%lld pixels", name, (long long)w,
                          (long long)h);
    if (w > IMAGE_MAX_SIDE_PX || h > IMAGE_MAX_SIDE_PX || w * h > IMAGE_MAX_PIXELS)
        return errctx_set(err, ST_FORMAT, "%s: picture of %lldx%lld pixels is above the bound",
                          name, (long long)w, (long long)h);
    picture->px =
        calloc((size_t)(w * h), (size_t)picture->channels * sample_bytes(picture->sample));
    if (!picture->px)
        return errctx_set(err, ST_NOMEM, "%s: no memory for %lldx%lld pixels", name, (long long)w,
                          (long long)h);
    return ST_OK;
}

void picture_destroy(struct picture *picture) {
    if (!picture)
        return;
    free(picture->px);
    memset(picture, 0, sizeof *picture);
}

enum st picture_decode(const void *data, size_t size, const char *name, struct picture *out_picture,
                       struct errctx *err) {
    static const uint8_t png_signature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
    const uint8_t *bytes = data;
    if (size >= sizeof png_signature && !memcmp(bytes, png_signature, sizeof png_signature))
        return picture_png_decode(bytes, size, name, out_picture, err);
    if (size >= 3 && bytes[0] == 0xff && bytes[1] == 0xd8 && bytes[2] == 0xff)
        return picture_jpeg_decode(bytes, size, name, out_picture, err);
    if (size >= 2 && bytes[0] == 'P' && bytes[1] && strchr("2356Ff", bytes[1]))
        return picture_pnm_decode(bytes, size, name, out_picture, err);
    return errctx_set(err, ST_FORMAT, "%s is not a PNG, JPEG, PGM, PPM or PFM picture", name);
}

enum st picture_read(const char *path, struct picture *out_picture, struct errctx *err) {
    uint8_t *data = NULL;
    size_t size = 0;
    enum st st = fileio_read(path, PICTURE_MAX_FILE_BYTES, &data, &size, err);
    if (st)
        return st;
    st = picture_decode(data, size, path, out_picture, err);
    free(data);
    return st;
}

/* value * 255 / value_max, rounded. */
static uint8_t to_8_bits(const struct picture *picture, size_t i) {
    if (picture->sample == PICTURE_U8 && picture->value_max == 255)
        return ((const uint8_t *)picture->px)[i];
    uint32_t value = picture->sample == PICTURE_U8 ? ((const uint8_t *)picture->px)[i]
                                                   : ((const uint16_t *)picture->px)[i];
    return (uint8_t)((value * 255u + picture->value_max / 2) / picture->value_max);
}

static enum st refuse_floats(struct errctx *err) {
    return errctx_set(err, ST_UNSUPPORTED, "a picture of floats (PFM) has no colours");
}

enum st picture_to_rgb(const struct picture *picture, struct image_u8 *out_im, struct errctx *err) {
    if (picture->sample == PICTURE_F32)
        return refuse_floats(err);
    struct image_u8 im;
    enum st st = image_u8_create(&im, picture->width_px, picture->height_px, 3);
    if (st)
        return errctx_set(err, st, "no memory for a picture");
    size_t n = pixel_count(picture), channels = (size_t)picture->channels;
    for (size_t i = 0; i < n; i++)
        for (size_t c = 0; c < 3; c++)
            im.px[3 * i + c] = to_8_bits(picture, i * channels + (channels == 3 ? c : 0));
    *out_im = im;
    return ST_OK;
}

enum st picture_to_grey(const struct picture *picture, struct image_u8 *out_im,
                        struct errctx *err) {
    if (picture->sample == PICTURE_F32)
        return refuse_floats(err);
    struct image_u8 im;
    enum st st = image_u8_create(&im, picture->width_px, picture->height_px, 1);
    if (st)
        return errctx_set(err, st, "no memory for a picture");
    size_t n = pixel_count(picture);
    for (size_t i = 0; i < n; i++) {
        if (picture->channels == 1) {
            im.px[i] = to_8_bits(picture, i);
            continue;
        }
        /* 0.299, 0.587, 0.114 in units of 2^-16, summing to 2^16: white stays white */
        uint32_t luma = 19595u * to_8_bits(picture, 3 * i) +
                        38470u * to_8_bits(picture, 3 * i + 1) +
                        7471u * to_8_bits(picture, 3 * i + 2);
        im.px[i] = (uint8_t)((luma + 32768u) >> 16);
    }
    *out_im = im;
    return ST_OK;
}

/* True if one channel tells all. */
static bool channels_equal(const struct picture *picture) {
    if (picture->channels == 1)
        return true;
    size_t bytes = sample_bytes(picture->sample), n = pixel_count(picture);
    const uint8_t *p = picture->px;
    for (size_t i = 0; i < n; i++, p += 3 * bytes)
        if (memcmp(p, p + bytes, bytes) != 0 || memcmp(p, p + 2 * bytes, bytes) != 0)
            return false;
    return true;
}

static enum st refuse_colour(struct errctx *err) {
    return errctx_set(err, ST_UNSUPPORTED,
                      "a colour picture where numbers (depth, disparity) are wanted");
}

enum st picture_to_u16(const struct picture *picture, struct image_u16 *out_im,
                       struct errctx *err) {
    if (picture->sample == PICTURE_F32)
        return errctx_set(err, ST_UNSUPPORTED,
                          "a picture of floats (PFM) where integers are wanted");
    if (!channels_equal(picture))
        return refuse_colour(err);
    struct image_u16 im;
    enum st st = image_u16_create(&im, picture->width_px, picture->height_px, 1);
    if (st)
        return errctx_set(err, st, "no memory for a picture");
    size_t n = pixel_count(picture), channels = (size_t)picture->channels;
    for (size_t i = 0; i < n; i++)
        im.px[i] = picture->sample == PICTURE_U8 ? ((const uint8_t *)picture->px)[i * channels]
                                                 : ((const uint16_t *)picture->px)[i * channels];
    *out_im = im;
    return ST_OK;
}

enum st picture_to_f32(const struct picture *picture, struct image_f32 *out_im,
                       struct errctx *err) {
    if (!channels_equal(picture))
        return refuse_colour(err);
    struct image_f32 im;
    enum st st = image_f32_create(&im, picture->width_px, picture->height_px, 1);
    if (st)
        return errctx_set(err, st, "no memory for a picture");
    size_t n = pixel_count(picture), channels = (size_t)picture->channels;
    for (size_t i = 0; i < n; i++) {
        size_t at = i * channels;
        im.px[i] = picture->sample == PICTURE_F32   ? ((const float *)picture->px)[at]
                   : picture->sample == PICTURE_U16 ? (float)((const uint16_t *)picture->px)[at]
                                                    : (float)((const uint8_t *)picture->px)[at];
    }
    *out_im = im;
    return ST_OK;
}

enum st picture_read_rgb(const char *path, struct image_u8 *out_im, struct errctx *err) {
    struct picture picture = {0};
    enum st st = picture_read(path, &picture, err);
    if (st)
        return st;
    st = picture_to_rgb(&picture, out_im, err);
    picture_destroy(&picture);
    return st ? errctx_prefix(err, st, "%s", path) : ST_OK;
}

enum st picture_read_grey(const char *path, struct image_u8 *out_im, struct errctx *err) {
    struct picture picture = {0};
    enum st st = picture_read(path, &picture, err);
    if (st)
        return st;
    st = picture_to_grey(&picture, out_im, err);
    picture_destroy(&picture);
    return st ? errctx_prefix(err, st, "%s", path) : ST_OK;
}

enum st picture_read_u16(const char *path, struct image_u16 *out_im, struct errctx *err) {
    struct picture picture = {0};
    enum st st = picture_read(path, &picture, err);
    if (st)
        return st;
    st = picture_to_u16(&picture, out_im, err);
    picture_destroy(&picture);
    return st ? errctx_prefix(err, st, "%s", path) : ST_OK;
}

/* Writes what an encoder made and frees it. */
static enum st write_encoded(const char *path, enum st st, uint8_t *data, size_t size,
                             struct errctx *err) {
    if (st)
        return errctx_prefix(err, st, "%s", path);
    st = fileio_write(path, data, size, err);
    free(data);
    return st;
}

enum st picture_write_png(const char *path, const struct image_u8 *im, struct errctx *err) {
    uint8_t *data = NULL;
    size_t size = 0;
    enum st st = picture_encode_png(im, &data, &size, err);
    return write_encoded(path, st, data, size, err);
}

enum st picture_write_png16(const char *path, const struct image_u16 *im, struct errctx *err) {
    uint8_t *data = NULL;
    size_t size = 0;
    enum st st = picture_encode_png16(im, &data, &size, err);
    return write_encoded(path, st, data, size, err);
}

enum st picture_write_jpeg(const char *path, const struct image_u8 *im, int quality,
                           struct errctx *err) {
    uint8_t *data = NULL;
    size_t size = 0;
    enum st st = picture_encode_jpeg(im, quality, &data, &size, err);
    return write_encoded(path, st, data, size, err);
}
