/* Image and map to a 3D photograph: kinds of maps, unknown values, distortion, confidence. */
#include "import/photo_import.h"
#include "tests/support/cmocka_all.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { W = 48, H = 36 };

struct scene {
    struct image_u8 rgb;
    struct image_f32 map;
    struct photo_import in;
};

static void make_scene(struct scene *s) {
    memset(s, 0, sizeof *s);
    assert_int_equal(image_u8_create(&s->rgb, W, H, 3), ST_OK);
    assert_int_equal(image_f32_create(&s->map, W, H, 1), ST_OK);
    for (int i = 0; i < W * H * 3; i++)
        s->rgb.px[i] = (uint8_t)(i * 7);
    s->in.rgb = &s->rgb;
    s->in.map = &s->map;
    s->in.camera = camera_pinhole(W, H, 1.0);
    s->in.station_from_cam = pose_identity();
}

static void free_scene(struct scene *s) {
    image_u8_destroy(&s->rgb);
    image_f32_destroy(&s->map);
}

static struct photo make(const struct scene *s, struct photo_import_result *result) {
    struct photo photo = {0};
    struct errctx err = {0};
    if (photo_import_make(&s->in, &photo, result, &err))
        fail_msg("%s", err.text);
    return photo;
}

static void depth_range_and_disparity_of_one_plane_agree(void **state) {
    (void)state;
    struct scene s;
    make_scene(&s);
    const double baseline_m = 0.16;
    for (int kind = 0; kind < 3; kind++) {
        s.in.values = (struct photo_import_map){.kind = (enum photo_import_kind)kind,
                                                .scale = kind == 2 ? 0.25 : 1e-3,
                                                .offset = kind == 2 ? 3.0 : 0.0,
                                                .baseline_m = baseline_m};
        for (int v = 0; v < H; v++)
            for (int u = 0; u < W; u++) {
                const double z = 2.0 + 0.01 * u + 0.02 * v;
                const double ray = vec3_norm(camera_pinhole_ray(&s.in.camera, u, v));
                const double d_px = s.in.camera.fx_px * baseline_m / z;
                *image_f32_at(&s.map, u, v) = (float)(kind == 0   ? 1e3 * z
                                                      : kind == 1 ? 1e3 * z * ray
                                                                  : (d_px - 3.0) / 0.25);
            }
        struct photo_import_result result;
        struct photo photo = make(&s, &result);
        for (int v = 0; v < H; v++)
            for (int u = 0; u < W; u++)
                assert_true(fabs(1.0 / (double)photo.disparity_per_m[v * W + u] -
                                 (2.0 + 0.01 * u + 0.02 * v)) < 1e-5);
        assert_memory_equal(photo.rgb, s.rgb.px, W * H * 3);
        assert_false(result.relative || result.undistorted);
        assert_int_equal(result.known_pixels, W * H);
        photo_destroy(&photo);
    }
    free_scene(&s);
}

static void unknown_values_are_dropped_and_nan(void **state) {
    (void)state;
    struct scene s;
    make_scene(&s);
    const float stored[] = {0.0f, -3.0f, NAN, INFINITY, 65535.0f, 1500.0f};
    for (int i = 0; i < W * H; i++)
        s.map.px[i] = stored[i % 6];
    s.in.values.unknown = 65535.0;
    struct photo_import_result result;
    struct photo photo = make(&s, &result);
    for (int i = 0; i < W * H; i++) {
        const bool known = i % 6 == 5;
        assert_int_equal(isnan(photo.disparity_per_m[i]), !known);
        assert_int_equal(photo.flags[i], known ? 0 : PHOTO_DROPPED);
        assert_int_equal(photo.confidence[i] > 0, known);
    }
    assert_int_equal(result.unknown_pixels, W * H * 5 / 6);
    photo_destroy(&photo);
    free_scene(&s);
}

static void without_a_baseline_lengths_are_relative(void **state) {
    (void)state;
    struct scene s;
    make_scene(&s);
    for (int i = 0; i < W * H; i++)
        s.map.px[i] = 8.0f;
    s.in.values.kind = PHOTO_IMPORT_DISPARITY;
    struct photo_import_result result;
    struct photo photo = make(&s, &result);
    assert_true(result.relative);
    assert_true(fabs((double)photo.disparity_per_m[5] - 8.0 / s.in.camera.fx_px) < 1e-7);
    photo_destroy(&photo);
    free_scene(&s);
}

