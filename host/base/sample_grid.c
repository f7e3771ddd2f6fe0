#include "base/sample_grid.h"

#include "base/image.h"
#include "base/photo.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;

enum { PLACES_PER_SAMPLE_MAX = 16, PLACES_MIN = 65536, SPACINGS_MAX = 8, MEDIAN_SAMPLES = 16384 };

/* ---- samples ---- */

struct vec3 sample_direction(const struct polar_sample *sample) {
    const double ce = cos(sample->elevation_rad);
    return vec3_make(ce * cos(sample->azimuth_rad), ce * sin(sample->azimuth_rad),
                     sin(sample->elevation_rad));
}

struct vec3 sample_point(const struct polar_sample *sample) {
    return vec3_scale(sample_direction(sample), (double)sample->range_m);
}

struct polar_sample sample_from_point(struct vec3 p_m) {
    struct polar_sample s;
    memset(&s, 0, sizeof s);
    s.azimuth_rad = atan2(p_m.y, p_m.x);
    s.elevation_rad = atan2(p_m.z, hypot(p_m.x, p_m.y));
    s.range_m = (float)vec3_norm(p_m);
    return s;
}

static bool is_absent(const struct polar_sample *s) {
    return isnan(s->azimuth_rad);
}

static bool is_valid(const struct polar_sample *s) {
    return !is_absent(s) && !(s->flags & (SAMPLE_NO_RETURN | SAMPLE_DROPPED)) &&
           s->range_m > 0.0f && isfinite(s->range_m);
}

/* ---- the grid ---- */

enum st sample_grid_create(const struct polar_sample *samples, size_t count,
                           struct sample_grid *out_grid, struct errctx *err) {
    uint64_t rows = 0, columns = 0;
    for (size_t i = 0; i < count; i++) {
        if (!isfinite(samples[i].azimuth_rad) || !isfinite(samples[i].elevation_rad))
            return errctx_set(err, ST_INVALID, "sample %zu has no direction", i);
        if (samples[i].row >= rows)
            rows = (uint64_t)samples[i].row + 1;
        if (samples[i].column >= columns)
            columns = (uint64_t)samples[i].column + 1;
    }
    const uint64_t places_max = (uint64_t)count * PLACES_PER_SAMPLE_MAX + PLACES_MIN;
    if (rows > INT32_MAX || columns > INT32_MAX || (rows && columns > places_max / rows))
        return errctx_set(err, ST_NOMEM, "%llu rows of %llu columns are too many for %zu samples",
                          (unsigned long long)rows, (unsigned long long)columns, count);
    struct sample_grid grid = {(int32_t)rows, (int32_t)columns, NULL};
    const size_t places = (size_t)(rows * columns);
    grid.samples = calloc(places ? places : 1, sizeof *grid.samples);
    if (!grid.samples)
        return errctx_set(err, ST_NOMEM, "no memory for a grid of %zu samples", places);
    for (size_t i = 0; i < places; i++) {
        grid.samples[i].azimuth_rad = NAN;
        grid.samples[i].range_m = NAN;
    }
    for (size_t i = 0; i < count; i++)
        grid.samples[(size_t)samples[i].row * (size_t)columns + samples[i].column] = samples[i];
    *out_grid = grid;
    return ST_OK;
}

void sample_grid_destroy(struct sample_grid *grid) {
    if (!grid)
        return;
    free(grid->samples);
    memset(grid, 0, sizeof *grid);
}

