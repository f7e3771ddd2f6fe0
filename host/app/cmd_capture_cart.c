#include "app/cmd_capture_cart.h"

#include "app/cmd_twin.h"
#include "base/fileio.h"
#include "base/rig_yaml.h"
#include "base/rng.h"
#include "capture/backends/board_open.h"
#include "site/calib.h"
#include "twin/twin_devices.h"
#include "twin/twin_scan.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;

struct twin_state {
    struct scene *scene;
    struct twin_config config;
    struct faults faults;
    uint64_t seed;
    struct twin_devices *devices;
};

/* ---- board ---- */

static enum st load_twin(const struct cmd_capture_options *o, struct cmd_capture_cart *cart,
                         struct errctx *err) {
    const struct board_twin *board = cart->board->twin;
    struct twin_state *t = cart->twin = calloc(1, sizeof *t);
    if (!t)
        return errctx_set(err, ST_NOMEM, "no memory for the simulated cart");
    t->config = twin_config_default();
    t->seed = o->seed >= 0 ? (uint64_t)o->seed : board->seed;
    enum st st = board->config ? twin_config_load(board->config, &t->config, err) : ST_OK;
    const char *q = o->quality ? o->quality : "field";
    if (!st)
        twin_config_set_quality(&t->config, !strcmp(q, "preview")  ? TWIN_PREVIEW
                                            : !strcmp(q, "survey") ? TWIN_SURVEY
                                                                   : TWIN_FIELD);
    for (size_t i = 0; o->set && o->set[i] && !st; i++)
        st = twin_config_set(&t->config, o->set[i], err);
    for (uint32_t i = 0; i < board->faults_count && !st; i++)
        st = faults_parse(&t->faults, board->faults[i], err);
    for (size_t i = 0; o->fault && o->fault[i] && !st; i++)
        st = faults_parse(&t->faults, o->fault[i], err);
    if (!st)
        st = cmd_twin_scene(board->scene ? board->scene : "accident", 1, 1, &t->scene, err);
    cart->sample_hz = twin_config_real(&t->config, TWIN_CONFIG_SAMPLE_RATE);
    cart->simulated = true;
    return st;
}

enum st cmd_capture_cart_load(const struct cmd_capture_options *options,
                              struct cmd_capture_cart *out_cart, struct errctx *err) {
    memset(out_cart, 0, sizeof *out_cart);
    enum st st = board_config_load(options->board, &out_cart->board, err);
    if (st)
        return st;
    out_cart->name = out_cart->board->name ? out_cart->board->name : "cart";
    if (out_cart->board->twin)
        return load_twin(options, out_cart, err);
    if (options->fault || options->set || options->seed >= 0)
        return errctx_set(err, ST_INVALID,
                          "--fault, --set and --seed are for a simulated cart; %s is none",
                          options->board);
    return ST_OK;
}

/* ---- where it stands ---- */

const char *cmd_capture_cart_stand(const struct cmd_capture_cart *cart, size_t number) {
    return cart->twin && number < cart->twin->scene->stand_count
               ? cart->twin->scene->stand[number].name
               : NULL;
}

/* The twin's stand of that name; the first for any other name. */
static size_t stand_number(const struct twin_state *t, const char *station) {
    for (size_t i = 0; i < t->scene->stand_count; i++)
        if (!strcmp(t->scene->stand[i].name, station))
            return i;
    return 0;
}

struct pose cmd_capture_cart_pose(const struct cmd_capture_cart *cart, const char *station) {
    const struct twin_state *t = cart->twin;
    struct pose pose = pose_identity();
    if (!t || !t->scene->stand_count)
        return pose;
    size_t number = stand_number(t, station);
    const struct scene_stand *stand = &t->scene->stand[number];
    struct rng rng = rng_stream(t->seed ^ 0xc3e4u, number);
    double sigma_m = twin_config_real(&t->config, TWIN_CONFIG_STAND_SIGMA);
    double sigma_rad = twin_config_real(&t->config, TWIN_CONFIG_STAND_YAW_SIGMA) * pi / 180;
    pose.t_m = stand->position_m;
    pose.t_m.x += sigma_m * rng_normal(&rng);
    pose.t_m.y += sigma_m * rng_normal(&rng);
    pose.t_m.z += t->config.value[TWIN_CONFIG_HEAD_HEIGHT].nominal;
    pose.r = so3_exp(vec3_make(0, 0, stand->yaw_rad + sigma_rad * rng_normal(&rng)));
    return pose;
}

/* ---- plan and calibration ---- */

