/* The rasteriser over random views of a room: one picture whatever the threads, the order and the
 * planes asked for; closed surfaces stay closed; the denser of two samples of one surface wins. */
#include "base/rng.h"
#include "raster/raster.h"
#include "raster/skin.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/draw.h"
#include "tests/support/prop.h"
#include "tests/support/room.h"

#include <math.h>

enum { PHOTOS = 3, CASES = 24 };
static const struct vec3 no_offset = {0, 0, 0};

static uint64_t seed;

/* Three photographs of the room with noise, skins marked and the unknown bounded. */
static void make_photos(struct draw_photo out[PHOTOS]) {
    static const double at[PHOTOS][3] = {{-2.5, -1.5, 0.5}, {-1.0, -1.8, 1.0}, {0.5, -2.0, 1.8}};
    for (uint32_t i = 0; i < PHOTOS; i++) {
        struct camera cam = camera_pinhole(150 + 20 * (int32_t)i, 110, 1.2);
        struct pose pose = room_pose(at[i][0], at[i][1], at[i][2], no_offset);
        struct photo photo = room_photo(&cam, &pose, no_offset, 0.004, seed + i);
        struct rng rng = rng_stream(seed, i);
        for (size_t k = 0; k < 150 * 110; k++)
            if (rng_below(&rng, 50) == 0) {
                photo.disparity_per_m[k] = NAN;
                photo.flags[k] = PHOTO_DROPPED;
            }
        struct skin_params params = skin_params_default();
        (void)skin_mark(&photo, &params);
        assert_int_equal(skin_bound_unknown(&photo, NULL), ST_OK);
        out[i] = draw_photo_make(photo, i);
    }
}

static struct raster_view random_view(struct rng *rng) {
    struct camera cam = camera_pinhole(90 + (int32_t)rng_below(rng, 150),
                                       70 + (int32_t)rng_below(rng, 120), rng_range(rng, 0.2, 1.5));
    struct pose pose = room_pose(rng_range(rng, -3.5, 3.5), rng_range(rng, -2.5, 2.5),
                                 rng_range(rng, -3.1, 3.1), no_offset);
    return raster_view_pinhole(&cam, &pose);
}

static struct raster_options random_options(struct rng *rng) {
    struct raster_options options = raster_options_default();
    options.primitive = (enum raster_primitive)rng_below(rng, 3);
    options.skins = (enum raster_skins)rng_below(rng, 5);
    options.filter = (enum raster_filter)rng_below(rng, 3);
    options.faces = (enum raster_faces)rng_below(rng, 2);
    options.radius = (enum raster_radius)rng_below(rng, 2);
    options.radius_k = rng_range(rng, 0.8, 2.5);
    options.push_sigma = rng_below(rng, 2) ? 2.0 : 0.0;
    return options;
}

static void assert_same(const struct draw_target *a, const struct draw_target *b) {
    assert_memory_equal(a->planes.rgba, b->planes.rgba, 4 * a->pixels);
    assert_memory_equal(a->planes.depth, b->planes.depth, sizeof(float) * a->pixels);
}

static void the_number_of_threads_does_not_show(void **state) {
    (void)state;
    struct draw_photo photos[PHOTOS];
    make_photos(photos);
    struct raster_input inputs[PHOTOS] = {photos[0].input, photos[1].input, photos[2].input};
    struct rng rng = rng_stream(seed, 100);
    for (int k = 0; k < CASES; k++) {
        struct raster_view view = random_view(&rng);
        struct raster_options options = random_options(&rng);
        bool rich = k % 3 == 0;
        struct draw_target one = draw_target_make(view.width_px, view.height_px, rich);
        options.threads = 1;
        assert_int_equal(draw(&one, inputs, PHOTOS, &view, &options), ST_OK);
        for (int threads = 2; threads <= 4; threads += 2) {
            struct draw_target more = draw_target_make(view.width_px, view.height_px, rich);
            options.threads = threads;
            assert_int_equal(draw(&more, inputs, PHOTOS, &view, &options), ST_OK);
            assert_same(&one, &more);
            if (rich) {
                assert_memory_equal(one.planes.item, more.planes.item, 8 * one.pixels);
                assert_memory_equal(one.planes.count, more.planes.count, 2 * one.pixels);
            }
            draw_target_fini(&more);
        }
        draw_target_fini(&one);
    }
    for (int i = 0; i < PHOTOS; i++)
        draw_photo_fini(&photos[i]);
}

