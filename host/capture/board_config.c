#include "capture/board_config.h"

#include "base/config.h"

#include <cyaml/cyaml.h>
#include <string.h>

enum { TEXT_MAX = 200 };

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
static const cyaml_schema_field_t gpio_fields[] = {
    TEXT("chip", board_gpio, chip),     TEXT("mirror_index", board_gpio, mirror_index),
    TEXT("estop", board_gpio, estop),   TEXT("interlock", board_gpio, interlock),
    TEXT("strobe", board_gpio, strobe), CYAML_FIELD_END};
static const cyaml_schema_field_t camera_fields[] = {TEXT("device", board_camera, device),
                                                     CYAML_FIELD_END};
static const cyaml_schema_field_t head_fields[] = {
    CYAML_FIELD_UINT("usb_vendor", CYAML_FLAG_OPTIONAL, struct board_head, usb_vendor),
    CYAML_FIELD_UINT("usb_product", CYAML_FLAG_OPTIONAL, struct board_head, usb_product),
    TEXT("serial", board_head, serial), CYAML_FIELD_END};
static const cyaml_schema_field_t top_fields[] = {
    TEXT("name", board_config, name),
    CYAML_FIELD_MAPPING("controller", CYAML_FLAG_OPTIONAL, struct board_config, controller,
                        controller_fields),
    CYAML_FIELD_MAPPING("gpio", CYAML_FLAG_OPTIONAL, struct board_config, gpio, gpio_fields),
    CYAML_FIELD_MAPPING("camera", CYAML_FLAG_OPTIONAL, struct board_config, camera, camera_fields),
    CYAML_FIELD_MAPPING("head", CYAML_FLAG_OPTIONAL, struct board_config, head, head_fields),
    CYAML_FIELD_END};
static const cyaml_schema_value_t top = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, struct board_config, top_fields)};
static const struct config_range ranges[] = {{"controller.baud", 1200, 4000000, "baud"},
                                             {"controller.unit", 1, 247, ""},
                                             {"controller.timeout_ms", 200, 60000, "ms"}};
static const struct config_schema schema = {&top, ranges, sizeof ranges / sizeof ranges[0]};

static void fill_defaults(struct board_controller *controller, const struct config *file) {
    if (!config_has(file, "controller.baud"))
        controller->baud = 115200;
    if (!config_has(file, "controller.unit"))
        controller->unit = 1;
    if (!config_has(file, "controller.timeout_ms"))
        controller->timeout_ms = 1000;
}

enum st board_config_load(const char *path, struct board_config **out_config, struct errctx *err) {
    void *value = NULL;
    struct config *file = NULL;
    enum st st = config_load(path, &schema, &value, &file, err);
    if (st)
        return st;
    struct board_config *config = value;
    fill_defaults(&config->controller, file);
    const char *parity = config->controller.parity;
    if (parity && strcmp(parity, "none") && strcmp(parity, "even") && strcmp(parity, "odd"))
        st = config_fail(file, err, "controller.parity", "'%s' is not none, even or odd", parity);
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
