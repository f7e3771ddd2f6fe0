#include "tests/support/view_fake.h"

#include "raster/raster.h"

#include <stdlib.h>
#include <string.h>

static const float wall_per_m = 0.25f;
static const double hfov_rad = 1.5707963;

static struct pose looking_along_x(void) {
    struct pose pose;
    if (pose_look_at(vec3_make(0, 0, 1.5), vec3_make(1, 0, 1.5), vec3_make(0, 0, 1), &pose))
        abort();
    return pose;
}

void view_fake_make(struct view_fake *f, int32_t photo_count, int32_t width_px) {
    memset(f, 0, sizeof *f);
    f->damaged = -1;
    f->index.photos = f->photos;
    f->index.photo_count = photo_count;
    for (int32_t p = 0; p < photo_count; p++) {
        struct tile_pack_photo *photo = &f->photos[p];
        photo->camera = camera_pinhole(width_px, width_px, hfov_rad);
        photo->station_from_cam = looking_along_x();
        photo->world_from_station = pose_identity();
        photo->level_count = tile_pack_level_count(&photo->camera);
        for (int32_t l = 0; l < photo->level_count; l++) {
            int32_t nx, ny;
            tile_pack_tiles(&photo->camera, l, &nx, &ny);
            photo->first_node[l] = f->index.node_count;
            f->index.node_count += (int64_t)nx * ny;
        }
    }
    f->index.nodes = calloc((size_t)f->index.node_count + 1, sizeof *f->index.nodes);
    if (!f->index.nodes)
        abort();
    for (int64_t k = 0; k < f->index.node_count; k++) {
        struct tile_pack_node *node = &f->index.nodes[k];
        node->kind = TILE_PACK_SAMPLED;
        node->disparity_min_per_m = node->disparity_max_per_m = wall_per_m;
        node->valid_count = PHOTO_TILE_PX * PHOTO_TILE_PX;
    }
}

void view_fake_fini(struct view_fake *fake) {
    free(fake->index.nodes);
}

struct view_fake_place view_fake_place_of(const struct view_fake *f, int64_t node) {
    struct view_fake_place at = {f->index.photo_count - 1, 0, 0, 0};
    while (at.photo > 0 && f->photos[at.photo].first_node[0] > node)
        at.photo--;
    const struct tile_pack_photo *photo = &f->photos[at.photo];
    while (at.level + 1 < photo->level_count && photo->first_node[at.level + 1] <= node)
        at.level++;
    int32_t nx, ny;
    tile_pack_tiles(&photo->camera, at.level, &nx, &ny);
    at.i = (int32_t)((node - photo->first_node[at.level]) % nx);
    at.j = (int32_t)((node - photo->first_node[at.level]) / nx);
    return at;
}

static enum st fake_read(const void *self, int64_t node, struct tile_samples *out,
                         struct errctx *err) {
    /* A test's own counter behind a const interface. */
    union {
        const void *in;
        struct view_fake *out;
    } fake = {.in = self};
    struct view_fake *f = fake.out;
    f->reads++;
    if (node == f->damaged)
        return errctx_set(err, ST_DAMAGED, "tile %lld is damaged", (long long)node);
    struct view_fake_place at = view_fake_place_of(f, node);
    struct camera camera = tile_pack_camera(&f->photos[at.photo].camera, at.level);
    int32_t w = camera.width_px - at.i * PHOTO_TILE_PX, h = camera.height_px - at.j * PHOTO_TILE_PX;
    out->width = w < TILE_CODE_SIDE ? w : TILE_CODE_SIDE;
    out->height = h < TILE_CODE_SIDE ? h : TILE_CODE_SIDE;
    for (int32_t k = 0; k < out->width * out->height; k++) {
        out->disparity_per_m[k] = wall_per_m;
        out->flags[k] = 0;
        out->confidence[k] = photo_confidence_from_sigma(1e-4);
        memset(out->rgb + (ptrdiff_t)3 * k, 40 * (at.level + 1), 3);
    }
    return ST_OK;
}

struct tile_source view_fake_source(struct view_fake *fake) {
    struct tile_source source = {.index = &fake->index, .read = fake_read, .self = fake};
    return source;
}

struct raster_view view_fake_view(const struct view_fake *fake, int32_t width_px) {
    struct camera camera = camera_pinhole(width_px, width_px, hfov_rad);
    struct pose pose = looking_along_x();
    (void)fake;
    struct raster_view view = raster_view_pinhole(&camera, &pose);
    view.near_m = 0.001;
    return view;
}
