#include "app/controller_text.h"

#include "base/json.h"
#include "firmware/shared/faultcode.h"
#include "firmware/shared/regmap.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

const char *controller_text_advice(unsigned fault) {
    switch ((enum faultcode)fault) {
    case FAULT_NONE:
    case FAULT_COUNT_:
        return "";
    case FAULT_ESTOP:
        return "Release the emergency stop, then clear the fault.";
    case FAULT_INTERLOCK:
        return "Close the laser interlock (connector and key), then clear the fault.";
    case FAULT_DOOR:
        return "Close the cover of the head, then clear the fault.";
    case FAULT_OVER_TEMP:
        return "Let the head cool down and free its air inlets, then clear the fault.";
    case FAULT_TEMP_SENSOR:
        return "Check the temperature sensor's plug; without it the laser stays off.";
    case FAULT_PAN_LIMIT:
    case FAULT_TILT_LIMIT:
        return "Turn the axis off the switch by hand, clear the fault, then home it.";
    case FAULT_MIRROR_SLOW:
    case FAULT_MIRROR_FAST:
        return "Check that the mirror turns freely and its index sensor is clean, then clear the "
               "fault.";
    case FAULT_MIRROR_STALL:
        return "Check that the mirror turns freely, its motor is plugged in and the index sensor "
               "is "
               "clean, then clear the fault.";
    case FAULT_HOST_SILENT:
        return "The program stopped talking to the controller: check the cable, clear the fault.";
    case FAULT_STACK:
    case FAULT_LOOP:
        return "An error in the controller's firmware: note what was done, report it, clear the "
               "fault.";
    case FAULT_CLOCK:
        return "The controller's clock failed: switch it off and on; if it comes back, replace the "
               "board.";
    case FAULT_PAN_HOMING:
    case FAULT_TILT_HOMING:
        return "Check that the axis turns and that its home switch is plugged in, clear, home "
               "again.";
    case FAULT_LASER_STUCK:
        return "DANGER: the laser may be on. Pull the laser's key switch; replace its driver.";
    case FAULT_WATCHDOG:
        return "The controller restarted by itself: note what was done, report it, clear the "
               "fault.";
    }
    return "This program does not know that fault: update it.";
}

static const char *board_name(unsigned id) {
    static const char *const names[] = {"unknown board", "cart_f405", "qemu_mps2", "simulated"};
    return id < sizeof names / sizeof names[0] ? names[id] : names[0];
}

static const char *state_name(unsigned state) {
    static const char *const names[] = {"idle", "ready", "laser on", "fault"};
    return state < sizeof names / sizeof names[0] ? names[state] : "unknown";
}

static const char *reset_name(unsigned cause) {
    static const char *const names[] = {"power-up", "reset pin", "watchdog",
                                        "software", "brown-out", "unknown reset"};
    return names[cause < RESETCAUSE_UNKNOWN ? cause : RESETCAUSE_UNKNOWN];
}

static const char *commission_name(unsigned state) {
    static const char *const names[] = {
        "defaults, nothing stored: the laser stays off until they are saved", "stored",
        "stored copy damaged, defaults used: commission again", "changed and not saved"};
    return state < sizeof names / sizeof names[0] ? names[state] : "unknown";
}

/* --- status
 * --------------------------------------------------------------------------------------------- */

static void put_axis(struct json *json, const char *name, const struct motor_axis_status *axis) {
    struct cJSON *object = json_object(json, NULL, name);
    json_integer(json, object, "steps", axis->steps);
    json_number(json, object, "velocity_steps_s", axis->velocity);
    json_boolean(json, object, "moving", axis->moving);
    json_boolean(json, object, "homed", axis->homed);
    json_boolean(json, object, "homing", axis->homing);
    json_boolean(json, object, "limit_min", axis->limit_min);
    json_boolean(json, object, "limit_max", axis->limit_max);
    json_integer(json, object, "home_error_steps", axis->home_error_steps);
}

static void put_state(struct json *json, const struct motor_status *status) {
    json_text(json, NULL, "state", state_name(status->state));
    struct cJSON *fault = json_object(json, NULL, "fault");
    json_integer(json, fault, "code", status->fault);
    json_text(json, fault, "name", faultcode_name((int)status->fault));
    json_text(json, fault, "text", faultcode_text((int)status->fault));
    json_integer(json, fault, "context", status->fault_context);
    json_text(json, fault, "context_means", faultcode_context((int)status->fault));
    json_text(json, fault, "advice", controller_text_advice(status->fault));
    struct cJSON *present = json_array(json, NULL, "causes_present");
    for (int code = 1; code < FAULT_COUNT_; code++)
        if (status->conditions >> code & 1u)
            json_text(json, present, NULL, faultcode_name(code));
    put_axis(json, "pan", &status->axis[MOTOR_PAN]);
    put_axis(json, "tilt", &status->axis[MOTOR_TILT]);
    json_number(json, NULL, "mirror_rev_s", status->mirror_rps);
    json_boolean(json, NULL, "mirror_in_range", status->mirror_in_range);
    json_boolean(json, NULL, "motors_on", status->motors_on);
    json_boolean(json, NULL, "laser_on", status->laser_on);
    json_number(json, NULL, "temperature_c", status->temperature_c);
}

