/* The recorded events of the controller, and the answers of a healthy one: see replay.h. */
#include "capture/backends/replay.h"
#include "capture/event_wire.h"
#include "firmware/shared/faultcode.h"
#include "site/frame_row.h"

#include <stdlib.h>
#include <string.h>

enum { BLOCK_MS = 1, AT_ONCE = 8, BEFORE_FRAME_NS = 2000000000 };

/* An event with the host time at which it is known. */
struct dated {
    struct index_event event;
    int64_t t_ns;
};

struct motor_replay {
    struct motor motor;
    struct replay *replay;
    struct dated *event; /* [count] */
    size_t count, capacity;
    int64_t *frame_ns; /* [frames]: when the photographs were taken */
    size_t frames;
    int64_t sweep_end_ns;
    int64_t host_minus_controller_ns;
    struct motor_status status;
    int64_t arrives_ns; /* of the last move */
};

static struct motor_replay *of(struct motor *motor) {
    return (struct motor_replay *)motor;
}

static enum st replay_identify(struct motor *motor, struct motor_identity *out_identity,
                               struct errctx *err) {
    struct motor_replay *m = of(motor);
    (void)err;
    *out_identity = (struct motor_identity){.board_id = 3, /* a simulation */
                                            .uptime_ns = replay_now_ns(m->replay) -
                                                         m->host_minus_controller_ns};
    return ST_OK;
}

/* The newest event that is known now; NULL: none. */
static const struct dated *newest(const struct motor_replay *m, int64_t now_ns) {
    size_t low = 0, high = m->count;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (m->event[middle].t_ns <= now_ns)
            low = middle + 1;
        else
            high = middle;
    }
    return low ? &m->event[low - 1] : NULL;
}

static enum st replay_status(struct motor *motor, struct motor_status *out_status,
                             struct errctx *err) {
    struct motor_replay *m = of(motor);
    struct motor_status *s = &m->status;
    (void)err;
    s->t_ns = replay_now_ns(m->replay);
    s->state = s->laser_on ? CTLSTATE_LASER : s->motors_on ? CTLSTATE_READY : CTLSTATE_IDLE;
    s->mirror_in_range = s->mirror_rps > 0;
    s->axis[MOTOR_PAN].moving = s->t_ns < m->arrives_ns;
    if (s->scan_state == SCANSTATE_SWEEP) {
        const struct dated *event = newest(m, s->t_ns);
        if (event)
            s->axis[MOTOR_PAN].steps = (int32_t)event->event.pan_steps;
        s->axis[MOTOR_PAN].moving = true;
        if (s->t_ns >= m->sweep_end_ns)
            s->scan_state = SCANSTATE_DONE;
    }
    *out_status = *s;
    return ST_OK;
}

static enum st replay_enable(struct motor *motor, bool on, struct errctx *err) {
    struct motor_replay *m = of(motor);
    (void)err;
    m->status.motors_on = on;
    if (!on) { /* the end: nothing of the recording is left behind */
        m->status.laser_on = false;
        m->status.mirror_rps = 0;
        replay_skip_to(m->replay, m->replay->last_ns);
    }
    return ST_OK;
}

static enum st replay_home(struct motor *motor, enum motor_axis axis, struct errctx *err) {
    (void)err;
    of(motor)->status.axis[axis].homed = true;
    of(motor)->status.axis[axis].steps = 0;
    return ST_OK;
}

/* After the sweep a move lasts until shortly before the next photograph. */
static enum st replay_move(struct motor *motor, enum motor_axis axis, int32_t steps,
                           struct errctx *err) {
    struct motor_replay *m = of(motor);
    int64_t now_ns = replay_now_ns(m->replay);
    (void)err;
    m->status.axis[axis].steps = steps;
    m->arrives_ns = now_ns;
    for (size_t i = 0; i < m->frames && m->status.scan_state != SCANSTATE_SWEEP; i++)
        if (m->frame_ns[i] > now_ns && now_ns >= m->sweep_end_ns) {
            m->arrives_ns = m->frame_ns[i] - BEFORE_FRAME_NS;
            break;
        }
    return ST_OK;
}