void cmd_capture_cart_plan(const struct cmd_capture_cart *cart,
                           const struct cmd_capture_options *options, struct scan_plan *plan) {
    const struct twin_state *t = cart->twin;
    double tilt_deg = 0;
    struct errctx err;
    if (!t)
        return;
    plan->pan_steps_per_turn = t->config.value[TWIN_CONFIG_PAN_STEPS].nominal;
    plan->tilt_steps_per_turn = t->config.value[TWIN_CONFIG_TILT_STEPS].nominal;
    plan->mirror_hz = twin_config_real(&t->config, TWIN_CONFIG_MIRROR_HZ);
    plan->steps_per_revolution = twin_config_real(&t->config, TWIN_CONFIG_PAN_PER_REV);
    plan->camera.width_px = (uint32_t)twin_config_real(&t->config, TWIN_CONFIG_CAMERA_WIDTH);
    plan->camera.height_px = (uint32_t)twin_config_real(&t->config, TWIN_CONFIG_CAMERA_HEIGHT);
    scan_plan_set_range(plan, twin_config_real(&t->config, TWIN_CONFIG_PAN_FROM),
                        twin_config_real(&t->config, TWIN_CONFIG_PAN_TO));
    tilt_deg = twin_config_real(&t->config, TWIN_CONFIG_CAMERA_TILT);
    if (!options->tilt &&
        scan_plan_set_passes(plan, &tilt_deg, 1,
                             twin_config_real(&t->config, TWIN_CONFIG_CAMERA_STEP), &err))
        plan->pass_count = 0;
}

/* A record from a file, checked before it goes into the site. */
static enum st add_file(struct site *site, const char *kind, const char *path, const char *name,
                        int64_t *out_id, struct errctx *err) {
    uint8_t *bytes = NULL;
    size_t size = 0;
    struct rig rig;
    struct rig_camera camera;
    enum st st = fileio_read(path, CALIB_MAX_BYTES, &bytes, &size, err);
    if (st)
        return st;
    char *text = malloc(size + 1);
    if (!text) {
        free(bytes);
        return errctx_set(err, ST_NOMEM, "no memory for %s", path);
    }
    memcpy(text, bytes, size);
    text[size] = 0;
    st = !strcmp(kind, "rig") ? rig_yaml_read(text, size, path, &rig, err)
                              : rig_yaml_read_camera(text, size, path, &camera, err);
    if (!st)
        st = calib_add_yaml(site, kind, name, CALIB_NOMINAL, text, out_id, err);
    free(text);
    free(bytes);
    return st;
}

/* The size of the pictures that the camera's record is for. */
static enum st size_of_camera(struct site *site, int64_t *out_camera, struct scan_plan *plan,
                              struct errctx *err) {
    struct calib record;
    struct rig_camera camera;
    enum st st = calib_find(site, "camera", NULL, 0, &record, err);
    if (st == ST_NOT_FOUND)
        return ST_OK;
    char *text = st ? NULL : malloc(CALIB_MAX_BYTES + 1);
    if (!st && !text)
        st = errctx_set(err, ST_NOMEM, "no memory for a calibration");
    if (!st)
        st = calib_read(site, record.id, &record, text, CALIB_MAX_BYTES + 1, err);
    if (!st)
        st = rig_yaml_read_camera(text, record.size_bytes, record.name, &camera, err);
    free(text);
    if (st)
        return st;
    *out_camera = record.id;
    plan->camera.width_px = (uint32_t)camera.camera.width_px;
    plan->camera.height_px = (uint32_t)camera.camera.height_px;
    return ST_OK;
}

enum st cmd_capture_cart_calibrate(const struct cmd_capture_cart *cart,
                                   const struct cmd_capture_options *options, struct site *site,
                                   int64_t *out_camera, struct scan_plan *in_out_plan,
                                   struct errctx *err) {
    int64_t rig_id = 0;
    enum st st = ST_OK;
    *out_camera = 0;
    if (cart->twin)
        return twin_scan_calibrate(&cart->twin->config, site, out_camera, err);
    if (options->rig)
        st = add_file(site, "rig", options->rig, cart->name, &rig_id, err);
    if (!st && options->camera)
        st = add_file(site, "camera", options->camera, cart->name, out_camera, err);
    return st ? st : size_of_camera(site, out_camera, in_out_plan, err);
}

/* ---- devices ---- */

static enum st open_twin(struct twin_state *t, const char *station, bool real_time,
                         struct errctx *err) {
    size_t number = stand_number(t, station);
    if (!t->scene->stand_count)
        return errctx_set(err, ST_INVALID, "scene %s has no stand", t->scene->name);
    struct twin_devices_spec spec = {.scene = t->scene,
                                     .config = &t->config,
                                     .faults = &t->faults,
                                     .world_from_station = twin_scan_true_pose(
                                         &t->config, &t->scene->stand[number], t->seed, number),
                                     .seed = t->seed * 7919u + number,
                                     .real_time = real_time};
    return twin_devices_open(&spec, &t->devices, err);
}

enum st cmd_capture_cart_open(struct cmd_capture_cart *cart,
                              const struct cmd_capture_options *options, const char *station,
                              struct errctx *err) {
    if (cart->twin) {
        enum st st = open_twin(cart->twin, station, cart->board->twin->real_time, err);
        if (!st)
            cart->devices = twin_devices_cart(cart->twin->devices);
        return st;
    }
    struct board_open_options open = {.no_camera = options->no_photos};
    enum st st = board_open(cart->board, &open, &cart->open, err);
    if (!st)
        cart->devices = board_open_cart(cart->open);
    return st;
}

void cmd_capture_cart_close(struct cmd_capture_cart *cart) {
    if (cart->twin) {
        twin_devices_close(cart->twin->devices);
        scene_destroy(cart->twin->scene);
        free(cart->twin);
    }
    board_open_close(cart->open);
    board_config_free(cart->board);
    memset(cart, 0, sizeof *cart);
}
