#include "app/view_source.h"

#include "app/fuse_tiles.h"
#include "base/tile_pack.h"
#include "fusion/lod.h"
#include "raster/skin.h"
#include "site/files.h"
#include "site/photo_row.h"
#include "site/photo_tiff.h"
#include "site/station.h"

#include <stdlib.h>
#include <string.h>

/* One photograph and its coarser levels. */
struct pyramid {
    struct photo levels[TILE_PACK_MAX_LEVELS];
    int32_t count;
};

struct view_source {
    struct tile_pack *pack; /* NULL: photographs */
    struct pyramid *pyramids;
    struct tile_pack_index index; /* of the photographs */
    int left_out;
    bool metric;
    struct errctx why;
};

/* ---- photographs ---- */

static enum st pack_read(const void *self, int64_t node, struct tile_samples *out,
                         struct errctx *err) {
    const struct view_source *s = self;
    return tile_pack_read(s->pack, node, out, err);
}

static enum st photos_read(const void *self, int64_t node, struct tile_samples *out,
                           struct errctx *err) {
    const struct view_source *s = self;
    int32_t p = s->index.photo_count - 1, nx = 1, ny = 1;
    while (p > 0 && s->index.photos[p].first_node[0] > node)
        p--;
    const struct tile_pack_photo *entry = &s->index.photos[p];
    int32_t level = 0;
    while (level + 1 < entry->level_count && entry->first_node[level + 1] <= node)
        level++;
    tile_pack_tiles(&entry->camera, level, &nx, &ny);
    int64_t at = node - entry->first_node[level];
    if (at < 0 || at >= (int64_t)nx * ny)
        return errctx_set(err, ST_INVALID, "there is no tile %lld", (long long)node);
    const struct photo *photo = &s->pyramids[p].levels[level];
    int32_t u0 = (int32_t)(at % nx) * PHOTO_TILE_PX, v0 = (int32_t)(at / nx) * PHOTO_TILE_PX;
    int32_t w = photo->camera.width_px - u0, h = photo->camera.height_px - v0;
    out->width = w < TILE_CODE_SIDE ? w : TILE_CODE_SIDE;
    out->height = h < TILE_CODE_SIDE ? h : TILE_CODE_SIDE;
    size_t n = (size_t)out->width;
    for (int32_t y = 0; y < out->height; y++) {
        size_t from = (size_t)(v0 + y) * (size_t)photo->camera.width_px + (size_t)u0;
        size_t to = (size_t)y * n;
        memcpy(out->rgb + 3 * to, photo->rgb + 3 * from, 3 * n);
        memcpy(out->disparity_per_m + to, photo->disparity_per_m + from, 4 * n);
        memcpy(out->flags + to, photo->flags + from, n);
        memcpy(out->confidence + to, photo->confidence + from, n);
    }
    return ST_OK;
}

/* The tile's line in the index. */
static void describe(const struct tile *tile, struct tile_pack_node *node) {
    float lo = 1.0f, hi = 0.0f;
    bool sky = false;
    for (int32_t y = 0; y <= tile->cells_y; y++)
        for (int32_t x = 0; x <= tile->cells_x; x++) {
            float d = tile->disparity_per_m[y * tile->stride_px + x];
            sky = sky || d == 0.0f;
            if (!(d > 0.0f))
                continue;
            bool first = lo > hi;
            lo = first || d < lo ? d : lo;
            hi = first || d > hi ? d : hi;
        }
    node->disparity_min_per_m = lo;
    node->disparity_max_per_m = hi;
    node->valid_count = (uint16_t)tile->valid_count;
    node->kind = lo <= hi || sky ? TILE_PACK_SAMPLED : TILE_PACK_NONE;
    node->flags = sky ? TILE_PACK_SKY : 0;
}

static enum st grow_index(struct view_source *s, int64_t nodes, struct errctx *err) {
    size_t photos = (size_t)s->index.photo_count + 1;
    void *p = realloc(s->index.photos, photos * sizeof *s->index.photos);
    s->index.photos = p ? p : s->index.photos;
    void *q = realloc(s->pyramids, photos * sizeof *s->pyramids);
    s->pyramids = q ? q : s->pyramids;
    void *n = realloc(s->index.nodes, (size_t)nodes * sizeof *s->index.nodes);
    s->index.nodes = n ? n : s->index.nodes;
    return p && q && n ? ST_OK : errctx_set(err, ST_NOMEM, "no memory for %zu photographs", photos);
}

static enum st index_level(struct view_source *s, struct tile_pack_photo *entry,
                           const struct photo *photo, int32_t level, struct errctx *err) {
    size_t n = photo_tile_count(photo->camera.width_px, photo->camera.height_px);
    struct tile *tiles = malloc(n * sizeof *tiles);
    if (!tiles)
        return errctx_set(err, ST_NOMEM, "no memory for %zu tiles", n);
    photo_tiles(photo, NULL, tiles);
    entry->first_node[level] = s->index.node_count;
    for (size_t i = 0; i < n; i++) {
        struct tile_pack_node node;
        memset(&node, 0, sizeof node);
        describe(&tiles[i], &node);
        s->index.nodes[s->index.node_count++] = node;
    }
    free(tiles);
    return ST_OK;
}

static void pyramid_fini(struct pyramid *pyramid) {
    for (int32_t l = 0; l < pyramid->count; l++)
        photo_destroy(&pyramid->levels[l]);
}

