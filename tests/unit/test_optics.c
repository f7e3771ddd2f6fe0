/* The rangefinder's light: errors are distributed as configured; silhouettes give points between
 * surfaces; mirrors, glass and reflectors do what they do to a real one. */
#include "base/head_packet.h"
#include "twin/optics.h"
#include "twin/scene_build.h"

#include "tests/support/cmocka_all.h"

/* A scene of one or two flat plates across the x axis; the nearer one covers y < 0 if `half`. */
static struct scene *plates(struct material near_m, double near_x, int half, double far_x) {
    struct scene *scene = NULL;
    struct errctx err = {0};
    assert_int_equal(scene_allocate(&scene, &err), ST_OK);
    struct shaper s = scene_shaper(scene, scene_add_material(scene, near_m), pose_identity());
    double y1 = half ? 0 : 5;
    shape_quad(&s, vec3_make(near_x, -5, -5), vec3_make(near_x, -5, 5), vec3_make(near_x, y1, 5),
               vec3_make(near_x, y1, -5));
    if (far_x > 0) {
        struct material white = {.rgb = {0.8f, 0.8f, 0.8f}, .albedo_ir = 0.8f, .roughness = 0.9f};
        s = scene_shaper(scene, scene_add_material(scene, white), pose_identity());
        shape_quad(&s, vec3_make(far_x, -9, -9), vec3_make(far_x, -9, 9), vec3_make(far_x, 9, 9),
                   vec3_make(far_x, 9, -9));
    }
    assert_int_equal(scene_finish(scene, &err), ST_OK);
    return scene;
}

static struct material matt(float albedo) {
    struct material m = {.rgb = {albedo, albedo, albedo}, .albedo_ir = albedo, .roughness = 0.9f};
    return m;
}

static struct optics_beam ahead(double y_slope) {
    struct optics_beam beam = {.dir = vec3_unit(vec3_make(1, y_slope, 0)), .sweep = {0, 0.001, 0}};
    return beam;
}

static struct optics quiet(void) {
    struct optics optics = optics_default();
    optics.outlier_probability = optics.dropout_probability = 0;
    optics.quantum_m = 0;
    return optics;
}

static void range_errors_have_the_configured_mean_sigma_and_shape(void **state) {
    (void)state;
    enum { N = 40000, BINS = 20 };
    struct optics optics = quiet();
    struct optics_echo echo = {.energy = 0.01, .distance_m = 3};
    struct rng rng = rng_make(11);
    double ratio = 0.01 / optics.echo_reference, sum = 0, sum2 = 0;
    double sigma = sqrt(1.2e-3 * 1.2e-3 + 1.2e-3 * 1.2e-3 / ratio), bias = -0.0015 * log10(ratio);
    int bin[BINS] = {0}, tail = 0;
    for (int i = 0; i < N; i++) {
        struct optics_reading r;
        optics_detect(&optics, &echo, 0, &rng, &r);
        double z = (r.distance_m - 3 - bias) / sigma;
        assert_true(fabs(r.sigma_m - sigma) < 1e-12 && fabs(r.bias_m - bias) < 1e-12);
        sum += z;
        sum2 += z * z;
        tail += fabs(z) > 3;
        int k = (int)(0.5 * erfc(-z / sqrt(2.0)) * BINS); /* uniform if z is normal */
        bin[k < BINS ? k : BINS - 1]++;
    }
    double chi2 = 0, expected = (double)N / BINS;
    for (int k = 0; k < BINS; k++)
        chi2 += (bin[k] - expected) * (bin[k] - expected) / expected;
    assert_true(fabs(sum / N) < 0.02);      /* 4 sigma of the mean */
    assert_true(fabs(sum2 / N - 1) < 0.03); /* 4 sigma of the variance */
    assert_true(chi2 < 43.8);               /* 19 degrees of freedom, 0.1 % */
    assert_true(tail > 60 && tail < 160);   /* 0.27 % of 40 000 is 108 */
}

