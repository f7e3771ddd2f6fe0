/* PLY range grids: three encodings, poses of a .conf, refusals. */
#include "base/sample_grid.h"
#include "import/ply_grid.h"
#include "tests/support/cmocka_all.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { ROWS = 4, COLUMNS = 5 };

struct bytes {
    uint8_t data[8192];
    size_t size;
};

static void put_text(struct bytes *b, const char *text) {
    memcpy(b->data + b->size, text, strlen(text));
    b->size += strlen(text);
}

static void put_bits(struct bytes *b, uint64_t bits, int bytes, bool big) {
    for (int i = 0; i < bytes; i++)
        b->data[b->size++] = (uint8_t)(bits >> 8 * (big ? bytes - 1 - i : i));
}

static void put_float(struct bytes *b, float value, bool big) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_bits(b, bits, 4, big);
}

static bool is_hole(int i) {
    return i % 7 == 3;
}
static float coordinate(int vertex, int axis) {
    return (float)(0.25 * vertex + 10 * axis + 0.001 * vertex * vertex);
}

/* kind: 0 ASCII, 1 little-endian, 2 big-endian. An unknown element and property must be skipped. */
static struct bytes make_file(int kind) {
    static const char *const names[] = {"ascii", "binary_little_endian", "binary_big_endian"};
    struct bytes b = {.size = 0};
    char text[512];
    int vertices = 0;
    for (int i = 0; i < ROWS * COLUMNS; i++)
        vertices += !is_hole(i);
    (void)snprintf(text, sizeof text,
                   "ply\nformat %s 1.0\ncomment made for a test\nobj_info num_cols %d\nobj_info "
                   "num_rows %d\nobj_info scale 0.5\nelement remark 1\nproperty list uchar short "
                   "text\nelement vertex %d\nproperty float x\nproperty float y\nproperty float "
                   "z\nproperty double extra\nproperty uchar intensity\nelement range_grid "
                   "%d\nproperty list uchar int vertex_indices\nend_header\n",
                   names[kind], COLUMNS, ROWS, vertices, ROWS * COLUMNS);
    put_text(&b, text);
    const bool big = kind == 2;
    if (kind == 0)
        put_text(&b, "3 7 8 9\n");
    else {
        put_bits(&b, 3, 1, big);
        for (uint64_t i = 7; i < 10; i++)
            put_bits(&b, i, 2, big);
    }
    for (int i = 0; i < vertices; i++) {
        if (kind == 0) {
            (void)snprintf(text, sizeof text, "%.9g %.9g %.9g 1.5 %d\n", (double)coordinate(i, 0),
                           (double)coordinate(i, 1), (double)coordinate(i, 2), i);
            put_text(&b, text);
            continue;
        }
        for (int axis = 0; axis < 3; axis++)
            put_float(&b, coordinate(i, axis), big);
        put_bits(&b, 0x3ff8000000000000u, 8, big);
        put_bits(&b, (uint64_t)i, 1, big);
    }
    int vertex = 0;
    for (int i = 0; i < ROWS * COLUMNS; i++) {
        const int n = !is_hole(i);
        if (kind == 0) {
            (void)snprintf(text, sizeof text, n ? "1 %d \n" : "0 \n", vertex);
            put_text(&b, text);
        } else {
            put_bits(&b, (uint64_t)n, 1, big);
            if (n)
                put_bits(&b, (uint64_t)vertex, 4, big);
        }
        vertex += n;
    }
    return b;
}

static void reads_all_three_encodings_alike(void **state) {
    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        const struct bytes b = make_file(kind);
        struct ply_grid grid;
        struct errctx err = {0};
        if (ply_grid_parse(b.data, b.size, &grid, &err))
            fail_msg("%d: %s", kind, err.text);
        assert_int_equal(grid.rows, ROWS);
        assert_int_equal(grid.columns, COLUMNS);
        int vertex = 0;
        for (int i = 0; i < ROWS * COLUMNS; i++) {
            assert_int_equal(grid.vertex[i], is_hole(i) ? -1 : vertex);
            if (is_hole(i))
                continue;
            assert_true((float)grid.p[vertex].x == coordinate(vertex, 0));
            assert_true((float)grid.p[vertex].z == coordinate(vertex, 2));
            assert_true(grid.intensity[vertex] == (float)vertex);
            vertex++;
        }
        assert_null(grid.rgb);
        ply_grid_destroy(&grid);
    }
}

static void samples_stay_where_they_were(void **state) {
    (void)state;
    const struct bytes b = make_file(1);
    struct ply_grid grid;
    struct scan scan;
    const struct ply_grid_options options = {.unit_m = 0.5, .up = FRAME_UP_Y};
    assert_int_equal(ply_grid_parse(b.data, b.size, &grid, NULL), ST_OK);
    assert_int_equal(ply_grid_to_scan(&grid, &options, &scan, NULL), ST_OK);
    assert_int_equal(scan.count, grid.vertex_count);
    for (size_t i = 0; i < scan.count; i++) {
        const struct vec3 p = vec3_add(scan.origin_m, sample_point(scan.samples + i));
        const struct vec3 f = grid.p[i];
        const struct vec3 truth = {0.5 * f.x, -0.5 * f.z, 0.5 * f.y};
        /* the range is a float: 6e-8 of the standoff */
        assert_true(vec3_norm(vec3_sub(p, truth)) < 1e-7 * (double)scan.samples[i].range_m);
    }
    scan_destroy(&scan);
    ply_grid_destroy(&grid);
}

