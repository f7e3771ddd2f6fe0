#include "capture/backends/camera_v4l2.h"

#include "base/clock.h"
#include "capture/backends/camera_v4l2_controls.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <math.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

enum { BUFFERS = 4, BUFFERS_MIN = 2, NO_BUFFER = -1 };

#define SOE_SIGMA_NS                                                                               \
    3e5 /* a start of exposure stamped by a USB driver: one 1 ms frame, uniform                    \
         */
#define UNIFORM 0.288675134594812882 /* 1 / sqrt(12) */

struct camera_v4l2 {
    struct camera_device camera;
    int fd;
    char device[256];
    struct camera_device_identity identity;
    struct camera_settings settings; /* as the device has them */
    struct camera_v4l2_locked locked;
    struct v4l2_pix_format format;
    double interval_s; /* between frames; NaN unknown */
    bool configured, streaming;
    uint8_t *buffer[BUFFERS];
    size_t buffer_bytes[BUFFERS];
    int held; /* buffer that the caller looks at */
};

static struct camera_v4l2 *of(struct camera_device *camera) {
    return (struct camera_v4l2 *)camera;
}

static int call(int fd, unsigned long request, void *argument) {
    int result;
    do
        result = ioctl(fd, request, argument);
    while (result < 0 && errno == EINTR);
    return result;
}

static enum st failed(const char *device, int error, const char *doing, struct errctx *err) {
    switch (error) {
    case ENOENT:
    case ENXIO:
        return errctx_set(err, ST_NOT_FOUND,
                          "no camera %s: plug it in, see `v4l2-ctl --list-devices`", device);
    case EACCES:
    case EPERM:
        return errctx_set(err, ST_PERMISSION,
                          "not allowed to open camera %s: install the udev rules of the board's "
                          "folder (boards/rpi5/70-scancart.rules) and add yourself to the group "
                          "scancart",
                          device);
    case ENODEV:
        return errctx_set(err, ST_DEVICE, "camera %s is gone while %s: has it been unplugged?",
                          device, doing);
    case EBUSY:
        return errctx_set(err, ST_BUSY, "camera %s is in use by another program", device);
    case ENOMEM:
        return errctx_set(err, ST_NOMEM, "no memory for the frames of camera %s", device);
    default:
        return errctx_set(err, ST_DEVICE, "camera %s failed while %s: %s", device, doing,
                          strerror(error));
    }
}

static enum st v4l2_identify(struct camera_device *camera,
                             struct camera_device_identity *out_identity, struct errctx *err) {
    (void)err;
    *out_identity = of(camera)->identity;
    return ST_OK;
}

/* --- settings --------------------------------------------------------------------------------- */

static const struct {
    uint32_t fourcc;
    enum camera_format format;
} formats[] = {/* the best first */
               {V4L2_PIX_FMT_MJPEG, CAMERA_FORMAT_JPEG},
               {V4L2_PIX_FMT_JPEG, CAMERA_FORMAT_JPEG},
               {V4L2_PIX_FMT_YUYV, CAMERA_FORMAT_YUYV},
               {V4L2_PIX_FMT_RGB24, CAMERA_FORMAT_RGB24}};
enum { FORMATS = sizeof formats / sizeof formats[0], ENUM_MAX = 256 };

static enum camera_format format_of(uint32_t fourcc) {
    for (int i = 0; i < FORMATS; i++)
        if (formats[i].fourcc == fourcc)
            return formats[i].format;
    return CAMERA_FORMATS;
}

/* The best format that the device has; 0: none that we know. */
static uint32_t best_format(int fd) {
    int best = FORMATS;
    for (uint32_t i = 0; i < ENUM_MAX; i++) {
        struct v4l2_fmtdesc d = {.index = i, .type = V4L2_BUF_TYPE_VIDEO_CAPTURE};
        if (call(fd, VIDIOC_ENUM_FMT, &d))
            break;
        for (int j = 0; j < best; j++)
            if (formats[j].fourcc == d.pixelformat)
                best = j;
    }
    return best < FORMATS ? formats[best].fourcc : 0;
}

