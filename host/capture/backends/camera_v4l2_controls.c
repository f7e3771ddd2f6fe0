#include "capture/backends/camera_v4l2_controls.h"

#include <errno.h>
#include <linux/videodev2.h>
#include <math.h>
#include <string.h>
#include <sys/ioctl.h>

#define EXPOSURE_UNIT_S   1e-4 /* of V4L2_CID_EXPOSURE_ABSOLUTE */
#define FOCUS_MAX_DIOPTER 10.0 /* given to the control's largest value */

static int control(int fd, unsigned long request, uint32_t id, int32_t *in_out_value) {
    struct v4l2_ext_control one = {.id = id, .value = *in_out_value};
    struct v4l2_ext_controls all = {.which = V4L2_CTRL_WHICH_CUR_VAL, .count = 1, .controls = &one};
    int failed = ioctl(fd, request, &all);
    if (!failed)
        *in_out_value = one.value;
    return failed;
}

/* False if the device has no such control. */
static bool range_of(int fd, uint32_t id, struct v4l2_queryctrl *out_range) {
    memset(out_range, 0, sizeof *out_range);
    out_range->id = id;
    return !ioctl(fd, VIDIOC_QUERYCTRL, out_range) && !(out_range->flags & V4L2_CTRL_FLAG_DISABLED);
}

/* Sets and reads back; remembers it. False if the control is not there or refuses. */
static bool set(int fd, uint32_t id, int32_t value, struct camera_v4l2_locked *locked,
                int32_t *out_value) {
    struct v4l2_queryctrl range;
    if (!range_of(fd, id, &range) || range.flags & V4L2_CTRL_FLAG_READ_ONLY)
        return false;
    value = value < range.minimum ? range.minimum : value > range.maximum ? range.maximum : value;
    if (control(fd, VIDIOC_S_EXT_CTRLS, id, &value) || control(fd, VIDIOC_G_EXT_CTRLS, id, &value))
        return false;
    if (locked->count < CAMERA_V4L2_CONTROLS_MAX) {
        locked->id[locked->count] = id;
        locked->value[locked->count++] = value;
    }
    *out_value = value;
    return true;
}

/* The value of a control that is left as it is. */
static bool get(int fd, uint32_t id, int32_t *out_value) {
    struct v4l2_queryctrl range;
    *out_value = 0;
    return range_of(fd, id, &range) && !control(fd, VIDIOC_G_EXT_CTRLS, id, out_value);
}

/* One quantity: the automatic that must be off (0: none), the control, its scale
 * value = offset + scale * quantity. */
struct quantity {
    uint32_t automatic;
    int32_t manual; /* value of `automatic` that means by hand */
    uint32_t id;
    double offset, scale;
};

static double lock_one(int fd, const struct quantity *q, double wanted,
                       struct camera_v4l2_locked *locked) {
    int32_t value = 0;
    bool known;
    if (isnan(wanted)) {
        known = get(fd, q->id, &value);
    } else {
        if (q->automatic)
            (void)set(fd, q->automatic, q->manual, locked, &value); /* not there: nothing to lock */
        double raw = round(q->offset + q->scale * wanted);
        known = set(fd, q->id, (int32_t)fmax(fmin(raw, 2e9), -2e9), locked, &value);
    }
    return known ? ((double)value - q->offset) / q->scale : (double)NAN;
}

static struct quantity gain_of(int fd) {
    uint32_t id = V4L2_CID_ANALOGUE_GAIN;
    struct v4l2_queryctrl range;
    if (!range_of(fd, id, &range)) {
        id = V4L2_CID_GAIN;
        if (!range_of(fd, id, &range))
            range.minimum = 0;
    }
    struct quantity q = {.automatic = V4L2_CID_AUTOGAIN, .manual = 0, .id = id};
    q.scale = range.minimum > 0 ? range.minimum : 1.0;
    q.offset = range.minimum > 0 ? 0.0 : range.minimum - 1.0;
    return q;
}

static struct quantity focus_of(int fd) {
    struct v4l2_queryctrl range;
    struct quantity q = {
        .automatic = V4L2_CID_FOCUS_AUTO, .manual = 0, .id = V4L2_CID_FOCUS_ABSOLUTE, .scale = 1.0};
    if (range_of(fd, q.id, &range) && range.maximum > range.minimum) {
        q.offset = range.minimum;
        q.scale = ((double)range.maximum - range.minimum) / FOCUS_MAX_DIOPTER;
    }
    return q;
}

void camera_v4l2_controls_lock(int fd, struct camera_settings *in_out_settings,
                               struct camera_v4l2_locked *out_locked) {
    struct camera_settings *s = in_out_settings;
    const struct quantity exposure = {V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL,
                                      V4L2_CID_EXPOSURE_ABSOLUTE, 0, 1 / EXPOSURE_UNIT_S};
    const struct quantity white = {V4L2_CID_AUTO_WHITE_BALANCE, 0,
                                   V4L2_CID_WHITE_BALANCE_TEMPERATURE, 0, 1};
    struct quantity gain = gain_of(fd), focus = focus_of(fd);
    struct camera_v4l2_locked locked = {.count = 0};
    int32_t ignored;
    if (!isnan(s->exposure_s)) /* the frame rate must not stretch the exposure */
        (void)set(fd, V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0, &locked, &ignored);
    s->exposure_s = lock_one(fd, &exposure, s->exposure_s, &locked);
    s->gain = lock_one(fd, &gain, s->gain, &locked);
    s->focus_diopter = lock_one(fd, &focus, s->focus_diopter, &locked);
    s->white_balance_k = lock_one(fd, &white, s->white_balance_k, &locked);
    *out_locked = locked;
}

bool camera_v4l2_controls_hold(int fd, const struct camera_v4l2_locked *locked) {
    struct v4l2_ext_control one[CAMERA_V4L2_CONTROLS_MAX];
    struct v4l2_ext_controls all = {
        .which = V4L2_CTRL_WHICH_CUR_VAL, .count = locked->count, .controls = one};
    memset(one, 0, sizeof one);
    for (unsigned i = 0; i < locked->count; i++)
        one[i].id = locked->id[i];
    if (locked->count && ioctl(fd, VIDIOC_G_EXT_CTRLS, &all))
        return false;
    for (unsigned i = 0; i < locked->count; i++)
        if (one[i].value != locked->value[i])
            return false;
    return true;
}