/* Tiles of all photographs in one random order, as one input. */
static struct raster_input shuffled(const struct draw_photo photos[PHOTOS], struct tile *tiles,
                                    struct rng *rng) {
    size_t n = 0;
    for (int i = 0; i < PHOTOS; i++) {
        memcpy(tiles + n, photos[i].tiles, photos[i].input.tile_count * sizeof *tiles);
        n += photos[i].input.tile_count;
    }
    for (size_t i = n - 1; i > 0; i--) {
        size_t k = rng_below(rng, (uint32_t)(i + 1));
        struct tile t = tiles[i];
        tiles[i] = tiles[k];
        tiles[k] = t;
    }
    return (struct raster_input){.tiles = tiles, .tile_count = n};
}

static void the_order_of_photographs_and_tiles_does_not_show(void **state) {
    (void)state;
    struct draw_photo photos[PHOTOS];
    make_photos(photos);
    struct tile *tiles = calloc(PHOTOS * 64, sizeof *tiles);
    assert_non_null(tiles);
    struct rng rng = rng_stream(seed, 200);
    for (int k = 0; k < CASES; k++) {
        struct raster_view view = random_view(&rng);
        struct raster_options options = random_options(&rng);
        /* Tiles torn from their photographs have no unknown of their own to yield, and read no
         * neighbours. */
        bool tear = k % 2 == 0;
        if (tear && options.skins != RASTER_SKINS_ONLY)
            options.skins = RASTER_SKINS_LEAVE_OUT;
        struct raster_input inputs[PHOTOS] = {photos[0].input, photos[1].input, photos[2].input};
        for (int i = 0; tear && i < PHOTOS; i++)
            inputs[i].photo_width_px = inputs[i].photo_height_px = 0;
        struct draw_target a = draw_target_make(view.width_px, view.height_px, false);
        struct draw_target b = draw_target_make(view.width_px, view.height_px, false);
        assert_int_equal(draw(&a, inputs, PHOTOS, &view, &options), ST_OK);
        if (tear) {
            struct raster_input all = shuffled(photos, tiles, &rng);
            assert_int_equal(draw(&b, &all, 1, &view, &options), ST_OK);
        } else {
            struct raster_input turned[PHOTOS] = {inputs[2], inputs[0], inputs[1]};
            assert_int_equal(draw(&b, turned, PHOTOS, &view, &options), ST_OK);
        }
        assert_same(&a, &b);
        draw_target_fini(&a);
        draw_target_fini(&b);
    }
    free(tiles);
    for (int i = 0; i < PHOTOS; i++)
        draw_photo_fini(&photos[i]);
}

static void asking_for_items_does_not_change_the_colours(void **state) {
    (void)state;
    struct draw_photo photos[PHOTOS];
    make_photos(photos);
    struct raster_input inputs[PHOTOS] = {photos[0].input, photos[1].input, photos[2].input};
    struct rng rng = rng_stream(seed, 300);
    for (int k = 0; k < CASES; k++) {
        struct raster_view view = random_view(&rng);
        struct raster_options options = random_options(&rng);
        struct draw_target plain = draw_target_make(view.width_px, view.height_px, false);
        struct draw_target rich = draw_target_make(view.width_px, view.height_px, true);
        assert_int_equal(draw(&plain, inputs, PHOTOS, &view, &options), ST_OK);
        assert_int_equal(draw(&rich, inputs, PHOTOS, &view, &options), ST_OK);
        assert_memory_equal(plain.planes.rgba, rich.planes.rgba, 4 * plain.pixels);
        for (size_t i = 0; i < rich.pixels; i++)
            assert_int_equal(rich.planes.rgba[4 * i + 3] == 0,
                             rich.planes.item[i] == RASTER_NO_ITEM);
        draw_target_fini(&plain);
        draw_target_fini(&rich);
    }
    for (int i = 0; i < PHOTOS; i++)
        draw_photo_fini(&photos[i]);
}

/* World offsets as they come, not chosen to fit a double: the picture may differ where a sample's
 * last bits move it over a pixel's edge. 1e7 m leave 2e-9 m, 1e-5 px here; allowed are 1 pixel in
 * 1000. */
static const double offset_tolerance = 1e-3;

