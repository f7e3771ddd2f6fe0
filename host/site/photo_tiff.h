/* 3D photographs as multi-page TIFF, in memory: any TIFF reader opens them.
 *
 *   page 1  "colour"      RGB, 8 bits
 *   page 2  "disparity"   32-bit IEEE float, 1/m along the optical axis; NaN: none, 0: infinity
 *   page 3  "flags"       8 bits, enum photo_flag
 *   page 4  "confidence"  8 bits, see photo_sigma_from_confidence()
 *
 * The camera, its pose and the unit are JSON in page 1's ImageDescription (so `tiffinfo` shows
 * them), numbers with 17 digits: they come back bit for bit. Pages are deflated after a predictor;
 * a page that does not get smaller is stored plain, so that a file has at most 9 bytes a pixel and
 * a few kilobytes more. The bytes depend on the photograph alone. The largest photograph (2^28
 * pixels) fits a classic TIFF; BigTIFF files of others are read too. */
#ifndef SC_SITE_PHOTO_TIFF_H
#define SC_SITE_PHOTO_TIFF_H

#include "base/photo.h"
#include "base/st.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What a photograph file says beside the photograph. */
struct photo_tiff_info {
    char name[64];        /* for people, UTF-8; may be empty */
    char length_unit[16]; /* "m"; "baseline" where a stereo baseline of unknown length is the unit
                           * of every length, and "1/m" in this file means 1/baseline */
};

/* Bytes beyond 9 a pixel that a file may have: headers, descriptions, strip tables. */
#define PHOTO_TIFF_OVERHEAD_BYTES(pixels) ((size_t)8192 + (size_t)(pixels) / 512)

/* The file as bytes, malloc'ed. info may be NULL: no name, metres. ST_INVALID for a disparity that
 * is infinite or negative, a camera that camera_check() refuses or a pose that is no rotation;
 * ST_NOMEM. Thread-safe. Scratch: as much as the file. */
ST_MUST_CHECK enum st photo_tiff_encode(const struct photo *photo,
                                        const struct photo_tiff_info *info, uint8_t **out_data,
                                        size_t *out_size, struct errctx *err);

/* A photograph from bytes; out_info may be NULL. ST_FORMAT with one line for anything that is not
 * such a file, whole and sane: sizes are checked against each other, the bounds and the size of the
 * file before memory is taken. ST_NOMEM. Thread-safe. */
ST_MUST_CHECK enum st photo_tiff_decode(const void *data, size_t size, struct photo *out_photo,
                                        struct photo_tiff_info *out_info, struct errctx *err);

/* The same to and from a file (replaced as a whole or not at all); messages name the path. */
ST_MUST_CHECK enum st photo_tiff_write(const char *path, const struct photo *photo,
                                       const struct photo_tiff_info *info, struct errctx *err);
ST_MUST_CHECK enum st photo_tiff_read(const char *path, struct photo *out_photo,
                                      struct photo_tiff_info *out_info, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
