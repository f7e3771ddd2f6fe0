#include "app/shot_view.h"

#include "app/app_photos.h"

#include <math.h>
#include <stdlib.h>

static const double rad = 3.14159265358979323846 / 180.0;

enum st shot_view_numbers(const char *text, size_t n, const char *what, double *out_values,
                          struct errctx *err) {
    const char *at = text;
    for (size_t i = 0; i < n; i++) {
        char *end = NULL;
        double value = strtod(at, &end);
        if (end == at || *end != (i + 1 < n ? ',' : '\0') || !isfinite(value))
            return errctx_set(err, ST_INVALID, "%s '%s' is not %zu numbers separated by commas",
                              what, text, n);
        out_values[i] = value;
        at = end + 1;
    }
    return ST_OK;
}

static enum st read_vec3(const char *text, const char *what, struct vec3 *out_v,
                         struct errctx *err) {
    double v[3];
    enum st st = shot_view_numbers(text, 3, what, v, err);
    if (!st)
        *out_v = vec3_make(v[0], v[1], v[2]);
    return st;
}

/* "1280x720"; "1280" keeps the shape that is. */
static enum st read_size(const char *text, int32_t *width_px, int32_t *height_px,
                         struct errctx *err) {
    char *end = NULL;
    long w = strtol(text, &end, 10), h = 0;
    if (end != text && *end == '\0' && w > 0)
        h = lround((double)*height_px * (double)w / (double)*width_px);
    else if (end != text && *end == 'x') {
        const char *second = end + 1;
        h = strtol(second, &end, 10);
        if (end == second || *end)
            h = 0;
    }
    if (w < 1 || h < 1 || w > RASTER_MAX_SIDE_PX || h > RASTER_MAX_SIDE_PX)
        return errctx_set(err, ST_INVALID,
                          "--size '%s' is not WIDTHxHEIGHT with sides from 1 to %d", text,
                          RASTER_MAX_SIDE_PX);
    *width_px = (int32_t)w;
    *height_px = (int32_t)h;
    return ST_OK;
}

/* Another number of pixels for the same horizontal field. Pixel (0,0) is a centre: the picture's
 * middle is at (size - 1) / 2. */
static void resize(struct camera *camera, int32_t width_px, int32_t height_px) {
    double scale = (double)width_px / camera->width_px;
    double from_x = 0.5 * (camera->width_px - 1), from_y = 0.5 * (camera->height_px - 1);
    camera->cx_px = 0.5 * (width_px - 1) + scale * (camera->cx_px - from_x);
    camera->cy_px = 0.5 * (height_px - 1) + scale * (camera->cy_px - from_y);
    camera->fx_px *= scale;
    camera->fy_px *= scale;
    camera->width_px = width_px;
    camera->height_px = height_px;
}

/* Turns the camera in its own frame: yaw about y (down), then pitch about x, then roll about z. */
static enum st turn(const char *words, struct pose *world_from_cam, struct errctx *err) {
    double a[3];
    enum st st = shot_view_numbers(words, 3, "--rotate", a, err);
    if (st)
        return st;
    struct mat3 yaw = so3_exp(vec3_make(0, a[0] * rad, 0));
    struct mat3 pitch = so3_exp(vec3_make(a[1] * rad, 0, 0));
    struct mat3 roll = so3_exp(vec3_make(0, 0, a[2] * rad));
    struct mat3 r = mat3_mul(&yaw, &pitch);
    r = mat3_mul(&r, &roll);
    world_from_cam->r = mat3_mul(&world_from_cam->r, &r);
    return ST_OK;
}

static enum st look(const struct shot_view_words *words, struct pose *world_from_cam,
                    struct errctx *err) {
    struct vec3 eye, target, up = vec3_make(0, 0, 1);
    enum st st = read_vec3(words->eye, "--eye", &eye, err);
    if (!st)
        st = read_vec3(words->target, "--target", &target, err);
    if (!st && words->up)
        st = read_vec3(words->up, "--up", &up, err);
    if (st)
        return st;
    if (pose_look_at(eye, target, up, world_from_cam))
        return errctx_set(err, ST_INVALID,
                          "--eye and --target are the same place, or --up lies along the view");
    return ST_OK;
}

static enum st check_words(const struct shot_view_words *words, struct errctx *err) {
    if (!words->eye != !words->target)
        return errctx_set(err, ST_INVALID, "--eye and --target belong together");
    if (words->eye && (words->offset || words->rotate))
        return errctx_set(err, ST_INVALID, "--eye does not go with --offset and --rotate");
    if (words->fov_deg < 0.0 || words->fov_deg >= 175.0)
        return errctx_set(err, ST_INVALID, "--fov must be below 175 degrees");
    if (!(words->width_m >= 0.0) || !(words->near_m >= 0.0))
        return errctx_set(err, ST_INVALID, "--parallel and --near are metres, not below 0");
    return ST_OK;
}

/* A parallel view takes in everything in front of the eye up to so many times its width. */
static const double parallel_depth_widths = 100.0;

enum st shot_view_make(struct site *site, const struct shot_view_words *words,
                       struct raster_view *out_view, struct errctx *err) {
    enum st st = check_words(words, err);
    if (st)
        return st;
    struct app_photo_view start;
    if (words->eye && !words->photo) {
        start.camera = camera_pinhole(1280, 720, 60.0 * rad);
        start.world_from_cam = pose_identity();
    } else {
        st = app_photos_view(site, words->photo, &start, err);
    }
    int32_t w = 0, h = 0;
    if (!st) {
        w = start.camera.width_px;
        h = start.camera.height_px;
        st = words->size ? read_size(words->size, &w, &h, err) : ST_OK;
    }
    if (!st && words->eye)
        st = look(words, &start.world_from_cam, err);
    struct vec3 offset = {0, 0, 0};
    if (!st && words->offset)
        st = read_vec3(words->offset, "--offset", &offset, err);
    if (st)
        return st;
    start.world_from_cam.t_m = pose_apply(&start.world_from_cam, offset);
    st = words->rotate ? turn(words->rotate, &start.world_from_cam, err) : ST_OK;
    if (st)
        return st;
    if (words->fov_deg > 0.0)
        start.camera = camera_pinhole(w, h, words->fov_deg * rad);
    else
        resize(&start.camera, w, h);
    *out_view =
        words->width_m > 0.0
            ? raster_view_orthographic(w, h, w / words->width_m, words->near_m,
                                       words->near_m + parallel_depth_widths * words->width_m,
                                       &start.world_from_cam)
            : raster_view_pinhole(&start.camera, &start.world_from_cam);
    out_view->near_m = words->near_m;
    return ST_OK;
}