static int by_value(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Median angle between the samples that are `stride` apart; every step-th of them is enough. */
static double median_angle(const struct sample_grid *grid, int32_t d_row, int32_t d_column,
                           double *scratch) {
    const size_t places = (size_t)grid->rows * (size_t)grid->columns;
    const size_t step = places / MEDIAN_SAMPLES + 1;
    size_t n = 0;
    for (size_t i = 0; i < places; i += step) {
        const int32_t row = (int32_t)(i / (size_t)grid->columns) + d_row;
        const int32_t column = (int32_t)(i % (size_t)grid->columns) + d_column;
        if (row >= grid->rows || column >= grid->columns)
            continue;
        const struct polar_sample *a = grid->samples + i;
        const struct polar_sample *b = grid->samples + (size_t)row * (size_t)grid->columns + column;
        if (is_absent(a) || is_absent(b))
            continue;
        const double d = vec3_norm(vec3_sub(sample_direction(a), sample_direction(b)));
        if (d > 0.0)
            scratch[n++] = 2.0 * asin(fmin(1.0, 0.5 * d));
    }
    if (n == 0)
        return NAN;
    qsort(scratch, n, sizeof *scratch, by_value);
    return scratch[n / 2];
}

enum st sample_grid_spacing(const struct sample_grid *grid, struct sample_spacing *out_spacing) {
    double *scratch = malloc((MEDIAN_SAMPLES + 1) * sizeof *scratch);
    if (!scratch)
        return ST_NOMEM;
    out_spacing->along_row_rad = median_angle(grid, 0, 1, scratch);
    out_spacing->along_column_rad = median_angle(grid, 1, 0, scratch);
    free(scratch);
    return ST_OK;
}

/* ---- what lies on one surface ---- */

enum { LINK_RIGHT = 1, LINK_DOWN = 2 };

/* Second difference of 1 / range within its noise: three neighbours on one plane. The 3 is three
 * sigmas, sqrt(6) what a second difference makes of one. */
static bool is_straight(const struct polar_sample *a, const struct polar_sample *b,
                        const struct polar_sample *c, double range_sigma_m) {
    if (!is_valid(a) || !is_valid(b) || !is_valid(c))
        return false;
    const double x = 1.0 / (double)a->range_m, y = 1.0 / (double)b->range_m;
    const double z = 1.0 / (double)c->range_m, largest = fmax(x, fmax(y, z));
    return fabs(x - 2.0 * y + z) <= 3.0 * sqrt(6.0) * range_sigma_m * largest * largest;
}

/* Whether neighbours b and c are one surface; a comes before b and d after c on the same line, or
 * NULL. */
static bool is_linked(const struct polar_sample *a, const struct polar_sample *b,
                      const struct polar_sample *c, const struct polar_sample *d,
                      const struct sample_draw_options *options) {
    if (!is_valid(b) || !is_valid(c))
        return false;
    const double angle = vec3_norm(vec3_sub(sample_direction(b), sample_direction(c)));
    const double nearer = fmin((double)b->range_m, (double)c->range_m);
    const double jump = fabs((double)b->range_m - (double)c->range_m);
    if (jump <=
        tan(options->slope_limit_rad) * angle * nearer + 3.0 * sqrt(2.0) * options->range_sigma_m)
        return true;
    return (a && is_straight(a, b, c, options->range_sigma_m)) ||
           (d && is_straight(b, c, d, options->range_sigma_m));
}

static void link_samples(const struct sample_grid *grid, const struct sample_draw_options *options,
                         uint8_t *links) {
    const ptrdiff_t w = grid->columns, h = grid->rows;
    for (ptrdiff_t row = 0; row < h; row++)
        for (ptrdiff_t column = 0; column < w; column++) {
            const struct polar_sample *s = grid->samples + row * w + column;
            uint8_t bits = 0;
            if (column + 1 < w && is_linked(column > 0 ? s - 1 : NULL, s, s + 1,
                                            column + 2 < w ? s + 2 : NULL, options))
                bits |= LINK_RIGHT;
            if (row + 1 < h && is_linked(row > 0 ? s - w : NULL, s, s + w,
                                         row + 2 < h ? s + 2 * w : NULL, options))
                bits |= LINK_DOWN;
            links[row * w + column] = bits;
        }
}

/* ---- drawing ---- */

enum vertex_state { VERTEX_NONE, VERTEX_SURFACE, VERTEX_EMPTY };

struct vertex {
    double u_px, v_px;
    double inverse_per_m;
    int32_t sample;
    uint8_t flags; /* of an empty one */
    enum vertex_state state;
};

struct drawing {
    const struct sample_grid *grid;
    const struct sample_view *view;
    struct sample_spacing spacing;
    uint8_t *links;
    struct sample_picture picture; /* no NULL planes */
};

/* Nearest to the eye that a direction may come to a pinhole's image plane: 84 deg off the axis. */
#define MIN_FORWARD 0.1

static struct vertex make_vertex(const struct drawing *d, int32_t row, int32_t column) {
    struct vertex x = {.sample = row * d->grid->columns + column, .state = VERTEX_NONE};
    const struct polar_sample *s = d->grid->samples + x.sample;
    if (is_absent(s))
        return x;
    const struct sample_view *view = d->view;
    double along_axis = 1.0;
    if (view->kind == SAMPLE_VIEW_PINHOLE) {
        const struct vec3 ray = mat3_tmulv(&view->station_from_cam, sample_direction(s));
        if (!(ray.z > MIN_FORWARD))
            return x;
        along_axis = ray.z;
        x.u_px = view->camera.fx_px * ray.x / ray.z + view->camera.cx_px;
        x.v_px = view->camera.fy_px * ray.y / ray.z + view->camera.cy_px;
    } else {
        x.u_px = (view->left_rad - s->azimuth_rad) / view->step_rad_per_px;
        x.v_px = (view->top_rad - s->elevation_rad) / view->step_rad_per_px;
    }
    x.state = is_valid(s) ? VERTEX_SURFACE : VERTEX_EMPTY;
    if (x.state == VERTEX_SURFACE)
        x.inverse_per_m = 1.0 / (along_axis * (double)s->range_m);
    else
        x.flags = s->flags & SAMPLE_NO_RETURN ? PHOTO_NO_RETURN : PHOTO_DROPPED;
    return x;
}

static void put(const struct drawing *d, int32_t u, int32_t v, const struct vertex *nearest,
                double inverse_per_m, uint8_t flags) {
    const size_t i = (size_t)v * (size_t)d->view->width_px + (size_t)u;
    float *held = d->picture.inverse_per_m + i;
    if (nearest->state == VERTEX_SURFACE) {
        if (!isnan(*held) && !((float)inverse_per_m > *held))
            return;
        *held = (float)inverse_per_m;
    } else if (!isnan(*held) || d->picture.sample[i] >= 0) {
        return;
    }
    d->picture.flags[i] = nearest->state == VERTEX_SURFACE ? flags : nearest->flags;
    d->picture.sample[i] = nearest->sample;
}

static double square_distance(const struct vertex *a, double u, double v) {
    return (a->u_px - u) * (a->u_px - u) + (a->v_px - v) * (a->v_px - v);
}

/* Pixel centres inside the triangle. `smooth`: one surface, 1 / Z is linear; else the nearest
 * corner. */
static void draw_triangle(const struct drawing *d, const struct vertex *a, const struct vertex *b,
                          const struct vertex *c, bool smooth) {
    const struct sample_view *view = d->view;
    const double area =
        (b->u_px - a->u_px) * (c->v_px - a->v_px) - (c->u_px - a->u_px) * (b->v_px - a->v_px);
    if (!(fabs(area) > 1e-12))
        return;
    const double u_low = fmax(0.0, ceil(fmin(a->u_px, fmin(b->u_px, c->u_px))));
    const double v_low = fmax(0.0, ceil(fmin(a->v_px, fmin(b->v_px, c->v_px))));
    const double u_high = fmin(view->width_px - 1.0, floor(fmax(a->u_px, fmax(b->u_px, c->u_px))));
    const double v_high = fmin(view->height_px - 1.0, floor(fmax(a->v_px, fmax(b->v_px, c->v_px))));
    const double slack =
        -1e-9; /* a pixel centre on an edge belongs to both sides, not to neither */
    for (double v = v_low; v <= v_high; v += 1.0)
        for (double u = u_low; u <= u_high; u += 1.0) {
            const double wb =
                ((u - a->u_px) * (c->v_px - a->v_px) - (c->u_px - a->u_px) * (v - a->v_px)) / area;
            const double wc =
                ((b->u_px - a->u_px) * (v - a->v_px) - (u - a->u_px) * (b->v_px - a->v_px)) / area;
            const double wa = 1.0 - wb - wc;
            if (wa < slack || wb < slack || wc < slack)
                continue;
            const double da = square_distance(a, u, v), db = square_distance(b, u, v);
            const double dc = square_distance(c, u, v);
            const struct vertex *nearest = da <= db && da <= dc ? a : db <= dc ? b : c;
            const double inverse =
                smooth ? wa * a->inverse_per_m + wb * b->inverse_per_m + wc * c->inverse_per_m
                       : nearest->inverse_per_m;
            put(d, (int32_t)u, (int32_t)v, nearest, inverse,
                (uint8_t)(smooth ? PHOTO_FILLED : PHOTO_FILLED | PHOTO_SILHOUETTE));
        }
}

/* The corners q[0] q[1] / q[2] q[3] as one or two triangles; link: smooth[0] top, [1] left, [2]
 * right, [3] bottom. */
static void draw_corners(const struct drawing *d, const struct vertex q[4], const bool link[4]) {
    static const int triangles[4][3] = {
        {0, 1, 2}, {3, 2, 1}, {1, 0, 3}, {2, 3, 0}}; /* first: the
                                                       right angle */
    const bool smooth[4] = {link[0] && link[1], link[2] && link[3], link[0] && link[2],
                            link[1] && link[3]};
    int missing = -1, count = 0;
    for (int i = 0; i < 4; i++) {
        count += q[i].state != VERTEX_NONE;
        if (q[i].state == VERTEX_NONE)
            missing = i;
    }
    int first = 0, second = 1; /* split between 1 and 2 */
    if (count == 3) {
        static const int without[4] = {1, 3, 2, 0}; /* the triangle that has not that corner */
        first = second = without[missing];
    } else if (count < 3) {
        return;
    } else if (smooth[2] + smooth[3] > smooth[0] + smooth[1] ||
               (smooth[2] + smooth[3] == smooth[0] + smooth[1] &&
                fabs(q[0].inverse_per_m - q[3].inverse_per_m) <
                    fabs(q[1].inverse_per_m - q[2].inverse_per_m))) {
        first = 2;
        second = 3;
    }
    for (int t = first; t <= second; t++)
        draw_triangle(d, &q[triangles[t][0]], &q[triangles[t][1]], &q[triangles[t][2]], smooth[t]);
}

/* A panorama is a ring: puts the corners side by side and draws them again one turn further where
 * they stand across its seam. False if they are too far apart to be neighbours. */
static bool unroll(const struct drawing *d, struct vertex q[4]) {
    const double turn_px = 2.0 * pi / d->view->step_rad_per_px;
    double anchor = NAN;
    for (int i = 0; i < 4; i++) {
        if (q[i].state == VERTEX_NONE)
            continue;
        if (isnan(anchor))
            anchor = q[i].u_px - turn_px * floor(q[i].u_px / turn_px);
        q[i].u_px -= turn_px * round((q[i].u_px - anchor) / turn_px);
        if (fabs(q[i].u_px - anchor) > 0.25 * turn_px)
            return false; /* a pole */
    }
    return true;
}

static void draw_cell(const struct drawing *d, int32_t row, int32_t column) {
    struct vertex q[4];
    for (int i = 0; i < 4; i++)
        q[i] = make_vertex(d, row + i / 2, column + i % 2);
    static const int edges[4][2] = {{0, 1}, {0, 2}, {1, 3}, {2, 3}};
    for (int i = 0; i < 4; i++) {
        const struct vertex *a = &q[edges[i][0]], *b = &q[edges[i][1]];
        if (a->state == VERTEX_NONE || b->state == VERTEX_NONE)
            continue;
        const double limit = SPACINGS_MAX * (i == 0 || i == 3 ? d->spacing.along_row_rad
                                                              : d->spacing.along_column_rad);
        if (!(vec3_norm(vec3_sub(sample_direction(d->grid->samples + a->sample),
                                 sample_direction(d->grid->samples + b->sample))) <= limit))
            return;
    }
    const uint8_t *k = d->links + (ptrdiff_t)row * d->grid->columns + column;
    const bool link[4] = {k[0] & LINK_RIGHT, k[0] & LINK_DOWN, k[1] & LINK_DOWN,
                          k[d->grid->columns] & LINK_RIGHT};
    if (d->view->kind == SAMPLE_VIEW_PINHOLE) {
        draw_corners(d, q, link);
        return;
    }
    if (!unroll(d, q))
        return;
    const double turn_px = 2.0 * pi / d->view->step_rad_per_px;
    for (int turn = -1; turn <= 1; turn++) {
        struct vertex shifted[4];
        for (int i = 0; i < 4; i++) {
            shifted[i] = q[i];
            shifted[i].u_px += turn * turn_px;
        }
        draw_corners(d, shifted, link);
    }
}

/* The pixel that a sample itself falls into: no longer filled from neighbours, or set if nothing
 * drew it. */
static void draw_sample(const struct drawing *d, int32_t row, int32_t column) {
    struct vertex x = make_vertex(d, row, column);
    if (x.state == VERTEX_NONE)
        return;
    if (d->view->kind == SAMPLE_VIEW_PANORAMA) {
        const double turn_px = 2.0 * pi / d->view->step_rad_per_px;
        x.u_px -= turn_px * floor((x.u_px + 0.5) / turn_px);
    }
    const double u = floor(x.u_px + 0.5), v = floor(x.v_px + 0.5);
    if (!(u >= 0.0 && v >= 0.0 && u < d->view->width_px && v < d->view->height_px))
        return;
    const size_t i = (size_t)v * (size_t)d->view->width_px + (size_t)u;
    if (d->picture.sample[i] < 0 ||
        (isnan(d->picture.inverse_per_m[i]) && x.state == VERTEX_SURFACE))
        put(d, (int32_t)u, (int32_t)v, &x, x.inverse_per_m, 0);
    else if (d->picture.sample[i] == x.sample)
        d->picture.flags[i] = (uint8_t)(d->picture.flags[i] & ~PHOTO_FILLED);
}

static void draw_all(const struct drawing *d) {
    const size_t n = (size_t)d->view->width_px * (size_t)d->view->height_px;
    for (size_t i = 0; i < n; i++) {
        d->picture.inverse_per_m[i] = NAN;
        d->picture.flags[i] = 0;
        d->picture.sample[i] = -1;
    }
    for (int32_t row = 0; row + 1 < d->grid->rows; row++)
        for (int32_t column = 0; column + 1 < d->grid->columns; column++)
            draw_cell(d, row, column);
    for (int32_t row = 0; row < d->grid->rows; row++)
        for (int32_t column = 0; column < d->grid->columns; column++)
            draw_sample(d, row, column);
}

enum st sample_grid_draw(const struct sample_grid *grid, const struct sample_view *view,
                         const struct sample_draw_options *options,
                         struct sample_picture *out_picture, struct errctx *err) {
    if (view->width_px < 1 || view->height_px < 1 || view->width_px > IMAGE_MAX_SIDE_PX ||
        view->height_px > IMAGE_MAX_SIDE_PX ||
        (int64_t)view->width_px * view->height_px > IMAGE_MAX_PIXELS)
        return errctx_set(err, ST_INVALID, "a picture of %d x %d pixels is out of bounds",
                          view->width_px, view->height_px);
    if (view->kind == SAMPLE_VIEW_PANORAMA && !(view->step_rad_per_px > 0.0))
        return errctx_set(err, ST_INVALID, "a panorama needs a pixel size");
    const size_t n = (size_t)view->width_px * (size_t)view->height_px;
    const size_t places = (size_t)grid->rows * (size_t)grid->columns;
    struct drawing d = {.grid = grid, .view = view, .picture = *out_picture};
    void *scratch[4] = {NULL, NULL, NULL, NULL};
    enum st st = sample_grid_spacing(grid, &d.spacing);
    if (!st && (!(scratch[0] = calloc(places ? places : 1, 1)) ||
                (!d.picture.inverse_per_m && !(scratch[1] = malloc(n * sizeof(float)))) ||
                (!d.picture.flags && !(scratch[2] = malloc(n))) ||
                (!d.picture.sample && !(scratch[3] = malloc(n * sizeof(int32_t))))))
        st = ST_NOMEM;
    if (st) {
        st = errctx_set(err, st, "no memory to draw %zu samples", places);
        goto out;
    }
    d.links = scratch[0];
    if (scratch[1])
        d.picture.inverse_per_m = scratch[1];
    if (scratch[2])
        d.picture.flags = scratch[2];
    if (scratch[3])
        d.picture.sample = scratch[3];
    link_samples(grid, options, d.links);
    draw_all(&d);
out:
    for (int i = 0; i < 4; i++)
        free(scratch[i]);
    return st;
}
