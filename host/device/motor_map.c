#include "device/motor_map.h"

#include "base/clock.h"
#include "firmware/shared/faultcode.h"
#include "firmware/shared/idxevent.h"
#include "firmware/shared/mbframe.h"
#include "firmware/shared/regmap.h"

#include <math.h>
#include <stdlib.h>

struct motor_map {
    struct motor motor; /* first member */
    struct motor_line line;
    uint64_t revolution; /* last one seen, to unwrap the next */
};

static struct motor_map *map_of(struct motor *motor) {
    return (struct motor_map *)motor;
}

/* Position of the last word of `last` in a block that starts at `first`, plus one. */
#define BLOCK(first, last)                                                                         \
    (unsigned)(REGMAP_ADDR_##last + REGMAP_WORDS_##last - REGMAP_ADDR_##first)

/* --- answers
 * --------------------------------------------------------------------------------------- */

/* A refused command: asks the controller why. */
static enum st refused(struct motor_map *map, const char *what, struct errctx *err) {
    uint16_t words[2];
    if (map->line.read(map->line.ctx, REGMAP_ADDR_refusal, 2, words, NULL))
        return errctx_set(err, ST_DEVICE, "the controller refused to %s", what);
    return errctx_set(err, ST_DEVICE, "the controller refused to %s: %s", what,
                      refusal_text(words[0]));
}

/* Turns the result of a line's call into a status; `what` completes "could not ...". */
static enum st judge(struct motor_map *map, int result, const char *what, struct errctx *err) {
    if (!result)
        return ST_OK;
    if (result < 0)
        return errctx_prefix(err, (enum st)result, "could not %s", what);
    switch ((enum mbexc)result) {
    case MBEXC_DEVICE:
    case MBEXC_BUSY:
        return refused(map, what, err);
    case MBEXC_VALUE:
        return errctx_set(err, ST_INVALID, "could not %s: the value is out of range", what);
    case MBEXC_FUNCTION:
    case MBEXC_ADDRESS:
        return errctx_set(err, ST_UNSUPPORTED,
                          "could not %s: the device does not know that register; it is no scancart "
                          "controller, or one with another register map",
                          what);
    case MBEXC_OK:
        break;
    }
    return errctx_set(err, ST_DAMAGED, "could not %s: the device answered exception %d", what,
                      result);
}

static enum st write_words(struct motor_map *map, uint16_t start, unsigned count,
                           const uint16_t *words, const char *what, struct errctx *err) {
    return judge(map, map->line.write(map->line.ctx, start, count, words, true, err), what, err);
}

static enum st write_coil(struct motor *motor, enum regmap_coil coil, bool on, const char *what,
                          struct errctx *err) {
    struct motor_map *map = map_of(motor);
    return judge(map, map->line.write_coil(map->line.ctx, (uint16_t)coil, on, true, err), what,
                 err);
}

/* --- reading
 * ----------------------------------------------------------------------------------------- */

static enum st map_identify(struct motor *motor, struct motor_identity *out_identity,
                            struct errctx *err) {
    struct motor_map *map = map_of(motor);
    enum { START = REGMAP_ADDR_map_version };
    uint16_t w[BLOCK(map_version, uptime_us)];
    int result = map->line.read(map->line.ctx, START, BLOCK(map_version, uptime_us), w, err);
    enum st st = judge(map, result, "read the identity", err);
    if (st)
        return st;
    struct motor_identity id = {.map_version = regmap_get_map_version(w, START),
                                .fw_major = regmap_get_fw_version(w, START) >> 8,
                                .fw_minor = regmap_get_fw_version(w, START) & 0xffu,
                                .fw_patch = regmap_get_fw_patch(w, START),
                                .board_id = regmap_get_board_id(w, START),
                                .serial = regmap_get_serial(w, START),
                                .build_id = regmap_get_build_id(w, START),
                                .reset_cause = regmap_get_reset_cause(w, START),
                                .commission_state = regmap_get_commission_state(w, START),
                                .uptime_ns = (int64_t)(regmap_get_uptime_us(w, START) * 1000)};
    if (id.map_version != REGMAP_VERSION)
        return errctx_set(err, ST_UNSUPPORTED,
                          "the controller has register map %u, this program knows %d: update the "
                          "older of the two",
                          id.map_version, REGMAP_VERSION);
    *out_identity = id;
    return ST_OK;
}

static int read_block(struct motor_map *map, uint16_t start, unsigned count,
                      struct regmap_input *out_values, struct errctx *err) {
    uint16_t words[128];
    int result = map->line.read(map->line.ctx, start, count, words, err);
    if (!result)
        (void)regmap_decode(regmap_inputs, REGMAP_INPUT_COUNT_, out_values, start, count, words);
    return result;
}

static struct motor_axis_status axis_status(int32_t steps, int32_t velocity, uint16_t flags,
                                            int32_t home_error) {
    return (struct motor_axis_status){.steps = steps,
                                      .velocity = velocity * 0.001,
                                      .moving = flags & 1u << 0,
                                      .homed = flags & 1u << 1,
                                      .homing = flags & 1u << 2,
                                      .limit_min = flags & 1u << 3,
                                      .limit_max = flags & 1u << 4,
                                      .home_switch = flags & 1u << 5,
                                      .home_error_steps = home_error};
}

static struct motor_status status_of(const struct regmap_input *in, const uint8_t *bits) {
    return (struct motor_status){
        .t_ns = clock_now_ns(),
        .state = in->state,
        .fault = in->fault_code,
        .fault_context = in->fault_context,
        .fault_t_ns = (int64_t)(in->fault_time_us * 1000),
        .fault_count = in->fault_count,
        .conditions = in->conditions,
        .inputs = in->safety_inputs,
        .temperature_c = in->temperature * 0.1,
        .axis = {axis_status(in->pan_actual, in->pan_velocity, in->pan_flags, in->pan_home_error),
                 axis_status(in->tilt_actual, in->tilt_velocity, in->tilt_flags,
                             in->tilt_home_error)},
        .mirror_rps = in->mirror_actual * 0.001,
        .mirror_in_range = bits[REGMAP_DISCRETE_mirror_in_range],
        .motors_on = bits[REGMAP_DISCRETE_motors_on],
        .laser_on = bits[REGMAP_DISCRETE_laser_on],
        .host_alive = bits[REGMAP_DISCRETE_host_alive],
        .index_missed = in->index_missed,
        .index_rejected = in->index_rejected,
        .scan_state = in->scan_state,
        .scan_lines = in->scan_lines,
        .scan_overruns = in->scan_overruns,
        .triggers = in->trigger_count,
        .strobes = in->strobe_count,
        .frames_ok = in->frames_ok,
        .frames_bad = in->frames_bad,
        .rx_overruns = in->rx_overruns,
        .tick_max_us = in->tick_max_us,
        .loop_max_us = in->loop_max_us,
        .stack_free = in->stack_free};
}

static enum st map_status(struct motor *motor, struct motor_status *out_status,
                          struct errctx *err) {
    struct motor_map *map = map_of(motor);
    struct regmap_input in = {0};
    uint8_t bits[REGMAP_DISCRETE_COUNT_];
    static const struct {
        uint16_t start;
        uint8_t count;
    } blocks[] = {{REGMAP_ADDR_state, BLOCK(state, safety_inputs)},
                  {REGMAP_ADDR_pan_actual, BLOCK(pan_actual, step_slips)},
                  {REGMAP_ADDR_mirror_actual, BLOCK(mirror_actual, index_rejected)},
                  {REGMAP_ADDR_scan_state, BLOCK(scan_state, scan_lines)},
                  {REGMAP_ADDR_trigger_count, BLOCK(trigger_count, strobe_time_us)},
                  {REGMAP_ADDR_frames_ok, BLOCK(frames_ok, stack_free)}};
    int result = 0;
    for (size_t i = 0; i < sizeof blocks / sizeof blocks[0] && !result; i++)
        result = read_block(map, blocks[i].start, blocks[i].count, &in, err);
    if (!result)
        result = map->line.read_discrete(map->line.ctx, 0, REGMAP_DISCRETE_COUNT_, bits, err);
    enum st st = judge(map, result, "read the status", err);
    if (st)
        return st;
    *out_status = status_of(&in, bits);
    if (map->line.now_ns)
        out_status->t_ns = map->line.now_ns(map->line.ctx);
    return ST_OK;
}

/* --- events
 * -------------------------------------------------------------------------------------------- */

/* The 64-bit number next to `near` whose low 32 bits are `low`. */
static uint64_t unwrap(uint64_t near, uint32_t low) {
    return near + (uint64_t)(int64_t)(int32_t)(low - (uint32_t)near);
}

static uint16_t flags_of(uint16_t wire) {
    static const struct {
        uint16_t wire, host;
    } pairs[] = {{IDXEVENT_PAN_MOVING, INDEX_EVENT_PAN_MOVING},
                 {IDXEVENT_TILT_MOVING, INDEX_EVENT_TILT_MOVING},
                 {IDXEVENT_PAN_HOMED, INDEX_EVENT_PAN_HOMED},
                 {IDXEVENT_TILT_HOMED, INDEX_EVENT_TILT_HOMED},
                 {IDXEVENT_PAN_POSITIVE, INDEX_EVENT_PAN_POSITIVE},
                 {IDXEVENT_PAN_TAKEN_UP, INDEX_EVENT_PAN_TAKEN_UP},
                 {IDXEVENT_LASER, INDEX_EVENT_LASER},
                 {IDXEVENT_SWEEP, INDEX_EVENT_SWEEP},
                 {IDXEVENT_MIRROR_OK, INDEX_EVENT_MIRROR_OK},
                 {IDXEVENT_AFTER_MISSED, INDEX_EVENT_AFTER_MISSED},
                 {IDXEVENT_OVERRUN, INDEX_EVENT_OVERRUN}};
    unsigned flags = 0;
    for (size_t i = 0; i < sizeof pairs / sizeof pairs[0]; i++)
        flags |= wire & pairs[i].wire ? pairs[i].host : 0u;
    return (uint16_t)flags;
}

static struct index_event event_of(struct motor_map *map, const struct idxevent *wire,
                                   uint64_t seq) {
    map->revolution = unwrap(map->revolution, wire->revolution);
    double phase = wire->pan_phase / 65536.0;
    return (struct index_event){.seq = seq,
                                .t_ns = (int64_t)(wire->time_us * 1000),
                                .revolution = map->revolution,
                                .pan_steps = wire->pan_steps +
                                             (wire->flags & IDXEVENT_PAN_POSITIVE ? phase : -phase),
                                .tilt_steps = wire->tilt_steps,
                                .kind = (uint16_t)(wire->flags & IDXEVENT_KIND),
                                .flags = flags_of(wire->flags)};
}

/* Header of the window against what was asked for: the number of the first record. */
static enum st check_window(const uint16_t *w, uint64_t from, uint64_t *out_first,
                            struct errctx *err) {
    enum { START = IDXEVENT_WINDOW_ADDR };
    uint32_t next = regmap_get_event_next(w, START), first = regmap_get_event_first(w, START);
    unsigned count = regmap_get_event_count(w, START);
    if ((int32_t)(next - (uint32_t)from) < 0)
        return errctx_set(
            err, ST_DAMAGED,
            "the controller has restarted: it counts %u events, fewer than seen before", next);
    if (count > IDXEVENT_WINDOW || regmap_get_event_record_size(w, START) != IDXEVENT_WORDS ||
        (count && (int32_t)(first - (uint32_t)from) < 0))
        return errctx_set(err, ST_DAMAGED, "the controller's event window makes no sense");
    *out_first = unwrap(from, first);
    return ST_OK;
}

static enum st map_read_events(struct motor *motor, uint64_t from, struct index_event *out_events,
                               size_t capacity, size_t *out_count, uint64_t *out_lost,
                               struct errctx *err) {
    struct motor_map *map = map_of(motor);
    uint16_t w[IDXEVENT_WINDOW_WORDS], wanted[2];
    regmap_store_U32(wanted, (uint32_t)from);
    int result = map->line.write_read(map->line.ctx, REGMAP_ADDR_event_from, 2, wanted,
                                      IDXEVENT_WINDOW_ADDR, IDXEVENT_WINDOW_WORDS, w, err);
    enum st st = judge(map, result, "read index events", err);
    uint64_t first = 0;
    if (!st)
        st = check_window(w, from, &first, err);
    if (st)
        return st;
    size_t count = regmap_get_event_count(w, IDXEVENT_WINDOW_ADDR);
    count = count < capacity ? count : capacity;
    for (size_t i = 0; i < count; i++) {
        struct idxevent wire = idxevent_decode(w + IDXEVENT_HEADER + i * IDXEVENT_WORDS);
        if (wire.seq != (uint32_t)(first + i))
            return errctx_set(err, ST_DAMAGED, "index event %u stands where %u belongs", wire.seq,
                              (uint32_t)(first + i));
        out_events[i] = event_of(map, &wire, first + i);
    }
    *out_count = count;
    *out_lost = count ? first - from : 0;
    return ST_OK;
}

/* --- commands
 * -------------------------------------------------------------------------------------------- */

static enum st map_enable(struct motor *motor, bool on, struct errctx *err) {
    return write_coil(motor, REGMAP_COIL_motor_enable, on,
                      on ? "switch the motors on" : "switch the motors off", err);
}

/* If the answer was lost, the repetition may find the homing under way: then it has been heard. */
static enum st map_home(struct motor *motor, enum motor_axis axis, struct errctx *err) {
    struct motor_map *map = map_of(motor);
    enum regmap_coil coil = axis == MOTOR_PAN ? REGMAP_COIL_home_pan : REGMAP_COIL_home_tilt;
    int result = map->line.write_coil(map->line.ctx, (uint16_t)coil, true, false, err);
    if (result == ST_TIMEOUT) {
        struct motor_status status;
        enum st st = map_status(motor, &status, err);
        if (st || status.axis[axis].homing)
            return st;
        result = map->line.write_coil(map->line.ctx, (uint16_t)coil, true, false, err);
    }
    return judge(map, result, axis == MOTOR_PAN ? "home the pan" : "home the tilt", err);
}

static enum st map_move(struct motor *motor, enum motor_axis axis, int32_t steps,
                        struct errctx *err) {
    uint16_t words[2];
    regmap_store_I32(words, steps);
    return write_words(map_of(motor),
                       axis == MOTOR_PAN ? REGMAP_ADDR_pan_target : REGMAP_ADDR_tilt_target, 2,
                       words, axis == MOTOR_PAN ? "move the pan" : "move the tilt", err);
}

static enum st map_stop(struct motor *motor, struct errctx *err) {
    return write_coil(motor, REGMAP_COIL_stop, true, "stop", err);
}

static enum st map_mirror(struct motor *motor, double speed_rps, struct errctx *err) {
    double mrps = round(speed_rps * 1000);
    if (!(mrps >= 0 && mrps <= UINT16_MAX))
        return errctx_set(err, ST_INVALID, "mirror speed %g rev/s is not within 0 to 65",
                          speed_rps);
    uint16_t word = (uint16_t)mrps;
    return write_words(map_of(motor), REGMAP_ADDR_mirror_target, 1, &word, "set the mirror speed",
                       err);
}

static enum st map_laser(struct motor *motor, bool on, struct errctx *err) {
    return write_coil(motor, REGMAP_COIL_laser_enable, on,
                      on ? "switch the laser on" : "switch the laser off", err);
}

static enum st map_scan_program(struct motor *motor, const struct motor_scan *scan,
                                struct errctx *err) {
    enum { START = REGMAP_ADDR_scan_from };
    struct motor_map *map = map_of(motor);
    bool stepwise = scan->steps_per_turn > 0;
    double rate = round(scan->rate * 1000);
    if (!stepwise && !(rate >= 1 && rate <= UINT32_MAX))
        return errctx_set(err, ST_INVALID, "scan rate %g steps/s makes no sense", scan->rate);
    uint16_t words[BLOCK(scan_from, scan_mode)];
    regmap_put_scan_from(words, START, scan->from_steps);
    regmap_put_scan_to(words, START, scan->to_steps);
    regmap_put_scan_rate(words, START,
                         stepwise ? regmap_holding_initial.scan_rate : (uint32_t)rate);
    regmap_put_scan_mode(words, START, stepwise);
    enum st st =
        write_words(map, START, BLOCK(scan_from, scan_mode), words, "set the scan program", err);
    if (!st && stepwise)
        st = write_words(map, REGMAP_ADDR_scan_steps, 1, &scan->steps_per_turn,
                         "set the steps per revolution", err);
    return st;
}

static enum st map_scan_run(struct motor *motor, bool on, struct errctx *err) {
    struct motor_map *map = map_of(motor);
    int result = map->line.write_coil(map->line.ctx, REGMAP_COIL_scan_run, on, !on, err);
    return judge(map, result, on ? "start the scan" : "end the scan", err);
}

static enum st map_camera_program(struct motor *motor, const struct motor_camera *camera,
                                  struct errctx *err) {
    enum { START = REGMAP_ADDR_camera_first };
    if (!camera->number)
        return write_coil(motor, REGMAP_COIL_camera_auto, false, "disarm the camera", err);
    uint16_t words[BLOCK(camera_first, camera_pulse_us)];
    regmap_put_camera_first(words, START, camera->first_steps);
    regmap_put_camera_interval(words, START, camera->interval_steps);
    regmap_put_camera_number(words, START, camera->number);
    regmap_put_camera_pulse_us(words, START, camera->pulse_us);
    enum st st = write_words(map_of(motor), START, BLOCK(camera_first, camera_pulse_us), words,
                             "set the camera program", err);
    return st ? st : write_coil(motor, REGMAP_COIL_camera_auto, true, "arm the camera", err);
}

static enum st map_trigger(struct motor *motor, struct errctx *err) {
    struct motor_map *map = map_of(motor);
    int result = map->line.write_coil(map->line.ctx, REGMAP_COIL_camera_trigger, true, false, err);
    return judge(map, result, "trigger the camera", err);
}

static enum st map_host_timeout(struct motor *motor, unsigned timeout_ms, struct errctx *err) {
    if (timeout_ms > UINT16_MAX)
        return errctx_set(err, ST_INVALID, "a host time-out of %u ms makes no sense", timeout_ms);
    uint16_t word = (uint16_t)timeout_ms;
    return write_words(map_of(motor), REGMAP_ADDR_host_timeout_ms, 1, &word,
                       "set the host's time-out", err);
}

static enum st map_kick(struct motor *motor, struct errctx *err) {
    struct motor_map *map = map_of(motor);
    uint16_t word;
    return judge(map, map->line.read(map->line.ctx, REGMAP_ADDR_state, 1, &word, err),
                 "reach the controller", err);
}

/* If the answer was lost, the fault may be gone already. */
static enum st map_clear_fault(struct motor *motor, unsigned fault, struct errctx *err) {
    struct motor_map *map = map_of(motor);
    uint16_t word = (uint16_t)fault;
    int result = map->line.write(map->line.ctx, REGMAP_ADDR_fault_clear, 1, &word, false, err);
    if (result == ST_TIMEOUT) {
        struct motor_status status;
        enum st st = map_status(motor, &status, err);
        if (st || status.state != CTLSTATE_FAULT)
            return st;
        result = map->line.write(map->line.ctx, REGMAP_ADDR_fault_clear, 1, &word, false, err);
    }
    return judge(map, result, "clear the fault", err);
}

static enum st map_save(struct motor *motor, struct errctx *err) {
    uint16_t word = 0x5afe;
    return write_words(map_of(motor), REGMAP_ADDR_commission_save, 1, &word,
                       "store the commissioning values", err);
}

static void map_close(struct motor *motor) {
    struct motor_map *map = map_of(motor);
    map->line.close(map->line.ctx);
    free(map);
}

static const struct motor_ops ops = {.identify = map_identify,
                                     .status = map_status,
                                     .enable = map_enable,
                                     .home = map_home,
                                     .move = map_move,
                                     .stop = map_stop,
                                     .mirror = map_mirror,
                                     .laser = map_laser,
                                     .scan_program = map_scan_program,
                                     .scan_run = map_scan_run,
                                     .camera_program = map_camera_program,
                                     .trigger = map_trigger,
                                     .read_events = map_read_events,
                                     .host_timeout = map_host_timeout,
                                     .kick = map_kick,
                                     .clear_fault = map_clear_fault,
                                     .save = map_save,
                                     .close = map_close};

enum st motor_map_open(const struct motor_line *line, unsigned block_ms, struct motor **out_motor,
                       struct errctx *err) {
    struct motor_map *map = malloc(sizeof *map);
    if (!map) {
        line->close(line->ctx);
        return errctx_set(err, ST_NOMEM, "no memory for the controller's line");
    }
    *map = (struct motor_map){.motor = {.ops = &ops, .block_ms = block_ms}, .line = *line};
    *out_motor = &map->motor;
    return ST_OK;
}