static enum st status_json(const struct motor_identity *identity, const struct motor_status *status,
                           struct errctx *err) {
    struct json json;
    char version[32];
    (void)snprintf(version, sizeof version, "%u.%u.%u", identity->fw_major, identity->fw_minor,
                   identity->fw_patch);
    json_init_object(&json);
    json_text(&json, NULL, "board", board_name(identity->board_id));
    json_integer(&json, NULL, "serial", identity->serial);
    json_text(&json, NULL, "firmware", version);
    json_integer(&json, NULL, "map_version", identity->map_version);
    json_text(&json, NULL, "reset_cause", reset_name(identity->reset_cause));
    json_number(&json, NULL, "uptime_s", (double)identity->uptime_ns * 1e-9);
    json_integer(&json, NULL, "commission_state", identity->commission_state);
    put_state(&json, status);
    json_integer(&json, NULL, "frames_ok", status->frames_ok);
    json_integer(&json, NULL, "frames_bad", status->frames_bad);
    json_integer(&json, NULL, "stack_free", status->stack_free);
    json_integer(&json, NULL, "tick_max_us", status->tick_max_us);
    json_integer(&json, NULL, "loop_max_us", status->loop_max_us);
    enum st st = json_write(&json, stdout, err);
    json_fini(&json);
    return st;
}

static void print_axis(const char *name, const struct motor_axis_status *axis) {
    (void)printf("%-10s %d steps, %s%s%s%s", name, axis->steps, axis->homed ? "homed" : "not homed",
                 axis->homing   ? ", homing"
                 : axis->moving ? ", moving"
                                : "",
                 axis->limit_min ? ", at its negative limit switch" : "",
                 axis->limit_max ? ", at its positive limit switch" : "");
    if (axis->home_error_steps)
        (void)printf(", %d steps lost before the last homing", axis->home_error_steps);
    (void)printf("\n");
}

static const char *chain(uint16_t inputs, enum regmap_discrete bit) {
    return (unsigned)inputs >> bit & 1u ? "closed" : "OPEN";
}

static void print_fault(const struct motor_status *status) {
    if (status->state == CTLSTATE_FAULT) {
        (void)printf("FAULT %-4u %s (%s: %d), latched %.1f s after start\n", status->fault,
                     faultcode_text((int)status->fault), faultcode_context((int)status->fault),
                     status->fault_context, (double)status->fault_t_ns * 1e-9);
        (void)printf("what to do %s\n", controller_text_advice(status->fault));
    }
    for (int code = 1; code < FAULT_COUNT_; code++)
        if (status->conditions >> code & 1u)
            (void)printf("present    %s\n", faultcode_text(code));
}

enum st controller_text_status(const struct motor_identity *identity,
                               const struct motor_status *status, bool json, struct errctx *err) {
    if (json)
        return status_json(identity, status, err);
    (void)printf("controller %s, serial %" PRIu32 ", firmware %u.%u.%u (%08" PRIx32 ")\n",
                 board_name(identity->board_id), identity->serial, identity->fw_major,
                 identity->fw_minor, identity->fw_patch, identity->build_id);
    (void)printf("up         %.1f s since %s\n", (double)identity->uptime_ns * 1e-9,
                 reset_name(identity->reset_cause));
    (void)printf("settings   %s\n", commission_name(identity->commission_state));
    (void)printf("state      %s; motors %s, laser %s\n", state_name(status->state),
                 status->motors_on ? "on" : "off", status->laser_on ? "ON" : "off");
    print_fault(status);
    (void)printf("chains     emergency stop %s, interlock %s, cover %s\n",
                 chain(status->inputs, REGMAP_DISCRETE_estop_closed),
                 chain(status->inputs, REGMAP_DISCRETE_interlock_closed),
                 chain(status->inputs, REGMAP_DISCRETE_door_closed));
    print_axis("pan", &status->axis[MOTOR_PAN]);
    print_axis("tilt", &status->axis[MOTOR_TILT]);
    (void)printf("mirror     %.3f rev/s%s\n", status->mirror_rps,
                 status->mirror_in_range ? ", in its range" : "");
    (void)printf("board      %.1f C, stack free %u bytes, longest tick %u us\n",
                 status->temperature_c, status->stack_free, status->tick_max_us);
    (void)printf("line       %" PRIu32 " requests, %" PRIu32 " broken frames\n", status->frames_ok,
                 status->frames_bad);
    return ST_OK;
}

/* --- motions
 * -------------------------------------------------------------------------------------------- */

