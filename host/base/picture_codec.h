/* The decoders behind picture_decode(). Not for use outside base. */
#ifndef SC_BASE_PICTURE_CODEC_H
#define SC_BASE_PICTURE_CODEC_H

#include "base/picture.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Allocates out_picture->px after checking the size against IMAGE_MAX_SIDE_PX and IMAGE_MAX_PIXELS;
 * the other fields are set by the caller before. `name` is for messages. */
ST_MUST_CHECK enum st picture_allocate(struct picture *picture, const char *name,
                                       struct errctx *err);

/* Each decodes a whole file in memory; on failure nothing is left allocated. */
ST_MUST_CHECK enum st picture_png_decode(const uint8_t *data, size_t size, const char *name,
                                         struct picture *out_picture, struct errctx *err);
ST_MUST_CHECK enum st picture_jpeg_decode(const uint8_t *data, size_t size, const char *name,
                                          struct picture *out_picture, struct errctx *err);
ST_MUST_CHECK enum st picture_pnm_decode(const uint8_t *data, size_t size, const char *name,
                                         struct picture *out_picture, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
