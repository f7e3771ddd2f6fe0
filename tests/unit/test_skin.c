/* Skins by the first heuristic, cracks, and the bounds of the unknown. */
#include "raster/skin.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/draw.h"

#include <math.h>

enum { W = 40, H = 36 };

static struct camera cam(void) {
    return camera_pinhole(W, H, 0.8);
}

static void a_plane_has_no_skins_however_steep(void **state) {
    (void)state;
    struct camera c = cam();
    for (int k = 1; k <= 4; k++) { /* up to a wall at 88.6 degrees of incidence */
        struct photo photo = draw_blank(&c);
        for (int i = 0; i < W * H; i++)
            photo.disparity_per_m[i] = 0.1f + 0.05f * (float)(k * (i % W));
        struct skin_params params = skin_params_default();
        assert_int_equal(skin_mark(&photo, &params), 0);
        photo_destroy(&photo);
    }
}

/* A square at 2 m before a wall at 4 m. */
static struct photo step_photo(void) {
    struct camera c = cam();
    struct photo photo = draw_wall(&c, 0.25f);
    for (int v = 10; v < 20; v++)
        for (int u = 10; u < 20; u++)
            photo.disparity_per_m[v * W + u] = 0.5f;
    return photo;
}

static void a_step_has_skins_all_around_and_nowhere_else(void **state) {
    (void)state;
    struct photo photo = step_photo();
    /* At a focal length of 47 px 80 degrees allow a step of 12 % a pixel; this one is 100 %. */
    struct skin_params params = skin_params_default();
    assert_int_equal(skin_mark(&photo, &params), 4 * 10 + 4 - 4);
    for (int v = 0; v < H; v++)
        for (int u = 0; u < W; u++) {
            uint8_t f = photo.flags[v * W + u];
            bool ring =
                u >= 9 && u <= 19 && v >= 9 && v <= 19 && (u == 9 || u == 19 || v == 9 || v == 19);
            bool inside = u >= 10 && u < 20 && v >= 10 && v < 20;
            bool corner = (u == 9 || u == 20) && (v == 9 || v == 20);
            bool outside_rim = u >= 9 && u <= 20 && v >= 9 && v <= 20 && !inside && !corner;
            bool inside_rim = inside && (u == 10 || u == 19 || v == 10 || v == 19);
            assert_int_equal((f & PHOTO_SKIN) != 0, ring);
            assert_int_equal((f & PHOTO_SILHOUETTE) != 0, outside_rim || inside_rim);
            assert_int_equal((f & PHOTO_MIXED) != 0, outside_rim);
        }
    photo_destroy(&photo);
}

static void steps_within_the_noise_are_no_skins(void **state) {
    (void)state;
    struct photo photo = step_photo();
    memset(photo.confidence, photo_confidence_from_sigma(0.1), W * H); /* the step is 2.5 sigmas */
    struct skin_params params = skin_params_default();
    assert_int_equal(skin_mark(&photo, &params), 0);
    memset(photo.confidence, photo_confidence_from_sigma(0.01), W * H);
    assert_int_equal(skin_mark(&photo, &params), 40);
    photo_destroy(&photo);
}

static void stairs_of_rounding_are_no_skins_if_their_noise_is_told(void **state) {
    (void)state;
    struct camera c = cam();
    struct photo photo = draw_blank(&c);
    const double step = 0.2; /* of disparity: more than 80 degrees allow */
    for (int i = 0; i < W * H; i++)
        photo.disparity_per_m[i] = (float)(0.4 + step * round(0.13 * (i % W)));
    struct skin_params params = skin_params_default();
    assert_true(skin_mark(&photo, &params) > 0);
    memset(photo.confidence, photo_confidence_from_sigma(step / sqrt(12.0)), W * H);
    assert_int_equal(skin_mark(&photo, &params), 0);
    photo_destroy(&photo);
}

static void marking_again_clears_what_no_longer_is(void **state) {
    (void)state;
    struct photo photo = step_photo();
    struct skin_params params = skin_params_default();
    assert_true(skin_mark(&photo, &params) > 0);
    for (int i = 0; i < W * H; i++)
        photo.disparity_per_m[i] = 0.25f;
    assert_int_equal(skin_mark(&photo, &params), 0);
    for (int i = 0; i < W * H; i++)
        assert_int_equal(photo.flags[i] & (PHOTO_SKIN | PHOTO_SILHOUETTE), 0);
    photo_destroy(&photo);
}

