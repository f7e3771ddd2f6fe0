#include "app/fuse_tiles.h"

#include "app/fuse_plan.h"

#include "base/clock.h"
#include "base/json.h"
#include "site/files.h"
#include "site/job.h"
#include "site/photo_tiff.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PAGE = 32 };

/* ---- which photographs ---- */

static bool is_fused(struct site *site, const struct photo_row *row) {
    struct job *job = NULL;
    struct errctx ignored;
    bool yes = row->job_id && !job_read(site, row->job_id, &job, &ignored) &&
               !strncmp(job->kind, "fuse.", 5);
    job_free(job);
    return yes;
}

static enum st add(struct fuse_photos *out, const struct photo_row *row,
                   const struct station *station, const struct fuse_settings *settings,
                   struct errctx *err) {
    struct fuse_photo *grown = realloc(out->list, (out->count + 1) * sizeof *grown);
    if (!grown)
        return errctx_set(err, ST_NOMEM, "no memory for %zu photographs", out->count + 1);
    out->list = grown;
    struct fuse_photo *p = grown + out->count++;
    memset(p, 0, sizeof *p);
    memcpy(p->name, row->name, sizeof p->name);
    p->station_id = row->station_id;
    p->world_from_station = station->pose.world_from_station;
    fuse_plan_pose_sigma(&station->pose, settings, &p->pose_sigma_m, &p->pose_sigma_rad);
    p->station_from_cam = row->station_from_cam;
    p->camera.width_px = row->width_px;
    p->camera.height_px = row->height_px;
    p->row_id = row->id;
    memcpy(p->final_sha256, row->sha256, sizeof p->final_sha256);
    return ST_OK;
}

/* Rows of one station: the fused ones, else all. */
static enum st collect_station(struct site *site, const struct station *station,
                               const struct fuse_settings *settings, struct fuse_photos *out,
                               struct errctx *err) {
    struct photo_row rows[PAGE];
    enum st st = ST_OK;
    size_t before = out->count;
    for (int fused_only = 1; !st && fused_only >= 0 && out->count == before; fused_only--) {
        size_t count = PAGE;
        for (int64_t after = 0; !st && count == PAGE;) {
            st = photo_row_list(site, station->id, after, rows, PAGE, &count, err);
            for (size_t i = 0; !st && i < count; i++) {
                after = rows[i].id;
                if (!fused_only || is_fused(site, &rows[i]))
                    st = add(out, &rows[i], station, settings, err);
            }
        }
    }
    return st;
}

static enum st collect(struct site *site, const struct fuse_settings *settings,
                       struct fuse_photos *out, struct errctx *err) {
    struct station stations[PAGE];
    size_t count = PAGE;
    enum st st = ST_OK;
    for (int64_t after = 0; !st && count == PAGE;) {
        st = station_list(site, after, stations, PAGE, &count, err);
        for (size_t i = 0; !st && i < count; i++) {
            after = stations[i].id;
            st = collect_station(site, &stations[i], settings, out, err);
        }
    }
    if (!st && !out->count)
        st = errctx_set(err, ST_NOT_FOUND, "%s has no photographs: scan or import something first",
                        site_path(site));
    return st;
}

/* Takes over what is in memory already. */
static void adopt(struct fuse_photos *to, struct fuse_photos *from) {
    for (size_t i = 0; from && i < to->count; i++)
        for (size_t k = 0; k < from->count; k++)
            if (from->list[k].photo.disparity_per_m &&
                !memcmp(from->list[k].final_sha256, to->list[i].final_sha256, HASH_SHA256_BYTES)) {
                to->list[i].photo = from->list[k].photo;
                memset(&from->list[k].photo, 0, sizeof from->list[k].photo);
                break;
            }
}

/* Loads all; those whose unit is not the metre have no place in a site's space and go. */
static enum st load(struct site *site, struct fuse_photos *photos, struct errctx *err) {
    size_t n = 0;
    for (size_t i = 0; i < photos->count; i++) {
        struct fuse_photo *p = &photos->list[i];
        struct photo_tiff_info info = {.length_unit = "m"};
        if (!p->photo.disparity_per_m) {
            uint8_t *bytes = NULL;
            size_t size = 0;
            enum st st = files_read(site, p->final_sha256, &bytes, &size, err);
            if (!st)
                st = photo_tiff_decode(bytes, size, &p->photo, &info, err);
            free(bytes);
            if (st)
                return errctx_prefix(err, st, "photograph %s", p->name);
        }
        p->photo.station_from_cam = p->station_from_cam;
        p->camera = p->photo.camera;
        if (strcmp(info.length_unit, "m") != 0) {
            photo_destroy(&p->photo);
            continue;
        }
        photos->list[n++] = *p;
    }
    photos->count = n;
    return n ? ST_OK : errctx_set(err, ST_NOT_FOUND, "no photograph has a scale in metres");
}

/* ---- the job ---- */

