/* Photographs of one station: which to make, and making those that are out of date. */
#ifndef SC_APP_FUSE_PHOTO_H
#define SC_APP_FUSE_PHOTO_H

#include "app/fuse_settings.h"
#include "app/fuse_source.h"
#include "base/photo.h"
#include "base/progress.h"
#include "fusion/face.h"
#include "site/photo_row.h"
#include "site/station.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* One photograph of the site. */
struct fuse_photo {
    char name[SITE_NAME_MAX];
    int64_t station_id;
    struct pose world_from_station;
    double pose_sigma_m, pose_sigma_rad; /* of the station */
    struct camera camera;                /* the pinhole */
    struct pose station_from_cam;
    /* from a frame; frame_id 0: coloured by the samples */
    int64_t frame_id;
    uint8_t frame_sha256[HASH_SHA256_BYTES], camera_sha256[HASH_SHA256_BYTES];
    struct camera frame_camera;
    /* outcome */
    uint8_t made_sha256[HASH_SHA256_BYTES];  /* without reprojection */
    uint8_t final_sha256[HASH_SHA256_BYTES]; /* with it */
    int64_t job_id, row_id;                  /* row_id: where it was read from rows */
    bool kept;                               /* was up to date */
    struct photo photo; /* in memory once loaded; made photographs stay in memory */
    struct resolve_counts counts;
    int64_t samples;
    double seconds;
};

struct fuse_photos {
    struct fuse_photo *list;
    size_t count;
};

/* What was found out about a station. */
struct fuse_station {
    int64_t id;
    char name[SITE_NAME_MAX];
    bool has_samples;
    struct face_survey survey;
    struct noise_model noise;
    struct cart_clock_report clock; /* head streams only */
    struct rays_counts rays;
    const char *calibration;
    int64_t damaged_packets;
    size_t photo_count, kept_count, frame_count;
    double seconds_read, seconds_photos;
};

/* Plans and makes all photographs of a station and adds them to `photos`. Those whose inputs and
 * parameters have not changed are not made again. `progress` counts photographs. ST_NOT_FOUND
 * never: a station without samples adds nothing. */
ST_MUST_CHECK enum st fuse_photo_station(struct site *site, const struct station *station,
                                         const struct fuse_settings *settings,
                                         struct fuse_photos *photos,
                                         struct fuse_station *out_station,
                                         struct progress *progress, struct errctx *err);

/* Reads the photograph into memory unless it is there. */
ST_MUST_CHECK enum st fuse_photo_load(struct site *site, struct fuse_photo *photo,
                                      const uint8_t sha256[HASH_SHA256_BYTES], struct errctx *err);

/* Name and version that jobs of fusion carry. */
extern const char fuse_photo_program[];

void fuse_photos_fini(struct fuse_photos *photos); /* takes a zeroed one */

#endif
