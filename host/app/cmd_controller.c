/* `scancart controller`: the cart's controller for the technician at the bench. */
#include "app/app.h"
#include "app/commands.h"
#include "app/controller_text.h"
#include "base/clock.h"
#include "capture/backends/motor_modbus.h"
#include "capture/board_config.h"
#include "firmware/shared/faultcode.h"

#include <inttypes.h>
#include <limits.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static const char about[] =
    "Talks to the cart's controller over its serial line.\n\n"
    "  status   who it is, what it does, a fault in words and what to do about it\n"
    "  home     finds the zero of pan and tilt (they move!)\n"
    "  move     moves pan or tilt to a position in steps (they move!); the axis must be homed\n"
    "  monitor  a line each interval, with the mirror's index events, until Ctrl-C\n"
    "  clear    clears a latched fault whose cause is gone\n"
    "  save     stores the commissioning values in the controller's flash; the laser needs them\n\n"
    "home and move switch the motors on for the time of the motion only; Ctrl-C stops it. The port "
    "is "
    "given by --port, or by the file of the board (--board), as boards/rpi5/board.yaml.\n\n"
    "Examples:\n"
    "  scancart controller status --port /dev/ttyUSB0\n"
    "  scancart controller home --board boards/rpi5/board.yaml\n"
    "  scancart controller move --pan 7000 --port /dev/ttyUSB0";

enum {
    POLL_MS = 100,
    MOTION_MAX_S = 600, /* longest homing or move */
    HOST_TIMEOUT_MS = 2000
};

struct options {
    char *port, *board, *parity, *axes; /* malloc'ed by popt */
    int baud, unit, timeout_ms, count;
    double interval_s;
    int pan, tilt;
    bool has_pan, has_tilt, json;
};

static volatile sig_atomic_t interrupted;

static void on_signal(int number) {
    (void)number;
    interrupted = interrupted ? 2 : 1;
}

static void catch_signals(void) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_signal;
    (void)sigaction(SIGINT, &action, NULL);
    (void)sigaction(SIGTERM, &action, NULL);
}

static void wait_ms(long ms) {
    struct timespec t = {ms / 1000, ms % 1000 * 1000000};
    (void)nanosleep(&t, NULL); /* a signal may end it early: that is wanted */
}

/* --- the line
 * ------------------------------------------------------------------------------------------- */

/* Board file first, then what the command line says. */
static enum st open_motor(const struct options *o, struct motor **out_motor, struct errctx *err) {
    struct motor_modbus_config line = motor_modbus_default();
    struct board_config *board = NULL;
    const char *parity = NULL;
    enum st st = ST_OK;
    if (o->board) {
        st = board_config_load(o->board, &board, err);
        if (st)
            return st;
        line.device = board->controller.device;
        line.baud = board->controller.baud;
        line.unit = board->controller.unit;
        line.timeout_ms = board->controller.timeout_ms;
        parity = board->controller.parity;
    }
    line.device = o->port ? o->port : line.device;
    line.baud = o->baud ? (unsigned)o->baud : line.baud;
    line.unit = o->unit ? (unsigned)o->unit : line.unit;
    line.timeout_ms = o->timeout_ms ? (unsigned)o->timeout_ms : line.timeout_ms;
    parity = o->parity ? o->parity : parity;
    if (parity)
        line.parity = !strcmp(parity, "none") ? 'N' : !strcmp(parity, "odd") ? 'O' : 'E';
    if (!line.device)
        st = errctx_set(err, ST_INVALID,
                        "%s names no device for the controller: add "
                        "controller.device, or give --port",
                        o->board);
    else
        st = motor_modbus_open(&line, out_motor, err);
    board_config_free(board);
    return st;
}

/* --- home and move
 * ------------------------------------------------------------------------------------------ */

/* A fault in one line, for a motion that it ended. */
static enum st say_fault(const struct motor_status *status, struct errctx *err) {
    return errctx_set(err, ST_DEVICE, "fault %u: %s. %s", status->fault,
                      faultcode_text((int)status->fault), controller_text_advice(status->fault));
}

static bool busy(const struct motor_axis_status *axis) {
    return axis->moving || axis->homing;
}

