/* Private to raster_mesh.c: ordinary cells, a row of up to 32 at a time, in arrays that the
 * compiler vectorises.
 *
 * A cell A B C D (A at (u, v), then clockwise in the photograph) is split along A C. A pixel p,
 * relative to A, lies on B's or on D's side of the diagonal; with Q for that corner its
 * barycentrics in A Q C are l_Q = C x p / area,  l_C = p x Q / area,  l_A = 1 - l_Q - l_C,   area =
 * C x Q, where a x b is the cross product. */
#ifndef SC_RASTER_RASTER_MESH_ROW_H
#define SC_RASTER_RASTER_MESH_ROW_H

#include "raster/raster_band.h"

/* Larger cells are not ordinary. */
enum { CELL_MAX_PX = 12 };

enum vertex_bits {
    VERTEX_THERE = 1, /* has a disparity */
    VERTEX_SHOWN = 2, /* ... and is a sample in its own right */
    VERTEX_FRONT = 4, /* projects to a sensible place before the eye */
    VERTEX_GUESS = 8  /* bounds the unknown */
};

/* One line of projected vertices. */
struct line {
    float x_px[ROW_MAX], y_px[ROW_MAX], inv_w[ROW_MAX];
    float depth[ROW_MAX], top[ROW_MAX]; /* top: pushed back */
    float rgb[3][ROW_MAX];
    uint8_t bits[ROW_MAX];
    const float *disparity;
    const uint8_t *flags;
};

/* Pixel centres in the bounding boxes of a row of cells, cut to the band, and the boxes' uncut
 * sizes. */
struct cell_boxes {
    int32_t x_lo[ROW_MAX], x_hi[ROW_MAX], y_lo[ROW_MAX], y_hi[ROW_MAX];
    float side_px[ROW_MAX];
};

/* Constants of a row of cells. */
struct cell_row {
    const struct line *a, *b; /* upper and lower vertices */
    const struct cell_boxes *boxes;
    float tolerance_px, depth_max;
    bool nearest, front_only;
};

/* Of a row of cells: the geometry in the picture, relative to A. */
struct cell_geometry {
    float bx[ROW_MAX], by[ROW_MAX], cx[ROW_MAX], cy[ROW_MAX], dx[ROW_MAX], dy[ROW_MAX];
    float inv_b[ROW_MAX], inv_d[ROW_MAX]; /* 1 / area of A B C with its sign, and of A D C */
    int32_t plain[ROW_MAX];               /* neither folded nor, if that matters, turned away */
};

/* What one of the pixels of each cell gets. */
struct cell_fragments {
    uint32_t upper[ROW_MAX], rgba[ROW_MAX]; /* upper half of the key, 0 for nothing */
    float depth[ROW_MAX];
    int32_t place[ROW_MAX];       /* of the nearest sample, 256 v + u in the cell */
    float s[ROW_MAX], t[ROW_MAX]; /* (u, v) in the cell, 0..1 */
};

KERNEL float min2(float a, float b) {
    return a < b ? a : b;
}
KERNEL float max2(float a, float b) {
    return a > b ? a : b;
}

/* First and last whole number in lo..hi, both cut to first..last (NaN too); lo > hi if there is
 * none. */
KERNEL void whole_between(float lo, float hi, float first, float last, int32_t *out_lo,
                          int32_t *out_hi) {
    lo = min2(max2(lo, first), last + 1.0f);
    hi = max2(min2(hi, last), first - 1.0f);
    int32_t floor_lo = (int32_t)lo; /* first >= 0: truncation rounds down */
    *out_lo = floor_lo + ((float)floor_lo < lo);
    *out_hi = (int32_t)(hi + 1.0f) - 1;
}

KERNEL void cell_boxes_make(const struct line *restrict a, const struct line *restrict b,
                            const struct band *band, float tolerance_px, int32_t n,
                            struct cell_boxes *restrict out) {
    float x_last = (float)(band->width_px - 1);
    float y_first = (float)band->y0_px, y_last = (float)(band->y1_px - 1);
    for (int32_t u = 0; u < n; u++) {
        float x0 = a->x_px[u], x1 = a->x_px[u + 1], x2 = b->x_px[u + 1], x3 = b->x_px[u];
        float y0 = a->y_px[u], y1 = a->y_px[u + 1], y2 = b->y_px[u + 1], y3 = b->y_px[u];
        float x_lo = min2(min2(x0, x1), min2(x2, x3)) - tolerance_px;
        float y_lo = min2(min2(y0, y1), min2(y2, y3)) - tolerance_px;
        float x_hi = max2(max2(x0, x1), max2(x2, x3)) + tolerance_px;
        float y_hi = max2(max2(y0, y1), max2(y2, y3)) + tolerance_px;
        out->side_px[u] = max2(x_hi - x_lo, y_hi - y_lo);
        whole_between(x_lo, x_hi, 0.0f, x_last, &out->x_lo[u], &out->x_hi[u]);
        whole_between(y_lo, y_hi, y_first, y_last, &out->y_lo[u], &out->y_hi[u]);
    }
}

