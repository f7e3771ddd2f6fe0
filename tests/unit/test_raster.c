/* The rasteriser: what is drawn where, and the extremes of its numbers. */
#include "raster/raster.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/draw.h"

#include <float.h>
#include <math.h>

static const enum raster_primitive all_primitives[] = {RASTER_POINTS, RASTER_SPLATS, RASTER_MESH};

static struct raster_options options_of(enum raster_primitive primitive) {
    struct raster_options options = raster_options_default();
    options.primitive = primitive;
    options.threads = 1;
    return options;
}

static struct camera small_camera(void) {
    return camera_pinhole(40, 36, 0.8);
}

/* Does the picture show the photograph itself, pixel by pixel? */
static void assert_shows_photo(const struct draw_target *t, const struct photo *photo) {
    for (size_t i = 0; i < t->pixels; i++) {
        assert_int_equal(t->planes.rgba[4 * i + 3], RASTER_ALPHA_SURFACE);
        assert_memory_equal(t->planes.rgba + 4 * i, photo->rgb + 3 * i, 3);
    }
}

static void own_view_shows_the_photograph_from_micrometres_to_megametres(void **state) {
    (void)state;
    struct camera cam = small_camera();
    for (int exponent = -6; exponent <= 6; exponent++)
        for (int p = 0; p < 3; p++) {
            float delta = (float)pow(10.0, -exponent);
            struct draw_photo d = draw_photo_make(draw_wall(&cam, delta), 0);
            struct pose pose = pose_identity();
            struct raster_view view = raster_view_pinhole(&cam, &pose);
            struct raster_options options = options_of(all_primitives[p]);
            struct draw_target t = draw_target_make(40, 36, false);
            assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
            assert_shows_photo(&t, &d.photo);
            /* Falloff lowers a splat's depth where its centre is off the pixel's by rounding only.
             */
            for (size_t i = 0; i < t.pixels; i++)
                assert_true(fabsf(t.planes.depth[i] / delta - 1.0f) < 1e-5f);
            draw_target_fini(&t);
            draw_photo_fini(&d);
        }
}

static void infinity_is_drawn_and_does_not_move_with_the_eye(void **state) {
    (void)state;
    struct camera cam = small_camera();
    struct draw_photo d = draw_photo_make(draw_wall(&cam, 0.0f), 0);
    struct pose far_away = pose_identity();
    far_away.t_m = vec3_make(1e6, -3e5, 2e6);
    struct raster_view view = raster_view_pinhole(&cam, &far_away);
    for (int p = 0; p < 3; p++) {
        struct raster_options options = options_of(all_primitives[p]);
        struct draw_target t = draw_target_make(40, 36, false);
        assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
        assert_shows_photo(&t, &d.photo);
        for (size_t i = 0; i < t.pixels; i++)
            assert_true(t.planes.depth[i] == 0.0f && !signbit(t.planes.depth[i]));
        draw_target_fini(&t);
    }
    draw_photo_fini(&d);
}

static void anything_near_hides_infinity(void **state) {
    (void)state;
    struct camera cam = small_camera();
    struct draw_photo sky = draw_photo_make(draw_wall(&cam, 0.0f), 0);
    struct draw_photo wall = draw_photo_make(draw_wall(&cam, 1e-6f), 1);
    struct pose pose = pose_identity();
    struct raster_view view = raster_view_pinhole(&cam, &pose);
    const struct raster_input inputs[2] = {wall.input, sky.input};
    struct raster_options options = options_of(RASTER_SPLATS);
    struct draw_target t = draw_target_make(40, 36, true);
    assert_int_equal(draw(&t, inputs, 2, &view, &options), ST_OK);
    for (size_t i = 0; i < t.pixels; i++)
        assert_int_equal(raster_item_input(t.planes.item[i]), 1);
    draw_target_fini(&t);
    draw_photo_fini(&sky);
    draw_photo_fini(&wall);
}

