/* The recorded frames of a station, in their order. JPEG as it was, other pictures as RGB. */
#include "base/image.h"
#include "base/picture.h"
#include "capture/backends/replay.h"
#include "site/files.h"
#include "site/frame_row.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct camera_replay {
    struct camera_device camera;
    struct replay *replay;
    struct site *site;
    struct frame_row next;
    bool has_next, running;
    uint32_t seq;
    uint8_t *bytes; /* of the frame that the caller looks at */
    struct image_u8 pixels;
};

static struct camera_replay *of(struct camera_device *camera) {
    return (struct camera_replay *)camera;
}

static enum st load_next(struct camera_replay *c, struct errctx *err) {
    size_t count = 0;
    int64_t after = c->has_next ? c->next.id : 0;
    enum st st = frame_row_list(c->site, c->replay->station_id, after, &c->next, 1, &count, err);
    c->has_next = !st && count;
    return st;
}

static int64_t start_ns(const struct frame_row *row) {
    return row->t_ns - (isfinite(row->exposure_s) ? (int64_t)(row->exposure_s * 5e8) : 0);
}

static enum st replay_identify(struct camera_device *camera,
                               struct camera_device_identity *out_identity, struct errctx *err) {
    (void)camera;
    (void)err;
    *out_identity = (struct camera_device_identity){.driver = "replay", .product = "recording"};
    return ST_OK;
}

static enum st replay_configure(struct camera_device *camera,
                                struct camera_settings *in_out_settings, struct errctx *err) {
    const struct camera_replay *c = of(camera);
    (void)err;
    in_out_settings->width_px = (uint32_t)c->next.width_px;
    in_out_settings->height_px = (uint32_t)c->next.height_px;
    in_out_settings->exposure_s = c->next.exposure_s;
    in_out_settings->gain = c->next.gain;
    in_out_settings->focus_diopter = in_out_settings->white_balance_k = (double)NAN;
    return ST_OK;
}

static enum st replay_start(struct camera_device *camera, struct errctx *err) {
    (void)err;
    of(camera)->running = true;
    return ST_OK;
}

static void drop(struct camera_replay *c) {
    free(c->bytes);
    c->bytes = NULL;
    image_u8_destroy(&c->pixels);
    c->pixels = (struct image_u8){.px = NULL};
}

static enum st read_frame(struct camera_replay *c, struct camera_frame *out_frame,
                          struct errctx *err) {
    const struct frame_row *row = &c->next;
    struct files_entry file;
    size_t size = 0;
    drop(c);
    enum st st = files_find(c->site, row->sha256, &file, err);
    if (!st)
        st = files_read(c->site, row->sha256, &c->bytes, &size, err);
    if (st)
        return st;
    struct camera_frame f = {.bytes = c->bytes,
                             .size = size,
                             .width_px = (uint32_t)row->width_px,
                             .height_px = (uint32_t)row->height_px,
                             .format = CAMERA_FORMAT_JPEG,
                             .seq = c->seq++,
                             .t_ns = start_ns(row),
                             .t_sigma_ns = 1e6,
                             .exposure_s = row->exposure_s,
                             .gain = row->gain,
                             .settings_held = !strstr(row->meta, "\"settings_held\": false")};
    if (strcmp(file.extension, "jpg")) {
        char path[FILEIO_PATH_MAX];
        st = files_path(c->site, row->sha256, path, err);
        if (!st)
            st = picture_read_rgb(path, &c->pixels, err);
        f.format = CAMERA_FORMAT_RGB24;
        f.bytes = c->pixels.px;
        f.stride_bytes = f.width_px * 3;
        f.size = (size_t)f.stride_bytes * f.height_px;
    }
    if (!st)
        *out_frame = f;
    return st;
}

static enum st replay_frame(struct camera_device *camera, int64_t after_ns, unsigned timeout_ms,
                            struct camera_frame *out_frame, struct errctx *err) {
    struct camera_replay *c = of(camera);
    enum st st = c->running ? ST_OK : errctx_set(err, ST_INVALID, "the camera does not run");
    while (!st && c->has_next && start_ns(&c->next) < after_ns)
        st = load_next(c, err);
    if (st)
        return st;
    int64_t end_ns = replay_now_ns(c->replay) + (int64_t)timeout_ms * 1000000;
    bool soon = c->has_next && c->next.t_ns <= end_ns;
    replay_wait_until(c->replay, soon ? c->next.t_ns : end_ns);
    if (!soon)
        return errctx_set(err, ST_TIMEOUT, "the recording has no frame there");
    st = read_frame(c, out_frame, err);
    return st ? st : load_next(c, err);
}

static enum st replay_stop(struct camera_device *camera, struct errctx *err) {
    (void)err;
    of(camera)->running = false;
    return ST_OK;
}

static void close_camera(struct camera_device *camera) {
    struct camera_replay *c = of(camera);
    drop(c);
    (void)site_close(c->site, NULL);
    free(c);
}

static const struct camera_device_ops replay_ops = {.identify = replay_identify,
                                                    .configure = replay_configure,
                                                    .start = replay_start,
                                                    .frame = replay_frame,
                                                    .stop = replay_stop,
                                                    .close = close_camera};

enum st camera_replay_open(struct replay *replay, struct camera_device **out_camera,
                           struct errctx *err) {
    struct camera_replay *c = calloc(1, sizeof *c);
    if (!c)
        return errctx_set(err, ST_NOMEM, "no memory for a recording");
    c->camera.ops = &replay_ops;
    c->replay = replay;
    enum st st = site_open(replay->site_path, SITE_READ, &c->site, err);
    if (!st)
        st = load_next(c, err);
    if (!st && !c->has_next)
        st = errctx_set(err, ST_NOT_FOUND, "the recording has no photograph");
    if (st)
        close_camera(&c->camera);
    else
        *out_camera = &c->camera;
    return st;
}
