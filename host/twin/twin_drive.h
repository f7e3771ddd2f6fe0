/* Drives a simulated cart as a host does, through its controller's registers: ready, sweep,
 * positions, and again after a fault. Requests that a disturbed line swallows are made again; a
 * controller that has switched itself off is cleared, homed and set going where it stopped. */
#ifndef SC_TWIN_TWIN_DRIVE_H
#define SC_TWIN_TWIN_DRIVE_H

#include "device/motor.h"
#include "twin/cart.h"

struct twin_drive {
    /* set by the user before twin_drive_open(); the cart outlives it */
    struct cart *cart;
    double mirror_rps;
    void *ctx;
    /* Each event that the controller logged, in order; may be NULL. */
    enum st (*event)(void *ctx, const struct index_event *event, struct errctx *err);
    /* After each stretch of time; may be NULL. */
    enum st (*passed)(void *ctx, int64_t now_ns, struct errctx *err);
    /* A sweep begins or ends (or is interrupted); may be NULL. */
    void (*sweeping)(void *ctx, bool on);
    /* inside */
    struct motor *motor;
    struct motor_status status;
    uint64_t next_event, lost_events;
    int64_t silent_since_ns; /* -1: it answered */
    bool is_sweeping;
    unsigned faults; /* latched faults that were cleared */
    unsigned last_fault;
};

/* Opens the motor and makes the cart ready: motors on, pan and tilt homed. ST_TIMEOUT if the
 * controller is silent for 20 s, ST_DEVICE if it stays in a fault for 60 s; what else the motor
 * says. */
ST_MUST_CHECK enum st twin_drive_open(struct twin_drive *drive, struct errctx *err);
void twin_drive_close(struct twin_drive *drive); /* takes a zeroed one */

/* Lets time pass while the controller is kept company. */
ST_MUST_CHECK enum st twin_drive_wait(struct twin_drive *drive, double seconds, struct errctx *err);

/* Moves pan and tilt and waits until both stand. */
ST_MUST_CHECK enum st twin_drive_move(struct twin_drive *drive, int32_t pan_steps,
                                      int32_t tilt_steps, struct errctx *err);

/* Mirror up, tilt level, laser on, one sweep (scan->steps_per_turn as in device/motor.h), laser off, mirror
 * coasting. A sweep that a fault interrupts goes on a little before where it stopped, `overlap`
 * steps. ST_DEVICE after 20 interruptions. */
ST_MUST_CHECK enum st twin_drive_sweep(struct twin_drive *drive, const struct motor_scan *scan,
                                       int32_t overlap_steps, struct errctx *err);

/* One camera trigger, and 50 ms for its strobe. */
ST_MUST_CHECK enum st twin_drive_trigger(struct twin_drive *drive, struct errctx *err);

#endif
