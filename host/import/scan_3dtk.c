#include "import/scan_3dtk.h"

#include "base/sample_grid.h"
#include "import/number_text.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;

#define CM                0.01
#define NO_RETURN_M       32.767
#define NO_RETURN_CODES_M 0.009 /* the codes 32758..32767 of a 15-bit word of millimetres */
#define GRID_TOLERANCE_M  1e-4
/* "0 0 0\n": the shortest line of a sample. */
enum { LINE_BYTES_MIN = 6 };
/* Beyond this a coordinate is no length but garbage. */
#define COORDINATE_MAX_CM 1e7

struct points {
    struct vec3 *p_m;
    float *intensity;
    size_t count;
    size_t columns; /* 3 or 4 */
};

static enum st parse_line(struct number_text *text, struct points *points, struct errctx *err) {
    double v[4] = {0, 0, 0, 0};
    size_t n = 0;
    while (!number_text_at_line_end(text)) {
        if (n == 4 || !number_text_double(text, &v[n]))
            return errctx_set(err, ST_FORMAT, "line %zu is not 'x y z [intensity]'", text->line);
        n++;
    }
    if (points->columns == 0)
        points->columns = n;
    if (n < 3 || n != points->columns)
        return errctx_set(err, ST_FORMAT, "line %zu has %zu numbers instead of %zu", text->line, n,
                          points->columns < 3 ? 3 : points->columns);
    for (int i = 0; i < 3; i++)
        if (fabs(v[i]) > COORDINATE_MAX_CM)
            return errctx_set(err, ST_FORMAT, "line %zu: %g cm is no coordinate", text->line, v[i]);
    points->p_m[points->count] = vec3_make(CM * v[0], CM * v[2], CM * v[1]);
    points->intensity[points->count++] = (float)v[3];
    return ST_OK;
}

static enum st parse_points(const void *data, size_t size, struct points *points,
                            struct errctx *err) {
    const size_t capacity = size / LINE_BYTES_MIN + 1;
    if (capacity > SCAN_MAX_SAMPLES)
        return errctx_set(err, ST_NOMEM, "%zu bytes are more than one scan may have", size);
    points->p_m = malloc(capacity * sizeof *points->p_m);
    points->intensity = malloc(capacity * sizeof *points->intensity);
    if (!points->p_m || !points->intensity)
        return errctx_set(err, ST_NOMEM, "no memory for %zu samples", capacity);
    struct number_text text = number_text_start(data, size);
    while (!number_text_at_end(&text)) {
        if (*text.at == '#') {
            number_text_next_line(&text);
            continue;
        }
        enum st st = parse_line(&text, points, err);
        if (st)
            return st;
        number_text_next_line(&text);
    }
    if (points->count == 0)
        return errctx_set(err, ST_FORMAT, "there is no sample in it");
    return ST_OK;
}

static void fill_samples(const struct points *points, double no_return_m, struct scan *scan) {
    float brightest = 0.0f;
    for (size_t i = 0; points->columns == 4 && i < points->count; i++)
        brightest = fmaxf(brightest, points->intensity[i]);
    for (size_t i = 0; i < points->count; i++) {
        struct polar_sample *s = scan->samples + i;
        *s = sample_from_point(points->p_m[i]);
        if (vec3_norm(points->p_m[i]) >= no_return_m - NO_RETURN_CODES_M) {
            s->flags |= SAMPLE_NO_RETURN;
            s->range_m = NAN;
        }
        if (brightest > 0.0f && points->intensity[i] >= 0.0f) {
            s->flags |= SAMPLE_INTENSITY;
            s->intensity = points->intensity[i] / brightest;
        }
    }
}