static void weaker_echoes_are_noisier_and_too_weak_ones_dropped_or_not_seen(void **state) {
    (void)state;
    struct optics optics = quiet();
    struct rng rng = rng_make(1);
    struct optics_reading strong, weak, dropped, unseen, none;
    struct optics_echo e = {.energy = 0.5, .distance_m = 2};
    optics_detect(&optics, &e, 0, &rng, &strong);
    e.energy = 0.001;
    optics_detect(&optics, &e, 0, &rng, &weak);
    assert_true(weak.sigma_m > 3 * strong.sigma_m);
    e.energy = 0.5 * (optics.echo_seen + optics.echo_usable);
    optics_detect(&optics, &e, 0, &rng, &dropped);
    assert_int_equal(dropped.flags, HEAD_SAMPLE_DROPPED);
    assert_true(isnan(dropped.distance_m));
    e.energy = 0.5 * optics.echo_seen;
    optics_detect(&optics, &e, 0, &rng, &unseen);
    assert_int_equal(unseen.flags, HEAD_SAMPLE_NO_RETURN);
    struct optics_echo nothing = {.distance_m = (double)NAN};
    optics_detect(&optics, &nothing, 0, &rng, &none);
    assert_int_equal(none.flags, HEAD_SAMPLE_NO_RETURN);
}

static void beyond_maximum_range_is_no_return_and_beyond_ambiguity_folds_back(void **state) {
    (void)state;
    struct optics optics = quiet();
    struct rng rng = rng_make(1);
    struct optics_echo e = {.energy = 0.5, .distance_m = 7};
    struct optics_reading r;
    optics_detect(&optics, &e, 0, &rng, &r);
    assert_int_equal(r.flags, HEAD_SAMPLE_NO_RETURN);
    e.distance_m = optics.ambiguity_m + 4;
    optics_detect(&optics, &e, 0, &rng, &r);
    assert_true(fabs(r.distance_m - 4) < 0.02);
}

static void quantisation_dropouts_and_outliers_happen_as_often_as_told(void **state) {
    (void)state;
    struct optics optics = optics_default();
    optics.dropout_probability = 0.05;
    optics.outlier_probability = 0.02;
    struct rng rng = rng_make(5);
    struct optics_echo e = {.energy = 0.3, .distance_m = 3};
    int dropped = 0, outliers = 0;
    for (int i = 0; i < 20000; i++) {
        struct optics_reading r;
        optics_detect(&optics, &e, 0, &rng, &r);
        dropped += (r.flags & HEAD_SAMPLE_DROPPED) != 0;
        if (isnan(r.distance_m))
            continue;
        double steps = r.distance_m / optics.quantum_m;
        assert_true(fabs(steps - floor(steps + 0.5)) < 1e-6);
        outliers += fabs(r.distance_m - 3) > 0.05;
    }
    assert_true(dropped > 850 && dropped < 1150);
    assert_true(outliers > 290 && outliers < 470); /* 2 % of 95 %, less those that fall near */
}

static void a_silhouette_gives_points_floating_between_the_surfaces(void **state) {
    (void)state;
    struct scene *scene = plates(matt(0.6f), 2, 1, 4);
    struct optics optics = quiet();
    int mixed = 0, between = 0;
    for (int i = 0; i < 400; i++) {
        struct optics_beam beam = ahead((i - 200) * 5e-5);
        struct rng rng = rng_stream(3, (uint64_t)i);
        struct optics_echo e;
        optics_shoot(scene, &optics, &beam, &rng, &e);
        assert_true(e.distance_m > 1.99 && e.distance_m < 4.01);
        mixed += e.mixed;
        between += e.distance_m > 2.1 && e.distance_m < 3.9;
        if (e.distance_m > 2.1 && e.distance_m < 3.9)
            assert_true(e.mixed);
        if (i < 100 || i > 300)
            assert_false(e.mixed);
    }
    assert_true(mixed > 5 && mixed < 100 && between > 5);
    scene_destroy(scene);
}

static void grazing_incidence_spreads_one_surface_but_mixes_nothing(void **state) {
    (void)state;
    struct scene *scene = plates(matt(0.6f), 4, 0, 0);
    struct optics optics = quiet();
    optics.max_range_m = 100;
    double widest_m = 0;
    for (int i = 0; i < 100; i++) { /* the beam meets the plate at 4 degrees */
        struct optics_beam beam = {.origin_m = {3.86, -4.4 + 0.002 * i, 0},
                                   .dir = vec3_unit(vec3_make(0.07, 1, 0)),
                                   .sweep = {0.004, 0, 0}};
        struct rng rng = rng_stream(3, (uint64_t)i);
        struct optics_echo e;
        optics_shoot(scene, &optics, &beam, &rng, &e);
        widest_m = fmax(widest_m, e.farthest_m - e.nearest_m);
        assert_false(e.mixed);
    }
    assert_true(widest_m > 0.06);
    scene_destroy(scene);
}

