/* Points of a spinning laser: rings of a made-up room come back, other orders stay as they are, and
 * damage is refused. */
#include "base/sample_grid.h"
#include "import/scan_spin.h"
#include "tests/support/cmocka_all.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;

enum { RINGS = 16, STEPS = 360, POINTS = RINGS * STEPS, RECORD = SCAN_SPIN_RECORD_BYTES };

static uint8_t file[(POINTS + 1) * RECORD];

static void put(size_t i, double x, double y, double z, double reflectance) {
    const float v[4] = {(float)x, (float)y, (float)z, (float)reflectance};
    memcpy(file + i * RECORD, v, sizeof v); /* the tests' machines are little-endian */
}

/* A ball of 5 m around the sensor, ring by ring from `seam_rad` on; every 7th place has no return
 * and, as in such files, no record. Gives the bytes. */
static size_t write_ball(double seam_rad, int turning, double brightest) {
    size_t n = 0;
    for (int ring = 0; ring < RINGS; ring++)
        for (int k = 0; k < STEPS; k++) {
            if ((k + ring) % 7 == 3)
                continue;
            const double az = seam_rad + turning * 2 * pi * (k + 0.5) / STEPS;
            const double el = 0.05 - 0.02 * ring;
            put(n++, 5 * cos(el) * cos(az), 5 * cos(el) * sin(az), 5 * sin(el),
                brightest * k / (STEPS - 1));
        }
    return n * RECORD;
}

static struct scan parse(size_t size) {
    struct scan scan;
    struct errctx err = {0};
    if (scan_spin_parse(file, size, &scan, &err))
        fail_msg("%s", err.text);
    return scan;
}

static void rings_and_columns_come_back_whichever_way_it_turns(void **state) {
    (void)state;
    for (int k = 0; k < 4; k++) {
        const size_t size = write_ball(k & 1 ? pi : 0, k & 2 ? -1 : 1, 1.0);
        struct scan scan = parse(size);
        assert_int_equal(scan.count, size / RECORD);
        assert_int_equal(scan.rows, RINGS);
        assert_in_range(scan.columns, STEPS, STEPS + 1);
        for (size_t i = 0; i < scan.count; i++) {
            const struct polar_sample *s = &scan.samples[i];
            assert_int_equal(s->row, lround((0.05 - s->elevation_rad) / 0.02));
            if (i && s->row == s[-1].row) /* a place without a return stays free */
                assert_int_equal(
                    s->column - s[-1].column,
                    lround(fabs(remainder(s->azimuth_rad - s[-1].azimuth_rad, 2 * pi)) * STEPS /
                           (2 * pi)));
        }
        scan_destroy(&scan);
    }
}

static void points_and_reflectances_are_those_of_the_file(void **state) {
    (void)state;
    const size_t size = write_ball(0, 1, 1.0);
    struct scan scan = parse(size);
    for (size_t i = 0; i < scan.count; i++) {
        float v[4];
        memcpy(v, file + i * RECORD, sizeof v);
        const struct vec3 p = sample_point(&scan.samples[i]);
        const struct vec3 truth = {(double)v[0], (double)v[1], (double)v[2]};
        assert_true(vec3_norm(vec3_sub(p, truth)) < 1e-6); /* the range is a float of 5 m */
        assert_true(scan.samples[i].intensity == v[3]);
        assert_int_equal(scan.samples[i].flags, SAMPLE_INTENSITY);
    }
    scan_destroy(&scan);
}

static void reflectances_up_to_255_are_scaled(void **state) {
    (void)state;
    struct scan scan = parse(write_ball(0, 1, 255.0));
    float highest = 0;
    for (size_t i = 0; i < scan.count; i++)
        highest = fmaxf(highest, scan.samples[i].intensity);
    assert_true(highest > 0.99f && highest <= 1.0f);
    scan_destroy(&scan);
}

