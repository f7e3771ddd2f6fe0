#include "capture/drive.h"

#include "base/picture.h"
#include "firmware/shared/faultcode.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;
#define NS_A_S ((int64_t)1000000000)
#define MS(n)  ((int64_t)(n)*1000000)

enum {
    HOST_TIMEOUT_MS = 2000, /* the controller stops everything after that silence of ours */
    STATUS_MS = 200,
    EVENTS_MS = 100,
    CLOCK_MS = 2000,
    SILENCE_MS = 4000, /* we stop after that silence of the controller */
    HEAD_SILENCE_MS = 3000,
    FRAME_WAIT_MS = 400, /* of one question; the host must be heard in between */
    FRAME_MAX_MS = 3000,
    EVENTS_AT_ONCE = 8
};

/* Longest stay in a phase, seconds; the sweep's follows from the plan. */
static const double limit_s[] = {
    [DRIVE_CONNECT] = 30,  [DRIVE_HOME] = 240,  [DRIVE_TILT] = 60,    [DRIVE_SPIN] = 40,
    [DRIVE_APPROACH] = 60, [DRIVE_SWEEP] = 0,   [DRIVE_DARK] = 20,    [DRIVE_AIM] = 60,
    [DRIVE_SETTLE] = 20,   [DRIVE_EXPOSE] = 20, [DRIVE_VERIFY] = 120, [DRIVE_PARK] = 10,
    [DRIVE_DONE] = 0,      [DRIVE_STOPPED] = 0};
static const double stop_s = 6; /* of an orderly stop */

const char *drive_phase_name(enum drive_phase phase) {
    static const char *const names[] = {
        "connect", "homing", "tilt",       "mirror spin-up", "approach", "sweep", "mirror stop",
        "aim",     "settle", "photograph", "homing again",   "rest",     "done",  "stopped"};
    return (unsigned)phase < sizeof names / sizeof names[0] ? names[phase] : "unknown";
}

void drive_init(struct drive *drive, const struct drive_config *config) {
    memset(drive, 0, sizeof *drive);
    drive->config = *config;
    drive->home_axis = -1;
}

static const struct motor_ops *ops(const struct drive *d) {
    return d->config.devices->motor->ops;
}

static struct motor *motor(const struct drive *d) {
    return d->config.devices->motor;
}

static void warn(struct drive *d, const char *fmt, ...) ST_PRINTF(2, 3);
static void warn(struct drive *d, const char *fmt, ...) {
    va_list args;
    va_start(args, fmt);
    (void)vsnprintf(d->warning, sizeof d->warning, fmt, args);
    va_end(args);
    d->warnings++;
}

void drive_stop(struct drive *drive, enum st why, const char *text) {
    if (drive->stopping || drive_ended(drive))
        return;
    drive->stopping = true;
    drive->why = errctx_set(&drive->why_err, why, "%s", text);
}

static void enter(struct drive *d, enum drive_phase phase) {
    d->phase = phase;
    d->step = 0;
    d->phase_since_ns = d->now_ns;
    d->good_since_ns = 0;
    d->has_status = false; /* of this phase */
    d->next_status_ns = d->now_ns;
}

/* ---- talking to the controller ---- */

/* Judges an answer: true if it was good. A controller that does not answer is asked again until it
 * has been silent for too long; one that refuses ends the scan. */
static bool answered(struct drive *d, enum st st, const struct errctx *err) {
    if (!st) {
        d->answered_ns = d->now_ns;
        return true;
    }
    if (st == ST_CANCELLED || st == ST_DEVICE || st == ST_INVALID || st == ST_UNSUPPORTED) {
        drive_stop(d, st, err->text);
        return false;
    }
    warn(d, "controller: %.140s", err->text);
    if (d->now_ns - d->answered_ns > MS(SILENCE_MS))
        drive_stop(d, st, err->text);
    return false;
}

