#include "import/scan_photo.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;

enum { FACE_MAX_PX = 4096, FACE_MIN_PX = 16 };

#define SINGLE_HALF_ANGLE_RAD (40.0 * 3.14159265358979323846 / 180.0)
#define SLOPE_LIMIT_RAD       (60.0 * 3.14159265358979323846 / 180.0)

static bool has_direction(const struct polar_sample *s) {
    return !isnan(s->azimuth_rad);
}

/* Focal length at which neighbours are a pixel apart in the middle of the picture. */
static enum st focal_px(const struct sample_grid *grid, double *out_f_px) {
    struct sample_spacing spacing;
    enum st st = sample_grid_spacing(grid, &spacing);
    if (st)
        return st;
    const double step_rad = fmin(spacing.along_row_rad, spacing.along_column_rad);
    *out_f_px = step_rad > 0.0 ? 1.0 / tan(fmin(step_rad, 0.25 * pi)) : 1.0;
    return ST_OK;
}

/* cam z along `forward`, x level, y down; straight up and down x is the station's x. */
static struct mat3 face_rotation(struct vec3 forward) {
    const struct vec3 z = vec3_unit(forward);
    struct vec3 x = vec3_cross(z, vec3_make(0, 0, 1));
    x = vec3_norm(x) > 1e-6 ? vec3_unit(x) : vec3_make(1, 0, 0);
    const struct vec3 y = vec3_cross(z, x);
    const struct mat3 r = {{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}};
    return r;
}

/* One pinhole around all samples. */
static void fit_single(const struct sample_grid *grid, struct vec3 forward, double f_px,
                       struct scan_photo_face *face) {
    memset(face, 0, sizeof *face);
    memcpy(face->name, "front", 6);
    face->station_from_cam = face_rotation(forward);
    double x_low = INFINITY, x_high = -INFINITY, y_low = INFINITY, y_high = -INFINITY;
    for (size_t i = 0; i < (size_t)grid->rows * (size_t)grid->columns; i++) {
        if (!has_direction(grid->samples + i))
            continue;
        const struct vec3 d =
            mat3_tmulv(&face->station_from_cam, sample_direction(grid->samples + i));
        x_low = fmin(x_low, d.x / d.z);
        x_high = fmax(x_high, d.x / d.z);
        y_low = fmin(y_low, d.y / d.z);
        y_high = fmax(y_high, d.y / d.z);
    }
    const double side = fmax(x_high - x_low, y_high - y_low);
    if (f_px * side > FACE_MAX_PX - 3)
        f_px = (FACE_MAX_PX - 3) / side;
    face->camera.fx_px = face->camera.fy_px = f_px;
    face->camera.cx_px = 1.0 - f_px * x_low;
    face->camera.cy_px = 1.0 - f_px * y_low;
    face->camera.width_px = (int32_t)ceil(f_px * (x_high - x_low)) + 3;
    face->camera.height_px = (int32_t)ceil(f_px * (y_high - y_low)) + 3;
}

static void fit_cube(const struct sample_grid *grid, double f_px, struct scan_photo_face *faces,
                     int *out_count) {
    static const struct {
        const char *name;
        struct vec3 forward;
    } sides[SCAN_PHOTO_FACES_MAX] = {{"x+", {1, 0, 0}},  {"y+", {0, 1, 0}}, {"x-", {-1, 0, 0}},
                                     {"y-", {0, -1, 0}}, {"z+", {0, 0, 1}}, {"z-", {0, 0, -1}}};
    bool used[SCAN_PHOTO_FACES_MAX] = {false};
    for (size_t i = 0; i < (size_t)grid->rows * (size_t)grid->columns; i++) {
        if (!has_direction(grid->samples + i) || !(grid->samples[i].range_m > 0.0f))
            continue;
        int best = 0;
        const struct vec3 d = sample_direction(grid->samples + i);
        for (int k = 1; k < SCAN_PHOTO_FACES_MAX; k++)
            if (vec3_dot(d, sides[k].forward) > vec3_dot(d, sides[best].forward))
                best = k;
        used[best] = true;
    }
    double half_px = fmin(fmax(ceil(f_px), FACE_MIN_PX / 2), FACE_MAX_PX / 2 - 1);
    *out_count = 0;
    for (int k = 0; k < SCAN_PHOTO_FACES_MAX; k++) {
        if (!used[k])
            continue;
        struct scan_photo_face *face = &faces[(*out_count)++];
        memset(face, 0, sizeof *face);
        memcpy(face->name, sides[k].name, 3);
        face->station_from_cam = face_rotation(sides[k].forward);
        const int32_t side_px = 2 * (int32_t)half_px + 2;
        face->camera.width_px = face->camera.height_px = side_px;
        face->camera.fx_px = face->camera.fy_px = half_px;
        face->camera.cx_px = face->camera.cy_px = 0.5 * (side_px - 1);
    }
}

