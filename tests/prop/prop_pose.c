/* Rotations and rigid poses: exponential and logarithm from 0 to pi, inverses, nearest rotation. */
#include "base/pose.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/prop.h"

#include <float.h>
#include <math.h>

enum { CASES = 20000 };
static const double pi = 3.14159265358979323846;

static uint64_t seed;

/* Angles crowd where formulas fail: 0, the series' limits, half a turn. */
static double random_angle(struct rng *rng) {
    switch (rng_below(rng, 6)) {
    case 0:
        return pow(10.0, rng_range(rng, -320, -1));
    case 1:
        return pi - pow(10.0, rng_range(rng, -16, -1));
    case 2:
        return pi;
    case 3:
        return 0.5 + rng_range(rng, -1e-3, 1e-3);
    case 4:
        return 0.25 + rng_range(rng, -1e-3, 1e-3);
    default:
        return rng_range(rng, 0, pi);
    }
}

static double mat3_distance(const struct mat3 *a, const struct mat3 *b) {
    double worst = 0;
    for (int i = 0; i < 9; i++)
        worst = fmax(worst, fabs(a->m[i] - b->m[i]));
    return worst;
}

static void rotation_log_undoes_exp(void **state) {
    (void)state;
    for (uint64_t i = 0; i < CASES; i++) {
        struct rng rng = rng_stream(seed, i);
        double angle = random_angle(&rng);
        struct vec3 w = vec3_scale(rng_direction(&rng), angle);
        struct mat3 r = so3_exp(w);
        assert_true(pose_orthonormality_error(&r) < 1e-14);
        struct vec3 back = so3_log(&r);
        double error = vec3_norm(vec3_sub(back, w));
        if (pi - angle < 1e-12) /* there the axis may come back as its opposite */
            error = fmin(error, vec3_norm(vec3_add(back, w)));
        if (!(error <= 1e-12))
            fail_msg("case %llu: angle %.17g off by %.3g", (unsigned long long)i, angle, error);
        struct mat3 again = so3_exp(back);
        assert_true(mat3_distance(&again, &r) <= 1e-12);
        if (angle < 1e-3) /* small angles keep their relative precision */
            assert_true(error <= 1e-12 * angle + DBL_MIN);
    }
}

/* exp of the 4x4 twist matrix by scaling, its Taylor series, and squaring: slow and independent. */
static struct pose reference_exp(struct vec3 w, struct vec3 v) {
    enum { SQUARINGS = 10, TERMS = 14 };
    double k = 1.0 / (1 << SQUARINGS);
    struct mat4 a = {{0, -w.z * k, w.y * k, v.x * k, w.z * k, 0, -w.x * k, v.y * k, -w.y * k,
                      w.x * k, 0, v.z * k, 0, 0, 0, 0}};
    struct mat4 sum = mat4_identity(), term = mat4_identity();
    for (int n = 1; n <= TERMS; n++) {
        term = mat4_mul(&term, &a);
        for (int i = 0; i < 16; i++) {
            term.m[i] /= n;
            sum.m[i] += term.m[i];
        }
    }
    for (int i = 0; i < SQUARINGS; i++)
        sum = mat4_mul(&sum, &sum);
    struct pose p = {{{sum.m[0], sum.m[1], sum.m[2], sum.m[4], sum.m[5], sum.m[6], sum.m[8],
                       sum.m[9], sum.m[10]}},
                     {sum.m[3], sum.m[7], sum.m[11]}};
    return p;
}

static void pose_exp_equals_matrix_exponential(void **state) {
    (void)state;
    for (uint64_t i = 0; i < CASES / 10; i++) {
        struct rng rng = rng_stream(seed ^ 0x10, i);
        struct vec3 w = vec3_scale(rng_direction(&rng), random_angle(&rng));
        struct vec3 v = vec3_scale(rng_direction(&rng), rng_range(&rng, 0, 10));
        struct pose p = se3_exp(w, v), q = reference_exp(w, v);
        assert_true(mat3_distance(&p.r, &q.r) < 1e-11);
        assert_true(vec3_norm(vec3_sub(p.t_m, q.t_m)) < 1e-10);
    }
}

