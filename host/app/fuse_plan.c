#include "app/fuse_plan.h"

#include "base/rig_yaml.h"
#include "fusion/frame.h"
#include "site/frame_row.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PAGE = 16 };

static enum st add(struct fuse_photos *photos, const struct fuse_photo *photo, struct errctx *err) {
    struct fuse_photo *grown = realloc(photos->list, (photos->count + 1) * sizeof *grown);
    if (!grown)
        return errctx_set(err, ST_NOMEM, "no memory for %zu photographs", photos->count + 1);
    photos->list = grown;
    photos->list[photos->count++] = *photo;
    return ST_OK;
}

void fuse_plan_pose_sigma(const struct station_pose *pose, const struct fuse_settings *settings,
                          double *out_sigma_m, double *out_sigma_rad) {
    const double *c = pose->covariance;
    if (settings->pose_sigma_m > 0) {
        *out_sigma_m = settings->pose_sigma_m;
        *out_sigma_rad = 0.1 * settings->pose_sigma_m; /* as seen from 10 m */
    } else if (pose->has_covariance) {
        *out_sigma_rad = sqrt((c[0] + c[7] + c[14]) / 3.0);
        *out_sigma_m = sqrt((c[21] + c[28] + c[35]) / 3.0);
    } else {
        bool guess = !strcmp(pose->source, "nominal");
        *out_sigma_m = guess ? 0.2 : 0.02;
        *out_sigma_rad = guess ? 0.05 : 0.005;
    }
}

static struct fuse_photo blank(const struct station *station, const struct fuse_settings *settings,
                               const char *what) {
    struct fuse_photo p;
    memset(&p, 0, sizeof p);
    fuse_plan_pose_sigma(&station->pose, settings, &p.pose_sigma_m, &p.pose_sigma_rad);
    p.station_id = station->id;
    p.world_from_station = station->pose.world_from_station;
    (void)snprintf(p.name, sizeof p.name, "%.30s-%.30s", station->name, what);
    return p;
}

/* ---- without a camera ---- */

static enum st plan_faces(const struct station *station, const struct fuse_source *source,
                          const struct face_survey *survey, const struct fuse_settings *s,
                          struct fuse_photos *photos, struct errctx *err) {
    double pixel_rad = s->pixel_spacings * survey->spacing_rad;
    if (!survey->return_count)
        return ST_OK; /* nothing but no returns: there is nothing to show */
    if (!isnan(survey->half_angle_rad)) {
        struct fuse_photo p = blank(station, s, "view");
        face_narrow(survey, pixel_rad, s->face_max_px, &p.camera, &p.station_from_cam);
        p.station_from_cam.t_m = source->origin_m;
        return add(photos, &p, err);
    }
    enum st st = ST_OK;
    for (int face = 0; !st && face < FACE_COUNT; face++) {
        if (!survey->seen[face])
            continue;
        struct fuse_photo p = blank(station, s, face_name(face));
        p.camera = face_camera(face_size_px(pixel_rad, s->face_max_px));
        p.station_from_cam = face_station_from_cam(face);
        p.station_from_cam.t_m = source->origin_m;
        st = add(photos, &p, err);
    }
    return st;
}

/* ---- with a camera ---- */

/* Steps of the motors when the frame was taken, from the frame's remark; false if it does not say.
 */
static bool steps_of(const struct frame_row *row, double *out_pan, double *out_tilt) {
    cJSON *meta = row->meta[0] ? cJSON_Parse(row->meta) : NULL;
    const cJSON *pan = cJSON_GetObjectItemCaseSensitive(meta, "pan_steps");
    const cJSON *tilt = cJSON_GetObjectItemCaseSensitive(meta, "tilt_steps");
    bool both = cJSON_IsNumber(pan) && cJSON_IsNumber(tilt);
    if (both) {
        *out_pan = pan->valuedouble;
        *out_tilt = tilt->valuedouble;
    }
    cJSON_Delete(meta);
    return both;
}

/* The camera's record. The cart's camera has many, of which the wanted or the best counts; a frame
 * of another's keeps the one that it names. */
