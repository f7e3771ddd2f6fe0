#include "import/scan_job.h"

#include "base/clock.h"
#include "base/json.h"
#include "base/sample_grid.h"
#include "import/scan_fan.h"
#include "import/scan_spin.h"
#include "site/files.h"
#include "site/job.h"
#include "site/photo_row.h"
#include "site/photo_tiff.h"
#include "site/polar_chunk.h"
#include "site/station.h"
#include "site/stream.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

/* Largest raw scan: bounded by what one site file may hold. */
#define SCAN_FILE_MAX_BYTES ((size_t)2 << 30)
#define POSE_FILE_MAX_BYTES ((size_t)1 << 20)

/* A turned line scanner of the pulse kind; a spinning one by its data sheet; and triangulating
 * scanners, whose spacing follows their noise. */
#define SIGMA_3DTK_M       0.01
#define SIGMA_SPIN_M       0.02
#define SIGMA_PLY_SPACINGS 0.05
#define SIGMA_PLY_MAX_M    1e-3

struct scan_job scan_job_default(void) {
    struct scan_job job;
    memset(&job, 0, sizeof job);
    job.style = SAMPLE_SHADE_COLOUR;
    return job;
}

void scan_job_fini(struct scan_job *job) {
    if (!job)
        return;
    source_file_destroy(&job->file);
    source_file_destroy(&job->pose_file);
    scan_destroy(&job->scan);
    scan_frame_destroy(&job->frame);
    for (int i = 0; i < job->face_count; i++)
        free(job->faces[i].tiff);
    memset(job->faces, 0, sizeof job->faces);
    job->face_count = 0;
}

static bool is_ply(const struct source_file *file) {
    return file->size >= 4 && !memcmp(file->bytes, "ply", 3) &&
           (file->bytes[3] == '\n' || file->bytes[3] == '\r');
}

/* Such a file says nothing of itself: its name does. */
static bool is_spin(const struct scan_job *job) {
    const char *dot = strrchr(fileio_basename(job->path), '.');
    return dot && !strcasecmp(dot, ".bin");
}

static const char *format_name(const struct scan_job *job) {
    if (is_ply(&job->file))
        return "PLY range grid";
    if (is_spin(job))
        return "spinning laser";
    return scan_fan_is(job->file.bytes, job->file.size) ? "turned line laser" : "3DTK";
}

/* The .pose beside a .3d, if there is one. */
static void beside(const char *path, char out_path[FILEIO_PATH_MAX]) {
    out_path[0] = 0;
    const char *dot = strrchr(fileio_basename(path), '.');
    const size_t stem = dot ? (size_t)(dot - path) : strlen(path);
    if (stem + sizeof ".pose" > FILEIO_PATH_MAX)
        return;
    memcpy(out_path, path, stem);
    memcpy(out_path + stem, ".pose", sizeof ".pose");
    if (!fileio_exists(out_path))
        out_path[0] = 0;
}

static enum st read_3dtk(struct scan_job *job, struct errctx *err) {
    enum st st =
        scan_3dtk_parse(job->file.bytes, job->file.size, &job->options_3dtk, &job->scan, NULL, err);
    if (st)
        return errctx_prefix(err, st, "%s", job->path);
    char pose_path[FILEIO_PATH_MAX];
    memcpy(pose_path, job->pose_path, sizeof pose_path);
    if (!pose_path[0] && !job->has_pose)
        beside(job->path, pose_path);
    if (pose_path[0]) {
        if ((st = source_file_read(pose_path, POSE_FILE_MAX_BYTES, &job->pose_file, err)))
            return st;
        st = scan_3dtk_parse_pose(job->pose_file.bytes, job->pose_file.size,
                                  &job->scan.world_from_station, err);
        if (st)
            return errctx_prefix(err, st, "%s", pose_path);
        job->posed = true;
    } else if (job->has_pose) {
        job->scan.world_from_station = job->world_from_file;
        job->posed = true;
    }
    job->used_sigma_m = job->range_sigma_m > 0.0 ? job->range_sigma_m : SIGMA_3DTK_M;
    return ST_OK;
}

/* No companion file: --pose is for the others. */
static enum st pose_of_list(struct scan_job *job, const char *what, struct errctx *err) {
    if (job->pose_path[0])
        return errctx_set(err, ST_UNSUPPORTED,
                          "%s: %s takes no pose file; give the pose as seven numbers in a list",
                          job->path, what);
    job->posed = job->has_pose;
    if (job->has_pose)
        job->scan.world_from_station = job->world_from_file;
    return ST_OK;
}