static void a_tile_behind_the_eye_is_rejected(void **state) {
    (void)state;
    struct camera cam = small_camera();
    struct draw_photo d = draw_photo_make(draw_wall(&cam, 0.5f), 0);
    struct pose back = pose_identity();
    back.r = so3_exp(vec3_make(0, 3.14159265358979, 0));
    struct raster_view view = raster_view_pinhole(&cam, &back);
    for (int p = 0; p < 3; p++) {
        struct raster_options options = options_of(all_primitives[p]);
        struct draw_target t = draw_target_make(40, 36, false);
        assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
        assert_int_equal(draw_count(&t, RASTER_ALPHA_NOTHING), t.pixels);
        assert_int_equal(t.stats.tiles_rejected, t.stats.tiles_total);
        for (size_t i = 0; i < t.pixels; i++)
            assert_true(isnan(t.planes.depth[i]));
        draw_target_fini(&t);
    }
    draw_photo_fini(&d);
}

/* A floor that runs from below the eye to far ahead: rows of it pass beside, under and behind the
 * eye. */
static struct photo floor_photo(const struct camera *cam) {
    struct photo photo = draw_blank(cam);
    for (int32_t v = 0; v < cam->height_px; v++)
        for (int32_t u = 0; u < cam->width_px; u++)
            photo.disparity_per_m[v * cam->width_px + u] = 0.02f + 0.05f * (float)v;
    return photo;
}

static void an_eye_in_a_surface_or_at_a_sample_draws_finite_numbers(void **state) {
    (void)state;
    struct camera cam = small_camera();
    struct draw_photo d = draw_photo_make(floor_photo(&cam), 0);
    for (int k = 0; k < 12; k++)
        for (int p = 0; p < 3; p++) {
            int32_t u = 3 * k, v = 2 * k;
            struct vec3 ray = camera_pinhole_ray(&cam, u + (k & 1) * 0.5, v);
            struct pose pose = pose_identity();
            pose.t_m = vec3_scale(ray, 1.0 / (double)d.photo.disparity_per_m[v * 40 + u]);
            pose.r = so3_exp(vec3_make(0.1 * k, -0.3 + 0.1 * k, 0.2));
            struct raster_view view = raster_view_pinhole(&cam, &pose);
            struct raster_options options = options_of(all_primitives[p]);
            struct draw_target t = draw_target_make(40, 36, true);
            assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
            for (size_t i = 0; i < t.pixels; i++)
                assert_true(t.planes.rgba[4 * i + 3] == 0
                                ? isnan(t.planes.depth[i])
                                : t.planes.depth[i] >= 0.0f && t.planes.depth[i] <= FLT_MAX);
            draw_target_fini(&t);
        }
    draw_photo_fini(&d);
}

static void a_mesh_that_passes_the_eye_fills_the_picture_in_front(void **state) {
    (void)state;
    struct camera cam = small_camera();
    struct draw_photo d = draw_photo_make(floor_photo(&cam), 0);
    /* Forward by 1 m: disparities reach 1.8, so some of the floor is behind the eye, some before
     * it. */
    struct pose pose = pose_identity();
    pose.t_m = vec3_make(0, 0, 1.0);
    struct raster_view view = raster_view_pinhole(&cam, &pose);
    struct raster_options options = options_of(RASTER_MESH);
    struct draw_target t = draw_target_make(40, 36, false);
    assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
    /* The cell that reaches through the eye's plane covers the lowest row. */
    for (int32_t u = 10; u < 30; u++)
        assert_int_equal(t.planes.rgba[4 * (35 * 40 + u) + 3], RASTER_ALPHA_SURFACE);
    draw_target_fini(&t);
    draw_photo_fini(&d);
}