/* Waits until nothing moves, drawing a line on a terminal. Ctrl-C ramps down, so that the axes
 * still know where they are: ST_CANCELLED at rest; a second Ctrl-C does not wait for that. */
static enum st wait_for_rest(struct motor *motor, struct motor_status *out_status,
                             struct errctx *err) {
    int64_t end_ns = clock_now_ns() + (int64_t)MOTION_MAX_S * 1000000000;
    bool stopping = false;
    for (;;) {
        enum st st = motor->ops->status(motor, out_status, err);
        if (st)
            return st;
        if (out_status->state == CTLSTATE_FAULT)
            return say_fault(out_status, err);
        controller_text_progress(out_status);
        bool rest = !busy(&out_status->axis[MOTOR_PAN]) && !busy(&out_status->axis[MOTOR_TILT]);
        if (interrupted && (rest || interrupted > 1))
            return errctx_set(err, ST_CANCELLED, "stopped at pan %d, tilt %d",
                              out_status->axis[MOTOR_PAN].steps,
                              out_status->axis[MOTOR_TILT].steps);
        if (rest)
            return ST_OK;
        if (interrupted && !stopping)
            st = motor->ops->stop(motor, err);
        stopping = interrupted;
        if (st)
            return st;
        if (clock_now_ns() > end_ns)
            return errctx_set(err, ST_TIMEOUT, "the motion has not ended within %d s",
                              MOTION_MAX_S);
        wait_ms(POLL_MS);
    }
}

/* Motors on, the motion started by `start`, waited for, motors off whatever happened. */
static enum st with_motors(struct motor *motor, const struct options *o,
                           enum st (*start)(struct motor *, const struct options *,
                                            struct errctx *),
                           struct motor_status *out_status, struct errctx *err) {
    enum st st = motor->ops->status(motor, out_status, err);
    if (!st && out_status->state == CTLSTATE_FAULT)
        st = say_fault(out_status, err);
    if (!st)
        st = motor->ops->host_timeout(motor, HOST_TIMEOUT_MS, err);
    if (!st)
        st = motor->ops->enable(motor, true, err);
    if (st)
        return st;
    st = start(motor, o, err);
    if (!st)
        st = wait_for_rest(motor, out_status, err);
    controller_text_progress_end();
    struct errctx off_err;
    enum st off = motor->ops->enable(motor, false, &off_err);
    if (off && !st) {
        *err = off_err;
        st = off;
    }
    return st;
}

static bool wants(const struct options *o, enum motor_axis axis) {
    const char *only = o->axes ? o->axes : "both";
    return !strcmp(only, "both") || !strcmp(only, axis == MOTOR_PAN ? "pan" : "tilt");
}

static enum st start_home(struct motor *motor, const struct options *o, struct errctx *err) {
    enum st st = ST_OK;
    for (int axis = 0; axis < MOTOR_AXES && !st; axis++)
        if (wants(o, (enum motor_axis)axis))
            st = motor->ops->home(motor, (enum motor_axis)axis, err);
    return st;
}

static enum st start_move(struct motor *motor, const struct options *o, struct errctx *err) {
    struct motor_status status;
    enum st st = motor->ops->status(motor, &status, err);
    if (!st && ((o->has_pan && !status.axis[MOTOR_PAN].homed) ||
                (o->has_tilt && !status.axis[MOTOR_TILT].homed)))
        return errctx_set(
            err, ST_DEVICE,
            "the axis does not know where it is: run `scancart controller home` first");
    if (!st && o->has_pan)
        st = motor->ops->move(motor, MOTOR_PAN, o->pan, err);
    if (!st && o->has_tilt)
        st = motor->ops->move(motor, MOTOR_TILT, o->tilt, err);
    return st;
}

static enum st run_home(struct motor *motor, const struct options *o, struct errctx *err) {
    struct motor_status status;
    enum st st = with_motors(motor, o, start_home, &status, err);
    for (int axis = 0; axis < MOTOR_AXES && !st; axis++)
        if (wants(o, (enum motor_axis)axis) && !status.axis[axis].homed)
            st = errctx_set(err, ST_DEVICE, "%s has not found its home switch",
                            axis == MOTOR_PAN ? "pan" : "tilt");
    return st ? st : controller_text_axes("home", &status, o->json, err);
}

