/* Triangles of any size, in double, clipped to what lies before the eye. */
#include "raster/raster_band.h"

enum { CLIPPED_MAX = 4 };

static struct mesh_corner corner_between(const struct mesh_corner *a, const struct mesh_corner *b,
                                         double t) {
    struct mesh_corner c = {.x = a->x + t * (b->x - a->x),
                            .y = a->y + t * (b->y - a->y),
                            .d = a->d + t * (b->d - a->d),
                            .w = a->w + t * (b->w - a->w),
                            .u = a->u + t * (b->u - a->u),
                            .v = a->v + t * (b->v - a->v),
                            .push = a->push + t * (b->push - a->push)};
    return c;
}

/* Sutherland and Hodgman 1974, one plane: inside where value > 0. `value` holds one number a
 * corner. */
static int clip_plane(const struct mesh_corner *in, int count, const double *value,
                      struct mesh_corner out[CLIPPED_MAX + 1]) {
    int n = 0;
    for (int i = 0; i < count; i++) {
        int k = (i + 1) % count;
        bool in_i = value[i] > 0.0, in_k = value[k] > 0.0;
        if (in_i)
            out[n++] = in[i];
        if (in_i != in_k)
            out[n++] = corner_between(&in[i], &in[k], value[i] / (value[i] - value[k]));
    }
    return n;
}

/* A corner on screen. All but the coordinates are linear over the screen. */
struct flat_corner {
    double x, y, inv_w, depth, u_w, v_w, push;
};

/* What is interpolated: all of it is linear over the screen. */
enum { FLAT_INV_W, FLAT_DEPTH, FLAT_U_W, FLAT_V_W, FLAT_PUSH, FLAT_VALUES };

struct flat_triangle {
    struct flat_corner p[3];
    double ex[3], ey[3], e0[3]; /* barycentrics l_i = ex x + ey y + e0 */
    /* value = dx x + dy y + at0 */
    double dx[FLAT_VALUES], dy[FLAT_VALUES], at0[FLAT_VALUES];
};

static void flat_gradients(struct flat_triangle *t) {
    for (int k = 0; k < FLAT_VALUES; k++)
        t->dx[k] = t->dy[k] = t->at0[k] = 0.0;
    for (int i = 0; i < 3; i++) {
        const struct flat_corner *p = &t->p[i];
        const double value[FLAT_VALUES] = {p->inv_w, p->depth, p->u_w, p->v_w, p->push};
        for (int k = 0; k < FLAT_VALUES; k++) {
            t->dx[k] += t->ex[i] * value[k];
            t->dy[k] += t->ey[i] * value[k];
            t->at0[k] += t->e0[i] * value[k];
        }
    }
}

static bool flat_setup(struct flat_triangle *t, enum raster_faces faces) {
    double x0 = t->p[0].x, y0 = t->p[0].y;
    double ax = t->p[1].x - x0, ay = t->p[1].y - y0, bx = t->p[2].x - x0, by = t->p[2].y - y0;
    double area = ax * by - ay * bx;
    if (!(fabs(area) > 0.0) || !isfinite(area) || (area < 0.0 && faces == RASTER_FACES_FRONT))
        return false;
    for (int i = 0; i < 3; i++) {
        const struct flat_corner *q = &t->p[(i + 1) % 3], *r = &t->p[(i + 2) % 3];
        t->ex[i] = (q->y - r->y) / area;
        t->ey[i] = (r->x - q->x) / area;
        t->e0[i] = -(t->ex[i] * q->x + t->ey[i] * q->y);
    }
    flat_gradients(t);
    return true;
}

/* Pixels of row y inside the triangle, widened by `pad_px`. */
static bool flat_span(const struct flat_triangle *t, double y, double pad_px, double x_last,
                      int32_t *out_lo, int32_t *out_hi) {
    double lo = 0.0, hi = x_last;
    for (int i = 0; i < 3; i++) {
        double pad = pad_px * (fabs(t->ex[i]) + fabs(t->ey[i]));
        double at0 = t->ey[i] * y + t->e0[i] + pad;
        if (t->ex[i] > 0.0)
            lo = fmax(lo, -at0 / t->ex[i]);
        else if (t->ex[i] < 0.0)
            hi = fmin(hi, -at0 / t->ex[i]);
        else if (at0 < 0.0)
            return false;
    }
    if (!(lo <= hi))
        return false;
    *out_lo = (int32_t)ceil(lo);
    *out_hi = (int32_t)floor(hi);
    return true;
}

