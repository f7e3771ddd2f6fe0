#include "twin/twin_scan.h"

#include "base/fileio.h"
#include "base/picture.h"
#include "base/rig_yaml.h"
#include "base/sheet.h"
#include "site/calib.h"
#include "site/files.h"
#include "site/frame_row.h"
#include "site/station.h"
#include "twin/camera_sim.h"
#include "twin/twin_picture.h"
#include "twin/twin_record.h"
#include "twin/twin_truth.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;
static const double clearance_m = 0.3;    /* room that the head needs around it */
static const double run_up_deg = 1.5;     /* before and after a sweep: acceleration, play */
static const double settle_s = 0.3;       /* before a photograph */
static const double exposure_s = 1.0 / 8; /* of the camera, f/11 at night */

enum { MAX_FRAMES = 64, STEP_NS = 250000000 };

/* One stand under way. */
struct run {
    const struct twin_scan *scan;
    struct site *site;
    struct twin_scan_stand *out;
    struct cart *cart;
    struct twin_record record;
    struct twin_picture picture;
    struct image_u8 frame[MAX_FRAMES];
    size_t frames;
    FILE *samples; /* truth, one record a sample */
    int64_t station_id, calib_id;
    bool sweeping;
    double error_sum_m, error_sum2_m2, turns_from_rad, turns_to_rad;
    uint64_t errors;
};

static double real(const struct twin_scan *scan, enum twin_config_key key) {
    return twin_config_real(scan->config, key);
}

/* ---- what the cart sends ---- */

static bool fault_on(const struct run *r, enum faults_kind kind) {
    const struct faults *f = r->scan->faults;
    return f && faults_at(f, kind, cart_time_ns(r->cart), STEP_NS);
}

static enum st take_packet(void *ctx, const struct cart_packet *packet, struct errctx *err) {
    struct run *r = ctx;
    if (!r->sweeping)
        return ST_OK; /* nobody listens to the head before the sweep */
    r->out->packets++;
    r->out->bytes += packet->size;
    return twin_record_packet(&r->record, packet, err);
}

static enum st take_index(void *ctx, const struct idxevent *event, int64_t t_host_ns,
                          struct errctx *err) {
    struct run *r = ctx;
    r->out->index_events++;
    return twin_record_index(&r->record, event, t_host_ns, err);
}

static enum st take_edge(void *ctx, const struct cart_edge *edge, struct errctx *err) {
    struct run *r = ctx;
    return twin_record_edge(&r->record, edge, err);
}

static void count_shot(struct run *r, const struct cart_shot *shot) {
    struct twin_scan_stand *out = r->out;
    uint8_t flags = shot->reading.flags;
    out->samples++;
    out->no_returns += (flags & HEAD_SAMPLE_NO_RETURN) != 0;
    out->dropped += (flags & HEAD_SAMPLE_DROPPED) != 0;
    out->saturated += (flags & HEAD_SAMPLE_SATURATED) != 0;
    if (isnan(shot->range_m))
        return;
    out->returns++;
    out->mixed += shot->echo.mixed;
    double error_m = shot->reading.distance_m - shot->echo.distance_m;
    if (!(flags & HEAD_SAMPLE_SATURATED) && fabs(error_m) < 0.1) {
        r->error_sum_m += error_m;
        r->error_sum2_m2 += error_m * error_m;
        r->errors++;
    }
}

static enum st take_shot(void *ctx, const struct cart_shot *shot, struct errctx *err) {
    struct run *r = ctx;
    if (!r->sweeping)
        return ST_OK;
    if (!r->out->samples)
        r->turns_from_rad = shot->state.mirror_rad;
    r->turns_to_rad = shot->state.mirror_rad;
    count_shot(r, shot);
    if (r->picture.range_m)
        twin_picture_add(&r->picture, shot, &r->out->true_pose);
    if (!r->samples)
        return ST_OK;
    struct twin_truth_sample truth = twin_truth_of_shot(shot);
    uint8_t bytes[TWIN_TRUTH_SAMPLE_BYTES];
    twin_truth_encode(&truth, bytes);
    return fwrite(bytes, sizeof bytes, 1, r->samples) == 1
               ? ST_OK
               : errctx_set(err, ST_IO, "cannot write the truth of a sample: %s", strerror(errno));
}

