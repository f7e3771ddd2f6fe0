#include "capture/session.h"

#include "base/clock.h"
#include "base/head_packet.h"
#include "capture/realtime.h"
#include "capture/scan_plan_json.h"
#include "capture/source.h"

#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>

#define NS_A_S ((int64_t)1000000000)
#define MS(n)  ((int64_t)(n)*1000000)

enum {
    VIRTUAL_STEP_MS = 20,
    PLAN_STEP_MS = 20,
    RECORDER_STEP_MS = 5,
    IDLE_MS = 10,
    PUMP_MS = 50, /* a source's thread looks at the end of the scan that often */
    REPORT_MS = 1000,
    DISK_PATIENCE_S = 3, /* a disk that refuses batches for longer ends the scan */
    FINISH_ATTEMPTS = 4,
    EDGES = 1 << 13,
    FRAME_BYTES = 400000 /* of a photograph, for the forecast */
};
static const double default_sample_hz = 25000, default_ring_s = 2.5;
static const double packet_overhead = 1.1;      /* short packets */
static const uint64_t spare_bytes = 256u << 20; /* write-ahead log, check, what comes after */

struct session {
    struct session_config config;
    struct scan_plan plan;
    struct source_head head;
    struct source_lines lines;
    struct recorder *recorder;
    struct drive drive;
    struct head_identity head_identity;
    struct motor_identity motor_identity;
    struct scan_plan_forecast forecast;
    double sample_hz;
    int64_t start_ns;
    uint64_t refused_seen;
    bool head_started; /* the head's thread, or after it has ended */
    /* any thread */
    atomic_bool head_wanted, head_on;
    atomic_int stop_asked; /* by session_stop() */
    atomic_bool ended;     /* the plan is over: sources and recorder finish */
    atomic_int head_failed, lines_failed, disk_failed; /* enum st */
    /* written by one thread before its flag above, read after it */
    struct errctx head_err, lines_err, disk_err;
    /* under the lock */
    pthread_mutex_t lock;
    struct session_status status;
    bool realtime;
    char realtime_note[240];
};

/* ---- before it runs ---- */

static uint64_t free_bytes(const struct site *site) {
    struct statvfs fs;
    return statvfs(site_path(site), &fs) ? UINT64_MAX : (uint64_t)fs.f_bavail * fs.f_frsize;
}

static enum st check_room(struct session *s, struct errctx *err) {
    uint64_t there = free_bytes(s->config.site), needed = s->forecast.bytes + spare_bytes;
    if (s->config.free_bytes)
        there = s->config.free_bytes;
    if (there >= needed)
        return ST_OK;
    return errctx_set(err, ST_FULL,
                      "%s: the scan needs %.1f GB (%.1f GB of samples and photographs and %.1f GB "
                      "to spare), %.1f GB are free: make room or choose a lower quality",
                      site_path(s->config.site), (double)needed * 1e-9,
                      (double)s->forecast.bytes * 1e-9, (double)spare_bytes * 1e-9,
                      (double)there * 1e-9);
}

/* Who is there; nothing moves. */
static enum st identify(struct session *s, struct errctx *err) {
    const struct cart_devices *d = s->config.devices;
    enum st st = d->motor->ops->identify(d->motor, &s->motor_identity, err);
    if (st)
        return errctx_prefix(err, st, "controller");
    st = d->head->ops->identify(d->head, &s->head_identity, err);
    if (st)
        return errctx_prefix(err, st, "rangefinder head");
    if (s->head_identity.protocol_version != HEAD_PACKET_VERSION)
        return errctx_set(err, ST_UNSUPPORTED,
                          "the rangefinder head speaks version %u of its protocol, this program "
                          "version %d: bring both to the same version",
                          s->head_identity.protocol_version, HEAD_PACKET_VERSION);
    struct lines_levels levels;
    if (d->lines && (st = d->lines->ops->levels(d->lines, &levels, err)))
        return errctx_prefix(err, st, "lines");
    unsigned chains = 1u << EDGE_RECORD_ESTOP | 1u << EDGE_RECORD_INTERLOCK;
    if (d->lines && (levels.wired & chains & ~levels.high))
        return errctx_set(err, ST_DEVICE, "the %s is open: nothing can move",
                          levels.wired & ~levels.high & 1u << EDGE_RECORD_ESTOP
                              ? "emergency stop chain"
                              : "laser interlock");
    if (d->camera && scan_plan_photos(&s->plan)) {
        st = d->camera->ops->configure(d->camera, &s->plan.camera, err);
        if (st)
            return errctx_prefix(err, st, "camera");
    }
    return ST_OK;
}

