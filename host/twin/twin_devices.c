#include "twin/twin_devices.h"

#include "base/clock.h"
#include "twin/twin_world.h"

#include <stdlib.h>

/* ---- what the cart gives ---- */

static enum st take_packet(void *ctx, const struct cart_packet *packet, struct errctx *err) {
    (void)err;
    twin_head_packet(ctx, packet);
    return ST_OK;
}

static enum st take_edge(void *ctx, const struct cart_edge *edge, struct errctx *err) {
    (void)err;
    twin_lines_edge(ctx, edge);
    if (edge->line == CART_LINE_STROBE)
        twin_camera_strobe(ctx, edge);
    return ST_OK;
}

static enum st take_shot(void *ctx, const struct cart_shot *shot, struct errctx *err) {
    (void)err;
    const struct twin_devices *twin = ctx;
    twin->shot(twin->shot_ctx, shot);
    return ST_OK;
}

/* ---- life ---- */

static bool disk_full(void *ctx) {
    struct twin_devices *twin = ctx;
    if (twin_world_enter(twin, NULL))
        return false;
    bool full = cart_fault(twin->cart, FAULTS_DISK_FULL, 250000000) != NULL;
    twin_world_leave(twin);
    return full;
}

/* The host's clock is the real one: what the twin's would do to it is left out. */
static void take_real_clock(struct twin_devices *twin) {
    twin->config.value[TWIN_CONFIG_HOST_OFFSET].real = 0;
    twin->config.value[TWIN_CONFIG_HOST_DRIFT].real = 0;
    twin->config.value[TWIN_CONFIG_HOST_WANDER].real = 0;
    size_t kept = 0;
    for (size_t i = 0; i < twin->faults.count; i++)
        if (twin->faults.list[i].kind != FAULTS_CLOCK_JUMP)
            twin->faults.list[kept++] = twin->faults.list[i];
    twin->faults.count = kept;
}

static enum st open_lock(struct twin_devices *twin, struct errctx *err) {
    pthread_condattr_t attributes;
    if (pthread_mutex_init(&twin->lock, NULL))
        return errctx_set(err, ST_NOMEM, "twin: no lock");
    bool good = !pthread_condattr_init(&attributes) &&
                !pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC) &&
                !pthread_cond_init(&twin->news, &attributes);
    (void)pthread_condattr_destroy(&attributes);
    if (!good) {
        (void)pthread_mutex_destroy(&twin->lock);
        return errctx_set(err, ST_NOMEM, "twin: no condition variable");
    }
    twin->has_lock = true;
    return ST_OK;
}

/* The motor ends with the twin, not when a user closes it. */
static void close_nothing(struct motor *motor) {
    (void)motor;
}

static enum st open_motor(struct twin_devices *twin, struct errctx *err) {
    twin->hooks = (struct cart_hooks){.ctx = twin,
                                      .enter = twin_world_request_begins,
                                      .leave = twin_world_request_ends,
                                      .now_ns = twin_world_request_now};
    enum st st = cart_motor(twin->cart, &twin->hooks, &twin->motor, err);
    if (st)
        return st;
    twin->motor_inner_ops = twin->motor->ops;
    twin->motor_ops = *twin->motor->ops;
    twin->motor_ops.close = close_nothing;
    twin->motor->ops = &twin->motor_ops;
    return ST_OK;
}

static void *follow(void *ctx) {
    twin_world_follow(ctx);
    return NULL;
}

static enum st open_all(struct twin_devices *twin, struct errctx *err) {
    struct cart_sink sink = {.ctx = twin,
                             .packet = take_packet,
                             .edge = take_edge,
                             .shot = twin->shot ? take_shot : NULL};
    enum st st = open_lock(twin, err);
    if (!st)
        st = cart_create(twin->scene, &twin->config, &twin->faults, &twin->world_from_station,
                         twin->seed, &sink, &twin->cart, err);
    if (!st)
        st = open_motor(twin, err);
    twin->zero_ns = clock_now_ns();
    if (st || !twin->real_time)
        return st;
    if (pthread_create(&twin->thread, NULL, follow, twin))
        return errctx_set(err, ST_IO, "twin: no thread for real time");
    twin->has_thread = true;
    return ST_OK;
}

enum st twin_devices_open(const struct twin_devices_spec *spec, struct twin_devices **out_twin,
                          struct errctx *err) {
    struct twin_devices *twin = calloc(1, sizeof *twin);
    struct twin_world_transfer *transfer =
        twin ? calloc(TWIN_WORLD_TRANSFERS, sizeof *transfer) : NULL;
    if (!transfer) {
        free(twin);
        return errctx_set(err, ST_NOMEM, "twin: out of memory");
    }
    twin->head.transfer = transfer;
    twin->scene = spec->scene;
    twin->config = *spec->config;
    if (spec->faults)
        twin->faults = *spec->faults;
    twin->world_from_station = spec->world_from_station;
    twin->seed = spec->seed;
    twin->shot = spec->shot;
    twin->shot_ctx = spec->shot_ctx;
    twin->real_time = spec->real_time;
    if (spec->real_time)
        take_real_clock(twin);
    twin->hosttime = (struct hosttime){.ctx = twin,
                                       .now_ns = twin_world_time_now,
                                       .wait_until = twin_world_time_wait,
                                       .is_virtual = !spec->real_time};
    twin_head_init(twin);
    twin_lines_init(twin);
    twin_camera_init(twin);
    enum st st = open_all(twin, err);
    if (st) {
        twin_devices_close(twin);
        return st;
    }
    *out_twin = twin;
    return ST_OK;
}

struct cart_devices twin_devices_cart(struct twin_devices *twin) {
    return (struct cart_devices){.hosttime = &twin->hosttime,
                                 .motor = twin->motor,
                                 .head = &twin->head.head,
                                 .lines = &twin->lines.lines,
                                 .camera = &twin->camera.camera,
                                 .disk_full = disk_full,
                                 .ctx = twin};
}

const struct cart *twin_devices_truth(const struct twin_devices *twin) {
    return twin->cart;
}

void twin_devices_close(struct twin_devices *twin) {
    if (!twin)
        return;
    if (twin->has_thread) {
        (void)pthread_mutex_lock(&twin->lock);
        twin->stopping = true;
        (void)pthread_mutex_unlock(&twin->lock);
        (void)pthread_join(twin->thread, NULL);
    }
    if (twin->motor) {
        twin->motor->ops = twin->motor_inner_ops;
        motor_close(twin->motor);
    }
    cart_destroy(twin->cart);
    free(twin->camera.jpeg);
    free(twin->head.transfer);
    if (twin->has_lock) {
        (void)pthread_cond_destroy(&twin->news);
        (void)pthread_mutex_destroy(&twin->lock);
    }
    free(twin);
}