/* sigma(1/Z) = sigma(Z) / Z^2, and a step that is not restored counts with step / sqrt(12). */
static void confidence_is_the_noise_that_was_stated(void **state) {
    (void)state;
    struct scene s;
    make_scene(&s);
    for (int i = 0; i < W * H; i++)
        s.map.px[i] = 2000.0f;
    s.in.values = (struct photo_import_map){.sigma_m = 0.004, .sigma_per_m = NAN};
    struct photo photo = make(&s, NULL);
    double sigma = photo_sigma_from_confidence(photo.confidence[7]);
    assert_true(sigma >= 0.001 && sigma < 0.001 * 1.08); /* the scale's step is 7 %, rounded up */
    photo_destroy(&photo);
    s.in.values.sigma_m = NAN;
    s.in.values.step = 40.0;
    photo = make(&s, NULL);
    sigma = photo_sigma_from_confidence(photo.confidence[7]);
    const double expected = 0.04 / sqrt(12.0) / 4.0;
    assert_true(sigma >= expected && sigma < expected * 1.08);
    photo_destroy(&photo);
    free_scene(&s);
}

static void dequantised_disparities_err_less_and_say_so(void **state) {
    (void)state;
    struct scene s;
    make_scene(&s);
    for (int v = 0; v < H; v++)
        for (int u = 0; u < W; u++)
            *image_f32_at(&s.map, u, v) = (float)round(20.0 + 0.13 * u + 0.05 * v);
    double rms[2], claimed[2];
    for (int restore = 0; restore < 2; restore++) {
        s.in.values = (struct photo_import_map){
            .kind = PHOTO_IMPORT_DISPARITY, .step = 1.0, .dequantise = restore, .sigma_px = NAN};
        struct photo photo = make(&s, NULL);
        double sum = 0, sigma = 0;
        for (int v = 0; v < H; v++)
            for (int u = 0; u < W; u++) {
                const size_t i = (size_t)(v * W + u);
                const double d = (double)photo.disparity_per_m[i] * s.in.camera.fx_px;
                sum += pow(d - (20.0 + 0.13 * u + 0.05 * v), 2);
                sigma += photo_sigma_from_confidence(photo.confidence[i]) * s.in.camera.fx_px;
            }
        rms[restore] = sqrt(sum / (W * H));
        claimed[restore] = sigma / (W * H);
        photo_destroy(&photo);
    }
    assert_true(rms[0] > 0.25 && rms[1] < 0.05);
    assert_true(claimed[1] < claimed[0] && claimed[1] > rms[1] && claimed[0] > rms[0]);
    free_scene(&s);
}

/* A plane seen through a lens with distortion: after the resampling it must be the plane again. */
static void undistorts_image_and_map_alike(void **state) {
    (void)state;
    struct scene s;
    make_scene(&s);
    s.in.camera.k1 = -0.25;
    s.in.camera.p1 = 0.004;
    for (int v = 0; v < H; v++)
        for (int u = 0; u < W; u++) {
            struct vec3 ray;
            assert_int_equal(camera_unproject(&s.in.camera, (struct vec2){u, v}, &ray, NULL),
                             ST_OK);
            const double delta = 0.5 + 0.1 * ray.x - 0.05 * ray.y; /* 1/Z of a plane */
            *image_f32_at(&s.map, u, v) = (float)(1e3 / delta);
            for (int c = 0; c < 3; c++) /* colour tells the place: linear in the ray */
                image_u8_at(&s.rgb, u, v)[c] =
                    (uint8_t)lround(128.0 + 120.0 * ray.x * (c == 0) + 120.0 * ray.y * (c == 1));
        }
    struct photo_import_result result;
    struct photo photo = make(&s, &result);
    assert_true(result.undistorted && camera_is_pinhole(&photo.camera));
    assert_true(result.unseen_pixels >= 0 && result.known_pixels > W * H * 8 / 10);
    for (int v = 0; v < H; v++)
        for (int u = 0; u < W; u++) {
            const size_t i = (size_t)(v * W + u);
            const struct vec3 ray = camera_pinhole_ray(&photo.camera, u, v);
            if (isnan(photo.disparity_per_m[i]))
                continue;
            /* bilinear in a distorted grid: the error is the lens's curvature over a pixel, but the
             * nearest sample at the border of the image is up to half a pixel off */
            const bool border = u < 2 || v < 2 || u >= W - 2 || v >= H - 2;
            const double delta = 0.5 + 0.1 * ray.x - 0.05 * ray.y;
            assert_true(fabs((double)photo.disparity_per_m[i] - delta) < (border ? 2e-3 : 2e-5));
            if (!border)
                assert_true(fabs(photo.rgb[3 * i] - (128.0 + 120.0 * ray.x)) < 1.6);
        }
    photo_destroy(&photo);
    free_scene(&s);
}