static enum st prepare(struct session *s, struct errctx *err) {
    enum st st = scan_plan_check(&s->plan, err);
    if (!st)
        st = identify(s, err);
    if (st)
        return st;
    uint32_t interval_ns = s->head_identity.interval_ns;
    s->sample_hz = s->config.sample_hz > 0 ? s->config.sample_hz
                   : interval_ns           ? 1e9 / interval_ns
                                           : default_sample_hz;
    s->forecast = scan_plan_predict(&s->plan, s->sample_hz, FRAME_BYTES);
    st = check_room(s, err);
    if (st)
        return st;
    double bytes_per_s =
        s->sample_hz / HEAD_PACKET_MAX_SAMPLES * HEAD_PACKET_MAX_BYTES * packet_overhead;
    st = source_head_init(&s->head, bytes_per_s,
                          s->config.ring_s > 0 ? s->config.ring_s : default_ring_s, err);
    if (!st && s->config.devices->lines)
        st = source_lines_init(&s->lines, EDGES, err);
    if (st)
        return st;
    char plan[SITE_TEXT_MAX - 64], meta[SITE_TEXT_MAX];
    if (scan_plan_json_write(s->config.whole_plan ? s->config.whole_plan : &s->plan, plan,
                             sizeof plan))
        return errctx_set(err, ST_INVALID, "the plan is too long to be kept");
    (void)snprintf(meta, sizeof meta, "{\"interval_ns\": %u, \"plan\": %s}", interval_ns, plan);
    struct recorder_config record = {.site = s->config.site,
                                     .station_id = s->config.station_id,
                                     .device = s->config.device,
                                     .head_meta = meta,
                                     .head_bytes_per_s = bytes_per_s,
                                     .head = &s->head,
                                     .lines = s->config.devices->lines ? &s->lines : NULL,
                                     .disk_full = s->config.devices->disk_full,
                                     .disk_ctx = s->config.devices->ctx,
                                     .before_stream_id = s->config.before_stream_id};
    st = recorder_open(&record, &s->recorder, err);
    struct drive_config drive = {s->config.devices, &s->plan, s->recorder,
                                 s->config.camera_calib_id};
    drive_init(&s->drive, &drive);
    return st;
}

enum st session_open(const struct session_config *config, struct session **out_session,
                     struct errctx *err) {
    struct session *s = calloc(1, sizeof *s);
    if (!s || pthread_mutex_init(&s->lock, NULL)) {
        free(s);
        return errctx_set(err, ST_NOMEM, "no memory for a session");
    }
    s->config = *config;
    s->plan = *config->plan;
    enum st st = prepare(s, err);
    if (st)
        session_close(s);
    else
        *out_session = s;
    return st;
}

void session_close(struct session *session) {
    if (!session)
        return;
    recorder_close(session->recorder);
    source_head_fini(&session->head);
    source_lines_fini(&session->lines);
    (void)pthread_mutex_destroy(&session->lock);
    free(session);
}

void session_stop(struct session *session) {
    atomic_store(&session->stop_asked, 1);
}

const struct scan_plan_forecast *session_forecast(const struct session *session) {
    return &session->forecast;
}