/* ---- driving the cart ---- */

static enum st wait(struct run *r, double seconds, struct errctx *err) {
    int64_t end_ns = cart_time_ns(r->cart) + (int64_t)(seconds * 1e9);
    while (cart_time_ns(r->cart) < end_ns) {
        int64_t next_ns = cart_time_ns(r->cart) + STEP_NS;
        enum st st = cart_advance(r->cart, next_ns < end_ns ? next_ns : end_ns, err);
        if (st)
            return st;
        progress_add(r->scan->progress, STEP_NS / 1000000);
        r->record.disk_full = r->record.disk_full || fault_on(r, FAULTS_DISK_FULL);
    }
    return ST_OK;
}

/* Motor steps for a pan angle: the crew commands by the nominal figure. */
static double steps_of(const struct twin_scan *scan, double pan_deg) {
    return pan_deg / 360 * scan->config->value[TWIN_CONFIG_PAN_STEPS].nominal;
}

static enum st go(struct run *r, double pan_deg, struct errctx *err) {
    double rate = steps_of(r->scan, real(r->scan, TWIN_CONFIG_PAN_SLEW));
    cart_pan(r->cart, floor(steps_of(r->scan, pan_deg) + 0.5), rate, false);
    enum st st = wait(r, 0.05, err);
    while (!st && !cart_at_rest(r->cart))
        st = wait(r, 0.05, err);
    return st;
}

static enum st sweep(struct run *r, struct errctx *err) {
    const struct twin_scan *scan = r->scan;
    double from = real(scan, TWIN_CONFIG_PAN_FROM), to = real(scan, TWIN_CONFIG_PAN_TO);
    double hz = real(scan, TWIN_CONFIG_MIRROR_HZ);
    double rate = real(scan, TWIN_CONFIG_PAN_PER_REV) * hz;
    enum st st =
        go(r, from - run_up_deg - 2, err); /* so that the start is met in positive direction */
    if (!st)
        st = go(r, from - run_up_deg, err);
    cart_mirror(r->cart, hz);
    if (!st)
        st = wait(r, 5 * real(scan, TWIN_CONFIG_MIRROR_SPIN_UP) + 2 / hz, err);
    if (st)
        return st;
    cart_laser(r->cart, true);
    r->sweeping = true;
    int64_t start_ns = cart_time_ns(r->cart);
    cart_pan(r->cart, floor(steps_of(scan, to + run_up_deg) + 0.5), rate, true);
    st = wait(r, 0.25, err);
    while (!st && !cart_at_rest(r->cart))
        st = wait(r, 0.25, err);
    r->sweeping = false;
    r->out->sweep_s = (double)(cart_time_ns(r->cart) - start_ns) * 1e-9;
    cart_laser(r->cart, false);
    cart_mirror(r->cart, 0);
    return st ? st : wait(r, 1.0, err);
}

/* ---- photographs ---- */

static int frame_count(const struct twin_scan *scan) {
    int n = (int)ceil(360 / real(scan, TWIN_CONFIG_CAMERA_STEP) - 1e-6);
    return n < MAX_FRAMES ? n : MAX_FRAMES;
}

/* Cart ms that a frame stands for in the progress bar: about equal in computing time. */
static int64_t frame_weight_ms(const struct twin_scan *scan) {
    return (int64_t)(real(scan, TWIN_CONFIG_CAMERA_WIDTH) * real(scan, TWIN_CONFIG_CAMERA_HEIGHT) *
                     real(scan, TWIN_CONFIG_CAMERA_SAMPLES) * 0.03);
}