static double frame_interval_s(int fd) {
    struct v4l2_streamparm parm = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};
    if (call(fd, VIDIOC_G_PARM, &parm) || !parm.parm.capture.timeperframe.denominator)
        return (double)NAN;
    return (double)parm.parm.capture.timeperframe.numerator /
           parm.parm.capture.timeperframe.denominator;
}

static enum st v4l2_configure(struct camera_device *camera, struct camera_settings *in_out_settings,
                              struct errctx *err) {
    struct camera_v4l2 *c = of(camera);
    if (c->streaming)
        return errctx_set(err, ST_INVALID, "the camera runs: stop it before it is set");
    struct v4l2_format f = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};
    f.fmt.pix.width = in_out_settings->width_px;
    f.fmt.pix.height = in_out_settings->height_px;
    f.fmt.pix.pixelformat = best_format(c->fd);
    f.fmt.pix.field = V4L2_FIELD_NONE;
    if (!f.fmt.pix.pixelformat)
        return errctx_set(err, ST_UNSUPPORTED, "camera %s gives neither JPEG nor YUYV nor RGB",
                          c->device);
    if (call(c->fd, VIDIOC_S_FMT, &f))
        return failed(c->device, errno, "being set", err);
    if (format_of(f.fmt.pix.pixelformat) == CAMERA_FORMATS || !f.fmt.pix.width ||
        !f.fmt.pix.height || f.fmt.pix.width > 65536 || f.fmt.pix.height > 65536)
        return errctx_set(err, ST_DEVICE, "camera %s answers with a format that was not asked for",
                          c->device);
    c->format = f.fmt.pix;
    in_out_settings->width_px = f.fmt.pix.width;
    in_out_settings->height_px = f.fmt.pix.height;
    camera_v4l2_controls_lock(c->fd, in_out_settings, &c->locked);
    c->settings = *in_out_settings;
    c->interval_s = frame_interval_s(c->fd);
    c->configured = true;
    return ST_OK;
}

/* --- streaming -------------------------------------------------------------------------------- */

static int queue(struct camera_v4l2 *c, int index) {
    struct v4l2_buffer b = {
        .type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP, .index = (uint32_t)index};
    return call(c->fd, VIDIOC_QBUF, &b);
}

static void unmap(struct camera_v4l2 *c) {
    for (int i = 0; i < BUFFERS; i++) {
        if (c->buffer[i])
            (void)munmap(c->buffer[i], c->buffer_bytes[i]);
        c->buffer[i] = NULL;
    }
    struct v4l2_requestbuffers none = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE,
                                       .memory = V4L2_MEMORY_MMAP};
    (void)call(c->fd, VIDIOC_REQBUFS, &none); /* gone with the file anyway */
}

static int map_buffer(struct camera_v4l2 *c, uint32_t index) {
    struct v4l2_buffer b = {
        .type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP, .index = index};
    if (call(c->fd, VIDIOC_QUERYBUF, &b))
        return -1;
    void *at = mmap(NULL, b.length, PROT_READ | PROT_WRITE, MAP_SHARED, c->fd, b.m.offset);
    if (at == MAP_FAILED)
        return -1;
    c->buffer[index] = at;
    c->buffer_bytes[index] = b.length;
    return queue(c, (int)index);
}

static enum st v4l2_start(struct camera_device *camera, struct errctx *err) {
    struct camera_v4l2 *c = of(camera);
    if (!c->configured || c->streaming)
        return errctx_set(err, ST_INVALID, "the camera %s",
                          c->streaming ? "runs already" : "must be set before it starts");
    struct v4l2_requestbuffers want = {
        .count = BUFFERS, .type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP};
    int bad = call(c->fd, VIDIOC_REQBUFS, &want);
    if (!bad && want.count < BUFFERS_MIN) {
        errno = ENOMEM;
        bad = -1;
    }
    for (uint32_t i = 0; !bad && i < want.count && i < BUFFERS; i++)
        bad = map_buffer(c, i);
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    if (!bad)
        bad = call(c->fd, VIDIOC_STREAMON, &type);
    if (bad) {
        enum st st = failed(c->device, errno, "starting", err);
        unmap(c);
        return st;
    }
    c->streaming = true;
    c->held = NO_BUFFER;
    return ST_OK;
}

