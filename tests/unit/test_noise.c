/* Noise measured from scan lines, and clocks fitted to each other. */
#include "base/clock_fit.h"
#include "base/rng.h"
#include "fusion/noise.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

/* A wall at 3 m seen by a turning beam, with jumps to another at 5 m now and then. */
static void feed(struct noise_meter *meter, double sigma_m, double intensity, uint64_t seed) {
    struct rng rng = rng_make(seed);
    for (int line = 0; line < 40; line++) {
        for (int i = 0; i < 500; i++) {
            double angle = (i - 250) * 0.002, wall = (i / 60) % 2 ? 5.0 : 3.0;
            noise_meter_add(meter, wall / cos(angle) + sigma_m * rng_normal(&rng), intensity);
        }
        noise_meter_add(meter, (double)NAN, (double)NAN);
    }
}

static void measures_the_noise_of_a_wall_with_edges(void **state) {
    (void)state;
    static struct noise_meter meter;
    struct noise_model model = noise_model_constant(1.0, 0.0);
    noise_meter_init(&meter);
    feed(&meter, 0.004, 0.6, 1);
    feed(&meter, 0.012, 0.1, 2);
    assert_true(noise_meter_read(&meter, 1e-4, &model));
    assert_true(model.measured);
    /* 1240 windows, a quarter of them with an edge */
    assert_true(fabs(model.sigma_m[noise_class(0.6)] / 0.004 - 1.0) < 0.05);
    assert_true(fabs(model.sigma_m[noise_class(0.1)] / 0.012 - 1.0) < 0.05);
    assert_true(noise_sigma(&model, 0.01, 3.0) > 0.015); /* weaker than ever seen: worse */
}

/* Every other stretch of a line is rough with three times the noise, and is not taken for noise. */
static void rough_ground_is_not_noise(void **state) {
    (void)state;
    static struct noise_meter meter;
    struct noise_model model;
    struct rng rng = rng_make(5);
    noise_meter_init(&meter);
    for (int i = 0; i < 100000; i++) {
        double rough_m = (i / 400) % 2 ? 0.006 * rng_normal(&rng) : 0.0;
        noise_meter_add(&meter, 4.0 + rough_m + 0.002 * rng_normal(&rng), 0.5);
    }
    assert_true(noise_meter_read(&meter, 1e-4, &model));
    assert_true(fabs(model.sigma_m[noise_class(0.5)] / 0.002 - 1.0) < 0.03);
}

/* Nothing but ranges: what is farther may be noisier. */
static void without_intensity_noise_goes_by_range(void **state) {
    (void)state;
    static struct noise_meter meter;
    struct noise_model model;
    struct rng rng = rng_make(7);
    noise_meter_init(&meter);
    for (int i = 0; i < 40000; i++) {
        double wall_m = (i / 200) % 2 ? 6.0 : 1.5, sigma_m = wall_m > 2.0 ? 0.008 : 0.002;
        noise_meter_add(&meter, wall_m + sigma_m * rng_normal(&rng), (double)NAN);
    }
    assert_true(noise_meter_read(&meter, 1e-4, &model));
    assert_true(model.by_range);
    assert_true(fabs(noise_sigma(&model, (double)NAN, 1.414) / 0.002 - 1.0) < 0.05);
    assert_true(fabs(noise_sigma(&model, (double)NAN, 5.657) / 0.008 - 1.0) < 0.05);
    assert_true(noise_sigma(&model, (double)NAN, 100.0) > 0.0075);
}

static void without_noise_reports_the_floor(void **state) {
    (void)state;
    static struct noise_meter meter;
    struct noise_model model;
    noise_meter_init(&meter);
    for (int i = 0; i < 5000; i++)
        noise_meter_add(&meter, 4.0, (double)NAN);
    assert_true(noise_meter_read(&meter, 1e-4, &model));
    assert_true(model.sigma_m[0] == 1e-4);
}

static void says_nothing_without_enough_samples(void **state) {
    (void)state;
    static struct noise_meter meter;
    struct noise_model model = noise_model_constant(0.5, 0.0);
    noise_meter_init(&meter);
    for (int i = 0; i < 900; i++)
        noise_meter_add(&meter, 3.0, 0.5);
    assert_false(noise_meter_read(&meter, 1e-4, &model));
    assert_true(noise_sigma(&model, 0.3, 3.0) == 0.5);
}

static void gaps_separate_runs(void **state) {
    (void)state;
    static struct noise_meter meter;
    struct noise_model model;
    noise_meter_init(&meter);
    for (int i = 0; i < 5000; i++) /* never a whole window in a row */
        noise_meter_add(&meter, i % NOISE_WINDOW == 2 ? (double)NAN : 3.0, 0.5);
    assert_false(noise_meter_read(&meter, 1e-4, &model));
}

static void finds_offset_and_drift_among_late_and_wrong_pairs(void **state) {
    (void)state;
    enum { N = 400 };
    int64_t from[N], to[N];
    struct rng rng = rng_make(3);
    for (int i = 0; i < N; i++) {
        from[i] = 1000000000000 + (int64_t)i * 250000000;
        double late = -60e3 * log(1.0 - rng_uniform(&rng)); /* exponential, 60 us */
        to[i] = 5000000000 + (int64_t)((double)from[i] * (1.0 + 21e-6)) + (int64_t)late;
        if (i % 17 == 0)
            to[i] += 250000000; /* a mismatched event */
    }
    struct clock_fit fit;
    assert_int_equal(clock_fit_make(from, to, N, &fit), ST_OK);
    assert_true(fit.used >= N * 3 / 4 && fit.used <= N - N / 17);
    assert_true(fabs(fit.rate - 1.0 - 21e-6) < 1e-6);
    int64_t want = 5000000000 + (int64_t)((double)from[200] * (1.0 + 21e-6));
    int64_t got = clock_fit_apply(&fit, from[200]);
    assert_true(got - want > 0 && got - want < 100000); /* late by about the mean lateness */
    int64_t back = clock_fit_invert(&fit, got);
    assert_true(back - from[200] < 3 && from[200] - back < 3);
}

static void one_pair_is_an_offset(void **state) {
    (void)state;
    int64_t from = 7, to = -1000;
    struct clock_fit fit;
    assert_int_equal(clock_fit_make(&from, &to, 1, &fit), ST_OK);
    assert_int_equal(clock_fit_apply(&fit, 17), -990);
    assert_int_equal(clock_fit_make(&from, &to, 0, &fit), ST_INVALID);
}

static void refuses_clocks_that_are_none(void **state) {
    (void)state;
    int64_t from[3] = {0, 1000, 2000}, twice[3] = {0, 2000, 4000}, same[3] = {5, 5, 5};
    struct clock_fit fit;
    assert_int_equal(clock_fit_make(from, twice, 3, &fit), ST_SINGULAR);
    assert_int_equal(clock_fit_make(same, from, 3, &fit), ST_SINGULAR);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(measures_the_noise_of_a_wall_with_edges),
        cmocka_unit_test(rough_ground_is_not_noise),
        cmocka_unit_test(without_intensity_noise_goes_by_range),
        cmocka_unit_test(without_noise_reports_the_floor),
        cmocka_unit_test(says_nothing_without_enough_samples),
        cmocka_unit_test(gaps_separate_runs),
        cmocka_unit_test(finds_offset_and_drift_among_late_and_wrong_pairs),
        cmocka_unit_test(one_pair_is_an_offset),
        cmocka_unit_test(refuses_clocks_that_are_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
