#include "app/fuse_skins.h"

#include "base/clock.h"
#include "base/json.h"
#include "site/files.h"
#include "site/job.h"
#include "site/photo_tiff.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PAGE = 32 };

static bool several_stations(const struct fuse_photos *photos) {
    for (size_t i = 1; i < photos->count; i++)
        if (photos->list[i].station_id != photos->list[0].station_id)
            return true;
    return false;
}

/* Where the photographs stand: part of what skins follow from. */
static void put_poses(struct json *json, const struct fuse_photos *photos) {
    struct cJSON *poses = json_array(json, NULL, "world_from_station");
    for (size_t i = 0; i < photos->count; i++) {
        const struct pose *p = &photos->list[i].world_from_station;
        struct cJSON *one = json_array(json, poses, NULL);
        for (int k = 0; k < 9; k++)
            json_number(json, one, NULL, p->r.m[k]);
        json_number(json, one, NULL, p->t_m.x);
        json_number(json, one, NULL, p->t_m.y);
        json_number(json, one, NULL, p->t_m.z);
        json_number(json, one, NULL, photos->list[i].pose_sigma_m);
        json_number(json, one, NULL, photos->list[i].pose_sigma_rad);
    }
}

static enum st parameters(const struct fuse_photos *photos, const struct reproject_params *p,
                          char **out_text, struct errctx *err) {
    struct json json;
    json_init_object(&json);
    json_number(&json, NULL, "sigmas", p->sigmas);
    json_number(&json, NULL, "step_sigmas", p->step_sigmas);
    json_number(&json, NULL, "step_grazing_rad", p->step_grazing_rad);
    json_integer(&json, NULL, "view_px", p->view_px);
    json_integer(&json, NULL, "trust_no_return", p->trust_no_return);
    put_poses(&json, photos);
    enum st st = json_print(&json, out_text, err);
    json_fini(&json);
    return st;
}

static enum st find_final(struct site *site, const struct job *wanted, struct fuse_photos *photos,
                          int64_t *out_id, struct errctx *err) {
    struct job *found = NULL;
    enum st st = job_find(site, wanted, out_id, err);
    if (!st)
        st = job_read(site, *out_id, &found, err);
    if (!st && found->output_count != photos->count)
        st = ST_NOT_FOUND;
    for (size_t i = 0; !st && i < photos->count; i++)
        memcpy(photos->list[i].final_sha256, found->outputs[i].sha256, HASH_SHA256_BYTES);
    job_free(found);
    return st;
}

static enum st store_one(struct site *site, struct fuse_photo *p, struct errctx *err) {
    uint8_t *bytes = NULL;
    size_t size = 0;
    struct photo_tiff_info info = {.length_unit = "m"};
    (void)snprintf(info.name, sizeof info.name, "%s", p->name);
    enum st st = photo_tiff_encode(&p->photo, &info, &bytes, &size, err);
    if (!st)
        st = files_put(site, FILES_PHOTO, "tif", bytes, size, p->final_sha256, err);
    free(bytes);
    return st;
}

struct ticker {
    struct progress *progress;
};

static bool tick(void *context, size_t done, size_t total) {
    (void)done;
    (void)total;
    struct ticker *t = context;
    progress_add(t->progress, 1);
    return true;
}

/* Looks from every photograph at every other and stores those whose flags have changed. */
static enum st compute(struct site *site, struct fuse_photos *photos,
                       const struct fuse_settings *settings, struct fuse_skins_result *result,
                       struct progress *progress, struct errctx *err) {
    struct reproject_view *views = calloc(photos->count, sizeof *views);
    uint32_t *before = calloc(photos->count, sizeof *before);
    enum st st = views && before ? ST_OK : errctx_set(err, ST_NOMEM, "no memory for skins");
    for (size_t i = 0; !st && i < photos->count; i++) {
        struct fuse_photo *p = &photos->list[i];
        st = fuse_photo_load(site, p, p->made_sha256, err);
        if (st)
            break;
        views[i] = (struct reproject_view){&p->photo, p->world_from_station, p->station_id,
                                           p->pose_sigma_m, p->pose_sigma_rad};
        before[i] = hash_crc32c(0, p->photo.flags,
                                (size_t)p->camera.width_px * (size_t)p->camera.height_px);
    }
    struct ticker ticker = {progress};
    struct reproject_progress steps = {tick, &ticker};
    if (!st)
        st = reproject_skins(views, photos->count, &settings->skins, &steps, &result->counts, err);
    for (size_t i = 0; !st && i < photos->count; i++) {
        struct fuse_photo *p = &photos->list[i];
        size_t pixels = (size_t)p->camera.width_px * (size_t)p->camera.height_px;
        if (hash_crc32c(0, p->photo.flags, pixels) == before[i])
            memcpy(p->final_sha256, p->made_sha256, HASH_SHA256_BYTES);
        else
            st = store_one(site, p, err);
    }
    free(views);
    free(before);
    return st;
}

static struct job_hash *hashes(const struct fuse_photos *photos, bool final) {
    struct job_hash *list = calloc(photos->count, sizeof *list);
    for (size_t i = 0; list && i < photos->count; i++) {
        (void)snprintf(list[i].role, sizeof list[i].role, "photo");
        memcpy(list[i].sha256, final ? photos->list[i].final_sha256 : photos->list[i].made_sha256,
               HASH_SHA256_BYTES);
    }
    return list;
}