static void what_is_no_disparity_is_not_drawn(void **state) {
    (void)state;
    struct camera cam = small_camera();
    static const float bad[] = {NAN, INFINITY, -INFINITY, -1.0f, -1e-30f};
    for (size_t b = 0; b < sizeof bad / sizeof bad[0]; b++)
        for (int p = 0; p < 3; p++) {
            struct photo photo = draw_wall(&cam, 0.25f);
            for (size_t i = 0; i < 40 * 36; i += 3)
                photo.disparity_per_m[i] = bad[b];
            struct draw_photo d = draw_photo_make(photo, 0);
            struct pose pose = pose_identity();
            struct raster_view view = raster_view_pinhole(&cam, &pose);
            struct raster_options options = options_of(all_primitives[p]);
            struct draw_target t = draw_target_make(40, 36, true);
            assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
            for (size_t i = 0; i < t.pixels; i++) {
                assert_true(isnan(t.planes.depth[i]) || fabsf(t.planes.depth[i] - 0.25f) < 1e-5f);
                if (t.planes.rgba[4 * i + 3] == 0 || p == 2)
                    continue;
                size_t u = raster_item_u(t.planes.item[i]), v = raster_item_v(t.planes.item[i]);
                size_t tile = raster_item_tile(t.planes.item[i]);
                size_t at = (v + 32 * (tile / 2)) * 40 + u + 32 * (tile % 2);
                assert_true(at % 3 != 0);
            }
            draw_target_fini(&t);
            draw_photo_fini(&d);
        }
}

static void nothing_in_gives_the_background(void **state) {
    (void)state;
    struct camera cam = camera_pinhole(1, 1, 0.5);
    struct pose pose = pose_identity();
    struct raster_view view = raster_view_pinhole(&cam, &pose);
    struct raster_options options = options_of(RASTER_SPLATS);
    options.background_rgb[1] = 77;
    struct draw_target t = draw_target_make(1, 1, true);
    assert_int_equal(draw(&t, NULL, 0, &view, &options), ST_OK);
    static const uint8_t expected[4] = {0, 77, 0, RASTER_ALPHA_NOTHING};
    assert_memory_equal(t.planes.rgba, expected, 4);
    assert_true(isnan(t.planes.depth[0]) && t.planes.item[0] == RASTER_NO_ITEM);
    struct photo empty = draw_blank(&cam); /* one pixel, no disparity */
    struct draw_photo d = draw_photo_make(empty, 0);
    assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
    assert_int_equal(t.planes.rgba[3], RASTER_ALPHA_NOTHING);
    draw_photo_fini(&d);
    d = draw_photo_make(draw_wall(&cam, 1.0f), 0);
    assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
    assert_int_equal(t.planes.rgba[3], RASTER_ALPHA_SURFACE);
    options.primitive = RASTER_MESH; /* no cells in one pixel */
    assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
    assert_int_equal(t.planes.rgba[3], RASTER_ALPHA_NOTHING);
    draw_photo_fini(&d);
    draw_target_fini(&t);
}

static void huge_splats_cost_no_more_than_their_bound(void **state) {
    (void)state;
    struct camera cam = small_camera();
    struct draw_photo d = draw_photo_make(draw_wall(&cam, 1.0f), 0);
    struct pose pose = pose_identity();
    pose.t_m = vec3_make(0, 0, 0.9); /* samples are 10 px apart and would be 9 px in radius */
    struct raster_view view = raster_view_pinhole(&cam, &pose);
    struct raster_options options = options_of(RASTER_SPLATS);
    options.radius_max_px = 5.0;
    struct draw_target t = draw_target_make(40, 36, true);
    assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
    int64_t covered = 0;
    for (size_t i = 0; i < t.pixels; i++)
        covered += t.planes.count[i];
    const int64_t samples_near = 8 * 8; /* those within 5 px of the picture */
    assert_true(covered > 500 && covered <= samples_near * 81);
    draw_target_fini(&t);
    draw_photo_fini(&d);
}

