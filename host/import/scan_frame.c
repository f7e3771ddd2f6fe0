#include "import/scan_frame.h"

#include "base/picture.h"
#include "base/rig_yaml.h"
#include "import/kitti_calib.h"
#include "site/calib.h"
#include "site/frame_row.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CALIB_FILE_MAX_BYTES ((size_t)1 << 20)
#define IMAGE_FILE_MAX_BYTES ((size_t)256 << 20)

/* In the folder of the points; a star stands for their name without extension. */
static const char *const points[] = {"velodyne.bin", "points.bin", NULL};
static const char *const images[] = {"image.png", "../image_2/*.png", "*.png", NULL};
static const char *const calibs[] = {"calib.txt", "../calib/*.txt", "*.txt", NULL};

/* The first of the names that is there, with the stem for '*'; "" if none is. */
static enum st find_first(const char *dir, const char *stem, const char *const *names,
                          char out_path[FILEIO_PATH_MAX], struct errctx *err) {
    char name[FILEIO_PATH_MAX];
    out_path[0] = 0;
    for (; *names; names++) {
        const char *star = strchr(*names, '*');
        const int n = star ? snprintf(name, sizeof name, "%.*s%s%s", (int)(star - *names), *names,
                                      stem, star + 1)
                           : snprintf(name, sizeof name, "%s", *names);
        if (n < 0 || (size_t)n >= sizeof name)
            return errctx_set(err, ST_INVALID, "%s: the name is too long", dir);
        enum st st = fileio_join(dir, name, out_path, err);
        if (st || fileio_exists(out_path))
            return st;
    }
    out_path[0] = 0;
    return ST_OK;
}

enum st scan_frame_points(const char *dir, char out_path[FILEIO_PATH_MAX], struct errctx *err) {
    enum st st = find_first(dir, "", points, out_path, err);
    if (!st && !out_path[0])
        st = errctx_set(err, ST_NOT_FOUND, "%s: the folder has no velodyne.bin and no points.bin",
                        dir);
    return st;
}

void scan_frame_destroy(struct scan_frame *frame) {
    source_file_destroy(&frame->image);
    source_file_destroy(&frame->calib);
    memset(frame, 0, sizeof *frame);
}

static enum st size_of_image(const struct source_file *image, const char *path, int32_t *out_width,
                             int32_t *out_height, struct errctx *err) {
    struct picture picture;
    enum st st = picture_decode(image->bytes, image->size, path, &picture, err);
    if (st)
        return st;
    if (picture.sample == PICTURE_F32)
        st = errctx_set(err, ST_UNSUPPORTED, "%s is no photograph", path);
    *out_width = picture.width_px;
    *out_height = picture.height_px;
    picture_destroy(&picture);
    return st;
}

static enum st load(const char *image, const char *calib, struct scan_frame *frame,
                    struct errctx *err) {
    int32_t width_px = 0, height_px = 0;
    char text[RIG_YAML_MAX_BYTES];
    enum st st = source_file_read(image, IMAGE_FILE_MAX_BYTES, &frame->image, err);
    if (!st)
        st = size_of_image(&frame->image, image, &width_px, &height_px, err);
    if (!st)
        st = source_file_read(calib, CALIB_FILE_MAX_BYTES, &frame->calib, err);
    if (st)
        return st;
    st = kitti_calib_parse(frame->calib.bytes, frame->calib.size, width_px, height_px,
                           &frame->camera, &frame->station_from_cam, err);
    if (st)
        return errctx_prefix(err, st, "%s", calib);
    /* what will be stored must be what fusion will read */
    struct rig_camera written = {.camera = frame->camera, .head_from_cam = frame->station_from_cam};
    struct rig_camera again;
    st = rig_yaml_write_camera(&written, text, sizeof text);
    return st ? errctx_set(err, st, "%s: the camera does not fit into a record", calib)
              : rig_yaml_read_camera(text, strlen(text), calib, &again, err);
}

enum st scan_frame_find(const char *points_path, struct scan_frame *out_frame, struct errctx *err) {
    char dir[FILEIO_PATH_MAX], stem[FILEIO_PATH_MAX], image[FILEIO_PATH_MAX],
        calib[FILEIO_PATH_MAX];
    struct scan_frame frame;
    memset(&frame, 0, sizeof frame);
    enum st st = fileio_dirname(points_path, dir, err);
    if (st)
        return st;
    (void)snprintf(stem, sizeof stem, "%s", fileio_basename(points_path));
    char *dot = strrchr(stem, '.');
    if (dot && dot > stem)
        *dot = 0;
    if ((st = find_first(dir, stem, images, image, err)) ||
        (st = find_first(dir, stem, calibs, calib, err)))
        return st;
    if (image[0] && calib[0])
        st = load(image, calib, &frame, err);
    else
        frame.lacks = image[0]   ? "no calib.txt beside the image"
                      : calib[0] ? "no image.png beside calib.txt"
                                 : "no image.png and calib.txt beside the points";
    if (st)
        scan_frame_destroy(&frame);
    else
        *out_frame = frame;
    return st;
}

static enum st store_calib(struct site *site, const struct scan_frame *frame, const char *station,
                           int64_t *out_id, struct errctx *err) {
    char text[RIG_YAML_MAX_BYTES];
    const struct rig_camera camera = {.camera = frame->camera,
                                      .head_from_cam = frame->station_from_cam};
    enum st st = rig_yaml_write_camera(&camera, text, sizeof text);
    return st ? errctx_set(err, st, "the camera does not fit into a record")
              : calib_add_yaml(site, SCAN_FRAME_CALIB_KIND, station, CALIB_ESTIMATED, text, out_id,
                               err);
}

enum st scan_frame_store(struct site *site, const struct scan_frame *frame, int64_t station_id,
                         const char *station, struct job_hash out_inputs[2], struct errctx *err) {
    struct frame_row row;
    int64_t id = 0;
    memset(&row, 0, sizeof row);
    enum st st = source_file_put(site, &frame->image, "image", &out_inputs[0], err);
    if (!st)
        st = source_file_put(site, &frame->calib, "calibration", &out_inputs[1], err);
    if (!st)
        st = store_calib(site, frame, station, &row.camera_calib_id, err);
    if (st)
        return st;
    row.station_id = station_id;
    row.width_px = frame->camera.width_px;
    row.height_px = frame->camera.height_px;
    row.exposure_s = row.gain = (double)NAN;
    memcpy(row.sha256, out_inputs[0].sha256, sizeof row.sha256);
    return frame_row_add(site, &row, &id, err);
}