enum st controller_text_axes(const char *done, const struct motor_status *status, bool json,
                             struct errctx *err) {
    if (!json) {
        print_axis("pan", &status->axis[MOTOR_PAN]);
        print_axis("tilt", &status->axis[MOTOR_TILT]);
        return ST_OK;
    }
    struct json out;
    json_init_object(&out);
    json_text(&out, NULL, "done", done);
    put_axis(&out, "pan", &status->axis[MOTOR_PAN]);
    put_axis(&out, "tilt", &status->axis[MOTOR_TILT]);
    enum st st = json_write(&out, stdout, err);
    json_fini(&out);
    return st;
}

void controller_text_progress(const struct motor_status *status) {
    if (!isatty(STDERR_FILENO))
        return;
    (void)fprintf(stderr, "\rpan %8d  tilt %8d  (Ctrl-C stops) ", status->axis[MOTOR_PAN].steps,
                  status->axis[MOTOR_TILT].steps);
    (void)fflush(stderr);
}

void controller_text_progress_end(void) {
    if (isatty(STDERR_FILENO))
        (void)fprintf(stderr, "\r\033[K");
}

/* --- clear
 * ---------------------------------------------------------------------------------------------- */

enum st controller_text_causes(const struct motor_status *status, struct errctx *err) {
    char causes[400] = "";
    size_t used = 0;
    for (int code = 1; code < FAULT_COUNT_; code++) {
        if (!(status->conditions >> code & 1u))
            continue;
        int n = snprintf(causes + used, sizeof causes - used, "%s%s", used ? ", " : "",
                         faultcode_text(code));
        if (n < 0 || (size_t)n >= sizeof causes - used)
            break;
        used += (size_t)n;
    }
    if (!used)
        return errctx_set(err, ST_DEVICE, "fault %u (%s) cannot be cleared. %s", status->fault,
                          faultcode_text((int)status->fault),
                          controller_text_advice(status->fault));
    return errctx_set(err, ST_DEVICE, "fault %u cannot be cleared, still present: %s. %s",
                      status->fault, causes, controller_text_advice(status->fault));
}

enum st controller_text_cleared(unsigned fault, bool json, struct errctx *err) {
    if (!json) {
        if (fault)
            (void)printf("cleared: %s\n", faultcode_text((int)fault));
        else
            (void)printf("no fault to clear\n");
        return ST_OK;
    }
    struct json out;
    json_init_object(&out);
    json_integer(&out, NULL, "cleared", fault);
    json_text(&out, NULL, "text", faultcode_text((int)fault));
    enum st st = json_write(&out, stdout, err);
    json_fini(&out);
    return st;
}

enum st controller_text_saved(bool json, struct errctx *err) {
    if (!json) {
        (void)printf("commissioning values stored\n");
        return ST_OK;
    }
    struct json out;
    json_init_object(&out);
    json_boolean(&out, NULL, "saved", true);
    enum st st = json_write(&out, stdout, err);
    json_fini(&out);
    return st;
}

/* --- monitor
 * -------------------------------------------------------------------------------------------- */

void controller_text_count(struct controller_events *events, const struct index_event *event) {
    if (event->kind == INDEX_EVENT_STROBE) {
        events->strobes++;
        return;
    }
    events->indexes++;
    bool missed = event->flags & INDEX_EVENT_AFTER_MISSED;
    events->missed += missed;
    if (events->last_t_ns && !missed)
        events->last_turn_s = (double)(event->t_ns - events->last_t_ns) * 1e-9;
    events->last_t_ns = event->t_ns;
}

enum st controller_text_monitor(const struct motor_status *status,
                                const struct controller_events *events, uint64_t next, bool first,
                                bool json, struct errctx *err) {
    double rate = events->last_turn_s > 0 ? 1 / events->last_turn_s : 0;
    if (json) {
        struct json out;
        json_init_object(&out);
        put_state(&out, status);
        json_integer(&out, NULL, "events_next", (int64_t)next);
        json_integer(&out, NULL, "index_events", (int64_t)events->indexes);
        json_integer(&out, NULL, "strobe_events", (int64_t)events->strobes);
        json_integer(&out, NULL, "lost_events", (int64_t)events->lost);
        json_number(&out, NULL, "last_turn_rev_s", rate);
        enum st st = json_write(&out, stdout, err);
        json_fini(&out);
        (void)fflush(stdout);
        return st;
    }
    if (first)
        (void)printf(
            "state         pan     tilt   mirror  by index  indexes  strobes  lost  missed\n");
    (void)printf(
        "%-9s %7d%s %7d%s %7.3f  %8.3f %8" PRIu64 " %8" PRIu64 " %5" PRIu64 " %7" PRIu64 "%s%s\n",
        state_name(status->state), status->axis[MOTOR_PAN].steps,
        status->axis[MOTOR_PAN].homed ? " " : "?", status->axis[MOTOR_TILT].steps,
        status->axis[MOTOR_TILT].homed ? " " : "?", status->mirror_rps, rate, events->indexes,
        events->strobes, events->lost, events->missed, status->state == CTLSTATE_FAULT ? "  " : "",
        status->state == CTLSTATE_FAULT ? faultcode_text((int)status->fault) : "");
    (void)fflush(stdout);
    return ST_OK;
}