static void world_offsets_do_not_show(void **state) {
    (void)state;
    struct rng rng = rng_stream(seed, 400);
    size_t differ = 0, all = 0;
    for (int k = 0; k < 8; k++) {
        struct vec3 shift = vec3_scale(rng_direction(&rng), 1e7);
        struct camera cam = camera_pinhole(120, 90, 1.1);
        struct pose stand = room_pose(-2.1, -1.3, rng_range(&rng, 0.0, 1.0), no_offset);
        struct photo near_photo = room_photo(&cam, &stand, no_offset, 0.0, 1);
        struct photo far_photo = room_photo(&cam, &stand, no_offset, 0.0, 1);
        far_photo.station_from_cam.t_m = vec3_add(stand.t_m, shift);
        struct draw_photo a = draw_photo_make(near_photo, 0), b = draw_photo_make(far_photo, 0);
        struct pose eye = room_pose(-1.6, -1.1, 0.4, no_offset);
        struct raster_view view = raster_view_pinhole(&cam, &eye);
        struct raster_options options = raster_options_default();
        options.primitive = (enum raster_primitive)(k % 3);
        struct draw_target ta = draw_target_make(120, 90, false);
        struct draw_target tb = draw_target_make(120, 90, false);
        assert_int_equal(draw(&ta, &a.input, 1, &view, &options), ST_OK);
        view.eye_m = vec3_add(view.eye_m, shift);
        assert_int_equal(draw(&tb, &b.input, 1, &view, &options), ST_OK);
        differ += draw_differ(&ta, &tb);
        all += ta.pixels;
        draw_target_fini(&ta);
        draw_target_fini(&tb);
        draw_photo_fini(&a);
        draw_photo_fini(&b);
    }
    print_message("%zu of %zu pixels differ\n", differ, all);
    assert_true((double)differ <= offset_tolerance * (double)all);
}

/* Uncovered pixels whose four neighbours are covered. */
static size_t pinholes(const struct draw_target *t) {
    size_t w = (size_t)t->planes.width_px, h = (size_t)t->planes.height_px, n = 0;
    const uint8_t *a = t->planes.rgba + 3;
    for (size_t y = 1; y + 1 < h; y++)
        for (size_t x = 1; x + 1 < w; x++) {
            size_t i = y * w + x;
            n += !a[4 * i] && a[4 * (i - 1)] && a[4 * (i + 1)] && a[4 * (i - w)] && a[4 * (i + w)];
        }
    return n;
}

static void a_mesh_has_no_cracks(void **state) {
    (void)state;
    struct camera cam = camera_pinhole(100, 100, 0.9);
    struct photo wall = draw_wall(&cam, 0.5f);
    struct rng rng = rng_stream(seed, 500);
    for (size_t i = 0; i < 100 * 100; i++) /* a slanted plane: affine in (u, v) */
        wall.disparity_per_m[i] = 0.4f + 0.002f * (float)(i % 100) + 0.001f * (float)(i / 100);
    struct draw_photo d = draw_photo_make(wall, 0);
    for (int k = 0; k < 40; k++) {
        struct camera vc = camera_pinhole(333, 222, rng_range(&rng, 0.02, 1.2));
        struct pose pose = pose_identity();
        pose.t_m =
            vec3_make(rng_range(&rng, -1, 1), rng_range(&rng, -1, 1), rng_range(&rng, -2, 1));
        pose.r = so3_exp(vec3_scale(rng_direction(&rng), rng_range(&rng, 0, 0.4)));
        struct raster_view view = raster_view_pinhole(&vc, &pose);
        struct raster_options options = raster_options_default();
        options.primitive = RASTER_MESH;
        struct draw_target t = draw_target_make(333, 222, false);
        assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
        assert_int_equal(pinholes(&t), 0);
        draw_target_fini(&t);
    }
    draw_photo_fini(&d);
}

/* The paper's radius grows with the 2/3 power of the magnification and leaves holes when zoomed;
 * the area form does not. */
static void splats_by_area_stay_closed_at_any_zoom(void **state) {
    (void)state;
    struct camera cam = camera_pinhole(128, 128, 0.9);
    struct draw_photo d = draw_photo_make(draw_wall(&cam, 0.5f), 0);
    struct rng rng = rng_stream(seed, 600);
    for (int k = 0; k < 20; k++) {
        double zoom = exp(rng_range(&rng, 0.0, 3.0));
        struct camera vc = camera_pinhole(200, 200, 2.0 * atan(0.4 / zoom));
        struct pose pose = pose_identity();
        pose.t_m = vec3_make(rng_range(&rng, -0.1, 0.1), rng_range(&rng, -0.1, 0.1), 0);
        struct raster_view view = raster_view_pinhole(&vc, &pose);
        struct raster_options options = raster_options_default();
        struct draw_target t = draw_target_make(200, 200, false);
        assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
        assert_int_equal(draw_count(&t, RASTER_ALPHA_SURFACE), t.pixels);
        options.radius = RASTER_RADIUS_CUBEROOT;
        assert_int_equal(draw(&t, &d.input, 1, &view, &options), ST_OK);
        size_t holes = draw_count(&t, RASTER_ALPHA_NOTHING);
        if (zoom > 8.0)
            assert_true(holes > t.pixels / 20);
        draw_target_fini(&t);
    }
    draw_photo_fini(&d);
}

/* Two photographs of one wall, equally noisy, one twice as dense: share of pixels that the denser
 * wins. */
