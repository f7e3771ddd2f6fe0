#include "app/app_photos.h"

#include "raster/skin.h"
#include "site/files.h"
#include "site/photo_row.h"
#include "site/photo_tiff.h"
#include "site/station.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PAGE = 64 };

/* Does `list` ("a,st1/b") name the photograph? */
static bool listed(const char *list, const char *station, const char *name) {
    char full[2 * SITE_NAME_MAX];
    (void)snprintf(full, sizeof full, "%s/%s", station, name);
    for (const char *at = list; *at;) {
        size_t n = strcspn(at, ",");
        if ((strlen(name) == n && !strncmp(at, name, n)) ||
            (strlen(full) == n && !strncmp(at, full, n)))
            return true;
        at += n + (at[n] == ',');
    }
    return false;
}

static enum st read_photo(struct site *site, const struct photo_row *row, struct app_photo *out,
                          struct errctx *err) {
    uint8_t *bytes = NULL;
    size_t size = 0;
    struct photo_tiff_info info;
    enum st st = files_read(site, row->sha256, &bytes, &size, err);
    if (!st)
        st = photo_tiff_decode(bytes, size, &out->photo, &info, err);
    free(bytes);
    if (st)
        return errctx_prefix(err, st, "photograph %s", row->name);
    (void)snprintf(out->length_unit, sizeof out->length_unit, "%s", info.length_unit);
    (void)snprintf(out->name, sizeof out->name, "%s", row->name);
    out->photo.station_from_cam = row->station_from_cam;
    return ST_OK;
}

static bool has_skins(const struct photo *photo) {
    size_t n = (size_t)photo->camera.width_px * (size_t)photo->camera.height_px;
    for (size_t i = 0; i < n; i++)
        if (photo->flags[i] & PHOTO_SKIN)
            return true;
    return false;
}

static enum st prepare(struct app_photo *p, bool bound_unknown, struct errctx *err) {
    p->world_from_cam = pose_compose(&p->world_from_station, &p->photo.station_from_cam);
    if (!has_skins(&p->photo)) {
        struct skin_params params = skin_params_default();
        (void)skin_fill_cracks(&p->photo, &params);
        (void)skin_mark(&p->photo, &params);
    }
    p->tile_count = photo_tile_count(p->photo.camera.width_px, p->photo.camera.height_px);
    p->tiles = malloc(p->tile_count * sizeof *p->tiles);
    if (!p->tiles || (bound_unknown && skin_bound_unknown(&p->photo, NULL)))
        return errctx_set(err, ST_NOMEM, "no memory for the tiles of photograph %s", p->name);
    photo_tiles(&p->photo, &p->world_from_station, p->tiles);
    return ST_OK;
}

static void photo_fini(struct app_photo *p) {
    photo_destroy(&p->photo);
    free(p->tiles);
}

/* Adds one photograph; its station's pose is the newest. */
static enum st add(struct site *site, const struct photo_row *row, const struct station *station,
                   bool bound_unknown, struct app_photos *photos, struct errctx *err) {
    size_t n = photos->count + 1;
    struct app_photo *grown = realloc(photos->photos, n * sizeof *grown);
    if (!grown)
        return errctx_set(err, ST_NOMEM, "no memory for %zu photographs", n);
    photos->photos = grown;
    struct app_photo *p = &grown[n - 1];
    memset(p, 0, sizeof *p);
    (void)snprintf(p->station, sizeof p->station, "%s", station->name);
    p->world_from_station = station->pose.world_from_station;
    enum st st = read_photo(site, row, p, err);
    if (!st)
        st = prepare(p, bound_unknown, err);
    if (st) {
        photo_fini(p);
        return st;
    }
    photos->count = n;
    return ST_OK;
}