/* ---- steps that both ways of running share ---- */

static void make_status(struct session *s, int64_t now_ns) {
    const struct drive *d = &s->drive;
    struct session_status status;
    memset(&status, 0, sizeof status);
    status.phase = d->phase;
    status.t_ns = now_ns;
    status.elapsed_s = (double)(now_ns - s->start_ns) * 1e-9;
    status.progress = drive_progress(d);
    status.remaining_s = status.progress >= 1 ? 0 : (1 - status.progress) * s->forecast.total_s;
    status.pan_deg = d->status_known
                         ? d->status.axis[MOTOR_PAN].steps * 360.0 / s->plan.pan_steps_per_turn
                         : (double)NAN;
    status.mirror_hz = d->status_known ? d->status.mirror_rps : 0;
    status.laser_on = d->status_known && d->status.laser_on;
    status.controller_state = d->status_known ? d->status.state : 0;
    status.motors_on = d->status_known && d->status.motors_on;
    status.ring_peak = source_head_peak(&s->head);
    status.photos = d->photos;
    status.photos_missed = d->photos_missed;
    status.photos_planned = scan_plan_photos(&s->plan);
    status.verified = d->verified;
    status.lost_steps = d->lost_steps;
    status.warnings = d->warnings;
    (void)snprintf(status.warning, sizeof status.warning, "%s", d->warning);
    recorder_counts(s->recorder, &status.counts);
    (void)pthread_mutex_lock(&s->lock);
    s->status = status;
    (void)pthread_mutex_unlock(&s->lock);
}

/* What other threads have met, to the plan. */
static void hear(struct session *s) {
    enum st st = (enum st)atomic_load(&s->head_failed);
    struct drive *d = &s->drive;
    if (st == ST_CANCELLED)
        d->power_gone = true;
    if (st)
        drive_stop(d, st, s->head_err.text);
    st = (enum st)atomic_load(&s->lines_failed);
    if (st)
        drive_stop(d, st, s->lines_err.text);
    st = (enum st)atomic_load(&s->disk_failed);
    if (st)
        drive_stop(d, st, s->disk_err.text);
    if (atomic_load(&s->stop_asked))
        drive_stop(d, ST_CANCELLED,
                   "stopped on request; all that was measured is stored, go on with --resume");
}

static void plan_step(struct session *s, int64_t now_ns) {
    hear(s);
    s->drive.head_on = atomic_load(&s->head_on);
    s->drive.head_transfers = s->head.transfers_total;
    drive_step(&s->drive, now_ns);
    atomic_store(&s->head_wanted, s->drive.head_wanted);
    make_status(s, now_ns);
}

/* Notes the first failure of a source or the disk for the plan's thread. */
static void fail(atomic_int *flag, struct errctx *kept, enum st st, const struct errctx *err,
                 const char *what) {
    if (atomic_load(flag))
        return;
    *kept = *err;
    if (what)
        (void)errctx_prefix(kept, st, "%s", what);
    atomic_store(flag, st);
}

/* A batch that fails is tried again; a disk that stays full, or broken for long, ends the scan. */
static void record_step(struct session *s, int64_t now_ns) {
    struct errctx err = {0};
    enum st st = recorder_step(s->recorder, now_ns, false, &err);
    if (!st)
        return;
    int64_t since_ns = recorder_failing_since(s->recorder);
    (void)errctx_prefix(
        &err, st, "the cart was stopped: make room, or mend the disk, then go on with --resume");
    bool long_ago = since_ns != INT64_MAX && now_ns - since_ns > DISK_PATIENCE_S * NS_A_S;
    if (st == ST_FULL || st == ST_NOMEM || long_ago)
        fail(&s->disk_failed, &s->disk_err, st, &err, NULL);
}

/* Starts and stops the head as the plan wants it: a head that sends while the laser is off would
 * only fill the disk. Between the two this is the real-time path. */