static enum st expose(struct run *r, double factor, uint64_t number, struct image_u8 *out_frame,
                      struct errctx *err) {
    const struct twin_scan *scan = r->scan;
    struct rig_camera real_camera = twin_config_camera(scan->config, true);
    struct mechanics_state s = cart_state(r->cart);
    struct pose station_from_cam = rig_camera_pose(&real_camera, s.tilt_rad, s.pan_rad);
    struct pose world_from_cam = pose_compose(&r->out->true_pose, &station_from_cam);
    struct camera_sim sim = camera_sim_at(&real_camera.camera, &world_from_cam);
    const struct fault *light =
        scan->faults ? faults_at(scan->faults, FAULTS_LIGHT_CHANGE, cart_time_ns(r->cart), STEP_NS)
                     : NULL;
    sim.rays = (int)(real(scan, TWIN_CONFIG_CAMERA_SAMPLES) + 0.5);
    sim.exposure = factor;
    sim.light = light ? light->value : 1;
    sim.vignetting = real(scan, TWIN_CONFIG_CAMERA_VIGNETTE);
    sim.noise = real(scan, TWIN_CONFIG_CAMERA_NOISE);
    sim.full_well = sim.noise > 0 ? real(scan, TWIN_CONFIG_CAMERA_WELL) : 0;
    sim.seed = scan->seed * 1000003u + (uint64_t)r->station_id * 4099u + number;
    return camera_sim_render(scan->scene, &sim, out_frame, err);
}

/* Stores a frame and its row. */
static enum st keep_frame(struct run *r, const struct image_u8 *frame, double factor,
                          double pan_deg, struct errctx *err) {
    struct frame_row row;
    memset(&row, 0, sizeof row);
    uint8_t *jpeg = NULL;
    size_t size = 0;
    enum st st = picture_encode_jpeg(frame, 95, &jpeg, &size, err);
    if (!st)
        st = files_put(r->site, FILES_FRAME, "jpg", jpeg, size, row.sha256, err);
    free(jpeg);
    if (st)
        return st;
    struct mechanics_state s = cart_state(r->cart);
    row.station_id = r->station_id;
    row.t_ns = cart_clock_ns(r->cart, TWIN_CLOCK_HOST);
    row.width_px = frame->width_px;
    row.height_px = frame->height_px;
    row.exposure_s = exposure_s * factor;
    row.gain = 1;
    row.pan_rad = pan_deg * pi / 180;
    row.tilt_rad = real(r->scan, TWIN_CONFIG_CAMERA_TILT) * pi / 180;
    row.camera_calib_id = r->calib_id;
    (void)snprintf(row.meta, sizeof row.meta, "{\"pan_steps\": %.0f, \"tilt_steps\": %.0f}",
                   s.pan_motor_steps, s.tilt_motor_steps);
    int64_t id = 0;
    return frame_row_add(r->site, &row, &id, err);
}

static enum st photograph(struct run *r, struct errctx *err) {
    const struct twin_scan *scan = r->scan;
    int count = frame_count(scan);
    double late = 1;
    double tilt = real(scan, TWIN_CONFIG_CAMERA_TILT) / 360 *
                  scan->config->value[TWIN_CONFIG_TILT_STEPS].nominal;
    cart_tilt(r->cart, floor(tilt + 0.5), 4000);
    enum st st = go(r, -180 - 0.5, err); /* every position is met in positive direction */
    for (int i = 0; i < count && !st; i++) {
        double pan_deg = -180 + 360.0 * (i + 0.5) / count;
        st = go(r, pan_deg, err);
        if (!st)
            st = wait(r, settle_s, err);
        if (st || fault_on(r, FAULTS_FRAME_DROPPED))
            continue;
        double factor = late;
        const struct fault *f = scan->faults ? faults_at(scan->faults, FAULTS_EXPOSURE_LATE,
                                                         cart_time_ns(r->cart), STEP_NS)
                                             : NULL;
        late = f ? f->value : 1;
        struct image_u8 frame = {.px = NULL};
        st = expose(r, factor, (uint64_t)i, &frame, err);
        if (!st)
            st = cart_strobe(r->cart, err);
        if (!st)
            st = keep_frame(r, &frame, factor, pan_deg, err);
        if (!st && r->scan->pictures_dir) {
            r->frame[r->frames++] = frame;
        } else {
            image_u8_destroy(&frame);
        }
        r->out->frames += !st;
        progress_add(scan->progress, frame_weight_ms(scan));
    }
    return st;
}