static void write_meta(const struct turned_grid *g, struct scan *scan) {
    (void)snprintf(scan->meta, sizeof scan->meta,
                   "{\"grid\":\"turned line scanner\",\"rows\":%d,\"columns\":%d,"
                   "\"axis\":[%.9g,%.9g,%.9g],\"column_step_deg\":%.9g,\"row_step_deg\":%.9g,"
                   "\"even_rows\":%s,\"even_rows_error_m\":%.3g,\"row_table_error_m\":%.3g}",
                   g->rows, g->columns, g->axis.x, g->axis.y, g->axis.z,
                   g->column_step_rad * 180.0 / pi, g->row_step_rad * 180.0 / pi,
                   g->even_rows ? "true" : "false", g->even_error_m, g->table_error_m);
}

enum st scan_3dtk_parse(const void *data, size_t size, const struct scan_3dtk_options *options,
                        struct scan *out_scan, struct turned_grid *out_grid, struct errctx *err) {
    const double no_return_m = options->no_return_m > 0.0 ? options->no_return_m : NO_RETURN_M;
    const double tolerance_m = options->tolerance_m > 0.0 ? options->tolerance_m : GRID_TOLERANCE_M;
    struct points points = {0};
    struct scan scan;
    memset(&scan, 0, sizeof scan);
    struct turned_grid grid;
    memset(&grid, 0, sizeof grid);
    enum st st = parse_points(data, size, &points, err);
    if (st)
        goto out;
    scan.samples = calloc(points.count, sizeof *scan.samples);
    if (!scan.samples) {
        st = errctx_set(err, ST_NOMEM, "no memory for %zu samples", points.count);
        goto out;
    }
    fill_samples(&points, no_return_m, &scan);
    st = turned_grid_recover(points.p_m, points.count, tolerance_m, scan.samples, &grid, err);
    if (st)
        goto out;
    scan.count = points.count;
    scan.rows = grid.rows;
    scan.columns = grid.columns;
    scan.world_from_station = pose_identity();
    write_meta(&grid, &scan);
out:
    free(points.p_m);
    free(points.intensity);
    if (st) {
        scan_destroy(&scan);
        return st;
    }
    *out_scan = scan;
    if (out_grid)
        *out_grid = grid;
    else
        turned_grid_fini(&grid);
    return ST_OK;
}

/* Rx(a) Ry(b) Rz(c) */
static struct mat3 euler_matrix(double a, double b, double c) {
    const struct mat3 rx = so3_exp(vec3_make(a, 0, 0)), ry = so3_exp(vec3_make(0, b, 0));
    const struct mat3 rz = so3_exp(vec3_make(0, 0, c)), rxy = mat3_mul(&rx, &ry);
    return mat3_mul(&rxy, &rz);
}

enum st scan_3dtk_parse_pose(const void *data, size_t size, struct pose *out_world_from_station,
                             struct errctx *err) {
    struct number_text text = number_text_start(data, size);
    double v[6];
    for (int i = 0; i < 6; i++) {
        if (number_text_at_end(&text) || !number_text_double(&text, &v[i]))
            return errctx_set(err, ST_FORMAT,
                              "line %zu: six numbers are wanted, x y z in cm and three angles in "
                              "degrees, number %d is missing",
                              text.line, i + 1);
        if (fabs(v[i]) > COORDINATE_MAX_CM)
            return errctx_set(err, ST_FORMAT, "line %zu: %g is out of bounds", text.line, v[i]);
    }
    if (!number_text_at_end(&text))
        return errctx_set(err, ST_FORMAT, "line %zu: more than six numbers", text.line);
    const double rad = pi / 180.0;
    const struct mat3 swap = {{1, 0, 0, 0, 0, 1, 0, 1, 0}};
    const struct mat3 left = euler_matrix(v[3] * rad, v[4] * rad, v[5] * rad);
    const struct mat3 half = mat3_mul(&swap, &left);
    out_world_from_station->r = mat3_mul(&half, &swap);
    out_world_from_station->t_m = vec3_make(CM * v[0], CM * v[2], CM * v[1]);
    return ST_OK;
}
