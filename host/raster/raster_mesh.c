/* Mesh: cells of 2 x 2 samples as two triangles (Nyland et al. 1999, section 5.2).
 *
 * Two lines of vertices at a time are projected into arrays, and the pixel centres in each cell's
 * bounding box are counted; most cells of a dense photograph have none or one. Ordinary cells are
 * drawn a row at a time (raster_mesh_row.h), odd ones one by one here, those that are large or
 * reach behind the eye by raster_mesh_large.c. Which way a cell goes depends on nothing but its own
 * geometry, so that the picture does not depend on how it was cut into bands.
 *
 * An edge is widened by a tolerance instead of obeying a fill rule: neighbours from different tiles
 * differ in their last bits, and since the nearest fragment wins anyway, drawing a pixel twice
 * costs nothing but a gap would show. */
#include "raster/raster_mesh_row.h"

#include "base/simd.h"

#include <float.h>

enum { SMALL_CELL_PX = 12 };

struct mesh {
    const struct frame *frame;
    const struct tile_job *job;
    const struct band *band;
    float tolerance_px;
    int64_t tested;
    int32_t v; /* of the cells */
    struct line lines[2];
    struct cell_boxes boxes;
    uint8_t todo[ROW_MAX]; /* cells that are left after the ordinary ones */
};

/* ---- vertices ---- */

KERNEL void line_project(const struct mesh *mesh, int32_t v, int32_t n, struct line *line) {
    const double *c = mesh->job->c;
    const float *disparity = line->disparity;
    float x0 = (float)(c[1] * v + c[2]), y0 = (float)(c[5] * v + c[6]);
    float d0 = (float)(c[9] * v + c[10]), w0 = (float)(c[13] * v + c[14]);
    float xu = (float)c[0], yu = (float)c[4], du = (float)c[8], wu = (float)c[12];
    float xd = (float)c[3], yd = (float)c[7], dd = (float)c[11], wd = (float)c[15];
    float depth_max = mesh->frame->depth_max;
    const float far_px = 1e6f; /* beyond it a float is no longer a place */
    for (int32_t j = 0; j < n; j++) {
        float delta = disparity[j], u = (float)j;
        float w = w0 + wu * u + wd * delta;
        float inv_w = 1.0f / w;
        float x = (x0 + xu * u + xd * delta) * inv_w;
        float y = (y0 + yu * u + yd * delta) * inv_w;
        float depth = (d0 + du * u + dd * delta) * inv_w;
        line->x_px[j] = x;
        line->y_px[j] = y;
        line->inv_w[j] = inv_w;
        line->depth[j] = line->top[j] = depth;
        int there = (delta >= 0.0f) & (delta <= FLT_MAX);
        int front = (w > 0.0f) & (x > -far_px) & (x < far_px) & (y > -far_px) & (y < far_px) &
                    (depth <= depth_max);
        line->bits[j] = (uint8_t)(there * VERTEX_THERE + front * VERTEX_FRONT);
    }
}

KERNEL void line_push(const struct mesh *mesh, const uint8_t *confidence, int32_t n,
                      struct line *line) {
    float lin2 = mesh->job->lin_px * mesh->job->lin_px;
    for (int32_t j = 0; j < n; j++) {
        float inv2 = line->inv_w[j] * line->inv_w[j];
        float push = mesh->frame->push_gain * mesh->frame->sigma_per_m[confidence[j]] * inv2 *
                     area_octaves(lin2 * inv2);
        line->top[j] = line->depth[j] - push;
    }
}

KERNEL void line_make(struct mesh *mesh, int32_t v, struct line *line) {
    const struct tile *tile = mesh->job->tile;
    int32_t n = tile->cells_x + 1;
    ptrdiff_t at = (ptrdiff_t)v * tile->stride_px;
    line->disparity = tile->disparity_per_m + at;
    line->flags = tile->flags + at;
    if (n == PHOTO_TILE_PX + 1)
        line_project(mesh, v, PHOTO_TILE_PX + 1, line);
    else
        line_project(mesh, v, n, line);
    if (mesh->frame->push_gain > 0.0f)
        line_push(mesh, tile->confidence + at, n, line);
    const uint8_t *rgb = tile->rgb + 3 * at;
    uint8_t leave_out = mesh->frame->options->leave_out_flags;
    for (int32_t j = 0; j < n; j++) {
        for (int k = 0; k < 3; k++)
            line->rgb[k][j] = (float)rgb[3 * j + k];
        bool there = line->bits[j] & VERTEX_THERE, guess = line->flags[j] & PHOTO_DROPPED;
        if (there && !sample_hidden(line->flags[j], leave_out))
            line->bits[j] |= VERTEX_SHOWN;
        if (there && guess)
            line->bits[j] |= VERTEX_GUESS;
    }
}