static void say_fault(struct drive *d) {
    char text[200];
    (void)snprintf(text, sizeof text,
                   "the controller stopped the cart: fault %u, %s. Remove the cause, then "
                   "`scancart controller clear`, then go on with --resume",
                   d->status.fault, faultcode_text((int)d->status.fault));
    drive_stop(d, ST_DEVICE, text);
}

static void poll_status(struct drive *d) {
    struct errctx err = {0};
    if (d->now_ns < d->next_status_ns)
        return;
    d->next_status_ns = d->now_ns + MS(STATUS_MS);
    if (!answered(d, ops(d)->status(motor(d), &d->status, &err), &err))
        return;
    d->has_status = true;
    d->status_known = true;
    if (d->status.state == CTLSTATE_FAULT && !d->stopping && d->phase != DRIVE_CONNECT)
        say_fault(d);
}

/* Pairs the controller's clock with the host's, by when a request was asked and answered. */
static void pair_clocks(struct drive *d) {
    struct motor_identity identity;
    struct errctx err = {0};
    const struct hosttime *hosttime = d->config.devices->hosttime;
    if (d->now_ns < d->next_clock_ns)
        return;
    d->next_clock_ns = d->now_ns + MS(CLOCK_MS);
    int64_t before_ns = hosttime_now_ns(hosttime);
    if (!answered(d, ops(d)->identify(motor(d), &identity, &err), &err))
        return;
    int64_t after_ns = hosttime_now_ns(hosttime);
    d->clock_offset_ns = before_ns + (after_ns - before_ns) / 2 - identity.uptime_ns;
    d->clock_known = true;
    recorder_put_clock_pair(d->config.recorder, before_ns, after_ns, identity.uptime_ns);
}

/* Reads all events that are new. Before the first call nothing is recorded: what happened before
 * the session is skipped. */
static void poll_events(struct drive *d) {
    if (d->now_ns < d->next_events_ns)
        return;
    d->next_events_ns = d->now_ns + MS(EVENTS_MS);
    for (int round = 0; round < 16; round++) {
        struct index_event event[EVENTS_AT_ONCE];
        struct errctx err = {0};
        size_t count = 0;
        uint64_t lost = 0;
        enum st st = ops(d)->read_events(motor(d), d->next_event, event, EVENTS_AT_ONCE, &count,
                                         &lost, &err);
        if (st == ST_DAMAGED && d->controller_resets < 3 && d->events_known) {
            d->controller_resets++; /* it counts anew */
            warn(d, "the controller has restarted");
            d->next_event = 0;
            d->clock_known = false;
            d->next_clock_ns = d->now_ns;
            return;
        }
        if (!answered(d, st, &err))
            return;
        int64_t now_ns = hosttime_now_ns(d->config.devices->hosttime);
        for (size_t i = 0; i < count && d->events_known; i++) {
            int64_t t_ns = event[i].t_ns + d->clock_offset_ns;
            bool plausible = d->clock_known && t_ns <= now_ns;
            recorder_put_event(d->config.recorder, &event[i], plausible ? t_ns : now_ns,
                               i ? 0 : lost);
            d->events_seen++;
        }
        d->next_event += lost + count;
        if (count < EVENTS_AT_ONCE) {
            d->events_known = true;
            return;
        }
    }
}

/* Carries out one command; once it has succeeded, the next call of the phase goes on behind it. */
static bool command(struct drive *d, enum st st, const struct errctx *err) {
    if (!answered(d, st, err))
        return false;
    d->step++;
    d->has_status = false; /* what was asked before says nothing any more */
    d->next_status_ns = d->now_ns;
    return true;
}

/* ---- the phases ---- */

static bool at_rest(const struct motor_axis_status *axis) {
    return !axis->moving && !axis->homing;
}

static bool good_for(struct drive *d, bool good, int64_t time_ns) {
    if (!good)
        d->good_since_ns = 0;
    else if (!d->good_since_ns)
        d->good_since_ns = d->now_ns ? d->now_ns : 1;
    return good && d->now_ns - d->good_since_ns >= time_ns;
}

static bool sweeps(const struct drive *d) {
    return d->config.plan->pan_to_steps > d->config.plan->pan_from_steps;
}