static void offsets_of_ten_thousand_kilometres_leave_the_bytes(void **state) {
    (void)state;
    struct camera cam = small_camera();
    /* Places that are multiples of 2^-16 m keep all their bits when 1e7 m are added. */
    struct vec3 stand = {0.5, -0.25, 1.5}, eye = {0.75, -0.125, 1.625}, shift = {1e7, -1e7, 1e7};
    struct draw_target t[2];
    for (int k = 0; k < 2; k++) {
        struct photo photo = floor_photo(&cam);
        struct pose from = {mat3_identity(), k ? vec3_add(stand, shift) : stand};
        photo.station_from_cam = from;
        struct draw_photo d = draw_photo_make(photo, 0);
        struct pose at = {so3_exp(vec3_make(0.05, 0.1, 0.02)), k ? vec3_add(eye, shift) : eye};
        struct raster_view view = raster_view_pinhole(&cam, &at);
        struct raster_options options = options_of(RASTER_MESH);
        t[k] = draw_target_make(40, 36, false);
        assert_int_equal(draw(&t[k], &d.input, 1, &view, &options), ST_OK);
        draw_photo_fini(&d);
    }
    assert_true(draw_count(&t[0], RASTER_ALPHA_SURFACE) > 500);
    assert_int_equal(draw_differ(&t[0], &t[1]), 0);
    assert_memory_equal(t[0].planes.depth, t[1].planes.depth, t[0].pixels * sizeof(float));
    draw_target_fini(&t[0]);
    draw_target_fini(&t[1]);
}

static void near_cuts_what_is_nearer(void **state) {
    (void)state;
    struct camera cam = small_camera();
    struct draw_photo d = draw_photo_make(floor_photo(&cam), 0);
    struct pose pose = pose_identity();
    struct raster_view view = raster_view_pinhole(&cam, &pose);
    view.near_m = 1.0;
    for (int p = 0; p < 3; p++) {
        struct raster_options options = options_of(all_primitives[p]);
        struct draw_target t = draw_target_make(40, 36, true);
        assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
        for (size_t i = 0; i < t.pixels; i++)
            assert_true(isnan(t.planes.depth[i]) || t.planes.depth[i] <= 1.0f);
        assert_int_equal(t.planes.rgba[4 * (5 * 40 + 20) + 3], RASTER_ALPHA_SURFACE);
        assert_int_equal(t.planes.rgba[4 * (34 * 40 + 20) + 3], RASTER_ALPHA_NOTHING);
        draw_target_fini(&t);
    }
    draw_photo_fini(&d);
}

static void a_parallel_view_draws_to_scale(void **state) {
    (void)state;
    struct camera cam = camera_pinhole(33, 33, 1.0);
    struct draw_photo d = draw_photo_make(draw_wall(&cam, 0.5f), 0);
    struct pose pose = pose_identity();
    double side_m = 2.0 * 32 / cam.fx_px; /* of the wall, 2 m away */
    struct raster_view view = raster_view_orthographic(101, 101, 40.0, 0.0, 10.0, &pose);
    struct raster_options options = options_of(RASTER_MESH);
    struct draw_target t = draw_target_make(101, 101, false);
    assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
    size_t row = 0;
    for (size_t x = 0; x < 101; x++)
        row += t.planes.rgba[4 * (50 * 101 + x) + 3] == RASTER_ALPHA_SURFACE;
    assert_true(fabs((double)row - side_m * 40.0) <= 1.0);
    assert_true(fabsf(t.planes.depth[50 * 101 + 50] - 0.8f) < 1e-6f);
    draw_target_fini(&t);
    draw_photo_fini(&d);
}

static void items_name_the_sample(void **state) {
    (void)state;
    struct camera cam = camera_pinhole(70, 40, 0.8);
    struct draw_photo d = draw_photo_make(draw_wall(&cam, 0.5f), 9);
    struct pose pose = pose_identity();
    struct raster_view view = raster_view_pinhole(&cam, &pose);
    for (int p = 0; p < 3; p++) {
        struct raster_options options = options_of(all_primitives[p]);
        struct draw_target t = draw_target_make(70, 40, true);
        assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
        for (uint32_t y = 0; y < 40; y++)
            for (uint32_t x = 0; x < 70; x++) {
                uint64_t item = t.planes.item[y * 70 + x];
                const struct tile *tile = &d.tiles[raster_item_tile(item)];
                assert_int_equal(raster_item_input(item), 9);
                assert_int_equal((uint32_t)tile->u0_px + raster_item_u(item), x);
                assert_int_equal((uint32_t)tile->v0_px + raster_item_v(item), y);
                assert_true(t.planes.count[y * 70 + x] >= 1);
            }
        draw_target_fini(&t);
    }
    draw_photo_fini(&d);
}

