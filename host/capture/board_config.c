#include "capture/board_config.h"

#include "base/config.h"

#include <cyaml/cyaml.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { TEXT_MAX = 200, PATH_BYTES = 4096, FAULTS_AT_MOST = 64 };

#define TEXT(key, type, member)                                                                    \
    CYAML_FIELD_STRING_PTR(key, CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, struct type, member, 0,  \
                           TEXT_MAX)

static const cyaml_schema_field_t controller_fields[] = {
    TEXT("device", board_controller, device),
    CYAML_FIELD_UINT("baud", CYAML_FLAG_OPTIONAL, struct board_controller, baud),
    TEXT("parity", board_controller, parity),
    CYAML_FIELD_UINT("unit", CYAML_FLAG_OPTIONAL, struct board_controller, unit),
    CYAML_FIELD_UINT("timeout_ms", CYAML_FLAG_OPTIONAL, struct board_controller, timeout_ms),
    CYAML_FIELD_END};
static const cyaml_schema_field_t gpio_fields[] = {TEXT("chip", board_gpio, chip),
                                                   TEXT("mirror_index", board_gpio, mirror_index),
                                                   TEXT("estop", board_gpio, estop),
                                                   TEXT("interlock", board_gpio, interlock),
                                                   TEXT("strobe", board_gpio, strobe),
                                                   TEXT("bias", board_gpio, bias),
                                                   CYAML_FIELD_END};
static const cyaml_schema_field_t camera_fields[] = {
    TEXT("device", board_camera, device), TEXT("driver", board_camera, driver), CYAML_FIELD_END};
static const cyaml_schema_field_t head_fields[] = {
    CYAML_FIELD_UINT("usb_vendor", CYAML_FLAG_OPTIONAL, struct board_head, usb_vendor),
    CYAML_FIELD_UINT("usb_product", CYAML_FLAG_OPTIONAL, struct board_head, usb_product),
    TEXT("serial", board_head, serial), CYAML_FIELD_END};
static const cyaml_schema_value_t fault_text = {
    CYAML_VALUE_STRING(CYAML_FLAG_POINTER, char *, 0, TEXT_MAX)};
static const cyaml_schema_field_t twin_fields[] = {
    CYAML_FIELD_STRING_PTR("scene", CYAML_FLAG_POINTER, struct board_twin, scene, 0, TEXT_MAX),
    TEXT("config", board_twin, config),
    CYAML_FIELD_SEQUENCE("faults", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, struct board_twin,
                         faults, &fault_text, 0, FAULTS_AT_MOST),
    CYAML_FIELD_UINT("seed", CYAML_FLAG_OPTIONAL, struct board_twin, seed),
    CYAML_FIELD_BOOL("real_time", CYAML_FLAG_OPTIONAL, struct board_twin, real_time),
    CYAML_FIELD_END};
static const cyaml_schema_field_t replay_fields[] = {
    CYAML_FIELD_STRING_PTR("site", CYAML_FLAG_POINTER, struct board_replay, site, 0, TEXT_MAX),
    TEXT("station", board_replay, station),
    CYAML_FIELD_BOOL("real_time", CYAML_FLAG_OPTIONAL, struct board_replay, real_time),
    CYAML_FIELD_END};
static const cyaml_schema_field_t top_fields[] = {
    TEXT("name", board_config, name),
    CYAML_FIELD_MAPPING("controller", CYAML_FLAG_OPTIONAL, struct board_config, controller,
                        controller_fields),
    CYAML_FIELD_MAPPING("gpio", CYAML_FLAG_OPTIONAL, struct board_config, gpio, gpio_fields),
    CYAML_FIELD_MAPPING("camera", CYAML_FLAG_OPTIONAL, struct board_config, camera, camera_fields),
    CYAML_FIELD_MAPPING("head", CYAML_FLAG_OPTIONAL, struct board_config, head, head_fields),
    CYAML_FIELD_MAPPING_PTR("twin", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, struct board_config,
                            twin, twin_fields),
    CYAML_FIELD_MAPPING_PTR("replay", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, struct board_config,
                            replay, replay_fields),
    CYAML_FIELD_END};
