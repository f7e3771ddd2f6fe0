#include "twin/twin_drive.h"

#include "firmware/shared/faultcode.h"

#include <string.h>

static const int64_t silent_ns = 20000000000, faulty_ns = 60000000000, homing_ns = 120000000000;
static const double look_s = 0.2, soon_s = 0.04; /* between two looks at the controller */
enum { SCAN_SWEEP = 2, SCAN_DONE = 3, INTERRUPTIONS = 20, HOST_TIMEOUT_MS = 2000 };

/* A request's end. Silence is borne for a while: ST_OK, and *out_answered says which. */
static enum st bear(struct twin_drive *d, enum st st, bool *out_answered, struct errctx *err) {
    int64_t now_ns = cart_time_ns(d->cart);
    *out_answered = st == ST_OK;
    if (st != ST_TIMEOUT) {
        d->silent_since_ns = -1;
        return st;
    }
    if (d->silent_since_ns < 0)
        d->silent_since_ns = now_ns;
    return now_ns - d->silent_since_ns < silent_ns ? ST_OK : errctx_prefix(err, st, "twin");
}

/* Takes all events that the controller has. */
static enum st take_events(struct twin_drive *d, struct errctx *err) {
    for (;;) {
        struct index_event events[8];
        size_t count = 0;
        uint64_t lost = 0;
        bool answered;
        enum st st =
            d->motor->ops->read_events(d->motor, d->next_event, events, 8, &count, &lost, err);
        st = bear(d, st, &answered, err);
        if (st || !answered)
            return st;
        d->lost_events += lost;
        for (size_t i = 0; i < count && !st; i++) {
            d->next_event = events[i].seq + 1;
            st = d->event ? d->event(d->ctx, &events[i], err) : ST_OK;
        }
        if (st || count < 8)
            return st;
    }
}

static void note_sweeping(struct twin_drive *d, bool on) {
    if (on != d->is_sweeping && d->sweeping)
        d->sweeping(d->ctx, on);
    d->is_sweeping = on;
}

/* Lets some time pass, then looks at the controller. d->status is old if it did not answer. */
static enum st look(struct twin_drive *d, double seconds, struct errctx *err) {
    int64_t end_ns = cart_time_ns(d->cart) + (int64_t)(seconds * 1e9);
    enum st st = cart_advance(d->cart, end_ns, err);
    bool answered = false;
    struct motor_status status;
    if (!st)
        st = bear(d, d->motor->ops->status(d->motor, &status, err), &answered, err);
    if (!st && answered) {
        d->status = status;
        note_sweeping(d, status.scan_state == SCAN_SWEEP && status.laser_on);
    }
    if (!st)
        st = take_events(d, err);
    if (!st && d->passed)
        st = d->passed(d->ctx, cart_time_ns(d->cart), err);
    return st;
}

enum st twin_drive_wait(struct twin_drive *drive, double seconds, struct errctx *err) {
    int64_t end_ns = cart_time_ns(drive->cart) + (int64_t)(seconds * 1e9);
    enum st st = ST_OK;
    while (!st && cart_time_ns(drive->cart) < end_ns) {
        double left_s = (double)(end_ns - cart_time_ns(drive->cart)) * 1e-9;
        st = look(drive, left_s < look_s ? left_s : look_s, err);
    }
    return st;
}

/* Commands are the host's wishes; a controller in a fault refuses them: the loop around sees that.
 */
static enum st command(struct twin_drive *d, enum st st, struct errctx *err) {
    bool answered;
    if (st == ST_DEVICE)
        st = ST_TIMEOUT; /* refused: if it stays so, the loop around runs out of time */
    return bear(d, st, &answered, err);
}

static bool faulted(const struct twin_drive *d) {
    return d->status.state == CTLSTATE_FAULT;
}

