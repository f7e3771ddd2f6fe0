#include "app/fuse_photo.h"

#include "app/fuse_plan.h"
#include "base/clock.h"
#include "base/json.h"
#include "base/picture.h"
#include "fusion/frame.h"
#include "fusion/shade.h"
#include "raster/skin.h"
#include "site/files.h"
#include "site/job.h"
#include "site/photo_tiff.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The number counts changes of what fusion computes: results of other numbers are made anew. */
const char fuse_photo_program[] = "scancart " SCANCART_VERSION " fusion 5";

void fuse_photos_fini(struct fuse_photos *photos) {
    for (size_t i = 0; i < photos->count; i++)
        photo_destroy(&photos->list[i].photo);
    free(photos->list);
    memset(photos, 0, sizeof *photos);
}

enum st fuse_photo_load(struct site *site, struct fuse_photo *photo,
                        const uint8_t sha256[HASH_SHA256_BYTES], struct errctx *err) {
    if (photo->photo.disparity_per_m)
        return ST_OK;
    uint8_t *bytes = NULL;
    size_t size = 0;
    enum st st = files_read(site, sha256, &bytes, &size, err);
    if (!st)
        st = photo_tiff_decode(bytes, size, &photo->photo, NULL, err);
    free(bytes);
    return st ? errctx_prefix(err, st, "photograph %s", photo->name) : ST_OK;
}

/* ---- is it up to date? ---- */

static void put_camera(struct json *json, const char *key, const struct camera *c) {
    struct cJSON *o = json_object(json, NULL, key);
    json_integer(json, o, "width_px", c->width_px);
    json_integer(json, o, "height_px", c->height_px);
    json_number(json, o, "fx_px", c->fx_px);
    json_number(json, o, "fy_px", c->fy_px);
    json_number(json, o, "cx_px", c->cx_px);
    json_number(json, o, "cy_px", c->cy_px);
}

static void put_pose(struct json *json, const char *key, const struct pose *pose) {
    struct cJSON *o = json_array(json, NULL, key);
    for (int i = 0; i < 9; i++)
        json_number(json, o, NULL, pose->r.m[i]);
    json_number(json, o, NULL, pose->t_m.x);
    json_number(json, o, NULL, pose->t_m.y);
    json_number(json, o, NULL, pose->t_m.z);
}

/* Everything that the photograph depends on and that is no file. */
static enum st parameters(const struct fuse_photo *p, const struct layer_params *layer,
                          const struct resolve_params *resolve, const struct fuse_source *source,
                          char **out_text, struct errctx *err) {
    struct json json;
    json_init_object(&json);
    json_text(&json, NULL, "name", p->name);
    put_camera(&json, "camera", &p->camera);
    put_pose(&json, "station_from_cam", &p->station_from_cam);
    json_number(&json, NULL, "splat_px", layer->splat_px);
    json_number(&json, NULL, "cluster_sigmas", layer->cluster_sigmas);
    json_number(&json, NULL, "grazing_rad", layer->grazing_rad);
    json_number(&json, NULL, "intensity_scale", layer->intensity_scale);
    json_number(&json, NULL, "beam_rad", resolve->beam_rad);
    json_number(&json, NULL, "sigma_angle_rad", resolve->sigma_angle_rad);
    json_number(&json, NULL, "sigma_system_m", resolve->sigma_system_m);
    struct cJSON *noise = json_array(&json, NULL, "noise_sigma_m");
    for (int i = 0; i < NOISE_CLASSES; i++)
        json_number(&json, noise, NULL, source->noise.sigma_m[i]);
    enum st st = json_print(&json, out_text, err);
    json_fini(&json);
    return st;
}

