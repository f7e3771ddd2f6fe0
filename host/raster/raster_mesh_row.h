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

enum { CELL_MAX_PX = 4, CELL_MAX_FRAGMENTS = CELL_MAX_PX * CELL_MAX_PX };

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
    int32_t place[ROW_MAX]; /* of the nearest sample, 256 v + u in the cell */
};

KERNEL void cell_boxes_make(const struct line *a, const struct line *b, const struct band *band,
                            float tolerance_px, int32_t n, struct cell_boxes *out) {
    float x_last = (float)(band->width_px - 1);
    float y_first = (float)band->y0_px, y_last = (float)(band->y1_px - 1);
    for (int32_t u = 0; u < n; u++) {
        float x0 = a->x_px[u], x1 = a->x_px[u + 1], x2 = b->x_px[u + 1], x3 = b->x_px[u];
        float y0 = a->y_px[u], y1 = a->y_px[u + 1], y2 = b->y_px[u + 1], y3 = b->y_px[u];
        float x01 = x0 < x1 ? x0 : x1, x23 = x2 < x3 ? x2 : x3;
        float y01 = y0 < y1 ? y0 : y1, y23 = y2 < y3 ? y2 : y3;
        float xl = (x01 < x23 ? x01 : x23) - tolerance_px;
        float yl = (y01 < y23 ? y01 : y23) - tolerance_px;
        x01 = x0 > x1 ? x0 : x1;
        x23 = x2 > x3 ? x2 : x3;
        y01 = y0 > y1 ? y0 : y1;
        y23 = y2 > y3 ? y2 : y3;
        float xh = (x01 > x23 ? x01 : x23) + tolerance_px;
        float yh = (y01 > y23 ? y01 : y23) + tolerance_px;
        out->side_px[u] = xh - xl > yh - yl ? xh - xl : yh - yl;
        xl = xl > 0.0f ? xl : 0.0f; /* also takes NaN away */
        yl = yl > y_first ? yl : y_first;
        xh = xh < x_last ? xh : x_last;
        yh = yh < y_last ? yh : y_last;
        xh = xh > -1.0f ? xh : -1.0f;
        yh = yh > -1.0f ? yh : -1.0f;
        xl = xl < 1e6f ? xl : 1e6f;
        yl = yl < 1e6f ? yl : 1e6f;
        int32_t ix = (int32_t)xl, iy = (int32_t)yl; /* not negative: truncation rounds down */
        out->x_lo[u] = ix + ((float)ix < xl);
        out->y_lo[u] = iy + ((float)iy < yl);
        out->x_hi[u] = (int32_t)(xh + 1.0f) - 1;
        out->y_hi[u] = (int32_t)(yh + 1.0f) - 1;
    }
}

KERNEL void cell_geometry_make(const struct cell_row *row, int32_t n, struct cell_geometry *out) {
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
        out->plain[u] = seen & (row->boxes->side_px[u] < (float)CELL_MAX_PX - 0.5f);
    }
}

KERNEL uint32_t channel(float value) {
    return (uint32_t)(int32_t)(value + 0.5f);
}

/* Fragments at the pixels (i, j) of the cells' boxes. */
KERNEL void cell_fragments_make(const struct cell_row *row, const struct cell_geometry *g,
                                int32_t i, int32_t j, int32_t n, struct cell_fragments *out) {
    const struct line *a = row->a, *b = row->b;
    const struct cell_boxes *boxes = row->boxes;
    float tolerance = row->tolerance_px, depth_max = row->depth_max;
    float snap = row->nearest ? 1.0f : 0.0f;
    for (int32_t u = 0; u < n; u++) {
        int32_t ix = boxes->x_lo[u] + i, iy = boxes->y_lo[u] + j;
        float px = (float)ix - a->x_px[u], py = (float)iy - a->y_px[u];
        float cx = g->cx[u], cy = g->cy[u];
        float cross = cx * py - cy * px;
        int32_t on_b = cross * g->inv_b[u] >= 0.0f;
        float qx = on_b ? g->bx[u] : g->dx[u], qy = on_b ? g->by[u] : g->dy[u];
        float inv = on_b ? g->inv_b[u] : g->inv_d[u];
        float lq = cross * inv, lc = (px * qy - py * qx) * inv, la = 1.0f - lq - lc;
        float slack = -tolerance * (inv > 0.0f ? inv : -inv);
        float reach_c = (qx > 0 ? qx : -qx) + (qy > 0 ? qy : -qy);
        float ax = cx - qx, ay = cy - qy;
        float reach_a = (ax > 0 ? ax : -ax) + (ay > 0 ? ay : -ay);
        int32_t in = (lq >= 0.0f) & (lc >= slack * reach_c) & (la >= slack * reach_a) &
                     (ix <= boxes->x_hi[u]) & (iy <= boxes->y_hi[u]);
        float depth_q = on_b ? a->depth[u + 1] : b->depth[u];
        float top_q = on_b ? a->top[u + 1] : b->top[u];
        float w_q = on_b ? a->inv_w[u + 1] : b->inv_w[u];
        float depth = la * a->depth[u] + lq * depth_q + lc * b->depth[u + 1];
        float top = la * a->top[u] + lq * top_q + lc * b->top[u + 1];
        top = top > 0.0f ? top : 0.0f;
        in &= (depth >= 0.0f) & (depth <= depth_max);
        float ma = la * a->inv_w[u], mq = lq * w_q, mc = lc * b->inv_w[u + 1];
        float scale = 1.0f / (ma + mq + mc);
        float s = (on_b ? mq + mc : mc) * scale, t = (on_b ? mc : mq + mc) * scale;
        s = s > 0.0f ? s : 0.0f;
        t = t > 0.0f ? t : 0.0f;
        s = s < 1.0f ? s : 1.0f;
        t = t < 1.0f ? t : 1.0f;
        int32_t s_up = s >= 0.5f, t_up = t >= 0.5f;
        float cs = snap > 0.0f ? (float)s_up : s, ct = snap > 0.0f ? (float)t_up : t;
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