static enum st read_fan(struct scan_job *job, struct errctx *err) {
    enum st st = scan_fan_parse(job->file.bytes, job->file.size, &job->scan, err);
    if (st)
        return errctx_prefix(err, st, "%s", job->path);
    job->used_sigma_m = job->range_sigma_m > 0.0 ? job->range_sigma_m : SIGMA_3DTK_M;
    return pose_of_list(job, "a log of a turned line laser", err);
}

/* Its lasers disagree by more than one of them scatters: fusion is told so by the stream. */
static void say_sigma(struct scan_job *job) {
    char *end = strrchr(job->scan.meta, '}');
    const size_t room = end ? sizeof job->scan.meta - (size_t)(end - job->scan.meta) : 0;
    if (room > 64)
        (void)snprintf(end, room, ",\"range_sigma_m\":%.9g}", job->used_sigma_m);
}

static enum st read_spin(struct scan_job *job, struct errctx *err) {
    enum st st = scan_spin_parse(job->file.bytes, job->file.size, &job->scan, err);
    if (st)
        return errctx_prefix(err, st, "%s", job->path);
    job->used_sigma_m = job->range_sigma_m > 0.0 ? job->range_sigma_m : SIGMA_SPIN_M;
    say_sigma(job);
    st = pose_of_list(job, "a spinning laser", err);
    return st ? st : scan_frame_find(job->path, &job->frame, err);
}

static enum st read_ply(struct scan_job *job, struct errctx *err) {
    struct ply_grid grid;
    enum st st = ply_grid_parse(job->file.bytes, job->file.size, &grid, err);
    if (!st) {
        st = ply_grid_to_scan(&grid, &job->options_ply, &job->scan, err);
        ply_grid_destroy(&grid);
    }
    if (st)
        return errctx_prefix(err, st, "%s", job->path);
    struct pose pose = job->world_from_file;
    job->posed = job->has_pose;
    if (job->pose_path[0]) {
        if ((st = source_file_read(job->pose_path, POSE_FILE_MAX_BYTES, &job->pose_file, err)))
            return st;
        st = ply_grid_conf_pose(job->pose_file.bytes, job->pose_file.size, job->path, &pose, err);
        if (st)
            return errctx_prefix(err, st, "%s", job->pose_path);
        job->posed = true;
    }
    if (job->posed)
        job->scan.world_from_station = ply_grid_station_pose(&pose, &job->options_ply);
    job->used_sigma_m = job->range_sigma_m; /* 0: needs the spacing, see draw_faces() */
    return ST_OK;
}

static enum st read_file(struct scan_job *job, struct errctx *err) {
    if (is_ply(&job->file))
        return read_ply(job, err);
    if (is_spin(job))
        return read_spin(job, err);
    return scan_fan_is(job->file.bytes, job->file.size) ? read_fan(job, err) : read_3dtk(job, err);
}

static enum st default_sigma(struct scan_job *job, const struct sample_grid *grid) {
    if (job->used_sigma_m > 0.0)
        return ST_OK;
    struct sample_spacing spacing;
    enum st st = sample_grid_spacing(grid, &spacing);
    if (st)
        return st;
    double range_m = 0;
    for (size_t i = 0; i < job->scan.count; i++)
        range_m = fmax(range_m, (double)job->scan.samples[i].range_m);
    const double along = fmin(spacing.along_row_rad, spacing.along_column_rad) * range_m;
    job->used_sigma_m =
        along > 0.0 ? fmin(SIGMA_PLY_SPACINGS * along, SIGMA_PLY_MAX_M) : SIGMA_PLY_MAX_M;
    return ST_OK;
}

static enum st draw_face(struct scan_job *job, const struct sample_grid *grid,
                         const struct scan_photo_face *face, struct errctx *err) {
    const struct scan_photo_options options = {.range_sigma_m = job->used_sigma_m,
                                               .style = job->style,
                                               .world_from_station =
                                                   job->scan.world_from_station.r};
    struct photo photo = {0};
    enum st st = scan_photo_draw(grid, job->scan.origin_m, face, &options, &photo, err);
    if (st)
        return st;
    struct scan_job_face *out = &job->faces[job->face_count];
    struct photo_tiff_info info;
    memset(&info, 0, sizeof info);
    (void)snprintf(info.name, sizeof info.name, "%.48s %.7s", job->name, face->name);
    (void)snprintf(info.length_unit, sizeof info.length_unit, "m");
    st = photo_tiff_encode(&photo, &info, &out->tiff, &out->tiff_size, err);
    if (!st) {
        memcpy(out->name, face->name, sizeof out->name);
        out->camera = photo.camera;
        out->station_from_cam = photo.station_from_cam;
        job->face_count++;
    }
    photo_destroy(&photo);
    return st;
}