/* A fault that our own death caused is no reason to send for the crew. */
static void connect(struct drive *d) {
    struct errctx err = {0};
    if (d->step == 0) {
        poll_status(d);
        if (!d->has_status)
            return;
        if (d->status.state == CTLSTATE_FAULT && d->status.fault == FAULT_HOST_SILENT)
            (void)command(d, ops(d)->clear_fault(motor(d), d->status.fault, &err), &err);
        else if (d->status.state == CTLSTATE_FAULT)
            say_fault(d);
        else
            (void)command(d, ST_OK, &err);
    } else if (d->step == 1) {
        (void)command(d, ops(d)->host_timeout(motor(d), HOST_TIMEOUT_MS, &err), &err);
    } else if (d->step == 2) {
        poll_events(d);
        if (d->events_known)
            (void)command(d, ST_OK, &err);
    } else if (command(d, ops(d)->enable(motor(d), true, &err), &err)) {
        enter(d, DRIVE_HOME);
    }
}

static void home(struct drive *d) {
    struct errctx err = {0};
    if (!d->has_status)
        return;
    if (d->home_axis >= 0) {
        const struct motor_axis_status *axis = &d->status.axis[d->home_axis];
        if (axis->homing || axis->moving)
            return;
        if (!axis->homed)
            drive_stop(d, ST_DEVICE,
                       d->home_axis == MOTOR_PAN ? "the pan has not found its home switch"
                                                 : "the tilt has not found its home switch");
        d->home_axis = -1;
        return;
    }
    for (int axis = 0; axis < MOTOR_AXES; axis++)
        if (!d->status.axis[axis].homed) {
            if (command(d, ops(d)->home(motor(d), (enum motor_axis)axis, &err), &err))
                d->home_axis = axis;
            return;
        }
    enter(d, sweeps(d) ? DRIVE_TILT : DRIVE_AIM);
}

static void tilt(struct drive *d) {
    struct errctx err = {0};
    const struct scan_plan *plan = d->config.plan;
    const int32_t run_up_steps = 60; /* so that the laser's way to the start is short */
    double near = fmax(plan->pan_from_steps - run_up_steps, -plan->pan_steps_per_turn / 2);
    if (d->step == 0)
        (void)command(d, ops(d)->move(motor(d), MOTOR_TILT, plan->tilt_steps, &err), &err);
    else if (d->step == 1)
        (void)command(d, ops(d)->move(motor(d), MOTOR_PAN, (int32_t)near, &err), &err);
    else if (d->step == 2)
        (void)command(d, ops(d)->mirror(motor(d), plan->mirror_hz, &err), &err);
    else if (d->has_status && at_rest(&d->status.axis[MOTOR_TILT]) &&
             at_rest(&d->status.axis[MOTOR_PAN]))
        enter(d, DRIVE_SPIN);
}

static void spin(struct drive *d) {
    const double near = 0.03; /* of the speed wanted */
    const double steady_s = 1;
    double hz = d->config.plan->mirror_hz;
    bool good =
        d->has_status && d->status.mirror_in_range && fabs(d->status.mirror_rps - hz) < near * hz;
    if (!d->has_status)
        return;
    if (good_for(d, good, (int64_t)(steady_s * 1e9)))
        enter(d, DRIVE_APPROACH);
}

static void approach(struct drive *d) {
    struct errctx err = {0};
    const struct scan_plan *plan = d->config.plan;
    struct motor_scan scan = {plan->pan_from_steps, plan->pan_to_steps, scan_plan_rate(plan), 0};
    d->head_wanted = true;
    if (!d->head_on) /* it listens before there is something to be heard */
        return;
    if (d->step == 0)
        (void)command(d, ops(d)->laser(motor(d), true, &err), &err);
    else if (d->step == 1)
        (void)command(d, ops(d)->scan_program(motor(d), &scan, &err), &err);
    else if (d->step == 2)
        (void)command(d, ops(d)->scan_run(motor(d), true, &err), &err);
    else if (d->has_status &&
             (d->status.scan_state == SCANSTATE_SWEEP || d->status.scan_state == SCANSTATE_DONE))
        enter(d, DRIVE_SWEEP);
}

