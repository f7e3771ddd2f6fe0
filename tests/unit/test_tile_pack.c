/* Tile packs: written, read, damaged. */
#include "base/fileio.h"
#include "base/rng.h"
#include "base/tile_pack.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

static char path[64];

static struct tile_pack_photo make_photo(const char *name, int32_t width, int32_t height) {
    struct tile_pack_photo p = {.photo_id = 7, .station_id = 3};
    (void)snprintf(p.name, sizeof p.name, "%s", name);
    p.camera = camera_pinhole(width, height, 1.2);
    p.station_from_cam = pose_identity();
    p.world_from_station = pose_identity();
    p.world_from_station.t_m = vec3_make(1e7, -5.0, 2.0);
    return p;
}

static void make_samples(struct tile_samples *s, int64_t node) {
    memset(s, 0, sizeof *s);
    struct rng rng = rng_stream(1, (uint64_t)node);
    s->width = s->height = 33;
    for (int i = 0; i < 33 * 33; i++) {
        s->disparity_per_m[i] = (float)rng_range(&rng, 0.1, 0.2);
        s->rgb[3 * i] = (uint8_t)rng_u64(&rng);
        s->confidence[i] = 220;
    }
}

static void write_pack(void) {
    struct tile_pack_photo photos[2] = {make_photo("front", 100, 70), make_photo("left", 33, 20)};
    struct tile_pack_writer *writer = NULL;
    struct errctx err;
    assert_int_equal(tile_pack_create(path, photos, 2, 0.001, 6.0, &writer, &err), ST_OK);
    assert_int_equal(photos[0].level_count, 3);
    assert_int_equal(photos[1].first_node[0], 12 + 4 + 1);
    struct tile_code_options o = tile_code_options_default(1e-5);
    for (int64_t node = 0; node < 20; node += 2) { /* in a stupid order: fine first */
        struct tile_samples s;
        uint8_t bytes[TILE_CODE_MAX_BYTES];
        size_t size;
        make_samples(&s, node);
        assert_int_equal(tile_code_encode(&s, &o, bytes, &size, NULL), ST_OK);
        struct tile_pack_node n = {.size_bytes = (uint32_t)size,
                                   .kind = TILE_PACK_SAMPLED,
                                   .disparity_min_per_m = 0.1f,
                                   .disparity_max_per_m = 0.2f,
                                   .valid_count = 1024};
        assert_int_equal(tile_pack_put(writer, node, &n, bytes, &err), ST_OK);
    }
    uint64_t file_bytes = 0;
    assert_int_equal(tile_pack_commit(writer, &file_bytes, &err), ST_OK);
    uint64_t on_disk = 0;
    assert_int_equal(fileio_size(path, &on_disk, &err), ST_OK);
    assert_int_equal(file_bytes, on_disk);
}

static void reads_back_what_was_written(void **state) {
    (void)state;
    write_pack();
    struct tile_pack *pack = NULL;
    struct errctx err;
    assert_int_equal(tile_pack_open(path, &pack, &err), ST_OK);
    const struct tile_pack_index *x = tile_pack_get_index(pack);
    assert_int_equal(x->photo_count, 2);
    assert_int_equal(x->node_count, 20);
    assert_string_equal(x->photos[1].name, "left");
    assert_true(x->photos[0].world_from_station.t_m.x == 1e7);
    assert_int_equal(x->photos[0].station_id, 3);
    for (int64_t node = 0; node < 20; node++) {
        struct tile_samples got, want;
        enum st st = tile_pack_read(pack, node, &got, &err);
        assert_int_equal(st, node % 2 ? ST_NOT_FOUND : ST_OK);
        if (st)
            continue;
        make_samples(&want, node);
        assert_memory_equal(got.rgb, want.rgb, sizeof got.rgb);
        for (int i = 0; i < 33 * 33; i++)
            assert_true(fabsf(got.disparity_per_m[i] - want.disparity_per_m[i]) < 5.1e-6f);
    }
    assert_int_equal(tile_pack_read(pack, 20, &(struct tile_samples){0}, &err), ST_INVALID);
    tile_pack_close(pack);
}

static void coarse_tiles_stand_first(void **state) {
    (void)state;
    write_pack();
    struct tile_pack *pack = NULL;
    struct errctx err;
    assert_int_equal(tile_pack_open(path, &pack, &err), ST_OK);
    const struct tile_pack_index *x = tile_pack_get_index(pack);
    const struct tile_pack_photo *p = x->photos;
    /* level 2 of photograph 0 is node 16, level 1 nodes 12 to 15 */
    assert_true(x->nodes[16].offset < x->nodes[12].offset);
    assert_true(x->nodes[14].offset < x->nodes[0].offset);
    assert_int_equal(tile_pack_node_at(p, 1, 1, 1), 15);
    tile_pack_close(pack);
}