/* Each name in the list must be somebody's. */
static enum st check_names(const char *list, const struct app_photos *photos, struct errctx *err) {
    for (const char *at = list; at && *at;) {
        size_t n = strcspn(at, ",");
        char one[2 * SITE_NAME_MAX];
        (void)snprintf(one, sizeof one, "%.*s", (int)(n < sizeof one ? n : sizeof one - 1), at);
        bool found = false;
        for (size_t i = 0; i < photos->count && !found; i++)
            found = listed(one, photos->photos[i].station, photos->photos[i].name);
        if (!found)
            return errctx_set(err, ST_NOT_FOUND, "no photograph '%s' in this site", one);
        at += n + (at[n] == ',');
    }
    return ST_OK;
}

static enum st make_inputs(struct app_photos *photos, struct errctx *err) {
    photos->inputs = calloc(photos->count, sizeof *photos->inputs);
    if (!photos->inputs)
        return errctx_set(err, ST_NOMEM, "no memory for %zu photographs", photos->count);
    for (size_t i = 0; i < photos->count; i++) {
        const struct app_photo *p = &photos->photos[i];
        photos->inputs[i] = (struct raster_input){.tiles = p->tiles,
                                                  .tile_count = p->tile_count,
                                                  .photo_width_px = p->photo.camera.width_px,
                                                  .photo_height_px = p->photo.camera.height_px,
                                                  .id = (uint32_t)i};
    }
    return ST_OK;
}

enum st app_photos_load(struct site *site, const struct app_photos_options *options,
                        struct app_photos *out_photos, struct errctx *err) {
    struct app_photos photos = {0};
    struct photo_row rows[PAGE];
    size_t n = PAGE, seen = 0;
    int64_t after = 0;
    enum st st = ST_OK;
    while (!st && n == PAGE) {
        st = photo_row_list(site, 0, after, rows, PAGE, &n, err);
        for (size_t i = 0; !st && i < n; i++, seen++) {
            struct station station;
            after = rows[i].id;
            st = station_get(site, rows[i].station_id, &station, err);
            if (st || (options->wanted && !listed(options->wanted, station.name, rows[i].name)) ||
                (options->unwanted && listed(options->unwanted, station.name, rows[i].name)))
                continue;
            st = add(site, &rows[i], &station, options->bound_unknown, &photos, err);
        }
    }
    if (!st && !seen)
        st = errctx_set(err, ST_NOT_FOUND,
                        "%s has no photographs; 'scancart import photo' brings some in",
                        site_path(site));
    if (!st)
        st = check_names(options->wanted, &photos, err);
    if (!st && !photos.count)
        st = errctx_set(err, ST_NOT_FOUND, "no photograph is left to draw");
    if (!st)
        st = make_inputs(&photos, err);
    if (st)
        app_photos_fini(&photos);
    else
        *out_photos = photos;
    return st;
}

void app_photos_fini(struct app_photos *photos) {
    if (!photos)
        return;
    for (size_t i = 0; i < photos->count; i++)
        photo_fini(&photos->photos[i]);
    free(photos->photos);
    free(photos->inputs);
    memset(photos, 0, sizeof *photos);
}

enum st app_photos_view(struct site *site, const char *name, struct app_photo_view *out_view,
                        struct errctx *err) {
    struct photo_row rows[PAGE];
    size_t n = PAGE;
    int64_t after = 0;
    while (n == PAGE) {
        enum st st = photo_row_list(site, 0, after, rows, PAGE, &n, err);
        for (size_t i = 0; !st && i < n; i++) {
            struct station station;
            after = rows[i].id;
            st = station_get(site, rows[i].station_id, &station, err);
            if (st || (name && !listed(name, station.name, rows[i].name)))
                continue;
            struct app_photo photo = {0};
            st = read_photo(site, &rows[i], &photo, err);
            if (st)
                return st;
            out_view->camera = photo.photo.camera;
            out_view->world_from_cam =
                pose_compose(&station.pose.world_from_station, &rows[i].station_from_cam);
            photo_fini(&photo);
            return ST_OK;
        }
        if (st)
            return st;
    }
    if (!name)
        return errctx_set(err, ST_NOT_FOUND,
                          "%s has no photographs; 'scancart import photo' brings some in",
                          site_path(site));
    return errctx_set(err, ST_NOT_FOUND, "no photograph '%s' in this site", name);
}
