/* Samples to photographs: the extremes. */
#include "base/rng.h"
#include "fusion/face.h"
#include "fusion/resolve.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

enum { SIZE = 64 };

/* A photograph of SIZE x SIZE px looking along +x, from samples. */
static struct photo shoot_with(const struct scatter_sample *samples, size_t count,
                               const struct layer_params *lp, const struct resolve_params *rp,
                               struct resolve_counts *out_counts) {
    struct camera camera = camera_pinhole(SIZE, SIZE, 1.0);
    struct pose pose = face_station_from_cam(0);
    struct layer_image image;
    struct photo photo;
    struct errctx err;
    assert_int_equal(layer_create(&camera, &pose, lp, &image, &err), ST_OK);
    assert_int_equal(layer_add(&image, samples, count), ST_OK);
    assert_int_equal(photo_create(&camera, &photo, &err), ST_OK);
    assert_int_equal(resolve_photo(&image, rp, 1, &photo, out_counts, &err), ST_OK);
    layer_destroy(&image);
    return photo;
}

static struct photo shoot(const struct scatter_sample *samples, size_t count,
                          struct resolve_counts *out_counts) {
    struct layer_params lp = layer_params_default();
    struct resolve_params rp = resolve_params_default();
    return shoot_with(samples, count, &lp, &rp, out_counts);
}

static struct scatter_sample at(double x, double y, double z, double sigma_m) {
    struct scatter_sample s = {.p_m = {(float)x, (float)y, (float)z},
                               .sigma_m = (float)sigma_m,
                               .intensity = 0.5f,
                               .flags = SAMPLE_INTENSITY};
    return s;
}

/* A sample on the ray through (u, v) at depth z. */
static struct scatter_sample through(double u, double v, double depth_m, double sigma_m) {
    struct camera camera = camera_pinhole(SIZE, SIZE, 1.0);
    struct pose pose = face_station_from_cam(0);
    struct vec3 p = pose_apply(&pose, vec3_scale(camera_pinhole_ray(&camera, u, v), depth_m));
    return at(p.x, p.y, p.z, sigma_m);
}

static void no_samples_give_an_unseen_photograph(void **state) {
    (void)state;
    struct resolve_counts counts;
    struct photo photo = shoot(NULL, 0, &counts);
    assert_int_equal(counts.unseen, SIZE * SIZE);
    for (int i = 0; i < SIZE * SIZE; i++) {
        assert_true(isnan(photo.disparity_per_m[i]));
        assert_int_equal(photo.flags[i], 0);
    }
    photo_destroy(&photo);
}

static void one_sample_is_where_it_was_measured(void **state) {
    (void)state;
    struct scatter_sample s = through(20.0, 30.0, 4.0, 0.01);
    struct resolve_counts counts;
    struct photo photo = shoot(&s, 1, &counts);
    size_t i = 30 * SIZE + 20;
    assert_int_equal(counts.valid, 1); /* its neighbours are a whole pixel away: weight 0 */
    assert_true(fabsf(photo.disparity_per_m[i] - 0.25f) < 1e-6f);
    /* sigma of 1/Z: sigma Z'/R = sigma delta / R, and no better than that */
    double sigma = photo_sigma_from_confidence(photo.confidence[i]);
    double range = 4.0 * vec3_norm(camera_pinhole_ray(&photo.camera, 20, 30));
    assert_true(sigma >= 0.01 * 0.25 / range * 0.999 && sigma < 0.01 * 0.25 / range * 1.08);
    photo_destroy(&photo);
}

static void all_samples_at_one_pixel_average(void **state) {
    (void)state;
    enum { N = 100000 };
    struct scatter_sample *s = malloc(N * sizeof *s);
    struct rng rng = rng_make(1);
    for (int i = 0; i < N; i++)
        s[i] = through(20.0, 30.0, 4.0 + 0.01 * rng_normal(&rng), 0.01);
    struct resolve_counts counts;
    struct photo photo = shoot(s, N, &counts);
    assert_int_equal(counts.valid, 1);
    /* 10 mm / sqrt(100 000) is 0.03 mm; float sums and clipped tails allow a tenth of a mm */
    assert_true(fabsf(1.0f / photo.disparity_per_m[30 * SIZE + 20] - 4.0f) < 1e-4f);
    photo_destroy(&photo);
    free(s);
}

