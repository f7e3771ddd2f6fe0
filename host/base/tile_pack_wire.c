#include "base/tile_pack_wire.h"

#include <math.h>
#include <string.h>

const char tile_pack_wire_magic[8] = {'S', 'C', 'T', 'I', 'L', 'E', 'S', '\n'};

static uint8_t *put_u(uint8_t *p, uint64_t x, int bytes) {
    for (int i = 0; i < bytes; i++)
        *p++ = (uint8_t)(x >> (8 * i));
    return p;
}
static uint64_t get_u(const uint8_t **p, int bytes) {
    uint64_t x = 0;
    for (int i = 0; i < bytes; i++)
        x |= (uint64_t)(*p)[i] << (8 * i);
    *p += bytes;
    return x;
}
static uint8_t *put_f64(uint8_t *p, double f) {
    uint64_t x;
    memcpy(&x, &f, sizeof x);
    return put_u(p, x, 8);
}
static double get_f64(const uint8_t **p) {
    uint64_t x = get_u(p, 8);
    double f;
    memcpy(&f, &x, sizeof f);
    return f;
}
static uint8_t *put_f32(uint8_t *p, float f) {
    uint32_t x;
    memcpy(&x, &f, sizeof x);
    return put_u(p, x, 4);
}
static float get_f32(const uint8_t **p) {
    uint32_t x = (uint32_t)get_u(p, 4);
    float f;
    memcpy(&f, &x, sizeof f);
    return f;
}

void tile_pack_wire_put_header(uint8_t *out_bytes, const struct tile_pack_wire_header *h) {
    memset(out_bytes, 0, TILE_PACK_WIRE_HEADER_BYTES);
    memcpy(out_bytes, tile_pack_wire_magic, sizeof tile_pack_wire_magic);
    uint8_t *p = put_u(out_bytes + 8, h->version, 4);
    p = put_u(p, h->index_crc32c, 4);
    p = put_u(p, (uint64_t)h->photo_count, 8);
    p = put_u(p, (uint64_t)h->node_count, 8);
    p = put_u(p, h->file_bytes, 8);
    p = put_f64(p, h->error_m);
    (void)put_f64(p, h->error_range_m);
}

enum st tile_pack_wire_get_header(const uint8_t *bytes, struct tile_pack_wire_header *out) {
    if (memcmp(bytes, tile_pack_wire_magic, sizeof tile_pack_wire_magic) != 0)
        return ST_FORMAT;
    const uint8_t *p = bytes + 8;
    struct tile_pack_wire_header h = {.version = (uint32_t)get_u(&p, 4),
                                      .index_crc32c = (uint32_t)get_u(&p, 4)};
    uint64_t photos = get_u(&p, 8), nodes = get_u(&p, 8);
    h.file_bytes = get_u(&p, 8);
    h.error_m = get_f64(&p);
    h.error_range_m = get_f64(&p);
    if (h.version != TILE_PACK_VERSION || photos > TILE_PACK_MAX_PHOTOS ||
        nodes > (uint64_t)TILE_PACK_MAX_NODES)
        return ST_FORMAT;
    h.photo_count = (int64_t)photos;
    h.node_count = (int64_t)nodes;
    *out = h;
    return ST_OK;
}

static uint8_t *put_pose(uint8_t *p, const struct pose *pose) {
    for (int i = 0; i < 9; i++)
        p = put_f64(p, pose->r.m[i]);
    p = put_f64(p, pose->t_m.x);
    p = put_f64(p, pose->t_m.y);
    return put_f64(p, pose->t_m.z);
}
static struct pose get_pose(const uint8_t **p) {
    struct pose pose;
    for (int i = 0; i < 9; i++)
        pose.r.m[i] = get_f64(p);
    pose.t_m.x = get_f64(p);
    pose.t_m.y = get_f64(p);
    pose.t_m.z = get_f64(p);
    return pose;
}