static void pump_head(struct session *s, unsigned timeout_ms) {
    struct head *head = s->config.devices->head;
    struct errctx err = {0};
    bool wanted = atomic_load(&s->head_wanted);
    enum st st = ST_OK;
    if (wanted && s->head_started)
        st = head->ops->pump(head, timeout_ms, &s->head.sink, &err);
    else if (wanted)
        s->head_started = !(st = head->ops->start(head, &err));
    else if (s->head_started)
        s->head_started = (st = head->ops->stop(head, &s->head.sink, &err)) != ST_OK;
    else if (timeout_ms)
        (void)hosttime_wait_until(&hosttime_real, clock_now_ns() + MS(IDLE_MS), &err);
    atomic_store(&s->head_on, s->head_started);
    if (st && st != ST_TIMEOUT)
        fail(&s->head_failed, &s->head_err, st, &err,
             st == ST_CANCELLED ? NULL : "rangefinder head");
}

static void pump_lines(struct session *s, unsigned timeout_ms) {
    struct lines *lines = s->config.devices->lines;
    struct errctx err = {0};
    enum st st = lines->ops->pump(lines, timeout_ms, &s->lines.sink, &err);
    if (st && st != ST_TIMEOUT && st != ST_CANCELLED)
        fail(&s->lines_failed, &s->lines_err, st, &err, "lines");
}

static void note_begin(struct session *s) {
    char detail[SITE_TEXT_MAX];
    (void)snprintf(detail, sizeof detail,
                   "{\"station\": %lld, \"device\": \"%.60s\", \"head\": \"%.60s %.60s\", "
                   "\"controller\": \"%u.%u.%u serial %u\", \"from_steps\": %d, \"to_steps\": %d, "
                   "\"steps_per_revolution\": %.6g, \"mirror_hz\": %.6g, \"photos\": %u}",
                   (long long)s->config.station_id, s->config.device, s->head_identity.product,
                   s->head_identity.serial, s->motor_identity.fw_major, s->motor_identity.fw_minor,
                   s->motor_identity.fw_patch, s->motor_identity.serial, s->plan.pan_from_steps,
                   s->plan.pan_to_steps, s->plan.steps_per_revolution, s->plan.mirror_hz,
                   scan_plan_photos(&s->plan));
    recorder_put_note(s->recorder, s->config.before_stream_id ? "capture.resume" : "capture.start",
                      detail);
}

static void note_end(struct session *s) {
    char detail[SITE_TEXT_MAX];
    struct recorder_counts c;
    recorder_counts(s->recorder, &c);
    const struct head_ledger_totals *t = &c.head;
    (void)snprintf(
        detail, sizeof detail,
        "{\"station\": %lld, \"end\": \"%s\", \"samples\": %llu, \"lost\": %llu, "
        "\"not_sent\": %llu, \"packets\": %llu, \"packets_lost\": %llu, \"resets\": %llu, "
        "\"repeated\": %llu, \"sequence\": %llu, \"damaged_bytes\": %llu, "
        "\"index_events\": %llu, \"index_lost\": %llu, \"photos\": %u, "
        "\"photos_missed\": %u, \"pan_lost_steps\": %d}",
        (long long)s->config.station_id, s->drive.why ? st_name(s->drive.why) : "done",
        (unsigned long long)t->samples, (unsigned long long)head_ledger_lost_samples(t),
        (unsigned long long)t->not_sent, (unsigned long long)t->packets,
        (unsigned long long)head_ledger_lost_packets(t), (unsigned long long)t->resets,
        (unsigned long long)t->repeated, (unsigned long long)t->sequence,
        (unsigned long long)t->damaged_bytes, (unsigned long long)c.index_events,
        (unsigned long long)c.index_lost, s->drive.photos, s->drive.photos_missed,
        s->drive.verified ? (int)s->drive.lost_steps : 0);
    recorder_put_note(s->recorder, s->drive.why ? "capture.stop" : "capture.end", detail);
}