/* The head must be heard while the laser is on. */
static void listen(struct drive *d) {
    struct recorder_counts counts;
    recorder_counts(d->config.recorder, &counts);
    /* A recorder that waits for the disk has not looked at what came. */
    bool came = d->head_transfers != d->head_came && counts.head.damaged_bytes == d->head_damaged;
    if (counts.head.packets != d->head_packets || came || !d->head_heard_ns)
        d->head_heard_ns = d->now_ns;
    d->head_packets = counts.head.packets;
    d->head_damaged = counts.head.damaged_bytes;
    d->head_came = d->head_transfers;
    if (d->now_ns - d->head_heard_ns < MS(HEAD_SILENCE_MS) ||
        d->now_ns - d->answered_ns > MS(2 * STATUS_MS)) /* a silent controller may be why */
        return;
    char text[200];
    if (counts.head_version_seen)
        (void)snprintf(text, sizeof text,
                       "the rangefinder head speaks version %u of its protocol, this program "
                       "version %d: bring both to the same version",
                       counts.head_version_seen, HEAD_PACKET_VERSION);
    else
        (void)snprintf(text, sizeof text,
                       "the rangefinder head has sent no good packet for %d s: look at its cable",
                       HEAD_SILENCE_MS / 1000);
    drive_stop(d, counts.head_version_seen ? ST_UNSUPPORTED : ST_TIMEOUT, text);
}

static void sweep(struct drive *d) {
    if (!d->has_status)
        return;
    listen(d);
    if (d->status.scan_state == SCANSTATE_DONE)
        /* the last samples lie between the last pulse of the sweep and the next: wait for that */
        (void)(good_for(d, true, (int64_t)(2.5e9 / d->config.plan->mirror_hz)) &&
               (enter(d, DRIVE_DARK), true));
    else if (d->status.scan_state == SCANSTATE_OFF)
        drive_stop(d, ST_DEVICE, "the controller has ended the sweep before its end");
    else if (!d->status.laser_on)
        drive_stop(d, ST_DEVICE, "the laser went off during the sweep");
}

static void dark(struct drive *d) {
    struct errctx err = {0};
    if (d->step == 0)
        (void)command(d, ops(d)->laser(motor(d), false, &err), &err);
    else if (d->step == 1)
        (void)command(d, ops(d)->scan_run(motor(d), false, &err), &err);
    else if (d->step == 2)
        (void)command(d, ops(d)->mirror(motor(d), 0, &err), &err);
    else if (good_for(d, d->has_status, NS_A_S)) {
        d->head_wanted = false;
        enter(d, DRIVE_AIM);
    }
}

/* ---- photographs ---- */

static bool next_shot(struct drive *d, int32_t *out_pan, int32_t *out_tilt) {
    const struct scan_plan *plan = d->config.plan;
    while (d->pass < plan->pass_count && d->shot >= plan->pass[d->pass].count) {
        d->pass++;
        d->shot = 0;
    }
    if (d->pass >= plan->pass_count || !d->config.devices->camera)
        return false;
    *out_pan = plan->pass[d->pass].pan_steps[d->shot];
    *out_tilt = plan->pass[d->pass].tilt_steps;
    return true;
}

static void aim(struct drive *d) {
    struct errctx err = {0};
    int32_t pan = 0, at = 0;
    if (!next_shot(d, &pan, &at)) {
        enter(d, DRIVE_VERIFY);
        return;
    }
    if (d->step == 0)
        (void)command(d, ops(d)->move(motor(d), MOTOR_TILT, at, &err), &err);
    else if (d->step == 1)
        (void)command(d, ops(d)->move(motor(d), MOTOR_PAN, pan, &err), &err);
    else if (d->has_status && at_rest(&d->status.axis[MOTOR_PAN]) &&
             at_rest(&d->status.axis[MOTOR_TILT]))
        enter(d, DRIVE_SETTLE);
}