void tile_pack_wire_put_photo(uint8_t *out_bytes, const struct tile_pack_photo *photo) {
    memset(out_bytes, 0, TILE_PACK_WIRE_PHOTO_BYTES);
    memcpy(out_bytes, photo->name, sizeof photo->name);
    uint8_t *p = out_bytes + TILE_PACK_NAME_BYTES;
    p = put_u(p, (uint64_t)photo->photo_id, 8);
    p = put_u(p, (uint64_t)photo->station_id, 8);
    p = put_u(p, (uint32_t)photo->camera.width_px, 4);
    p = put_u(p, (uint32_t)photo->camera.height_px, 4);
    p = put_f64(p, photo->camera.fx_px);
    p = put_f64(p, photo->camera.fy_px);
    p = put_f64(p, photo->camera.cx_px);
    p = put_f64(p, photo->camera.cy_px);
    p = put_pose(p, &photo->station_from_cam);
    p = put_pose(p, &photo->world_from_station);
    (void)put_u(p, (uint64_t)photo->first_node[0], 8);
}

void tile_pack_wire_get_photo(const uint8_t *bytes, struct tile_pack_photo *out) {
    memset(out, 0, sizeof *out);
    memcpy(out->name, bytes, sizeof out->name);
    out->name[sizeof out->name - 1] = 0;
    const uint8_t *p = bytes + TILE_PACK_NAME_BYTES;
    out->photo_id = (int64_t)get_u(&p, 8);
    out->station_id = (int64_t)get_u(&p, 8);
    out->camera.width_px = (int32_t)(uint32_t)get_u(&p, 4);
    out->camera.height_px = (int32_t)(uint32_t)get_u(&p, 4);
    out->camera.fx_px = get_f64(&p);
    out->camera.fy_px = get_f64(&p);
    out->camera.cx_px = get_f64(&p);
    out->camera.cy_px = get_f64(&p);
    out->station_from_cam = get_pose(&p);
    out->world_from_station = get_pose(&p);
    out->first_node[0] = (int64_t)get_u(&p, 8);
}

void tile_pack_wire_put_node(uint8_t *out_bytes, const struct tile_pack_node *n) {
    uint8_t *p = put_u(out_bytes, n->offset, 8);
    p = put_u(p, n->size_bytes, 4);
    p = put_u(p, n->crc32c, 4);
    p = put_f32(p, n->disparity_min_per_m);
    p = put_f32(p, n->disparity_max_per_m);
    p = put_f32(p, n->error_per_m);
    p = put_u(p, n->valid_count, 2);
    p = put_u(p, n->kind, 1);
    (void)put_u(p, n->flags, 1);
}

void tile_pack_wire_get_node(const uint8_t *bytes, struct tile_pack_node *out) {
    const uint8_t *p = bytes;
    out->offset = get_u(&p, 8);
    out->size_bytes = (uint32_t)get_u(&p, 4);
    out->crc32c = (uint32_t)get_u(&p, 4);
    out->disparity_min_per_m = get_f32(&p);
    out->disparity_max_per_m = get_f32(&p);
    out->error_per_m = get_f32(&p);
    out->valid_count = (uint16_t)get_u(&p, 2);
    out->kind = (uint8_t)get_u(&p, 1);
    out->flags = (uint8_t)get_u(&p, 1);
}

struct camera tile_pack_camera(const struct camera *level0, int32_t level) {
    struct camera c = *level0;
    for (int32_t k = 0; k < level; k++) {
        c.width_px = (c.width_px + 1) / 2;
        c.height_px = (c.height_px + 1) / 2;
        c.fx_px *= 0.5;
        c.fy_px *= 0.5;
        c.cx_px = (c.cx_px - 0.5) * 0.5; /* pixel 0 covers 0 and 1: its centre is at 0.5 */
        c.cy_px = (c.cy_px - 0.5) * 0.5;
    }
    return c;
}