/* The job that made or will make the photograph. `inputs` has room for FUSE_SOURCE_INPUTS + 2. */
static struct job job_of(const struct fuse_photo *p, const struct fuse_source *source,
                         const char *text, struct job_hash *inputs) {
    size_t n = source->input_count;
    memcpy(inputs, source->inputs, n * sizeof *inputs);
    if (p->frame_id) {
        memset(inputs + n, 0, 2 * sizeof *inputs);
        (void)snprintf(inputs[n].role, sizeof inputs[n].role, "frame");
        memcpy(inputs[n++].sha256, p->frame_sha256, sizeof p->frame_sha256);
        (void)snprintf(inputs[n].role, sizeof inputs[n].role, "camera");
        memcpy(inputs[n++].sha256, p->camera_sha256, sizeof p->camera_sha256);
    }
    struct job job = {.kind = "fuse.photo", .parameters = text, .inputs = inputs, .input_count = n};
    (void)snprintf(job.program, sizeof job.program, "%s", fuse_photo_program);
    return job;
}

static enum st find_made(struct site *site, const struct job *wanted, struct fuse_photo *p,
                         struct errctx *err) {
    struct job *found = NULL;
    enum st st = job_find(site, wanted, &p->job_id, err);
    if (!st)
        st = job_read(site, p->job_id, &found, err);
    if (!st && found->output_count != 1)
        st = ST_NOT_FOUND;
    if (!st) {
        memcpy(p->made_sha256, found->outputs[0].sha256, sizeof p->made_sha256);
        p->kept = true;
    }
    job_free(found);
    return st;
}

/* ---- making one ---- */

static enum st colour(struct site *site, struct fuse_photo *p, struct errctx *err) {
    uint8_t *bytes = NULL;
    size_t size = 0;
    struct picture picture = {0};
    struct image_u8 frame = {0};
    enum st st = files_read(site, p->frame_sha256, &bytes, &size, err);
    if (!st)
        st = picture_decode(bytes, size, p->name, &picture, err);
    if (!st)
        st = picture_to_rgb(&picture, &frame, err);
    if (!st)
        st = frame_undistort(&frame, &p->frame_camera, &p->photo, NULL, err);
    image_u8_destroy(&frame);
    picture_destroy(&picture);
    free(bytes);
    return st;
}

static enum st make(struct site *site, struct fuse_photo *p, struct fuse_source *source,
                    const struct layer_params *layer, const struct resolve_params *resolve,
                    bool shade, struct errctx *err) {
    struct layer_image image = {0};
    struct pose sensor_from_cam = p->station_from_cam; /* samples are relative to the sensor */
    sensor_from_cam.t_m = vec3_sub(sensor_from_cam.t_m, source->origin_m);
    enum st st = layer_create(&p->camera, &sensor_from_cam, layer, &image, err);
    if (!st)
        st = layer_add_source(&image, &source->source, err);
    if (!st)
        st = photo_create(&p->camera, &p->photo, err);
    if (!st)
        st = resolve_photo(&image, resolve, !p->frame_id, &p->photo, &p->counts, err);
    p->samples = image.sample_count;
    layer_destroy(&image);
    if (st)
        return st;
    p->photo.station_from_cam = p->station_from_cam;
    struct skin_params skins = skin_params_default();
    (void)skin_mark(&p->photo, &skins);
    if (shade)
        shade_photo(&p->photo, &p->world_from_station.r);
    return p->frame_id ? colour(site, p, err) : ST_OK;
}

static enum st store(struct site *site, struct fuse_photo *p, struct job *job, struct errctx *err) {
    uint8_t *bytes = NULL;
    size_t size = 0;
    struct photo_tiff_info info = {.length_unit = "m"};
    (void)snprintf(info.name, sizeof info.name, "%s", p->name);
    enum st st = photo_tiff_encode(&p->photo, &info, &bytes, &size, err);
    if (!st)
        st = files_put(site, FILES_PHOTO, "tif", bytes, size, p->made_sha256, err);
    free(bytes);
    if (st)
        return st;
    struct job_hash output = {.outside = false};
    (void)snprintf(output.role, sizeof output.role, "photo");
    memcpy(output.sha256, p->made_sha256, sizeof output.sha256);
    job->outputs = &output;
    job->output_count = 1;
    job->seconds = p->seconds;
    return job_add(site, job, &p->job_id, err);
}