static enum st replay_stop(struct motor *motor, struct errctx *err) {
    struct motor_replay *m = of(motor);
    (void)err;
    m->arrives_ns = 0;
    m->status.scan_state = SCANSTATE_OFF;
    return ST_OK;
}

static enum st replay_mirror(struct motor *motor, double speed_rps, struct errctx *err) {
    if (!(speed_rps >= 0))
        return errctx_set(err, ST_INVALID, "a mirror speed of %g rev/s makes no sense", speed_rps);
    of(motor)->status.mirror_rps = speed_rps;
    return ST_OK;
}

static enum st replay_laser(struct motor *motor, bool on, struct errctx *err) {
    struct motor_replay *m = of(motor);
    if (on && !(m->status.motors_on && m->status.mirror_rps > 0))
        return errctx_set(err, ST_DEVICE, "the laser needs the motors on and the mirror turning");
    m->status.laser_on = on;
    return ST_OK;
}

static enum st replay_scan_program(struct motor *motor, const struct motor_scan *scan,
                                   struct errctx *err) {
    (void)motor;
    return scan->to_steps > scan->from_steps
               ? ST_OK
               : errctx_set(err, ST_INVALID, "a sweep goes from a lower to a higher position");
}

static enum st replay_scan_run(struct motor *motor, bool on, struct errctx *err) {
    struct motor_replay *m = of(motor);
    if (on && !m->status.motors_on)
        return errctx_set(err, ST_DEVICE, "the motors are off");
    m->status.scan_state = on ? SCANSTATE_SWEEP : SCANSTATE_OFF;
    return ST_OK;
}

static enum st replay_camera_program(struct motor *motor, const struct motor_camera *camera,
                                     struct errctx *err) {
    (void)motor;
    (void)camera;
    (void)err;
    return ST_OK;
}

static enum st replay_trigger(struct motor *motor, struct errctx *err) {
    (void)err;
    of(motor)->status.triggers++;
    return ST_OK;
}

static enum st replay_read_events(struct motor *motor, uint64_t from,
                                  struct index_event *out_events, size_t capacity,
                                  size_t *out_count, uint64_t *out_lost, struct errctx *err) {
    const struct motor_replay *m = of(motor);
    int64_t now_ns = replay_now_ns(m->replay);
    size_t first = 0, count = 0;
    (void)err;
    while (first < m->count && m->event[first].event.seq < from)
        first++;
    capacity = capacity < AT_ONCE ? capacity : AT_ONCE;
    while (count < capacity && first + count < m->count && m->event[first + count].t_ns <= now_ns &&
           (!count || m->event[first + count].event.seq == out_events[count - 1].seq + 1)) {
        out_events[count] = m->event[first + count].event;
        count++;
    }
    *out_count = count;
    /* what came before the recording is gone: a reader may begin at 0 */
    *out_lost = count ? out_events[0].seq - from
                : first < m->count && !first && m->event[0].event.seq > from
                    ? m->event[0].event.seq - from
                    : 0;
    return ST_OK;
}

static enum st replay_host_timeout(struct motor *motor, unsigned timeout_ms, struct errctx *err) {
    (void)motor;
    return timeout_ms >= 50 && timeout_ms <= 5000
               ? ST_OK
               : errctx_set(err, ST_INVALID, "a time-out of %u ms is not within 50 to 5000 ms",
                            timeout_ms);
}

static enum st replay_nothing(struct motor *motor, struct errctx *err) {
    (void)motor;
    (void)err;
    return ST_OK;
}

static enum st replay_clear_fault(struct motor *motor, unsigned fault, struct errctx *err) {
    (void)motor;
    return errctx_set(err, ST_INVALID, "there is no fault %u to be cleared", fault);
}

static void close_motor(struct motor *motor) {
    struct motor_replay *m = of(motor);
    free(m->event);
    free(m->frame_ns);
    free(m);
}

