/* The twin's camera behind the ops of device/camera_device.h: each strobe is an exposure; its
 * picture is computed when it is fetched. */
#include "twin/twin_world.h"

#include "base/picture.h"
#include "twin/camera_sim.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static const double base_exposure_s = 1.0 / 8; /* at factor 1, f/11 at night */
static const double read_out_s = 0.1;          /* after the exposure */
static const int64_t fault_ns = 250000000;     /* a fault without duration is on for this */
enum { JPEG_QUALITY = 95 };

static struct twin_world_camera *camera_of(struct camera_device *camera) {
    return (struct twin_world_camera *)camera;
}

static double value_of(const struct twin_devices *twin, enum faults_kind kind, double otherwise) {
    const struct fault *f = cart_fault(twin->cart, kind, fault_ns);
    return f ? f->value : otherwise;
}

void twin_camera_strobe(struct twin_devices *twin, const struct cart_edge *edge) {
    struct twin_world_camera *c = &twin->camera;
    uint32_t seq = c->strobes++;
    double factor = c->late;
    c->late = value_of(twin, FAULTS_EXPOSURE_LATE, 1);
    if (!c->started || cart_fault(twin->cart, FAULTS_FRAME_DROPPED, fault_ns))
        return;
    int slot = twin_world_put(&c->queue, TWIN_WORLD_EXPOSURES);
    if (slot < 0)
        return;
    c->exposure[slot] =
        (struct twin_world_exposure){.t_host_ns = twin_world_host_ns(twin, edge->t_host_ns),
                                     .seq = seq,
                                     .pan_rad = edge->state.pan_rad,
                                     .tilt_rad = edge->state.tilt_rad,
                                     .light = value_of(twin, FAULTS_LIGHT_CHANGE, 1),
                                     .factor = factor};
}

static enum st identify(struct camera_device *camera, struct camera_device_identity *out_identity,
                        struct errctx *err) {
    struct twin_devices *twin = camera_of(camera)->twin;
    enum st st = twin_world_enter(twin, err);
    if (st)
        return st;
    struct camera_device_identity id = {.driver = "twin", .product = "scancart twin camera"};
    (void)snprintf(id.serial, sizeof id.serial, "twin-%llu", (unsigned long long)twin->seed);
    *out_identity = id;
    twin_world_leave(twin);
    return ST_OK;
}

/* The size is the one that the parameters give it; focus and white balance are fixed. */
static enum st configure(struct camera_device *camera, struct camera_settings *in_out_settings,
                         struct errctx *err) {
    struct twin_world_camera *c = camera_of(camera);
    enum st st = twin_world_enter(c->twin, err);
    if (st)
        return st;
    struct camera_settings *s = in_out_settings;
    const struct twin_config *config = &c->twin->config;
    s->width_px = (uint32_t)twin_config_real(config, TWIN_CONFIG_CAMERA_WIDTH);
    s->height_px = (uint32_t)twin_config_real(config, TWIN_CONFIG_CAMERA_HEIGHT);
    s->exposure_s = s->exposure_s > 0 ? fmin(fmax(s->exposure_s, 1e-4), 4) : base_exposure_s;
    s->gain = s->gain > 0 ? fmin(fmax(s->gain, 1), 16) : 1;
    s->focus_diopter = (double)NAN;
    s->white_balance_k = (double)NAN;
    c->settings = *s;
    twin_world_leave(c->twin);
    return ST_OK;
}

static enum st start(struct camera_device *camera, struct errctx *err) {
    struct twin_world_camera *c = camera_of(camera);
    enum st st = twin_world_enter(c->twin, err);
    if (st)
        return st;
    c->queue.taken = c->queue.put;
    c->started = true;
    twin_world_leave(c->twin);
    return ST_OK;
}

/* The picture of an exposure, outside the lock: it takes a while. */
static enum st develop(struct twin_world_camera *c, const struct twin_world_exposure *e,
                       struct camera_frame *out_frame, struct errctx *err) {
    const struct twin_devices *twin = c->twin;
    double factor = e->factor * c->settings.exposure_s / base_exposure_s * c->settings.gain;
    struct camera_sim sim = camera_sim_on_cart(&twin->config, &twin->world_from_station, e->pan_rad,
                                               e->tilt_rad, twin->seed * 1000003u + e->seq);
    sim.exposure = factor;
    sim.light = e->light;
    struct image_u8 image = {.px = NULL};
    size_t size = 0;
    free(c->jpeg);
    c->jpeg = NULL;
    enum st st = camera_sim_render(twin->scene, &sim, &image, err);
    if (!st)
        st = picture_encode_jpeg(&image, JPEG_QUALITY, &c->jpeg, &size, err);
    if (!st)
        *out_frame = (struct camera_frame){.bytes = c->jpeg,
                                           .size = size,
                                           .width_px = (uint32_t)image.width_px,
                                           .height_px = (uint32_t)image.height_px,
                                           .format = CAMERA_FORMAT_JPEG,
                                           .seq = e->seq,
                                           .t_ns = e->t_host_ns,
                                           .t_sigma_ns = 1e5,
                                           .exposure_s = c->settings.exposure_s * e->factor,
                                           .gain = c->settings.gain,
                                           .settings_held = fabs(e->factor - 1) < 1e-9};
    image_u8_destroy(&image);
    return st;
}

/* The first exposure from after_ns on that has been read out; earlier ones are thrown away. */
static bool take(struct twin_world_camera *c, int64_t after_ns, struct twin_world_exposure *out) {
    while (c->queue.taken != c->queue.put) {
        struct twin_world_exposure e = c->exposure[c->queue.taken % TWIN_WORLD_EXPOSURES];
        double ready_s = c->settings.exposure_s * e.factor + read_out_s;
        if (e.t_host_ns >= after_ns) {
            if (twin_world_now_ns(c->twin) < e.t_host_ns + (int64_t)(ready_s * 1e9))
                return false;
            *out = e;
            c->queue.taken++;
            return true;
        }
        c->queue.taken++;
    }
    return false;
}

static enum st frame(struct camera_device *camera, int64_t after_ns, unsigned timeout_ms,
                     struct camera_frame *out_frame, struct errctx *err) {
    struct twin_world_camera *c = camera_of(camera);
    struct twin_world_exposure exposure;
    enum st st = twin_world_enter(c->twin, err);
    if (st)
        return st;
    int64_t until_ns = twin_world_now_ns(c->twin) + (int64_t)timeout_ms * 1000000;
    bool got = false;
    for (bool over = false; !(got = take(c, after_ns, &exposure)) && !over;) {
        st = twin_world_await(c->twin, until_ns, &over, err);
        if (st)
            return st;
    }
    twin_world_leave(c->twin);
    return got ? develop(c, &exposure, out_frame, err)
               : errctx_set(err, ST_TIMEOUT, "the simulated camera gave no frame in %u ms",
                            timeout_ms);
}

static enum st stop(struct camera_device *camera, struct errctx *err) {
    struct twin_world_camera *c = camera_of(camera);
    enum st st = twin_world_enter(c->twin, err);
    if (st)
        return st;
    c->started = false;
    twin_world_leave(c->twin);
    return ST_OK;
}

static void close_camera(struct camera_device *camera) {
    (void)camera; /* it ends with the twin */
}

static const struct camera_device_ops ops = {identify, configure, start, frame, stop, close_camera};

void twin_camera_init(struct twin_devices *twin) {
    twin->camera.camera.ops = &ops;
    twin->camera.twin = twin;
    twin->camera.late = 1;
    twin->camera.settings.exposure_s = base_exposure_s;
    twin->camera.settings.gain = 1;
}
