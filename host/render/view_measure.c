#include "render/view_measure.h"

#include <math.h>
#include <stdlib.h>

static const double normal_95 = 1.959963985; /* half of the 95 % interval in sigmas */
static const double outlier_sigmas = 4.0;    /* farther from the plane: another surface */
enum { REACH_PX = 3, TERMS = 3 };

/* ---- which sample ---- */

struct hit {
    const struct tile *tile;
    uint32_t input;
    int32_t u, v;
    double depth;
};

static enum st draw_pixel(const struct render_item *items, size_t count,
                          const struct raster_view *view, double x_px, double y_px, struct hit *out,
                          struct errctx *err) {
    struct tile *tiles = malloc((count + 1) * sizeof *tiles);
    if (!tiles)
        return errctx_set(err, ST_NOMEM, "no memory for %zu tiles", count);
    for (size_t i = 0; i < count; i++)
        tiles[i] = *items[i].tile;
    struct raster_view one = *view;
    one.width_px = one.height_px = 1;
    one.cx_px -= x_px;
    one.cy_px -= y_px;
    struct raster_options options = raster_options_default();
    options.primitive = RASTER_MESH;
    options.threads = 1;
    uint64_t item = RASTER_NO_ITEM;
    float depth = 0;
    struct raster_input input = {.tiles = tiles, .tile_count = count};
    struct raster_target target = {.width_px = 1, .height_px = 1, .depth = &depth, .item = &item};
    struct raster_scratch scratch = {0};
    enum st st = raster_draw(&input, 1, &one, &options, &target, &scratch, NULL, err);
    raster_scratch_fini(&scratch);
    free(tiles);
    if (st)
        return st;
    if (item == RASTER_NO_ITEM)
        return errctx_set(err, ST_NOT_FOUND, "nothing was measured there");
    const struct render_item *at = &items[raster_item_tile(item)];
    *out = (struct hit){at->tile, at->input, (int32_t)raster_item_u(item),
                        (int32_t)raster_item_v(item), (double)depth};
    return ST_OK;
}

/* ---- the plane ---- */

struct fit {
    double c[TERMS], cov[TERMS * TERMS];
    double u0, v0; /* the terms are (u - u0, v - v0, 1) */
    int32_t samples;
    double chi2, var_mean; /* of one sample, the mean by weight */
};

static bool invert3(const double a[9], double out[9]) {
    struct mat3 m;
    for (int i = 0; i < 9; i++)
        m.m[i] = a[i];
    double det = mat3_det(&m);
    if (!(fabs(det) > 0.0) || !isfinite(det))
        return false;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int p = (j + 1) % 3, q = (j + 2) % 3, r = (i + 1) % 3, s = (i + 2) % 3;
            out[3 * i + j] = (a[3 * p + r] * a[3 * q + s] - a[3 * p + s] * a[3 * q + r]) / det;
        }
    return true;
}

/* One pass of weighted least squares over the samples within `limit` sigmas of `from` (NULL: all
 * without a skin between). */
static bool fit_pass(const struct hit *hit, int32_t reach, const struct fit *from,
                     struct fit *out) {
    const struct tile *t = hit->tile;
    double a[9] = {0}, b[3] = {0}, sum_squares = 0, weights = 0;
    *out = (struct fit){.u0 = hit->u, .v0 = hit->v};
    for (int32_t v = hit->v - reach; v <= hit->v + reach; v++)
        for (int32_t u = hit->u - reach; u <= hit->u + reach; u++) {
            if (u < 0 || v < 0 || u > t->cells_x || v > t->cells_y)
                continue;
            ptrdiff_t at = (ptrdiff_t)v * t->stride_px + u;
            double d = (double)t->disparity_per_m[at];
            double sigma = photo_sigma_from_confidence(t->confidence[at]);
            if (!(d > 0.0) || t->flags[at] & (PHOTO_DROPPED | PHOTO_MIXED | PHOTO_SILHOUETTE) ||
                !(sigma > 0.0))
                continue;
            double q[3] = {u - out->u0, v - out->v0, 1.0};
            double expected = from ? from->c[0] * q[0] + from->c[1] * q[1] + from->c[2] : d;
            double residual = (d - expected) / sigma;
            double spread = from ? fmax(1.0, sqrt(from->chi2)) : 1.0;
            if (fabs(residual) > outlier_sigmas * spread)
                continue;
            sum_squares += residual * residual;
            for (int i = 0; i < 3; i++) {
                b[i] += q[i] * d / (sigma * sigma);
                for (int j = 0; j < 3; j++)
                    a[3 * i + j] += q[i] * q[j] / (sigma * sigma);
            }
            weights += 1.0 / (sigma * sigma);
            out->samples++;
        }
    if (out->samples <= TERMS || !invert3(a, out->cov))
        return false;
    for (int i = 0; i < 3; i++)
        out->c[i] =
            out->cov[3 * i] * b[0] + out->cov[3 * i + 1] * b[1] + out->cov[3 * i + 2] * b[2];
    out->chi2 = sum_squares / (out->samples - TERMS);
    out->var_mean = out->samples / weights;
    return true;
}

