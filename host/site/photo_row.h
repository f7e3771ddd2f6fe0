/* Rows of 3D photographs: the photograph is a TIFF file (files.h, FILES_PHOTO) that also carries
 * its camera and pose; the row makes it part of a station. Photographs are derived: a row can be
 * replaced by a better one. */
#ifndef SC_SITE_PHOTO_ROW_H
#define SC_SITE_PHOTO_ROW_H

#include "base/hash.h"
#include "base/pose.h"
#include "base/st.h"
#include "site/site.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct photo_row {
    int64_t id; /* output only */
    int64_t station_id;
    char name[SITE_NAME_MAX]; /* unique within the station */
    uint8_t sha256[HASH_SHA256_BYTES];
    int32_t width_px, height_px;
    struct pose station_from_cam;
    int64_t frame_id; /* the camera frame it was made from; 0: none */
    int64_t job_id;   /* the job that made it; 0: imported */
    int64_t utc_ns;   /* output only */
};

/* Adds a row; a row with the same station and name is replaced (with a custody event; its file
 * stays). ST_NOT_FOUND without station, file, frame or job; ST_INVALID for a bad name, size or
 * pose. */
ST_MUST_CHECK enum st photo_row_put(struct site *site, const struct photo_row *row, int64_t *out_id,
                                    struct errctx *err);
ST_MUST_CHECK enum st photo_row_get(struct site *site, int64_t id, struct photo_row *out_row,
                                    struct errctx *err);
/* `station` may be 0: the first of that name in any station. */
ST_MUST_CHECK enum st photo_row_find(struct site *site, int64_t station_id, const char *name,
                                     struct photo_row *out_row, struct errctx *err);
/* Removes the row (with a custody event); the file stays. */
ST_MUST_CHECK enum st photo_row_remove(struct site *site, int64_t id, struct errctx *err);
/* Pages through the photographs of a station (0: of all) in the order of id, see station_list(). */
ST_MUST_CHECK enum st photo_row_list(struct site *site, int64_t station_id, int64_t after_id,
                                     struct photo_row *out_rows, size_t capacity, size_t *out_count,
                                     struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
