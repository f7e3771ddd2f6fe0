/* What people give to the twin: parameters, faults, stands, meshes. Good ones are read, bad ones
 * refused with one clear line. */
#include "base/fileio.h"
#include "base/rig_yaml.h"
#include "twin/clocks.h"
#include "twin/faults.h"
#include "twin/mesh_load.h"
#include "twin/scene.h"
#include "twin/twin_config.h"

#include "tests/support/cmocka_all.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

static enum st load_config(const char *text, struct twin_config *config, struct errctx *err) {
    char path[64];
    (void)snprintf(path, sizeof path, "/tmp/twin_input_%d.yaml", (int)getpid());
    assert_int_equal(fileio_write(path, text, strlen(text), err), ST_OK);
    enum st st = twin_config_load(path, config, err);
    (void)unlink(path);
    return st;
}

static void a_parameter_file_changes_what_it_names_and_no_more(void **state) {
    (void)state;
    struct errctx err = {0};
    struct twin_config config = twin_config_default(), before = config;
    assert_int_equal(
        load_config("rig:\n  mirror_angle_deg: {true: 44.5}\nhead:\n  rays_per_sample: 2\n",
                    &config, &err),
        ST_OK);
    assert_true(config.value[TWIN_CONFIG_MIRROR_ANGLE].real == 44.5);
    assert_true(config.value[TWIN_CONFIG_MIRROR_ANGLE].nominal == 45);
    assert_true(config.value[TWIN_CONFIG_RAYS].real == 2);
    assert_true(config.value[TWIN_CONFIG_HORIZON].real == before.value[TWIN_CONFIG_HORIZON].real);
}

static void a_written_parameter_file_reads_back_the_same(void **state) {
    (void)state;
    static char text[32768];
    struct errctx err = {0};
    struct twin_config config = twin_config_default(), back = twin_config_ideal();
    FILE *file = fmemopen(text, sizeof text, "w");
    assert_non_null(file);
    assert_int_equal(twin_config_write(&config, file, &err), ST_OK);
    (void)fclose(file);
    assert_int_equal(load_config(text, &back, &err), ST_OK);
    for (int i = 0; i < TWIN_CONFIG_COUNT; i++)
        assert_true(back.value[i].real == config.value[i].real);
}

static void wrong_units_are_refused_with_key_and_bounds(void **state) {
    (void)state;
    struct errctx err = {0};
    struct twin_config config = twin_config_default();
    assert_int_equal(load_config("rig:\n  mirror_angle_deg: {true: 0.782}\n", &config, &err),
                     ST_FORMAT);
    assert_non_null(strstr(err.text, "mirror_angle_deg"));
    assert_int_equal(load_config("rig:\n  mirror_angle_rad: {true: 0.782}\n", &config, &err),
                     ST_FORMAT);
    assert_non_null(strstr(err.text, "mirror_angle_rad"));
    assert_int_equal(load_config("head:\n  max_range_m: 6000 mm\n", &config, &err), ST_FORMAT);
    assert_non_null(strstr(err.text, "max_range_m"));
    assert_int_equal(twin_config_set(&config, "mirror.speed_hz=240", &err), ST_INVALID);
    assert_int_equal(twin_config_set(&config, "mirror.speed=4", &err), ST_NOT_FOUND);
    assert_int_equal(twin_config_set(&config, "rig.mirror_angle_deg.nominal=44.9", &err), ST_OK);
    assert_true(config.value[TWIN_CONFIG_MIRROR_ANGLE].nominal == 44.9);
}

static void the_boards_file_holds_the_defaults(void **state) {
    (void)state;
    struct errctx err = {0};
    struct twin_config config = twin_config_ideal(), expected = twin_config_default();
    assert_int_equal(twin_config_load(SCANCART_SOURCE_DIR "/boards/twin/twin.yaml", &config, &err),
                     ST_OK);
    for (int i = 0; i < TWIN_CONFIG_COUNT; i++)
        assert_true(config.value[i].real == expected.value[i].real);
}

