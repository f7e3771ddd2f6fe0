#include "base/camera.h"
#include "tests/support/cmocka_all.h"

#include <math.h>
#include <string.h>

static const double pi = 3.14159265358979323846;

static void pinhole_sees_half_its_field_of_view_at_the_edge(void **state) {
    (void)state;
    struct camera cam = camera_pinhole(640, 480, pi / 2);
    struct vec3 ray;
    /* the outer edge of the last column is half a pixel beyond its centre */
    assert_int_equal(camera_unproject(&cam, (struct vec2){639.5, 239.5}, &ray, NULL), ST_OK);
    assert_true(fabs(ray.x - 1.0) < 1e-15 && fabs(ray.y) < 1e-15 && ray.z == 1.0);
}

static void known_distortion_gives_the_hand_computed_pixel(void **state) {
    (void)state;
    struct camera cam = {.width_px = 100,
                         .height_px = 100,
                         .fx_px = 100,
                         .fy_px = 200,
                         .cx_px = 50,
                         .cy_px = 40,
                         .k1 = 0.1,
                         .k2 = 0.01,
                         .k3 = 0.001,
                         .p1 = 0.02,
                         .p2 = 0.03};
    struct vec2 q;
    assert_int_equal(camera_project(&cam, vec3_make(1, 1, 2), &q, NULL), ST_OK);
    /* x = y = 0.5, s = 0.5, g = 1 + 0.05 + 0.0025 + 0.000125 = 1.052625
     * x' = 0.5263125 + 0.04 * 0.25 + 0.03 * (0.5 + 0.5) = 0.5663125
     * y' = 0.5263125 + 0.02 * (0.5 + 0.5) + 0.06 * 0.25 = 0.5613125 */
    assert_true(fabs(q.x - 106.63125) < 1e-11);
    assert_true(fabs(q.y - 152.2625) < 1e-11);
}

static void refuses_points_at_and_behind_the_camera(void **state) {
    (void)state;
    struct camera cam = camera_pinhole(64, 48, 1);
    struct vec2 q;
    assert_int_equal(camera_project(&cam, vec3_make(0, 0, 0), &q, NULL), ST_DOMAIN);
    assert_int_equal(camera_project(&cam, vec3_make(1, 0, -1), &q, NULL), ST_DOMAIN);
    assert_int_equal(camera_project(&cam, vec3_make(0, 0, NAN), &q, NULL), ST_DOMAIN);
    assert_int_equal(camera_project(&cam, vec3_make(NAN, 0, 1), &q, NULL), ST_DOMAIN);
    assert_int_equal(camera_project(&cam, vec3_make(1e308, 0, 1e-308), &q, NULL), ST_DOMAIN);
}

static void projects_from_a_micrometre_to_a_thousand_kilometres(void **state) {
    (void)state;
    struct camera cam = camera_pinhole(640, 480, 1);
    cam.k1 = -0.1;
    struct vec2 near, far;
    assert_int_equal(camera_project(&cam, vec3_make(0.25e-6, 0.125e-6, 1e-6), &near, NULL), ST_OK);
    assert_int_equal(camera_project(&cam, vec3_make(0.25e6, 0.125e6, 1e6), &far, NULL), ST_OK);
    assert_true(hypot(near.x - far.x, near.y - far.y) < 1e-10);
}

static void barrel_domain_ends_at_the_stationary_radius(void **state) {
    (void)state;
    struct camera cam = camera_pinhole(640, 480, 1);
    cam.k1 = -0.3; /* 1 - 0.9 s = 0 */
    assert_true(fabs(camera_s_max(&cam) - 1.0 / 0.9) < 1e-15);
    struct vec2 q;
    assert_int_equal(camera_project(&cam, vec3_make(1.054, 0, 1), &q, NULL), ST_OK);
    assert_int_equal(camera_project(&cam, vec3_make(1.055, 0, 1), &q, NULL), ST_DOMAIN);
    /* the largest image radius is sqrt(s) g(s) there; no ray projects beyond */
    double edge = sqrt(1 / 0.9) * (1 - 0.3 / 0.9);
    struct vec3 ray;
    q = (struct vec2){cam.cx_px + cam.fx_px * (edge - 1e-6), cam.cy_px};
    assert_int_equal(camera_unproject(&cam, q, &ray, NULL), ST_OK);
    q.x = cam.cx_px + cam.fx_px * (edge + 1e-6);
    assert_int_equal(camera_unproject(&cam, q, &ray, NULL), ST_DOMAIN);
}

static void pincushion_has_no_end(void **state) {
    (void)state;
    struct camera cam = camera_pinhole(640, 480, 1);
    assert_true(isinf(camera_s_max(&cam)));
    cam.k1 = 0.3;
    assert_true(isinf(camera_s_max(&cam)));
}

static void refuses_cameras_that_make_no_sense(void **state) {
    (void)state;
    const struct camera good = camera_pinhole(640, 480, 1);
    struct errctx err = {0};
    assert_int_equal(camera_check(&good, &err), ST_OK);
    struct camera bad[8];
    for (int i = 0; i < 8; i++)
        bad[i] = good;
    bad[0].width_px = 0;
    bad[1].height_px = 65537;
    bad[2].fx_px = 0;
    bad[3].fy_px = -1;
    bad[4].fx_px = INFINITY;
    bad[5].cx_px = NAN;
    bad[6].k2 = NAN;
    bad[7].p1 = INFINITY;
    for (int i = 0; i < 8; i++) {
        memset(&err, 0, sizeof err);
        assert_int_equal(camera_check(&bad[i], &err), ST_INVALID);
        assert_true(strlen(err.text) > 10);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pinhole_sees_half_its_field_of_view_at_the_edge),
        cmocka_unit_test(known_distortion_gives_the_hand_computed_pixel),
        cmocka_unit_test(refuses_points_at_and_behind_the_camera),
        cmocka_unit_test(projects_from_a_micrometre_to_a_thousand_kilometres),
        cmocka_unit_test(barrel_domain_ends_at_the_stationary_radius),
        cmocka_unit_test(pincushion_has_no_end),
        cmocka_unit_test(refuses_cameras_that_make_no_sense),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