static int32_t tiles_of(int32_t px) {
    return (px + PHOTO_TILE_PX - 1) / PHOTO_TILE_PX;
}

void tile_pack_tiles(const struct camera *level0, int32_t level, int32_t *out_tiles_x,
                     int32_t *out_tiles_y) {
    int32_t w = level0->width_px, h = level0->height_px;
    for (int32_t k = 0; k < level; k++) {
        w = (w + 1) / 2;
        h = (h + 1) / 2;
    }
    *out_tiles_x = tiles_of(w);
    *out_tiles_y = tiles_of(h);
}

int32_t tile_pack_level_count(const struct camera *level0) {
    for (int32_t level = 0;; level++) {
        int32_t x, y;
        tile_pack_tiles(level0, level, &x, &y);
        if ((x == 1 && y == 1) || level == TILE_PACK_MAX_LEVELS - 1)
            return level + 1;
    }
}

int64_t tile_pack_node_at(const struct tile_pack_photo *photo, int32_t level, int32_t i,
                          int32_t j) {
    int32_t x, y;
    tile_pack_tiles(&photo->camera, level, &x, &y);
    return photo->first_node[level] + (int64_t)j * x + i;
}

int64_t tile_pack_wire_lay_out(struct tile_pack_photo *photo, int64_t first) {
    photo->level_count = tile_pack_level_count(&photo->camera);
    int64_t at = first;
    for (int32_t level = 0; level < photo->level_count; level++) {
        int32_t x, y;
        tile_pack_tiles(&photo->camera, level, &x, &y);
        photo->first_node[level] = at;
        at += (int64_t)x * y;
    }
    return at - first;
}

struct tile tile_pack_tile(const struct tile_pack_photo *photo, int32_t level, int32_t i, int32_t j,
                           const struct tile_samples *s) {
    struct camera c = tile_pack_camera(&photo->camera, level);
    struct tile t = {.rgb = s->rgb,
                     .disparity_per_m = s->disparity_per_m,
                     .flags = s->flags,
                     .confidence = s->confidence,
                     .stride_px = s->width,
                     .u0_px = i * PHOTO_TILE_PX,
                     .v0_px = j * PHOTO_TILE_PX,
                     .width_px = s->width < PHOTO_TILE_PX ? s->width : PHOTO_TILE_PX,
                     .height_px = s->height < PHOTO_TILE_PX ? s->height : PHOTO_TILE_PX,
                     .cells_x = s->width - 1,
                     .cells_y = s->height - 1,
                     .disparity_min_per_m = 1.0f,
                     .disparity_max_per_m = 0.0f};
    for (int32_t y = 0; y < s->height; y++)
        for (int32_t x = 0; x < s->width; x++) {
            float d = s->disparity_per_m[y * s->width + x];
            if (isnan(d))
                continue;
            if (t.disparity_min_per_m > t.disparity_max_per_m)
                t.disparity_min_per_m = t.disparity_max_per_m = d;
            t.disparity_min_per_m = d < t.disparity_min_per_m ? d : t.disparity_min_per_m;
            t.disparity_max_per_m = d > t.disparity_max_per_m ? d : t.disparity_max_per_m;
            t.valid_count += x < t.width_px && y < t.height_px;
        }
    struct pose world_from_cam = pose_compose(&photo->world_from_station, &photo->station_from_cam);
    struct mat3 k = {{1.0 / c.fx_px, 0, (t.u0_px - c.cx_px) / c.fx_px, 0, 1.0 / c.fy_px,
                      (t.v0_px - c.cy_px) / c.fy_px, 0, 0, 1}};
    struct mat3 rk = mat3_mul(&world_from_cam.r, &k);
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 3; column++)
            t.m.m[4 * row + column] = rk.m[3 * row + column];
    t.m.m[15] = 1.0;
    t.origin_m = world_from_cam.t_m;
    return t;
}