static void rig_and_camera_survive_their_yaml(void **state) {
    (void)state;
    struct errctx err = {0};
    struct twin_config config = twin_config_default();
    struct rig rig = twin_config_rig(&config, true), rig_back;
    struct rig_camera cam = twin_config_camera(&config, true), cam_back;
    char text[RIG_YAML_MAX_BYTES];
    assert_int_equal(rig_yaml_write(&rig, text, sizeof text), ST_OK);
    assert_int_equal(rig_yaml_read(text, strlen(text), "rig", &rig_back, &err), ST_OK);
    assert_memory_equal(&rig, &rig_back, sizeof rig);
    assert_int_equal(rig_yaml_write_camera(&cam, text, sizeof text), ST_OK);
    assert_int_equal(rig_yaml_read_camera(text, strlen(text), "camera", &cam_back, &err), ST_OK);
    assert_true(cam.camera.fx_px == cam_back.camera.fx_px && cam.camera.k1 == cam_back.camera.k1);
    for (int i = 0; i < 9; i++)
        assert_true(fabs(cam.head_from_cam.r.m[i] - cam_back.head_from_cam.r.m[i]) < 1e-12);
    assert_int_equal(rig_yaml_read("shaft_x: 1\n", 11, "rig", &rig_back, &err), ST_FORMAT);
}

static void distortion_moves_the_corners_by_30_px_at_1728_x_1152(void **state) {
    (void)state;
    struct twin_config config = twin_config_default();
    twin_config_set_quality(&config, TWIN_SURVEY);
    struct camera cam = twin_config_camera(&config, true).camera, pinhole = cam;
    assert_int_equal(cam.width_px * cam.height_px, 1728 * 1152);
    pinhole.k1 = pinhole.k2 = pinhole.p1 = pinhole.p2 = 0;
    struct vec3 corner = camera_pinhole_ray(&pinhole, 0, 0);
    struct vec2 q;
    assert_int_equal(camera_project(&cam, corner, &q, NULL), ST_OK);
    assert_true(fabs(sqrt(q.x * q.x + q.y * q.y) - 30) < 1.5);
}

static void faults_are_read_or_refused_with_a_reason(void **state) {
    (void)state;
    struct errctx err = {0};
    struct faults faults = {.count = 0};
    assert_int_equal(faults_parse(&faults, "mirror_stall@12+1.5", &err), ST_OK);
    assert_int_equal(faults_parse(&faults, "packet_lost@30=5", &err), ST_OK);
    assert_true(faults.list[0].duration_ns == 1500000000 && faults.list[1].value == 5);
    assert_non_null(faults_at(&faults, FAULTS_MIRROR_STALL, 13000000000, 1));
    assert_null(faults_at(&faults, FAULTS_MIRROR_STALL, 13500000000, 1));
    assert_int_equal(faults_parse(&faults, "mirror_stal@12", &err), ST_NOT_FOUND);
    assert_non_null(strstr(err.text, "mirror_stall"));
    assert_int_equal(faults_parse(&faults, "mirror_stall", &err), ST_FORMAT);
    assert_int_equal(faults_parse(&faults, "mirror_stall@1s", &err), ST_FORMAT);
    assert_int_equal(faults_parse(&faults, "mirror_stall@-1", &err), ST_INVALID);
    assert_int_equal(faults_parse(&faults, "mirror_surge@1+1=400", &err), ST_INVALID);
    assert_int_equal(faults.count, 2);
}

static void clocks_invert_and_jump(void **state) {
    (void)state;
    struct clocks_spec spec = {12.5, 30, 50, 0};
    struct clocks clock = clocks_make(&spec, 9);
    for (int64_t t = 0; t < 2000000000000; t += 77777777777) {
        int64_t back = clocks_when(&clock, clocks_show(&clock, t));
        assert_true(back - t <= 1 && t - back <= 1);
    }
    int64_t before = clocks_show(&clock, 5000000000);
    clocks_jump(&clock, 4000000000, 250000000);
    assert_true(clocks_show(&clock, 5000000000) == before + 250000000);
    assert_true(clocks_show(&clock, 3000000000) < 3000000000 + 12600000000);
}