static enum st parameters(const struct fuse_photos *photos, const struct fuse_settings *s,
                          char **out_text, struct errctx *err) {
    struct json json;
    json_init_object(&json);
    json_number(&json, NULL, "error_m", s->pack.error_m);
    json_number(&json, NULL, "error_range_m", s->pack.error_range_m);
    json_number(&json, NULL, "noise_share", s->pack.noise_share);
    json_integer(&json, NULL, "planes", s->pack.planes);
    json_integer(&json, NULL, "confidence_step", s->pack.confidence_step);
    json_integer(&json, NULL, "zstd_level", s->pack.zstd_level);
    json_boolean(&json, NULL, "cull", s->reproject);
    json_number(&json, NULL, "threshold", s->cull.threshold);
    json_number(&json, NULL, "cull_sigmas", s->cull.sigmas);
    json_number(&json, NULL, "doubt", s->cull.doubt);
    json_integer(&json, NULL, "keep_frontier", s->cull.keep_frontier);
    struct cJSON *list = json_array(&json, NULL, "photos");
    for (size_t i = 0; i < photos->count; i++) {
        const struct pose *p = &photos->list[i].world_from_station;
        struct cJSON *one = json_object(&json, list, NULL);
        json_text(&json, one, "name", photos->list[i].name);
        struct cJSON *pose = json_array(&json, one, "world_from_station");
        for (int k = 0; k < 9; k++)
            json_number(&json, pose, NULL, p->r.m[k]);
        json_number(&json, pose, NULL, p->t_m.x);
        json_number(&json, pose, NULL, p->t_m.y);
        json_number(&json, pose, NULL, p->t_m.z);
        json_number(&json, pose, NULL, photos->list[i].pose_sigma_m);
        json_number(&json, pose, NULL, photos->list[i].pose_sigma_rad);
    }
    enum st st = json_print(&json, out_text, err);
    json_fini(&json);
    return st;
}

static enum st find_pack(struct site *site, const struct job *wanted,
                         struct fuse_tiles_result *result, struct errctx *err) {
    struct job *found = NULL;
    struct files_entry entry;
    int64_t id = 0;
    enum st st = job_find(site, wanted, &id, err);
    if (!st)
        st = job_read(site, id, &found, err);
    if (!st && found->output_count != 1)
        st = ST_NOT_FOUND;
    if (!st)
        st = files_find(site, found->outputs[0].sha256, &entry, err);
    if (!st) {
        memcpy(result->sha256, entry.sha256, sizeof result->sha256);
        result->file_bytes = entry.size_bytes;
        result->kept = true;
    }
    job_free(found);
    return st;
}

/* ---- the work ---- */

static void free_masks(uint8_t **masks, size_t count) {
    for (size_t i = 0; masks && i < count; i++)
        free(masks[i]);
    free(masks);
}

static bool tick(void *context, size_t done, size_t total) {
    (void)done;
    (void)total;
    progress_add(context, 0);
    return true;
}

/* One mask a photograph; all 0 without culling. */
static enum st cull(const struct fuse_photos *photos, const struct fuse_settings *s,
                    struct fuse_tiles_result *result, struct progress *progress,
                    uint8_t ***out_masks, struct errctx *err) {
    int64_t start_ns = clock_now_ns();
    struct cull_view *views = calloc(photos->count, sizeof *views);
    uint8_t **masks = calloc(photos->count, sizeof *masks);
    enum st st = views && masks ? ST_OK : ST_NOMEM;
    for (size_t i = 0; !st && i < photos->count; i++) {
        const struct fuse_photo *p = &photos->list[i];
        masks[i] = calloc(photo_tile_count(p->camera.width_px, p->camera.height_px), 1);
        views[i] = (struct cull_view){.photo = &p->photo,
                                      .world_from_station = p->world_from_station,
                                      .station = p->station_id,
                                      .pose_sigma_m = p->pose_sigma_m,
                                      .pose_sigma_rad = p->pose_sigma_rad,
                                      .culled = masks[i]};
        st = masks[i] ? ST_OK : ST_NOMEM;
    }
    if (st)
        (void)errctx_set(err, st, "no memory to cull tiles");
    struct cull_progress steps = {tick, progress};
    if (!st && s->reproject && photos->count > 1)
        st = cull_tiles(views, photos->count, &s->cull, &steps, &result->cull, err);
    free(views);
    if (st)
        free_masks(masks, photos->count);
    else
        *out_masks = masks;
    result->seconds_cull = 1e-9 * (double)(clock_now_ns() - start_ns);
    return st;
}

