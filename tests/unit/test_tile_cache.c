/* The cache of tiles: bounded, segmented least recently used, the coarsest levels for good. */
#include "render/tile_cache.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/view_fake.h"

#include <string.h>

enum { CACHE_BYTES = 16 << 20 };

static struct view_fake fake;
static struct tile_cache *cache;

static int set_up(void **state) {
    (void)state;
    struct errctx err = {0};
    view_fake_make(&fake, 2, 1024); /* 2 x 1365 tiles: several times what 16 MB hold */
    struct tile_source source = view_fake_source(&fake);
    return tile_cache_create(&source, CACHE_BYTES, &cache, &err) ? -1 : 0;
}

static int tear_down(void **state) {
    (void)state;
    tile_cache_destroy(cache);
    view_fake_fini(&fake);
    return 0;
}

static void load(int64_t node) {
    (void)tile_cache_load(cache, &node, 1, 1.0);
}

/* Tiles first..end-1, each in a frame of its own, asked for once. */
static void stream(int64_t first, int64_t end) {
    for (int64_t k = first; k < end; k++) {
        tile_cache_begin(cache);
        load(k);
    }
}

static void never_holds_more_than_its_bytes(void **state) {
    (void)state;
    struct tile_cache_stats stats = tile_cache_get_stats(cache);
    assert_true(stats.bytes <= CACHE_BYTES + (int64_t)(4 * (fake.index.node_count + 1)));
    stream(0, fake.index.node_count);
    stats = tile_cache_get_stats(cache);
    assert_true(stats.capacity < fake.index.node_count / 2);
    assert_true(stats.resident <= stats.capacity);
    assert_true(stats.evicted > 0);
    assert_int_equal(stats.loaded - stats.evicted, stats.resident);
}

static void what_was_asked_for_again_outlives_what_streams_by(void **state) {
    (void)state;
    int64_t often = 7, once = 8;
    load(often);
    load(once);
    tile_cache_begin(cache);
    assert_non_null(tile_cache_get(cache, often)); /* protected from now on */
    stream(100, 100 + tile_cache_get_stats(cache).capacity);
    tile_cache_begin(cache);
    assert_non_null(tile_cache_get(cache, often));
    assert_null(tile_cache_get(cache, once));
}

static void protected_tiles_leave_when_others_are_asked_for_more(void **state) {
    (void)state;
    int64_t capacity = tile_cache_get_stats(cache).capacity;
    load(7);
    tile_cache_begin(cache);
    assert_non_null(tile_cache_get(cache, 7));
    stream(100, 100 + capacity / 2);
    for (int round = 0; round < 3; round++)
        for (int64_t k = 100; k < 100 + 2 * capacity; k++) {
            tile_cache_begin(cache);
            if (!tile_cache_get(cache, k))
                load(k);
            tile_cache_begin(cache);
            (void)tile_cache_get(cache, k);
        }
    tile_cache_begin(cache);
    assert_null(tile_cache_get(cache, 7));
}

static void coarsest_levels_stay_for_good(void **state) {
    (void)state;
    const struct tile_pack_photo *photo = &fake.photos[1];
    int64_t coarsest = photo->first_node[photo->level_count - 1];
    load(coarsest);
    stream(0, fake.photos[1].first_node[0]);
    tile_cache_begin(cache);
    assert_non_null(tile_cache_get(cache, coarsest));
}

static void nothing_of_this_frame_is_pushed_out(void **state) {
    (void)state;
    int64_t capacity = tile_cache_get_stats(cache).capacity;
    tile_cache_begin(cache);
    for (int64_t k = 0; k < capacity + 50; k++)
        load(k);
    assert_true(tile_cache_get_stats(cache).resident <= capacity);
    assert_int_equal(tile_cache_get_stats(cache).evicted, 0);
    assert_non_null(tile_cache_get(cache, 0));
}

static void damaged_tile_is_said_and_not_read_again(void **state) {
    (void)state;
    fake.damaged = 5;
    load(5);
    load(5);
    struct tile_cache_stats stats = tile_cache_get_stats(cache);
    assert_int_equal(fake.reads, 1);
    assert_int_equal(stats.damaged, 1);
    assert_non_null(strstr(stats.damage, "tile 5"));
    assert_true(tile_cache_is_damaged(cache, 5));
    assert_null(tile_cache_get(cache, 5));
    load(6);
    assert_non_null(tile_cache_get(cache, 6));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(never_holds_more_than_its_bytes, set_up, tear_down),
        cmocka_unit_test_setup_teardown(what_was_asked_for_again_outlives_what_streams_by, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(protected_tiles_leave_when_others_are_asked_for_more,
                                        set_up, tear_down),
        cmocka_unit_test_setup_teardown(coarsest_levels_stay_for_good, set_up, tear_down),
        cmocka_unit_test_setup_teardown(nothing_of_this_frame_is_pushed_out, set_up, tear_down),
        cmocka_unit_test_setup_teardown(damaged_tile_is_said_and_not_read_again, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
