/* Pictures from and to files: PNG (libspng), JPEG (libjpeg-turbo), PGM, PPM and PFM (own parser).
 * Every size is bounded before memory is taken; a truncated or absurd file gives ST_FORMAT and one
 * line that names the file. Values are as stored: no colour management, no gamma, alpha is dropped.
 */
#ifndef SC_BASE_PICTURE_H
#define SC_BASE_PICTURE_H

#include "base/image.h"
#include "base/st.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Largest picture file that is read. */
#define PICTURE_MAX_FILE_BYTES ((size_t)1 << 30)

enum picture_sample { PICTURE_U8, PICTURE_U16, PICTURE_F32 };

/* A decoded picture of whatever kind the file held. */
struct picture {
    void *
        px; /* [height][width][channels] of uint8_t, uint16_t or float, tightly packed; malloc'ed */
    int32_t width_px, height_px;
    int32_t channels; /* 1 grey, 3 RGB */
    enum picture_sample sample;
    uint32_t value_max; /* of integers: 255, 65535 or a PGM's own maximum */
};

/* Reads a file, or decodes one in memory (`name` is for messages); the kind is told by the content.
 * PFM: NaN and infinities become NaN, the scale factor's magnitude is ignored. Free with
 * picture_destroy(), which takes a zeroed one or NULL. */
ST_MUST_CHECK enum st picture_read(const char *path, struct picture *out_picture,
                                   struct errctx *err);
ST_MUST_CHECK enum st picture_decode(const void *data, size_t size, const char *name,
                                     struct picture *out_picture, struct errctx *err);
void picture_destroy(struct picture *picture);

/* To 8-bit RGB or grey: larger maxima are scaled to 255 and rounded, grey is copied to three
 * channels, colour becomes grey by ITU-R BT.601 weights. ST_UNSUPPORTED for floats. */
ST_MUST_CHECK enum st picture_to_rgb(const struct picture *picture, struct image_u8 *out_im,
                                     struct errctx *err);
ST_MUST_CHECK enum st picture_to_grey(const struct picture *picture, struct image_u8 *out_im,
                                      struct errctx *err);

/* To one channel of numbers, not scaled: what a depth or disparity map needs. A colour picture will
 * do only if its channels are equal everywhere, else ST_UNSUPPORTED. u16 takes integers only. */
ST_MUST_CHECK enum st picture_to_u16(const struct picture *picture, struct image_u16 *out_im,
                                     struct errctx *err);
ST_MUST_CHECK enum st picture_to_f32(const struct picture *picture, struct image_f32 *out_im,
                                     struct errctx *err);

/* Read and convert in one. */
ST_MUST_CHECK enum st picture_read_rgb(const char *path, struct image_u8 *out_im,
                                       struct errctx *err);
ST_MUST_CHECK enum st picture_read_grey(const char *path, struct image_u8 *out_im,
                                        struct errctx *err);
ST_MUST_CHECK enum st picture_read_u16(const char *path, struct image_u16 *out_im,
                                       struct errctx *err);

/* Encodes to memory (*out_data is malloc'ed). PNG keeps every value: 1, 3 or 4 channels of 8 bits,
 * 1 or 3 of
 * 16. JPEG: 1 or 3 channels, quality 1..100, chroma at half resolution. An empty image is
 * ST_INVALID. */
ST_MUST_CHECK enum st picture_encode_png(const struct image_u8 *im, uint8_t **out_data,
                                         size_t *out_size, struct errctx *err);
ST_MUST_CHECK enum st picture_encode_png16(const struct image_u16 *im, uint8_t **out_data,
                                           size_t *out_size, struct errctx *err);
ST_MUST_CHECK enum st picture_encode_jpeg(const struct image_u8 *im, int quality,
                                          uint8_t **out_data, size_t *out_size, struct errctx *err);

/* The same to a file, whole or not at all. */
ST_MUST_CHECK enum st picture_write_png(const char *path, const struct image_u8 *im,
                                        struct errctx *err);
ST_MUST_CHECK enum st picture_write_png16(const char *path, const struct image_u16 *im,
                                          struct errctx *err);
ST_MUST_CHECK enum st picture_write_jpeg(const char *path, const struct image_u8 *im, int quality,
                                         struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