/* One frame as bytes of a file. JPEG as it came; pixels without loss. */
static enum st frame_bytes(const struct camera_frame *f, uint8_t **out_bytes, size_t *out_size,
                           const char **out_extension, struct errctx *err) {
    *out_extension = f->format == CAMERA_FORMAT_JPEG ? "jpg" : "png";
    if (f->format == CAMERA_FORMAT_JPEG) {
        uint8_t *copy = f->size ? malloc(f->size) : NULL;
        if (!copy)
            return errctx_set(err, ST_NOMEM, "no memory for a photograph of %zu bytes", f->size);
        memcpy(copy, f->bytes, f->size);
        *out_bytes = copy;
        *out_size = f->size;
        return ST_OK;
    }
    struct image_u8 image = {.px = NULL};
    enum st st = image_u8_create(&image, (int32_t)f->width_px, (int32_t)f->height_px, 3);
    if (st)
        return errctx_set(err, st, "no memory for a photograph");
    for (uint32_t y = 0; y < f->height_px; y++) {
        const uint8_t *row = f->bytes + (size_t)y * f->stride_bytes;
        uint8_t *to = image_u8_at(&image, 0, (int32_t)y);
        for (uint32_t x = 0; x < f->width_px; x++, to += 3) {
            if (f->format == CAMERA_FORMAT_RGB24) {
                memcpy(to, row + 3 * (size_t)x, 3);
                continue;
            }
            const uint8_t *pair = row + 4 * (size_t)(x / 2); /* BT.601, full range */
            double luma = pair[x % 2 ? 2 : 0], cb = pair[1] - 128.0, cr = pair[3] - 128.0;
            double rgb[3] = {luma + 1.402 * cr, luma - 0.344136 * cb - 0.714136 * cr,
                             luma + 1.772 * cb};
            for (int c = 0; c < 3; c++)
                to[c] = (uint8_t)lrint(fmin(fmax(rgb[c], 0), 255));
        }
    }
    st = picture_encode_png(&image, out_bytes, out_size, err);
    image_u8_destroy(&image);
    return st;
}

static void keep_frame(struct drive *d, const struct camera_frame *f) {
    const struct scan_plan *plan = d->config.plan;
    struct frame_row row;
    struct errctx err = {0};
    uint8_t *bytes = NULL;
    size_t size = 0;
    const char *extension = NULL;
    enum st st = frame_bytes(f, &bytes, &size, &extension, &err);
    if (st) {
        warn(d, "%.150s", err.text);
        d->photos_missed++;
        return;
    }
    memset(&row, 0, sizeof row);
    double exposure_ns = isfinite(f->exposure_s) ? f->exposure_s * 1e9 : 0;
    row.t_ns = f->t_ns + (int64_t)(exposure_ns / 2);
    row.width_px = (int32_t)f->width_px;
    row.height_px = (int32_t)f->height_px;
    row.exposure_s = f->exposure_s;
    row.gain = f->gain;
    row.pan_rad = d->status.axis[MOTOR_PAN].steps * 2 * pi / plan->pan_steps_per_turn;
    row.tilt_rad = d->status.axis[MOTOR_TILT].steps * 2 * pi / plan->tilt_steps_per_turn;
    row.camera_calib_id = d->config.camera_calib_id;
    (void)snprintf(row.meta, sizeof row.meta,
                   "{\"pan_steps\": %d, \"tilt_steps\": %d, \"seq\": %u, \"settings_held\": %s}",
                   (int)d->status.axis[MOTOR_PAN].steps, (int)d->status.axis[MOTOR_TILT].steps,
                   f->seq, f->settings_held ? "true" : "false");
    if (!f->settings_held)
        warn(d, "the camera has changed its settings by itself at pan %d",
             (int)d->status.axis[MOTOR_PAN].steps);
    st = recorder_put_frame(d->config.recorder, bytes, size, extension, &row);
    if (st)
        warn(d, "a photograph could not be kept: the disk is too slow");
    d->photos += !st;
    d->photos_missed += st != ST_OK;
}