static enum st draw_faces(struct scan_job *job, struct errctx *err) {
    struct sample_grid grid = {0};
    struct scan_photo_face faces[SCAN_PHOTO_FACES_MAX];
    int count = 0;
    enum st st = sample_grid_create(job->scan.samples, job->scan.count, &grid, err);
    if (!st && (st = default_sigma(job, &grid)))
        st = errctx_set(err, st, "no memory for the spacing of the samples");
    if (!st && !job->no_photos && job->scan.rows > 1)
        st = scan_photo_faces(&grid, faces, &count, err);
    for (int i = 0; !st && i < count; i++)
        st = draw_face(job, &grid, &faces[i], err);
    sample_grid_destroy(&grid);
    return st ? errctx_prefix(err, st, "%s", job->path) : ST_OK;
}

/* A folder stands for the points in it, and gives the station its name. */
static enum st enter_folder(struct scan_job *job, struct errctx *err) {
    char dir[FILEIO_PATH_MAX];
    if (!fileio_is_dir(job->path))
        return ST_OK;
    memcpy(dir, job->path, sizeof dir);
    enum st st = scan_frame_points(dir, job->path, err);
    for (size_t n = strlen(dir); n > 1 && dir[n - 1] == '/'; n--)
        dir[n - 1] = 0;
    const char *name = fileio_basename(dir);
    if (!job->name[0] && site_name_is_valid(name) && strcmp(name, ".") && strcmp(name, ".."))
        memcpy(job->name, name, strlen(name) + 1);
    return st;
}

enum st scan_job_prepare(struct scan_job *job, struct errctx *err) {
    const int64_t start_ns = clock_now_ns();
    enum st st = enter_folder(job, err);
    if (!st)
        st = source_file_read(job->path, SCAN_FILE_MAX_BYTES, &job->file, err);
    if (!st) {
        if (!job->name[0])
            memcpy(job->name, job->file.stem, sizeof job->name);
        if (!site_name_is_valid(job->name))
            st = errctx_set(err, ST_INVALID, "'%s' is no name for a station", job->name);
    }
    if (!st)
        st = read_file(job, err);
    if (!st)
        st = draw_faces(job, err);
    job->surfaces = job->no_returns = 0;
    for (size_t i = 0; !st && i < job->scan.count; i++) {
        job->no_returns += (job->scan.samples[i].flags & SAMPLE_NO_RETURN) != 0;
        job->surfaces += !(job->scan.samples[i].flags & (SAMPLE_NO_RETURN | SAMPLE_DROPPED));
    }
    if (st)
        scan_job_fini(job);
    job->seconds = (double)(clock_now_ns() - start_ns) * 1e-9;
    return st;
}

enum st scan_job_check_names(struct site *site, const struct scan_job *jobs, size_t count,
                             struct errctx *err) {
    for (size_t i = 0; i < count; i++) {
        struct station station;
        enum st st = station_find(site, jobs[i].name, &station, err);
        if (!st)
            return errctx_set(err, ST_EXISTS,
                              "station %s is in the site already: give another --name",
                              jobs[i].name);
        if (st != ST_NOT_FOUND)
            return st;
        for (size_t k = 0; k < i; k++)
            if (!strcmp(jobs[k].name, jobs[i].name))
                return errctx_set(err, ST_EXISTS, "two scans would be station %s", jobs[i].name);
    }
    return ST_OK;
}

static enum st parameters_text(const struct scan_job *job, char **out_text, struct errctx *err) {
    struct json json;
    json_init_object(&json);
    json_text(&json, NULL, "name", job->name);
    json_text(&json, NULL, "format", format_name(job));
    json_number(&json, NULL, "no_return_m", job->options_3dtk.no_return_m);
    json_number(&json, NULL, "tolerance_m", job->options_3dtk.tolerance_m);
    json_number(&json, NULL, "unit_m", job->options_ply.unit_m);
    json_number(&json, NULL, "standoff_m", job->options_ply.standoff_m);
    json_integer(&json, NULL, "up", job->options_ply.up);
    json_number(&json, NULL, "range_sigma_m", job->used_sigma_m);
    json_integer(&json, NULL, "style", job->style);
    struct cJSON *pose = json_array(&json, NULL, "world_from_station");
    const struct mat4 m = pose_to_mat4(&job->scan.world_from_station);
    for (int i = 0; i < 12; i++)
        json_number(&json, pose, NULL, m.m[i]);
    enum st st = json_print(&json, out_text, err);
    json_fini(&json);
    return st;
}