static enum st start_devices(struct session *s, struct errctx *err) {
    const struct cart_devices *d = s->config.devices;
    enum st st = ST_OK;
    if (d->camera && scan_plan_photos(&s->plan))
        st = d->camera->ops->start(d->camera, err);
    return st ? errctx_prefix(err, st, "camera") : ST_OK;
}

static void stop_devices(struct session *s) {
    const struct cart_devices *d = s->config.devices;
    struct errctx err = {0};
    if (s->head_started)
        (void)d->head->ops->stop(d->head, &s->head.sink, &err);
    if (d->lines)
        (void)d->lines->ops->pump(d->lines, 0, &s->lines.sink, &err);
    if (d->camera && scan_plan_photos(&s->plan))
        (void)d->camera->ops->stop(d->camera, &err);
}

static void tell(struct session *s) {
    struct session_status status;
    if (!s->config.report)
        return;
    (void)pthread_mutex_lock(&s->lock);
    status = s->status;
    (void)pthread_mutex_unlock(&s->lock);
    status.free_bytes = free_bytes(s->config.site);
    s->config.report(s->config.report_ctx, &status);
}

/* ---- virtual time: one loop ---- */

static void run_virtual(struct session *s) {
    const struct hosttime *hosttime = s->config.devices->hosttime;
    int64_t next_report_ns = s->start_ns;
    struct errctx err = {0};
    while (!drive_ended(&s->drive)) {
        int64_t now_ns = hosttime_now_ns(hosttime);
        enum st st = hosttime_wait_until(hosttime, now_ns + MS(VIRTUAL_STEP_MS), &err);
        if (st) {
            fail(&s->head_failed, &s->head_err, ST_CANCELLED, &err, NULL);
            s->drive.power_gone = true;
        }
        pump_head(s, 0);
        if (s->config.devices->lines)
            pump_lines(s, 0);
        now_ns = hosttime_now_ns(hosttime);
        plan_step(s, now_ns);
        if (!s->drive.power_gone)
            record_step(s, now_ns);
        if (now_ns >= next_report_ns || next_report_ns - now_ns > 2 * NS_A_S) {
            next_report_ns = now_ns + MS(REPORT_MS);
            tell(s);
        }
    }
}

/* ---- real time: threads ---- */

static void *head_main(void *arg) {
    struct session *s = arg;
    while (!atomic_load(&s->ended) && !atomic_load(&s->head_failed))
        pump_head(s, PUMP_MS);
    return NULL;
}

static void *lines_main(void *arg) {
    struct session *s = arg;
    while (!atomic_load(&s->ended) && !atomic_load(&s->lines_failed))
        pump_lines(s, PUMP_MS);
    return NULL;
}

static void *recorder_main(void *arg) {
    struct session *s = arg;
    const struct hosttime *hosttime = s->config.devices->hosttime;
    struct errctx err = {0};
    while (!atomic_load(&s->ended)) {
        int64_t now_ns = hosttime_now_ns(hosttime);
        record_step(s, now_ns);
        (void)hosttime_wait_until(&hosttime_real, clock_now_ns() + MS(RECORDER_STEP_MS), &err);
    }
    return NULL;
}

static void *plan_main(void *arg) {
    struct session *s = arg;
    const struct hosttime *hosttime = s->config.devices->hosttime;
    struct errctx err = {0};
    while (!drive_ended(&s->drive)) {
        plan_step(s, hosttime_now_ns(hosttime));
        (void)hosttime_wait_until(&hosttime_real, clock_now_ns() + MS(PLAN_STEP_MS), &err);
    }
    atomic_store(&s->ended, true);
    return NULL;
}