static enum st reproject(struct site *site, struct fuse_photos *photos,
                         const struct fuse_settings *settings, struct fuse_skins_result *result,
                         int64_t *out_job, struct progress *progress, struct errctx *err) {
    char *text = NULL;
    struct job_hash *inputs = hashes(photos, false), *outputs = NULL;
    enum st st = inputs ? parameters(photos, &settings->skins, &text, err)
                        : errctx_set(err, ST_NOMEM, "no memory for skins");
    struct job job = {
        .kind = "fuse.skins", .parameters = text, .inputs = inputs, .input_count = photos->count};
    (void)snprintf(job.program, sizeof job.program, "%s", fuse_photo_program);
    if (!st)
        st = find_final(site, &job, photos, out_job, err);
    if (st == ST_NOT_FOUND) {
        int64_t start_ns = clock_now_ns();
        st = compute(site, photos, settings, result, progress, err);
        result->seconds = 1e-9 * (double)(clock_now_ns() - start_ns);
        result->ran = true;
        outputs = st ? NULL : hashes(photos, true);
        if (!st && !outputs)
            st = errctx_set(err, ST_NOMEM, "no memory for skins");
        job.outputs = outputs;
        job.output_count = photos->count;
        job.seconds = result->seconds;
        if (!st)
            st = job_add(site, &job, out_job, err);
    } else if (!st) {
        result->kept = true;
    }
    free(outputs);
    free(inputs);
    free(text);
    return st;
}

/* ---- rows ---- */

static enum st put_row(struct site *site, const struct fuse_photo *p, struct errctx *err) {
    struct photo_row row, old;
    enum st st = photo_row_find(site, p->station_id, p->name, &old, err);
    if (st && st != ST_NOT_FOUND)
        return st;
    if (!st && !memcmp(old.sha256, p->final_sha256, sizeof old.sha256))
        return ST_OK; /* nothing new: no custody event either */
    memset(&row, 0, sizeof row);
    row.station_id = p->station_id;
    memcpy(row.name, p->name, sizeof row.name);
    memcpy(row.sha256, p->final_sha256, sizeof row.sha256);
    row.width_px = p->camera.width_px;
    row.height_px = p->camera.height_px;
    row.station_from_cam = p->station_from_cam;
    row.frame_id = p->frame_id;
    row.job_id = p->job_id;
    int64_t id = 0;
    return photo_row_put(site, &row, &id, err);
}

static bool is_ours(const struct fuse_photos *photos, const struct photo_row *row) {
    for (size_t i = 0; i < photos->count; i++)
        if (photos->list[i].station_id == row->station_id &&
            !strcmp(photos->list[i].name, row->name))
            return true;
    return false;
}

static bool is_fused_station(const struct fuse_photos *photos, int64_t station_id) {
    for (size_t i = 0; i < photos->count; i++)
        if (photos->list[i].station_id == station_id)
            return true;
    return false;
}

/* Whether a row was made from samples, by an import's quick look or an earlier fusion. */
static bool is_superseded(struct site *site, const struct photo_row *row, struct errctx *err) {
    struct job *job = NULL;
    bool yes = row->job_id && !job_read(site, row->job_id, &job, err) &&
               (!strcmp(job->kind, "import.scan") || !strncmp(job->kind, "fuse.", 5));
    job_free(job);
    return yes;
}

static enum st remove_old(struct site *site, const struct fuse_photos *photos, struct errctx *err) {
    struct photo_row rows[PAGE];
    size_t count = PAGE;
    int64_t after = 0;
    enum st st = ST_OK;
    while (!st && count == PAGE) {
        st = photo_row_list(site, 0, after, rows, PAGE, &count, err);
        for (size_t i = 0; !st && i < count; i++) {
            after = rows[i].id;
            if (is_fused_station(photos, rows[i].station_id) && !is_ours(photos, &rows[i]) &&
                is_superseded(site, &rows[i], err))
                st = photo_row_remove(site, rows[i].id, err);
        }
    }
    return st;
}

enum st fuse_skins(struct site *site, struct fuse_photos *photos,
                   const struct fuse_settings *settings, struct fuse_skins_result *out_result,
                   struct progress *progress, struct errctx *err) {
    struct fuse_skins_result result;
    memset(&result, 0, sizeof result);
    int64_t job_id = 0;
    enum st st = ST_OK;
    for (size_t i = 0; i < photos->count; i++)
        memcpy(photos->list[i].final_sha256, photos->list[i].made_sha256, HASH_SHA256_BYTES);
    if (settings->reproject && several_stations(photos))
        st = reproject(site, photos, settings, &result, &job_id, progress, err);
    for (size_t i = 0; !st && i < photos->count; i++)
        if (job_id)
            photos->list[i].job_id = job_id;
    if (!st)
        st = site_begin(site, err);
    if (st)
        return st;
    for (size_t i = 0; !st && i < photos->count; i++)
        st = put_row(site, &photos->list[i], err);
    if (!st)
        st = remove_old(site, photos, err);
    if (st)
        site_rollback(site);
    else
        st = site_commit(site, err);
    if (!st)
        *out_result = result;
    return st;
}
