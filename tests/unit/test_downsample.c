/* Box filter of supersampled pictures, and pictures of depths. */
#include "raster/depth_picture.h"
#include "raster/raster.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/draw.h"

#include <math.h>

static const uint8_t background[3] = {1, 2, 3};

static void set(struct draw_target *t, size_t i, uint8_t value, uint8_t alpha, float depth) {
    memset(t->planes.rgba + 4 * i, value, 3);
    t->planes.rgba[4 * i + 3] = alpha;
    t->planes.depth[i] = depth;
}

static void sub_pixels_are_averaged_in_linear_light(void **state) {
    (void)state;
    struct draw_target fine = draw_target_make(2, 2, false), out = draw_target_make(1, 1, false);
    for (size_t i = 0; i < 4; i++)
        set(&fine, i, i < 2 ? 0 : 255, RASTER_ALPHA_SURFACE, 1.0f);
    assert_int_equal(raster_downsample(&fine.planes, 2, background, &out.planes), ST_OK);
    assert_int_equal(out.planes.rgba[0], 188); /* half the light, not half the number */
    for (size_t i = 0; i < 4; i++)
        set(&fine, i, 97, RASTER_ALPHA_SURFACE, 1.0f);
    assert_int_equal(raster_downsample(&fine.planes, 2, background, &out.planes), ST_OK);
    assert_int_equal(out.planes.rgba[0], 97);
    draw_target_fini(&fine);
    draw_target_fini(&out);
}

static void half_of_the_sub_pixels_make_a_pixel(void **state) {
    (void)state;
    struct draw_target fine = draw_target_make(6, 2, false), out = draw_target_make(3, 1, false);
    for (size_t i = 0; i < 12; i++)
        set(&fine, i, 9, RASTER_ALPHA_NOTHING, NAN);
    set(&fine, 0, 100, RASTER_ALPHA_SURFACE, 2.0f); /* first pixel: one of four */
    set(&fine, 2, 100, RASTER_ALPHA_SURFACE, 2.0f); /* second: two of four, at two depths */
    set(&fine, 8, 100, RASTER_ALPHA_SURFACE, 5.0f);
    set(&fine, 4, 50, RASTER_ALPHA_UNKNOWN, 1.0f); /* third: one surface, two unknown */
    set(&fine, 5, 50, RASTER_ALPHA_UNKNOWN, 1.0f);
    set(&fine, 10, 200, RASTER_ALPHA_SURFACE, 1.0f);
    assert_int_equal(raster_downsample(&fine.planes, 2, background, &out.planes), ST_OK);
    static const uint8_t expected[12] = {1, 2, 3, 0, 100, 100, 100, 255, 50, 50, 50, 128};
    assert_memory_equal(out.planes.rgba, expected, 12);
    assert_true(isnan(out.planes.depth[0]));
    assert_true(out.planes.depth[1] == 5.0f); /* one of the two, the nearer; never between them */
    draw_target_fini(&fine);
    draw_target_fini(&out);
}

static void sizes_must_fit(void **state) {
    (void)state;
    struct draw_target fine = draw_target_make(6, 2, false), out = draw_target_make(2, 1, false);
    assert_int_equal(raster_downsample(&fine.planes, 2, background, &out.planes), ST_INVALID);
    assert_int_equal(raster_downsample(&fine.planes, 0, background, &out.planes), ST_INVALID);
    draw_target_fini(&fine);
    draw_target_fini(&out);
}

static void a_supersampled_view_covers_the_same_field(void **state) {
    (void)state;
    struct camera cam = camera_pinhole(40, 30, 1.0);
    struct pose pose = pose_identity();
    struct raster_view view = raster_view_pinhole(&cam, &pose);
    struct raster_view fine = raster_view_supersampled(&view, 3);
    assert_int_equal(fine.width_px, 120);
    /* The picture's rims, at -1/2 and size - 1/2, are the same rays. */
    assert_true(fabs((-0.5 - fine.cx_px) / fine.fx - (-0.5 - view.cx_px) / view.fx) < 1e-12);
    assert_true(fabs((89.5 - fine.cy_px) / fine.fy - (29.5 - view.cy_px) / view.fy) < 1e-12);
}

static void depth_pictures_run_from_near_to_far(void **state) {
    (void)state;
    const float depth[5] = {0.1f, 0.2f, 0.4f, NAN, 0.0f};
    struct depth_range range;
    assert_int_equal(depth_picture_range(depth, 5, &range), ST_OK);
    assert_true(range.far_depth == 0.0f && range.near_depth == 0.4f);
    uint8_t rgb[15];
    depth_picture_colour(depth, 5, range, rgb);
    int luma[5];
    for (int i = 0; i < 5; i++)
        luma[i] = 299 * rgb[3 * i] + 587 * rgb[3 * i + 1] + 114 * rgb[3 * i + 2];
    assert_true(luma[2] > luma[1] && luma[1] > luma[0] && luma[0] > luma[4]);
    static const uint8_t grey[3] = {128, 128, 128};
    assert_memory_equal(rgb + 9, grey, 3);
    uint16_t mm[5];
    depth_picture_u16(depth, 5, 0.001, mm);
    static const uint16_t expected[5] = {10000, 5000, 2500, 0, 65535};
    assert_memory_equal(mm, expected, sizeof mm);
}

static void no_depth_at_all_is_no_trouble(void **state) {
    (void)state;
    const float depth[2] = {NAN, NAN};
    struct depth_range range;
    uint8_t rgb[6];
    assert_int_equal(depth_picture_range(depth, 2, &range), ST_OK);
    depth_picture_colour(depth, 2, range, rgb);
    assert_int_equal(rgb[5], 128);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sub_pixels_are_averaged_in_linear_light),
        cmocka_unit_test(half_of_the_sub_pixels_make_a_pixel),
        cmocka_unit_test(sizes_must_fit),
        cmocka_unit_test(a_supersampled_view_covers_the_same_field),
        cmocka_unit_test(depth_pictures_run_from_near_to_far),
        cmocka_unit_test(no_depth_at_all_is_no_trouble),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
