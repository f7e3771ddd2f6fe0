#include "import/photo_import.h"

#include "import/dequantise.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Defaults of the noise, one standard deviation; see the header and the manual of `scancart
 * import`. */
#define SIGMA_M_DEFAULT     1e-3
#define SIGMA_PER_M_DEFAULT 0.0015
#define SIGMA_PX_DEFAULT    0.25
/* sqrt(1/12): of an error uniform over one step. */
#define ROUNDING_SIGMA 0.28867513459481287
#define MILLIMETRES    1e-3
/* Neighbours in the map are one surface if their disparities bend by less than this share. */
#define SURFACE_BEND 0.05

static double or_default(double value, double usual) {
    return isnan(value) ? 0.0 : value != 0.0 ? value : usual;
}

struct maker {
    const struct photo_import *in;
    struct photo_import_map values; /* with the defaults filled in */
    struct image_f32 delta;         /* 1/Z in the image as it came, NaN unknown */
    struct image_f32 sigma;         /* of delta */
};

static enum st check_input(const struct photo_import *in, struct errctx *err) {
    const struct photo_import_map *v = &in->values;
    enum st st = camera_check(&in->camera, err);
    if (st)
        return errctx_prefix(err, st, "camera");
    if (in->rgb->channels != 3 || in->map->channels != 1)
        return errctx_set(err, ST_INVALID, "an RGB image and a map of one channel are wanted");
    if (in->rgb->width_px != in->map->width_px || in->rgb->height_px != in->map->height_px)
        return errctx_set(err, ST_INVALID, "the image is %d x %d pixels, the map %d x %d",
                          in->rgb->width_px, in->rgb->height_px, in->map->width_px,
                          in->map->height_px);
    if (in->camera.width_px != in->rgb->width_px || in->camera.height_px != in->rgb->height_px)
        return errctx_set(
            err, ST_INVALID, "the camera is for %d x %d pixels, the image has %d x %d",
            in->camera.width_px, in->camera.height_px, in->rgb->width_px, in->rgb->height_px);
    if (!isfinite(v->scale) || v->scale < 0.0 || !isfinite(v->offset) || !isfinite(v->baseline_m) ||
        v->baseline_m < 0.0 || !isfinite(v->step) || v->step < 0.0 || v->sigma_m < 0.0 ||
        v->sigma_per_m < 0.0 || v->sigma_px < 0.0)
        return errctx_set(err, ST_INVALID,
                          "scale, baseline, step and sigmas must be finite and not negative");
    if (v->dequantise && (v->kind != PHOTO_IMPORT_DISPARITY || !(v->step > 0.0)))
        return errctx_set(err, ST_INVALID,
                          "only a disparity map of a known step can be dequantised: depths are not "
                          "affine over a plane");
    return ST_OK;
}

static void fill_defaults(const struct photo_import_map *in, struct photo_import_map *out) {
    *out = *in;
    const bool disparity = in->kind == PHOTO_IMPORT_DISPARITY;
    out->scale = in->scale > 0.0 ? in->scale : disparity ? 1.0 : MILLIMETRES;
    out->sigma_m = or_default(in->sigma_m, SIGMA_M_DEFAULT);
    out->sigma_per_m =
        or_default(in->sigma_per_m, in->kind == PHOTO_IMPORT_DEPTH ? SIGMA_PER_M_DEFAULT : 0.0);
    out->sigma_px = or_default(in->sigma_px, SIGMA_PX_DEFAULT);
    if (!(out->baseline_m > 0.0))
        out->baseline_m = 1.0;
}

/* Stored value and its rounding sigma (stored units) to 1/Z and sigma(1/Z); NaN if unknown. */
static void to_delta(const struct maker *m, int32_t u, int32_t v, double stored,
                     double rounding_sigma, float *out_delta, float *out_sigma) {
    const struct photo_import_map *k = &m->values;
    const double d = stored * k->scale + k->offset;
    *out_delta = NAN;
    *out_sigma = NAN;
    if (!(d > 0.0) || !isfinite(d))
        return;
    double delta, sigma;
    if (k->kind == PHOTO_IMPORT_DISPARITY) {
        const double per_px = 1.0 / (m->in->camera.fx_px * k->baseline_m);
        delta = d * per_px;
        sigma = per_px * hypot(k->sigma_px, rounding_sigma * k->scale);
    } else {
        double ray = 1.0;
        if (k->kind == PHOTO_IMPORT_RANGE) {
            struct vec3 r;
            const struct vec2 q = {u, v};
            if (camera_unproject(&m->in->camera, q, &r, NULL))
                return;
            ray = vec3_norm(r);
        }
        delta = ray / d;
        /* d(ray / d) = ray / d^2 */
        sigma = ray / (d * d) *
                hypot(hypot(k->sigma_m, rounding_sigma * k->scale), k->sigma_per_m * d * d);
    }
    if (!isfinite((float)delta))
        return;
    *out_delta = (float)delta;
    *out_sigma = (float)sigma;
}

/* The map as it is stored, unknown values NaN; dequantised if asked for. */
static enum st clean_map(const struct maker *m, struct image_f32 *map, struct image_f32 *rounding,
                         struct errctx *err) {
    const struct image_f32 *in = m->in->map;
    for (int32_t v = 0; v < in->height_px; v++)
        for (int32_t u = 0; u < in->width_px; u++) {
            const float stored = *image_f32_at(in, u, v);
            const double d = (double)stored * m->values.scale + m->values.offset;
            const bool known = isfinite(stored) && d > 0.0 && (double)stored != m->values.unknown;
            *image_f32_at(map, u, v) = known ? stored : NAN;
            *image_f32_at(rounding, u, v) = known ? (float)(m->values.step * ROUNDING_SIGMA) : NAN;
        }
    if (!m->values.dequantise)
        return ST_OK;
    const struct dequantise_options options = {.step = (float)m->values.step};
    return dequantise(map, &options, map, rounding, err);
}

static enum st make_delta(struct maker *m, struct photo_import_result *result, struct errctx *err) {
    const int32_t w = m->in->map->width_px, h = m->in->map->height_px;
    struct image_f32 map = {0}, rounding = {0};
    enum st st = image_f32_create(&map, w, h, 1);
    if (!st)
        st = image_f32_create(&rounding, w, h, 1);
    if (!st)
        st = image_f32_create(&m->delta, w, h, 1);
    if (!st)
        st = image_f32_create(&m->sigma, w, h, 1);
    if (st)
        st = errctx_set(err, st, "no memory for a map of %d x %d pixels", w, h);
    else
        st = clean_map(m, &map, &rounding, err);
    double sum = 0;
    int64_t n = 0;
    for (int32_t v = 0; !st && v < h; v++)
        for (int32_t u = 0; u < w; u++) {
            const double r = (double)*image_f32_at(&rounding, u, v);
            to_delta(m, u, v, (double)*image_f32_at(&map, u, v), r, image_f32_at(&m->delta, u, v),
                     image_f32_at(&m->sigma, u, v));
            if (isfinite(*image_f32_at(&m->delta, u, v))) {
                sum += r * r * m->values.scale * m->values.scale;
                n++;
            }
        }
    image_f32_destroy(&map);
    image_f32_destroy(&rounding);
    if (!st && n == 0)
        return errctx_set(err, ST_INVALID,
                          "the map has no known value: is its scale or its 'unknown' right?");
    if (!st)
        result->rounding_sigma = sqrt(sum / (double)n);
    return st;
}

/* ---- one pixel of the photograph ---- */

static double cubic_weight(double t) { /* Catmull-Rom: Keys 1981, a = -1/2 */
    t = fabs(t);
    if (t < 1.0)
        return (1.5 * t - 2.5) * t * t + 1.0;
    return t < 2.0 ? ((-0.5 * t + 2.5) * t - 4.0) * t + 2.0 : 0.0;
}

static int32_t clamp_index(int32_t i, int32_t n) {
    return i < 0 ? 0 : i >= n ? n - 1 : i;
}

static void sample_colour(const struct image_u8 *im, struct vec2 q_px, uint8_t out_rgb[3]) {
    const int32_t u0 = (int32_t)floor(q_px.x), v0 = (int32_t)floor(q_px.y);
    double sum[3] = {0, 0, 0};
    for (int32_t v = v0 - 1; v <= v0 + 2; v++)
        for (int32_t u = u0 - 1; u <= u0 + 2; u++) {
            const double weight = cubic_weight(q_px.x - u) * cubic_weight(q_px.y - v);
            const uint8_t *px =
                image_u8_at(im, clamp_index(u, im->width_px), clamp_index(v, im->height_px));
            for (int c = 0; c < 3; c++)
                sum[c] += weight * px[c];
        }
    for (int c = 0; c < 3; c++)
        out_rgb[c] = (uint8_t)lround(fmin(255.0, fmax(0.0, sum[c])));
}

/* Bilinear where the four corners lie on one plane, else the nearest. The same weights for sigma.
 */
static void sample_delta(const struct maker *m, struct vec2 q_px, float *out_delta,
                         float *out_sigma) {
    const struct image_f32 *im = &m->delta;
    const int32_t w = im->width_px, h = im->height_px;
    const int32_t u_near = clamp_index((int32_t)lround(q_px.x), w);
    const int32_t v_near = clamp_index((int32_t)lround(q_px.y), h);
    *out_delta = *image_f32_at(im, u_near, v_near);
    *out_sigma = *image_f32_at(&m->sigma, u_near, v_near);
    const int32_t u0 = (int32_t)floor(q_px.x), v0 = (int32_t)floor(q_px.y);
    if (u0 < 0 || v0 < 0 || u0 + 1 >= w || v0 + 1 >= h)
        return;
    double d[4], s = 0;
    for (int i = 0; i < 4; i++) {
        d[i] = (double)*image_f32_at(im, u0 + i % 2, v0 + i / 2);
        s = fmax(s, (double)*image_f32_at(&m->sigma, u0 + i % 2, v0 + i / 2));
    }
    const double largest = fmax(fmax(d[0], d[1]), fmax(d[2], d[3]));
    const double smallest = fmin(fmin(d[0], d[1]), fmin(d[2], d[3]));
    const double bend = fabs(d[0] - d[1] - d[2] + d[3]);
    const double limit = 6.0 * s + SURFACE_BEND * largest; /* 3 sigmas of four values */
    if (isnan(d[0] + d[1] + d[2] + d[3]) || bend > limit || largest - smallest > 2.0 * limit)
        return;
    const double fu = q_px.x - u0, fv = q_px.y - v0;
    *out_delta =
        (float)((1 - fv) * ((1 - fu) * d[0] + fu * d[1]) + fv * ((1 - fu) * d[2] + fu * d[3]));
}

static void make_pixel(const struct maker *m, int32_t u, int32_t v, bool distorted,
                       struct photo *photo, struct photo_import_result *result) {
    const size_t i = (size_t)v * (size_t)photo->camera.width_px + (size_t)u;
    float delta = *image_f32_at(&m->delta, u, v), sigma = *image_f32_at(&m->sigma, u, v);
    if (distorted) {
        struct vec2 q;
        const struct vec3 ray = camera_pinhole_ray(&photo->camera, u, v);
        if (camera_project(&m->in->camera, ray, &q, NULL) || !(q.x >= -0.5 && q.y >= -0.5) ||
            !(q.x <= photo->camera.width_px - 0.5 && q.y <= photo->camera.height_px - 0.5)) {
            result->unseen_pixels++;
            return; /* photo_create() left it unseen */
        }
        sample_colour(m->in->rgb, q, photo->rgb + 3 * i);
        sample_delta(m, q, &delta, &sigma);
    } else {
        memcpy(photo->rgb + 3 * i, image_u8_at(m->in->rgb, u, v), 3);
    }
    photo->disparity_per_m[i] = delta;
    if (isnan(delta)) {
        photo->flags[i] = PHOTO_DROPPED;
        result->unknown_pixels++;
        return;
    }
    photo->confidence[i] = photo_confidence_from_sigma((double)sigma);
    result->known_pixels++;
    result->nearest_m = fmin(result->nearest_m, 1.0 / (double)delta);
    result->farthest_m = fmax(result->farthest_m, 1.0 / (double)delta);
}

enum st photo_import_make(const struct photo_import *in, struct photo *out_photo,
                          struct photo_import_result *out_result, struct errctx *err) {
    enum st st = check_input(in, err);
    if (st)
        return st;
    struct photo_import_result result = {.nearest_m = INFINITY, .farthest_m = 0.0};
    struct maker m = {.in = in};
    struct photo photo = {0};
    fill_defaults(&in->values, &m.values);
    result.relative = in->values.kind == PHOTO_IMPORT_DISPARITY && !(in->values.baseline_m > 0.0);
    result.undistorted = !camera_is_pinhole(&in->camera);
    struct camera pinhole = in->camera;
    pinhole.k1 = pinhole.k2 = pinhole.p1 = pinhole.p2 = pinhole.k3 = 0.0;
    st = make_delta(&m, &result, err);
    if (!st)
        st = photo_create(&pinhole, &photo, err);
    if (st)
        goto out;
    photo.station_from_cam = in->station_from_cam;
    for (int32_t v = 0; v < pinhole.height_px; v++)
        for (int32_t u = 0; u < pinhole.width_px; u++)
            make_pixel(&m, u, v, result.undistorted, &photo, &result);
    *out_photo = photo;
    if (out_result)
        *out_result = result;
out:
    image_f32_destroy(&m.delta);
    image_f32_destroy(&m.sigma);
    return st;
}
