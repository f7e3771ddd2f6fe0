#include "base/image.h"
#include "base/photo.h"
#include "base/rng.h"
#include "tests/support/cmocka_all.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void confidence_never_claims_more_than_sigma_justifies(void **state) {
    (void)state;
    for (int c = 1; c <= 255; c++) /* the scale's own steps are exact */
        assert_int_equal(photo_confidence_from_sigma(photo_sigma_from_confidence((uint8_t)c)), c);
    struct rng rng = rng_make(1);
    for (int i = 0; i < 5000; i++) {
        double sigma = pow(10.0, rng_range(&rng, -9, 1.6));
        uint8_t c = photo_confidence_from_sigma(sigma);
        assert_true(c > 0 && photo_sigma_from_confidence(c) >= sigma);
        assert_true(c == 255 || photo_sigma_from_confidence((uint8_t)(c + 1)) < sigma);
    }
}

static void confidence_of_nonsense_is_unknown(void **state) {
    (void)state;
    static const double bad[] = {NAN, 0.0, -1.0, INFINITY, 50.0, 1e300};
    for (int i = 0; i < 6; i++)
        assert_int_equal(photo_confidence_from_sigma(bad[i]), 0);
    assert_true(isnan(photo_sigma_from_confidence(0)));
    assert_int_equal(photo_confidence_from_sigma(1e-300), 255);
}

static void new_photograph_knows_nothing(void **state) {
    (void)state;
    struct camera cam = camera_pinhole(33, 1, 1);
    struct photo photo;
    struct errctx err = {0};
    assert_int_equal(photo_create(&cam, &photo, &err), ST_OK);
    for (int i = 0; i < 33; i++)
        assert_true(isnan(photo.disparity_per_m[i]) && !photo.flags[i] && !photo.confidence[i]);
    photo_destroy(&photo);
    assert_null(photo.rgb);
    photo_destroy(&photo);
    photo_destroy(NULL);
}

static void refuses_distorted_and_absurd_cameras(void **state) {
    (void)state;
    struct photo photo;
    struct errctx err = {0};
    struct camera cam = camera_pinhole(64, 64, 1);
    cam.k1 = 0.1;
    assert_int_equal(photo_create(&cam, &photo, &err), ST_INVALID);
    cam = camera_pinhole(0, 64, 1);
    assert_int_equal(photo_create(&cam, &photo, &err), ST_INVALID);
    cam = camera_pinhole(65536, 65536, 1);
    assert_int_equal(photo_create(&cam, &photo, &err), ST_NOMEM);
}

static void tiles_own_each_pixel_and_each_cell_once(void **state) {
    (void)state;
    static const int32_t sizes[][2] = {{1, 1}, {32, 32}, {33, 31}, {100, 65}, {31, 97}};
    for (int k = 0; k < 5; k++) {
        int32_t w = sizes[k][0], h = sizes[k][1];
        struct camera cam = camera_pinhole(w, h, 1);
        struct photo photo;
        assert_int_equal(photo_create(&cam, &photo, NULL), ST_OK);
        size_t count = photo_tile_count(w, h);
        struct tile *tiles = calloc(count, sizeof *tiles);
        assert_non_null(tiles);
        photo_tiles(&photo, NULL, tiles);
        int32_t pixels = 0, cells = 0;
        for (size_t i = 0; i < count; i++) {
            const struct tile *t = &tiles[i];
            pixels += t->width_px * t->height_px;
            cells += t->cells_x * t->cells_y;
            assert_true(t->u0_px + t->cells_x < w && t->v0_px + t->cells_y < h);
            assert_ptr_equal(t->disparity_per_m, photo.disparity_per_m + t->v0_px * w + t->u0_px);
            assert_ptr_equal(t->rgb, photo.rgb + 3 * (t->v0_px * w + t->u0_px));
            assert_true(t->disparity_min_per_m > t->disparity_max_per_m && t->valid_count == 0);
        }
        assert_int_equal(pixels, w * h);
        assert_int_equal(cells, (w - 1) * (h - 1));
        free(tiles);
        photo_destroy(&photo);
    }
}