static const char cube_obj[] = "# a tent\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 0.5 1\n"
                               "f 1 2 3 4\nf 1/1 2/2 5\nf -4//1 -3//1 -1//1\r\nf 3 4 5\nf 4 1 5\n";

static enum st load_mesh(const char *text, struct mesh *mesh, struct errctx *err) {
    memset(mesh, 0, sizeof *mesh);
    return mesh_load_bytes(text, strlen(text), "mesh", mesh, err);
}

static void obj_and_ply_meshes_are_read(void **state) {
    (void)state;
    struct errctx err = {0};
    struct mesh mesh;
    assert_int_equal(load_mesh(cube_obj, &mesh, &err), ST_OK);
    assert_int_equal(mesh.vertex_count, 5);
    assert_int_equal(mesh.triangle_count, 6);
    mesh_fini(&mesh);
    const char *ply =
        "ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty float "
        "y\nproperty float z\nproperty uchar red\nelement face 1\nproperty list uchar int "
        "vertex_indices\nend_header\n0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 0 9\n4 0 1 2 3\n";
    assert_int_equal(load_mesh(ply, &mesh, &err), ST_OK);
    assert_int_equal(mesh.triangle_count, 2);
    mesh_fini(&mesh);
}

/* Appends a value of `size` bytes in the wanted order of bytes. */
static void put(uint8_t *out, size_t *at, const void *value, size_t size, bool big) {
    for (size_t i = 0; i < size; i++)
        out[*at + i] = ((const uint8_t *)value)[big ? size - 1 - i : i];
    *at += size;
}

/* Two squares: doubles with a colour, indices of `wide` or 16 bits, a scalar before the list. */
static size_t binary_ply(uint8_t *out, bool big, bool wide) {
    int n = sprintf((char *)out,
                    "ply\nformat binary_%s_endian 1.0\nelement vertex 6\nproperty double x\n"
                    "property double y\nproperty double z\nproperty uchar red\nelement face 2\n"
                    "property short group\nproperty list uchar %s vertex_index\nend_header\n",
                    big ? "big" : "little", wide ? "uint" : "ushort");
    size_t at = (size_t)n;
    for (int i = 0; i < 6; i++) {
        double p[3] = {i % 3, i / 3, 0.25 * i};
        uint8_t red = 200;
        for (int k = 0; k < 3; k++)
            put(out, &at, &p[k], sizeof p[k], big);
        put(out, &at, &red, 1, big);
    }
    static const uint32_t face[2][4] = {{0, 1, 4, 3}, {1, 2, 5, 4}};
    for (int f = 0; f < 2; f++) {
        int16_t group = 7;
        uint8_t corners = 4;
        put(out, &at, &group, sizeof group, big);
        put(out, &at, &corners, 1, big);
        for (int k = 0; k < 4; k++) {
            uint16_t narrow = (uint16_t)face[f][k];
            put(out, &at, wide ? (const void *)&face[f][k] : &narrow, wide ? 4 : 2, big);
        }
    }
    return at;
}

static void binary_meshes_of_either_byte_order_are_the_same_and_never_read_beyond(void **state) {
    (void)state;
    static uint8_t bytes[1024];
    for (int kind = 0; kind < 4; kind++) {
        struct errctx err = {0};
        struct mesh mesh;
        memset(&mesh, 0, sizeof mesh);
        size_t size = binary_ply(bytes, kind & 1, kind & 2);
        if (mesh_load_bytes(bytes, size, "binary", &mesh, &err))
            fail_msg("kind %d: %s", kind, err.text);
        assert_int_equal(mesh.vertex_count, 6);
        assert_int_equal(mesh.triangle_count, 4);
        struct vec3 last = mesh_position(&mesh, 5);
        assert_true(last.x == 2 && last.y == 1 && last.z == 1.25);
        assert_int_equal(mesh.corner[11], 4);
        mesh_fini(&mesh);
        for (size_t cut = size - 1; cut > size - 100; cut--) { /* every shorter file is refused */
            memset(&mesh, 0, sizeof mesh);
            assert_int_not_equal(mesh_load_bytes(bytes, cut, "cut", &mesh, &err), ST_OK);
            assert_true(err.text[0] != 0);
        }
    }
}

