/* A capture session: one scan of one station, from opened devices into an open site.
 *
 * With the host's real clock: one thread for the head, one for the lines (SCHED_FIFO, pinned,
 * locked memory where allowed), one for the recorder, one for the plan; the caller's thread only
 * waits and reports. With a virtual clock one loop does the same in turn, through the same
 * functions: deterministic, and as fast as the machine can. */
#ifndef SC_CAPTURE_SESSION_H
#define SC_CAPTURE_SESSION_H

#include "capture/drive.h"
#include "capture/recorder.h"
#include "capture/scan_plan.h"
#include "device/cart_devices.h"
#include "site/site.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What a status line is made of; see status.h. */
struct session_status {
    enum drive_phase phase;
    int64_t t_ns;       /* host time */
    double elapsed_s;   /* since the start */
    double progress;    /* 0 to 1 */
    double remaining_s; /* NaN: not known */
    double pan_deg;     /* NaN: not known */
    double mirror_hz;
    bool laser_on;
    bool motors_on;
    unsigned controller_state; /* enum ctlstate */
    double ring_peak;          /* most of the head's ring in use so far, 0 to 1 */
    uint64_t free_bytes;
    uint32_t photos, photos_missed, photos_planned;
    struct recorder_counts counts;
    bool verified; /* the pan was homed again */
    int32_t lost_steps;
    uint32_t warnings;
    char warning[160]; /* the newest; "" */
};

struct session_config {
    const struct cart_devices *devices;
    const struct scan_plan *plan;
    const struct scan_plan *whole_plan; /* resumed: what was meant at first; NULL: plan */
    struct site *site;
    int64_t station_id;
    const char *device;       /* name of the streams */
    int64_t camera_calib_id;  /* 0: none */
    double sample_hz;         /* expected of the head; 0: as it says, else 25 000 */
    double ring_s;            /* time that the rings hold; 0: 2.5 */
    int64_t before_stream_id; /* resumed: see struct recorder_config */
    uint64_t free_bytes;      /* for tests: take this as the free space of the disk; 0: ask it */
    /* Called about once a second (host time) from the caller's thread; may be NULL. */
    void (*report)(void *ctx, const struct session_status *status);
    void *report_ctx;
};

struct session_result {
    struct session_status last;
    bool complete;           /* the whole plan was carried out */
    bool realtime;           /* priorities and locked memory were granted (virtual: false) */
    char realtime_note[240]; /* why not; "" */
    struct head_identity head;
    struct motor_identity controller;
};

/* Session on the heap: streams are added to the station, the head's ring is there. Checks the
 * devices: who they are, whether the head's protocol is known, whether the disk has room for the
 * forecast (ST_FULL with the figure). Nothing moves yet. */
struct session;
ST_MUST_CHECK enum st session_open(const struct session_config *config,
                                   struct session **out_session, struct errctx *err);

/* What the plan will take, at the head's own rate. */
const struct scan_plan_forecast *session_forecast(const struct session *session);

/* Runs to its end: ST_OK with the whole plan done; ST_CANCELLED after session_stop() or when the
 * simulated power went; else what ended it. In every case the laser and the motors are off (as far
 * as the controller answers), and all that came is stored (as far as the disk takes it). */
ST_MUST_CHECK enum st session_run(struct session *session, struct session_result *out_result,
                                  struct errctx *err);

/* Asks a running session to stop in order. Safe in a signal handler and from any thread. */
void session_stop(struct session *session);

void session_close(struct session *session); /* takes NULL */

#ifdef __cplusplus
}
#endif
#endif