static void one_ray_never_mixes(void **state) {
    (void)state;
    struct scene *scene = plates(matt(0.6f), 2, 1, 4);
    struct optics optics = quiet();
    optics.rays = 1;
    for (int i = 0; i < 100; i++) {
        struct optics_beam beam = ahead((i - 50) * 1e-4);
        struct rng rng = rng_stream(3, (uint64_t)i);
        struct optics_echo e;
        optics_shoot(scene, &optics, &beam, &rng, &e);
        assert_false(e.mixed);
    }
    scene_destroy(scene);
}

static double energy_of(struct material m, double slope) {
    struct scene *scene = plates(m, 2, 0, -1);
    struct optics optics = optics_ideal();
    struct optics_beam beam = ahead(slope);
    struct rng rng = rng_make(1);
    struct optics_echo e;
    optics_shoot(scene, &optics, &beam, &rng, &e);
    scene_destroy(scene);
    return e.energy;
}

static void echo_follows_albedo_and_incidence(void **state) {
    (void)state;
    double white = energy_of(matt(0.8f), 0), dark = energy_of(matt(0.08f), 0);
    assert_true(fabs(white / dark - 10) < 0.01);
    double r = 2 * sqrt(2.0), cos45 = sqrt(0.5);
    double expected = 0.8 * cos45 * (1 - material_fresnel(0, cos45)) / (1 + r * r / 4);
    assert_true(fabs(energy_of(matt(0.8f), 1) / expected - 1) < 1e-4);
}

static void a_reflector_is_bright_and_a_mirror_shows_what_is_elsewhere(void **state) {
    (void)state;
    struct material sign = matt(0.5f), chrome = matt(0.9f);
    sign.kind = MATERIAL_RETRO;
    sign.retro = 20;
    assert_true(energy_of(sign, 0.2) > 15 * energy_of(matt(0.5f), 0.2));
    chrome.kind = MATERIAL_METAL;
    chrome.roughness = 0;
    assert_true(energy_of(chrome, 0.5) < 0.1 * energy_of(matt(0.5f), 0.5));
}

static void glass_lets_the_beam_through_and_truth_knows_both_surfaces(void **state) {
    (void)state;
    struct material glass = matt(0.01f);
    glass.kind = MATERIAL_GLASS;
    glass.f0 = 0.06f;
    glass.transmission_ir = 0.8f;
    struct scene *scene = plates(glass, 2, 0, 4);
    struct optics optics = optics_ideal();
    struct optics_beam beam = ahead(0.3);
    struct rng rng = rng_make(1);
    struct optics_echo e;
    optics_shoot(scene, &optics, &beam, &rng, &e);
    double slant = sqrt(1 + 0.3 * 0.3);
    assert_true(e.distance_m > 3.7 * slant &&
                e.distance_m < 4 * slant); /* a little dust is on the pane */
    struct trace_ray ray = {beam.origin_m, beam.dir, 0, INFINITY};
    struct scene_truth truth;
    scene_truth_of(scene, &ray, &truth);
    assert_true(truth.hit && truth.behind);
    assert_true(fabs(truth.first.t_m - 2 * slant) < 1e-9);
    assert_true(fabs(truth.second.t_m - 4 * slant) < 1e-9);
    assert_true(fabs(truth.second.normal.x + 1) < 1e-9);
    scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(range_errors_have_the_configured_mean_sigma_and_shape),
        cmocka_unit_test(weaker_echoes_are_noisier_and_too_weak_ones_dropped_or_not_seen),
        cmocka_unit_test(beyond_maximum_range_is_no_return_and_beyond_ambiguity_folds_back),
        cmocka_unit_test(quantisation_dropouts_and_outliers_happen_as_often_as_told),
        cmocka_unit_test(a_silhouette_gives_points_floating_between_the_surfaces),
        cmocka_unit_test(grazing_incidence_spreads_one_surface_but_mixes_nothing),
        cmocka_unit_test(one_ray_never_mixes),
        cmocka_unit_test(echo_follows_albedo_and_incidence),
        cmocka_unit_test(a_reflector_is_bright_and_a_mirror_shows_what_is_elsewhere),
        cmocka_unit_test(glass_lets_the_beam_through_and_truth_knows_both_surfaces),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