static void two_surfaces_in_a_pixel_are_not_averaged(void **state) {
    (void)state;
    struct scatter_sample s[5] = {through(20, 30, 0.05, 0.0005), through(20, 30, 1000, 0.1),
                                  through(20, 30, 1000, 0.1), through(20, 30, 1000, 0.1),
                                  through(20, 30, 0.05, 0.0005)};
    struct resolve_counts counts;
    struct photo photo = shoot(s, 5, &counts);
    size_t i = 30 * SIZE + 20;
    assert_true(fabsf(photo.disparity_per_m[i] - 0.001f) < 1e-6f); /* three against two */
    assert_true(photo.flags[i] & PHOTO_MIXED);
    photo_destroy(&photo);
    photo = shoot(s, 2, &counts); /* one against one: the nearer */
    assert_true(fabsf(photo.disparity_per_m[i] - 20.0f) < 1e-3f);
    photo_destroy(&photo);
}

/* What a sensor at the end of its range gives: one distance everywhere. */
static void samples_all_at_the_largest_range_are_one_surface(void **state) {
    (void)state;
    enum { N = 20000 };
    static struct scatter_sample s[N];
    struct rng rng = rng_make(9);
    struct camera c = camera_pinhole(SIZE, SIZE, 1.0);
    for (int i = 0; i < N; i++) {
        double u = rng_range(&rng, -1, SIZE), v = rng_range(&rng, -1, SIZE);
        s[i] = through(u, v, 655.35 / vec3_norm(camera_pinhole_ray(&c, u, v)), 0.02);
    }
    struct resolve_counts counts;
    struct photo photo = shoot(s, N, &counts);
    assert_int_equal(counts.valid, SIZE * SIZE);
    assert_int_equal(counts.refused, 0);
    for (int i = 0; i < SIZE * SIZE; i++) {
        double norm = vec3_norm(camera_pinhole_ray(&c, i % SIZE, (double)(i / SIZE)));
        /* the sphere bends by R / f^2 = 0.2 m within a pixel; where only one side is known, that */
        assert_true(fabs(norm / (double)photo.disparity_per_m[i] - 655.35) < 0.2);
    }
    photo_destroy(&photo);
}

static void impossible_samples_are_left_out(void **state) {
    (void)state;
    struct scatter_sample s[6] = {at(0, 0, 0, 0.01),         at((double)NAN, 1, 1, 0.01),
                                  at(INFINITY, 0, 0, 0.01),  at(-3, 0, 0, 0.01),
                                  at(1e-30, 1e-31, 0, 0.01), at(3, 100, 0, 0.01)};
    struct resolve_counts counts;
    struct photo photo = shoot(s, 6, &counts);
    assert_int_equal(counts.valid, 0);
    photo_destroy(&photo);
}

static void range_zero_counts_as_dropped(void **state) {
    (void)state;
    struct polar_sample polar[3] = {{.azimuth_rad = 0.0, .range_m = 0.0f},
                                    {.azimuth_rad = 0.0, .range_m = NAN},
                                    {.azimuth_rad = 0.1, .range_m = 2.0f}};
    struct scatter_sample s[3];
    struct scatter_noise noise = {0.01, 0.001};
    scatter_from_polar(polar, 3, vec3_make(0, 0, 0), &noise, s);
    assert_true(s[0].flags & SAMPLE_DROPPED);
    assert_true(s[1].flags & SAMPLE_DROPPED);
    assert_int_equal(s[2].flags, 0);
    assert_true(fabsf(s[2].sigma_m - (float)hypot(0.01, 0.002)) < 1e-6f);
    struct resolve_counts counts;
    struct photo photo = shoot(s, 2, &counts);
    assert_int_equal(counts.valid, 0);
    assert_true(counts.dropped > 0);
    photo_destroy(&photo);
}

static void sigma_zero_is_not_believed(void **state) {
    (void)state;
    struct scatter_sample s[2] = {through(20, 30, 4, 0.0), through(20, 30, 4.00001, 0.0)};
    struct resolve_counts counts;
    struct photo photo = shoot(s, 2, &counts);
    size_t i = 30 * SIZE + 20;
    assert_true(fabsf(photo.disparity_per_m[i] - 0.25f) < 1e-5f);
    double sigma_m = photo_sigma_from_confidence(photo.confidence[i]) * 16.0;
    assert_true(sigma_m > 5e-5 && sigma_m < 2e-4); /* the floor of 0.1 mm, over sqrt(2) */
    photo_destroy(&photo);
}

