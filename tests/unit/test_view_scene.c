/* What is drawn of a pyramid: no hole and no surface twice at any moment of loading, hysteresis,
 * budgets, and what happens with damage, one tile and none. */
#include "render/view_scene.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/view_fake.h"

#include <math.h>
#include <string.h>

enum { SIDE_PX = 512, TILES = SIDE_PX / PHOTO_TILE_PX };

static struct view_fake fake;
static struct view_scene *scene;
static struct view_scene_stats stats;
static const struct render_item *items;
static size_t count;

static void open_scene(int32_t photos, int32_t width_px, size_t cache_bytes) {
    struct errctx err = {0};
    view_fake_make(&fake, photos, width_px);
    struct tile_source source = view_fake_source(&fake);
    assert_int_equal(view_scene_create(&source, cache_bytes, &scene, &err), ST_OK);
}

static int close_scene(void **state) {
    (void)state;
    view_scene_destroy(scene);
    view_fake_fini(&fake);
    scene = NULL;
    return 0;
}

static void choose(const struct raster_view *view, double error_px, double load_s) {
    struct errctx err = {0};
    struct view_quality quality = view_quality_default();
    quality.error_px = error_px;
    quality.load_s = load_s;
    assert_int_equal(view_scene_select(scene, view, &quality, &items, &count, &stats, &err), ST_OK);
}

/* How often each tile's place of photograph 0's finest level is covered, itself or by a coarser. */
static void cover(int *out_least, int *out_most) {
    static int times[TILES][TILES];
    memset(times, 0, sizeof times);
    for (size_t k = 0; k < count; k++) {
        struct view_fake_place at = view_fake_place_of(&fake, (int64_t)items[k].key);
        if (at.photo != 0)
            continue;
        for (int y = at.j << at.level; y < (at.j + 1) << at.level && y < TILES; y++)
            for (int x = at.i << at.level; x < (at.i + 1) << at.level && x < TILES; x++)
                times[y][x]++;
    }
    *out_least = *out_most = times[0][0];
    for (int y = 0; y < TILES; y++)
        for (int x = 0; x < TILES; x++) {
            *out_least = times[y][x] < *out_least ? times[y][x] : *out_least;
            *out_most = times[y][x] > *out_most ? times[y][x] : *out_most;
        }
}

static int finest_level(void) {
    int level = 99;
    for (size_t k = 0; k < count; k++) {
        struct view_fake_place at = view_fake_place_of(&fake, (int64_t)items[k].key);
        level = at.level < level ? at.level : level;
    }
    return level;
}

static void parents_stay_until_all_children_are_there(void **state) {
    (void)state;
    open_scene(1, SIDE_PX, 0);
    struct raster_view view = view_fake_view(&fake, SIDE_PX);
    int frames = 0, least, most;
    bool partly = false;
    do {
        choose(&view, 1.0, 0.0); /* a few tiles a frame */
        cover(&least, &most);
        if (count) { /* from the first picture on: no hole, nothing twice */
            assert_int_equal(least, 1);
            assert_int_equal(most, 1);
        }
        partly = partly || (count > 1 && !stats.complete);
        frames++;
    } while (!stats.complete && frames < 1000);
    assert_true(stats.complete && partly && frames > 2);
    assert_int_equal(finest_level(), 0);
    assert_int_equal(count, TILES * TILES);
}

static void refined_tiles_stay_down_to_four_fifths(void **state) {
    (void)state;
    open_scene(1, SIDE_PX, 0);
    /* At level 1 a sample is 2 w / SIDE_PX pixels large. */
    struct raster_view above = view_fake_view(&fake, SIDE_PX * 11 / 20);
    struct raster_view between = view_fake_view(&fake, SIDE_PX * 9 / 20);
    struct raster_view below = view_fake_view(&fake, SIDE_PX * 7 / 20);
    choose(&between, 1.0, 10.0);
    assert_int_equal(finest_level(), 1); /* 0.9 px: fine enough */
    choose(&above, 1.0, 10.0);
    assert_int_equal(finest_level(), 0);
    choose(&between, 1.0, 10.0);
    assert_int_equal(finest_level(), 0); /* stays */
    choose(&below, 1.0, 10.0);
    assert_int_equal(finest_level(), 1);
    choose(&between, 1.0, 10.0);
    assert_int_equal(finest_level(), 1); /* and does not come back */
}

