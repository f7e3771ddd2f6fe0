/* 3D photographs as TIFF: bit for bit, never large, never trusting. */
#include "site/photo_tiff.h"

#include "base/photo.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static uint32_t lcg(uint32_t *s) {
    *s = *s * 1664525u + 1013904223u;
    return *s >> 8;
}

/* A photograph with awkward numbers; noise = true makes it incompressible. */
static struct photo make_photo(int32_t w, int32_t h, bool noise) {
    struct camera camera = camera_pinhole(w, h, 1.1);
    camera.fx_px = 1.0 / 3.0 * 1e3;
    camera.cx_px = 0.1 + 0.2;
    struct photo photo;
    assert_int_equal(photo_create(&camera, &photo, NULL), ST_OK);
    photo.station_from_cam.r = so3_exp(vec3_make(0.1, -0.7, 1.0 / 3.0));
    photo.station_from_cam.t_m = vec3_make(1e7 + 1.0 / 7.0, -0.0, 5e-324);
    uint32_t seed = 7;
    for (int32_t i = 0; i < w * h; i++) {
        for (int c = 0; c < 3; c++)
            photo.rgb[3 * i + c] = (uint8_t)(noise ? lcg(&seed) : (uint32_t)(i + c) / 8u);
        float d = (float)(0.01 + 1e-3 * (i % w));
        uint32_t bits = (lcg(&seed) ^ lcg(&seed) << 16) & 0x7f7fffffu; /* any finite float >= 0 */
        if (noise)
            memcpy(&d, &bits, sizeof d);
        photo.disparity_per_m[i] = i % 11 == 3 ? NAN : i % 13 == 5 ? 0.0f : d;
        photo.flags[i] = (uint8_t)(noise ? lcg(&seed) : (uint32_t)(i % 11 == 3));
        photo.confidence[i] = (uint8_t)(noise ? lcg(&seed) : 200u);
    }
    return photo;
}

static void assert_same(const struct photo *a, const struct photo *b) {
    size_t n = (size_t)a->camera.width_px * (size_t)a->camera.height_px;
    assert_memory_equal(&a->camera, &b->camera, sizeof a->camera);
    assert_memory_equal(&a->station_from_cam, &b->station_from_cam, sizeof a->station_from_cam);
    assert_memory_equal(a->rgb, b->rgb, 3 * n);
    assert_memory_equal(a->disparity_per_m, b->disparity_per_m, 4 * n);
    assert_memory_equal(a->flags, b->flags, n);
    assert_memory_equal(a->confidence, b->confidence, n);
}

static void round_trip(int32_t w, int32_t h, bool noise, size_t *out_size) {
    struct photo photo = make_photo(w, h, noise), back = {0};
    struct photo_tiff_info info = {"stand \"one\" \xc3\xa9", "baseline"}, back_info;
    struct errctx err = {0};
    uint8_t *data = NULL;
    assert_int_equal(photo_tiff_encode(&photo, &info, &data, out_size, &err), ST_OK);
    assert_int_equal(photo_tiff_decode(data, *out_size, &back, &back_info, &err), ST_OK);
    assert_same(&photo, &back);
    assert_string_equal(info.name, back_info.name);
    assert_string_equal(info.length_unit, back_info.length_unit);
    free(data);
    photo_destroy(&photo);
    photo_destroy(&back);
}

static void comes_back_bit_for_bit(void **state) {
    (void)state;
    const int32_t sizes[][2] = {{1, 1}, {1, 33}, {33, 1}, {64, 48}, {301, 307}};
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++)
        for (int noise = 0; noise < 2; noise++) {
            size_t size = 0;
            round_trip(sizes[i][0], sizes[i][1], noise, &size);
        }
}

static void is_never_larger_than_nine_bytes_a_pixel(void **state) {
    (void)state;
    size_t size = 0;
    round_trip(301, 307, true, &size);
    assert_true(size <= 9u * 301u * 307u + PHOTO_TIFF_OVERHEAD_BYTES(301 * 307));
    assert_true(size >= 8u * 301u * 307u); /* the noise was noise */
    round_trip(301, 307, false, &size);
    assert_true(size < 4u * 301u * 307u);
    round_trip(1, 1, true, &size);
    assert_true(size <= 9u + PHOTO_TIFF_OVERHEAD_BYTES(1));
}