/* One step towards: no fault, motors on, both axes homed. *out_ready says that all is so. */
static enum st make_ready(struct twin_drive *d, bool *out_ready, struct errctx *err) {
    const struct motor_ops *ops = d->motor->ops;
    const struct motor_axis_status *pan = &d->status.axis[MOTOR_PAN];
    const struct motor_axis_status *tilt = &d->status.axis[MOTOR_TILT];
    *out_ready = false;
    if (faulted(d)) {
        d->last_fault = d->status.fault;
        enum st st = ops->clear_fault(d->motor, d->status.fault, err);
        d->faults += st == ST_OK;
        return command(d, st == ST_INVALID ? ST_OK : st, err);
    }
    if (!d->status.motors_on) {
        enum st st = command(d, ops->host_timeout(d->motor, HOST_TIMEOUT_MS, err), err);
        return st ? st : command(d, ops->enable(d->motor, true, err), err);
    }
    enum st st = ST_OK;
    if (!pan->homed && !pan->homing)
        st = command(d, ops->home(d->motor, MOTOR_PAN, err), err);
    if (!st && !tilt->homed && !tilt->homing)
        st = command(d, ops->home(d->motor, MOTOR_TILT, err), err);
    *out_ready =
        pan->homed && tilt->homed && !pan->homing && !tilt->homing && !pan->moving && !tilt->moving;
    return st;
}

static enum st wait_ready(struct twin_drive *d, struct errctx *err) {
    int64_t start_ns = cart_time_ns(d->cart);
    bool ready = false;
    for (;;) {
        enum st st = look(d, soon_s, err);
        if (!st)
            st = make_ready(d, &ready, err);
        if (st || ready)
            return st;
        int64_t took_ns = cart_time_ns(d->cart) - start_ns;
        if (took_ns > (faulted(d) ? faulty_ns : homing_ns))
            return errctx_set(err, ST_DEVICE, "the controller %s (fault %u)",
                              faulted(d) ? "stays in a fault" : "cannot be made ready",
                              d->status.fault);
    }
}

enum st twin_drive_open(struct twin_drive *drive, struct errctx *err) {
    drive->silent_since_ns = -1;
    struct motor_identity who;
    enum st st = cart_motor(drive->cart, NULL, &drive->motor, err);
    if (!st)
        st = command(drive, drive->motor->ops->identify(drive->motor, &who, err), err);
    return st ? st : wait_ready(drive, err);
}

void twin_drive_close(struct twin_drive *drive) {
    motor_close(drive->motor);
    drive->motor = NULL;
}

enum st twin_drive_move(struct twin_drive *drive, int32_t pan_steps, int32_t tilt_steps,
                        struct errctx *err) {
    int64_t start_ns = cart_time_ns(drive->cart);
    for (;;) {
        const struct motor_axis_status *axis = drive->status.axis;
        bool there = axis[MOTOR_PAN].steps == pan_steps && axis[MOTOR_TILT].steps == tilt_steps &&
                     !axis[MOTOR_PAN].moving && !axis[MOTOR_TILT].moving;
        if (there && drive->status.motors_on)
            return ST_OK;
        enum st st = wait_ready(drive, err);
        if (!st)
            st = command(drive, drive->motor->ops->move(drive->motor, MOTOR_PAN, pan_steps, err),
                         err);
        if (!st)
            st = command(drive, drive->motor->ops->move(drive->motor, MOTOR_TILT, tilt_steps, err),
                         err);
        do {
            if (!st)
                st = look(drive, soon_s, err);
        } while (!st && (axis[MOTOR_PAN].moving || axis[MOTOR_TILT].moving));
        if (st)
            return st;
        if (cart_time_ns(drive->cart) - start_ns > homing_ns)
            return errctx_set(err, ST_DEVICE, "the pan-tilt unit does not arrive at %d, %d steps",
                              (int)pan_steps, (int)tilt_steps);
    }
}

