/* The photograph that a camera beside a spinning laser took: image and calibration found beside the
 * points, checked, and stored as a camera frame of the scan's station, from which fusion then makes
 * a 3D photograph. */
#ifndef SC_IMPORT_SCAN_FRAME_H
#define SC_IMPORT_SCAN_FRAME_H

#include "base/camera.h"
#include "base/fileio.h"
#include "base/pose.h"
#include "base/st.h"
#include "import/source_file.h"
#include "site/job.h"
#include "site/site.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Kind of the calibration record of a frame that came from outside; "camera" is the cart's own. */
#define SCAN_FRAME_CALIB_KIND "import-camera"

struct scan_frame {
    struct source_file image, calib; /* bytes NULL: there is no frame */
    struct camera camera;
    struct pose station_from_cam;
    const char *lacks; /* why there is none: static text; NULL where there is one */
};

/* The points of a KITTI folder: its velodyne.bin or points.bin. ST_NOT_FOUND names the folder. */
ST_MUST_CHECK enum st scan_frame_points(const char *dir, char out_path[FILEIO_PATH_MAX],
                                        struct errctx *err);

/* Looks for both files beside the points STEM.bin (image.png or STEM.png; calib.txt or STEM.txt)
 * and in the folders of the dataset as published (../image_2/STEM.png, ../calib/STEM.txt), reads
 * and checks them. No frame if one of them is not there: that is no failure, out_frame->lacks says
 * it. Messages name the file. Free with scan_frame_destroy(), which takes a zeroed one. */
ST_MUST_CHECK enum st scan_frame_find(const char *points_path, struct scan_frame *out_frame,
                                      struct errctx *err);
void scan_frame_destroy(struct scan_frame *frame);

/* Stores image, calibration record (named after the station) and frame, inside the caller's batch.
 * The frame's place is pan 0, tilt 0: the head's frame there is the station's. Fills the two inputs
 * of the job. */
ST_MUST_CHECK enum st scan_frame_store(struct site *site, const struct scan_frame *frame,
                                       int64_t station_id, const char *station,
                                       struct job_hash out_inputs[2], struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