/* Samples that lie closer to their plane than their sigmas say have errors in common: a bias of
 * the sensor, neighbours made of the same echoes, a tile coded as a plane. What the residuals do
 * not show does not average out; it stays with the point as a whole. */
static void share_out(struct fit *fit) {
    double own = fmin(fit->chi2, 1.0);
    for (int i = 0; i < 9; i++)
        fit->cov[i] *= own;
    fit->cov[8] += (1.0 - own) * fit->var_mean;
}

/* The largest neighbourhood that is a plane within its noise: residuals beyond what chance allows
 * say that the surface bends or ends there, and a plane through it would be sure of the wrong
 * place. */
static bool fit_plane(const struct hit *hit, struct fit *out) {
    for (int32_t reach = REACH_PX; reach > 0; reach--) {
        struct fit first, second;
        if (!fit_pass(hit, reach, NULL, &first))
            continue;
        first.chi2 = fmin(first.chi2, 1.0);
        if (!fit_pass(hit, reach, &first, &second) || !fit_pass(hit, reach, &second, out))
            continue;
        int32_t window = (2 * reach + 1) * (2 * reach + 1);
        if (out->chi2 > 1.0 || 2 * out->samples < window)
            continue;
        share_out(out);
        return true;
    }
    return false;
}

/* ---- ray and plane ---- */

struct ray {
    struct vec3 from_m, along;
};

static struct ray pixel_ray(const struct raster_view *view, double x_px, double y_px) {
    double x = (x_px - view->cx_px) / view->fx, y = (y_px - view->cy_px) / view->fy;
    struct ray ray;
    if (view->projection == RASTER_PINHOLE) {
        ray.from_m = view->eye_m;
        ray.along = vec3_unit(mat3_tmulv(&view->cam_from_world_r, vec3_make(x, y, 1.0)));
    } else {
        ray.from_m =
            vec3_add(view->eye_m, mat3_tmulv(&view->cam_from_world_r, vec3_make(x, y, 0.0)));
        ray.along = mat3_tmulv(&view->cam_from_world_r, vec3_make(0, 0, 1));
    }
    return ray;
}

/* The depth that was drawn, as a distance along the ray. */
static double drawn_distance_m(const struct raster_view *view, const struct ray *ray,
                               double depth) {
    struct vec3 z = mat3_tmulv(&view->cam_from_world_r, vec3_make(0, 0, 1));
    double along_z = view->projection == RASTER_PINHOLE
                         ? 1.0 / depth
                         : view->far_m - depth * (view->far_m - view->near_m);
    return along_z / vec3_dot(z, ray->along);
}

static void meet(const struct fit *fit, const struct hit *hit, const struct ray *ray,
                 double drawn_m, struct view_point *out) {
    const double *m = hit->tile->m.m;
    double rows[9] = {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]}, inv[9];
    struct mat3 y_from_world;
    if (!invert3(rows, inv))
        return;
    for (int i = 0; i < 9; i++)
        y_from_world.m[i] = inv[i];
    struct vec3 e = mat3_mulv(&y_from_world, vec3_sub(ray->from_m, hit->tile->origin_m));
    struct vec3 d = mat3_mulv(&y_from_world, ray->along);
    /* terms are (u - u0, v - v0, 1): the same for y, with the last row as the scale */
    struct vec3 es = vec3_make(e.x - fit->u0 * e.z, e.y - fit->v0 * e.z, e.z);
    struct vec3 ds = vec3_make(d.x - fit->u0 * d.z, d.y - fit->v0 * d.z, d.z);
    struct vec3 c = vec3_make(fit->c[0], fit->c[1], fit->c[2]);
    double slope = vec3_dot(c, ds), t = (1.0 - vec3_dot(c, es)) / slope;
    struct vec3 y = vec3_madd(es, ds, t);
    const double *s = fit->cov;
    double var = y.x * (s[0] * y.x + s[1] * y.y + s[2] * y.z) +
                 y.y * (s[3] * y.x + s[4] * y.y + s[5] * y.z) +
                 y.z * (s[6] * y.x + s[7] * y.y + s[8] * y.z);
    double sigma = sqrt(var) / fabs(slope);
    if (!isfinite(t) || !isfinite(sigma) || fabs(t - drawn_m) > 0.1 * drawn_m)
        return; /* seen too obliquely for a plane to say more than the sample */
    out->p_m = vec3_madd(ray->from_m, ray->along, t);
    out->sigma_m = sigma;
    out->samples = fit->samples;
    out->spread_sigma = sqrt(fit->chi2);
}