static double denser_share(double push_sigma, bool dense_first) {
    struct camera coarse_cam = camera_pinhole(80, 80, 0.8),
                  dense_cam = camera_pinhole(114, 114, 0.8);
    struct photo coarse = draw_wall(&coarse_cam, 0.5f), dense = draw_wall(&dense_cam, 0.5f);
    const double sigma = 1e-3;
    struct rng rng = rng_stream(seed, 700);
    struct photo *both[2] = {&coarse, &dense};
    for (int i = 0; i < 2; i++) {
        size_t n = (size_t)both[i]->camera.width_px * (size_t)both[i]->camera.height_px;
        for (size_t k = 0; k < n; k++) {
            both[i]->disparity_per_m[k] += (float)(sigma * rng_normal(&rng));
            both[i]->confidence[k] = photo_confidence_from_sigma(sigma);
        }
    }
    struct draw_photo a = draw_photo_make(coarse, 0), b = draw_photo_make(dense, 1);
    const struct raster_input inputs[2] = {dense_first ? b.input : a.input,
                                           dense_first ? a.input : b.input};
    struct pose pose = pose_identity();
    struct camera vc = camera_pinhole(300, 300, 0.8);
    struct raster_view view = raster_view_pinhole(&vc, &pose);
    struct raster_options options = raster_options_default();
    options.primitive = RASTER_MESH;
    options.push_sigma = push_sigma;
    struct draw_target t = draw_target_make(300, 300, true);
    assert_int_equal(draw(&t, inputs, 2, &view, &options), ST_OK);
    size_t wins = 0, drawn = 0;
    for (size_t i = 0; i < t.pixels; i++) {
        drawn += t.planes.item[i] != RASTER_NO_ITEM;
        wins += t.planes.item[i] != RASTER_NO_ITEM && raster_item_input(t.planes.item[i]) == 1;
    }
    draw_target_fini(&t);
    draw_photo_fini(&a);
    draw_photo_fini(&b);
    return (double)wins / (double)drawn;
}

/* Two samples with noise of one sigma each differ with sigma sqrt(2): a push of k sigmas lets the
 * denser win with probability Phi(k / sqrt(2)) = 50, 76, 92, 98 %. Mesh interpolation averages
 * noise, so more. */
static void the_denser_of_two_samples_of_a_surface_wins(void **state) {
    (void)state;
    double share[4];
    for (int k = 0; k < 4; k++) {
        share[k] = denser_share(k, false);
        assert_true(share[k] == denser_share(k, true));
    }
    print_message("denser wins %.3f %.3f %.3f %.3f at 0..3 sigmas\n", share[0], share[1], share[2],
                  share[3]);
    assert_true(share[1] > share[0] && share[1] > 0.74);
    assert_true(share[2] > 0.90 && share[3] > 0.96);
}

/* A surface behind another by far more than the noise stays hidden, however coarse the front one.
 */
static void push_back_does_not_show_what_is_hidden(void **state) {
    (void)state;
    struct camera front_cam = camera_pinhole(40, 40, 0.8), back_cam = camera_pinhole(200, 200, 0.8);
    struct photo front = draw_wall(&front_cam, 0.5f), back = draw_wall(&back_cam, 0.45f);
    memset(front.confidence, photo_confidence_from_sigma(1e-3), 40 * 40);
    memset(back.confidence, photo_confidence_from_sigma(1e-3), 200 * 200);
    struct draw_photo a = draw_photo_make(front, 0), b = draw_photo_make(back, 1);
    const struct raster_input inputs[2] = {a.input, b.input};
    struct pose pose = pose_identity();
    struct camera vc = camera_pinhole(120, 120, 0.7);
    struct raster_view view = raster_view_pinhole(&vc, &pose);
    struct draw_target t = draw_target_make(120, 120, true);
    for (int p = 1; p < 3; p++) {
        struct raster_options options = raster_options_default();
        options.primitive = (enum raster_primitive)p;
        options.push_sigma = 2.0;
        assert_int_equal(draw(&t, inputs, 2, &view, &options), ST_OK);
        for (size_t i = 0; i < t.pixels; i++)
            assert_int_equal(raster_item_input(t.planes.item[i]), 0);
    }
    draw_target_fini(&t);
    draw_photo_fini(&a);
    draw_photo_fini(&b);
}

int main(void) {
    seed = prop_seed();
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_number_of_threads_does_not_show),
        cmocka_unit_test(the_order_of_photographs_and_tiles_does_not_show),
        cmocka_unit_test(asking_for_items_does_not_change_the_colours),
        cmocka_unit_test(world_offsets_do_not_show),
        cmocka_unit_test(a_mesh_has_no_cracks),
        cmocka_unit_test(splats_by_area_stay_closed_at_any_zoom),
        cmocka_unit_test(the_denser_of_two_samples_of_a_surface_wins),
        cmocka_unit_test(push_back_does_not_show_what_is_hidden),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