static void other_orders_stay_as_they_are(void **state) {
    (void)state;
    const size_t size = write_ball(0, 1, 1.0), count = size / RECORD;
    uint8_t one[RECORD];
    uint32_t random = 1;
    for (size_t i = count - 1; i > 0; i--) { /* shuffled */
        random = random * 1664525u + 1013904223u;
        const size_t k = (random >> 8) % (i + 1);
        memcpy(one, file + i * RECORD, RECORD);
        memcpy(file + i * RECORD, file + k * RECORD, RECORD);
        memcpy(file + k * RECORD, one, RECORD);
    }
    struct scan scan = parse(size);
    assert_int_equal(scan.rows, 1);
    assert_int_equal(scan.columns, count);
    for (size_t i = 0; i < count; i++) {
        assert_int_equal(scan.samples[i].row, 0);
        assert_int_equal(scan.samples[i].column, i);
    }
    assert_non_null(strstr(scan.meta, "file's order"));
    scan_destroy(&scan);
}

static void one_point_is_a_scan(void **state) {
    (void)state;
    put(0, 1, 2, 3, 0.5);
    struct scan scan = parse(RECORD);
    assert_int_equal(scan.count, 1);
    assert_int_equal(scan.rows, 1);
    scan_destroy(&scan);
}

static void records_without_a_direction_are_left_out_and_counted(void **state) {
    (void)state;
    const size_t size = write_ball(0, 1, 1.0);
    put(100, 0, 0, 0, 0);
    put(2000, 0, 0, 0, 0);
    struct scan scan = parse(size);
    assert_int_equal(scan.count, size / RECORD - 2);
    assert_int_equal(scan.rows, RINGS);
    assert_non_null(strstr(scan.meta, "\"left_out\":2"));
    scan_destroy(&scan);
}

static void refuses_what_is_no_scan_and_names_the_point(void **state) {
    (void)state;
    const size_t size = write_ball(0, 1, 1.0);
    const struct {
        double v[4];
        const char *says;
    } cases[] = {{{(double)NAN, 0, 0, 0}, "point 17: number 1 is not finite"},
                 {{1, 0, -(double)INFINITY, 0}, "point 17: number 3 is not finite"},
                 {{1, 0, 0, (double)NAN}, "point 17: number 4 is not finite"},
                 {{1e30, 0, 0, 0}, "point 17 is"},
                 {{1, 0, 0, -0.5}, "no reflectance"},
                 {{1, 0, 0, 1000}, "no reflectance"}};
    struct scan scan;
    struct errctx err = {0};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        put(17, cases[i].v[0], cases[i].v[1], cases[i].v[2], cases[i].v[3]);
        assert_int_equal(scan_spin_parse(file, size, &scan, &err), ST_FORMAT);
        if (!strstr(err.text, cases[i].says))
            fail_msg("'%s' does not say '%s'", err.text, cases[i].says);
    }
    for (size_t cut = 1; cut < RECORD; cut++) {
        assert_int_equal(scan_spin_parse(file, size - cut, &scan, &err), ST_FORMAT);
        assert_non_null(strstr(err.text, "16 bytes"));
    }
    assert_int_equal(scan_spin_parse(file, 0, &scan, &err), ST_FORMAT);
    memset(file, 0, sizeof file);
    assert_int_equal(scan_spin_parse(file, 50 * RECORD, &scan, &err), ST_FORMAT);
    assert_non_null(strstr(err.text, "no point"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rings_and_columns_come_back_whichever_way_it_turns),
        cmocka_unit_test(points_and_reflectances_are_those_of_the_file),
        cmocka_unit_test(reflectances_up_to_255_are_scaled),
        cmocka_unit_test(other_orders_stay_as_they_are),
        cmocka_unit_test(one_point_is_a_scan),
        cmocka_unit_test(records_without_a_direction_are_left_out_and_counted),
        cmocka_unit_test(refuses_what_is_no_scan_and_names_the_point),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