enum st view_measure_pick(const struct render_item *items, size_t item_count,
                          const struct raster_view *view, double x_px, double y_px,
                          struct view_point *out_point, struct errctx *err) {
    struct hit hit = {0};
    enum st st = draw_pixel(items, item_count, view, x_px, y_px, &hit, err);
    if (st)
        return st;
    if (!(hit.depth > 0.0))
        return errctx_set(err, ST_NOT_FOUND, "that is the sky");
    struct ray ray = pixel_ray(view, x_px, y_px);
    double drawn_m = drawn_distance_m(view, &ray, hit.depth);
    struct view_point p = {.p_m = vec3_madd(ray.from_m, ray.along, drawn_m),
                           .along = ray.along,
                           .sigma_m = (double)NAN,
                           .samples = 1,
                           .input = hit.input};
    struct fit fit;
    if (fit_plane(&hit, &fit))
        meet(&fit, &hit, &ray, drawn_m, &p);
    if (isnan(p.sigma_m)) { /* the sample's own error stands for the place */
        ptrdiff_t at = (ptrdiff_t)hit.v * hit.tile->stride_px + hit.u;
        double delta = (double)hit.tile->disparity_per_m[at];
        double range_m = vec3_norm(vec3_sub(p.p_m, hit.tile->origin_m));
        p.sigma_m = photo_sigma_from_confidence(hit.tile->confidence[at]) / delta * range_m;
    }
    p.range_m = vec3_norm(vec3_sub(p.p_m, hit.tile->origin_m));
    *out_point = p;
    return ST_OK;
}

/* ---- what follows ---- */

double view_measure_half95(struct view_value value) {
    return normal_95 * value.sigma;
}

struct view_value view_measure_distance_m(const struct view_point *a, const struct view_point *b) {
    struct vec3 d = vec3_sub(b->p_m, a->p_m);
    struct view_value out = {vec3_norm(d), 0.0};
    struct vec3 e = out.value > 0.0 ? vec3_scale(d, 1.0 / out.value) : a->along;
    double sa = vec3_dot(e, a->along) * a->sigma_m, sb = vec3_dot(e, b->along) * b->sigma_m;
    out.sigma = sqrt(sa * sa + sb * sb);
    return out;
}

struct view_value view_measure_height_m(const struct view_point *a, const struct view_point *b) {
    double sa = a->along.z * a->sigma_m, sb = b->along.z * b->sigma_m;
    struct view_value out = {b->p_m.z - a->p_m.z, sqrt(sa * sa + sb * sb)};
    return out;
}

static double angle_at(struct vec3 a, struct vec3 b, struct vec3 c) {
    struct vec3 p = vec3_sub(a, b), q = vec3_sub(c, b);
    return atan2(vec3_norm(vec3_cross(p, q)), vec3_dot(p, q));
}

struct view_value view_measure_angle_rad(const struct view_point *a, const struct view_point *b,
                                         const struct view_point *c) {
    const struct view_point *points[3] = {a, b, c};
    double shortest =
        fmin(vec3_norm(vec3_sub(a->p_m, b->p_m)), vec3_norm(vec3_sub(c->p_m, b->p_m)));
    struct view_value out = {(double)NAN, (double)NAN};
    if (!(shortest > 0.0))
        return out;
    out.value = angle_at(a->p_m, b->p_m, c->p_m);
    double var = 0, step_m = 1e-4 * shortest; /* central differences: the angle is smooth */
    for (int i = 0; i < 3; i++) {
        struct vec3 lo[3] = {a->p_m, b->p_m, c->p_m}, hi[3] = {a->p_m, b->p_m, c->p_m};
        lo[i] = vec3_madd(lo[i], points[i]->along, -step_m);
        hi[i] = vec3_madd(hi[i], points[i]->along, step_m);
        double slope = (angle_at(hi[0], hi[1], hi[2]) - angle_at(lo[0], lo[1], lo[2])) / step_m / 2;
        var += slope * slope * points[i]->sigma_m * points[i]->sigma_m;
    }
    out.sigma = sqrt(var);
    return out;
}
