#include "import/import_list.h"

#include "base/config.h"
#include "import/frame_up.h"

#include <cyaml/cyaml.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define DEG (3.14159265358979323846 / 180.0)

/* ---- what the files hold ---- */

static const cyaml_strval_t ups[] = {
    {"z", FRAME_UP_Z}, {"y", FRAME_UP_Y}, {"-y", FRAME_UP_MINUS_Y}};
static const cyaml_strval_t kinds[] = {{"depth", PHOTO_IMPORT_DEPTH},
                                       {"range", PHOTO_IMPORT_RANGE},
                                       {"disparity", PHOTO_IMPORT_DISPARITY}};
static const cyaml_schema_value_t number = {CYAML_VALUE_FLOAT(CYAML_FLAG_DEFAULT, double)};

struct list_camera {
    double fx_px, fy_px, cx_px, cy_px, k1, k2, p1, p2, k3, hfov_deg;
};
#define CAMERA_FIELD(name) CYAML_FIELD_FLOAT(#name, CYAML_FLAG_OPTIONAL, struct list_camera, name)
static const cyaml_schema_field_t camera_fields[] = {
    CAMERA_FIELD(fx_px), CAMERA_FIELD(fy_px),    CAMERA_FIELD(cx_px), CAMERA_FIELD(cy_px),
    CAMERA_FIELD(k1),    CAMERA_FIELD(k2),       CAMERA_FIELD(p1),    CAMERA_FIELD(p2),
    CAMERA_FIELD(k3),    CAMERA_FIELD(hfov_deg), CYAML_FIELD_END};

struct list_map {
    enum photo_import_kind kind;
    double scale, offset, unknown, baseline_m, step, sigma_m, sigma_per_m, sigma_px;
    bool dequantise;
};
#define MAP_FIELD(name) CYAML_FIELD_FLOAT(#name, CYAML_FLAG_OPTIONAL, struct list_map, name)
static const cyaml_schema_field_t map_fields[] = {
    CYAML_FIELD_ENUM("kind", CYAML_FLAG_STRICT, struct list_map, kind, kinds, 3),
    MAP_FIELD(scale),
    MAP_FIELD(offset),
    MAP_FIELD(unknown),
    MAP_FIELD(baseline_m),
    MAP_FIELD(step),
    MAP_FIELD(sigma_m),
    MAP_FIELD(sigma_per_m),
    MAP_FIELD(sigma_px),
    CYAML_FIELD_BOOL("dequantise", CYAML_FLAG_OPTIONAL, struct list_map, dequantise),
    CYAML_FIELD_END};

struct list_photo {
    char *name, *station, *image, *map;
    double pose[7];
};
#define TEXT_FIELD(type, name, flags, max)                                                         \
    CYAML_FIELD_STRING_PTR(#name, CYAML_FLAG_POINTER | (flags), type, name, 1, max)
static const cyaml_schema_field_t photo_fields[] = {
    TEXT_FIELD(struct list_photo, name, CYAML_FLAG_OPTIONAL, SITE_NAME_MAX - 1),
    TEXT_FIELD(struct list_photo, station, CYAML_FLAG_OPTIONAL, SITE_NAME_MAX - 1),
    TEXT_FIELD(struct list_photo, image, 0, 1024),
    TEXT_FIELD(struct list_photo, map, 0, 1024),
    CYAML_FIELD_SEQUENCE_FIXED("pose", CYAML_FLAG_OPTIONAL, struct list_photo, pose, &number, 7),
    CYAML_FIELD_END};
static const cyaml_schema_value_t photo_value = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, struct list_photo, photo_fields)};

struct list_photos {
    enum frame_up up;
    struct list_camera camera;
    struct list_map map;
    char *station;
    struct list_photo *photos;
    uint32_t photos_count;
};
static const cyaml_schema_field_t photos_fields[] = {
    CYAML_FIELD_ENUM("up", CYAML_FLAG_OPTIONAL | CYAML_FLAG_STRICT, struct list_photos, up, ups, 3),
    CYAML_FIELD_MAPPING("camera", CYAML_FLAG_DEFAULT, struct list_photos, camera, camera_fields),
    CYAML_FIELD_MAPPING("map", CYAML_FLAG_DEFAULT, struct list_photos, map, map_fields),
    TEXT_FIELD(struct list_photos, station, CYAML_FLAG_OPTIONAL, SITE_NAME_MAX - 1),
    CYAML_FIELD_SEQUENCE("photos", CYAML_FLAG_POINTER, struct list_photos, photos, &photo_value, 1,
                         IMPORT_LIST_MAX),
    CYAML_FIELD_END};