static enum st run_move(struct motor *motor, const struct options *o, struct errctx *err) {
    struct motor_status status;
    enum st st = with_motors(motor, o, start_move, &status, err);
    return st ? st : controller_text_axes("move", &status, o->json, err);
}

/* --- status, clear, monitor
 * --------------------------------------------------------------------------------- */

static enum st run_status(struct motor *motor, const struct options *o, struct errctx *err) {
    struct motor_identity identity;
    struct motor_status status;
    enum st st = motor->ops->identify(motor, &identity, err);
    if (!st)
        st = motor->ops->status(motor, &status, err);
    return st ? st : controller_text_status(&identity, &status, o->json, err);
}

static enum st run_clear(struct motor *motor, const struct options *o, struct errctx *err) {
    struct motor_status before;
    enum st st = motor->ops->status(motor, &before, err);
    if (st)
        return st;
    if (before.state == CTLSTATE_FAULT) {
        st = motor->ops->clear_fault(motor, before.fault, err);
        if (st == ST_DEVICE) { /* the cause is still there: say which */
            (void)motor->ops->status(motor, &before, NULL);
            return controller_text_causes(&before, err);
        }
        if (st)
            return st;
    }
    return controller_text_cleared(before.state == CTLSTATE_FAULT ? before.fault : 0, o->json, err);
}

/* The stored values count only if the controller says so afterwards. */
static enum st run_save(struct motor *motor, const struct options *o, struct errctx *err) {
    struct motor_identity identity;
    enum st st = motor->ops->save(motor, err);
    if (!st)
        st = motor->ops->identify(motor, &identity, err);
    if (!st && identity.commission_state != 1)
        st = errctx_set(err, ST_DEVICE,
                        "the controller did not keep its commissioning values (state %u): its "
                        "flash may be worn out",
                        identity.commission_state);
    return st ? st : controller_text_saved(o->json, err);
}

/* All events since *next; counts index events, strobes and lost ones. */
static enum st take_events(struct motor *motor, uint64_t *next, struct controller_events *events,
                           struct errctx *err) {
    struct index_event event[8];
    size_t count;
    do {
        uint64_t lost;
        enum st st = motor->ops->read_events(motor, *next, event, 8, &count, &lost, err);
        if (st)
            return st;
        *next += lost + count;
        events->lost += lost;
        for (size_t i = 0; i < count; i++)
            controller_text_count(events, &event[i]);
    } while (count == 8 && !interrupted);
    return ST_OK;
}

static enum st run_monitor(struct motor *motor, const struct options *o, struct errctx *err) {
    struct motor_identity identity;
    struct controller_events events = {0};
    uint64_t next = 0;
    enum st st = motor->ops->identify(motor, &identity, err);
    if (!st)
        st = take_events(motor, &next, &events, err);
    events = (struct controller_events){.last_t_ns = events.last_t_ns}; /* from now on */
    for (int i = 0; !st && !interrupted && (!o->count || i < o->count); i++) {
        struct motor_status status;
        st = motor->ops->status(motor, &status, err);
        if (!st)
            st = take_events(motor, &next, &events, err);
        if (!st)
            st = controller_text_monitor(&status, &events, next, i == 0, o->json, err);
        if (!o->count || i + 1 < o->count)
            wait_ms((long)(o->interval_s * 1000));
    }
    return st;
}

/* --- command line
 * ------------------------------------------------------------------------------------------- */

static const struct action {
    const char *name;
    enum st (*run)(struct motor *motor, const struct options *o, struct errctx *err);
} actions[] = {{"status", run_status},   {"home", run_home},   {"move", run_move},
               {"monitor", run_monitor}, {"clear", run_clear}, {"save", run_save}};

static const struct action *find_action(const char *name) {
    for (size_t i = 0; name && i < sizeof actions / sizeof actions[0]; i++)
        if (!strcmp(name, actions[i].name))
            return &actions[i];
    return NULL;
}

