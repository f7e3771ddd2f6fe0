#include "render/render_plane.h"

#include "render/render_tile.h"

#include <float.h>
#include <math.h>
#include <string.h>

float render_plane_push(const struct raster_options *options, float gain, uint8_t confidence,
                        float inv_w, float lin_px) {
    float sigma = confidence ? (float)photo_sigma_from_confidence(confidence)
                             : (float)options->sigma_unknown_per_m;
    float inv2 = inv_w * inv_w, area = lin_px * lin_px * inv2;
    /* octaves above 1/16 px, piecewise linear between powers of two, as the rasteriser counts */
    int32_t bits;
    memcpy(&bits, &area, sizeof bits);
    float octaves = (float)(bits - 0x3f800000) * (1.0f / 8388608.0f) + 4.0f;
    octaves = octaves > 0.0f ? octaves : 0.0f;
    octaves = octaves < 12.0f ? octaves : 12.0f;
    return gain * sigma * inv2 * octaves;
}

struct quad {
    double h[9];     /* [x y w] = h [u v 1] */
    double inv[9];   /* [u v 1] ~ inv [x y 1] */
    double depth[4]; /* depth d over (u, v, 1): d = depth . */
    double u_hi, v_hi;
    int32_t x_lo, x_hi, y_lo, y_hi;
};

static bool quad_invert(struct quad *q) {
    const double *a = q->h;
    double c0 = a[4] * a[8] - a[5] * a[7], c1 = a[5] * a[6] - a[3] * a[8];
    double c2 = a[3] * a[7] - a[4] * a[6];
    double det = a[0] * c0 + a[1] * c1 + a[2] * c2;
    if (!isfinite(det) || det == 0.0)
        return false;
    double inv[9] = {c0, a[2] * a[7] - a[1] * a[8], a[1] * a[5] - a[2] * a[4],
                     c1, a[0] * a[8] - a[2] * a[6], a[2] * a[3] - a[0] * a[5],
                     c2, a[1] * a[6] - a[0] * a[7], a[0] * a[4] - a[1] * a[3]};
    for (int i = 0; i < 9; i++)
        q->inv[i] = inv[i] / det;
    return true;
}

/* Bounding box on screen; the whole picture if a corner lies behind the eye. */
static void quad_box(struct quad *q, const struct raster_view *view) {
    double x_lo = INFINITY, x_hi = -INFINITY, y_lo = INFINITY, y_hi = -INFINITY;
    for (int i = 0; i < 4; i++) {
        double u = i & 1 ? q->u_hi : 0.0, v = i & 2 ? q->v_hi : 0.0;
        double x = q->h[0] * u + q->h[1] * v + q->h[2], y = q->h[3] * u + q->h[4] * v + q->h[5];
        double w = q->h[6] * u + q->h[7] * v + q->h[8];
        if (!(w > 0.0)) {
            x_lo = y_lo = -INFINITY;
            x_hi = y_hi = INFINITY;
            break;
        }
        x_lo = fmin(x_lo, x / w);
        x_hi = fmax(x_hi, x / w);
        y_lo = fmin(y_lo, y / w);
        y_hi = fmax(y_hi, y / w);
    }
    q->x_lo = (int32_t)fmin(fmax(floor(x_lo), 0.0), view->width_px);
    q->x_hi = (int32_t)fmax(fmin(ceil(x_hi), view->width_px - 1.0), -1.0);
    q->y_lo = (int32_t)fmin(fmax(floor(y_lo), 0.0), view->height_px);
    q->y_hi = (int32_t)fmax(fmin(ceil(y_hi), view->height_px - 1.0), -1.0);
}

static bool quad_make(const struct render_item *item, const struct render_projection *p,
                      const struct raster_view *view, struct quad *q) {
    const double *c = p->c;
    double c0 = (double)item->plane[0], cu = (double)item->plane[1], cv = (double)item->plane[2];
    static const int rows[3] = {0, 1, 3};
    for (int i = 0; i < 3; i++) {
        const double *row = c + 4 * rows[i];
        q->h[3 * i] = row[0] + row[3] * cu;
        q->h[3 * i + 1] = row[1] + row[3] * cv;
        q->h[3 * i + 2] = row[2] + row[3] * c0;
    }
    q->depth[0] = c[8] + c[11] * cu;
    q->depth[1] = c[9] + c[11] * cv;
    q->depth[2] = c[10] + c[11] * c0;
    q->u_hi = item->tile->cells_x;
    q->v_hi = item->tile->cells_y;
    if (!quad_invert(q))
        return false;
    quad_box(q, view);
    return q->x_lo <= q->x_hi && q->y_lo <= q->y_hi;
}