static void bad_meshes_are_refused_with_a_reason(void **state) {
    (void)state;
    static const struct {
        const char *text, *says;
    } bad[] = {
        {"", "no triangles"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no triangles"},
        {"v 0 0 nan\n", "finite"},
        {"v 0 0 inf\n", "finite"},
        {"v 0 0\n", "three"},
        {"v 0 0 0\nf 1 2 3\n", "not there"},
        {"v 0 0 0\nf 1 1\n", "three"},
        {"ply\nformat ascii 1.0\nelement vertex 4\n", "header"},
        {"ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nproperty float "
         "y\nproperty "
         "float z\nend_header\n",
         "more than"},
        {"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty "
         "float "
         "z\nend_header\n0 nan 0\n",
         "finite"},
        {"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n",
         "x, y and z"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct errctx err = {0};
        struct mesh mesh;
        assert_int_not_equal(load_mesh(bad[i].text, &mesh, &err), ST_OK);
        if (!strstr(err.text, bad[i].says))
            fail_msg("case %zu says: %s", i, err.text);
        assert_null(mesh.position_m);
    }
}

static void stands_in_walls_and_unknown_scenes_are_refused(void **state) {
    (void)state;
    struct errctx err = {0};
    struct scene *scene = NULL;
    assert_int_equal(scene_create("cathedral", 1, 1, &scene, &err), ST_NOT_FOUND);
    assert_non_null(strstr(err.text, "heritage"));
    assert_int_equal(scene_create("room", 1, 1, &scene, &err), ST_OK);
    assert_int_equal(scene_check_place(scene, vec3_make(0, 0, 1.6), 0.3, &err), ST_OK);
    assert_int_equal(scene_check_place(scene, vec3_make(2.9, 0, 1.6), 0.3, &err), ST_INVALID);
    assert_non_null(strstr(err.text, "mm from a surface"));
    scene_destroy(scene);
}

static void every_scene_has_stands_where_a_cart_can_stand(void **state) {
    (void)state;
    static const char *const names[] = {"room",     "accident",   "heritage",
                                        "corridor", "open_field", "sphere"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        struct errctx err = {0};
        struct scene *scene = NULL;
        assert_int_equal(scene_create(names[i], 1, 0.1, &scene, &err), ST_OK);
        assert_true(scene->stand_count > 0);
        for (size_t k = 0; k < scene->stand_count; k++) {
            struct vec3 head_m = scene->stand[k].position_m;
            head_m.z += 1.6;
            if (scene_check_place(scene, head_m, 0.3, &err))
                fail_msg("%s, stand %s: %s", names[i], scene->stand[k].name, err.text);
        }
        scene_destroy(scene);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_parameter_file_changes_what_it_names_and_no_more),
        cmocka_unit_test(a_written_parameter_file_reads_back_the_same),
        cmocka_unit_test(wrong_units_are_refused_with_key_and_bounds),
        cmocka_unit_test(the_boards_file_holds_the_defaults),
        cmocka_unit_test(rig_and_camera_survive_their_yaml),
        cmocka_unit_test(distortion_moves_the_corners_by_30_px_at_1728_x_1152),
        cmocka_unit_test(faults_are_read_or_refused_with_a_reason),
        cmocka_unit_test(clocks_invert_and_jump),
        cmocka_unit_test(obj_and_ply_meshes_are_read),
        cmocka_unit_test(binary_meshes_of_either_byte_order_are_the_same_and_never_read_beyond),
        cmocka_unit_test(bad_meshes_are_refused_with_a_reason),
        cmocka_unit_test(stands_in_walls_and_unknown_scenes_are_refused),
        cmocka_unit_test(every_scene_has_stands_where_a_cart_can_stand),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