static void pose_log_undoes_exp(void **state) {
    (void)state;
    for (uint64_t i = 0; i < CASES; i++) {
        struct rng rng = rng_stream(seed ^ 0x20, i);
        double angle = random_angle(&rng);
        struct vec3 w = vec3_scale(rng_direction(&rng), angle);
        double size = pow(10.0, rng_range(&rng, -3, 4));
        struct vec3 v = vec3_scale(rng_direction(&rng), size);
        struct pose p = se3_exp(w, v);
        struct vec3 w2, v2;
        se3_log(&p, &w2, &v2);
        struct pose again = se3_exp(w2, v2);
        assert_true(mat3_distance(&again.r, &p.r) <= 1e-12);
        assert_true(vec3_norm(vec3_sub(again.t_m, p.t_m)) <= 1e-12 * size + 1e-15);
        if (pi - angle > 1e-9) {
            double error = vec3_norm(vec3_sub(v2, v));
            if (!(error <= 1e-11 * size))
                fail_msg("case %llu: angle %.17g, v off by %.3g of %.3g", (unsigned long long)i,
                         angle, error, size);
        }
    }
}

static void composition_with_inverse_is_identity(void **state) {
    (void)state;
    for (uint64_t i = 0; i < CASES; i++) {
        struct rng rng = rng_stream(seed ^ 0x30, i);
        struct pose a_from_b = se3_exp(vec3_scale(rng_direction(&rng), random_angle(&rng)),
                                       vec3_scale(rng_direction(&rng), 10));
        struct pose b_from_a = pose_inverse(&a_from_b);
        struct pose one = pose_compose(&a_from_b, &b_from_a);
        struct mat3 identity = mat3_identity();
        assert_true(mat3_distance(&one.r, &identity) < 1e-14);
        assert_true(vec3_norm(one.t_m) < 1e-13);
        struct vec3 p = vec3_scale(rng_direction(&rng), 5);
        struct mat4 h = pose_to_mat4(&a_from_b);
        struct vec4 by_matrix = mat4_mulv(&h, (struct vec4){p.x, p.y, p.z, 1});
        struct vec3 by_pose = pose_apply(&a_from_b, p);
        assert_true(vec3_norm(vec3_sub(by_pose, vec3_make(by_matrix.x, by_matrix.y, by_matrix.z))) <
                    1e-14);
        assert_true(by_matrix.w == 1.0);
    }
}

static void quaternion_of_half_angle_is_the_rotation(void **state) {
    (void)state;
    for (uint64_t i = 0; i < CASES; i++) {
        struct rng rng = rng_stream(seed ^ 0x40, i);
        struct vec3 axis = rng_direction(&rng);
        double angle = random_angle(&rng), scale = pow(10.0, rng_range(&rng, -6, 6));
        double s = scale * sin(0.5 * angle), c = scale * cos(0.5 * angle);
        struct mat3 r, expected = so3_exp(vec3_scale(axis, angle));
        assert_int_equal(pose_rotation_from_quat(s * axis.x, s * axis.y, s * axis.z, c, &r), ST_OK);
        assert_true(mat3_distance(&r, &expected) < 1e-14);
    }
}

static void nearest_rotation_recovers_a_disturbed_one(void **state) {
    (void)state;
    for (uint64_t i = 0; i < CASES / 4; i++) {
        struct rng rng = rng_stream(seed ^ 0x50, i);
        struct mat3 r = so3_exp(vec3_scale(rng_direction(&rng), random_angle(&rng))), s, near;
        /* r times a symmetric positive matrix: r is exactly its polar factor */
        double e = pow(10.0, rng_range(&rng, -15, -0.7)), scale = pow(10.0, rng_range(&rng, -5, 5));
        double a = e * rng_normal(&rng) / 4, b = e * rng_normal(&rng) / 4,
               c = e * rng_normal(&rng) / 4;
        struct mat3 symmetric = {{1 + a, b, c, b, 1 + c, a, c, a, 1 + b}};
        s = mat3_mul(&r, &symmetric);
        for (int k = 0; k < 9; k++)
            s.m[k] *= scale;
        if (mat3_det(&s) < 0.1 * scale * scale * scale)
            continue;
        assert_int_equal(pose_orthonormalise(&s, &near), ST_OK);
        assert_true(pose_orthonormality_error(&near) < 1e-14);
        assert_true(mat3_distance(&near, &r) < 1e-13);
    }
}

int main(void) {
    seed = prop_seed();
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rotation_log_undoes_exp),
        cmocka_unit_test(pose_exp_equals_matrix_exponential),
        cmocka_unit_test(pose_log_undoes_exp),
        cmocka_unit_test(composition_with_inverse_is_identity),
        cmocka_unit_test(quaternion_of_half_angle_is_the_rotation),
        cmocka_unit_test(nearest_rotation_recovers_a_disturbed_one),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
