#include "import/turned_grid.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;

enum { ROW_POINTS_MIN = 8, MEDIAN_POINTS = 65536 };

/* A row ends where the direction moves by more than this many usual steps: at a column or two that
 * the file leaves out a row goes on. */
#define ROW_BREAK_STEPS 12.0
/* A point belongs to a column if it is within this share of a step of it. */
#define COLUMN_TOLERANCE 0.25

struct row {
    size_t first, count;
    struct vec3 normal; /* of the swept plane, along the sense of the sweep */
};

struct recovery {
    const struct vec3 *points_m;
    size_t count;
    struct vec3 *dir; /* [count] unit */
    struct row *rows;
    size_t row_count;
    double *angle; /* [count] t */
    double step_rad;
};

static double angle_between(struct vec3 a, struct vec3 b) {
    return atan2(vec3_norm(vec3_cross(a, b)), vec3_dot(a, b));
}

static int by_value(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static enum st median_step(struct recovery *r) {
    double *steps = malloc(MEDIAN_POINTS * sizeof *steps);
    if (!steps)
        return ST_NOMEM;
    const size_t stride = r->count / MEDIAN_POINTS + 1;
    size_t n = 0;
    for (size_t i = 0; i + 1 < r->count; i += stride)
        steps[n++] = angle_between(r->dir[i], r->dir[i + 1]);
    qsort(steps, n, sizeof *steps, by_value);
    r->step_rad = n ? steps[n / 2] : 0.0;
    free(steps);
    return ST_OK;
}

/* Cuts the points into rows; rows too short to span a plane are refused. */
static enum st cut_rows(struct recovery *r, struct errctx *err) {
    size_t capacity = 0, first = 0;
    for (size_t i = 1; i <= r->count; i++) {
        if (i < r->count &&
            angle_between(r->dir[i - 1], r->dir[i]) <= ROW_BREAK_STEPS * r->step_rad)
            continue;
        if (i - first < ROW_POINTS_MIN)
            return errctx_set(err, ST_UNSUPPORTED,
                              "points %zu to %zu: a row of %zu points is too short for a grid",
                              first + 1, i, i - first);
        if (r->row_count == capacity) {
            capacity = capacity ? 2 * capacity : 256;
            struct row *more = realloc(r->rows, capacity * sizeof *more);
            if (!more)
                return errctx_set(err, ST_NOMEM, "no memory for %zu rows", capacity);
            r->rows = more;
        }
        r->rows[r->row_count++] = (struct row){.first = first, .count = i - first};
        first = i;
    }
    if (r->row_count < 2)
        return errctx_set(err, ST_UNSUPPORTED, "%zu row of points is too few for a grid",
                          r->row_count);
    return ST_OK;
}

/* Row normals from the sum of cross products, the axis from normals a quarter of the rows apart. */
static enum st find_axis(struct recovery *r, struct turned_grid *grid, struct errctx *err) {
    for (size_t k = 0; k < r->row_count; k++) {
        struct vec3 sum = {0, 0, 0};
        for (size_t i = r->rows[k].first; i + 1 < r->rows[k].first + r->rows[k].count; i++)
            sum = vec3_add(sum, vec3_cross(r->dir[i], r->dir[i + 1]));
        r->rows[k].normal = vec3_unit(sum);
    }
    const size_t apart = r->row_count / 4 ? r->row_count / 4 : 1;
    struct vec3 axis = {0, 0, 0}, start = {0, 0, 0};
    for (size_t k = 0; k + apart < r->row_count; k++)
        axis = vec3_add(axis, vec3_cross(r->rows[k].normal, r->rows[k + apart].normal));
    for (size_t k = 0; k < r->row_count; k++)
        start = vec3_add(start, r->dir[r->rows[k].first]);
    if (!vec3_is_finite(axis) || !(vec3_norm(axis) > 1e-9))
        return errctx_set(err, ST_UNSUPPORTED, "the rows do not turn about an axis");
    axis = vec3_unit(axis);
    if (vec3_dot(axis, start) < 0.0)
        axis = vec3_scale(axis, -1.0);
    /* e2 lies in the first row's plane, on the side where the beam sweeps: n = a x e2. */
    const struct vec3 e2 = vec3_cross(r->rows[0].normal, axis);
    if (!(vec3_norm(e2) > 1e-6))
        return errctx_set(err, ST_UNSUPPORTED, "the first row does not contain the axis");
    grid->axis = axis;
    grid->e2 = vec3_unit(e2);
    grid->e3 = vec3_cross(axis, grid->e2);
    return ST_OK;
}

/* Turn of each row's plane about the axis, unwrapped. */
static void measure_rows(const struct recovery *r, struct turned_grid *grid) {
    double before = 0.0;
    for (size_t k = 0; k < r->row_count; k++) {
        const struct vec3 side = vec3_cross(r->rows[k].normal, grid->axis);
        double f = atan2(vec3_dot(side, grid->e3), vec3_dot(side, grid->e2));
        f += 2.0 * pi * round((before - f) / (2.0 * pi));
        grid->row_rad[k] = f;
        before = f;
    }
}

/* Intercept and slope of y over x = 0..n-1. */
static void fit_line(const double *y, size_t n, double *out_zero, double *out_step) {
    const double mean_x = 0.5 * (double)(n - 1);
    double mean_y = 0.0, xy = 0.0, xx = 0.0;
    for (size_t i = 0; i < n; i++)
        mean_y += y[i] / (double)n;
    for (size_t i = 0; i < n; i++) {
        xy += ((double)i - mean_x) * (y[i] - mean_y);
        xx += ((double)i - mean_x) * ((double)i - mean_x);
    }
    *out_step = xy / xx;
    *out_zero = mean_y - *out_step * mean_x;
}

static void measure_columns(const struct recovery *r, const struct turned_grid *grid) {
    for (size_t k = 0; k < r->row_count; k++) {
        const struct vec3 side =
            vec3_madd(vec3_scale(grid->e2, cos(grid->row_rad[k])), grid->e3, sin(grid->row_rad[k]));
        double before = 0.0;
        for (size_t i = r->rows[k].first; i < r->rows[k].first + r->rows[k].count; i++) {
            double t = atan2(vec3_dot(r->dir[i], side), vec3_dot(r->dir[i], grid->axis));
            if (i > r->rows[k].first)
                t += 2.0 * pi * round((before - t) / (2.0 * pi));
            r->angle[i] = t;
            before = t;
        }
    }
}

/* Zero and step of the columns: from the step as seen between neighbours, then least squares over
 * all. */
static enum st fit_columns(const struct recovery *r, struct turned_grid *grid, struct errctx *err) {
    double low = INFINITY, high = -INFINITY, step = r->step_rad;
    for (size_t i = 0; i < r->count; i++) {
        low = fmin(low, r->angle[i]);
        high = fmax(high, r->angle[i]);
    }
    if (!(step > 0.0) || !((high - low) / step < 1e6))
        return errctx_set(err, ST_UNSUPPORTED, "the points of a row do not advance");
    double zero = low;
    for (int pass = 0; pass < 3; pass++) {
        double sx = 0, sy = 0, sxx = 0, sxy = 0;
        const double n = (double)r->count;
        for (size_t i = 0; i < r->count; i++) {
            const double c = round((r->angle[i] - zero) / step);
            sx += c;
            sy += r->angle[i] - low;
            sxx += c * c;
            sxy += c * (r->angle[i] - low);
        }
        step = (n * sxy - sx * sy) / (n * sxx - sx * sx);
        zero = low + (sy - step * sx) / n;
    }
    if (!(step > 0.0))
        return errctx_set(err, ST_UNSUPPORTED, "the points of a row do not advance");
    grid->column_zero_rad = zero;
    grid->column_step_rad = step;
    return ST_OK;
}

static enum st place_points(const struct recovery *r, struct turned_grid *grid,
                            struct polar_sample *samples, struct errctx *err) {
    double c_low = INFINITY, c_high = -INFINITY;
    for (size_t i = 0; i < r->count; i++) {
        const double c = (r->angle[i] - grid->column_zero_rad) / grid->column_step_rad;
        if (fabs(c - round(c)) > COLUMN_TOLERANCE)
            return errctx_set(err, ST_UNSUPPORTED,
                              "point %zu is %.2f steps off the grid of %.4f deg", i + 1,
                              fabs(c - round(c)), grid->column_step_rad * 180.0 / pi);
        c_low = fmin(c_low, round(c));
        c_high = fmax(c_high, round(c));
    }
    grid->column_zero_rad += c_low * grid->column_step_rad;
    grid->rows = (int32_t)r->row_count;
    grid->columns = (int32_t)(c_high - c_low) + 1;
    for (size_t k = 0; k < r->row_count; k++)
        for (size_t i = r->rows[k].first; i < r->rows[k].first + r->rows[k].count; i++) {
            samples[i].row = (uint32_t)k;
            samples[i].column =
                (uint32_t)lround((r->angle[i] - grid->column_zero_rad) / grid->column_step_rad);
            if (i > r->rows[k].first && samples[i].column <= samples[i - 1].column)
                return errctx_set(err, ST_UNSUPPORTED, "points %zu and %zu fall on one place", i,
                                  i + 1);
        }
    return ST_OK;
}

static double reproduction_error(const struct recovery *r, const struct turned_grid *grid,
                                 const struct polar_sample *samples) {
    double largest = 0.0;
    for (size_t i = 0; i < r->count; i++) {
        const struct vec3 dir = turned_grid_direction(grid, samples[i].row, samples[i].column);
        const struct vec3 p = vec3_scale(dir, vec3_norm(r->points_m[i]));
        largest = fmax(largest, vec3_norm(vec3_sub(p, r->points_m[i])));
    }
    return largest;
}

struct vec3 turned_grid_direction(const struct turned_grid *grid, uint32_t row, uint32_t column) {
    const double t = grid->column_zero_rad + (double)column * grid->column_step_rad;
    const double f = grid->even_rows ? grid->row_zero_rad + (double)row * grid->row_step_rad
                                     : grid->row_rad[row];
    const struct vec3 side = vec3_madd(vec3_scale(grid->e2, cos(f)), grid->e3, sin(f));
    return vec3_madd(vec3_scale(grid->axis, cos(t)), side, sin(t));
}

void turned_grid_fini(struct turned_grid *grid) {
    if (!grid)
        return;
    free(grid->row_rad);
    memset(grid, 0, sizeof *grid);
}

static enum st recover(struct recovery *r, double tolerance_m, struct polar_sample *samples,
                       struct turned_grid *grid, struct errctx *err) {
    enum st st = median_step(r);
    if (st)
        return errctx_set(err, st, "no memory for %zu points", r->count);
    if ((st = cut_rows(r, err)) || (st = find_axis(r, grid, err)))
        return st;
    grid->row_rad = malloc(r->row_count * sizeof *grid->row_rad);
    if (!grid->row_rad)
        return errctx_set(err, ST_NOMEM, "no memory for %zu rows", r->row_count);
    measure_rows(r, grid);
    fit_line(grid->row_rad, r->row_count, &grid->row_zero_rad, &grid->row_step_rad);
    measure_columns(r, grid);
    if ((st = fit_columns(r, grid, err)) || (st = place_points(r, grid, samples, err)))
        return st;
    grid->even_rows = true;
    grid->even_error_m = reproduction_error(r, grid, samples);
    grid->even_rows = false;
    grid->table_error_m = reproduction_error(r, grid, samples);
    grid->even_rows = grid->even_error_m <= tolerance_m;
    return ST_OK;
}

enum st turned_grid_recover(const struct vec3 *points_m, size_t count, double tolerance_m,
                            struct polar_sample *samples, struct turned_grid *out_grid,
                            struct errctx *err) {
    struct recovery r = {.points_m = points_m, .count = count};
    struct turned_grid grid;
    memset(&grid, 0, sizeof grid);
    enum st st = ST_NOMEM;
    r.dir = malloc((count ? count : 1) * sizeof *r.dir);
    r.angle = malloc((count ? count : 1) * sizeof *r.angle);
    if (!r.dir || !r.angle) {
        st = errctx_set(err, st, "no memory for %zu points", count);
        goto out;
    }
    for (size_t i = 0; i < count; i++) {
        r.dir[i] = vec3_unit(points_m[i]);
        if (!vec3_is_finite(r.dir[i])) {
            st = errctx_set(err, ST_UNSUPPORTED, "point %zu has no direction", i + 1);
            goto out;
        }
    }
    st = recover(&r, tolerance_m, samples, &grid, err);
out:
    free(r.dir);
    free(r.angle);
    free(r.rows);
    if (st)
        turned_grid_fini(&grid);
    else
        *out_grid = grid;
    return st;
}
