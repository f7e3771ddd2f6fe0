/* The rig model: its frames, and the figures that the UNC cart's errors amount to. */
#include "base/rig.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

static const double pi = 3.14159265358979323846;
static const double exact_m = 1e-12; /* rounding of a few double operations at metres */

static void assert_near(struct vec3 a, struct vec3 b, double tolerance_m) {
    assert_true(vec3_norm(vec3_sub(a, b)) <= tolerance_m);
}

static void nominal_beam_sweeps_a_vertical_plane(void **state) {
    (void)state;
    struct rig rig = rig_nominal();
    assert_near(rig_point(&rig, 0, 0, 0, 2), vec3_make(2, 0, 0), exact_m);
    assert_near(rig_point(&rig, pi / 2, 0, 0, 2), vec3_make(0, 0, 2), exact_m);
    assert_near(rig_point(&rig, pi, 0, 0, 2), vec3_make(-2, 0, 0), exact_m);
    assert_near(rig_point(&rig, -pi / 4, 0, 0, 2), vec3_make(sqrt(2.0), 0, -sqrt(2.0)), exact_m);
}

static void pan_turns_left_and_tilt_raises(void **state) {
    (void)state;
    struct rig rig = rig_nominal();
    assert_near(rig_point(&rig, 0, 0, pi / 2, 2), vec3_make(0, 2, 0), exact_m);
    assert_near(rig_point(&rig, 0, pi / 6, 0, 2), vec3_make(2 * cos(pi / 6), 0, 1), exact_m);
    struct rig_camera cam = {.head_from_cam = rig_camera_nominal_pose()};
    struct pose pose = rig_camera_pose(&cam, 0, pi / 2);
    assert_near(mat3_mulv(&pose.r, vec3_make(0, 0, 1)), vec3_make(0, 1, 0), exact_m);  /* looks left */
    assert_near(mat3_mulv(&pose.r, vec3_make(0, 1, 0)), vec3_make(0, 0, -1), exact_m); /* y is down */
}

static void mirror_error_of_0_2_deg_displaces_a_wall_at_3_m_by_21_mm(void **state) {
    (void)state;
    struct rig nominal = rig_nominal(), real = rig_nominal();
    real.mirror_angle_rad = 44.8 * pi / 180;
    for (int i = 0; i < 8; i++) {
        double theta = i * pi / 4;
        double d_m = vec3_norm(
            vec3_sub(rig_point(&real, theta, 0, 0, 3), rig_point(&nominal, theta, 0, 0, 3)));
        assert_true(fabs(d_m - 0.021) < 0.0005);
    }
}

static void steps_of_14039_for_14000_displace_by_26_mm_over_180_deg_at_3_m(void **state) {
    (void)state;
    struct rig nominal = rig_nominal(), real = rig_nominal();
    real.pan_steps_per_turn = 28078;
    struct vec3 a = rig_point(&nominal, 0, 0, rig_pan_angle(&nominal, 14000, 0), 3);
    struct vec3 b = rig_point(&real, 0, 0, rig_pan_angle(&real, 14000, 0), 3);
    assert_true(fabs(vec3_norm(vec3_sub(a, b)) - 0.026) < 0.0005);
}

static void backlash_lags_behind_the_motion(void **state) {
    (void)state;
    struct rig rig = rig_nominal();
    rig.pan_backlash_rad = 1e-3;
    double up = rig_pan_angle(&rig, 1000, 1), down = rig_pan_angle(&rig, 1000, -1);
    assert_true(fabs(down - up - 1e-3) < 1e-15);
    assert_true(fabs((up + down) / 2 - rig_pan_angle(&rig, 1000, 0)) < 1e-15);
}

static struct rig misaligned(void) {
    struct rig rig = rig_nominal();
    rig.shaft = vec3_unit(vec3_make(0.004, -1, -0.003));
    rig.laser = vec3_unit(vec3_make(-0.002, 1, 0.005));
    rig.mirror_angle_rad = 44.8 * pi / 180;
    rig.mirror_m = vec3_make(0.003, -0.002, 0.05);
    rig.mirror_path_m = 0.06;
    rig.range_scale = 1.0007;
    rig.range_offset_m = 0.011;
    rig.encoder_horizon_counts = 1037.3;
    rig.encoder_ecc_cos_rad = 0.0011;
    rig.encoder_ecc_sin_rad = -0.0007;
    return rig;
}

static void encoder_inverse_returns_the_counts(void **state) {
    (void)state;
    struct rig rig = misaligned();
    for (int i = -20000; i < 20000; i += 37) {
        double counts = i + 0.37;
        double back = rig_encoder_counts(&rig, rig_mirror_angle(&rig, counts));
        assert_true(fabs(back - counts) < 1e-9);
    }
}

static void range_inverse_returns_the_distance(void **state) {
    (void)state;
    struct rig rig = misaligned();
    assert_true(fabs(rig_distance(&rig, rig_range(&rig, 4.321)) - 4.321) < exact_m);
}

static void beam_and_normal_obey_the_law_of_reflection(void **state) {
    (void)state;
    struct rig rig = misaligned();
    for (int i = 0; i < 100; i++) {
        double theta = i * 0.0628;
        struct vec3 n = rig_mirror_normal(&rig, theta);
        struct rig_beam beam = rig_head_beam(&rig, theta);
        assert_true(fabs(vec3_norm(n) - 1) < 1e-14);
        assert_true(fabs(vec3_norm(beam.dir) - 1) < 1e-14);
        assert_true(fabs(vec3_dot(n, rig.shaft) - cos(rig.mirror_angle_rad)) < 1e-14);
        assert_near(vec3_cross(vec3_sub(beam.dir, rig.laser), n), vec3_make(0, 0, 0), 1e-14);
        assert_true(fabs(vec3_dot(beam.dir, n) + vec3_dot(rig.laser, n)) < 1e-14);
    }
}

static void check_refuses_wrong_units_and_nan(void **state) {
    (void)state;
    struct errctx err = {0};
    struct rig rig = misaligned();
    assert_int_equal(rig_check(&rig, &err), ST_OK);
    rig.mirror_angle_rad = 44.8; /* degrees by mistake */
    assert_int_equal(rig_check(&rig, &err), ST_INVALID);
    assert_non_null(strstr(err.text, "mirror_angle"));
    rig = misaligned();
    rig.range_scale = NAN;
    assert_int_equal(rig_check(&rig, &err), ST_INVALID);
    rig = misaligned();
    rig.shaft = vec3_make(0, -2, 0);
    assert_int_equal(rig_check(&rig, &err), ST_INVALID);
    rig = misaligned();
    rig.laser = rig.shaft;
    assert_int_equal(rig_check(&rig, &err), ST_INVALID);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nominal_beam_sweeps_a_vertical_plane),
        cmocka_unit_test(pan_turns_left_and_tilt_raises),
        cmocka_unit_test(mirror_error_of_0_2_deg_displaces_a_wall_at_3_m_by_21_mm),
        cmocka_unit_test(steps_of_14039_for_14000_displace_by_26_mm_over_180_deg_at_3_m),
        cmocka_unit_test(backlash_lags_behind_the_motion),
        cmocka_unit_test(encoder_inverse_returns_the_counts),
        cmocka_unit_test(range_inverse_returns_the_distance),
        cmocka_unit_test(beam_and_normal_obey_the_law_of_reflection),
        cmocka_unit_test(check_refuses_wrong_units_and_nan),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