static void cracks_in_a_surface_are_closed_and_holes_are_not(void **state) {
    (void)state;
    struct camera c = cam();
    struct photo photo = draw_blank(&c);
    for (int i = 0; i < W * H; i++)
        photo.disparity_per_m[i] = 0.5f + 0.001f * (float)(i % W);
    for (int v = 0; v < H; v++)
        photo.disparity_per_m[v * W + 7] = photo.disparity_per_m[v * W + 8] = NAN;
    for (int v = 10; v < 18; v++)
        for (int u = 20; u < 28; u++)
            photo.disparity_per_m[v * W + u] = NAN;
    photo.disparity_per_m[30 * W + 30] = NAN; /* the beam met nothing: free space, no crack */
    photo.flags[30 * W + 30] = PHOTO_NO_RETURN;
    struct skin_params params = skin_params_default();
    assert_int_equal(skin_fill_cracks(&photo, &params), 2 * H);
    for (int v = 0; v < H; v++) {
        assert_true(fabsf(photo.disparity_per_m[v * W + 7] - 0.507f) < 1e-6f);
        assert_true(fabsf(photo.disparity_per_m[v * W + 8] - 0.508f) < 1e-6f);
        assert_true(photo.flags[v * W + 7] & PHOTO_FILLED);
    }
    assert_true(isnan(photo.disparity_per_m[12 * W + 24]));
    assert_true(isnan(photo.disparity_per_m[30 * W + 30]));
    photo_destroy(&photo);
}

static void a_gap_between_two_surfaces_is_no_crack(void **state) {
    (void)state;
    struct photo photo = step_photo();
    for (int v = 12; v < 18; v++)
        photo.disparity_per_m[v * W + 9] = NAN; /* between the wall and the square */
    struct skin_params params = skin_params_default();
    /* Down the column there is wall above and below, but too far away: 6 pixels. */
    assert_int_equal(skin_fill_cracks(&photo, &params), 0);
    photo_destroy(&photo);
}

static void the_unknown_is_bounded_by_the_farthest_around(void **state) {
    (void)state;
    struct photo photo = step_photo();
    for (int v = 12; v < 18; v++)
        for (int u = 20; u < 26; u++) /* right of the square */
            photo.disparity_per_m[v * W + u] = NAN;
    photo.disparity_per_m[30 * W + 30] = NAN; /* too small to hide anything */
    for (int v = 24; v < 30; v++)
        for (int u = 5; u < 10; u++) { /* free space */
            photo.disparity_per_m[v * W + u] = NAN;
            photo.flags[v * W + u] = PHOTO_NO_RETURN;
        }
    int64_t count = 0;
    assert_int_equal(skin_bound_unknown(&photo, &count), ST_OK);
    assert_int_equal(count, 36);
    for (int v = 12; v < 18; v++)
        for (int u = 20; u < 26; u++) {
            assert_true(photo.disparity_per_m[v * W + u] == 0.25f);
            assert_true(photo.flags[v * W + u] & PHOTO_DROPPED &&
                        photo.flags[v * W + u] & PHOTO_SKIN);
        }
    assert_true(photo.flags[13 * W + 19] & PHOTO_SKIN); /* the cell from the square into the hole */
    assert_true(isnan(photo.disparity_per_m[30 * W + 30]));
    assert_true(isnan(photo.disparity_per_m[26 * W + 7]));
    photo_destroy(&photo);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_plane_has_no_skins_however_steep),
        cmocka_unit_test(a_step_has_skins_all_around_and_nowhere_else),
        cmocka_unit_test(steps_within_the_noise_are_no_skins),
        cmocka_unit_test(stairs_of_rounding_are_no_skins_if_their_noise_is_told),
        cmocka_unit_test(marking_again_clears_what_no_longer_is),
        cmocka_unit_test(cracks_in_a_surface_are_closed_and_holes_are_not),
        cmocka_unit_test(a_gap_between_two_surfaces_is_no_crack),
        cmocka_unit_test(the_unknown_is_bounded_by_the_farthest_around),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
