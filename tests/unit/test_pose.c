#include "base/pose.h"
#include "tests/support/cmocka_all.h"

#include <math.h>

static const double pi = 3.14159265358979323846;

static void assert_near(struct vec3 a, struct vec3 b, double tolerance) {
    if (!(vec3_norm(vec3_sub(a, b)) <= tolerance))
        fail_msg("(%.17g %.17g %.17g) is not (%.17g %.17g %.17g)", a.x, a.y, a.z, b.x, b.y, b.z);
}

static void quarter_turn_about_z_takes_x_to_y(void **state) {
    (void)state;
    struct mat3 r = so3_exp(vec3_make(0, 0, pi / 2));
    assert_near(mat3_mulv(&r, vec3_make(1, 0, 0)), vec3_make(0, 1, 0), 1e-15);
}

static void half_turn_picks_the_axis_with_positive_largest_component(void **state) {
    (void)state;
    const struct vec3 axes[] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.6, 0, -0.8}, {-0.6, 0.8, 0}};
    for (int i = 0; i < 5; i++) {
        /* 2 a a^T - I: half a turn without rounding of pi */
        struct vec3 a = axes[i];
        struct mat3 r = {{2 * a.x * a.x - 1, 2 * a.x * a.y, 2 * a.x * a.z, 2 * a.x * a.y,
                          2 * a.y * a.y - 1, 2 * a.y * a.z, 2 * a.x * a.z, 2 * a.y * a.z,
                          2 * a.z * a.z - 1}};
        double sign = fabs(a.z) > 0.7 && a.z < 0 ? -1 : 1;
        assert_near(so3_log(&r), vec3_scale(a, sign * pi), 1e-12);
    }
}

static void identity_has_zero_log(void **state) {
    (void)state;
    struct pose p = pose_identity();
    struct vec3 w, v;
    se3_log(&p, &w, &v);
    assert_near(w, vec3_make(0, 0, 0), 0);
    assert_near(v, vec3_make(0, 0, 0), 0);
}

static void camera_looking_north_has_east_right_and_down_below(void **state) {
    (void)state;
    struct pose world_from_cam;
    assert_int_equal(
        pose_look_at(vec3_make(1, 2, 3), vec3_make(1, 12, 3), vec3_make(0, 0, 1), &world_from_cam),
        ST_OK);
    assert_near(pose_apply(&world_from_cam, vec3_make(0, 0, 10)), vec3_make(1, 12, 3), 1e-14);
    assert_near(pose_apply(&world_from_cam, vec3_make(1, 0, 0)), vec3_make(2, 2, 3), 1e-14);
    assert_near(pose_apply(&world_from_cam, vec3_make(0, 1, 0)), vec3_make(1, 2, 2), 1e-14);
    assert_true(pose_orthonormality_error(&world_from_cam.r) < 1e-15);
}

static void refuses_view_without_a_direction(void **state) {
    (void)state;
    struct vec3 eye = {1, 2, 3}, up = {0, 0, 1};
    struct pose p;
    assert_int_equal(pose_look_at(eye, eye, up, &p), ST_SINGULAR);
    assert_int_equal(pose_look_at(eye, vec3_make(1, 2, 9), up, &p), ST_SINGULAR);
    assert_int_equal(pose_look_at(eye, vec3_make(0, 0, 0), vec3_make(0, 0, 0), &p), ST_SINGULAR);
    assert_int_equal(pose_look_at(eye, vec3_make(NAN, 0, 0), up, &p), ST_SINGULAR);
}

static void refuses_quaternion_without_length(void **state) {
    (void)state;
    struct mat3 r;
    assert_int_equal(pose_rotation_from_quat(0, 0, 0, 0, &r), ST_SINGULAR);
    assert_int_equal(pose_rotation_from_quat(NAN, 0, 0, 1, &r), ST_SINGULAR);
    assert_int_equal(pose_rotation_from_quat(INFINITY, 0, 0, 1, &r), ST_SINGULAR);
}

static void refuses_reflection_and_rank_loss(void **state) {
    (void)state;
    struct mat3 mirror = {{1, 0, 0, 0, 1, 0, 0, 0, -1}}, flat = {{1, 0, 0, 0, 1, 0, 0, 0, 0}};
    struct mat3 zero = {{0, 0, 0, 0, 0, 0, 0, 0, 0}}, nan = {{NAN, 0, 0, 0, 1, 0, 0, 0, 1}}, out;
    assert_int_equal(pose_orthonormalise(&mirror, &out), ST_SINGULAR);
    assert_int_equal(pose_orthonormalise(&flat, &out), ST_SINGULAR);
    assert_int_equal(pose_orthonormalise(&zero, &out), ST_SINGULAR);
    assert_int_equal(pose_orthonormalise(&nan, &out), ST_SINGULAR);
}

static void orthonormality_error_sees_reflection_and_nan(void **state) {
    (void)state;
    struct mat3 mirror = {{1, 0, 0, 0, 1, 0, 0, 0, -1}}, nan = {{1, 0, 0, 0, NAN, 0, 0, 0, 1}};
    assert_true(pose_orthonormality_error(&mirror) == 2.0);
    assert_true(isnan(pose_orthonormality_error(&nan)));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(quarter_turn_about_z_takes_x_to_y),
        cmocka_unit_test(half_turn_picks_the_axis_with_positive_largest_component),
        cmocka_unit_test(identity_has_zero_log),
        cmocka_unit_test(camera_looking_north_has_east_right_and_down_below),
        cmocka_unit_test(refuses_view_without_a_direction),
        cmocka_unit_test(refuses_quaternion_without_length),
        cmocka_unit_test(refuses_reflection_and_rank_loss),
        cmocka_unit_test(orthonormality_error_sees_reflection_and_nan),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