static void budget_of_tiles_bounds_the_frame(void **state) {
    (void)state;
    open_scene(1, SIDE_PX, 0);
    struct raster_view view = view_fake_view(&fake, SIDE_PX);
    struct errctx err = {0};
    struct view_quality quality = view_quality_default();
    quality.tiles_max = 40;
    quality.load_s = 10.0;
    int least, most;
    assert_int_equal(view_scene_select(scene, &view, &quality, &items, &count, &stats, &err),
                     ST_OK);
    assert_true(count <= 40 && count > 16);
    cover(&least, &most);
    assert_int_equal(least, 1);
    assert_int_equal(most, 1);
}

static void damaged_tile_leaves_its_parent_and_no_hole(void **state) {
    (void)state;
    open_scene(1, SIDE_PX, 0);
    fake.damaged = 3 * TILES + 5; /* one of the finest */
    struct raster_view view = view_fake_view(&fake, SIDE_PX);
    int least, most;
    for (int i = 0; i < 3; i++)
        choose(&view, 1.0, 10.0);
    cover(&least, &most);
    assert_int_equal(least, 1);
    assert_int_equal(most, 1);
    assert_int_equal(stats.cache.damaged, 1);
    assert_int_equal(count, TILES * TILES - 3); /* one parent for four */
    assert_true(stats.complete);
}

static void small_cache_shows_everything_coarser(void **state) {
    (void)state;
    open_scene(16, SIDE_PX, 16 << 20); /* 16 photographs of 4.5 MB each in 16 MB */
    struct raster_view view = view_fake_view(&fake, SIDE_PX);
    int least = 0, most = 0;
    for (int i = 0; i < 20; i++) {
        choose(&view, 1.0, 0.01);
        assert_true(stats.cache.resident <= stats.cache.capacity);
        if (i > 0) {
            cover(&least, &most);
            assert_int_equal(least, 1);
            assert_int_equal(most, 1);
        }
    }
}

static void one_tile_and_none_are_fine(void **state) {
    (void)state;
    open_scene(1, 20, 0);
    struct raster_view view = view_fake_view(&fake, 64);
    choose(&view, 1.0, 1.0);
    assert_int_equal(count, 1);
    (void)close_scene(NULL);
    open_scene(0, 20, 0);
    struct vec3 centre;
    double radius_m = 0;
    choose(&view, 1.0, 1.0);
    assert_int_equal(count, 0);
    assert_true(stats.complete);
    view_scene_place(scene, &centre, &radius_m);
    assert_true(radius_m > 0.0 && isfinite(centre.x));
}

static void tiles_behind_the_eye_are_not_chosen(void **state) {
    (void)state;
    open_scene(1, SIDE_PX, 0);
    struct raster_view view = view_fake_view(&fake, SIDE_PX);
    for (int i = 0; i < 9; i += 1) /* look the other way: x and z of the camera change sign */
        if (i / 3 != 1)
            view.cam_from_world_r.m[i] = -view.cam_from_world_r.m[i];
    choose(&view, 1.0, 1.0);
    assert_int_equal(count, 0);
    assert_int_equal(fake.reads, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(parents_stay_until_all_children_are_there, close_scene),
        cmocka_unit_test_teardown(refined_tiles_stay_down_to_four_fifths, close_scene),
        cmocka_unit_test_teardown(budget_of_tiles_bounds_the_frame, close_scene),
        cmocka_unit_test_teardown(damaged_tile_leaves_its_parent_and_no_hole, close_scene),
        cmocka_unit_test_teardown(small_cache_shows_everything_coarser, close_scene),
        cmocka_unit_test_teardown(one_tile_and_none_are_fine, close_scene),
        cmocka_unit_test_teardown(tiles_behind_the_eye_are_not_chosen, close_scene),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
