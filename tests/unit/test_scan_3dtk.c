/* 3DTK scans: grid from the points alone, handedness, no returns, refusals. */
#include "base/sample_grid.h"
#include "import/scan_3dtk.h"
#include "tests/support/cmocka_all.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;

enum { ROWS = 23, COLUMNS = 40 };

struct maker {
    double row_jitter_rad; /* rows not evenly spaced */
    int leave_out;         /* every n-th point is missing from the file; 0: none */
    bool intensity;
};

static double row_angle(const struct maker *m, int row) {
    return (-40.0 + 4.1 * row) * pi / 180.0 + m->row_jitter_rad * sin(7.0 * row);
}

/* 3DTK coordinates, cm, of a scanner whose axis is x: as the real one. */
static void point_cm(const struct maker *m, int row, int column, double range_cm, double out[3]) {
    const double t = (0.5 + 4.2 * column) * pi / 180.0, f = row_angle(m, row);
    out[0] = range_cm * cos(t);
    out[1] = range_cm * sin(t) * sin(f);
    out[2] = range_cm * sin(t) * cos(f);
}

static double range_cm(int row, int column) {
    return (row + column) % 9 == 4     ? 3276.7
           : (row * column) % 11 == 10 ? 3276.3
                                       : 200.0 + 7.0 * row + column;
}

/* The text of a .3d file, malloc'ed. */
static char *make_text(const struct maker *m, size_t *out_size) {
    char *text = malloc(ROWS * COLUMNS * 80);
    size_t n = 0;
    assert_non_null(text);
    for (int row = 0; row < ROWS; row++)
        for (int column = 0; column < COLUMNS; column++) {
            double p[3];
            if (m->leave_out && (row * COLUMNS + column) % m->leave_out == 3)
                continue;
            point_cm(m, row, column, range_cm(row, column), p);
            n += (size_t)sprintf(text + n, "%.9g %.9g %.9g", p[0], p[1], p[2]);
            n += (size_t)sprintf(text + n, m->intensity ? " %d\n" : "\n", column);
        }
    *out_size = n;
    return text;
}

static void parse(const struct maker *m, struct scan *scan, struct turned_grid *grid) {
    struct errctx err = {0};
    const struct scan_3dtk_options options = {0};
    size_t size = 0;
    char *text = make_text(m, &size);
    if (scan_3dtk_parse(text, size, &options, scan, grid, &err))
        fail_msg("%s", err.text);
    free(text);
}

/* Largest distance between a point of the file, in our frame, and its place in the grid at its
 * range. */
static double reproduction_error(const struct maker *m, const struct scan *scan,
                                 const struct turned_grid *grid) {
    double largest = 0;
    size_t i = 0;
    for (int row = 0; row < ROWS; row++)
        for (int column = 0; column < COLUMNS; column++) {
            if (m->leave_out && (row * COLUMNS + column) % m->leave_out == 3)
                continue;
            const struct polar_sample *s = scan->samples + i++;
            assert_int_equal(s->row, row);
            assert_int_equal(s->column, column);
            double p[3];
            point_cm(m, row, column, range_cm(row, column), p);
            const struct vec3 truth = {0.01 * p[0], 0.01 * p[2], 0.01 * p[1]};
            const struct vec3 place =
                vec3_scale(turned_grid_direction(grid, s->row, s->column), vec3_norm(truth));
            const struct vec3 polar = vec3_scale(sample_direction(s), vec3_norm(truth));
            largest = fmax(largest, vec3_norm(vec3_sub(place, truth)));
            largest = fmax(largest, vec3_norm(vec3_sub(polar, truth)));
        }
    assert_int_equal(i, scan->count);
    return largest;
}

static void finds_rows_columns_and_ranges_to_a_tenth_of_a_millimetre(void **state) {
    (void)state;
    const struct maker makers[] = {{0}, {.leave_out = 17}, {.row_jitter_rad = 0.002}};
    for (size_t i = 0; i < sizeof makers / sizeof makers[0]; i++) {
        struct scan scan;
        struct turned_grid grid;
        parse(&makers[i], &scan, &grid);
        assert_int_equal(grid.rows, ROWS);
        assert_int_equal(grid.columns, COLUMNS);
        assert_true(fabs(grid.column_step_rad - 4.2 * pi / 180.0) < 1e-9);
        assert_true(fabs(grid.column_zero_rad - 0.5 * pi / 180.0) < 1e-7);
        assert_true(grid.even_rows == (makers[i].row_jitter_rad == 0.0));
        assert_true(reproduction_error(&makers[i], &scan, &grid) < 1e-4);
        assert_true((grid.even_rows ? grid.even_error_m : grid.table_error_m) < 1e-4);
        scan_destroy(&scan);
        turned_grid_fini(&grid);
    }
}

static void the_instruments_top_codes_are_no_returns(void **state) {
    (void)state;
    struct scan scan;
    const struct maker plain = {0};
    parse(&plain, &scan, NULL);
    for (size_t i = 0; i < scan.count; i++) {
        const struct polar_sample *s = scan.samples + i;
        const double r = range_cm((int)s->row, (int)s->column);
        assert_int_equal((s->flags & SAMPLE_NO_RETURN) != 0, r > 3000.0);
        assert_true(r > 3000.0 ? isnan(s->range_m) : fabs((double)s->range_m - 0.01 * r) < 1e-5);
        assert_int_equal(s->flags & SAMPLE_INTENSITY, 0);
    }
    scan_destroy(&scan);
}