KERNEL void cell_geometry_make(const struct cell_row *row, int32_t n,
                               struct cell_geometry *restrict out) {
    const struct line *a = row->a, *b = row->b;
    for (int32_t u = 0; u < n; u++) {
        float x = a->x_px[u], y = a->y_px[u];
        float bx = a->x_px[u + 1] - x, by = a->y_px[u + 1] - y;
        float cx = b->x_px[u + 1] - x, cy = b->y_px[u + 1] - y;
        float dx = b->x_px[u] - x, dy = b->y_px[u] - y;
        float area_b = cx * by - cy * bx, area_d = cx * dy - cy * dx;
        out->bx[u] = bx;
        out->by[u] = by;
        out->cx[u] = cx;
        out->cy[u] = cy;
        out->dx[u] = dx;
        out->dy[u] = dy;
        out->inv_b[u] = 1.0f / area_b;
        out->inv_d[u] = 1.0f / area_d;
        int32_t seen = ((area_b < 0.0f) & (area_d > 0.0f)) |
                       ((area_b > 0.0f) & (area_d < 0.0f) & !row->front_only);
        out->plain[u] = seen & (row->boxes->side_px[u] < (float)CELL_MAX_PX);
    }
}

/* A choice of values, both at hand: no branch, so that loops can be vectorised. */
KERNEL float either(int32_t first, float a, float b) {
    return first ? a : b;
}

KERNEL uint32_t channel(float value) {
    return (uint32_t)(int32_t)(value + 0.5f);
}

/* Fragments at the pixels (i, j) of the boxes of cells first..end - 1. */
KERNEL void cell_fragments_make(const struct cell_row *row, const struct cell_geometry *g,
                                int32_t i, int32_t j, int32_t first, int32_t end,
                                struct cell_fragments *restrict out) {
    const struct line *a = row->a, *b = row->b;
    const struct cell_boxes *boxes = row->boxes;
    float tolerance = row->tolerance_px, depth_max = row->depth_max;
    float snap = row->nearest ? 1.0f : 0.0f;
    for (int32_t u = first; u < end; u++) {
        int32_t ix = boxes->x_lo[u] + i, iy = boxes->y_lo[u] + j;
        float px = (float)ix - a->x_px[u], py = (float)iy - a->y_px[u];
        float cx = g->cx[u], cy = g->cy[u];
        float cross = cx * py - cy * px;
        int32_t on_b = cross * g->inv_b[u] >= 0.0f;
        float qx = either(on_b, g->bx[u], g->dx[u]), qy = either(on_b, g->by[u], g->dy[u]);
        float inv = either(on_b, g->inv_b[u], g->inv_d[u]);
        float lq = cross * inv, lc = (px * qy - py * qx) * inv, la = 1.0f - lq - lc;
        float slack = -tolerance * fabsf(inv);
        float reach_c = fabsf(qx) + fabsf(qy);
        float reach_a = fabsf(cx - qx) + fabsf(cy - qy);
        int32_t in = (lq >= 0.0f) & (lc >= slack * reach_c) & (la >= slack * reach_a) &
                     (ix <= boxes->x_hi[u]) & (iy <= boxes->y_hi[u]);
        float depth_q = either(on_b, a->depth[u + 1], b->depth[u]);
        float top_q = either(on_b, a->top[u + 1], b->top[u]);
        float w_q = either(on_b, a->inv_w[u + 1], b->inv_w[u]);
        float depth = la * a->depth[u] + lq * depth_q + lc * b->depth[u + 1];
        float top = la * a->top[u] + lq * top_q + lc * b->top[u + 1];
        top = max2(top, 0.0f);
        in &= (depth >= 0.0f) & (depth <= depth_max);
        float ma = la * a->inv_w[u], mq = lq * w_q, mc = lc * b->inv_w[u + 1];
        float scale = 1.0f / (ma + mq + mc);
        float s = (mc + either(on_b, mq, 0.0f)) * scale, t = (mc + either(on_b, 0.0f, mq)) * scale;
        s = min2(max2(s, 0.0f), 1.0f);
        t = min2(max2(t, 0.0f), 1.0f);
        out->s[u] = s;
        out->t[u] = t;
        int32_t s_up = s >= 0.5f, t_up = t >= 0.5f;
        float cs = s + snap * ((float)s_up - s), ct = t + snap * ((float)t_up - t);
        float wc = cs * ct, wb = cs - wc, wd = ct - wc, wa = 1.0f - cs - wd;
        uint32_t red = channel(wa * a->rgb[0][u] + wb * a->rgb[0][u + 1] + wc * b->rgb[0][u + 1] +
                               wd * b->rgb[0][u]);
        uint32_t green = channel(wa * a->rgb[1][u] + wb * a->rgb[1][u + 1] + wc * b->rgb[1][u + 1] +
                                 wd * b->rgb[1][u]);
        uint32_t blue = channel(wa * a->rgb[2][u] + wb * a->rgb[2][u + 1] + wc * b->rgb[2][u + 1] +
                                wd * b->rgb[2][u]);
        out->rgba[u] = red | green << 8 | blue << 16 | (uint32_t)RASTER_ALPHA_SURFACE << 24;
        out->upper[u] = in ? float_bits(top) + 1u : 0u;
        out->depth[u] = depth;
        out->place[u] = 256 * t_up + s_up;
    }
}

#endif
