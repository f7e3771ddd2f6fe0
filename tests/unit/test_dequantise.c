/* Dequantisation on surfaces whose truth is known. */
#include "import/dequantise.h"

#include <math.h>
#include <omp.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

enum { W = 128, H = 96 };

static float truth[H][W], stored[H][W], estimate[H][W], sigma[H][W];

static struct image_f32 view(float *px) {
    struct image_f32 im = {px, W, H, 1, W};
    return im;
}

static double plane(double u, double v) {
    return 20.0 + 0.037 * u + 0.021 * v;
}
static double wave(double u, double v) {
    return 50.0 + 3.0 * sin(u / 40.0) + 2.0 * cos(v / 33.0);
}
static double ball(double u, double v) {
    double r2 = (u - 64.0) * (u - 64.0) + (v - 48.0) * (v - 48.0);
    return r2 < 1764.0 ? 60.0 + 15.0 * sqrt(1.0 - r2 / 1764.0) : 10.0 + 0.013 * u;
}
static double gentle(double u, double v) {
    return 50.0 + 0.5 * sin(u / 60.0) + 1e-5 * v * v;
}
static double step_edge(double u, double v) {
    return 50.0 + (u > 70.0 ? 20.0 : 0.0) + 0.05 * v;
}

static void run(double (*surface)(double, double), float step) {
    for (int v = 0; v < H; v++)
        for (int u = 0; u < W; u++) {
            truth[v][u] = (float)surface(u, v) * step;
            stored[v][u] = step * roundf(truth[v][u] / step);
        }
    struct image_f32 in = view(&stored[0][0]), out = view(&estimate[0][0]), s = view(&sigma[0][0]);
    struct dequantise_options options = {.step = step};
    assert_int_equal(dequantise(&in, &options, &out, &s, NULL), ST_OK);
    /* whatever the surface: no pixel leaves its interval */
    for (int v = 0; v < H; v++)
        for (int u = 0; u < W; u++)
            assert_true(fabsf(estimate[v][u] - stored[v][u]) <= 0.5001f * step);
}

static double rms_of(float (*a)[W]) {
    double sum = 0;
    for (int v = 0; v < H; v++)
        for (int u = 0; u < W; u++)
            sum += pow((double)a[v][u] - (double)truth[v][u], 2);
    return sqrt(sum / (W * H));
}

static void restores_a_plane_to_a_hundredth_of_a_step(void **state) {
    (void)state;
    run(plane, 1.0f);
    assert_true(rms_of(stored) > 0.28);
    assert_true(rms_of(estimate) < 0.01);
}

static void errs_less_than_half_of_rounding_on_curved_surfaces(void **state) {
    (void)state;
    double (*surfaces[])(double, double) = {wave, ball};
    for (int i = 0; i < 2; i++) {
        run(surfaces[i], 0.25f); /* in another unit: nothing depends on a step of 1 */
        assert_true(rms_of(estimate) < rms_of(stored) / 2.0);
    }
}

static void does_not_smooth_across_a_jump(void **state) {
    (void)state;
    run(step_edge, 1.0f);
    for (int v = 10; v < H - 10; v++) {
        assert_true(fabsf(estimate[v][70] - truth[v][70]) < 0.1f);
        assert_true(fabsf(estimate[v][71] - truth[v][71]) < 0.1f);
    }
}

/* Per surface, so that a plateau's large sigma cannot pay for a slope's small one. */
static void claims_no_less_than_the_error_seen(void **state) {
    (void)state;
    double (*surfaces[])(double, double) = {plane, wave, ball, gentle, step_edge};
    for (int i = 0; i < 5; i++) {
        run(surfaces[i], 1.0f);
        for (int wide = 0; wide < 2; wide++) {
            double chi2 = 0;
            int n = 0;
            for (int v = 0; v < H; v++)
                for (int u = 0; u < W; u++)
                    if ((sigma[v][u] > 0.2f) == wide) {
                        chi2 +=
                            pow((double)(estimate[v][u] - truth[v][u]) / (double)sigma[v][u], 2);
                        n++;
                    }
            if (n > 500)
                assert_true(chi2 / n < 1.2); /* 1 is a sigma that fits; few plateaus scatter */
        }
    }
}