/* Bilinear colour, or of the nearest sample. */
static uint32_t colour_at(const struct tile *tile, float u, float v, bool nearest) {
    int32_t iu = (int32_t)u, iv = (int32_t)v;
    iu = iu < tile->cells_x ? iu : tile->cells_x - 1;
    iv = iv < tile->cells_y ? iv : tile->cells_y - 1;
    float s = u - (float)iu, t = v - (float)iv;
    if (nearest) {
        s = s >= 0.5f ? 1.0f : 0.0f;
        t = t >= 0.5f ? 1.0f : 0.0f;
    }
    const uint8_t *a = tile->rgb + 3 * ((ptrdiff_t)iv * tile->stride_px + iu);
    const uint8_t *d = a + 3 * (ptrdiff_t)tile->stride_px;
    uint32_t out = (uint32_t)RASTER_ALPHA_SURFACE << 24;
    for (int k = 0; k < 3; k++) {
        float upper = (float)a[k] + s * (float)(a[3 + k] - a[k]);
        float lower = (float)d[k] + s * (float)(d[3 + k] - d[k]);
        out |= (uint32_t)(upper + t * (lower - upper) + 0.5f) << (8 * k);
    }
    return out;
}

/* Cells with a missing corner, hidden samples or a skin are not the plane's. */
static bool cell_shown(const struct tile *tile, float u, float v, uint8_t leave_out) {
    int32_t iu = (int32_t)u, iv = (int32_t)v;
    iu = iu < tile->cells_x ? iu : tile->cells_x - 1;
    iv = iv < tile->cells_y ? iv : tile->cells_y - 1;
    ptrdiff_t at = (ptrdiff_t)iv * tile->stride_px + iu;
    if (tile->flags[at] & PHOTO_SKIN)
        return false;
    ptrdiff_t corner[4] = {at, at + 1, at + tile->stride_px, at + tile->stride_px + 1};
    for (int i = 0; i < 4; i++)
        if (!(tile->disparity_per_m[corner[i]] >= 0.0f) ||
            tile->flags[corner[i]] & (leave_out | PHOTO_DROPPED))
            return false;
    return true;
}

static void put(const struct raster_target *target, size_t at, float depth, uint32_t rgba) {
    uint32_t old;
    memcpy(&old, target->rgba + 4 * at, 4);
    float old_depth = target->depth[at];
    if (depth < old_depth || (depth == old_depth && rgba <= old))
        return;
    target->depth[at] = depth;
    memcpy(target->rgba + 4 * at, &rgba, 4);
}

void render_plane_draw(const struct render_item *item, const struct raster_view *view,
                       const struct raster_options *options, int32_t y0_px, int32_t y1_px,
                       const struct raster_target *target) {
    struct render_projection p = render_tile_project(view, item->tile);
    struct quad q;
    const struct tile *tile = item->tile;
    if (tile->cells_x < 1 || tile->cells_y < 1 || !quad_make(item, &p, view, &q))
        return;
    bool pinhole = view->projection == RASTER_PINHOLE;
    double depth_max = pinhole ? fmin(1.0 / view->near_m, (double)FLT_MAX) : 1.0;
    float gain = (float)(options->push_sigma / (pinhole ? 1.0 : view->far_m - view->near_m));
    int32_t y_lo = q.y_lo > y0_px ? q.y_lo : y0_px;
    int32_t y_hi = q.y_hi < y1_px - 1 ? q.y_hi : y1_px - 1;
    const double *n = q.inv, slack = 1.0 / 512;
    for (int32_t y = y_lo; y <= y_hi; y++)
        for (int32_t x = q.x_lo; x <= q.x_hi; x++) {
            double s = n[6] * x + n[7] * y + n[8]; /* 1 / w */
            if (!(s > 0.0))
                continue;
            double w = 1.0 / s;
            double u = (n[0] * x + n[1] * y + n[2]) * w, v = (n[3] * x + n[4] * y + n[5]) * w;
            if (!(u >= -slack && v >= -slack && u <= q.u_hi + slack && v <= q.v_hi + slack))
                continue;
            u = fmin(fmax(u, 0.0), q.u_hi);
            v = fmin(fmax(v, 0.0), q.v_hi);
            double depth = (q.depth[0] * u + q.depth[1] * v + q.depth[2]) * s;
            /* pushing back only makes it farther: what loses now need not be looked at */
            if ((float)depth < target->depth[(size_t)y * (size_t)view->width_px + (size_t)x] ||
                !(depth >= 0.0 && depth <= depth_max) ||
                !cell_shown(tile, (float)u, (float)v, options->leave_out_flags))
                continue;
            float top = (float)depth;
            if (gain > 0.0f) {
                ptrdiff_t near = (ptrdiff_t)(v + 0.5) * tile->stride_px + (ptrdiff_t)(u + 0.5);
                top -= render_plane_push(options, gain, tile->confidence[near], (float)s,
                                         (float)p.lin_px);
            }
            put(target, (size_t)y * (size_t)view->width_px + (size_t)x, top > 0.0f ? top : 0.0f,
                colour_at(tile, (float)u, (float)v, options->filter == RASTER_FILTER_NEAREST));
        }
}