/* One photograph: found or made. */
static enum st one(struct site *site, struct fuse_photo *p, struct fuse_source *source,
                   const struct face_survey *survey, const struct fuse_settings *s,
                   struct errctx *err) {
    struct layer_params layer = s->layer;
    struct resolve_params resolve = s->resolve;
    double spacing_px = survey->spacing_rad * fmin(p->camera.fx_px, p->camera.fy_px);
    layer.splat_px = fmin(fmax(1.0, s->splat_spacings * spacing_px), LAYER_MAX_SPLAT_PX);
    layer.intensity_scale =
        survey->intensity_high > 0.0f ? 0.9 / (double)survey->intensity_high : 1;
    /* The head averages over its step and its spot; of other instruments that is not known. */
    resolve.beam_rad = source->rays ? survey->spacing_rad : 0.0;
    resolve.sigma_angle_rad = s->sigma_angle_rad;
    resolve.sigma_system_m = s->sigma_system_m;
    char *text = NULL;
    struct job_hash inputs[FUSE_SOURCE_INPUTS + 2];
    enum st st = parameters(p, &layer, &resolve, source, &text, err);
    if (st)
        return st;
    struct job job = job_of(p, source, text, inputs);
    st = find_made(site, &job, p, err);
    if (st == ST_NOT_FOUND) {
        int64_t start_ns = clock_now_ns();
        bool shade = !survey->has_colour && !(survey->intensity_high > 0.0f);
        st = make(site, p, source, &layer, &resolve, shade, err);
        p->seconds = 1e-9 * (double)(clock_now_ns() - start_ns);
        if (!st)
            st = store(site, p, &job, err);
    }
    free(text);
    return st ? errctx_prefix(err, st, "photograph %s", p->name) : ST_OK;
}

enum st fuse_photo_station(struct site *site, const struct station *station,
                           const struct fuse_settings *settings, struct fuse_photos *photos,
                           struct fuse_station *out_station, struct progress *progress,
                           struct errctx *err) {
    struct fuse_source source;
    struct fuse_source_options options = {.calibration = settings->calibration,
                                          .cache_samples = settings->cache_samples,
                                          .sigma_m = settings->sigma_m};
    struct fuse_station *out = out_station;
    memset(out, 0, sizeof *out);
    out->id = station->id;
    (void)snprintf(out->name, sizeof out->name, "%s", station->name);
    out->calibration = "none";
    int64_t start_ns = clock_now_ns();
    enum st st = fuse_source_open(site, station->id, &options, &source, err);
    if (st == ST_NOT_FOUND && !source.stream.id) /* nothing was scanned here */
        return ST_OK;
    if (st)
        return errctx_prefix(err, st, "station %s", station->name);
    out->has_samples = true;
    out->calibration = source.calibration;
    st = face_survey_source(&source.source, &out->survey, err);
    out->seconds_read = 1e-9 * (double)(clock_now_ns() - start_ns);
    size_t first = photos->count;
    if (!st)
        st = fuse_plan_station(site, station, &source, &out->survey, settings, photos, err);
    start_ns = clock_now_ns();
    for (size_t i = first; !st && i < photos->count; i++) {
        st = one(site, &photos->list[i], &source, &out->survey, settings, err);
        out->kept_count += photos->list[i].kept;
        out->frame_count += photos->list[i].frame_id != 0;
        progress_add(progress, 1);
    }
    out->seconds_photos = 1e-9 * (double)(clock_now_ns() - start_ns);
    out->photo_count = photos->count - first;
    out->noise = source.noise;
    out->rays = source.counts;
    out->clock = source.clock;
    out->damaged_packets = source.damaged_packets;
    fuse_source_close(&source);
    return st ? errctx_prefix(err, st, "station %s", station->name) : ST_OK;
}