/* A wall at 4 m with a square at 2 m before it; the cells around the square are skins. */
static struct photo stepped_photo(const struct camera *cam) {
    struct photo photo = draw_wall(cam, 0.25f);
    int32_t w = cam->width_px;
    for (int32_t v = 10; v < 20; v++)
        for (int32_t u = 10; u < 20; u++)
            photo.disparity_per_m[v * w + u] = 0.5f;
    for (int32_t v = 9; v < 20; v++)
        for (int32_t u = 9; u < 20; u++)
            if (v == 9 || v == 19 || u == 9 || u == 19)
                photo.flags[v * w + u] |= PHOTO_SKIN;
    return photo;
}

static void skins_are_left_out_coloured_or_all_there_is(void **state) {
    (void)state;
    struct camera cam = small_camera();
    struct draw_photo d = draw_photo_make(stepped_photo(&cam), 0);
    struct pose pose = pose_identity();
    pose.t_m = vec3_make(0.3, 0, 0);
    struct raster_view view = raster_view_pinhole(&cam, &pose);
    size_t surface[5], unknown[5];
    for (int s = 0; s < 5; s++) {
        struct raster_options options = options_of(RASTER_MESH);
        options.skins = (enum raster_skins)s;
        struct draw_target t = draw_target_make(40, 36, false);
        assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
        surface[s] = draw_count(&t, RASTER_ALPHA_SURFACE);
        unknown[s] = draw_count(&t, RASTER_ALPHA_UNKNOWN);
        for (size_t i = 0; i < t.pixels; i++)
            if (t.planes.rgba[4 * i + 3] == RASTER_ALPHA_UNKNOWN)
                assert_memory_equal(t.planes.rgba + 4 * i, options.skin_rgb, 3);
        draw_target_fini(&t);
    }
    assert_int_equal(unknown[RASTER_SKINS_LEAVE_OUT], 0);
    assert_int_equal(unknown[RASTER_SKINS_UNKNOWN], 0); /* no skin here bounds a guess */
    assert_true(unknown[RASTER_SKINS_COLOUR] > 10);
    assert_int_equal(surface[RASTER_SKINS_DRAW],
                     surface[RASTER_SKINS_LEAVE_OUT] + unknown[RASTER_SKINS_COLOUR]);
    assert_int_equal(surface[RASTER_SKINS_ONLY], 0);
    assert_true(unknown[RASTER_SKINS_ONLY] >= unknown[RASTER_SKINS_COLOUR]);
    draw_photo_fini(&d);
}

static void the_unknown_of_one_yields_to_what_another_saw(void **state) {
    (void)state;
    struct camera cam = small_camera();
    struct draw_photo a = draw_photo_make(stepped_photo(&cam), 0);
    struct draw_photo b = draw_photo_make(draw_wall(&cam, 0.2f), 1); /* looks through all of it */
    struct pose pose = pose_identity();
    pose.t_m = vec3_make(0.3, 0, 0);
    struct raster_view view = raster_view_pinhole(&cam, &pose);
    struct raster_options options = options_of(RASTER_MESH);
    options.skins = RASTER_SKINS_COLOUR;
    const struct raster_input both[2] = {a.input, b.input};
    struct draw_target t = draw_target_make(40, 36, true);
    assert_int_equal(draw(&t, &a.input, 1, &view, &options), ST_OK);
    assert_true(draw_count(&t, RASTER_ALPHA_UNKNOWN) > 10);
    assert_int_equal(draw(&t, both, 2, &view, &options), ST_OK);
    assert_int_equal(draw_count(&t, RASTER_ALPHA_UNKNOWN), 0);
    assert_true(draw_count(&t, RASTER_ALPHA_SURFACE) > 1000);
    draw_target_fini(&t);
    draw_photo_fini(&a);
    draw_photo_fini(&b);
}