/* The values of a row: value = dx x + row. */
static void flat_pixel(const struct frame *frame, const struct mesh_paint *paint,
                       const struct flat_triangle *t, const double row[FLAT_VALUES], int32_t x,
                       int32_t y, const struct band *band) {
    double depth = t->dx[FLAT_DEPTH] * x + row[FLAT_DEPTH];
    double push = t->dx[FLAT_PUSH] * x + row[FLAT_PUSH];
    double inv_w = t->dx[FLAT_INV_W] * x + row[FLAT_INV_W];
    if (!(depth >= 0.0 && depth <= (double)frame->depth_max) || !(inv_w > 0.0))
        return;
    uint64_t upper = key_depth((float)fmax(depth - push, 0.0));
    ptrdiff_t at = (y - band->y0_px) * band->stride + x;
    if (!frame->rich && upper + UINT32_MAX <= band->key[at])
        return; /* hidden whatever its colour */
    double u_w = t->dx[FLAT_U_W] * x + row[FLAT_U_W], v_w = t->dx[FLAT_V_W] * x + row[FLAT_V_W];
    double u = fmin(fmax(u_w / inv_w, 0.0), 32.0), v = fmin(fmax(v_w / inv_w, 0.0), 32.0);
    uint64_t key = upper | raster_texture_rgba(frame, paint, (float)u, (float)v);
    if (frame->rich)
        band_put_rich(band, at, key,
                      paint->job->item + ((uint64_t)(v + 0.5) << 8) + (uint64_t)(u + 0.5),
                      (float)depth);
    else if (key > band->key[at])
        band->key[at] = key;
}

static int64_t flat_draw(const struct frame *frame, const struct mesh_paint *paint,
                         struct flat_triangle *t, const struct band *band) {
    static const double pad_px = 1.0 / 512; /* as raster_mesh.c: no gaps between neighbours */
    if (!flat_setup(t, frame->options->faces))
        return 0;
    double lo = fmin(fmin(t->p[0].y, t->p[1].y), t->p[2].y) - pad_px;
    double hi = fmax(fmax(t->p[0].y, t->p[1].y), t->p[2].y) + pad_px;
    int32_t y_lo = (int32_t)fmin(fmax(ceil(lo), band->y0_px), band->y1_px);
    int32_t y_hi = (int32_t)fmax(fmin(floor(hi), band->y1_px - 1.0), band->y0_px - 1.0);
    int64_t tested = 0;
    for (int32_t y = y_lo; y <= y_hi; y++) {
        int32_t x_lo, x_hi;
        if (!flat_span(t, y, pad_px, band->width_px - 1.0, &x_lo, &x_hi))
            continue;
        double row[FLAT_VALUES];
        for (int k = 0; k < FLAT_VALUES; k++)
            row[k] = t->dy[k] * y + t->at0[k];
        for (int32_t x = x_lo; x <= x_hi; x++)
            flat_pixel(frame, paint, t, row, x, y, band);
        tested += x_hi >= x_lo ? x_hi - x_lo + 1 : 0;
    }
    return tested;
}

int64_t raster_mesh_large_triangle(const struct frame *frame, const struct mesh_paint *paint,
                                   const struct mesh_corner corner[3], const struct band *band) {
    /* Before the eye: w above a tiny share of the largest; and not nearer than near_m. */
    double w_max = fmax(fmax(corner[0].w, corner[1].w), corner[2].w);
    if (!(w_max > 0.0) || !isfinite(w_max))
        return 0;
    double value[CLIPPED_MAX + 1];
    struct mesh_corner a[CLIPPED_MAX + 1], b[CLIPPED_MAX + 2];
    for (int i = 0; i < 3; i++)
        value[i] = corner[i].w - 1e-7 * w_max;
    int n = clip_plane(corner, 3, value, a);
    for (int i = 0; i < n; i++)
        value[i] = (double)frame->depth_max * a[i].w * (1.0 + 1e-6) - a[i].d;
    n = clip_plane(a, n, value, b);
    int64_t tested = 0;
    for (int i = 2; i < n; i++) {
        const struct mesh_corner *q[3] = {&b[0], &b[i - 1], &b[i]};
        struct flat_triangle t;
        for (int k = 0; k < 3; k++) {
            double inv_w = 1.0 / q[k]->w;
            t.p[k] =
                (struct flat_corner){q[k]->x * inv_w, q[k]->y * inv_w, inv_w,     q[k]->d * inv_w,
                                     q[k]->u * inv_w, q[k]->v * inv_w, q[k]->push};
        }
        tested += flat_draw(frame, paint, &t, band);
    }
    return tested;
}
