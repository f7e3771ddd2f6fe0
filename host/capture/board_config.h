/* The board file of a single-board computer (boards/NAME/board.yaml): where its devices are. */
#ifndef SC_CAPTURE_BOARD_CONFIG_H
#define SC_CAPTURE_BOARD_CONFIG_H

#include "base/st.h"

#include <stdbool.h>
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

/* Lines of one GPIO chip, by name or by number. NULL: not wired. */
struct board_gpio {
    char *chip;         /* label of the chip "pinctrl-rp1", its name "gpiochip0", or a path */
    char *mirror_index; /* rising edge at each turn of the mirror */
    char *estop, *interlock;
    char *strobe; /* camera strobe */
    char *bias;   /* of all: "pull-down", "pull-up", "none"; NULL: as the chip has it */
};

struct board_camera {
    char *device; /* "/dev/scancart-camera" (V4L2), or libcamera's name of the camera */
    char *driver; /* "v4l2" (default) or "libcamera" */
};

/* The rangefinder head, by its USB descriptors. */
struct board_head {
    uint16_t usb_vendor, usb_product;
    char *serial; /* NULL: any */
};

/* A simulated cart instead of devices. */
struct board_twin {
    char *scene;   /* a name ("accident") or the path of a mesh */
    char *config;  /* path of the twin's parameters; NULL: its defaults */
    char **faults; /* [faults_count] as `scancart twin scan --fault` takes them */
    uint32_t faults_count;
    uint32_t seed;  /* of noise and chance; default 1 */
    bool real_time; /* follow the host's clock; else as fast as the machine can */
};

/* A recorded station instead of devices. */
struct board_replay {
    char *site;     /* path of the site folder */
    char *station;  /* name of the station; NULL: the first */
    bool real_time; /* with its own timing; else as fast as the machine can */
};

struct board_config {
    char *name;
    struct board_controller controller;
    struct board_gpio gpio;
    struct board_camera camera;
    struct board_head head;
    struct board_twin *twin;     /* NULL: none */
    struct board_replay *replay; /* NULL: none. With neither, the devices are real */
};

/* Loads a board: a file, or a folder with a board.yaml in it. What it leaves out has its default
 * (115 200 baud, even parity, unit 1, 1000 ms), or NULL. Relative paths of `twin` and `replay` are
 * made relative to the file's folder here. Free with board_config_free(). ST_NOT_FOUND, ST_IO,
 * ST_FORMAT with one line that names file, line and key. */
ST_MUST_CHECK enum st board_config_load(const char *path, struct board_config **out_config,
                                        struct errctx *err);
void board_config_free(struct board_config *config); /* takes NULL */

#ifdef __cplusplus
}
#endif
#endif
