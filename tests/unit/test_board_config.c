#include "capture/board_config.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/tempdir.h"

static char dir[TEMPDIR_MAX];

/* Writes board.yaml into the test's folder and loads `path` (of that folder; "": the folder). */
static enum st load(const char *text, const char *path, struct board_config **out_config,
                    struct errctx *err) {
    char name[TEMPDIR_MAX + 64];
    (void)snprintf(name, sizeof name, "%s/board.yaml", dir);
    FILE *file = fopen(name, "w");
    assert_non_null(file);
    assert_true(fputs(text, file) >= 0);
    assert_int_equal(fclose(file), 0);
    (void)snprintf(name, sizeof name, "%s%s", dir, path);
    *out_config = NULL;
    return board_config_load(name, out_config, err);
}

static void rejects(const char *text, const char *word) {
    struct board_config *config;
    struct errctx err = {0};
    assert_int_equal(load(text, "", &config, &err), ST_FORMAT);
    assert_null(config);
    if (!strstr(err.text, word))
        fail_msg("'%s' does not say '%s'", err.text, word);
}

static void a_folder_stands_for_the_board_in_it(void **state) {
    (void)state;
    struct board_config *config;
    struct errctx err = {0};
    assert_int_equal(load("name: here\n", "", &config, &err), ST_OK);
    assert_string_equal(config->name, "here");
    assert_null(config->twin);
    assert_null(config->replay);
    assert_int_equal(config->controller.baud, 115200);
    board_config_free(config);
    assert_int_equal(load("name: here\n", "/board.yaml", &config, &err), ST_OK);
    board_config_free(config);
    assert_int_equal(load("name: here\n", "/none.yaml", &config, &err), ST_NOT_FOUND);
    assert_non_null(strstr(err.text, "none.yaml"));
}

static void the_twins_paths_begin_at_the_board(void **state) {
    (void)state;
    struct board_config *config;
    struct errctx err = {0};
    char want[TEMPDIR_MAX + 64];
    assert_int_equal(load("twin:\n  scene: accident\n  config: twin.yaml\n  real_time: true\n"
                          "  faults: [mirror_stall@12+1.5, power_loss@30]\n",
                          "", &config, &err),
                     ST_OK);
    (void)snprintf(want, sizeof want, "%s/twin.yaml", dir);
    assert_string_equal(config->twin->config, want);
    assert_string_equal(config->twin->scene, "accident");
    assert_true(config->twin->real_time);
    assert_int_equal(config->twin->seed, 1);
    assert_int_equal(config->twin->faults_count, 2);
    assert_string_equal(config->twin->faults[1], "power_loss@30");
    board_config_free(config);
    assert_int_equal(load("twin: {scene: ./car.ply, config: /etc/t.yaml}\n", "", &config, &err),
                     ST_OK);
    assert_string_equal(config->twin->config, "/etc/t.yaml");
    (void)snprintf(want, sizeof want, "%s/./car.ply", dir);
    assert_string_equal(config->twin->scene, want);
    board_config_free(config);
}

static void a_recording_is_named_by_site_and_station(void **state) {
    (void)state;
    struct board_config *config;
    struct errctx err = {0};
    assert_int_equal(load("replay: {site: old, station: north}\n", "", &config, &err), ST_OK);
    char want[TEMPDIR_MAX + 64];
    (void)snprintf(want, sizeof want, "%s/old", dir);
    assert_string_equal(config->replay->site, want);
    assert_string_equal(config->replay->station, "north");
    assert_false(config->replay->real_time);
    board_config_free(config);
}

static void a_wrong_board_is_refused_with_line_and_key(void **state) {
    (void)state;
    rejects("twin: {}\n", "scene");
    rejects("twin: {scene: a, speed: 3}\n", "speed");
    rejects("twin: {scene: a, real_time: 2}\n", "real_time");
    rejects("twin: {scene: a}\nreplay: {site: b}\n", "board.yaml:2");
    rejects("camera: {driver: dshow}\n", "camera.driver");
    rejects("gpio: {bias: up}\n", "gpio.bias");
    rejects("controller: {parity: mark}\n", "controller.parity");
    rejects("head: {usb_vendor: 70000}\n", "usb_vendor");
}

static void the_shipped_boards_load(void **state) {
    (void)state;
    struct board_config *config = NULL;
    struct errctx err = {0};
    assert_int_equal(board_config_load(SCANCART_SOURCE_DIR "/boards/rpi5", &config, &err), ST_OK);
    assert_non_null(config->gpio.mirror_index);
    assert_int_equal(config->head.usb_vendor, 0x1209);
    board_config_free(config);
}

static int set_up(void **state) {
    (void)state;
    return !tempdir_make(dir);
}

static int tear_down(void **state) {
    (void)state;
    tempdir_remove(dir);
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_folder_stands_for_the_board_in_it),
        cmocka_unit_test(the_twins_paths_begin_at_the_board),
        cmocka_unit_test(a_recording_is_named_by_site_and_station),
        cmocka_unit_test(a_wrong_board_is_refused_with_line_and_key),
        cmocka_unit_test(the_shipped_boards_load),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
