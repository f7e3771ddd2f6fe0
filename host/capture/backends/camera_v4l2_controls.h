/* Locking the controls of a V4L2 camera. For camera_v4l2.c alone. */
#ifndef SC_CAPTURE_CAMERA_V4L2_CONTROLS_H
#define SC_CAPTURE_CAMERA_V4L2_CONTROLS_H

#include "device/camera_device.h"

#include <stdbool.h>
#include <stdint.h>

enum { CAMERA_V4L2_CONTROLS_MAX = 12 };

/* What was set, to see later whether it still holds. */
struct camera_v4l2_locked {
    uint32_t id[CAMERA_V4L2_CONTROLS_MAX];
    int32_t value[CAMERA_V4L2_CONTROLS_MAX];
    unsigned count;
};

/* Sets what is asked for and writes back what the device then has, NaN what it has not. Never
 * fails: a camera without a control is still a camera. */
void camera_v4l2_controls_lock(int fd, struct camera_settings *in_out_settings,
                               struct camera_v4l2_locked *out_locked);

/* True if all that was set is as it was; no control that was set: true. */
bool camera_v4l2_controls_hold(int fd, const struct camera_v4l2_locked *locked);

#endif