static const cyaml_schema_value_t photos_top = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, struct list_photos, photos_fields)};
static const struct config_range photos_ranges[] = {
    {"camera.fx_px", 1e-3, 1e7, "px"},     {"camera.fy_px", 1e-3, 1e7, "px"},
    {"camera.hfov_deg", 0.01, 177, "deg"}, {"map.scale", 1e-12, 1e6, ""},
    {"map.baseline_m", 1e-6, 1e4, "m"},    {"map.step", 1e-9, 1e6, ""},
    {"map.sigma_m", 0, 1e3, "m"},          {"map.sigma_per_m", 0, 1e3, "1/m"},
    {"map.sigma_px", 0, 1e3, "px"}};
static const struct config_schema photos_schema = {&photos_top, photos_ranges,
                                                   sizeof photos_ranges / sizeof photos_ranges[0]};

struct list_scan {
    char *name, *file, *pose_file, *conf;
    double pose[7];
};
static const cyaml_schema_field_t scan_fields[] = {
    TEXT_FIELD(struct list_scan, name, CYAML_FLAG_OPTIONAL, SITE_NAME_MAX - 1),
    TEXT_FIELD(struct list_scan, file, 0, 1024),
    TEXT_FIELD(struct list_scan, pose_file, CYAML_FLAG_OPTIONAL, 1024),
    TEXT_FIELD(struct list_scan, conf, CYAML_FLAG_OPTIONAL, 1024),
    CYAML_FIELD_SEQUENCE_FIXED("pose", CYAML_FLAG_OPTIONAL, struct list_scan, pose, &number, 7),
    CYAML_FIELD_END};
static const cyaml_schema_value_t scan_value = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, struct list_scan, scan_fields)};

struct list_scans {
    enum frame_up up;
    double unit_m, range_sigma_m, no_return_m;
    char *conf;
    struct list_scan *scans;
    uint32_t scans_count;
};
static const cyaml_schema_field_t scans_fields[] = {
    CYAML_FIELD_ENUM("up", CYAML_FLAG_OPTIONAL | CYAML_FLAG_STRICT, struct list_scans, up, ups, 3),
    CYAML_FIELD_FLOAT("unit_m", CYAML_FLAG_OPTIONAL, struct list_scans, unit_m),
    CYAML_FIELD_FLOAT("range_sigma_m", CYAML_FLAG_OPTIONAL, struct list_scans, range_sigma_m),
    CYAML_FIELD_FLOAT("no_return_m", CYAML_FLAG_OPTIONAL, struct list_scans, no_return_m),
    TEXT_FIELD(struct list_scans, conf, CYAML_FLAG_OPTIONAL, 1024),
    CYAML_FIELD_SEQUENCE("scans", CYAML_FLAG_POINTER, struct list_scans, scans, &scan_value, 1,
                         IMPORT_LIST_MAX),
    CYAML_FIELD_END};
static const cyaml_schema_value_t scans_top = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, struct list_scans, scans_fields)};
static const struct config_range scans_ranges[] = {
    {"unit_m", 1e-9, 1e6, "m"}, {"range_sigma_m", 1e-9, 1e3, "m"}, {"no_return_m", 1e-3, 1e6, "m"}};
static const struct config_schema scans_schema = {&scans_top, scans_ranges,
                                                  sizeof scans_ranges / sizeof scans_ranges[0]};

/* ---- from them to jobs ---- */

struct list {
    const struct config *config;
    char dir[FILEIO_PATH_MAX];
    const char *section; /* "photos" or "scans" */
    struct errctx *err;
};

static enum st element_path(const struct list *list, const char *name,
                            char out_path[FILEIO_PATH_MAX]) {
    return fileio_join(list->dir, name, out_path, list->err);
}

static void copy_text(char *to, size_t capacity, const char *from) {
    (void)snprintf(to, capacity, "%s", from ? from : "");
}

/* The pose of element i, if it has one. */
static enum st element_pose(const struct list *list, size_t i, const double pose[7],
                            enum frame_up up, bool *out_has, struct pose *out_pose) {
    char key[64];
    struct errctx why = {0};
    (void)snprintf(key, sizeof key, "%s[%zu].pose", list->section, i);
    *out_has = config_has(list->config, key);
    if (!*out_has)
        return ST_OK;
    if (frame_up_pose(pose, up, out_pose, &why))
        return config_fail(list->config, list->err, key, "%s", why.text);
    return ST_OK;
}

static double number_or(const struct list *list, const char *key, double value, double otherwise) {
    return config_has(list->config, key) ? value : otherwise;
}

/* A sigma of 0 in the file means none, an absent one the default. */
static double sigma_or_default(const struct list *list, const char *key, double value) {
    return config_has(list->config, key) ? (value > 0.0 ? value : (double)NAN) : 0.0;
}

