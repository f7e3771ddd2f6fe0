/* What one sees of the twin: patterns of materials, photographs, panoramas; and scenes that people
 * bring along as a mesh file. */
#include "base/fileio.h"
#include "twin/camera_sim.h"
#include "twin/material.h"
#include "twin/scene.h"
#include "twin/twin_picture.h"

#include "tests/support/cmocka_all.h"
#include "tests/support/tempdir.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

static void every_pattern_is_bounded_repeatable_and_not_empty(void **state) {
    (void)state;
    for (int t = TEXTURE_PLAIN; t <= TEXTURE_VELVET; t++) {
        struct material m = {.texture = (enum material_texture)t,
                             .rgb = {0.6f, 0.5f, 0.4f},
                             .rgb2 = {0.2f, 0.25f, 0.3f},
                             .albedo_ir = 0.5f,
                             .f0 = 0.04f,
                             .roughness = 0.6f,
                             .scale_m = 0.3f};
        float low = 2, high = -1;
        for (int i = 0; i < 600; i++) {
            struct vec3 p = {0.013 * i, 0.7 + 0.037 * (i % 29), 0.011 * (i % 83)};
            if (i < 300) /* signs and plates are small and centred */
                p = vec3_make(0.008 * (i % 61) - 0.24, 0.011 * (i % 37) - 0.2,
                              0.01 * (i % 43) - 0.2);
            struct vec3 n = i % 2 ? vec3_make(0, 0, 1) : vec3_make(1, 0, 0);
            struct material_sample fine, again, coarse;
            material_sample_at(&m, p, n, false, &fine);
            material_sample_at(&m, p, n, false, &again);
            material_sample_at(&m, p, n, true, &coarse);
            assert_memory_equal(fine.rgb, again.rgb, sizeof fine.rgb);
            for (int k = 0; k < 3; k++)
                assert_true(fine.rgb[k] >= 0 && fine.rgb[k] <= 1.5f);
            assert_true(fine.albedo_ir >= 0 && fine.albedo_ir <= 1);
            assert_true(coarse.albedo_ir >= 0 && coarse.albedo_ir <= 1);
            assert_true(fine.roughness >= 0 && fine.roughness <= 1);
            float seen = fine.rgb[1] + fine.emission[1];
            low = seen < low ? seen : low;
            high = seen > high ? seen : high;
        }
        if (t != TEXTURE_PLAIN && !(high > low + 0.01f))
            fail_msg("texture %d shows nothing: %g to %g", t, (double)low, (double)high);
    }
}

/* A camera on a cart in the first stand of a scene, small and noiseless. */
static struct camera_sim camera_in(const struct scene *scene, double pan_rad) {
    struct twin_config config = twin_config_default();
    config.value[TWIN_CONFIG_CAMERA_WIDTH].real = 40;
    config.value[TWIN_CONFIG_CAMERA_HEIGHT].real = 60;
    config.value[TWIN_CONFIG_CAMERA_SAMPLES].real = 4;
    config.value[TWIN_CONFIG_CAMERA_NOISE].real = 0;
    struct pose stand = {so3_exp(vec3_make(0, 0, scene->stand[0].yaw_rad)),
                         scene->stand[0].position_m};
    stand.t_m.z += 1.6;
    return camera_sim_on_cart(&config, &stand, pan_rad, 0, 11);
}

static double mean_of(const struct image_u8 *im, int x0, int x1, int y0, int y1) {
    double sum = 0;
    for (int y = y0; y < y1; y++)
        for (int x = x0; x < x1; x++)
            for (int k = 0; k < 3; k++)
                sum += image_u8_at(im, x, y)[k];
    return sum / (3.0 * (x1 - x0) * (y1 - y0));
}

static void photographs_do_not_depend_on_threads_and_follow_exposure_and_lens(void **state) {
    (void)state;
    static const char *const names[] = {"accident", "heritage", "room"};
    for (size_t i = 0; i < 3; i++) {
        struct scene *scene = NULL;
        struct errctx err = {0};
        struct image_u8 one, three, brighter, dark;
        assert_int_equal(scene_create(names[i], 1, 0.1, &scene, &err), ST_OK);
        struct camera_sim sim = camera_in(scene, 0.4);
        sim.vignetting = 0;
        int before = omp_get_max_threads();
        omp_set_num_threads(1);
        assert_int_equal(camera_sim_render(scene, &sim, &one, &err), ST_OK);
        omp_set_num_threads(3);
        assert_int_equal(camera_sim_render(scene, &sim, &three, &err), ST_OK);
        omp_set_num_threads(before);
        assert_memory_equal(one.px, three.px, 40 * 60 * 3);
        sim.exposure = 2;
        assert_int_equal(camera_sim_render(scene, &sim, &brighter, &err), ST_OK);
        assert_true(mean_of(&brighter, 0, 40, 0, 60) > 1.1 * mean_of(&one, 0, 40, 0, 60));
        sim.exposure = 1;
        sim.vignetting = 0.8;
        assert_int_equal(camera_sim_render(scene, &sim, &dark, &err), ST_OK);
        double corner = mean_of(&one, 0, 8, 0, 8); /* the night sky is black anyway */
        assert_true(mean_of(&dark, 0, 8, 0, 8) < (corner > 20 ? 0.9 * corner : corner + 1));
        assert_true(fabs(mean_of(&dark, 18, 22, 28, 32) - mean_of(&one, 18, 22, 28, 32)) < 3);
        image_u8_destroy(&one);
        image_u8_destroy(&three);
        image_u8_destroy(&brighter);
        image_u8_destroy(&dark);
        scene_destroy(scene);
    }
}