static const struct motor_ops replay_ops = {.identify = replay_identify,
                                            .status = replay_status,
                                            .enable = replay_enable,
                                            .home = replay_home,
                                            .move = replay_move,
                                            .stop = replay_stop,
                                            .mirror = replay_mirror,
                                            .laser = replay_laser,
                                            .scan_program = replay_scan_program,
                                            .scan_run = replay_scan_run,
                                            .camera_program = replay_camera_program,
                                            .trigger = replay_trigger,
                                            .read_events = replay_read_events,
                                            .host_timeout = replay_host_timeout,
                                            .kick = replay_nothing,
                                            .clear_fault = replay_clear_fault,
                                            .save = replay_nothing,
                                            .close = close_motor};

/* --- what the recording holds ----------------------------------------------------------------- */

static enum st keep_event(struct motor_replay *m, const uint8_t *bytes, int64_t t_ns,
                          struct errctx *err) {
    if (m->count == m->capacity) {
        size_t capacity = m->capacity ? 2 * m->capacity : 1024;
        struct dated *event = realloc(m->event, capacity * sizeof *event);
        if (!event)
            return errctx_set(err, ST_NOMEM, "no memory for the events of a recording");
        m->event = event;
        m->capacity = capacity;
    }
    struct dated e = {event_wire_decode(bytes), t_ns};
    if (e.event.flags & INDEX_EVENT_SWEEP)
        m->sweep_end_ns = t_ns;
    m->event[m->count++] = e;
    return ST_OK;
}

static enum st load_events(struct motor_replay *m, struct errctx *err) {
    struct replay_reader reader;
    enum st st = replay_reader_open(&reader, m->replay, "index", "idxevent.1", err);
    while (!st) {
        const uint8_t *bytes;
        size_t size;
        int64_t t_ns;
        st = replay_reader_peek(&reader, EVENT_WIRE_BYTES, &bytes, &size, &t_ns, err);
        if (!st && size < EVENT_WIRE_BYTES)
            st = errctx_set(err, ST_DAMAGED, "recording: an event of the controller is cut");
        if (!st)
            st = keep_event(m, bytes, t_ns, err);
        if (!st)
            replay_reader_take(&reader, size);
    }
    bool ended = reader.ended;
    replay_reader_close(&reader);
    return st == ST_NOT_FOUND && ended ? ST_OK : st;
}

static enum st load_frames(struct motor_replay *m, struct errctx *err) {
    enum { FRAMES_MAX = 4096 };
    struct site *site = NULL;
    int64_t after = 0;
    size_t got = 1;
    enum st st = site_open(m->replay->site_path, SITE_READ, &site, err);
    m->frame_ns = calloc((size_t)FRAMES_MAX, sizeof *m->frame_ns);
    if (!st && !m->frame_ns)
        st = errctx_set(err, ST_NOMEM, "no memory for a recording");
    while (!st && got && m->frames < FRAMES_MAX) {
        struct frame_row row;
        st = frame_row_list(site, m->replay->station_id, after, &row, 1, &got, err);
        if (!st && got) {
            m->frame_ns[m->frames++] = row.t_ns;
            after = row.id;
        }
    }
    (void)site_close(site, NULL);
    return st;
}

enum st motor_replay_open(struct replay *replay, struct motor **out_motor, struct errctx *err) {
    struct motor_replay *m = calloc(1, sizeof *m);
    if (!m)
        return errctx_set(err, ST_NOMEM, "no memory for a recording");
    m->motor = (struct motor){.ops = &replay_ops, .block_ms = BLOCK_MS};
    m->replay = replay;
    m->sweep_end_ns = replay->head_last_ns;
    for (int i = 0; i < MOTOR_AXES; i++)
        m->status.axis[i].homed = true;
    m->status.inputs = 7; /* all chains closed */
    m->status.host_alive = true;
    enum st st = load_events(m, err);
    if (!st)
        st = load_frames(m, err);
    if (m->count)
        m->host_minus_controller_ns = m->event[0].t_ns - m->event[0].event.t_ns;
    if (st)
        close_motor(&m->motor);
    else
        *out_motor = &m->motor;
    return st;
}