static void tile_bounds_cover_the_neighbours_that_its_cells_touch(void **state) {
    (void)state;
    struct camera cam = camera_pinhole(64, 32, 1);
    struct photo photo;
    assert_int_equal(photo_create(&cam, &photo, NULL), ST_OK);
    photo.disparity_per_m[5] = 0.5f;
    photo.disparity_per_m[32] = 2.0f; /* first column of the second tile */
    photo.disparity_per_m[40] = 0.0f; /* infinity is a disparity */
    struct tile tiles[2];
    photo_tiles(&photo, NULL, tiles);
    assert_true(tiles[0].disparity_min_per_m == 0.5f && tiles[0].disparity_max_per_m == 2.0f);
    assert_int_equal(tiles[0].valid_count, 1);
    assert_true(tiles[1].disparity_min_per_m == 0.0f && tiles[1].disparity_max_per_m == 2.0f);
    assert_int_equal(tiles[1].valid_count, 2);
    photo_destroy(&photo);
}

static void tile_matrix_places_points_where_the_camera_saw_them(void **state) {
    (void)state;
    const double tolerance_m = 1e-8; /* eps of 1e7 m coordinates is 2e-9 */
    struct camera cam = camera_pinhole(100, 80, 1);
    struct photo photo;
    assert_int_equal(photo_create(&cam, &photo, NULL), ST_OK);
    struct pose world_from_station = se3_exp(vec3_make(0.1, -0.4, 2), vec3_make(1, 2, 3));
    world_from_station.t_m = vec3_make(1e7, -4e6, 250);
    photo.station_from_cam = se3_exp(vec3_make(-1.2, 1.1, -1.3), vec3_make(0.2, 0.1, 1.5));
    struct tile tiles[16];
    assert_int_equal(photo_tile_count(100, 80), 12);
    photo_tiles(&photo, &world_from_station, tiles);
    struct pose world_from_cam = pose_compose(&world_from_station, &photo.station_from_cam);
    for (int i = 0; i < 12; i++) {
        double u = 3, v = 4, delta = 0.25;
        struct vec4 x = mat4_mulv(&tiles[i].m, (struct vec4){u, v, 1, delta});
        struct vec3 ray = camera_pinhole_ray(&cam, tiles[i].u0_px + u, tiles[i].v0_px + v);
        struct vec3 expected = pose_apply(&world_from_cam, vec3_scale(ray, 1 / delta));
        struct vec3 got = vec3_madd(tiles[i].origin_m, vec3_make(x.x, x.y, x.z), 1 / x.w);
        assert_true(vec3_norm(vec3_sub(got, expected)) < tolerance_m);
        x = mat4_mulv(&tiles[i].m, (struct vec4){u, v, 1, 0}); /* infinity: a direction */
        assert_true(x.w == 0 && fabs(vec3_norm(vec3_make(x.x, x.y, x.z)) - vec3_norm(ray)) < 1e-14);
    }
    photo_destroy(&photo);
}

static void images_are_bounded_and_may_be_empty(void **state) {
    (void)state;
    struct image_u8 a;
    struct image_u16 b;
    struct image_f32 c;
    assert_int_equal(image_u8_create(&a, 0, 7, 3), ST_OK);
    assert_null(a.px);
    image_u8_destroy(&a);
    assert_int_equal(image_u8_create(&a, -1, 7, 3), ST_INVALID);
    assert_int_equal(image_u8_create(&a, 7, 7, 5), ST_INVALID);
    assert_int_equal(image_u16_create(&b, 7, 7, 0), ST_INVALID);
    assert_int_equal(image_u16_create(&b, 65537, 1, 1), ST_NOMEM);
    assert_int_equal(image_f32_create(&c, 65536, 65536, 1), ST_NOMEM);
    assert_int_equal(image_f32_create(&c, 3, 2, 1), ST_OK);
    *image_f32_at(&c, 2, 1) = 5.0f;
    assert_true(c.px[5] == 5.0f);
    image_f32_destroy(&c);
    assert_null(c.px);
    image_u8_destroy(NULL);
    image_u16_destroy(NULL);
    image_f32_destroy(NULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(confidence_never_claims_more_than_sigma_justifies),
        cmocka_unit_test(confidence_of_nonsense_is_unknown),
        cmocka_unit_test(new_photograph_knows_nothing),
        cmocka_unit_test(refuses_distorted_and_absurd_cameras),
        cmocka_unit_test(tiles_own_each_pixel_and_each_cell_once),
        cmocka_unit_test(tile_bounds_cover_the_neighbours_that_its_cells_touch),
        cmocka_unit_test(tile_matrix_places_points_where_the_camera_saw_them),
        cmocka_unit_test(images_are_bounded_and_may_be_empty),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