static void common_photo(const struct list *list, const struct list_photos *in,
                         struct photo_job *job) {
    const struct list_camera *c = &in->camera;
    const struct list_map *m = &in->map;
    *job = photo_job_default();
    job->camera = (struct camera){.fx_px = c->fx_px,
                                  .fy_px = c->fy_px,
                                  .cx_px = number_or(list, "camera.cx_px", c->cx_px, NAN),
                                  .cy_px = number_or(list, "camera.cy_px", c->cy_px, NAN),
                                  .k1 = c->k1,
                                  .k2 = c->k2,
                                  .p1 = c->p1,
                                  .p2 = c->p2,
                                  .k3 = c->k3};
    job->hfov_rad = c->hfov_deg * DEG;
    job->values = (struct photo_import_map){
        .kind = m->kind,
        .scale = m->scale,
        .offset = m->offset,
        .unknown = m->unknown,
        .baseline_m = m->baseline_m,
        .step = m->step,
        .dequantise = m->dequantise,
        .sigma_m = sigma_or_default(list, "map.sigma_m", m->sigma_m),
        .sigma_per_m = sigma_or_default(list, "map.sigma_per_m", m->sigma_per_m),
        .sigma_px = sigma_or_default(list, "map.sigma_px", m->sigma_px)};
}

static enum st fill_photo(const struct list *list, const struct list_photos *in, size_t i,
                          struct photo_job *job) {
    const struct list_photo *p = &in->photos[i];
    common_photo(list, in, job);
    copy_text(job->name, sizeof job->name, p->name);
    copy_text(job->station, sizeof job->station, p->station ? p->station : in->station);
    enum st st = element_path(list, p->image, job->image_path);
    if (!st)
        st = element_path(list, p->map, job->map_path);
    if (!st)
        st = element_pose(list, i, p->pose, in->up, &job->has_pose, &job->world_from_cam);
    return st;
}

enum st import_list_photos(const char *path, struct photo_job **out_jobs, size_t *out_count,
                           struct errctx *err) {
    struct config *config = NULL;
    void *value = NULL;
    struct list list = {.section = "photos", .err = err};
    struct photo_job *jobs = NULL;
    enum st st = config_load(path, &photos_schema, &value, &config, err);
    if (st)
        return st;
    const struct list_photos *in = value;
    list.config = config;
    st = fileio_dirname(path, list.dir, err);
    if (!st && !(jobs = calloc(in->photos_count, sizeof *jobs)))
        st = errctx_set(err, ST_NOMEM, "%s: no memory for its photographs", path);
    for (size_t i = 0; !st && i < in->photos_count; i++)
        st = fill_photo(&list, in, i, &jobs[i]);
    if (!st) {
        *out_jobs = jobs;
        *out_count = in->photos_count;
        jobs = NULL;
    }
    free(jobs);
    config_free(&photos_schema, value);
    config_destroy(config);
    return st;
}

static enum st fill_scan(const struct list *list, const struct list_scans *in, size_t i,
                         struct scan_job *job) {
    const struct list_scan *s = &in->scans[i];
    *job = scan_job_default();
    copy_text(job->name, sizeof job->name, s->name);
    job->options_ply.up = in->up;
    job->options_ply.unit_m = in->unit_m;
    job->range_sigma_m = in->range_sigma_m;
    job->options_3dtk.no_return_m = in->no_return_m;
    const char *conf = s->conf ? s->conf : in->conf;
    const char *pose_file = s->pose_file ? s->pose_file : conf;
    enum st st = element_path(list, s->file, job->path);
    /* The pose stays in the file's frame: how it is turned depends on the kind of file. */
    if (!st)
        st = element_pose(list, i, s->pose, FRAME_UP_Z, &job->has_pose, &job->world_from_file);
    if (!st && pose_file && !job->has_pose)
        st = element_path(list, pose_file, job->pose_path);
    return st;
}

enum st import_list_scans(const char *path, struct scan_job **out_jobs, size_t *out_count,
                          struct errctx *err) {
    struct config *config = NULL;
    void *value = NULL;
    struct list list = {.section = "scans", .err = err};
    struct scan_job *jobs = NULL;
    enum st st = config_load(path, &scans_schema, &value, &config, err);
    if (st)
        return st;
    const struct list_scans *in = value;
    list.config = config;
    st = fileio_dirname(path, list.dir, err);
    if (!st && !(jobs = calloc(in->scans_count, sizeof *jobs)))
        st = errctx_set(err, ST_NOMEM, "%s: no memory for its scans", path);
    for (size_t i = 0; !st && i < in->scans_count; i++)
        st = fill_scan(&list, in, i, &jobs[i]);
    if (!st) {
        *out_jobs = jobs;
        *out_count = in->scans_count;
        jobs = NULL;
    }
    free(jobs);
    config_free(&scans_schema, value);
    config_destroy(config);
    return st;
}
