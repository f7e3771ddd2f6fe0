/* The rig model in bulk against the rig model of base, and its derivatives against differences. */
#include "../support/prop.h"
#include "fusion/rays.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

/* Positions agree to this: a thousand times the rounding of 100 m. */
static const double same_m = 1e-11;

static struct rig random_rig(struct rng *rng) {
    struct rig rig = rig_nominal();
    rig.shaft = vec3_unit(vec3_madd(rig.shaft, rng_direction(rng), 0.02));
    rig.laser = vec3_unit(vec3_madd(rig.laser, rng_direction(rng), 0.02));
    rig.mirror_angle_rad += rng_range(rng, -0.02, 0.02);
    rig.mirror_m = vec3_scale(rng_direction(rng), 0.05);
    rig.mirror_path_m = rng_range(rng, 0, 0.1);
    rig.range_scale = rng_range(rng, 0.99, 1.01);
    rig.range_offset_m = rng_range(rng, -0.05, 0.05);
    rig.encoder_horizon_counts = rng_range(rng, 0, 4096);
    rig.encoder_ecc_cos_rad = rng_range(rng, -0.01, 0.01);
    rig.encoder_ecc_sin_rad = rng_range(rng, -0.01, 0.01);
    rig.pan_steps_per_turn = rng_range(rng, 20000, 30000);
    rig.pan_zero_steps = rng_range(rng, -100, 100);
    rig.pan_backlash_rad = rng_range(rng, 0, 0.01);
    rig.tilt_steps_per_turn = rng_range(rng, 20000, 30000);
    rig.tilt_zero_steps = rng_range(rng, -100, 100);
    return rig;
}

static struct sweep_place random_place(struct rng *rng) {
    struct sweep_place place = {.verdict = SWEEP_GOOD,
                                .counts = rng_range(rng, 0, 4096),
                                .pan_steps = rng_range(rng, -30000, 60000),
                                .tilt_steps = rng_range(rng, -3000, 3000),
                                .pan_direction = (int)rng_below(rng, 3) - 1,
                                .sweep = true};
    return place;
}

static struct vec3 point(const struct rig *rig, const struct sweep_place *place, double range_m) {
    return rig_point(rig, rig_mirror_angle(rig, place->counts),
                     rig_tilt_angle(rig, place->tilt_steps),
                     rig_pan_angle(rig, place->pan_steps, place->pan_direction), range_m);
}

static void bulk_points_are_the_rigs(void **state) {
    (void)state;
    enum { N = 1001 };
    uint64_t seed = prop_seed();
    for (uint64_t round = 0; round < 20; round++) {
        struct rng rng = rng_stream(seed, round);
        struct rig rig = random_rig(&rng);
        static double counts[N], pan[N], tilt[N], range[N], x[N], y[N], z[N];
        static struct sweep_place places[N];
        for (int i = 0; i < N; i++) {
            places[i] = random_place(&rng);
            counts[i] = places[i].counts;
            pan[i] = rig_pan_angle(&rig, places[i].pan_steps, places[i].pan_direction);
            tilt[i] = rig_tilt_angle(&rig, places[i].tilt_steps);
            range[i] = rng_range(&rng, 0.1, 100.0);
        }
        struct rays_batch batch = {N, counts, pan, tilt, range, x, y, z};
        rays_points(&rig, &batch);
        for (int i = 0; i < N; i++) {
            struct vec3 p = point(&rig, &places[i], range[i]);
            assert_true(vec3_norm(vec3_sub(p, vec3_make(x[i], y[i], z[i]))) < same_m);
        }
    }
}

static void a_sample_without_range_keeps_its_direction(void **state) {
    (void)state;
    struct rng rng = rng_make(prop_seed());
    struct rig rig = random_rig(&rng);
    struct sweep_place place = random_place(&rng);
    double pan = rig_pan_angle(&rig, place.pan_steps, place.pan_direction);
    double tilt = rig_tilt_angle(&rig, place.tilt_steps), range = (double)NAN, x, y, z;
    struct rays_batch batch = {1, &place.counts, &pan, &tilt, &range, &x, &y, &z};
    rays_points(&rig, &batch);
    struct rig_beam beam = rig_direction(&rig, rig_mirror_angle(&rig, place.counts), tilt, pan);
    assert_true(vec3_norm(vec3_sub(beam.dir, vec3_make(x, y, z))) < same_m);
}

static struct vec3 turned(struct vec3 v, int axis, double by) {
    struct vec3 w = {axis == 0 ? by : 0, 0, axis == 2 ? by : 0};
    struct mat3 r = so3_exp(w);
    return mat3_mulv(&r, v);
}