static void a_level_sees_the_same_space(void **state) {
    (void)state;
    struct camera c = camera_pinhole(101, 70, 1.2), half = tile_pack_camera(&c, 1);
    assert_int_equal(half.width_px, 51);
    assert_int_equal(half.height_px, 35);
    /* pixel 10 of level 1 covers 20 and 21: its ray is that of 20.5 */
    struct vec3 a = camera_pinhole_ray(&half, 10, 7), b = camera_pinhole_ray(&c, 20.5, 14.5);
    assert_true(fabs(a.x - b.x) < 1e-12 && fabs(a.y - b.y) < 1e-12);
}

static void a_tile_is_where_its_photograph_is(void **state) {
    (void)state;
    struct tile_pack_photo p = make_photo("front", 100, 70);
    struct tile_samples s;
    make_samples(&s, 0);
    struct tile t = tile_pack_tile(&p, 0, 1, 0, &s);
    assert_int_equal(t.u0_px, 32);
    assert_int_equal(t.width_px, 32);
    assert_int_equal(t.cells_x, 32);
    struct vec4 uv = {3.0, 4.0, 1.0, 0.125};
    struct vec4 q = mat4_mulv(&t.m, uv);
    struct vec3 ray = camera_pinhole_ray(&p.camera, 35.0, 4.0);
    assert_true(fabs(q.x / q.w - ray.x * 8.0) < 1e-9 && fabs(q.z / q.w - 8.0) < 1e-9);
    assert_true(t.origin_m.x == 1e7);
}

static void refuses_damage(void **state) {
    (void)state;
    write_pack();
    struct errctx err;
    uint8_t *bytes = NULL;
    size_t size = 0;
    assert_int_equal(fileio_read(path, 1 << 20, &bytes, &size, &err), ST_OK);
    struct tile_pack *pack = NULL;
    for (size_t cut = 0; cut < size; cut += 101) /* truncated */
        assert_true(tile_pack_open_memory(bytes, cut, &pack, &err) != ST_OK);
    size_t index = 64 + 2 * 320 + 20 * 32;
    for (size_t at = 0; at < index; at += 7) { /* any byte of the index */
        bytes[at] ^= 0x10;
        assert_true(tile_pack_open_memory(bytes, size, &pack, &err) != ST_OK);
        bytes[at] ^= 0x10;
    }
    bytes[size - 1] ^= 1; /* a tile: the others are still read */
    assert_int_equal(tile_pack_open_memory(bytes, size, &pack, &err), ST_OK);
    int damaged = 0;
    for (int64_t node = 0; node < 20; node += 2) {
        struct tile_samples got;
        enum st st = tile_pack_read(pack, node, &got, &err);
        damaged += st == ST_DAMAGED;
        assert_true(st == ST_OK || st == ST_DAMAGED);
    }
    assert_int_equal(damaged, 1);
    tile_pack_close(pack);
    free(bytes);
}

static void an_empty_pack_is_a_pack(void **state) {
    (void)state;
    struct tile_pack_writer *writer = NULL;
    struct tile_pack *pack = NULL;
    struct errctx err;
    assert_int_equal(tile_pack_create(path, NULL, 0, 0.001, 6.0, &writer, &err), ST_OK);
    assert_int_equal(tile_pack_commit(writer, NULL, &err), ST_OK);
    assert_int_equal(tile_pack_open(path, &pack, &err), ST_OK);
    assert_int_equal(tile_pack_get_index(pack)->node_count, 0);
    tile_pack_close(pack);
    assert_int_equal(tile_pack_open("no/such/file", &pack, &err), ST_NOT_FOUND);
}

static int set_up(void **state) {
    (void)state;
    (void)snprintf(path, sizeof path, "/tmp/test_tile_pack.%ld", (long)getpid());
    return 0;
}
static int tear_down(void **state) {
    (void)state;
    return unlink(path);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(reads_back_what_was_written),
        cmocka_unit_test(coarse_tiles_stand_first),
        cmocka_unit_test(a_level_sees_the_same_space),
        cmocka_unit_test(a_tile_is_where_its_photograph_is),
        cmocka_unit_test(refuses_damage),
        cmocka_unit_test(an_empty_pack_is_a_pack),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