static const cyaml_schema_value_t top = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, struct board_config, top_fields)};
static const struct config_range ranges[] = {{"controller.baud", 1200, 4000000, "baud"},
                                             {"controller.unit", 1, 247, ""},
                                             {"controller.timeout_ms", 200, 60000, "ms"}};
static const struct config_schema schema = {&top, ranges, sizeof ranges / sizeof ranges[0]};

static void fill_defaults(struct board_config *config, const struct config *file) {
    struct board_controller *controller = &config->controller;
    if (!config_has(file, "controller.baud"))
        controller->baud = 115200;
    if (!config_has(file, "controller.unit"))
        controller->unit = 1;
    if (!config_has(file, "controller.timeout_ms"))
        controller->timeout_ms = 1000;
    if (config->twin && !config_has(file, "twin.seed"))
        config->twin->seed = 1;
}

static bool one_of(const char *text, const char *const *words) {
    for (; text && *words; words++)
        if (!strcmp(text, *words))
            return true;
    return !text;
}

/* What the schema cannot say. */
static enum st check(const struct board_config *config, const struct config *file,
                     struct errctx *err) {
    static const char *const parities[] = {"none", "even", "odd", NULL};
    static const char *const drivers[] = {"v4l2", "libcamera", NULL};
    static const char *const biases[] = {"pull-down", "pull-up", "none", NULL};
    if (!one_of(config->controller.parity, parities))
        return config_fail(file, err, "controller.parity", "'%s' is not none, even or odd",
                           config->controller.parity);
    if (!one_of(config->camera.driver, drivers))
        return config_fail(file, err, "camera.driver", "'%s' is not v4l2 or libcamera",
                           config->camera.driver);
    if (!one_of(config->gpio.bias, biases))
        return config_fail(file, err, "gpio.bias", "'%s' is not pull-down, pull-up or none",
                           config->gpio.bias);
    if (config->twin && config->replay)
        return config_fail(file, err, "replay", "a board is either a twin or a recording");
    return ST_OK;
}

/* Makes a relative path one from the folder of the board's file. The text is freed by libcyaml,
 * with free(). */
static enum st rebase(const char *board_path, char **in_out_path, struct errctx *err) {
    const char *slash = strrchr(board_path, '/');
    if (!*in_out_path || **in_out_path == '/' || !slash)
        return ST_OK;
    size_t folder = (size_t)(slash - board_path) + 1, rest = strlen(*in_out_path) + 1;
    char *path = malloc(folder + rest);
    if (!path)
        return errctx_set(err, ST_NOMEM, "no memory for %s", board_path);
    memcpy(path, board_path, folder);
    memcpy(path + folder, *in_out_path, rest);
    free(*in_out_path);
    *in_out_path = path;
    return ST_OK;
}

static enum st rebase_all(const char *board_path, struct board_config *config, struct errctx *err) {
    enum st st = ST_OK;
    if (config->twin) {
        st = rebase(board_path, &config->twin->config, err);
        if (!st && config->twin->scene && strchr(config->twin->scene, '/'))
            st = rebase(board_path, &config->twin->scene, err);
    }
    if (!st && config->replay)
        st = rebase(board_path, &config->replay->site, err);
    return st;
}

/* A folder stands for the board.yaml in it. */
static enum st find_file(const char *path, char out_path[PATH_BYTES], struct errctx *err) {
    struct stat info;
    bool folder = !stat(path, &info) && S_ISDIR(info.st_mode);
    int n = snprintf(out_path, PATH_BYTES, folder ? "%s/board.yaml" : "%s", path);
    if (n < 0 || n >= PATH_BYTES)
        return errctx_set(err, ST_INVALID, "the path of the board is too long");
    return ST_OK;
}

enum st board_config_load(const char *path, struct board_config **out_config, struct errctx *err) {
    char file_path[PATH_BYTES];
    void *value = NULL;
    struct config *file = NULL;
    enum st st = find_file(path, file_path, err);
    if (!st)
        st = config_load(file_path, &schema, &value, &file, err);
    if (st)
        return st;
    struct board_config *config = value;
    fill_defaults(config, file);
    st = check(config, file, err);
    if (!st)
        st = rebase_all(file_path, config, err);
    config_destroy(file);
    if (st)
        board_config_free(config);
    else
        *out_config = config;
    return st;
}

void board_config_free(struct board_config *config) {
    config_free(&schema, config);
}
