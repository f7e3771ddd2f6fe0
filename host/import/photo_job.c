#include "import/photo_job.h"

#include "base/clock.h"
#include "base/json.h"
#include "base/picture.h"
#include "import/frame_up.h"
#include "site/files.h"
#include "site/frame_row.h"
#include "site/job.h"
#include "site/photo_row.h"
#include "site/photo_tiff.h"
#include "site/station.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct photo_job photo_job_default(void) {
    struct photo_job job;
    memset(&job, 0, sizeof job);
    job.camera.cx_px = job.camera.cy_px = NAN;
    job.world_from_cam = frame_up_level_camera();
    return job;
}

void photo_job_fini(struct photo_job *job) {
    if (!job)
        return;
    source_file_destroy(&job->image);
    source_file_destroy(&job->map);
    free(job->tiff);
    job->tiff = NULL;
    job->tiff_size = 0;
}

/* ---- names and stations ---- */

static enum st default_names(struct photo_job *job, struct errctx *err) {
    if (!job->name[0]) {
        const char *name = fileio_basename(job->image_path);
        const char *dot = strrchr(name, '.');
        const size_t n = dot && dot > name ? (size_t)(dot - name) : strlen(name);
        (void)snprintf(job->name, sizeof job->name, "%.*s", (int)(n < 60 ? n : 60), name);
    }
    if (!job->station[0])
        (void)snprintf(job->station, sizeof job->station, "%s", job->name);
    if (!site_name_is_valid(job->name) || !site_name_is_valid(job->station))
        return errctx_set(err, ST_INVALID, "'%s' or '%s' is no name for a photograph or a station",
                          job->name, job->station);
    return ST_OK;
}

static enum st check_name(struct site *site, int64_t station_id, const struct photo_job *job,
                          struct errctx *err) {
    struct photo_row row;
    enum st st = photo_row_find(site, station_id, job->name, &row, err);
    if (st == ST_NOT_FOUND)
        return ST_OK;
    if (!st && !job->replace)
        return errctx_set(err, ST_EXISTS,
                          "station %s has a photograph %s already: give another --name, or "
                          "--replace",
                          job->station, job->name);
    return st;
}

static enum st resolve_one(struct site *site, struct photo_job *jobs, size_t at,
                           struct errctx *err) {
    struct photo_job *job = &jobs[at];
    enum st st = default_names(job, err);
    if (st)
        return st;
    struct station station;
    st = station_find(site, job->station, &station, err);
    if (!st) {
        job->station_is_new = false;
        job->world_from_station = station.pose.world_from_station;
        if ((st = check_name(site, station.id, job, err)))
            return st;
    } else if (st != ST_NOT_FOUND) {
        return st;
    } else {
        job->station_is_new = true;
        job->world_from_station = pose_identity();
        if (job->has_pose)
            job->world_from_station.t_m = job->world_from_cam.t_m;
    }
    for (size_t i = 0; i < at; i++) {
        if (strcmp(jobs[i].station, job->station) != 0)
            continue;
        if (!strcmp(jobs[i].name, job->name))
            return errctx_set(err, ST_EXISTS, "station %s gets a photograph %s twice", job->station,
                              job->name);
        job->world_from_station = jobs[i].world_from_station;
    }
    if (!job->has_pose) {
        const struct pose level = frame_up_level_camera();
        job->world_from_cam = pose_compose(&job->world_from_station, &level);
    }
    return ST_OK;
}

enum st photo_job_resolve(struct site *site, struct photo_job *jobs, size_t count,
                          struct errctx *err) {
    for (size_t i = 0; i < count; i++) {
        enum st st = resolve_one(site, jobs, i, err);
        if (st)
            return st;
    }
    return ST_OK;
}

/* ---- from files to a photograph ---- */

static enum st complete_camera(const struct photo_job *job, const struct image_u8 *rgb,
                               struct camera *out_camera, struct errctx *err) {
    struct camera c = job->camera;
    c.width_px = rgb->width_px;
    c.height_px = rgb->height_px;
    if (!(c.fx_px > 0.0)) {
        if (!(job->hfov_rad > 0.0 && job->hfov_rad < 3.1))
            return errctx_set(err, ST_INVALID,
                              "no focal length: give it in pixels, or the horizontal field of "
                              "view (below 177 deg)");
        c.fx_px = 0.5 * rgb->width_px / tan(0.5 * job->hfov_rad);
    }
    if (!(c.fy_px > 0.0))
        c.fy_px = c.fx_px;
    if (isnan(c.cx_px))
        c.cx_px = 0.5 * (rgb->width_px - 1);
    if (isnan(c.cy_px))
        c.cy_px = 0.5 * (rgb->height_px - 1);
    *out_camera = c;
    return ST_OK;
}