/* ---- pictures ---- */

static enum st write_picture(const struct run *r, const char *what, const struct image_u8 *image,
                             struct errctx *err) {
    char name[64], path[FILEIO_PATH_MAX];
    (void)snprintf(name, sizeof name, "%s-%s.png", r->out->name, what);
    enum st st = fileio_join(r->scan->pictures_dir, name, path, err);
    return st ? st : picture_write_png(path, image, err);
}

static enum st write_frames(const struct run *r, struct errctx *err) {
    static struct sheet_cell cell[MAX_FRAMES];
    static char caption[MAX_FRAMES][32];
    int count = frame_count(r->scan);
    for (size_t i = 0; i < r->frames; i++) {
        struct sheet_cell one = {.image = r->frame[i], .caption = caption[i]};
        (void)snprintf(caption[i], sizeof caption[i], "pan %.0f\xc2\xb0",
                       -180 + 360.0 * ((double)i + 0.5) / count);
        cell[i] = one;
    }
    char title[96];
    (void)snprintf(title, sizeof title, "%s, stand %s", r->scan->scene->name, r->out->name);
    struct sheet sheet = {.title = title,
                          .subtitle = "photographs of the simulated camera",
                          .cells = cell,
                          .cell_count = (int)r->frames,
                          .columns = r->frames < 5 ? (int)r->frames : 5,
                          .cell_width_px = 360};
    struct image_u8 image = {.px = NULL};
    enum st st = sheet_render(&sheet, &image, err);
    if (!st)
        st = write_picture(r, "camera", &image, err);
    image_u8_destroy(&image);
    return st;
}

static enum st write_pictures(const struct run *r, struct errctx *err) {
    static const char *const names[] = {"range", "intensity", "mixed"};
    enum st st = fileio_mkdirs(r->scan->pictures_dir, err);
    for (int i = 0; i < 3 && !st; i++) {
        struct image_u8 image = {.px = NULL};
        st = twin_picture_draw(&r->picture, (enum twin_picture_style)i, &image);
        if (st)
            return errctx_set(err, st, "pictures: out of memory");
        st = write_picture(r, names[i], &image, err);
        image_u8_destroy(&image);
    }
    return st || !r->frames ? st : write_frames(r, err);
}

/* ---- a stand ---- */

struct pose twin_scan_true_pose(const struct twin_config *config, const struct scene_stand *stand,
                                uint64_t seed, size_t number) {
    struct rng rng = rng_stream(seed ^ 0x57a2d5u, number);
    /* The floor is never quite the same: a third of the level's error differs from stand to stand.
     */
    double x = twin_config_real(config, TWIN_CONFIG_LEVEL_X) * 1e-3;
    double y = twin_config_real(config, TWIN_CONFIG_LEVEL_Y) * 1e-3;
    x *= 1 + 0.33 * rng_normal(&rng);
    y *= 1 + 0.33 * rng_normal(&rng);
    struct mat3 yaw = so3_exp(vec3_make(0, 0, stand->yaw_rad)), level = so3_exp(vec3_make(x, y, 0));
    struct pose pose = {mat3_mul(&yaw, &level), stand->position_m};
    pose.t_m.z += twin_config_real(config, TWIN_CONFIG_HEAD_HEIGHT);
    return pose;
}

/* What the crew wrote down: level, and off by the seed's guess. */
static struct station_pose crew_pose(const struct twin_scan *scan, const struct scene_stand *stand,
                                     size_t number) {
    struct rng rng = rng_stream(scan->seed ^ 0xc3e4u, number);
    double sigma_m = real(scan, TWIN_CONFIG_STAND_SIGMA);
    double sigma_rad = real(scan, TWIN_CONFIG_STAND_YAW_SIGMA) * pi / 180;
    struct station_pose p;
    memset(&p, 0, sizeof p);
    p.world_from_station.t_m = stand->position_m;
    p.world_from_station.t_m.x += sigma_m * rng_normal(&rng);
    p.world_from_station.t_m.y += sigma_m * rng_normal(&rng);
    p.world_from_station.t_m.z += scan->config->value[TWIN_CONFIG_HEAD_HEIGHT].nominal;
    p.world_from_station.r =
        so3_exp(vec3_make(0, 0, stand->yaw_rad + sigma_rad * rng_normal(&rng)));
    (void)snprintf(p.source, sizeof p.source, "nominal");
    return p;
}

