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
#include "twin/twin_drive.h"
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
    struct twin_drive drive;
    struct twin_record record;
    struct cart_edge strobe; /* the last one; seq + 1 of them came */
    uint32_t strobes;
    int64_t sweep_from_ns;
    struct twin_picture picture;
    struct image_u8 frame[MAX_FRAMES];
    size_t frames;
    FILE *samples; /* truth, one record a sample */
    int64_t station_id, calib_id;
    bool listening, sweeping;
    int64_t shown_ms; /* cart time that the progress bar has */
    double error_sum_m, error_sum2_m2, turned_rad, last_rad, panned_rad, last_pan_rad;
    uint64_t errors;
};

static double real(const struct twin_scan *scan, enum twin_config_key key) {
    return twin_config_real(scan->config, key);
}

/* ---- what the cart sends ---- */

static bool fault_on(const struct run *r, enum faults_kind kind) {
    return cart_fault(r->cart, kind, STEP_NS) != NULL;
}

static enum st take_packet(void *ctx, const struct cart_packet *packet, struct errctx *err) {
    struct run *r = ctx;
    if (!r->listening)
        return ST_OK; /* nobody listens to the head before the sweep */
    r->out->packets++;
    r->out->bytes += packet->size;
    return twin_record_packet(&r->record, packet, err);
}

static enum st take_event(void *ctx, const struct index_event *event, struct errctx *err) {
    struct run *r = ctx;
    r->out->index_events++;
    return twin_record_index(&r->record, event, cart_clock_ns(r->cart, TWIN_CLOCK_HOST), err);
}