static void pincushion_corners_beyond_the_image_are_unseen(void **state) {
    (void)state;
    struct scene s;
    make_scene(&s);
    for (int i = 0; i < W * H; i++)
        s.map.px[i] = 2000.0f;
    s.in.camera.k1 = 0.3;
    struct photo_import_result result;
    struct photo photo = make(&s, &result);
    assert_true(result.unseen_pixels > 0);
    assert_true(isnan(photo.disparity_per_m[0]) && photo.flags[0] == 0 && photo.confidence[0] == 0);
    assert_int_equal(result.known_pixels + result.unknown_pixels + result.unseen_pixels, W * H);
    photo_destroy(&photo);
    free_scene(&s);
}

static void resampling_bridges_no_jump(void **state) {
    (void)state;
    struct scene s;
    make_scene(&s);
    s.in.camera.k1 = -0.2;
    for (int v = 0; v < H; v++)
        for (int u = 0; u < W; u++)
            *image_f32_at(&s.map, u, v) = u < W / 2 ? 1000.0f : 3000.0f;
    struct photo photo = make(&s, NULL);
    for (int i = 0; i < W * H; i++) {
        const float d = photo.disparity_per_m[i];
        assert_true(isnan(d) || fabsf(d - 1.0f) < 1e-5f || fabsf(d - 1.0f / 3.0f) < 1e-5f);
    }
    photo_destroy(&photo);
    free_scene(&s);
}

static void refuses_what_does_not_fit(void **state) {
    (void)state;
    struct scene s;
    struct photo photo = {0};
    struct errctx err = {0};
    make_scene(&s);
    assert_int_equal(photo_import_make(&s.in, &photo, NULL, &err), ST_INVALID);
    assert_non_null(strstr(err.text, "no known value"));
    s.map.px[0] = 1000.0f;
    s.in.camera.width_px = W + 1;
    assert_int_equal(photo_import_make(&s.in, &photo, NULL, &err), ST_INVALID);
    s.in.camera.width_px = W;
    s.in.values.dequantise = true; /* of depths */
    s.in.values.step = 1.0;
    assert_int_equal(photo_import_make(&s.in, &photo, NULL, &err), ST_INVALID);
    s.in.values = (struct photo_import_map){.scale = -1.0};
    assert_int_equal(photo_import_make(&s.in, &photo, NULL, &err), ST_INVALID);
    s.in.values = (struct photo_import_map){.scale = 0.0};
    s.map.width_px = W - 1;
    assert_int_equal(photo_import_make(&s.in, &photo, NULL, &err), ST_INVALID);
    assert_non_null(strstr(err.text, "48 x 36"));
    s.map.width_px = W;
    s.in.camera.fx_px = NAN;
    assert_int_equal(photo_import_make(&s.in, &photo, NULL, &err), ST_INVALID);
    free_scene(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(depth_range_and_disparity_of_one_plane_agree),
        cmocka_unit_test(unknown_values_are_dropped_and_nan),
        cmocka_unit_test(without_a_baseline_lengths_are_relative),
        cmocka_unit_test(confidence_is_the_noise_that_was_stated),
        cmocka_unit_test(dequantised_disparities_err_less_and_say_so),
        cmocka_unit_test(undistorts_image_and_map_alike),
        cmocka_unit_test(pincushion_corners_beyond_the_image_are_unseen),
        cmocka_unit_test(resampling_bridges_no_jump),
        cmocka_unit_test(refuses_what_does_not_fit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
