/* One scan to import, from files to a station: prepared without touching the site, then stored. */
#ifndef SC_IMPORT_SCAN_JOB_H
#define SC_IMPORT_SCAN_JOB_H

#include "base/fileio.h"
#include "base/photo.h"
#include "base/sample_shade.h"
#include "base/st.h"
#include "import/ply_grid.h"
#include "import/scan.h"
#include "import/scan_3dtk.h"
#include "import/scan_frame.h"
#include "import/scan_photo.h"
#include "import/source_file.h"
#include "site/site.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct scan_job {
    char name[SITE_NAME_MAX]; /* of the station; empty: the file's */
    /* .3d, PLY or a turned laser's log, told apart by content; a spinning laser's .bin by its name;
     * a folder with velodyne.bin becomes the path of that */
    char path[FILEIO_PATH_MAX];
    /* Where the scan stood. For .3d a .pose file (empty: the one beside the scan, if there is one),
     * for PLY a Stanford .conf (empty: none), for PLY also seven numbers in the file's frame and
     * unit. */
    char pose_path[FILEIO_PATH_MAX];
    bool has_pose;
    struct pose world_from_file;
    struct scan_3dtk_options options_3dtk;
    struct ply_grid_options options_ply;
    double range_sigma_m; /* of one range; 0: 0.01 for .3d and logs, 0.02 for .bin, a twentieth of
                           * the spacing of the samples for PLY, at most 1 mm */
    enum sample_shade_style style;
    bool no_photos;

    /* set by scan_job_prepare(), released by scan_job_fini() */
    struct source_file file, pose_file; /* pose_file.bytes NULL: none */
    struct scan scan;
    struct scan_frame frame; /* of a spinning laser's camera; image.bytes NULL: none */
    bool posed;              /* a pose was found or given */
    double used_sigma_m;
    int face_count;
    struct scan_job_face {
        char name[8];
        struct camera camera;
        struct pose station_from_cam;
        uint8_t *tiff;
        size_t tiff_size;
    } faces[SCAN_PHOTO_FACES_MAX];
    size_t surfaces, no_returns;
    double seconds;
};

struct scan_job scan_job_default(void);
void scan_job_fini(struct scan_job *job); /* takes NULL; paths and options stay */

/* Reads the files, finds the grid and the pose, draws and encodes the photographs (none of samples
 * without a grid). Messages name the file. Needs no site. Fills an empty name. */
ST_MUST_CHECK enum st scan_job_prepare(struct scan_job *job, struct errctx *err);

/* ST_EXISTS if the site has a station of a job's name, or two jobs have one. Reads the site only.
 */
ST_MUST_CHECK enum st scan_job_check_names(struct site *site, const struct scan_job *jobs,
                                           size_t count, struct errctx *err);

/* Stores a prepared job as a new station: files as they came, samples as a polar stream,
 * photographs, the camera's frame, job. Inside the caller's batch. */
ST_MUST_CHECK enum st scan_job_store(struct site *site, const struct scan_job *job,
                                     int64_t *out_station_id, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