static void settle(struct drive *d) {
    struct errctx err = {0};
    if (d->step == 0) {
        if (!good_for(d, d->has_status, (int64_t)(d->config.plan->settle_s * 1e9)))
            return;
        d->shot_after_ns = hosttime_now_ns(d->config.devices->hosttime);
        (void)command(d, ops(d)->trigger(motor(d), &err), &err);
        return;
    }
    enter(d, DRIVE_EXPOSE);
}

static void expose(struct drive *d) {
    struct errctx err = {0};
    struct camera_frame frame;
    struct camera_device *camera = d->config.devices->camera;
    if (!d->has_status)
        return;
    enum st st = camera->ops->frame(camera, d->shot_after_ns, FRAME_WAIT_MS, &frame, &err);
    if (st == ST_CANCELLED) {
        drive_stop(d, st, err.text);
        return;
    }
    if (st && d->now_ns - d->phase_since_ns < MS(FRAME_MAX_MS))
        return; /* once more, after the controller has heard of us */
    if (st) {
        d->photos_missed++;
        warn(d, "no photograph at pan %d: %.110s", (int)d->status.axis[MOTOR_PAN].steps, err.text);
    } else {
        keep_frame(d, &frame);
    }
    d->shot++;
    enter(d, DRIVE_AIM);
}

/* Steps that the pan's motor lost are seen by nobody until it is homed again. */
static void verify(struct drive *d) {
    struct errctx err = {0};
    if (d->step == 0) {
        (void)command(d, ops(d)->home(motor(d), MOTOR_PAN, &err), &err);
        return;
    }
    const struct motor_axis_status *pan = &d->status.axis[MOTOR_PAN];
    if (!d->has_status || !at_rest(pan))
        return;
    d->verified = pan->homed;
    d->lost_steps = pan->home_error_steps;
    if (!pan->homed)
        warn(d, "the pan has not found its home switch again");
    else if (abs(d->lost_steps) > 1)
        warn(d,
             "the pan was %d steps off when it was homed again: it was held or pushed, and the "
             "scan is bent",
             (int)d->lost_steps);
    enter(d, DRIVE_PARK);
}

static void park(struct drive *d) {
    struct errctx err = {0};
    if (d->step == 0) {
        (void)command(d, ops(d)->enable(motor(d), false, &err), &err);
    } else if (d->has_status) {
        poll_events(d);
        enter(d, DRIVE_DONE);
    }
}

/* ---- stopping ---- */

/* Laser first; then whatever moves; then the power. Each is tried whatever became of the one
 * before. A controller in its fault state has done all of it by itself. */
static void stop_in_order(struct drive *d) {
    struct errctx err = {0};
    if (d->why == ST_CANCELLED && d->power_gone) {
        enter(d, DRIVE_STOPPED);
        return;
    }
    if (!d->stop_sent) {
        enum st laser = ops(d)->laser(motor(d), false, &err);
        enum st rest = ops(d)->stop(motor(d), &err);
        enum st scan = ops(d)->scan_run(motor(d), false, &err);
        enum st mirror = ops(d)->mirror(motor(d), 0, &err);
        if ((laser || rest || scan || mirror) && d->status.state != CTLSTATE_FAULT)
            warn(d, "stopping: %.140s", err.text);
        d->stop_sent = true;
        d->stop_since_ns = d->now_ns;
        d->has_status = false;
        d->next_status_ns = d->now_ns;
        return;
    }
    d->next_events_ns = d->now_ns < d->next_events_ns ? d->next_events_ns : d->now_ns;
    poll_status(d);
    poll_events(d);
    bool rest = d->has_status && at_rest(&d->status.axis[MOTOR_PAN]) &&
                at_rest(&d->status.axis[MOTOR_TILT]);
    if (!rest && d->now_ns - d->stop_since_ns < (int64_t)(stop_s * 1e9))
        return;
    if (ops(d)->enable(motor(d), false, &err))
        warn(d, "stopping: %.140s", err.text);
    if (!d->status_known || ops(d)->status(motor(d), &d->status, &err))
        warn(d,
             "stopping: the controller does not say in what state it is; it stops by itself "
             "within %d s",
             HOST_TIMEOUT_MS / 1000);
    enter(d, DRIVE_STOPPED);
}