/* NULL if the options make sense together, else what is wrong. */
static const char *check_options(const struct options *o, const char *action) {
    if (!o->port && !o->board)
        return "needs --port DEVICE or --board FILE";
    if (!strcmp(action, "move") && !o->has_pan && !o->has_tilt)
        return "move needs --pan STEPS or --tilt STEPS";
    if (o->axes && strcmp(o->axes, "pan") && strcmp(o->axes, "tilt") && strcmp(o->axes, "both"))
        return "--axis is pan, tilt or both";
    if (o->parity && strcmp(o->parity, "none") && strcmp(o->parity, "even") &&
        strcmp(o->parity, "odd"))
        return "--parity is none, even or odd";
    if (!(o->interval_s >= 0.05 && o->interval_s <= 3600))
        return "--interval is 0.05 to 3600 seconds";
    if (o->baud < 0 || o->unit < 0 || o->timeout_ms < 0 || o->count < 0)
        return "numbers must not be negative";
    return NULL;
}

/* A line that was stopped on purpose is no failure of the program, but not what was asked for
 * either. */
static int finish(enum st st, const struct errctx *err) {
    return st ? app_fail("controller", err) : APP_DONE;
}

static int run(const struct action *action, const struct options *o) {
    struct motor *motor = NULL;
    struct errctx err = {0};
    catch_signals();
    enum st st = open_motor(o, &motor, &err);
    if (!st && action->run != run_status && action->run != run_monitor) {
        struct motor_identity identity; /* nothing is moved before it is known who moves */
        st = motor->ops->identify(motor, &identity, &err);
    }
    if (!st)
        st = action->run(motor, o, &err);
    motor_close(motor);
    return finish(st, &err);
}

int cmd_controller(int argc, const char **argv) {
    struct options o = {.interval_s = 0.5, .pan = INT_MIN, .tilt = INT_MIN};
    struct poptOption table[] = {
        {"port", 'p', POPT_ARG_STRING, &o.port, 0, "serial line of the controller", "DEVICE"},
        {"board", 'b', POPT_ARG_STRING, &o.board, 0, "board file that names the line", "FILE"},
        {"baud", 0, POPT_ARG_INT, &o.baud, 0, "bits a second (115200)", "N"},
        {"parity", 0, POPT_ARG_STRING, &o.parity, 0, "none, even (default) or odd", "P"},
        {"unit", 0, POPT_ARG_INT, &o.unit, 0, "Modbus address (1)", "N"},
        {"timeout", 0, POPT_ARG_INT, &o.timeout_ms, 0, "time for an answer (1000)", "MS"},
        {"axis", 0, POPT_ARG_STRING, &o.axes, 0, "home: pan, tilt or both (default)", "AXIS"},
        {"pan", 0, POPT_ARG_INT, &o.pan, 0, "move: pan position", "STEPS"},
        {"tilt", 0, POPT_ARG_INT, &o.tilt, 0, "move: tilt position", "STEPS"},
        {"interval", 'i', POPT_ARG_DOUBLE, &o.interval_s, 0, "monitor: time between lines (0.5)",
         "S"},
        {"count", 'n', POPT_ARG_INT, &o.count, 0, "monitor: lines, then end (0: until Ctrl-C)",
         "N"},
        POPT_TABLEEND};
    struct app_usage usage = {.name = "controller",
                              .synopsis =
                                  "status|home|move|monitor|clear|save --port DEVICE | --board "
                                  "FILE [--json]",
                              .about = about,
                              .options = table,
                              .out_json = &o.json};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st)
        return app_parse_exit(st);
    o.has_pan = o.pan != INT_MIN;
    o.has_tilt = o.tilt != INT_MIN;
    const char *name = poptGetArg(context);
    const struct action *action = find_action(name);
    const char *rest = poptGetArg(context);
    const char *wrong = action ? check_options(&o, name) : NULL;
    int exit_status;
    if (!action)
        exit_status = app_usage_error("controller", name ? "no action '%s'" : "what to do?", name);
    else if (rest)
        exit_status = app_usage_error("controller", "'%s' is one argument too many", rest);
    else if (wrong)
        exit_status = app_usage_error("controller", "%s", wrong);
    else
        exit_status = run(action, &o);
    (void)poptFreeContext(context);
    free(o.port);
    free(o.board);
    free(o.parity);
    free(o.axes);
    return exit_status;
}