static void same_photograph_same_bytes(void **state) {
    (void)state;
    struct photo photo = make_photo(64, 48, false);
    uint8_t *a = NULL, *b = NULL;
    size_t a_size = 0, b_size = 0;
    assert_int_equal(photo_tiff_encode(&photo, NULL, &a, &a_size, NULL), ST_OK);
    assert_int_equal(photo_tiff_encode(&photo, NULL, &b, &b_size, NULL), ST_OK);
    assert_int_equal(a_size, b_size);
    assert_memory_equal(a, b, a_size);
    free(a);
    free(b);
    photo_destroy(&photo);
}

static void refuses_to_write_what_is_no_photograph(void **state) {
    (void)state;
    uint8_t *data = NULL;
    size_t size = 0;
    struct errctx err = {0};
    struct photo photo = make_photo(8, 8, false);
    photo.disparity_per_m[9] = -1.0f;
    assert_int_equal(photo_tiff_encode(&photo, NULL, &data, &size, &err), ST_INVALID);
    assert_non_null(strstr(err.text, "(1, 1)"));
    photo.disparity_per_m[9] = INFINITY;
    assert_int_equal(photo_tiff_encode(&photo, NULL, &data, &size, &err), ST_INVALID);
    photo.disparity_per_m[9] = 0.0f;
    photo.station_from_cam.r.m[0] = 2.0;
    assert_int_equal(photo_tiff_encode(&photo, NULL, &data, &size, &err), ST_INVALID);
    photo.station_from_cam = pose_identity();
    photo.camera.k1 = 0.1;
    assert_int_equal(photo_tiff_encode(&photo, NULL, &data, &size, &err), ST_INVALID);
    photo_destroy(&photo);
}

/* Truncated anywhere, one byte changed anywhere: an answer, no crash, and one line where it fails.
 */
static void survives_damage_with_one_clear_line(void **state) {
    (void)state;
    struct photo photo = make_photo(40, 30, false);
    uint8_t *data = NULL;
    size_t size = 0;
    assert_int_equal(photo_tiff_encode(&photo, NULL, &data, &size, NULL), ST_OK);
    uint8_t *copy = malloc(size);
    assert_non_null(copy);
    uint32_t seed = 3;
    for (size_t i = 0; i < 300; i++) {
        const bool cut = i % 3 == 0;
        size_t length = cut ? lcg(&seed) % size : size;
        memcpy(copy, data, size);
        if (!cut)
            copy[lcg(&seed) % size] ^= (uint8_t)(1u << (lcg(&seed) % 8));
        struct photo back = {0};
        struct errctx err = {0};
        enum st st = photo_tiff_decode(copy, length, &back, NULL, &err);
        if (st) {
            assert_int_equal(st, ST_FORMAT);
            assert_true(strlen(err.text) > 8);
            assert_null(strchr(err.text, '\n'));
        }
        assert_true(st || !cut || length == size);
        photo_destroy(&back);
    }
    free(copy);
    free(data);
    photo_destroy(&photo);
}

static void refuses_other_files(void **state) {
    (void)state;
    struct photo back = {0};
    struct errctx err = {0};
    const char *texts[] = {"", "II*", "II*\0\x08\0\0\0\0\0", "hello, this is no TIFF at all"};
    const size_t sizes[] = {0, 3, 10, 29};
    for (int i = 0; i < 4; i++)
        assert_int_equal(photo_tiff_decode(texts[i], sizes[i], &back, NULL, &err), ST_FORMAT);
}

static void names_the_file(void **state) {
    (void)state;
    struct photo back = {0};
    struct errctx err = {0};
    assert_int_equal(photo_tiff_read("no/such/photo.tif", &back, NULL, &err), ST_NOT_FOUND);
    assert_non_null(strstr(err.text, "no/such/photo.tif"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(comes_back_bit_for_bit),
        cmocka_unit_test(is_never_larger_than_nine_bytes_a_pixel),
        cmocka_unit_test(same_photograph_same_bytes),
        cmocka_unit_test(refuses_to_write_what_is_no_photograph),
        cmocka_unit_test(survives_damage_with_one_clear_line),
        cmocka_unit_test(refuses_other_files),
        cmocka_unit_test(names_the_file),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