/* When the exposure began, and how well that is known. */
static void time_frame(const struct camera_v4l2 *c, const struct v4l2_buffer *b,
                       struct camera_frame *out_frame) {
    double interval_s = isnan(c->interval_s) ? 0.1 : c->interval_s;
    double exposure_s = isnan(c->settings.exposure_s) ? interval_s / 2 : c->settings.exposure_s;
    bool start = (b->flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
    double before_s = start ? 0 : exposure_s + interval_s / 2; /* read-out ends the frame */
    double sigma_ns = start ? SOE_SIGMA_NS : interval_s * 1e9 * UNIFORM;
    int64_t stamp_ns = (int64_t)b->timestamp.tv_sec * 1000000000 + b->timestamp.tv_usec * 1000;
    if ((b->flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) != V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC) {
        stamp_ns = clock_now_ns(); /* some other clock: when it arrived is all that is known */
        before_s = exposure_s + interval_s;
        sigma_ns = interval_s * 1e9;
    }
    out_frame->t_ns = stamp_ns - (int64_t)llround(before_s * 1e9);
    out_frame->t_sigma_ns = sigma_ns;
}

/* A frame of a buffer; false if it is damaged. */
static bool describe(const struct camera_v4l2 *c, const struct v4l2_buffer *b,
                     struct camera_frame *out_frame) {
    enum camera_format format = format_of(c->format.pixelformat);
    const uint8_t *bytes = c->buffer[b->index];
    struct camera_frame f = {.bytes = bytes,
                             .size = b->bytesused,
                             .width_px = c->format.width,
                             .height_px = c->format.height,
                             .format = format,
                             .seq = b->sequence,
                             .exposure_s = c->settings.exposure_s,
                             .gain = c->settings.gain};
    if (b->flags & V4L2_BUF_FLAG_ERROR || b->bytesused > c->buffer_bytes[b->index])
        return false;
    if (format == CAMERA_FORMAT_JPEG) {
        if (f.size < 4 || bytes[0] != 0xff || bytes[1] != 0xd8)
            return false;
    } else {
        f.stride_bytes = c->format.bytesperline;
        if (f.size < (size_t)f.stride_bytes * f.height_px)
            return false;
    }
    time_frame(c, b, &f);
    *out_frame = f;
    return true;
}

/* Waits for a filled buffer until end_ns. */
static enum st wait_buffer(struct camera_v4l2 *c, int64_t end_ns, struct v4l2_buffer *out_buffer,
                           struct errctx *err) {
    for (;;) {
        *out_buffer =
            (struct v4l2_buffer){.type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP};
        if (!call(c->fd, VIDIOC_DQBUF, out_buffer))
            return ST_OK;
        if (errno != EAGAIN)
            return failed(c->device, errno, "waiting for a frame", err);
        int64_t left_ns = end_ns - clock_now_ns();
        if (left_ns <= 0)
            return errctx_set(err, ST_TIMEOUT, "no frame came from camera %s", c->device);
        struct pollfd file = {.fd = c->fd, .events = POLLIN};
        int ready = poll(&file, 1, (int)(left_ns / 1000000) + 1);
        if (ready > 0 && file.revents & (POLLERR | POLLHUP | POLLNVAL) && !(file.revents & POLLIN))
            return failed(c->device, ENODEV, "waiting for a frame", err);
    }
}

static enum st v4l2_frame(struct camera_device *camera, int64_t after_ns, unsigned timeout_ms,
                          struct camera_frame *out_frame, struct errctx *err) {
    struct camera_v4l2 *c = of(camera);
    if (!c->streaming)
        return errctx_set(err, ST_INVALID, "the camera does not run");
    int64_t end_ns = clock_now_ns() + (int64_t)timeout_ms * 1000000;
    for (;;) {
        if (c->held != NO_BUFFER && queue(c, c->held))
            return failed(c->device, errno, "taking frames", err);
        c->held = NO_BUFFER;
        struct v4l2_buffer b;
        enum st st = wait_buffer(c, end_ns, &b, err);
        if (st)
            return st;
        if (b.index >= BUFFERS || !c->buffer[b.index])
            return errctx_set(err, ST_DEVICE, "camera %s answers nonsense", c->device);
        c->held = (int)b.index;
        struct camera_frame frame;
        if (!describe(c, &b, &frame) || frame.t_ns < after_ns) {
            if (clock_now_ns() > end_ns)
                return errctx_set(err, ST_TIMEOUT, "no whole frame came from camera %s in time",
                                  c->device);
            continue;
        }
        frame.settings_held = camera_v4l2_controls_hold(c->fd, &c->locked);
        *out_frame = frame;
        return ST_OK;
    }
}

static enum st v4l2_stop(struct camera_device *camera, struct errctx *err) {
    struct camera_v4l2 *c = of(camera);
    if (!c->streaming)
        return ST_OK;
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    int bad = call(c->fd, VIDIOC_STREAMOFF, &type);
    int error = errno;
    unmap(c);
    c->streaming = false;
    c->held = NO_BUFFER;
    return bad ? failed(c->device, error, "stopping", err) : ST_OK;
}

static void v4l2_close(struct camera_device *camera) {
    struct camera_v4l2 *c = of(camera);
    (void)v4l2_stop(camera, NULL);
    if (c->fd >= 0)
        (void)close(c->fd);
    free(c);
}

static const struct camera_device_ops v4l2_ops = {.identify = v4l2_identify,
                                                  .configure = v4l2_configure,
                                                  .start = v4l2_start,
                                                  .frame = v4l2_frame,
                                                  .stop = v4l2_stop,
                                                  .close = v4l2_close};

static enum st look(struct camera_v4l2 *c, struct errctx *err) {
    struct v4l2_capability cap;
    memset(&cap, 0, sizeof cap);
    if (call(c->fd, VIDIOC_QUERYCAP, &cap))
        return errno == ENODEV ? failed(c->device, errno, "opening", err)
                               : errctx_set(err, ST_UNSUPPORTED, "%s is no camera", c->device);
    uint32_t can = cap.capabilities & V4L2_CAP_DEVICE_CAPS ? cap.device_caps : cap.capabilities;
    if (!(can & V4L2_CAP_VIDEO_CAPTURE) || !(can & V4L2_CAP_STREAMING))
        return errctx_set(err, ST_UNSUPPORTED,
                          "%s does not stream pictures: is it the camera's second node, or one for "
                          "libcamera (camera.driver)?",
                          c->device);
    memcpy(c->identity.driver, cap.driver, sizeof cap.driver);
    memcpy(c->identity.product, cap.card, sizeof cap.card);
    memcpy(c->identity.serial, cap.bus_info, sizeof cap.bus_info);
    c->identity.driver[sizeof c->identity.driver - 1] = 0; /* the others are longer than V4L2's */
    return ST_OK;
}

enum st camera_v4l2_open(const char *device, struct camera_device **out_camera,
                         struct errctx *err) {
    struct camera_v4l2 *c = calloc(1, sizeof *c);
    if (!c)
        return errctx_set(err, ST_NOMEM, "no memory for the camera");
    c->camera.ops = &v4l2_ops;
    c->held = NO_BUFFER;
    strncpy(c->device, device, sizeof c->device - 1);
    c->fd = open(device, O_RDWR | O_NONBLOCK | O_CLOEXEC);
    enum st st = c->fd < 0 ? failed(device, errno, "opening", err) : look(c, err);
    if (st)
        v4l2_close(&c->camera);
    else
        *out_camera = &c->camera;
    return st;
}