static void no_return_and_dropped_stay_apart(void **state) {
    (void)state;
    struct scatter_sample s[3] = {through(10, 10, 1, 0.01), through(20, 20, 1, 0.01),
                                  through(30, 30, 5, 0.01)};
    s[0].flags = SAMPLE_NO_RETURN;
    s[1].flags = SAMPLE_DROPPED;
    struct resolve_counts counts;
    struct photo photo = shoot(s, 3, &counts);
    assert_int_equal(photo.flags[10 * SIZE + 10], PHOTO_NO_RETURN);
    assert_int_equal(photo.flags[20 * SIZE + 20], PHOTO_DROPPED);
    assert_int_equal(photo.flags[40 * SIZE + 40], 0);
    assert_true(photo.disparity_per_m[30 * SIZE + 30] > 0.0f);
    photo_destroy(&photo);
}

/* Every second pixel each way has a sample: a splat of 2 px fills what lies between, and says so.
 */
static void splat_size_sets_what_is_filled(void **state) {
    (void)state;
    enum { N = 32 * 32 };
    struct scatter_sample s[N];
    for (int i = 0; i < N; i++)
        s[i] = through(2.0 * (i % 32), 2.0 * (double)(i / 32), 3.0, 0.01);
    struct layer_params lp = layer_params_default();
    struct resolve_params rp = resolve_params_default();
    struct resolve_counts counts;
    struct photo photo = shoot_with(s, N, &lp, &rp, &counts);
    assert_int_equal(counts.valid, N);
    photo_destroy(&photo);
    lp.splat_px = 2.0;
    photo = shoot_with(s, N, &lp, &rp, &counts);
    assert_int_equal(counts.valid, SIZE * SIZE);
    assert_int_equal(counts.filled, SIZE * SIZE - N);
    assert_false(photo.flags[2 * SIZE + 2] & PHOTO_FILLED);
    assert_true(photo.flags[2 * SIZE + 3] & PHOTO_FILLED);
    photo_destroy(&photo);
}

static void a_large_region_without_return_above_is_sky(void **state) {
    (void)state;
    struct scatter_sample *s = malloc(SIZE * SIZE * sizeof *s);
    for (int i = 0; i < SIZE * SIZE; i++) {
        s[i] = through(i % SIZE, (double)(i / SIZE), 5.0, 0.01);
        if (i / SIZE < 20 || (i % SIZE < 4 && i / SIZE > 60)) /* the upper part; and a dark thing */
            s[i].flags = SAMPLE_NO_RETURN;
    }
    struct resolve_counts counts;
    struct photo photo = shoot(s, SIZE * SIZE, &counts);
    assert_int_equal(counts.sky, 20 * SIZE);
    assert_true(photo.disparity_per_m[0] == 0.0f);
    assert_true(photo.flags[0] & PHOTO_SKY);
    assert_int_equal(photo.flags[62 * SIZE + 1], PHOTO_NO_RETURN);
    photo_destroy(&photo);
    free(s);
}

/* A floor seen at 89.9 degrees: 2 mm below the eye, pixels far apart in range. */
static void grazing_surfaces_stay_surfaces(void **state) {
    (void)state;
    enum { N = 60000 };
    struct scatter_sample *s = malloc(N * sizeof *s);
    struct rng rng = rng_make(5);
    double h = 0.05; /* below the eye: at 28 m the incidence is 89.9 degrees */
    for (int i = 0; i < N; i++) {
        double u = rng_range(&rng, 0, SIZE - 1), v = rng_range(&rng, 32.0, SIZE - 1);
        struct camera c = camera_pinhole(SIZE, SIZE, 1.0);
        struct vec3 ray = camera_pinhole_ray(&c, u, v);
        double depth = h / ray.y;
        s[i] = through(u, v, depth, 1e-4 + 1e-4 * depth);
    }
    struct resolve_counts counts;
    struct photo photo = shoot(s, N, &counts);
    int good = 0, all = 0;
    for (int v = 34; v < SIZE - 1; v++)
        for (int u = 1; u < SIZE - 1; u++) {
            size_t i = (size_t)(v * SIZE + u);
            double truth = camera_pinhole_ray(&photo.camera, u, v).y / h;
            all++;
            /* a tenth of what one row changes */
            good += fabs((double)photo.disparity_per_m[i] - truth) < 0.1 / photo.camera.fy_px / h;
        }
    assert_true(good > all * 98 / 100);
    photo_destroy(&photo);
    free(s);
}