/* ---- small cells ---- */

struct corner {
    float x, y, inv_w, depth, top, u, v; /* u, v in the cell: 0 or 1 */
};

static inline struct corner corner_of(const struct line *line, int32_t j, float u, float v) {
    struct corner c = {
        line->x_px[j], line->y_px[j], line->inv_w[j], line->depth[j], line->top[j], u, v};
    return c;
}

struct cell {
    int32_t u;
    struct mesh_paint paint;
};

static inline void put_fragment(const struct mesh *mesh, const struct cell *cell, int32_t x,
                                int32_t y, float u, float v, float depth, float top) {
    if (!(depth >= 0.0f && depth <= mesh->frame->depth_max))
        return;
    u = u < 0.0f ? 0.0f : u > 1.0f ? 1.0f : u;
    v = v < 0.0f ? 0.0f : v > 1.0f ? 1.0f : v;
    uint32_t rgba =
        raster_texture_rgba(mesh->frame, &cell->paint, (float)cell->u + u, (float)mesh->v + v);
    const struct band *band = mesh->band;
    ptrdiff_t at = (y - band->y0_px) * band->stride + x;
    uint64_t key = key_depth(top > 0.0f ? top : 0.0f) | rgba;
    if (mesh->frame->rich) {
        uint64_t place = ((uint64_t)(uint32_t)(mesh->v + (v >= 0.5f)) << 8) +
                         (uint64_t)(uint32_t)(cell->u + (u >= 0.5f));
        band_put_rich(band, at, key, mesh->job->item + place, depth);
    } else if (key > band->key[at]) {
        band->key[at] = key;
    }
}

/* Edge functions of p against P1 P2, P2 P0, P0 P1; their sum is the doubled area. */
KERNEL void draw_triangle(const struct mesh *mesh, const struct cell *cell,
                          const struct corner p[3], const int32_t box[4]) {
    float x10 = p[1].x - p[0].x, y10 = p[1].y - p[0].y;
    float x21 = p[2].x - p[1].x, y21 = p[2].y - p[1].y;
    float x02 = p[0].x - p[2].x, y02 = p[0].y - p[2].y;
    float area = x02 * y10 - y02 * x10;
    if (area == 0.0f || (area < 0.0f && mesh->frame->options->faces == RASTER_FACES_FRONT))
        return;
    float sign = area > 0.0f ? 1.0f : -1.0f, inv_area = 1.0f / fabsf(area);
    float t = -mesh->tolerance_px;
    float t0 = t * (fabsf(x21) + fabsf(y21)), t1 = t * (fabsf(x02) + fabsf(y02));
    float t2 = t * (fabsf(x10) + fabsf(y10));
    for (int32_t y = box[2]; y <= box[3]; y++)
        for (int32_t x = box[0]; x <= box[1]; x++) {
            float px = (float)x, py = (float)y;
            float e0 = sign * (x21 * (py - p[1].y) - y21 * (px - p[1].x));
            float e1 = sign * (x02 * (py - p[2].y) - y02 * (px - p[2].x));
            float e2 = sign * (x10 * (py - p[0].y) - y10 * (px - p[0].x));
            if (e0 < t0 || e1 < t1 || e2 < t2)
                continue;
            float l0 = e0 * inv_area, l1 = e1 * inv_area, l2 = e2 * inv_area;
            float depth = l0 * p[0].depth + l1 * p[1].depth + l2 * p[2].depth;
            float top = l0 * p[0].top + l1 * p[1].top + l2 * p[2].top;
            float m0 = l0 * p[0].inv_w, m1 = l1 * p[1].inv_w, m2 = l2 * p[2].inv_w;
            float inv = 1.0f / (m0 + m1 + m2);
            float u = (m0 * p[0].u + m1 * p[1].u + m2 * p[2].u) * inv;
            float v = (m0 * p[0].v + m1 * p[1].v + m2 * p[2].v) * inv;
            put_fragment(mesh, cell, x, y, u, v, depth, top);
        }
}