struct decoded {
    struct image_u8 rgb;
    struct image_f32 map;
    bool integers;
};

static enum st decode(const struct photo_job *job, struct decoded *out, struct errctx *err) {
    struct picture picture = {0};
    enum st st = picture_decode(job->image.bytes, job->image.size, job->image_path, &picture, err);
    if (!st && (st = picture_to_rgb(&picture, &out->rgb, err)))
        st = errctx_prefix(err, st, "%s", job->image_path);
    picture_destroy(&picture);
    if (st)
        return st;
    st = picture_decode(job->map.bytes, job->map.size, job->map_path, &picture, err);
    if (!st) {
        out->integers = picture.sample != PICTURE_F32;
        st = picture_to_f32(&picture, &out->map, err);
        if (st)
            st = errctx_prefix(err, st, "%s", job->map_path);
    }
    picture_destroy(&picture);
    return st;
}

static enum st make(struct photo_job *job, const struct decoded *decoded, struct errctx *err) {
    struct photo_import in = {.rgb = &decoded->rgb, .map = &decoded->map, .values = job->values};
    const struct pose station_from_world = pose_inverse(&job->world_from_station);
    in.station_from_cam = pose_compose(&station_from_world, &job->world_from_cam);
    if (decoded->integers && !(in.values.step > 0.0))
        in.values.step = 1.0;
    job->values.step = in.values.step;
    struct photo photo = {0};
    enum st st = complete_camera(job, &decoded->rgb, &in.camera, err);
    if (!st)
        st = photo_import_make(&in, &photo, &job->result, err);
    if (st)
        return errctx_prefix(err, st, "%s with %s", job->image_path, job->map_path);
    job->made_camera = photo.camera;
    job->station_from_cam = photo.station_from_cam;
    struct photo_tiff_info info;
    memset(&info, 0, sizeof info);
    (void)snprintf(info.name, sizeof info.name, "%s", job->name);
    (void)snprintf(info.length_unit, sizeof info.length_unit, "%s",
                   job->result.relative ? "baseline" : "m");
    st = photo_tiff_encode(&photo, &info, &job->tiff, &job->tiff_size, err);
    photo_destroy(&photo);
    return st ? errctx_prefix(err, st, "%s", job->image_path) : ST_OK;
}

enum st photo_job_prepare(struct photo_job *job, struct errctx *err) {
    const int64_t start_ns = clock_now_ns();
    struct decoded decoded = {0};
    enum st st = source_file_read(job->image_path, PICTURE_MAX_FILE_BYTES, &job->image, err);
    if (!st)
        st = source_file_read(job->map_path, PICTURE_MAX_FILE_BYTES, &job->map, err);
    if (!st)
        st = decode(job, &decoded, err);
    if (!st)
        st = make(job, &decoded, err);
    image_u8_destroy(&decoded.rgb);
    image_f32_destroy(&decoded.map);
    if (st)
        photo_job_fini(job);
    job->seconds = (double)(clock_now_ns() - start_ns) * 1e-9;
    return st;
}

/* ---- into the site ---- */

static void add_values(struct json *json, const struct photo_import_map *v) {
    static const char *const kinds[] = {"depth", "range", "disparity"};
    struct cJSON *map = json_object(json, NULL, "map");
    json_text(json, map, "kind", kinds[v->kind]);
    json_number(json, map, "scale", v->scale);
    json_number(json, map, "offset", v->offset);
    json_number(json, map, "unknown", v->unknown);
    json_number(json, map, "baseline_m", v->baseline_m);
    json_number(json, map, "step", v->step);
    json_boolean(json, map, "dequantise", v->dequantise);
    json_number(json, map, "sigma_m", v->sigma_m);
    json_number(json, map, "sigma_per_m", v->sigma_per_m);
    json_number(json, map, "sigma_px", v->sigma_px);
}