static enum st camera_of(struct site *site, const struct frame_row *row,
                         const struct fuse_settings *s, char *text, struct calib *out_record,
                         struct rig_camera *out_camera, struct errctx *err) {
    enum st st = calib_read(site, row->camera_calib_id, out_record, text, CALIB_MAX_BYTES + 1, err);
    if (!st && !strcmp(out_record->kind, "camera")) {
        st = fuse_source_calibration(site, "camera", s->calibration, out_record, text, err);
        if (st == ST_NOT_FOUND)
            st = calib_read(site, row->camera_calib_id, out_record, text, CALIB_MAX_BYTES + 1, err);
    }
    if (!st)
        st = rig_yaml_read_camera(text, out_record->size_bytes, out_record->name, out_camera, err);
    return st;
}

static enum st plan_frame(struct site *site, const struct station *station,
                          const struct fuse_source *source, const struct frame_row *row,
                          const struct fuse_settings *s, char *text, struct fuse_photos *photos,
                          struct errctx *err) {
    struct rig_camera camera;
    struct calib record;
    double pan_steps = 0, tilt_steps = 0, pan_rad = row->pan_rad, tilt_rad = row->tilt_rad;
    bool steps = source->rays && steps_of(row, &pan_steps, &tilt_steps);
    if (steps) { /* the calibrated axes say more than the commanded angles */
        pan_rad = rig_pan_angle(&source->rig, pan_steps, 1);
        tilt_rad = rig_tilt_angle(&source->rig, tilt_steps);
    }
    if (!row->camera_calib_id || !isfinite(pan_rad) || !isfinite(tilt_rad))
        return ST_OK; /* a frame without a pose is a picture, not a photograph */
    enum st st = camera_of(site, row, s, text, &record, &camera, err);
    if (st)
        return st;
    if (camera.camera.width_px != row->width_px || camera.camera.height_px != row->height_px)
        return errctx_set(err, ST_INVALID, "frame %lld is not of the calibrated camera's size",
                          (long long)row->id);
    char what[32];
    (void)snprintf(what, sizeof what, "frame%lld", (long long)row->id);
    struct fuse_photo p = blank(station, s, what);
    p.frame_id = row->id;
    memcpy(p.frame_sha256, row->sha256, sizeof p.frame_sha256);
    memcpy(p.camera_sha256, record.sha256, sizeof p.camera_sha256);
    p.frame_camera = camera.camera;
    p.station_from_cam = rig_camera_pose(&camera, tilt_rad, pan_rad);
    p.camera = frame_pinhole(&camera.camera, (int32_t)lrint(row->width_px * s->frame_scale),
                             (int32_t)lrint(row->height_px * s->frame_scale));
    return add(photos, &p, err);
}

static enum st plan_frames(struct site *site, const struct station *station,
                           const struct fuse_source *source, const struct fuse_settings *s,
                           struct fuse_photos *photos, struct errctx *err) {
    struct frame_row rows[PAGE];
    size_t count = PAGE;
    int64_t after = 0;
    char *text = malloc(CALIB_MAX_BYTES + 1);
    enum st st = text ? ST_OK : errctx_set(err, ST_NOMEM, "no memory for a calibration");
    while (!st && count == PAGE) {
        st = frame_row_list(site, station->id, after, rows, PAGE, &count, err);
        for (size_t i = 0; !st && i < count; i++) {
            st = plan_frame(site, station, source, &rows[i], s, text, photos, err);
            after = rows[i].id;
        }
    }
    free(text);
    return st;
}

enum st fuse_plan_station(struct site *site, const struct station *station,
                          const struct fuse_source *source, const struct face_survey *survey,
                          const struct fuse_settings *settings, struct fuse_photos *photos,
                          struct errctx *err) {
    size_t before = photos->count;
    enum st st = plan_frames(site, station, source, settings, photos, err);
    /* The cart's camera sees all that its laser does; another's need not. */
    bool faces = photos->count == before || settings->faces_always || !source->rays;
    if (!st && faces)
        st = plan_faces(station, source, survey, settings, photos, err);
    return st;
}