/* Pixel centres in the triangle's bounding box, cut to the band; returns its uncut larger side. */
static inline float triangle_box(const struct mesh *mesh, const struct corner p[3],
                                 int32_t box[4]) {
    float t = mesh->tolerance_px;
    float x_lo = fminf(fminf(p[0].x, p[1].x), p[2].x) - t;
    float x_hi = fmaxf(fmaxf(p[0].x, p[1].x), p[2].x) + t;
    float y_lo = fminf(fminf(p[0].y, p[1].y), p[2].y) - t;
    float y_hi = fmaxf(fmaxf(p[0].y, p[1].y), p[2].y) + t;
    box[0] = (int32_t)ceilf(fmaxf(x_lo, 0.0f));
    box[1] = (int32_t)floorf(fminf(x_hi, (float)(mesh->band->width_px - 1)));
    box[2] = (int32_t)ceilf(fmaxf(y_lo, (float)mesh->band->y0_px));
    box[3] = (int32_t)floorf(fminf(y_hi, (float)(mesh->band->y1_px - 1)));
    return fmaxf(x_hi - x_lo, y_hi - y_lo);
}

/* ---- cells ---- */

/* What becomes of a cell. */
enum cell_kind { CELL_SKIP, CELL_SURFACE, CELL_SKIN };

static inline enum cell_kind cell_kind(const struct mesh *mesh, uint8_t flags, uint8_t any_bits) {
    const struct raster_options *options = mesh->frame->options;
    if (!(flags & PHOTO_SKIN))
        return options->primitive == RASTER_MESH && options->skins != RASTER_SKINS_ONLY
                   ? CELL_SURFACE
                   : CELL_SKIP;
    if ((flags & PHOTO_SKIN_DISPROVED) == PHOTO_SKIN_DISPROVED)
        return options->skins == RASTER_SKINS_DRAW ? CELL_SURFACE : CELL_SKIP; /* seen through */
    switch (options->skins) {
    case RASTER_SKINS_LEAVE_OUT:
        return CELL_SKIP;
    case RASTER_SKINS_UNKNOWN:
        return any_bits & VERTEX_GUESS ? CELL_SKIN : CELL_SKIP;
    case RASTER_SKINS_COLOUR:
    case RASTER_SKINS_ONLY:
        return CELL_SKIN;
    case RASTER_SKINS_DRAW:
        return CELL_SURFACE;
    }
    return CELL_SKIP;
}

/* Cells that reach behind the eye, or are large. */
static void draw_large(struct mesh *mesh, const struct cell *cell, const int *corners, int count) {
    static const double du[4] = {0, 1, 1, 0}, dv[4] = {0, 0, 1, 1};
    const double *c = mesh->job->c;
    struct mesh_corner p[4];
    for (int i = 0; i < count; i++) {
        int k = corners[i];
        const struct line *line = &mesh->lines[(mesh->v + (dv[k] > 0)) & 1];
        int32_t j = cell->u + (du[k] > 0);
        double u = cell->u + du[k], v = mesh->v + dv[k], delta = (double)line->disparity[j];
        p[i] = (struct mesh_corner){.x = c[0] * u + c[1] * v + c[2] + c[3] * delta,
                                    .y = c[4] * u + c[5] * v + c[6] + c[7] * delta,
                                    .d = c[8] * u + c[9] * v + c[10] + c[11] * delta,
                                    .w = c[12] * u + c[13] * v + c[14] + c[15] * delta,
                                    .u = u,
                                    .v = v};
        float push = line->depth[j] - line->top[j];
        p[i].push = push >= 0.0f && push <= FLT_MAX ? (double)push : 0.0;
    }
    for (int i = 2; i < count; i++) {
        struct mesh_corner triangle[3] = {p[0], p[i - 1], p[i]};
        mesh->tested += raster_mesh_large_triangle(mesh->frame, &cell->paint, triangle, mesh->band);
    }
}