static void add_camera(struct json *json, const struct photo_job *job) {
    const struct camera *c = &job->made_camera, *d = &job->camera;
    struct cJSON *camera = json_object(json, NULL, "camera");
    const struct {
        const char *key;
        double value;
    } numbers[] = {{"fx_px", c->fx_px}, {"fy_px", c->fy_px}, {"cx_px", c->cx_px},
                   {"cy_px", c->cy_px}, {"k1", d->k1},       {"k2", d->k2},
                   {"p1", d->p1},       {"p2", d->p2},       {"k3", d->k3}};
    json_integer(json, camera, "width_px", c->width_px);
    json_integer(json, camera, "height_px", c->height_px);
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++)
        json_number(json, camera, numbers[i].key, numbers[i].value);
}

static enum st parameters_text(const struct photo_job *job, char **out_text, struct errctx *err) {
    struct json json;
    json_init_object(&json);
    json_text(&json, NULL, "name", job->name);
    json_text(&json, NULL, "station", job->station);
    add_camera(&json, job);
    add_values(&json, &job->values);
    struct cJSON *pose = json_array(&json, NULL, "station_from_cam");
    const struct mat4 m = pose_to_mat4(&job->station_from_cam);
    for (int i = 0; i < 12; i++)
        json_number(&json, pose, NULL, m.m[i]);
    enum st st = json_print(&json, out_text, err);
    json_fini(&json);
    return st;
}

static enum st station_id(struct site *site, const struct photo_job *job, int64_t *out_id,
                          struct errctx *err) {
    struct station station;
    enum st st = station_find(site, job->station, &station, err);
    if (!st)
        *out_id = station.id;
    if (st != ST_NOT_FOUND)
        return st;
    struct station_pose pose;
    memset(&pose, 0, sizeof pose);
    pose.world_from_station = job->world_from_station;
    (void)snprintf(pose.source, sizeof pose.source, "%s", job->has_pose ? "import" : "nominal");
    return station_add(site, job->station, NULL, &pose, out_id, err);
}

static enum st add_job(struct site *site, const struct photo_job *job,
                       const struct job_hash inputs[2], const struct job_hash *output,
                       int64_t *out_id, struct errctx *err) {
    char *parameters = NULL;
    enum st st = parameters_text(job, &parameters, err);
    if (st)
        return st;
    const struct job row = {.kind = "import.photo",
                            .parameters = parameters,
                            .program = "scancart " SCANCART_VERSION,
                            .inputs = inputs,
                            .input_count = 2,
                            .outputs = output,
                            .output_count = 1,
                            .seconds = job->seconds};
    st = job_add(site, &row, out_id, err);
    free(parameters);
    return st;
}

enum st photo_job_store(struct site *site, struct photo_job *job, int64_t *out_photo_id,
                        struct errctx *err) {
    struct job_hash inputs[2], output;
    memset(&output, 0, sizeof output);
    (void)snprintf(output.role, sizeof output.role, "photo");
    struct photo_row row;
    memset(&row, 0, sizeof row);
    struct frame_row frame;
    memset(&frame, 0, sizeof frame);
    frame.exposure_s = frame.gain = frame.pan_rad = frame.tilt_rad = NAN;
    frame.width_px = row.width_px = job->made_camera.width_px;
    frame.height_px = row.height_px = job->made_camera.height_px;
    enum st st = station_id(site, job, &row.station_id, err);
    if (st || (st = source_file_put(site, &job->image, "image", &inputs[0], err)) ||
        (st = source_file_put(site, &job->map, "map", &inputs[1], err)) ||
        (st = files_put(site, FILES_PHOTO, "tif", job->tiff, job->tiff_size, output.sha256, err)) ||
        (st = add_job(site, job, inputs, &output, &row.job_id, err)))
        return st;
    frame.station_id = row.station_id;
    memcpy(frame.sha256, inputs[0].sha256, sizeof frame.sha256);
    st = frame_row_add(site, &frame, &row.frame_id, err);
    if (st)
        return st;
    (void)snprintf(row.name, sizeof row.name, "%s", job->name);
    memcpy(row.sha256, output.sha256, sizeof row.sha256);
    row.station_from_cam = job->station_from_cam;
    return photo_row_put(site, &row, out_photo_id, err);
}
