/* The board file of a single-board computer (boards/NAME/board.yaml): where its devices are. */
#ifndef SC_CAPTURE_BOARD_CONFIG_H
#define SC_CAPTURE_BOARD_CONFIG_H

#include "base/st.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct board_controller {
    char *device; /* serial line: "/dev/scancart-controller" */
    uint32_t baud;
    char *parity; /* "none", "even", "odd" */
    uint8_t unit; /* Modbus address */
    uint16_t timeout_ms;
};

/* Lines of one GPIO chip, by name. NULL: not wired. */
struct board_gpio {
    char *chip;         /* label of the chip: "pinctrl-rp1" */
    char *mirror_index; /* rising edge at each turn of the mirror */
    char *estop, *interlock;
    char *strobe; /* camera strobe */
};

struct board_camera {
    char *device; /* "/dev/scancart-camera" */
};

/* The rangefinder head, by its USB descriptors. */
struct board_head {
    uint16_t usb_vendor, usb_product;
    char *serial; /* NULL: any */
};

struct board_config {
    char *name;
    struct board_controller controller;
    struct board_gpio gpio;
    struct board_camera camera;
    struct board_head head;
};

/* Loads a board file; what it leaves out has its default (115 200 baud, even parity, unit 1, 1000
 * ms), or NULL. Free with board_config_free(). ST_NOT_FOUND, ST_IO, ST_FORMAT with one line that
 * names file, line and key. */
ST_MUST_CHECK enum st board_config_load(const char *path, struct board_config **out_config,
                                        struct errctx *err);
void board_config_free(struct board_config *config); /* takes NULL */

#ifdef __cplusplus
}
#endif
#endif