static enum st take_edge(void *ctx, const struct cart_edge *edge, struct errctx *err) {
    struct run *r = ctx;
    if (edge->line == CART_LINE_STROBE) {
        r->strobe = *edge;
        r->strobes++;
    }
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
    if (!r->listening)
        return ST_OK;
    if (r->sweeping && r->last_rad > 0) {
        r->turned_rad += shot->state.mirror_rad - r->last_rad;
        r->panned_rad += fabs(shot->state.pan_rad - r->last_pan_rad);
    }
    r->last_rad = r->sweeping ? shot->state.mirror_rad : 0;
    r->last_pan_rad = shot->state.pan_rad;
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

static enum st time_passed(void *ctx, int64_t now_ns, struct errctx *err) {
    (void)err;
    struct run *r = ctx;
    progress_add(r->scan->progress, now_ns / 1000000 - r->shown_ms);
    r->shown_ms = now_ns / 1000000;
    r->record.disk_full = r->record.disk_full || fault_on(r, FAULTS_DISK_FULL);
    return ST_OK;
}

/* From the first sweep on all is kept, also what the head sends while the controller recovers from
 * a fault. */
static void note_sweeping(void *ctx, bool on) {
    struct run *r = ctx;
    int64_t now_ns = cart_time_ns(r->cart);
    if (on)
        r->sweep_from_ns = now_ns;
    else
        r->out->sweep_s += (double)(now_ns - r->sweep_from_ns) * 1e-9;
    r->listening = true;
    r->sweeping = on;
}

/* Motor steps for an angle: the crew commands by the nominal figure. */
static int32_t steps_of(const struct twin_scan *scan, enum twin_config_key turn, double deg) {
    return (int32_t)floor(deg / 360 * scan->config->value[turn].nominal + 0.5);
}

static enum st sweep(struct run *r, struct errctx *err) {
    const struct twin_scan *scan = r->scan;
    double from = real(scan, TWIN_CONFIG_PAN_FROM), to = real(scan, TWIN_CONFIG_PAN_TO);
    double way = to >= from ? 1 : -1;
    struct motor_scan program = {
        .from_steps = steps_of(scan, TWIN_CONFIG_PAN_STEPS, from - way * run_up_deg),
        .to_steps = steps_of(scan, TWIN_CONFIG_PAN_STEPS, to + way * run_up_deg),
        .rate = real(scan, TWIN_CONFIG_PAN_PER_REV) * real(scan, TWIN_CONFIG_MIRROR_HZ)};
    int32_t overlap = steps_of(scan, TWIN_CONFIG_PAN_STEPS, run_up_deg);
    enum st st = twin_drive_sweep(&r->drive, &program, overlap, err);
    r->listening = false;
    return st;
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

/* What the camera saw at the strobe. */
static enum st expose(struct run *r, double factor, uint64_t number, struct image_u8 *out_frame,
                      struct errctx *err) {
    const struct twin_scan *scan = r->scan;
    const struct fault *light = cart_fault(r->cart, FAULTS_LIGHT_CHANGE, STEP_NS);
    uint64_t seed = scan->seed * 1000003u + (uint64_t)r->station_id * 4099u + number;
    struct camera_sim sim = camera_sim_on_cart(
        scan->config, &r->out->true_pose, r->strobe.state.pan_rad, r->strobe.state.tilt_rad, seed);
    sim.exposure = factor;
    sim.light = light ? light->value : 1;
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
    row.station_id = r->station_id;
    row.t_ns = r->strobe.t_host_ns;
    row.width_px = frame->width_px;
    row.height_px = frame->height_px;
    row.exposure_s = exposure_s * factor;
    row.gain = 1;
    row.pan_rad = pan_deg * pi / 180;
    row.tilt_rad = real(r->scan, TWIN_CONFIG_CAMERA_TILT) * pi / 180;
    row.camera_calib_id = r->calib_id;
    (void)snprintf(row.meta, sizeof row.meta, "{\"pan_steps\": %d, \"tilt_steps\": %d}",
                   (int)r->drive.status.axis[MOTOR_PAN].steps,
                   (int)r->drive.status.axis[MOTOR_TILT].steps);
    int64_t id = 0;
    return frame_row_add(r->site, &row, &id, err);
}

/* One photograph at a position. *late: factor of the exposure that is set only for the next one. */
static enum st photograph_at(struct run *r, double pan_deg, int number, double *late,
                             struct errctx *err) {
    const struct twin_scan *scan = r->scan;
    double tilt_deg = real(scan, TWIN_CONFIG_CAMERA_TILT), factor = *late;
    uint32_t strobes = r->strobes;
    enum st st = twin_drive_move(&r->drive, steps_of(scan, TWIN_CONFIG_PAN_STEPS, pan_deg),
                                 steps_of(scan, TWIN_CONFIG_TILT_STEPS, tilt_deg), err);
    if (!st)
        st = twin_drive_wait(&r->drive, settle_s, err);
    if (!st)
        st = twin_drive_trigger(&r->drive, err);
    if (st || r->strobes == strobes || fault_on(r, FAULTS_FRAME_DROPPED))
        return st;
    const struct fault *f = cart_fault(r->cart, FAULTS_EXPOSURE_LATE, STEP_NS);
    *late = f ? f->value : 1;
    struct image_u8 frame = {.px = NULL};
    st = expose(r, factor, (uint64_t)number, &frame, err);
    if (!st)
        st = keep_frame(r, &frame, factor, pan_deg, err);
    if (!st && scan->pictures_dir)
        r->frame[r->frames++] = frame;
    else
        image_u8_destroy(&frame);
    r->out->frames += !st;
    progress_add(scan->progress, frame_weight_ms(scan));
    return st;
}

static enum st photograph(struct run *r, struct errctx *err) {
    int count = frame_count(r->scan);
    double late = 1;
    enum st st = ST_OK;
    for (int i = 0; i < count && !st; i++)
        st = photograph_at(r, -180 + 360.0 * (i + 0.5) / count, i, &late, err);
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
    double turns = r->turned_rad / (2 * pi);
    out->mirror_hz = out->sweep_s > 0 ? turns / out->sweep_s : 0;
    double rate = real(r->scan, TWIN_CONFIG_SAMPLE_RATE);
    out->samples_a_deg_mirror = out->mirror_hz > 0 ? rate / out->mirror_hz / 360 : 0;
    out->samples_a_deg_pan = r->panned_rad > 0 ? turns / (r->panned_rad * 180 / pi) : 0;
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
    struct cart_sink sink = {r, take_packet, NULL, take_edge, take_shot};
    struct twin_config config = *scan->config;
    /* One host for all stands: its clock goes on. */
    config.value[TWIN_CONFIG_HOST_OFFSET].real += 3600.0 * (double)number;
    if (!st)
        st = cart_create(scan->scene, &config, scan->faults, &r->out->true_pose,
                         scan->seed * 7919u + number, &sink, &r->cart, err);
    r->drive = (struct twin_drive){.cart = r->cart,
                                   .mirror_rps = real(scan, TWIN_CONFIG_MIRROR_HZ),
                                   .ctx = r,
                                   .event = take_event,
                                   .passed = time_passed,
                                   .sweeping = note_sweeping};
    if (!st)
        st = twin_drive_open(&r->drive, err);
    if (!st)
        st = sweep(r, err);
    if (!st && scan->frames)
        st = photograph(r, err);
    if (r->record.site && st != ST_CANCELLED && st != ST_FULL) {
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
    twin_drive_close(&r->drive);
    cart_destroy(r->cart);
    twin_record_fini(&r->record);
    twin_picture_destroy(&r->picture);
    for (size_t i = 0; i < r->frames; i++)
        image_u8_destroy(&r->frame[i]);
    free(r);
    return st;
}

enum st twin_scan_calibrate(const struct twin_config *config, struct site *site,
                            int64_t *out_camera, struct errctx *err) {
    enum st st = ST_OK;
    for (int truth = 1; truth >= 0 && !st; truth--) {
        char text[RIG_YAML_MAX_BYTES];
        struct rig rig = twin_config_rig(config, truth);
        struct rig_camera camera = twin_config_camera(config, truth);
        enum calib_status status = truth ? CALIB_TRUE : CALIB_NOMINAL;
        int64_t id = 0;
        st = rig_yaml_write(&rig, text, sizeof text);
        if (!st)
            st = calib_add_yaml(site, "rig", "twin", status, text, &id, err);
        if (!st)
            st = rig_yaml_write_camera(&camera, text, sizeof text);
        if (!st)
            st = calib_add_yaml(site, "camera", "twin", status, text, out_camera, err);
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
    enum st st = twin_scan_calibrate(scan->config, site, &camera_id, err);
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