static void keeps_unknown_pixels_unknown_and_lone_pixels_as_they_are(void **state) {
    (void)state;
    for (int v = 0; v < H; v++)
        for (int u = 0; u < W; u++)
            stored[v][u] = (u + v) % 2 ? NAN : 7.0f;
    struct image_f32 in = view(&stored[0][0]), out = view(&estimate[0][0]), s = view(&sigma[0][0]);
    struct dequantise_options options = {.step = 1.0f};
    assert_int_equal(dequantise(&in, &options, &out, &s, NULL), ST_OK);
    for (int v = 0; v < H; v++)
        for (int u = 0; u < W; u++)
            if ((u + v) % 2) {
                assert_true(isnan(estimate[v][u]) && isnan(sigma[v][u]));
            } else {
                assert_true(estimate[v][u] == 7.0f);
                assert_true(fabsf(sigma[v][u] - sqrtf(1.0f / 12.0f)) < 1e-4f);
            }
}

static void same_bytes_for_any_number_of_threads(void **state) {
    (void)state;
    enum { LARGE_W = 400, LARGE_H = 300 }; /* large enough to be shared out */
    static float in_px[LARGE_H * LARGE_W], out_px[2][LARGE_H * LARGE_W];
    for (int i = 0; i < LARGE_H * LARGE_W; i++)
        in_px[i] = (float)round(wave(i % LARGE_W, i / LARGE_W));
    const struct dequantise_options options = {.step = 1.0f, .iterations = 8};
    const int before = omp_get_max_threads();
    for (int k = 0; k < 2; k++) {
        const struct image_f32 in = {in_px, LARGE_W, LARGE_H, 1, LARGE_W};
        struct image_f32 out = {out_px[k], LARGE_W, LARGE_H, 1, LARGE_W};
        omp_set_num_threads(k ? 3 : 1);
        assert_int_equal(dequantise(&in, &options, &out, NULL, NULL), ST_OK);
    }
    omp_set_num_threads(before);
    assert_memory_equal(out_px[0], out_px[1], sizeof out_px[0]);
    assert_memory_not_equal(out_px[0], in_px, sizeof in_px);
}

static void takes_one_pixel_and_none_and_refuses_nonsense(void **state) {
    (void)state;
    float px = 3.0f, out_px = 0;
    struct image_f32 in = {&px, 1, 1, 1, 1}, out = {&out_px, 1, 1, 1, 1}, none = {NULL, 0, 0, 1, 0};
    struct dequantise_options options = {.step = 1.0f};
    assert_int_equal(dequantise(&in, &options, &out, NULL, NULL), ST_OK);
    assert_true(out_px == 3.0f);
    struct image_f32 none_out = none;
    assert_int_equal(dequantise(&none, &options, &none_out, NULL, NULL), ST_OK);
    assert_int_equal(dequantise(&in, &options, &none_out, NULL, NULL), ST_INVALID);
    options.step = 0.0f;
    assert_int_equal(dequantise(&in, &options, &out, NULL, NULL), ST_INVALID);
    options.step = NAN;
    assert_int_equal(dequantise(&in, &options, &out, NULL, NULL), ST_INVALID);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(restores_a_plane_to_a_hundredth_of_a_step),
        cmocka_unit_test(errs_less_than_half_of_rounding_on_curved_surfaces),
        cmocka_unit_test(does_not_smooth_across_a_jump),
        cmocka_unit_test(claims_no_less_than_the_error_seen),
        cmocka_unit_test(keeps_unknown_pixels_unknown_and_lone_pixels_as_they_are),
        cmocka_unit_test(same_bytes_for_any_number_of_threads),
        cmocka_unit_test(takes_one_pixel_and_none_and_refuses_nonsense),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