static void refuses_what_makes_no_sense(void **state) {
    (void)state;
    struct camera camera = camera_pinhole(SIZE, SIZE, 1.0);
    struct pose pose = pose_identity();
    struct layer_params lp = layer_params_default();
    struct layer_image image;
    struct errctx err;
    lp.splat_px = 0.5;
    assert_int_equal(layer_create(&camera, &pose, &lp, &image, &err), ST_INVALID);
    lp = layer_params_default();
    lp.sigma_floor_m = 0.0;
    assert_int_equal(layer_create(&camera, &pose, &lp, &image, &err), ST_INVALID);
    lp = layer_params_default();
    camera.k1 = 0.1;
    assert_int_equal(layer_create(&camera, &pose, &lp, &image, &err), ST_INVALID);
}

static void layers_of_a_pixel_are_bounded(void **state) {
    (void)state;
    struct cluster_pixel pixel = {0};
    struct cluster_rule rule = {.sigmas = 3.0f, .slope_per_px = 0.001f};
    for (int i = 0; i < 1000; i++) { /* a thousand surfaces in one pixel */
        struct cluster_entry e = {
            .weight = 0.5f, .disparity_per_m = 0.1f + 0.01f * (float)i, .sigma_per_m = 1e-5f};
        cluster_add(&pixel, &e, &rule);
    }
    assert_int_equal(pixel.layer_count, CLUSTER_LAYERS);
    assert_true(fabsf(pixel.lost_weight - 0.5f * (1000 - CLUSTER_LAYERS)) < 1e-3f);
}

static void faces_meet_without_a_seam(void **state) {
    (void)state;
    struct camera camera = face_camera(64);
    for (int face = 0; face < FACE_COUNT; face++) {
        struct pose pose = face_station_from_cam(face);
        assert_true(pose_orthonormality_error(&pose.r) < 1e-12);
    }
    /* the second column of one face looks where the last but one of its neighbour does */
    struct pose front = face_station_from_cam(0), left = face_station_from_cam(1);
    struct vec3 a = vec3_unit(mat3_mulv(&front.r, camera_pinhole_ray(&camera, 1, 32)));
    struct vec3 b = vec3_unit(mat3_mulv(&left.r, camera_pinhole_ray(&camera, 62, 32)));
    assert_true(vec3_norm(vec3_sub(a, b)) < 1e-12);
}

static void spacing_of_a_grid_is_found(void **state) {
    (void)state;
    static const double spacings[3] = {0.004, 0.011, 0.02};
    for (int k = 0; k < 3; k++) {
        size_t n = (size_t)(1.2 / spacings[k]), count = 0;
        struct scatter_sample *s = malloc(n * n * sizeof *s);
        for (size_t i = 0; i < n * n; i++) {
            double az = -0.6 + spacings[k] * (double)(i % n),
                   el = -0.6 + spacings[k] * (double)(i / n);
            s[count++] = at(3 * cos(el) * cos(az), 3 * cos(el) * sin(az), 3 * sin(el), 0.01);
        }
        struct scatter_array array;
        struct scatter_source source = scatter_source_array(&array, s, count);
        struct face_survey survey;
        struct errctx err;
        assert_int_equal(face_survey_source(&source, &survey, &err), ST_OK);
        assert_true(survey.spacing_rad > 0.7 * spacings[k] &&
                    survey.spacing_rad < 1.5 * spacings[k]);
        assert_true(survey.half_angle_rad > 0.6 && survey.half_angle_rad < 0.873);
        free(s);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(no_samples_give_an_unseen_photograph),
        cmocka_unit_test(one_sample_is_where_it_was_measured),
        cmocka_unit_test(all_samples_at_one_pixel_average),
        cmocka_unit_test(two_surfaces_in_a_pixel_are_not_averaged),
        cmocka_unit_test(samples_all_at_the_largest_range_are_one_surface),
        cmocka_unit_test(impossible_samples_are_left_out),
        cmocka_unit_test(range_zero_counts_as_dropped),
        cmocka_unit_test(sigma_zero_is_not_believed),
        cmocka_unit_test(no_return_and_dropped_stay_apart),
        cmocka_unit_test(splat_size_sets_what_is_filled),
        cmocka_unit_test(a_large_region_without_return_above_is_sky),
        cmocka_unit_test(grazing_surfaces_stay_surfaces),
        cmocka_unit_test(refuses_what_makes_no_sense),
        cmocka_unit_test(layers_of_a_pixel_are_bounded),
        cmocka_unit_test(faces_meet_without_a_seam),
        cmocka_unit_test(spacing_of_a_grid_is_found),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
