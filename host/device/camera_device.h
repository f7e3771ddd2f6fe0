/* The colour camera as capture sees it: frames as they came, taken with locked exposure, gain,
 * focus and white balance. Backends: camera_v4l2, camera_libcamera, camera_replay (a recording),
 * the twin's. (The camera *model* is base/camera.h.)
 *
 * Threads: one thread at a time; not for the real-time path. Statuses as in device/head.h. */
#ifndef SC_DEVICE_CAMERA_DEVICE_H
#define SC_DEVICE_CAMERA_DEVICE_H

#include "base/st.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum camera_format {
    CAMERA_FORMAT_JPEG,  /* a whole JPEG file */
    CAMERA_FORMAT_RGB24, /* rows of R G B */
    CAMERA_FORMAT_YUYV,  /* rows of Y U Y V, BT.601, full range unless the device says else */
    CAMERA_FORMATS
};

/* What is asked for, and what the device then gave: values that a device cannot set come back as
 * NaN, a size as the nearest it has. */
struct camera_settings {
    uint32_t width_px, height_px;
    double exposure_s;      /* NaN: leave; else locked */
    double gain;            /* 1 is the sensor's lowest; NaN: leave */
    double focus_diopter;   /* 1/m, 0 is infinity; NaN: leave */
    double white_balance_k; /* colour temperature; NaN: leave */
};

struct camera_frame {
    const uint8_t *bytes; /* the camera's; valid until the next call */
    size_t size;
    uint32_t width_px, height_px, stride_bytes; /* stride 0 for JPEG */
    enum camera_format format;
    uint32_t seq;       /* of the device; gaps are lost frames */
    int64_t t_ns;       /* host time: start of exposure as the device stamps it */
    double t_sigma_ns;  /* how well that is known */
    double exposure_s;  /* as the device says; NaN unknown */
    double gain;        /* NaN unknown */
    bool settings_held; /* exposure, gain, focus and white balance are still those asked for */
};

struct camera_device_identity {
    char driver[32], product[64], serial[64];
};

struct camera_device;

struct camera_device_ops {
    /* Required. */
    enum st (*identify)(struct camera_device *camera, struct camera_device_identity *out_identity,
                        struct errctx *err);
    /* Required. Locks the settings; in_out: asked for, then given. Before start(). */
    enum st (*configure)(struct camera_device *camera, struct camera_settings *in_out_settings,
                         struct errctx *err);
    /* Required. */
    enum st (*start)(struct camera_device *camera, struct errctx *err);
    /* Required. The first whole frame whose exposure began at after_ns or later; frames before it
     * are thrown away. ST_TIMEOUT if there is none within timeout_ms. */
    enum st (*frame)(struct camera_device *camera, int64_t after_ns, unsigned timeout_ms,
                     struct camera_frame *out_frame, struct errctx *err);
    /* Required. */
    enum st (*stop)(struct camera_device *camera, struct errctx *err);
    /* Required. */
    void (*close)(struct camera_device *camera);
};

struct camera_device {
    const struct camera_device_ops *ops;
};

/* Calls close; takes NULL. */
static inline void camera_device_close(struct camera_device *camera) {
    if (camera)
        camera->ops->close(camera);
}

#ifdef __cplusplus
}
#endif
#endif
