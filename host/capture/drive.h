/* The scan's course: homing, tilt, mirror, laser, sweep, photographs, rest. A state machine that is
 * stepped: each step does at most a few requests to the controller, each of which is bounded, and
 * no state lasts longer than its bound. Stops in order (laser first) on a request, on the
 * controller's fault, on silence, and whenever anything fails.
 *
 * Threads: one, the plan's. It owns motor and camera. */
#ifndef SC_CAPTURE_DRIVE_H
#define SC_CAPTURE_DRIVE_H

#include "base/st.h"
#include "capture/recorder.h"
#include "capture/scan_plan.h"
#include "device/cart_devices.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum drive_phase {
    DRIVE_CONNECT,
    DRIVE_HOME, /* pan and tilt, where not homed */
    DRIVE_TILT, /* to the sweep's tilt; the mirror spins up meanwhile */
    DRIVE_SPIN,
    DRIVE_APPROACH, /* laser on, to the sweep's start */
    DRIVE_SWEEP,
    DRIVE_DARK, /* laser off, mirror coasts; the last events are read */
    DRIVE_AIM,  /* to the next photograph */
    DRIVE_SETTLE,
    DRIVE_EXPOSE,
    DRIVE_VERIFY, /* homes the pan again: how many steps were lost during the scan */
    DRIVE_PARK,
    DRIVE_DONE,
    DRIVE_STOPPED /* laser and motors off, not all of the plan done */
};

/* "homing", "sweep", ... for people. */
const char *drive_phase_name(enum drive_phase phase);

struct drive_config {
    const struct cart_devices *devices;
    const struct scan_plan *plan;
    struct recorder *recorder;
    int64_t camera_calib_id; /* of the frames; 0: none */
};

struct drive {
    struct drive_config config;
    enum drive_phase phase;
    int step; /* within the phase */
    int64_t now_ns, phase_since_ns, good_since_ns;
    int64_t next_status_ns, next_events_ns, next_clock_ns;
    /* the controller */
    struct motor_status status; /* the newest */
    bool status_known;          /* there was one */
    bool has_status;            /* it is newer than the last command */
    int64_t answered_ns;        /* last good answer */
    uint64_t next_event;
    bool events_known; /* what happened before the session has been skipped */
    uint32_t events_seen, controller_resets;
    int64_t clock_offset_ns; /* host minus controller, from the last pair */
    bool clock_known;
    int32_t home_axis; /* being homed, or -1 */
    bool verified;
    int32_t lost_steps; /* of the pan, between the two homings */
    /* the head */
    bool head_wanted; /* it should be listened to; the session sees to it, and sets */
    bool head_on;
    uint64_t head_transfers; /* set by the session: that came */
    uint64_t head_packets, head_damaged, head_came;
    int64_t head_heard_ns;
    /* photographs */
    uint32_t pass, shot; /* the next */
    uint32_t photos, photos_missed;
    int64_t shot_after_ns;
    /* the end */
    bool stopping, stop_sent;
    bool power_gone; /* there is nobody left to stop */
    int64_t stop_since_ns;
    enum st why; /* what ended it; ST_OK */
    struct errctx why_err;
    char warning[160]; /* the newest; "" */
    uint32_t warnings;
};

void drive_init(struct drive *drive, const struct drive_config *config);

/* One step at host time now. Never fails: what went wrong is in `why`, and the cart is brought to
 * rest. Done when drive_ended(). */
void drive_step(struct drive *drive, int64_t now_ns);

/* Asks for an orderly stop; the first reason stays. */
void drive_stop(struct drive *drive, enum st why, const char *text);

static inline bool drive_ended(const struct drive *drive) {
    return drive->phase == DRIVE_DONE || drive->phase == DRIVE_STOPPED;
}

/* Part of the plan that is done, 0 to 1. */
double drive_progress(const struct drive *drive);

#ifdef __cplusplus
}
#endif
#endif
