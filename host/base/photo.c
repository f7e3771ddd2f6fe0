#include "base/photo.h"

#include "base/image.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Confidence scale: sigma = SIGMA_MIN * 2^(steps / STEPS_PER_OCTAVE), steps = 255 - c. */
#define SIGMA_MIN_PER_M  1e-6
#define STEPS_PER_OCTAVE 10.0

double photo_sigma_from_confidence(uint8_t confidence) {
    if (confidence == 0)
        return NAN;
    return SIGMA_MIN_PER_M * exp2((255 - confidence) / STEPS_PER_OCTAVE);
}

uint8_t photo_confidence_from_sigma(double sigma_per_m) {
    if (!(sigma_per_m > 0.0) || !isfinite(sigma_per_m))
        return 0;
    if (sigma_per_m > photo_sigma_from_confidence(1))
        return 0;
    /* A guess one step too sure, then down until it claims no more than is so: exact at every step.
     */
    double steps = ceil(STEPS_PER_OCTAVE * log2(sigma_per_m / SIGMA_MIN_PER_M)) - 1.0;
    int c = 255 - (int)fmax(0.0, steps);
    while (c > 1 && photo_sigma_from_confidence((uint8_t)c) < sigma_per_m)
        c--;
    return (uint8_t)c;
}

enum st photo_create(const struct camera *camera, struct photo *out_photo, struct errctx *err) {
    enum st st = camera_check(camera, err);
    if (st)
        return st;
    if (!camera_is_pinhole(camera))
        return errctx_set(err, ST_INVALID,
                          "a photograph needs a camera without distortion: undistort it first");
    int64_t count = (int64_t)camera->width_px * camera->height_px;
    if (count > IMAGE_MAX_PIXELS)
        return errctx_set(err, ST_NOMEM, "photograph of %dx%d pixels is above the bound of %lld",
                          (int)camera->width_px, (int)camera->height_px,
                          (long long)IMAGE_MAX_PIXELS);
    size_t n = (size_t)count;
    struct photo p = {.camera = *camera, .station_from_cam = pose_identity()};
    p.rgb = calloc(n, 3);
    p.disparity_per_m = malloc(n * sizeof *p.disparity_per_m);
    p.flags = calloc(n, 1);
    p.confidence = calloc(n, 1);
    if (!p.rgb || !p.disparity_per_m || !p.flags || !p.confidence) {
        photo_destroy(&p);
        return errctx_set(err, ST_NOMEM, "no memory for a photograph of %dx%d pixels",
                          (int)camera->width_px, (int)camera->height_px);
    }
    for (size_t i = 0; i < n; i++)
        p.disparity_per_m[i] = NAN;
    *out_photo = p;
    return ST_OK;
}

void photo_destroy(struct photo *photo) {
    if (!photo)
        return;
    free(photo->rgb);
    free(photo->disparity_per_m);
    free(photo->flags);
    free(photo->confidence);
    memset(photo, 0, sizeof *photo);
}

static int32_t tiles_along(int32_t side_px) {
    return side_px <= 0 ? 0 : (side_px - 1) / PHOTO_TILE_PX + 1;
}

size_t photo_tile_count(int32_t width_px, int32_t height_px) {
    return (size_t)tiles_along(width_px) * (size_t)tiles_along(height_px);
}

/* M = R E T relative to the camera's centre: X = R K^-1 [u0 + u, v0 + v, 1], w = delta. */
static struct mat4 tile_matrix(const struct camera *cam, const struct mat3 *world_from_cam,
                               int32_t u0_px, int32_t v0_px) {
    struct vec3 du = mat3_mulv(world_from_cam, vec3_make(1.0 / cam->fx_px, 0, 0));
    struct vec3 dv = mat3_mulv(world_from_cam, vec3_make(0, 1.0 / cam->fy_px, 0));
    struct vec3 at = mat3_mulv(world_from_cam, camera_pinhole_ray(cam, u0_px, v0_px));
    struct mat4 m = {{du.x, dv.x, at.x, 0, du.y, dv.y, at.y, 0, du.z, dv.z, at.z, 0, 0, 0, 0, 1}};
    return m;
}

/* Fills in the disparity bounds over the tile's cells and the count of owned valid samples. */
static void tile_bounds(struct tile *tile) {
    float low = INFINITY, high = -INFINITY;
    int32_t valid = 0;
    int32_t columns = tile->cells_x + 1, rows = tile->cells_y + 1;
    for (int32_t y = 0; y < rows; y++) {
        const float *row = tile->disparity_per_m + (ptrdiff_t)y * tile->stride_px;
        for (int32_t x = 0; x < columns; x++) {
            float d = row[x];
            if (isnan(d))
                continue;
            low = d < low ? d : low;
            high = d > high ? d : high;
            valid += x < tile->width_px && y < tile->height_px;
        }
    }
    tile->disparity_min_per_m = low;
    tile->disparity_max_per_m = high;
    tile->valid_count = valid;
}

static int32_t smaller(int32_t a, int32_t b) {
    return a < b ? a : b;
}

void photo_tiles(const struct photo *photo, const struct pose *world_from_station,
                 struct tile *out_tiles) {
    struct pose world_from_cam = photo->station_from_cam;
    if (world_from_station)
        world_from_cam = pose_compose(world_from_station, &photo->station_from_cam);
    int32_t w = photo->camera.width_px, h = photo->camera.height_px;
    struct tile *tile = out_tiles;
    for (int32_t v0 = 0; v0 < h; v0 += PHOTO_TILE_PX) {
        for (int32_t u0 = 0; u0 < w; u0 += PHOTO_TILE_PX, tile++) {
            size_t at = (size_t)v0 * (size_t)w + (size_t)u0;
            *tile = (struct tile){
                .rgb = photo->rgb + 3 * at,
                .disparity_per_m = photo->disparity_per_m + at,
                .flags = photo->flags + at,
                .confidence = photo->confidence + at,
                .stride_px = w,
                .u0_px = u0,
                .v0_px = v0,
                .width_px = smaller(PHOTO_TILE_PX, w - u0),
                .height_px = smaller(PHOTO_TILE_PX, h - v0),
                .cells_x = smaller(PHOTO_TILE_PX, w - 1 - u0),
                .cells_y = smaller(PHOTO_TILE_PX, h - 1 - v0),
                .m = tile_matrix(&photo->camera, &world_from_cam.r, u0, v0),
                .origin_m = world_from_cam.t_m,
            };
            tile_bounds(tile);
        }
    }
}
