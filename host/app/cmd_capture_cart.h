/* The cart that `scancart capture` drives: the devices of a board, or the twin; and what is known
 * of it beforehand (rig, camera, where it stands). */
#ifndef SC_APP_CMD_CAPTURE_CART_H
#define SC_APP_CMD_CAPTURE_CART_H

#include "base/pose.h"
#include "base/st.h"
#include "capture/board_config.h"
#include "capture/scan_plan.h"
#include "device/cart_devices.h"
#include "site/site.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct twin_devices;
struct board_open;
struct twin_state;

struct cmd_capture_options {
    char *board, *station, *at, *quality, *rig, *camera;
    const char **fault, **set, **tilt;
    double from_deg, to_deg, resolution_deg, mirror_hz, photo_step_deg; /* NaN: not given */
    long seed;                                                          /* < 0: the board's */
    int resume, keep_going, no_photos, plan_only;
    bool json;
};

struct cmd_capture_cart {
    struct board_config *board;
    struct cart_devices devices;
    const char *name; /* of the streams */
    double sample_hz; /* 0: ask the head */
    bool simulated;   /* the site's day is then fixed, so that runs can be compared */
    /* private */
    struct twin_state *twin;
    struct board_open *open;
};

/* Loads the board file, nothing more: what --board says. */
ST_MUST_CHECK enum st cmd_capture_cart_load(const struct cmd_capture_options *options,
                                            struct cmd_capture_cart *out_cart, struct errctx *err);

/* For a twin: the name of its `number`-th stand (NULL: it has no more). */
const char *cmd_capture_cart_stand(const struct cmd_capture_cart *cart, size_t number);

/* What the crew writes down of a station: the twin's stand of that name with the crew's error, else
 * the origin. */
struct pose cmd_capture_cart_pose(const struct cmd_capture_cart *cart, const char *station);

/* Puts the cart's own figures into a plan: steps a turn, mirror speed, photographs. */
void cmd_capture_cart_plan(const struct cmd_capture_cart *cart,
                           const struct cmd_capture_options *options, struct scan_plan *plan);

/* Adds the calibration records that the site lacks. *out_camera: the camera's record, 0 none;
 * in_out_plan gets the camera's size. */
ST_MUST_CHECK enum st cmd_capture_cart_calibrate(const struct cmd_capture_cart *cart,
                                                 const struct cmd_capture_options *options,
                                                 struct site *site, int64_t *out_camera,
                                                 struct scan_plan *in_out_plan, struct errctx *err);

/* Opens the devices; the twin stands at `station`. */
ST_MUST_CHECK enum st cmd_capture_cart_open(struct cmd_capture_cart *cart,
                                            const struct cmd_capture_options *options,
                                            const char *station, struct errctx *err);

void cmd_capture_cart_close(struct cmd_capture_cart *cart); /* takes a zeroed one */

#endif