KERNEL void draw_cell(struct mesh *mesh, int32_t u) {
    const struct line *a = &mesh->lines[mesh->v & 1], *b = &mesh->lines[(mesh->v + 1) & 1];
    const uint8_t bits[4] = {a->bits[u], a->bits[u + 1], b->bits[u + 1], b->bits[u]};
    enum cell_kind kind =
        cell_kind(mesh, a->flags[u], (uint8_t)(bits[0] | bits[1] | bits[2] | bits[3]));
    if (kind == CELL_SKIP)
        return;
    struct cell cell = {u, {mesh->job, kind == CELL_SKIN}};
    uint8_t wanted = kind == CELL_SKIN ? VERTEX_THERE : VERTEX_SHOWN;
    int corners[4], count = 0;
    uint8_t all = 0xff;
    for (int i = 0; i < 4; i++)
        if (bits[i] & wanted) {
            corners[count++] = i;
            all &= bits[i];
        }
    if (count < 3)
        return;
    if (!(all & VERTEX_FRONT)) {
        draw_large(mesh, &cell, corners, count);
        return;
    }
    const struct corner p[4] = {corner_of(a, u, 0, 0), corner_of(a, u + 1, 1, 0),
                                corner_of(b, u + 1, 1, 1), corner_of(b, u, 0, 1)};
    for (int i = 2; i < count; i++) {
        const struct corner triangle[3] = {p[corners[0]], p[corners[i - 1]], p[corners[i]]};
        int32_t box[4];
        float side_px = triangle_box(mesh, triangle, box);
        if (!(side_px < (float)SMALL_CELL_PX)) {
            const int own[3] = {corners[0], corners[i - 1], corners[i]};
            draw_large(mesh, &cell, own, 3);
        } else if (box[0] <= box[1] && box[2] <= box[3]) {
            mesh->tested += (int64_t)(box[1] - box[0] + 1) * (box[3] - box[2] + 1);
            draw_triangle(mesh, &cell, triangle, box);
        }
    }
}

/* ---- rows of ordinary cells ---- */

KERNEL void put_cell(const struct mesh *mesh, const struct cell_row *row,
                     const struct cell_fragments *fragments, int32_t u, int32_t i, int32_t j) {
    if (!fragments->upper[u])
        return;
    const struct band *band = mesh->band;
    ptrdiff_t at = (row->boxes->y_lo[u] + j - band->y0_px) * band->stride + row->boxes->x_lo[u] + i;
    uint64_t upper = (uint64_t)fragments->upper[u] << 32;
    if (!mesh->frame->rich && upper + UINT32_MAX <= band->key[at])
        return; /* hidden whatever its colour */
    uint32_t rgba = fragments->rgba[u];
    if (mesh->frame->options->filter == RASTER_FILTER_CUBIC) {
        struct mesh_paint paint = {mesh->job, false};
        rgba = raster_texture_rgba(mesh->frame, &paint, (float)u + fragments->s[u],
                                   (float)mesh->v + fragments->t[u]);
    }
    uint64_t key = upper | rgba;
    if (mesh->frame->rich) {
        int32_t place = 256 * mesh->v + u + fragments->place[u];
        band_put_rich(band, at, key, mesh->job->item + (uint32_t)place, fragments->depth[u]);
    } else {
        band->key[at] = key > band->key[at] ? key : band->key[at];
    }
}

/* Draws the pixels (i, j) of the boxes of the listed cells: all cells of the row at once if that is
 * less work than the listed ones by themselves. */
KERNEL void draw_pixel_of(struct mesh *mesh, const struct cell_row *row,
                          const struct cell_geometry *geometry, const int32_t *list, int32_t count,
                          int32_t n, int32_t i, int32_t j) {
    struct cell_fragments fragments;
    if (count > n / 6) {
        cell_fragments_make(row, geometry, i, j, 0, n, &fragments);
        for (int32_t k = 0; k < count; k++)
            put_cell(mesh, row, &fragments, list[k], i, j);
    } else {
        for (int32_t k = 0; k < count; k++) {
            cell_fragments_make(row, geometry, i, j, list[k], list[k] + 1, &fragments);
            put_cell(mesh, row, &fragments, list[k], i, j);
        }
    }
}

