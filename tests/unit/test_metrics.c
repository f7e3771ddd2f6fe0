/* PSNR, SSIM and coverage against figures that follow from their definitions. */
#include "raster/metrics.h"
#include "tests/support/cmocka_all.h"

#include <math.h>
#include <string.h>

enum { W = 24, H = 20 };

static void fill(uint8_t rgba[H * W * 4], uint8_t truth[H * W * 3]) {
    for (size_t i = 0; i < H * W; i++) {
        for (size_t k = 0; k < 3; k++)
            rgba[4 * i + k] = truth[3 * i + k] = (uint8_t)(40 + (i * 7 + k * 31) % 150);
        rgba[4 * i + 3] = 255;
    }
}

static void equal_pictures_have_no_error(void **state) {
    (void)state;
    uint8_t rgba[H * W * 4], truth[H * W * 3];
    fill(rgba, truth);
    struct metrics m;
    assert_int_equal(metrics_compare(rgba, truth, NULL, W, H, &m), 0);
    assert_true(isinf(m.psnr_db) && m.psnr_db > 0);
    assert_true(fabs(m.ssim - 1.0) < 1e-12);
    assert_true(m.coverage == 1.0 && m.covered_px == W * H);
}

static void psnr_is_that_of_a_constant_difference(void **state) {
    (void)state;
    uint8_t rgba[H * W * 4], truth[H * W * 3];
    fill(rgba, truth);
    for (size_t i = 0; i < H * W; i++)
        for (size_t k = 0; k < 3; k++)
            rgba[4 * i + k] = (uint8_t)(rgba[4 * i + k] + 10);
    struct metrics m;
    assert_int_equal(metrics_compare(rgba, truth, NULL, W, H, &m), 0);
    assert_true(fabs(m.psnr_db - 20.0 * log10(25.5)) < 1e-9);
}

static void ssim_of_flat_pictures_is_their_luminance_term(void **state) {
    (void)state;
    uint8_t rgba[H * W * 4], truth[H * W * 3];
    memset(truth, 100, sizeof truth);
    for (size_t i = 0; i < H * W; i++) {
        memset(rgba + 4 * i, 140, 3);
        rgba[4 * i + 3] = 255;
    }
    struct metrics m;
    assert_int_equal(metrics_compare(rgba, truth, NULL, W, H, &m), 0);
    double c1 = 2.55 * 2.55;
    assert_true(fabs(m.ssim - (2.0 * 140 * 100 + c1) / (140.0 * 140 + 100.0 * 100 + c1)) < 1e-9);
}

static void only_covered_pixels_that_count_are_compared(void **state) {
    (void)state;
    uint8_t rgba[H * W * 4], truth[H * W * 3], counts[H * W];
    fill(rgba, truth);
    memset(counts, 1, sizeof counts);
    for (size_t i = 0; i < H * W / 4; i++) { /* wrong, and said not to be covered */
        rgba[4 * i] ^= 0x80;
        rgba[4 * i + 3] = i % 2 ? 0 : 128;
    }
    for (size_t i = H * W / 2; i < H * W; i++) { /* wrong, and said not to count */
        rgba[4 * i] ^= 0x80;
        counts[i] = 0;
    }
    struct metrics m;
    assert_int_equal(metrics_compare(rgba, truth, counts, W, H, &m), 0);
    assert_true(isinf(m.psnr_db));
    assert_true(fabs(m.ssim - 1.0) < 1e-12);
    assert_true(fabs(m.coverage - 0.5) < 1e-12);
}

static void nothing_covered_has_no_figure(void **state) {
    (void)state;
    uint8_t rgba[H * W * 4], truth[H * W * 3];
    fill(rgba, truth);
    for (size_t i = 0; i < H * W; i++)
        rgba[4 * i + 3] = 0;
    struct metrics m;
    assert_int_equal(metrics_compare(rgba, truth, NULL, W, H, &m), 0);
    assert_true(isnan(m.psnr_db) && isnan(m.ssim) && m.coverage == 0.0);
    assert_int_equal(metrics_compare(rgba, truth, NULL, 0, H, &m), ST_INVALID);
}

static void the_rim_is_what_hangs_together_with_the_border(void **state) {
    (void)state;
    uint8_t rgb[H * W * 3], counts[H * W];
    memset(rgb, 90, sizeof rgb);
    static const uint8_t white[3] = {255, 255, 255};
    for (size_t x = 0; x < W; x++)
        memset(rgb + 3 * (3 * W + x), 255, 3); /* a white line across, */
    memset(rgb + 3 * (10 * W + 10), 255, 3);   /* a white spot inside, */
    memset(rgb + 3 * (4 * W + 5), 255, 3);     /* one below the line, */
    memset(rgb + 3 * (5 * W + 6), 255, 3);     /* and one that only touches that at a corner */
    assert_int_equal(metrics_rim_mask(rgb, W, H, white, counts), W * H - W - 1);
    assert_int_equal(counts[3 * W + 7], 0);
    assert_int_equal(counts[4 * W + 5], 0);
    assert_int_equal(counts[5 * W + 6], 1);
    assert_int_equal(counts[10 * W + 10], 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equal_pictures_have_no_error),
        cmocka_unit_test(psnr_is_that_of_a_constant_difference),
        cmocka_unit_test(ssim_of_flat_pictures_is_their_luminance_term),
        cmocka_unit_test(only_covered_pixels_that_count_are_compared),
        cmocka_unit_test(nothing_covered_has_no_figure),
        cmocka_unit_test(the_rim_is_what_hangs_together_with_the_border),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