static enum st write_pack(const char *path, const struct fuse_photos *photos, uint8_t **masks,
                          const struct fuse_settings *s, struct fuse_tiles_result *result,
                          struct progress *progress, struct errctx *err) {
    struct tile_pack_photo *entries = calloc(photos->count, sizeof *entries);
    struct tile_pack_writer *writer = NULL;
    enum st st = entries ? ST_OK : errctx_set(err, ST_NOMEM, "no memory for the tiles");
    for (size_t i = 0; !st && i < photos->count; i++) {
        const struct fuse_photo *p = &photos->list[i];
        (void)snprintf(entries[i].name, sizeof entries[i].name, "%s", p->name);
        entries[i].photo_id = p->row_id;
        entries[i].station_id = p->station_id;
        entries[i].camera = p->camera;
        entries[i].station_from_cam = p->station_from_cam;
        entries[i].world_from_station = p->world_from_station;
    }
    if (!st)
        st = tile_pack_create(path, entries, (int32_t)photos->count, s->pack.error_m,
                              s->pack.error_range_m, &writer, err);
    for (size_t i = 0; !st && i < photos->count; i++) {
        struct pack_stats stats;
        st = pack_photo(writer, &entries[i], &photos->list[i].photo, masks[i], &s->pack, &stats,
                        err);
        if (!st)
            pack_stats_add(&result->pack, &stats);
        progress_add(progress, 1);
    }
    if (st) {
        tile_pack_abandon(writer);
    } else {
        uint64_t bytes = 0;
        st = tile_pack_commit(writer, &bytes, err);
        result->file_bytes = (int64_t)bytes;
    }
    free(entries);
    return st;
}

static enum st compute(struct site *site, struct fuse_photos *photos, const struct fuse_settings *s,
                       struct job *job, struct fuse_tiles_result *result, struct progress *progress,
                       struct errctx *err) {
    char path[FILEIO_PATH_MAX];
    uint8_t **masks = NULL;
    enum st st = cull(photos, s, result, progress, &masks, err);
    if (st)
        return st;
    int64_t start_ns = clock_now_ns();
    st = files_temp_path(site, FILES_TILES, "tiles", path, err);
    if (!st)
        st = write_pack(path, photos, masks, s, result, progress, err);
    if (!st)
        st = files_adopt(site, FILES_TILES, "tiles", path, result->sha256, err);
    result->seconds_pack = 1e-9 * (double)(clock_now_ns() - start_ns);
    free_masks(masks, photos->count);
    if (st)
        return st;
    struct job_hash output = {.outside = false};
    (void)snprintf(output.role, sizeof output.role, "tiles");
    memcpy(output.sha256, result->sha256, sizeof output.sha256);
    job->outputs = &output;
    job->output_count = 1;
    job->seconds = result->seconds_cull + result->seconds_pack;
    int64_t id = 0;
    return job_add(site, job, &id, err);
}

enum st fuse_tiles(struct site *site, struct fuse_photos *photos,
                   const struct fuse_settings *settings, struct fuse_tiles_result *out_result,
                   struct progress *progress, struct errctx *err) {
    struct fuse_tiles_result result;
    struct fuse_photos all = {NULL, 0};
    struct job_hash *inputs = NULL;
    char *text = NULL;
    memset(&result, 0, sizeof result);
    enum st st = collect(site, settings, &all, err);
    if (!st)
        st = parameters(&all, settings, &text, err);
    if (!st && !(inputs = calloc(all.count, sizeof *inputs)))
        st = errctx_set(err, ST_NOMEM, "no memory for the tiles");
    for (size_t i = 0; !st && i < all.count; i++) {
        (void)snprintf(inputs[i].role, sizeof inputs[i].role, "photo");
        memcpy(inputs[i].sha256, all.list[i].final_sha256, sizeof inputs[i].sha256);
    }
    struct job job = {
        .kind = "fuse.tiles", .parameters = text, .inputs = inputs, .input_count = all.count};
    (void)snprintf(job.program, sizeof job.program, "%s", fuse_photo_program);
    if (!st)
        st = find_pack(site, &job, &result, err);
    result.photo_count = all.count;
    if (st == ST_NOT_FOUND && all.count) {
        adopt(&all, photos);
        st = load(site, &all, err);
        result.photo_count = all.count;
        if (!st)
            st = compute(site, &all, settings, &job, &result, progress, err);
    }
    fuse_photos_fini(&all);
    free(inputs);
    free(text);
    if (!st)
        *out_result = result;
    return st;
}

enum st fuse_tiles_path(struct site *site, char out_path[FILEIO_PATH_MAX], struct errctx *err) {
    int64_t ids[PAGE], newest = 0;
    size_t count = PAGE;
    enum st st = ST_OK;
    for (int64_t after = 0; !st && count == PAGE;) {
        st = job_list(site, "fuse.tiles", after, ids, PAGE, &count, err);
        if (!st && count)
            after = newest = ids[count - 1];
    }
    if (st)
        return st;
    if (!newest)
        return errctx_set(err, ST_NOT_FOUND, "%s has no tiles: run scancart fuse %s",
                          site_path(site), site_path(site));
    struct job *job = NULL;
    st = job_read(site, newest, &job, err);
    if (!st && !job->output_count)
        st = errctx_set(err, ST_NOT_FOUND, "the newest tiles are gone: run scancart fuse");
    if (!st)
        st = files_path(site, job->outputs[0].sha256, out_path, err);
    job_free(job);
    return st;
}
