/* Opens the devices that a board file names: the real ones, or a recording's. (The twin's are
 * opened by the program: capture does not know the twin.) */
#ifndef SC_CAPTURE_BACKENDS_BOARD_OPEN_H
#define SC_CAPTURE_BACKENDS_BOARD_OPEN_H

#include "base/st.h"
#include "capture/board_config.h"
#include "device/cart_devices.h"

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

struct board_open_options {
    bool no_camera; /* leave it closed although the board has one */
    bool no_lines;
};

struct board_open;

/* Opens what the board has: the controller and the head must be named in it, lines and camera may
 * be. All or nothing: if one device fails, those opened before are closed, and the text names the
 * device. `options` may be NULL. ST_INVALID: the board is a twin, or leaves out the controller or
 * the head; else as the backends say. Opening asks nothing of the controller: identify() does. */
ST_MUST_CHECK enum st board_open(const struct board_config *config,
                                 const struct board_open_options *options,
                                 struct board_open **out_board, struct errctx *err);

/* The devices; valid until close. */
struct cart_devices board_open_cart(const struct board_open *board);

/* Takes NULL. */
void board_open_close(struct board_open *board);

#ifdef __cplusplus
}
#endif
#endif