static enum st add_job(struct site *site, const struct scan_job *job, const struct job_hash *inputs,
                       size_t input_count, const struct job_hash *outputs, int64_t *out_id,
                       struct errctx *err) {
    char *parameters = NULL;
    enum st st = parameters_text(job, &parameters, err);
    if (st)
        return st;
    const struct job row = {.kind = "import.scan",
                            .parameters = parameters,
                            .program = "scancart " SCANCART_VERSION,
                            .inputs = inputs,
                            .input_count = input_count,
                            .outputs = outputs,
                            .output_count = 1 + (size_t)job->face_count,
                            .seconds = job->seconds};
    st = job_add(site, &row, out_id, err);
    free(parameters);
    return st;
}

static enum st store_samples(struct site *site, const struct scan_job *job, int64_t *out_station_id,
                             struct job_hash *out_stream, struct errctx *err) {
    struct station_pose pose;
    memset(&pose, 0, sizeof pose);
    pose.world_from_station = job->scan.world_from_station;
    (void)snprintf(pose.source, sizeof pose.source, "%s", job->posed ? "import" : "nominal");
    int64_t stream_id = 0;
    struct stream_state state;
    enum st st = station_add(site, job->name, NULL, &pose, out_station_id, err);
    if (st ||
        (st = polar_chunk_write(site, *out_station_id, "import", job->scan.origin_m, job->scan.meta,
                                job->scan.samples, job->scan.count, &stream_id, err)) ||
        (st = stream_get_state(site, stream_id, &state, err)))
        return st;
    memset(out_stream, 0, sizeof *out_stream);
    (void)snprintf(out_stream->role, sizeof out_stream->role, "stream");
    memcpy(out_stream->sha256, state.chain, sizeof out_stream->sha256);
    return ST_OK;
}

static enum st store_rows(struct site *site, const struct scan_job *job, int64_t station_id,
                          int64_t job_id, const struct job_hash *photos, struct errctx *err) {
    for (int i = 0; i < job->face_count; i++) {
        const struct scan_job_face *face = &job->faces[i];
        struct photo_row row;
        memset(&row, 0, sizeof row);
        row.station_id = station_id;
        row.job_id = job_id;
        row.width_px = face->camera.width_px;
        row.height_px = face->camera.height_px;
        row.station_from_cam = face->station_from_cam;
        memcpy(row.sha256, photos[i].sha256, sizeof row.sha256);
        (void)snprintf(row.name, sizeof row.name, "%.48s-%s", job->name, face->name);
        int64_t id = 0;
        enum st st = photo_row_put(site, &row, &id, err);
        if (st)
            return st;
    }
    return ST_OK;
}

enum st scan_job_store(struct site *site, const struct scan_job *job, int64_t *out_station_id,
                       struct errctx *err) {
    struct job_hash inputs[3], outputs[1 + SCAN_PHOTO_FACES_MAX];
    size_t input_count = 1;
    memset(outputs, 0, sizeof outputs);
    int64_t station_id = 0, job_id = 0;
    enum st st = source_file_put(site, &job->file, "scan", &inputs[0], err);
    if (!st && job->pose_file.bytes)
        st = source_file_put(site, &job->pose_file, "pose", &inputs[input_count++], err);
    if (!st)
        st = store_samples(site, job, &station_id, &outputs[0], err);
    if (!st && job->frame.image.bytes) { /* its format takes no pose file: there is room */
        st = scan_frame_store(site, &job->frame, station_id, job->name, &inputs[1], err);
        input_count = 3;
    }
    for (int i = 0; !st && i < job->face_count; i++) {
        (void)snprintf(outputs[1 + i].role, sizeof outputs[1 + i].role, "photo");
        st = files_put(site, FILES_PHOTO, "tif", job->faces[i].tiff, job->faces[i].tiff_size,
                       outputs[1 + i].sha256, err);
    }
    if (!st)
        st = add_job(site, job, inputs, input_count, outputs, &job_id, err);
    if (!st)
        st = store_rows(site, job, station_id, job_id, outputs + 1, err);
    if (!st)
        *out_station_id = station_id;
    return st;
}
