/* Logs of a turned line laser: a made-up wall, and refusals. */
#include "base/sample_grid.h"
#include "import/scan_fan.h"
#include "tests/support/cmocka_all.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const double rad = 3.14159265358979323846 / 180.0;
static const double wall_m = 2.5;

enum { LINES = 7, BEARINGS = 41 };

/* A wall at x = 2.5 m; the sample in the middle of line 3 has no return. */
static size_t write_wall(char *out, size_t size, const char *separator) {
    size_t n = (size_t)snprintf(out, size, "0%s0%s0", separator, separator);
    for (int b = 0; b < BEARINGS; b++)
        n += (size_t)snprintf(out + n, size - n, "%s%.6f", separator, 2.0 * (b - 20));
    for (int t = 0; t < LINES; t++) {
        n += (size_t)snprintf(out + n, size - n, "\r\n%d%s%d%s%.6f", t + 1, separator, 100 * t,
                              separator, 0.7 * t);
        for (int b = 0; b < BEARINGS; b++) {
            const double range_m = wall_m / (cos(2.0 * (b - 20) * rad) * cos(0.7 * t * rad));
            n += (size_t)snprintf(out + n, size - n, "%s%.7f", separator,
                                  t == 3 && b == 20 ? 0.0 : range_m);
        }
    }
    return n;
}

static void a_wall_comes_back_as_a_wall(void **state) {
    (void)state;
    static const char *const separators[] = {", ", " ", ","};
    static char text[1 << 15];
    for (int k = 0; k < 3; k++) {
        struct scan scan;
        struct errctx err = {0};
        const size_t size = write_wall(text, sizeof text, separators[k]);
        assert_true(scan_fan_is(text, size));
        if (scan_fan_parse(text, size, &scan, &err))
            fail_msg("%s", err.text);
        assert_int_equal(scan.rows, LINES);
        assert_int_equal(scan.columns, BEARINGS);
        assert_int_equal(scan.count, LINES * BEARINGS);
        for (size_t i = 0; i < scan.count; i++) {
            const struct polar_sample *s = &scan.samples[i];
            assert_int_equal(s->row, i / BEARINGS);
            assert_int_equal(s->column, i % BEARINGS);
            if (i == 3 * BEARINGS + 20) {
                assert_int_equal(s->flags, SAMPLE_NO_RETURN);
                assert_true(isnan(s->range_m));
                continue;
            }
            const struct vec3 p = vec3_scale(sample_direction(s), (double)s->range_m);
            assert_true(fabs(p.x - wall_m) < 1e-6);
        }
        scan_destroy(&scan);
    }
}

static void refuses_what_is_no_log_and_names_the_line(void **state) {
    (void)state;
    static const struct {
        const char *text, *says;
    } cases[] = {{"", "no scan"},
                 {"0,0,0,1,2,3,4,5\n", "no line of ranges"},
                 {"0,0,0,1,2,3,4,500\n1,2,3,1,1,1,1,1\n", "line 1: number 8"},
                 {"0,0,0,1,2,3,4,5\n1,2,3,1,1,1,1\n", "line 2: number 8"},
                 {"0,0,0,1,2,3,4,5\n1,2,3,1,1,1,1,1,1\n", "line 2 has more"},
                 {"0,0,0,1,2,3,4,5\n1,2,3,1,1,x,1,1\n", "line 2: number 6"},
                 {"0,0,0,1,2,3,4,5\n1,2,3,1,1,-1,1,1\n", "line 2: number 6"},
                 {"0,0,0,1,2,3,4,5\n1,2,9999,1,1,1,1,1\n", "angle of the motor"}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct scan scan;
        struct errctx err = {0};
        assert_int_equal(scan_fan_parse(cases[i].text, strlen(cases[i].text), &scan, &err),
                         ST_FORMAT);
        if (!strstr(err.text, cases[i].says))
            fail_msg("'%s' does not say '%s'", err.text, cases[i].says);
    }
}

static void points_are_no_log(void **state) {
    (void)state;
    static const char points[] = "1 2 3\n4 5 6\n7 8 9\n";
    assert_false(scan_fan_is(points, sizeof points - 1));
    assert_false(scan_fan_is("ply\n", 4));
    assert_false(scan_fan_is("", 0));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_wall_comes_back_as_a_wall),
        cmocka_unit_test(refuses_what_is_no_log_and_names_the_line),
        cmocka_unit_test(points_are_no_log),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