static void faces_seen_from_behind_are_left_out_on_request(void **state) {
    (void)state;
    struct camera cam = small_camera();
    struct draw_photo d = draw_photo_make(draw_wall(&cam, 0.5f), 0);
    struct pose behind;
    assert_int_equal(
        pose_look_at(vec3_make(0, 0, 4), vec3_make(0, 0, 2), vec3_make(0, -1, 0), &behind), ST_OK);
    struct raster_view view = raster_view_pinhole(&cam, &behind);
    struct raster_options options = options_of(RASTER_MESH);
    struct draw_target t = draw_target_make(40, 36, false);
    assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
    assert_true(draw_count(&t, RASTER_ALPHA_SURFACE) > 1000);
    options.faces = RASTER_FACES_FRONT;
    assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
    assert_int_equal(draw_count(&t, RASTER_ALPHA_SURFACE), 0);
    draw_target_fini(&t);
    draw_photo_fini(&d);
}

static void nonsense_is_refused(void **state) {
    (void)state;
    struct camera cam = small_camera();
    struct pose pose = pose_identity();
    struct raster_view good = raster_view_pinhole(&cam, &pose);
    struct raster_options options = options_of(RASTER_SPLATS);
    struct draw_target t = draw_target_make(40, 36, false);
    struct raster_view bad[6];
    for (int i = 0; i < 6; i++)
        bad[i] = good;
    bad[0].fx = NAN;
    bad[1].fy = 0.0;
    bad[2].eye_m.y = INFINITY;
    bad[3].near_m = -1.0;
    bad[4].width_px = 41;
    bad[5].cam_from_world_r.m[4] = NAN;
    for (int i = 0; i < 6; i++)
        assert_int_equal(draw(&t, NULL, 0, &bad[i], &options), ST_INVALID);
    struct raster_options wrong[5];
    for (int i = 0; i < 5; i++)
        wrong[i] = options;
    wrong[0].radius_k = 0.0;
    wrong[1].radius_max_px = 1e9;
    wrong[2].falloff = -1.0;
    wrong[3].push_sigma = NAN;
    wrong[4].threads = -1;
    for (int i = 0; i < 5; i++)
        assert_int_equal(draw(&t, NULL, 0, &good, &wrong[i]), ST_INVALID);
    struct raster_view flat = raster_view_orthographic(40, 36, 10.0, 5.0, 5.0, &pose);
    assert_int_equal(draw(&t, NULL, 0, &flat, &options), ST_INVALID);
    struct raster_input input = {.id = RASTER_MAX_INPUT_ID};
    assert_int_equal(draw(&t, &input, 1, &good, &options), ST_INVALID);
    draw_target_fini(&t);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(own_view_shows_the_photograph_from_micrometres_to_megametres),
        cmocka_unit_test(infinity_is_drawn_and_does_not_move_with_the_eye),
        cmocka_unit_test(anything_near_hides_infinity),
        cmocka_unit_test(a_tile_behind_the_eye_is_rejected),
        cmocka_unit_test(an_eye_in_a_surface_or_at_a_sample_draws_finite_numbers),
        cmocka_unit_test(a_mesh_that_passes_the_eye_fills_the_picture_in_front),
        cmocka_unit_test(what_is_no_disparity_is_not_drawn),
        cmocka_unit_test(nothing_in_gives_the_background),
        cmocka_unit_test(huge_splats_cost_no_more_than_their_bound),
        cmocka_unit_test(offsets_of_ten_thousand_kilometres_leave_the_bytes),
        cmocka_unit_test(near_cuts_what_is_nearer),
        cmocka_unit_test(a_parallel_view_draws_to_scale),
        cmocka_unit_test(items_name_the_sample),
        cmocka_unit_test(skins_are_left_out_coloured_or_all_there_is),
        cmocka_unit_test(the_unknown_of_one_yields_to_what_another_saw),
        cmocka_unit_test(faces_seen_from_behind_are_left_out_on_request),
        cmocka_unit_test(nonsense_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
