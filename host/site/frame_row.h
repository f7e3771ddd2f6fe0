/* Rows of camera frames: the pixels as received are a file (files.h, FILES_FRAME), the row says
 * when and how. */
#ifndef SC_SITE_FRAME_ROW_H
#define SC_SITE_FRAME_ROW_H

#include "base/hash.h"
#include "base/st.h"
#include "site/site.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct frame_row {
    int64_t id; /* output only */
    int64_t station_id;
    int64_t t_ns; /* host monotonic, middle of the exposure */
    uint8_t sha256[HASH_SHA256_BYTES];
    int32_t width_px, height_px;
    double exposure_s, gain;  /* NaN: not known */
    double pan_rad, tilt_rad; /* as commanded or latched; NaN: not known */
    int64_t camera_calib_id;  /* 0: none */
    char meta[SITE_TEXT_MAX]; /* JSON: strobe time, controller steps, ...; or "" */
};

/* ST_NOT_FOUND without the station, the file or the calibration record. */
ST_MUST_CHECK enum st frame_row_add(struct site *site, const struct frame_row *row, int64_t *out_id,
                                    struct errctx *err);
ST_MUST_CHECK enum st frame_row_get(struct site *site, int64_t id, struct frame_row *out_row,
                                    struct errctx *err);
/* Pages through the frames of a station (0: of all) in the order of id, see station_list(). */
ST_MUST_CHECK enum st frame_row_list(struct site *site, int64_t station_id, int64_t after_id,
                                     struct frame_row *out_rows, size_t capacity, size_t *out_count,
                                     struct errctx *err);

/* Calls `visit` for each frame of a station in turn, until one fails; its failure is returned.
 * ST_NOMEM. */
ST_MUST_CHECK enum st frame_row_each(struct site *site, int64_t station_id,
                                     enum st (*visit)(void *ctx, const struct frame_row *row,
                                                      struct errctx *err),
                                     void *ctx, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