enum st scan_photo_faces(const struct sample_grid *grid,
                         struct scan_photo_face out_faces[SCAN_PHOTO_FACES_MAX], int *out_count,
                         struct errctx *err) {
    const size_t places = (size_t)grid->rows * (size_t)grid->columns;
    struct vec3 sum = {0, 0, 0};
    size_t n = 0;
    for (size_t i = 0; i < places; i++)
        if (has_direction(grid->samples + i)) {
            sum = vec3_add(sum, sample_direction(grid->samples + i));
            n++;
        }
    if (n == 0)
        return errctx_set(err, ST_INVALID, "there is no sample to make a photograph of");
    double f_px = 0, least = vec3_norm(sum) > 1e-9 * (double)n ? 1.0 : -1.0;
    const struct vec3 mean = vec3_unit(sum);
    for (size_t i = 0; least > 0.0 && i < places; i++)
        if (has_direction(grid->samples + i))
            least = fmin(least, vec3_dot(mean, sample_direction(grid->samples + i)));
    enum st st = focal_px(grid, &f_px);
    if (st)
        return errctx_set(err, st, "no memory for the spacing of %zu samples", n);
    if (least >= cos(SINGLE_HALF_ANGLE_RAD)) {
        fit_single(grid, mean, f_px, &out_faces[0]);
        *out_count = 1;
    } else {
        fit_cube(grid, f_px, out_faces, out_count);
    }
    return ST_OK;
}

static void write_confidence(const struct scan_photo_face *face, double range_sigma_m,
                             struct photo *photo) {
    for (int32_t v = 0; v < face->camera.height_px; v++)
        for (int32_t u = 0; u < face->camera.width_px; u++) {
            const size_t i = (size_t)v * (size_t)face->camera.width_px + (size_t)u;
            const double delta = (double)photo->disparity_per_m[i];
            const double ray = vec3_norm(camera_pinhole_ray(&face->camera, u, v));
            /* range = ray / delta, so d(delta) = delta / range d(range) = delta^2 / ray d(range) */
            photo->confidence[i] =
                isnan(delta) ? 0 : photo_confidence_from_sigma(range_sigma_m * delta * delta / ray);
        }
}

enum st scan_photo_draw(const struct sample_grid *grid, struct vec3 origin_m,
                        const struct scan_photo_face *face,
                        const struct scan_photo_options *options, struct photo *out_photo,
                        struct errctx *err) {
    struct photo photo = {0};
    struct sample_shade_scale scale;
    int32_t *sample = NULL;
    enum st st = photo_create(&face->camera, &photo, err);
    if (st)
        return st;
    sample =
        malloc((size_t)face->camera.width_px * (size_t)face->camera.height_px * sizeof *sample);
    st = sample ? sample_shade_auto_scale(grid, &scale) : ST_NOMEM;
    if (st) {
        st = errctx_set(err, st, "no memory for a photograph");
        goto out;
    }
    photo.station_from_cam.r = face->station_from_cam;
    photo.station_from_cam.t_m = origin_m;
    const struct sample_view view = {.kind = SAMPLE_VIEW_PINHOLE,
                                     .width_px = face->camera.width_px,
                                     .height_px = face->camera.height_px,
                                     .camera = face->camera,
                                     .station_from_cam = face->station_from_cam};
    const struct sample_draw_options draw = {.range_sigma_m = options->range_sigma_m,
                                             .slope_limit_rad = SLOPE_LIMIT_RAD};
    struct sample_picture picture = {photo.disparity_per_m, photo.flags, sample};
    st = sample_grid_draw(grid, &view, &draw, &picture, err);
    if (st)
        goto out;
    sample_shade(grid, &view, &picture, &scale, options->style, &options->world_from_station,
                 photo.rgb);
    write_confidence(face, options->range_sigma_m, &photo);
out:
    free(sample);
    if (st)
        photo_destroy(&photo);
    else
        *out_photo = photo;
    return st;
}