/* Draws the listed cells of a row. */
KERNEL void draw_listed(struct mesh *mesh, const struct cell_row *row,
                        const struct cell_geometry *geometry, const int32_t *list, int32_t count,
                        int32_t n) {
    const struct cell_boxes *boxes = row->boxes;
    int32_t wide = 0, high = 0;
    for (int32_t k = 0; k < count; k++) {
        int32_t u = list[k];
        int32_t nx = boxes->x_hi[u] - boxes->x_lo[u] + 1, ny = boxes->y_hi[u] - boxes->y_lo[u] + 1;
        wide = nx > wide ? nx : wide;
        high = ny > high ? ny : high;
        mesh->tested += (int64_t)nx * ny;
    }
    draw_pixel_of(mesh, row, geometry, list, count, n, 0, 0);
    for (int32_t j = 0; j < high; j++)
        for (int32_t i = j ? 0 : 1; i < wide; i++) {
            int32_t those[ROW_MAX], left = 0;
            for (int32_t k = 0; k < count; k++) {
                int32_t u = list[k];
                those[left] = u;
                left +=
                    (boxes->x_lo[u] + i <= boxes->x_hi[u]) & (boxes->y_lo[u] + j <= boxes->y_hi[u]);
            }
            draw_pixel_of(mesh, row, geometry, those, left, n, i, j);
        }
}

/* Draws the ordinary cells of a row and leaves the others in mesh->todo. */
KERNEL void draw_row(struct mesh *mesh, int32_t n) {
    const struct raster_options *options = mesh->frame->options;
    const struct line *a = &mesh->lines[mesh->v & 1], *b = &mesh->lines[(mesh->v + 1) & 1];
    struct cell_row row = {.a = a,
                           .b = b,
                           .boxes = &mesh->boxes,
                           .tolerance_px = mesh->tolerance_px,
                           .depth_max = mesh->frame->depth_max,
                           .nearest = options->filter == RASTER_FILTER_NEAREST,
                           .front_only = options->faces == RASTER_FACES_FRONT};
    bool fast = options->primitive == RASTER_MESH && options->skins != RASTER_SKINS_ONLY;
    struct cell_geometry geometry;
    cell_boxes_make(a, b, mesh->band, mesh->tolerance_px, n, &mesh->boxes);
    cell_geometry_make(&row, n, &geometry);
    int32_t list[ROW_MAX], count = 0;
    const uint8_t ordinary = VERTEX_SHOWN | VERTEX_FRONT;
    for (int32_t u = 0; u < n; u++) {
        uint8_t all = a->bits[u] & a->bits[u + 1] & b->bits[u] & b->bits[u + 1];
        bool whole = (all & ordinary) == ordinary;
        bool empty = (mesh->boxes.x_hi[u] < mesh->boxes.x_lo[u]) |
                     (mesh->boxes.y_hi[u] < mesh->boxes.y_lo[u]);
        bool mine = whole && fast && geometry.plain[u] && !(a->flags[u] & PHOTO_SKIN);
        mesh->todo[u] = !mine && !(whole && empty);
        list[count] = u;
        count += mine && !empty;
    }
    draw_listed(mesh, &row, &geometry, list, count, n);
}

SC_SIMD_CLONES
int64_t raster_mesh_tile(const struct frame *frame, const struct tile_job *job,
                         const struct band *band) {
    const struct tile *tile = job->tile;
    struct mesh mesh;
    mesh.frame = frame;
    mesh.job = job;
    mesh.band = band;
    mesh.tested = 0;
    /* Last bits of a float at the picture's far edge, times the few operations that made it. */
    mesh.tolerance_px =
        fmaxf(1.0f / 512, (float)fmax(frame->view->width_px, frame->view->height_px) / 1048576.0f);
    int32_t cells_x = tile->cells_x;
    if (cells_x < 1 || tile->cells_y < 1)
        return 0;
    line_make(&mesh, 0, &mesh.lines[0]);
    for (int32_t v = 0; v < tile->cells_y; v++) {
        line_make(&mesh, v + 1, &mesh.lines[(v + 1) & 1]);
        mesh.v = v;
        if (cells_x == PHOTO_TILE_PX)
            draw_row(&mesh, PHOTO_TILE_PX);
        else
            draw_row(&mesh, cells_x);
        for (int32_t u = 0; u < cells_x; u++)
            if (mesh.todo[u])
                draw_cell(&mesh, u);
    }
    return mesh.tested;
}
