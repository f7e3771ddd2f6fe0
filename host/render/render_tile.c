#include "render/render_tile.h"

#include <float.h>
#include <math.h>

static double det3(const double *m) {
    return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
           m[2] * (m[4] * m[9] - m[5] * m[8]);
}

struct render_projection render_tile_project(const struct raster_view *view,
                                             const struct tile *tile) {
    struct render_projection out;
    const struct mat3 *r = &view->cam_from_world_r;
    struct vec3 t = mat3_mulv(r, vec3_sub(tile->origin_m, view->eye_m));
    bool pinhole = view->projection == RASTER_PINHOLE;
    double depth_range_m = view->far_m - view->near_m;
    const double *m = tile->m.m;
    for (int j = 0; j < 4; j++) {
        double w = m[12 + j];
        struct vec3 p = mat3_mulv(r, vec3_make(m[j], m[4 + j], m[8 + j]));
        p = vec3_madd(p, t, w);
        double along = pinhole ? p.z : w;
        out.c[j] = view->fx * p.x + view->cx_px * along;
        out.c[4 + j] = view->fy * p.y + view->cy_px * along;
        out.c[8 + j] = pinhole ? w : (view->far_m * w - p.z) / depth_range_m;
        out.c[12 + j] = along;
    }
    out.lin_px = sqrt(view->fx * view->fy * fabs(det3(m)));
    return out;
}

double render_tile_radius_px(const struct raster_view *view, const struct tile *tile,
                             const struct raster_options *options) {
    double magnification = view->fx * view->fy * fabs(det3(tile->m.m));
    return options->radius_k * (options->radius == RASTER_RADIUS_AREA ? sqrt(0.5 * magnification)
                                                                      : cbrt(0.5 * magnification));
}

/* The largest value of a linear form over (u, v, 1, delta) in the bounds. */
static double form_max(const double row[4], const struct render_bounds *b) {
    double sum = row[2];
    sum += row[0] > 0 ? row[0] * b->u_hi : 0.0;
    sum += row[1] > 0 ? row[1] * b->v_hi : 0.0;
    sum += row[3] > 0 ? row[3] * b->d_hi : row[3] * b->d_lo;
    return sum;
}

/* Is sign * (pixel - edge) + margin < 0 everywhere? */
static bool outside(const double c[16], int row, double sign, double edge_px, double margin_px,
                    double grow_px, const struct render_bounds *b) {
    double form[4];
    for (int j = 0; j < 4; j++)
        form[j] = sign * (c[4 * row + j] - edge_px * c[12 + j]) + margin_px * c[12 + j];
    form[2] += grow_px;
    return form_max(form, b) < 0.0;
}

struct render_extent render_tile_extent(const struct raster_view *view,
                                        const struct render_projection *projection,
                                        const struct render_bounds *bounds, double margin_px) {
    struct render_extent out = {false, 0.0, 0.0};
    struct render_bounds b = *bounds;
    b.d_lo = fmax(b.d_lo, 0.0);
    b.d_hi = fmin(b.d_hi, (double)FLT_MAX);
    if (!(b.d_lo <= b.d_hi))
        return out;
    const double *c = projection->c;
    double w_last = view->width_px - 1.0, h_last = view->height_px - 1.0;
    double nearest = form_max(c + 12, &b), grow = projection->lin_px;
    if (!(nearest > 0.0) || outside(c, 0, 1.0, 0.0, margin_px, grow, &b) ||
        outside(c, 0, -1.0, w_last, margin_px, grow, &b) ||
        outside(c, 1, 1.0, 0.0, margin_px, grow, &b) ||
        outside(c, 1, -1.0, h_last, margin_px, grow, &b))
        return out;
    double behind[4] = {-c[12], -c[13], -c[14], -c[15]};
    double w_min = -form_max(behind, &b);
    out.visible = true;
    out.sample_px = w_min > 0.0 ? projection->lin_px / w_min : (double)INFINITY;
    out.sample_min_px = projection->lin_px / nearest;
    return out;
}