static enum st add_station(struct run *r, const struct scene_stand *stand, size_t number,
                           struct errctx *err) {
    struct station_pose crew = crew_pose(r->scan, stand, number);
    r->out->nominal_pose = crew.world_from_station;
    enum st st = station_add(r->site, stand->name, NULL, &crew, &r->station_id, err);
    double rate = real(r->scan, TWIN_CONFIG_SAMPLE_RATE);
    return st ? st
              : twin_record_open(&r->record, r->site, r->station_id, (uint32_t)(1e9 / rate + 0.5),
                                 err);
}

static void summarise(struct run *r) {
    struct twin_scan_stand *out = r->out;
    double turns = (r->turns_to_rad - r->turns_from_rad) / (2 * pi);
    out->mirror_hz = out->sweep_s > 0 ? turns / out->sweep_s : 0;
    double rate = real(r->scan, TWIN_CONFIG_SAMPLE_RATE);
    out->samples_a_deg_mirror = out->mirror_hz > 0 ? rate / out->mirror_hz / 360 : 0;
    out->samples_a_deg_pan =
        real(r->scan, TWIN_CONFIG_PAN_STEPS) / 360 / real(r->scan, TWIN_CONFIG_PAN_PER_REV);
    if (!r->errors)
        return;
    double n = (double)r->errors, mean = r->error_sum_m / n;
    out->error_mean_m = mean;
    out->error_sigma_m = sqrt(fmax(0, r->error_sum2_m2 / n - mean * mean));
}

static enum st open_truth(struct run *r, struct errctx *err) {
    if (!r->scan->truth_dir || !r->scan->truth_samples)
        return ST_OK;
    char name[64], path[FILEIO_PATH_MAX];
    (void)snprintf(name, sizeof name, "samples-%s.bin", r->out->name);
    enum st st = fileio_mkdirs(r->scan->truth_dir, err);
    if (!st)
        st = fileio_join(r->scan->truth_dir, name, path, err);
    if (st)
        return st;
    r->samples = fopen(path, "wb");
    return r->samples ? ST_OK
                      : errctx_set(err, fileio_status(errno), "%s: %s", path, strerror(errno));
}

static enum st work(struct run *r, const struct scene_stand *stand, size_t number,
                    struct errctx *err) {
    const struct twin_scan *scan = r->scan;
    enum st st = scene_check_place(scan->scene, r->out->true_pose.t_m, clearance_m, err);
    if (st)
        return errctx_prefix(err, st, "stand %s", stand->name);
    st = add_station(r, stand, number, err);
    if (!st)
        st = open_truth(r, err);
    if (!st && scan->pictures_dir &&
        twin_picture_create(&r->picture, 2880, -50 * pi / 180, 90 * pi / 180))
        st = errctx_set(err, ST_NOMEM, "pictures: out of memory");
    struct cart_sink sink = {r, take_packet, take_index, take_edge, take_shot};
    struct twin_config config = *scan->config;
    /* One host for all stands: its clock goes on. */
    config.value[TWIN_CONFIG_HOST_OFFSET].real += 3600.0 * (double)number;
    if (!st)
        st = cart_create(scan->scene, &config, scan->faults, &r->out->true_pose,
                         scan->seed * 7919u + number, &sink, &r->cart, err);
    if (!st)
        st = sweep(r, err);
    if (!st && scan->frames)
        st = photograph(r, err);
    if (r->record.site && !r->record.disk_full && st != ST_CANCELLED) {
        struct errctx flush_err = {0};
        enum st flushed = twin_record_flush(&r->record, st ? &flush_err : err);
        st = st ? st : flushed;
    }
    summarise(r);
    if (!st && scan->pictures_dir)
        st = write_pictures(r, err);
    return st;
}