static void run_threads(struct session *s) {
    pthread_t head, lines, recorder, plan;
    bool head_granted = false, lines_granted = true, ignored;
    bool has_lines = s->config.devices->lines != NULL;
    char why[100];
    bool locked = realtime_lock_memory(why, sizeof why);
    int failed = realtime_start(&recorder, recorder_main, s, 0, -1, &ignored);
    bool recording = !failed, lining = false, heading = false, planning = false;
    if (!failed && !(failed = realtime_start(&head, head_main, s, REALTIME_HEAD, 1, &head_granted)))
        heading = true;
    if (!failed && has_lines &&
        !(failed = realtime_start(&lines, lines_main, s, REALTIME_LINES, 0, &lines_granted)))
        lining = true;
    s->realtime = head_granted && lines_granted && locked;
    if (!s->realtime)
        (void)snprintf(s->realtime_note, sizeof s->realtime_note,
                       "%s%s%s: samples may be lost when the machine is busy (run as the service, "
                       "or raise rtprio and memlock in limits.conf)",
                       head_granted ? "" : "no real-time priority",
                       head_granted || locked ? "" : ", ", why);
    if (!failed && !(failed = pthread_create(&plan, NULL, plan_main, s)))
        planning = true;
    if (failed) {
        drive_stop(&s->drive, ST_IO, "the system does not start another thread");
        if (!planning) /* nothing has moved yet */
            s->drive.phase = DRIVE_STOPPED;
        atomic_store(&s->ended, true);
    }
    int64_t next_report_ns = clock_now_ns();
    struct errctx err = {0};
    while (!atomic_load(&s->ended)) {
        if (clock_now_ns() >= next_report_ns) {
            next_report_ns += MS(REPORT_MS);
            tell(s);
        }
        (void)hosttime_wait_until(&hosttime_real, clock_now_ns() + MS(PUMP_MS), &err);
    }
    if (planning)
        (void)pthread_join(plan, NULL);
    if (heading)
        (void)pthread_join(head, NULL);
    if (lining)
        (void)pthread_join(lines, NULL);
    if (recording)
        (void)pthread_join(recorder, NULL);
    if (locked)
        realtime_unlock_memory();
}

/* ---- the whole ---- */

static enum st finish(struct session *s, struct errctx *err) {
    struct drive *d = &s->drive;
    int64_t now_ns = hosttime_now_ns(s->config.devices->hosttime);
    enum st st = d->why;
    if (d->power_gone)
        return errctx_set(err, ST_CANCELLED,
                          "the power went; what was stored by then is in the site, go on with "
                          "--resume");
    stop_devices(s);
    note_end(s);
    struct errctx disk_err = {0};
    enum st disk = recorder_finish(s->recorder, now_ns, FINISH_ATTEMPTS, &disk_err);
    if (disk && !st)
        return errctx_set(err, disk, "%s", disk_err.text);
    return st ? errctx_set(err, st, "%s", d->why_err.text) : ST_OK;
}

enum st session_run(struct session *session, struct session_result *out_result,
                    struct errctx *err) {
    struct session *s = session;
    const struct hosttime *hosttime = s->config.devices->hosttime;
    s->start_ns = hosttime_now_ns(hosttime);
    note_begin(s);
    enum st st = recorder_step(s->recorder, s->start_ns, true, err);
    if (!st)
        st = start_devices(s, err);
    if (!st) {
        make_status(s, s->start_ns);
        if (hosttime->is_virtual)
            run_virtual(s);
        else
            run_threads(s);
        st = finish(s, err);
    }
    make_status(s, hosttime_now_ns(hosttime));
    memset(out_result, 0, sizeof *out_result);
    s->status.free_bytes = free_bytes(s->config.site);
    out_result->last = s->status;
    out_result->complete = !st && s->drive.phase == DRIVE_DONE;
    out_result->realtime = s->realtime;
    out_result->head = s->head_identity;
    out_result->controller = s->motor_identity;
    (void)snprintf(out_result->realtime_note, sizeof out_result->realtime_note, "%s",
                   s->realtime_note);
    return st;
}