/* A sample straight ahead at azimuth `deg`. */
static struct cart_shot shot_at(double deg, double range_m, unsigned flags, bool mixed) {
    double a = deg * 3.14159265358979323846 / 180;
    struct cart_shot shot = {.range_m = range_m};
    shot.beam.dir = vec3_make(cos(a), sin(a), 0);
    shot.reading.flags = (uint8_t)flags;
    shot.reading.intensity = 0.1;
    shot.echo.mixed = mixed;
    return shot;
}

static void a_panorama_keeps_the_nearest_range_closes_gaps_and_marks_what_is_mixed(void **state) {
    (void)state;
    struct twin_picture picture;
    struct pose here = pose_identity();
    struct image_u8 range, intensity, mixed;
    assert_int_equal(twin_picture_create(&picture, 360, -0.2, 0.2), ST_OK);
    for (int deg = -100; deg < 100; deg += 2) { /* every second pixel */
        struct cart_shot near_shot = shot_at(deg + 0.5, deg < 0 ? 1 : 4, 0, deg >= 50);
        struct cart_shot far_shot = shot_at(deg + 0.5, 9, 0, false);
        twin_picture_add(&picture, &near_shot, &here);
        twin_picture_add(&picture, &far_shot, &here);
    }
    struct cart_shot lost = shot_at(150.5, (double)NAN, HEAD_SAMPLE_DROPPED, false);
    twin_picture_add(&picture, &lost, &here);
    int y = (int)(picture.top_rad / picture.step_rad);
    const float *row = picture.range_m + (size_t)y * 360;
    assert_true(row[180 + 20 - 1] == 1); /* azimuth falls from left to right */
    assert_true(row[180 - 20 - 1] == 4);
    assert_int_equal(twin_picture_draw(&picture, TWIN_PICTURE_STYLE_RANGE, &range), ST_OK);
    assert_int_equal(twin_picture_draw(&picture, TWIN_PICTURE_STYLE_INTENSITY, &intensity), ST_OK);
    assert_int_equal(twin_picture_draw(&picture, TWIN_PICTURE_STYLE_MIXED, &mixed), ST_OK);
    const uint8_t *near_px = image_u8_at(&range, 200, y), *far_px = image_u8_at(&range, 160, y);
    assert_true(near_px[0] > far_px[0]);               /* near is light */
    assert_true(image_u8_at(&range, 201, y)[0] > 0);   /* between two samples */
    assert_int_equal(image_u8_at(&range, 5, y)[0], 0); /* nobody looked there */
    assert_true(image_u8_at(&mixed, 180 - 60, y)[0] > 200);
    assert_true(image_u8_at(&mixed, 180 + 60, y)[0] < 200);
    assert_true(image_u8_at(&intensity, 200, y)[0] == image_u8_at(&intensity, 200, y)[2]);
    image_u8_destroy(&range);
    image_u8_destroy(&intensity);
    image_u8_destroy(&mixed);
    twin_picture_destroy(&picture);
}

/* A box as an OBJ file, walls to the inside, edges of `size`. */
static void write_box(const char *path, double size, bool closed) {
    char text[512];
    double s = size / 2;
    int n = snprintf(text, sizeof text,
                     "v %g %g 0\nv %g %g 0\nv %g %g 0\nv %g %g 0\nv %g %g %g\nv %g %g %g\n"
                     "v %g %g %g\nv %g %g %g\nf 1 2 3 4\n%s",
                     -s, -s, s, -s, s, s, -s, s, -s, -s, size, s, -s, size, s, s, size, -s, s, size,
                     closed ? "f 8 7 6 5\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n" : "");
    struct errctx err = {0};
    assert_int_equal(fileio_write(path, text, (size_t)n, &err), ST_OK);
}

static void a_mesh_file_becomes_a_scene_with_stands_inside_or_around_it(void **state) {
    (void)state;
    char dir[TEMPDIR_MAX], path[TEMPDIR_MAX + 16];
    struct errctx err = {0};
    struct scene *scene = NULL;
    assert_true(tempdir_make(dir));
    (void)snprintf(path, sizeof path, "%s/box.obj", dir);
    write_box(path, 8, true);
    assert_int_equal(scene_load(path, &scene, &err), ST_OK);
    assert_int_equal(scene->stand_count, 3);
    assert_string_equal(scene->stand[0].name, "middle");
    struct vec3 eye = vec3_make(0, 0, 1.6);
    struct scene_truth truth;
    struct trace_ray ray = {eye, {1, 0, 0}, 0, 100};
    scene_truth_of(scene, &ray, &truth);
    assert_true(truth.hit && fabs(truth.first.t_m - 4) < 1e-6);
    assert_int_equal(scene_check_place(scene, eye, 0.3, &err), ST_OK);
    scene_destroy(scene);

    write_box(path, 8, false); /* a floor alone: one stands around it */
    assert_int_equal(scene_load(path, &scene, &err), ST_OK);
    assert_string_equal(scene->stand[0].name, "a");
    assert_true(fabs(scene->stand[0].position_m.x) + fabs(scene->stand[0].position_m.y) > 4);
    scene_destroy(scene);

    write_box(path, 8000, true); /* millimetres */
    assert_int_equal(scene_load(path, &scene, &err), ST_INVALID);
    assert_non_null(strstr(err.text, "unit"));
    (void)snprintf(path, sizeof path, "%s/none.ply", dir);
    assert_int_equal(scene_load(path, &scene, &err), ST_NOT_FOUND);
    tempdir_remove(dir);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_pattern_is_bounded_repeatable_and_not_empty),
        cmocka_unit_test(photographs_do_not_depend_on_threads_and_follow_exposure_and_lens),
        cmocka_unit_test(a_panorama_keeps_the_nearest_range_closes_gaps_and_marks_what_is_mixed),
        cmocka_unit_test(a_mesh_file_becomes_a_scene_with_stands_inside_or_around_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