static enum st run_stand(const struct twin_scan *scan, struct site *site, size_t number,
                         int64_t calib_id, struct twin_scan_stand *out, struct errctx *err) {
    const struct scene_stand *stand = &scan->stands[number];
    struct run *r = calloc(1, sizeof *r);
    if (!r)
        return errctx_set(err, ST_NOMEM, "scan: out of memory");
    memset(out, 0, sizeof *out);
    memcpy(out->name, stand->name, sizeof out->name);
    out->true_pose = twin_scan_true_pose(scan->config, stand, scan->seed, number);
    r->scan = scan;
    r->site = site;
    r->out = out;
    r->calib_id = calib_id;
    enum st st = work(r, stand, number, err);
    if (r->samples && fclose(r->samples) && !st)
        st = errctx_set(err, ST_IO, "cannot write the truth of the samples: %s", strerror(errno));
    cart_destroy(r->cart);
    twin_record_fini(&r->record);
    twin_picture_destroy(&r->picture);
    for (size_t i = 0; i < r->frames; i++)
        image_u8_destroy(&r->frame[i]);
    free(r);
    return st;
}

/* Nominal and true calibration records; the nominal camera's is what frames refer to. */
static enum st add_calibration(const struct twin_scan *scan, struct site *site, int64_t *out_camera,
                               struct errctx *err) {
    enum st st = ST_OK;
    for (int truth = 1; truth >= 0 && !st; truth--) {
        char text[RIG_YAML_MAX_BYTES];
        struct rig rig = twin_config_rig(scan->config, truth);
        struct rig_camera camera = twin_config_camera(scan->config, truth);
        struct calib record;
        memset(&record, 0, sizeof record);
        record.status = truth ? CALIB_TRUE : CALIB_NOMINAL;
        record.format = CALIB_YAML;
        (void)snprintf(record.name, sizeof record.name, "twin");
        (void)snprintf(record.kind, sizeof record.kind, "rig");
        int64_t id = 0;
        st = rig_yaml_write(&rig, text, sizeof text);
        if (!st)
            st = calib_add(site, &record, text, strlen(text), &id, err);
        (void)snprintf(record.kind, sizeof record.kind, "camera");
        if (!st)
            st = rig_yaml_write_camera(&camera, text, sizeof text);
        if (!st)
            st = calib_add(site, &record, text, strlen(text), out_camera, err);
    }
    return st;
}

int64_t twin_scan_duration_ms(const struct twin_scan *scan) {
    double turn = scan->config->value[TWIN_CONFIG_PAN_STEPS].nominal;
    double sweep_deg =
        real(scan, TWIN_CONFIG_PAN_TO) - real(scan, TWIN_CONFIG_PAN_FROM) + 2 * run_up_deg;
    double rate = real(scan, TWIN_CONFIG_PAN_PER_REV) * real(scan, TWIN_CONFIG_MIRROR_HZ);
    double ms = 1000 * (sweep_deg / 360 * turn / rate + 25);
    int64_t frames = scan->frames ? frame_count(scan) : 0;
    return (int64_t)scan->stand_count * ((int64_t)ms + frames * (frame_weight_ms(scan) + 3500));
}

enum st twin_scan_run(const struct twin_scan *scan, struct site *site,
                      struct twin_scan_stand *out_stands, struct errctx *err) {
    int64_t camera_id = 0;
    enum st st = add_calibration(scan, site, &camera_id, err);
    for (size_t i = 0; i < scan->stand_count && !st; i++)
        st = run_stand(scan, site, i, camera_id, &out_stands[i], err);
    if ((st == ST_OK || st == ST_CANCELLED || st == ST_FULL) && scan->truth_dir) {
        struct errctx truth_err = {0};
        enum st truth = twin_truth_write(scan, scan->truth_dir, out_stands, &truth_err);
        if (!st && truth) {
            *err = truth_err;
            st = truth;
        }
    }
    return st;
}