/* Takes the photograph over. */
static enum st add_photo(struct view_source *s, struct photo *photo,
                         const struct tile_pack_photo *about, struct errctx *err) {
    struct tile_pack_photo entry = *about;
    struct pyramid pyramid = {.levels = {*photo}, .count = 1};
    struct lod_params params = lod_params_default();
    entry.camera = photo->camera;
    entry.level_count = tile_pack_level_count(&entry.camera);
    enum st st = ST_OK;
    int64_t nodes = s->index.node_count;
    for (int32_t l = 0; l < entry.level_count; l++) {
        int32_t nx, ny;
        tile_pack_tiles(&entry.camera, l, &nx, &ny);
        nodes += (int64_t)nx * ny;
        if (l > 0 && !st)
            st = lod_half(&pyramid.levels[l - 1], &params, &pyramid.levels[l], err);
        pyramid.count += l > 0 && !st;
    }
    if (!st)
        st = grow_index(s, nodes, err);
    for (int32_t l = 0; l < entry.level_count && !st; l++)
        st = index_level(s, &entry, &pyramid.levels[l], l, err);
    if (st) {
        pyramid_fini(&pyramid);
        return st;
    }
    s->index.photos[s->index.photo_count] = entry;
    s->pyramids[s->index.photo_count++] = pyramid;
    return ST_OK;
}

static void mark_skins(struct photo *photo) {
    size_t n = (size_t)photo->camera.width_px * (size_t)photo->camera.height_px;
    for (size_t i = 0; i < n; i++)
        if (photo->flags[i] & PHOTO_SKIN)
            return;
    struct skin_params params = skin_params_default();
    (void)skin_mark(photo, &params);
}

static enum st read_row(struct view_source *s, struct site *site, const struct photo_row *row,
                        struct errctx *err) {
    struct tile_pack_photo about;
    struct photo_tiff_info info;
    struct station station;
    struct photo photo;
    uint8_t *bytes = NULL;
    size_t size = 0;
    memset(&about, 0, sizeof about);
    memset(&photo, 0, sizeof photo);
    enum st st = station_get(site, row->station_id, &station, err);
    if (!st)
        st = files_read(site, row->sha256, &bytes, &size, err);
    if (!st)
        st = photo_tiff_decode(bytes, size, &photo, &info, err);
    free(bytes);
    if (st)
        return errctx_prefix(err, st, "photograph %s", row->name);
    s->metric = s->metric && !strcmp(info.length_unit, "m");
    mark_skins(&photo);
    memcpy(about.name, row->name, sizeof about.name);
    about.photo_id = row->id;
    about.station_id = row->station_id;
    about.station_from_cam = row->station_from_cam;
    about.world_from_station = station.pose.world_from_station;
    photo.station_from_cam = row->station_from_cam;
    return add_photo(s, &photo, &about, err);
}

static enum st open_photos(struct view_source *s, struct site *site, struct errctx *err) {
    enum { PAGE = 64 };
    struct photo_row rows[PAGE];
    size_t n = PAGE;
    int64_t after = 0;
    enum st st = ST_OK;
    while (!st && n == PAGE) {
        st = photo_row_list(site, 0, after, rows, PAGE, &n, err);
        for (size_t i = 0; !st && i < n; i++) {
            struct errctx why = {0};
            after = rows[i].id;
            if (!read_row(s, site, &rows[i], &why))
                continue;
            if (!s->left_out++)
                s->why = why;
        }
    }
    if (st || s->index.photo_count)
        return st;
    if (s->left_out)
        return errctx_set(err, s->why.st, "%s", s->why.text);
    return errctx_set(err, ST_NOT_FOUND,
                      "%s has nothing to show yet: 'scancart import' or 'scancart fuse' first",
                      site_path(site));
}

/* ---- either ---- */

enum st view_source_open(struct site *site, bool from_photos, struct view_source **out_source,
                         struct errctx *err) {
    struct view_source *s = calloc(1, sizeof *s);
    char path[FILEIO_PATH_MAX];
    struct errctx why = {0};
    if (!s)
        return errctx_set(err, ST_NOMEM, "no memory");
    s->metric = true;
    enum st st = ST_OK;
    if (!from_photos && !fuse_tiles_path(site, path, &why) &&
        tile_pack_open(path, &s->pack, &why)) {
        s->left_out = 1; /* a damaged pack: the photographs still show everything */
        s->why = why;
    }
    if (!s->pack)
        st = open_photos(s, site, err);
    if (st) {
        view_source_close(s);
        return st;
    }
    *out_source = s;
    return ST_OK;
}

void view_source_close(struct view_source *s) {
    if (!s)
        return;
    tile_pack_close(s->pack);
    for (int32_t p = 0; p < s->index.photo_count; p++)
        pyramid_fini(&s->pyramids[p]);
    free(s->pyramids);
    free(s->index.photos);
    free(s->index.nodes);
    free(s);
}

struct tile_source view_source_tiles(const struct view_source *s) {
    struct tile_source out = {.index = s->pack ? tile_pack_get_index(s->pack) : &s->index,
                              .read = s->pack ? pack_read : photos_read,
                              .self = s};
    return out;
}

const char *view_source_kind(const struct view_source *s) {
    return s->pack ? "tiles" : "photographs";
}

int view_source_left_out(const struct view_source *s, const char **out_why) {
    *out_why = s->why.text;
    return s->left_out;
}

bool view_source_is_metric(const struct view_source *s) {
    return s->metric;
}
