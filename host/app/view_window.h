/* The viewer's window: SDL2 (X11, Wayland, KMSDRM), mouse, keyboard and touch. */
#ifndef SC_APP_VIEW_WINDOW_H
#define SC_APP_VIEW_WINDOW_H

#include "app/viewer.h"

struct view_window_options {
    int32_t width_px, height_px;
    bool fullscreen;
    const char *play; /* a file of input to play and pictures to save, then it ends; NULL: none */
};

/* Runs until the user quits. ST_UNSUPPORTED without a display. */
ST_MUST_CHECK enum st view_window_run(struct viewer *viewer,
                                      const struct view_window_options *options,
                                      struct errctx *err);

#endif
