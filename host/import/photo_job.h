/* One photograph to import, from files to rows: prepared without touching the site, then stored. */
#ifndef SC_IMPORT_PHOTO_JOB_H
#define SC_IMPORT_PHOTO_JOB_H

#include "base/fileio.h"
#include "base/photo.h"
#include "base/st.h"
#include "import/photo_import.h"
#include "import/source_file.h"
#include "site/site.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct photo_job {
    char name[SITE_NAME_MAX];    /* empty: the image's file name */
    char station[SITE_NAME_MAX]; /* empty: the photograph's name */
    char image_path[FILEIO_PATH_MAX], map_path[FILEIO_PATH_MAX];
    /* fx 0: from hfov_rad; fy 0: fx; cx, cy NaN: the middle; sizes are the image's. */
    struct camera camera;
    double hfov_rad;
    struct photo_import_map values; /* step 0: 1 for maps of integers */
    bool has_pose;
    struct pose world_from_cam; /* without one: level at the station, looking along its y */
    bool replace;               /* a photograph of that name may be there */

    /* set by photo_job_resolve() */
    bool station_is_new;
    struct pose world_from_station;
    /* set by photo_job_prepare(), released by photo_job_fini() */
    struct source_file image, map;
    uint8_t *tiff;
    size_t tiff_size;
    struct camera made_camera;
    struct pose station_from_cam;
    struct photo_import_result result;
    double seconds;
};

/* A job with nothing set but what means "default". */
struct photo_job photo_job_default(void);
void photo_job_fini(struct photo_job *job); /* takes NULL; paths and options stay */

/* Names, and the stations' poses: of the site, of an earlier job of the list, or new: level, where
 * the camera stands. ST_EXISTS if a photograph of that name is in the site (unless `replace`) or
 * twice in the list; ST_INVALID for bad names. Reads the site only. */
ST_MUST_CHECK enum st photo_job_resolve(struct site *site, struct photo_job *jobs, size_t count,
                                        struct errctx *err);

/* Reads the files, makes the photograph and encodes it. Messages name the file. Needs no site; jobs
 * may be prepared in any order. */
ST_MUST_CHECK enum st photo_job_prepare(struct photo_job *job, struct errctx *err);

/* Stores a prepared job: station if new, image and map as they came, photograph, rows, job. Inside
 * the caller's batch. */
ST_MUST_CHECK enum st photo_job_store(struct site *site, struct photo_job *job,
                                      int64_t *out_photo_id, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