static void scales_intensity_to_one(void **state) {
    (void)state;
    struct scan scan;
    const struct maker with = {.intensity = true};
    parse(&with, &scan, NULL);
    for (size_t i = 0; i < scan.count; i++) {
        assert_true(scan.samples[i].flags & SAMPLE_INTENSITY);
        assert_true(fabsf(scan.samples[i].intensity -
                          (float)scan.samples[i].column / (COLUMNS - 1)) < 1e-6f);
    }
    scan_destroy(&scan);
}

static struct pose parse_pose(const char *text) {
    struct pose pose;
    struct errctx err = {0};
    if (scan_3dtk_parse_pose(text, strlen(text), &pose, &err))
        fail_msg("%s", err.text);
    return pose;
}

/* A point of the left-handed world must land where the exchange of y and z puts it. */
static void poses_are_right_handed_and_in_metres(void **state) {
    (void)state;
    const struct pose place = parse_pose("100 20 -300\n0 0 0\n");
    assert_true(fabs(place.t_m.x - 1.0) < 1e-15 && fabs(place.t_m.y + 3.0) < 1e-15 &&
                fabs(place.t_m.z - 0.2) < 1e-15);
    /* Ry(90 deg), left-handed matrix of 3DTK: (x, y, z) -> (z, y, -x). Ours: (x, y, z) -> (y, -x,
     * z). */
    const struct pose turn = parse_pose("0 0 0 0 90 0");
    const struct vec3 p = pose_apply(&turn, vec3_make(1, 2, 3));
    assert_true(fabs(p.x - 2) < 1e-12 && fabs(p.y + 1) < 1e-12 && fabs(p.z - 3) < 1e-12);
    const struct pose any = parse_pose("1 2 3 10 20 30");
    assert_true(pose_orthonormality_error(&any.r) < 1e-14);
    assert_true(mat3_det(&any.r) > 0.0);
}

/* Rx Ry Rz in that order: a -> b -> c from the right. */
static void euler_angles_apply_z_first(void **state) {
    (void)state;
    const struct pose pose = parse_pose("0 0 0 90 0 90");
    /* 3DTK: z turns x to y, then x turns y to z: x -> z. Ours: x -> y. */
    const struct vec3 p = pose_apply(&pose, vec3_make(1, 0, 0));
    assert_true(fabs(p.x) < 1e-12 && fabs(p.y - 1) < 1e-12 && fabs(p.z) < 1e-12);
}

static void refusals_say_which_line(void **state) {
    (void)state;
    static const struct {
        const char *text, *message;
    } cases[] = {
        {"", "no sample"},
        {"1 2\n", "line 1 has 2 numbers instead of 3"},
        {"1 2 3\n4 5 x\n", "line 2 is not 'x y z [intensity]'"},
        {"1 2 3 4\n4 5 6\n", "line 2 has 3 numbers instead of 4"},
        {"1 2 3 4 5\n", "line 1 is not"},
        {"1 2 1e300\n", "line 1: 1e+300 cm is no coordinate"},
        {"1 2 nan\n", "line 1 is not"},
        {"1 2 0x10\n", "line 1 is not"},
        {"1 2 3\n4 5 6\n7 8 10\n", "too short for a grid"},
        {"0 0 0\n0 0 0\n", "point 1 has no direction"},
    };
    const struct scan_3dtk_options options = {0};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct scan scan = {0};
        struct errctx err = {0};
        const enum st st =
            scan_3dtk_parse(cases[i].text, strlen(cases[i].text), &options, &scan, NULL, &err);
        assert_true(st == ST_FORMAT || st == ST_UNSUPPORTED);
        if (!strstr(err.text, cases[i].message))
            fail_msg("'%s' is not in '%s'", cases[i].message, err.text);
        assert_null(scan.samples);
    }
}

static void refuses_points_that_make_no_grid(void **state) {
    (void)state;
    char text[64 * 200];
    size_t n = 0;
    uint32_t seed = 5;
    for (int i = 0; i < 200; i++) {
        double v[3];
        for (int k = 0; k < 3; k++) {
            seed = seed * 1664525u + 1013904223u;
            v[k] = (double)(seed >> 8) / 65536.0 - 128.0;
        }
        n += (size_t)sprintf(text + n, "%g %g %g\n", v[0], v[1], v[2]);
    }
    struct scan scan = {0};
    struct errctx err = {0};
    const struct scan_3dtk_options options = {0};
    assert_int_equal(scan_3dtk_parse(text, n, &options, &scan, NULL, &err), ST_UNSUPPORTED);
    assert_true(strlen(err.text) > 10);
}

static void pose_refusals_say_what_is_missing(void **state) {
    (void)state;
    static const char *const texts[] = {
        "", "1 2 3\n4 5", "1 2 3 4 5 6 7", "1 2 3 a b c", "1 2 3 4 5 inf", "1 2 3 4 5 1e99"};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        struct pose pose;
        struct errctx err = {0};
        assert_int_equal(scan_3dtk_parse_pose(texts[i], strlen(texts[i]), &pose, &err), ST_FORMAT);
        assert_non_null(strstr(err.text, "line"));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(finds_rows_columns_and_ranges_to_a_tenth_of_a_millimetre),
        cmocka_unit_test(the_instruments_top_codes_are_no_returns),
        cmocka_unit_test(scales_intensity_to_one),
        cmocka_unit_test(poses_are_right_handed_and_in_metres),
        cmocka_unit_test(euler_angles_apply_z_first),
        cmocka_unit_test(refusals_say_which_line),
        cmocka_unit_test(refuses_points_that_make_no_grid),
        cmocka_unit_test(pose_refusals_say_what_is_missing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