/* ---- one step ---- */

static void check_time(struct drive *d) {
    double limit = limit_s[d->phase];
    if (d->phase == DRIVE_SWEEP)
        limit = 1.25 * scan_plan_predict(d->config.plan, 1, 0).sweep_s + 30;
    if (limit <= 0 || (double)(d->now_ns - d->phase_since_ns) * 1e-9 <= limit)
        return;
    char text[120];
    (void)snprintf(text, sizeof text, "%s has not ended within %.0f s", drive_phase_name(d->phase),
                   limit);
    drive_stop(d, ST_TIMEOUT, text);
}

/* The host's clock should not go back. Where it does, nothing waits for it. */
static void take_time(struct drive *d, int64_t now_ns) {
    int64_t back_ns = d->now_ns - now_ns;
    if (d->now_ns && back_ns > 0) {
        warn(d, "the host's clock was set back by %.3f s", (double)back_ns * 1e-9);
        d->next_status_ns = d->next_events_ns = d->next_clock_ns = now_ns;
        d->phase_since_ns -= back_ns;
        d->answered_ns -= back_ns;
        d->head_heard_ns -= back_ns;
        d->stop_since_ns -= back_ns;
        d->good_since_ns -= d->good_since_ns ? back_ns : 0;
        d->shot_after_ns = now_ns;
    } else if (!d->now_ns) {
        d->phase_since_ns = d->answered_ns = now_ns;
    }
    d->now_ns = now_ns;
}

void drive_step(struct drive *drive, int64_t now_ns) {
    static void (*const work[])(struct drive *) = {
        [DRIVE_CONNECT] = connect, [DRIVE_HOME] = home,         [DRIVE_TILT] = tilt,
        [DRIVE_SPIN] = spin,       [DRIVE_APPROACH] = approach, [DRIVE_SWEEP] = sweep,
        [DRIVE_DARK] = dark,       [DRIVE_AIM] = aim,           [DRIVE_SETTLE] = settle,
        [DRIVE_EXPOSE] = expose,   [DRIVE_VERIFY] = verify,     [DRIVE_PARK] = park};
    struct drive *d = drive;
    if (drive_ended(d))
        return;
    take_time(d, now_ns);
    if (d->stopping) {
        stop_in_order(d);
        return;
    }
    if (d->phase != DRIVE_CONNECT) {
        pair_clocks(d);
        poll_status(d);
        poll_events(d);
    }
    if (!d->stopping)
        work[d->phase](d);
    if (!d->stopping && !drive_ended(d))
        check_time(d);
}

double drive_progress(const struct drive *drive) {
    const struct scan_plan *plan = drive->config.plan;
    struct scan_plan_forecast f = scan_plan_predict(plan, 1, 0);
    double way = plan->pan_to_steps - plan->pan_from_steps, swept = 0;
    if (drive->phase == DRIVE_DONE)
        return 1;
    if (drive->phase == DRIVE_SWEEP && way > 0 && drive->status_known)
        swept = (drive->status.axis[MOTOR_PAN].steps - plan->pan_from_steps) / way;
    else if (drive->phase > DRIVE_SWEEP && drive->phase < DRIVE_STOPPED)
        swept = 1;
    double photos = scan_plan_photos(plan);
    double rest_s = fmax(f.total_s - f.sweep_s, 1);
    double shot = photos > 0 ? (drive->photos + drive->photos_missed) / photos : 0;
    double prepared = drive->phase >= DRIVE_SWEEP ? 1 : (double)drive->phase / DRIVE_SWEEP;
    double rest = 0.4 * prepared + 0.6 * (photos > 0 ? shot : prepared);
    return fmin(fmax((f.sweep_s * swept + rest_s * rest) / (f.sweep_s + rest_s), 0), 1);
}