static void refuses_a_file_cut_anywhere(void **state) {
    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        const struct bytes b = make_file(kind);
        for (size_t size = 0; size < b.size - 3; size += 5) {
            struct ply_grid grid = {0};
            struct errctx err = {0};
            const enum st st = ply_grid_parse(b.data, size, &grid, &err);
            assert_true(st == ST_FORMAT || st == ST_UNSUPPORTED);
            assert_true(strlen(err.text) > 5 && !strchr(err.text, '\n'));
        }
    }
}

static void refuses_nonsense_with_one_line(void **state) {
    (void)state;
#define HEAD "ply\nformat ascii 1.0\nobj_info num_cols 2\nobj_info num_rows 1\n"
#define XYZ  "property float x\nproperty float y\nproperty float z\n"
    static const struct {
        const char *text, *message;
    } cases[] = {
        {"plx\n", "not a PLY file"},
        {"ply\nformat ascii 2.0\nend_header\n", "line 2: not 'format KIND 1.0'"},
        {"ply\nformat utf8 1.0\nend_header\n", "line 2: this kind"},
        {"ply\nelement vertex -4\n", "line 2: not 'element"},
        {"ply\nproperty float x\n", "line 2: a property before"},
        {"ply\nelement vertex 1\nproperty quad x\n", "line 3: not 'property"},
        {"ply\nelement vertex 1\nproperty list float int x\n", "line 3: not 'property"},
        {"ply\nend_header\n", "no 'format'"},
        {HEAD "element vertex 1000000000\n" XYZ "end_header\n1 2 3\n", "cannot be in the"},
        {HEAD "element vertex 1\n" XYZ "end_header\n1 2 3\n", "no range_grid"},
        {HEAD "element vertex 1\nproperty float x\nend_header\n1\n", "with x, y and z"},
        {HEAD "element vertex 1\n" XYZ "element range_grid 3\nproperty list uchar int "
              "i\nend_header\n1 2 3\n0 0 0\n",
         "do not make 3 places"},
        {HEAD "element vertex 1\n" XYZ "element range_grid 2\nproperty list uchar int "
              "i\nend_header\n1 2 3\n1 7\n0\n",
         "names vertex 7 of 1"},
        {HEAD "element vertex 1\n" XYZ "element range_grid 2\nproperty list uchar int "
              "i\nend_header\n1 2 3\n1 -1\n0\n",
         "names no vertex"},
        {HEAD "element vertex 1\n" XYZ "element range_grid 2\nproperty list uchar int "
              "i\nend_header\n1 2 3\n2 0 0\n0\n",
         "list of one vertex"},
        {HEAD "element vertex 1\n" XYZ "element range_grid 2\nproperty list uchar int "
              "i\nend_header\n1 nan 3\n0\n0\n",
         "line 12"},
        {HEAD "element vertex 1\n" XYZ "element range_grid 2\nproperty list uchar int "
              "i\nend_header\n1 1e20 3\n0\n0\n",
         "absurdly large"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct ply_grid grid = {0};
        struct errctx err = {0};
        const enum st st = ply_grid_parse(cases[i].text, strlen(cases[i].text), &grid, &err);
        assert_true(st == ST_FORMAT || st == ST_UNSUPPORTED);
        if (!strstr(err.text, cases[i].message))
            fail_msg("case %zu: '%s' is not in '%s'", i, cases[i].message, err.text);
    }
}

static void a_conf_holds_the_inverse_rotation(void **state) {
    (void)state;
    const char *text =
        "camera 1 2 3  0 0 0 1\nmesh other.ply 9 9 9 0 0 0 1\nbmesh dir/a.ply 1 2 3 0 "
        "0 0.7071067811865476 0.7071067811865476\n";
    struct pose pose;
    struct errctx err = {0};
    if (ply_grid_conf_pose(text, strlen(text), "some/where/a.ply", &pose, &err))
        fail_msg("%s", err.text);
    /* the quaternion turns x to y, so the pose turns y to x */
    const struct vec3 p = pose_apply(&pose, vec3_make(0, 1, 0));
    assert_true(fabs(p.x - 2) < 1e-12 && fabs(p.y - 2) < 1e-12 && fabs(p.z - 3) < 1e-12);
    const struct ply_grid_options options = {.unit_m = 10, .up = FRAME_UP_Y};
    const struct pose station = ply_grid_station_pose(&pose, &options);
    assert_true(fabs(station.t_m.x - 10) < 1e-12 && fabs(station.t_m.y + 30) < 1e-12 &&
                fabs(station.t_m.z - 20) < 1e-12);
    assert_int_equal(ply_grid_conf_pose(text, strlen(text), "b.ply", &pose, &err), ST_NOT_FOUND);
}

static void conf_refusals_say_which_line(void **state) {
    (void)state;
    static const char *const texts[] = {"\nbmesh a.ply 1 2 3 0 0 0\n",
                                        "\nbmesh a.ply 1 2 3 0 0 0 0\n", "\nbmesh\n",
                                        "bmesh a.ply 1 2 3 0 0 0 1\nbmesh a.ply 1 2 3 "
                                        "0 0 0 1\n"};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        struct pose pose;
        struct errctx err = {0};
        assert_int_equal(ply_grid_conf_pose(texts[i], strlen(texts[i]), "a.ply", &pose, &err),
                         ST_FORMAT);
        assert_non_null(strstr(err.text, "line 2"));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(reads_all_three_encodings_alike),
        cmocka_unit_test(samples_stay_where_they_were),
        cmocka_unit_test(refuses_a_file_cut_anywhere),
        cmocka_unit_test(refuses_nonsense_with_one_line),
        cmocka_unit_test(a_conf_holds_the_inverse_rotation),
        cmocka_unit_test(conf_refusals_say_which_line),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