static void move_parameter(struct rig *rig, int parameter, double by) {
    switch ((enum rays_parameter)parameter) {
    case RAYS_SHAFT_X:
    case RAYS_SHAFT_Z:
        rig->shaft = turned(rig->shaft, parameter == RAYS_SHAFT_X ? 0 : 2, by);
        break;
    case RAYS_LASER_X:
    case RAYS_LASER_Z:
        rig->laser = turned(rig->laser, parameter == RAYS_LASER_X ? 0 : 2, by);
        break;
    case RAYS_MIRROR_ANGLE:
        rig->mirror_angle_rad += by;
        break;
    case RAYS_MIRROR_X:
        rig->mirror_m.x += by;
        break;
    case RAYS_MIRROR_Y:
        rig->mirror_m.y += by;
        break;
    case RAYS_MIRROR_Z:
        rig->mirror_m.z += by;
        break;
    case RAYS_MIRROR_PATH:
        rig->mirror_path_m += by;
        break;
    case RAYS_RANGE_SCALE:
        rig->range_scale += by;
        break;
    case RAYS_RANGE_OFFSET:
        rig->range_offset_m += by;
        break;
    case RAYS_HORIZON:
        rig->encoder_horizon_counts += by;
        break;
    case RAYS_ECC_COS:
        rig->encoder_ecc_cos_rad += by;
        break;
    case RAYS_ECC_SIN:
        rig->encoder_ecc_sin_rad += by;
        break;
    case RAYS_PAN_STEPS_PER_TURN:
        rig->pan_steps_per_turn += by;
        break;
    case RAYS_PAN_ZERO:
        rig->pan_zero_steps += by;
        break;
    case RAYS_PAN_BACKLASH:
        rig->pan_backlash_rad += by;
        break;
    case RAYS_TILT_STEPS_PER_TURN:
        rig->tilt_steps_per_turn += by;
        break;
    case RAYS_TILT_ZERO:
        rig->tilt_zero_steps += by;
        break;
    case RAYS_PARAMETERS:
        break;
    }
}

/* Central differences err by step^2 times the third derivative plus rounding / step. */
static void check_column(const double *column, int stride, struct vec3 plus, struct vec3 minus,
                         double step, int which) {
    struct vec3 d = vec3_scale(vec3_sub(plus, minus), 0.5 / step);
    struct vec3 got = {column[0], column[stride], column[2 * stride]};
    double off = vec3_norm(vec3_sub(d, got)), size = vec3_norm(d) + 1e-3;
    if (!(off < 1e-5 * size + 1e-7))
        print_message("column %d: %g against %g\n", which, vec3_norm(got), vec3_norm(d));
    assert_true(off < 1e-5 * size + 1e-7);
}

static void derivatives_are_those_of_the_rig(void **state) {
    (void)state;
    uint64_t seed = prop_seed();
    for (uint64_t round = 0; round < 50; round++) {
        struct rng rng = rng_stream(seed, 1000 + round);
        struct rig rig = random_rig(&rng);
        struct sweep_place place = random_place(&rng);
        double range_m = rng_range(&rng, 0.3, 30.0);
        struct rays_jacobian j;
        rays_differentiate(&rig, &place, range_m, &j);
        assert_true(vec3_norm(vec3_sub(j.p_m, point(&rig, &place, range_m))) < same_m);
        for (int k = 0; k < RAYS_PARAMETERS; k++) {
            double step = k == RAYS_HORIZON || k == RAYS_PAN_STEPS_PER_TURN || k == RAYS_PAN_ZERO ||
                                  k == RAYS_TILT_STEPS_PER_TURN || k == RAYS_TILT_ZERO
                              ? 0.1
                              : 1e-5;
            struct rig plus = rig, minus = rig;
            move_parameter(&plus, k, step);
            move_parameter(&minus, k, -step);
            check_column(&j.dp_dparameter[0][k], RAYS_PARAMETERS, point(&plus, &place, range_m),
                         point(&minus, &place, range_m), step, k);
        }
        for (int k = 0; k < RAYS_MEASURES; k++) {
            double step = k == RAYS_RANGE ? 1e-4 : 0.1, rp = range_m, rm = range_m;
            struct sweep_place plus = place, minus = place;
            double *fields[RAYS_MEASURES][2] = {{&plus.counts, &minus.counts},
                                                {&plus.pan_steps, &minus.pan_steps},
                                                {&plus.tilt_steps, &minus.tilt_steps},
                                                {&rp, &rm}};
            *fields[k][0] += step;
            *fields[k][1] -= step;
            check_column(&j.dp_dmeasure[0][k], RAYS_MEASURES, point(&rig, &plus, rp),
                         point(&rig, &minus, rm), step, 100 + k);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bulk_points_are_the_rigs),
        cmocka_unit_test(a_sample_without_range_keeps_its_direction),
        cmocka_unit_test(derivatives_are_those_of_the_rig),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