/* Mirror in its range and laser on; *out_lit false after a fault. */
static enum st light_up(struct twin_drive *d, bool *out_lit, struct errctx *err) {
    const struct motor_ops *ops = d->motor->ops;
    enum st st = command(d, ops->mirror(d->motor, d->mirror_rps, err), err);
    int64_t start_ns = cart_time_ns(d->cart);
    int settled = 0; /* the first periods in range are still those of the run-up */
    while (!st && !faulted(d) && settled < 5) {
        st = look(d, look_s, err);
        double off = fabs(d->status.mirror_rps - d->mirror_rps) / d->mirror_rps;
        settled = d->status.mirror_in_range && off < 0.05 ? settled + 1 : 0;
        if (cart_time_ns(d->cart) - start_ns > faulty_ns)
            return errctx_set(err, ST_DEVICE, "the mirror does not reach %g rev/s", d->mirror_rps);
    }
    while (!st && !faulted(d) && !d->status.laser_on) {
        st = command(d, ops->laser(d->motor, true, err), err);
        if (!st)
            st = look(d, soon_s, err);
    }
    *out_lit = !st && !faulted(d) && d->status.laser_on;
    return st;
}

/* Runs the program until it is done, a fault comes, or it ends by itself. */
static enum st run_program(struct twin_drive *d, const struct motor_scan *scan, bool *out_done,
                           int32_t *out_reached, struct errctx *err) {
    const struct motor_ops *ops = d->motor->ops;
    bool started = false;
    enum st st = command(d, ops->scan_program(d->motor, scan, err), err);
    while (!st) {
        if (!started)
            st = command(d, ops->scan_run(d->motor, true, err), err);
        if (!st)
            st = look(d, started ? look_s : soon_s, err);
        started = started || d->status.scan_state == 1 || d->status.scan_state == SCAN_SWEEP;
        if (d->is_sweeping)
            *out_reached = d->status.axis[MOTOR_PAN].steps;
        *out_done = started && d->status.scan_state == SCAN_DONE;
        if (*out_done || faulted(d) || !d->status.motors_on || !d->status.laser_on)
            break;
    }
    note_sweeping(d, false);
    return st;
}

enum st twin_drive_sweep(struct twin_drive *drive, const struct motor_scan *scan,
                         int32_t overlap_steps, struct errctx *err) {
    const struct motor_ops *ops = drive->motor->ops;
    struct motor_scan part = *scan;
    int32_t way = scan->to_steps > scan->from_steps ? 1 : -1, reached = scan->from_steps;
    bool done = false;
    enum st st = ST_OK;
    for (int turn = 0; !st && !done && turn < INTERRUPTIONS; turn++) {
        bool lit = false;
        st = wait_ready(drive, err);
        if (!st) /* while the pan moves, the mirror runs up */
            st = command(drive, ops->mirror(drive->motor, drive->mirror_rps, err), err);
        if (!st)
            st = twin_drive_move(drive, part.from_steps, 0,
                                 err); /* homing leaves the tilt at its switch */
        if (!st)
            st = light_up(drive, &lit, err);
        if (!st && lit)
            st = run_program(drive, &part, &done, &reached, err);
        int32_t again = reached - way * overlap_steps;
        part.from_steps = (again - scan->from_steps) * way > 0 ? again : scan->from_steps;
    }
    if (!st)
        st = command(drive, ops->laser(drive->motor, false, err), err);
    if (!st)
        st = command(drive, ops->mirror(drive->motor, 0, err), err);
    if (!st && !done)
        st = errctx_set(err, ST_DEVICE, "the sweep was interrupted %d times (last: fault %u)",
                        INTERRUPTIONS, drive->last_fault);
    return st ? st : look(drive, look_s, err);
}

enum st twin_drive_trigger(struct twin_drive *drive, struct errctx *err) {
    enum st st = command(drive, drive->motor->ops->trigger(drive->motor, err), err);
    return st ? st : look(drive, 0.05, err);
}
