/* The motor ops against the real firmware on its simulated port, in virtual time, and against lines
 * that misbehave. */
#include "device/motor_map.h"
#include "device/motor_sim.h"
#include "firmware/port/sim/sim.h"
#include "firmware/shared/faultcode.h"
#include "firmware/shared/idxevent.h"
#include "firmware/shared/regmap.h"
#include "tests/support/cmocka_all.h"

#include <string.h>

struct bench {
    struct sim *sim;
    struct motor *motor;
    struct errctx err;
};

static int set_up(void **state) {
    static struct bench bench;
    struct sim_config config = sim_config_default();
    config.lossless_line = true;
    for (int i = 0; i < HAL_AXES; i++)
        config.axis[i].start = config.axis[i].home_edge + 200;
    bench = (struct bench){.sim = sim_create(&config)};
    *state = &bench;
    return !bench.sim || motor_sim_open(bench.sim, &bench.motor, &bench.err);
}

static int tear_down(void **state) {
    struct bench *b = *state;
    motor_close(b->motor);
    sim_destroy(b->sim);
    return 0;
}

static struct motor_status status_of(struct bench *b) {
    struct motor_status status;
    assert_int_equal(b->motor->ops->status(b->motor, &status, &b->err), ST_OK);
    return status;
}

/* Virtual time passes, the host stays alive. */
static void pass(struct bench *b, int ms) {
    for (; ms > 0; ms -= 100) {
        sim_advance(b->sim, 100000);
        assert_int_equal(b->motor->ops->kick(b->motor, &b->err), ST_OK);
    }
}

static void power_up(struct bench *b) {
    const struct motor_ops *ops = b->motor->ops;
    assert_int_equal(ops->save(b->motor, &b->err), ST_OK);
    assert_int_equal(ops->enable(b->motor, true, &b->err), ST_OK);
    assert_int_equal(ops->mirror(b->motor, 8, &b->err), ST_OK);
    pass(b, 4000);
}

static void identifies_the_simulated_controller(void **state) {
    struct bench *b = *state;
    struct motor_identity id;
    assert_int_equal(b->motor->ops->identify(b->motor, &id, &b->err), ST_OK);
    assert_int_equal(id.map_version, REGMAP_VERSION);
    assert_int_equal(id.board_id, 3);
}

static void homes_moves_and_scans(void **state) {
    struct bench *b = *state;
    const struct motor_ops *ops = b->motor->ops;
    power_up(b);
    assert_int_equal(ops->home(b->motor, MOTOR_PAN, &b->err), ST_OK);
    pass(b, 10000);
    assert_true(status_of(b).axis[MOTOR_PAN].homed);
    assert_int_equal(ops->move(b->motor, MOTOR_PAN, -13000, &b->err), ST_OK);
    pass(b, 2000);
    assert_int_equal(status_of(b).axis[MOTOR_PAN].steps, -13000);
    struct motor_scan scan = {.from_steps = -13000, .to_steps = -12900, .steps_per_turn = 10};
    assert_int_equal(ops->scan_program(b->motor, &scan, &b->err), ST_OK);
    assert_int_equal(ops->scan_run(b->motor, true, &b->err), ST_OK);
    pass(b, 4000);
    struct motor_status after = status_of(b);
    assert_int_equal(after.scan_state, SCANSTATE_DONE);
    assert_int_equal(after.axis[MOTOR_PAN].steps, -12900);
}

static void says_why_a_command_is_refused(void **state) {
    struct bench *b = *state;
    assert_int_equal(b->motor->ops->home(b->motor, MOTOR_TILT, &b->err), ST_DEVICE);
    assert_non_null(strstr(b->err.text, refusal_text(REFUSAL_MOTORS_OFF)));
    assert_int_equal(b->motor->ops->mirror(b->motor, -1, &b->err), ST_INVALID);
    assert_int_equal(b->motor->ops->host_timeout(b->motor, 10, &b->err), ST_INVALID);
}

static void laser_needs_everything_and_fault_is_cleared_by_its_code(void **state) {
    struct bench *b = *state;
    const struct motor_ops *ops = b->motor->ops;
    assert_int_equal(ops->laser(b->motor, true, &b->err), ST_DEVICE);
    power_up(b);
    assert_int_equal(ops->laser(b->motor, true, &b->err), ST_OK);
    assert_true(status_of(b).laser_on);
    sim_chain(b->sim, HAL_IN_DOOR_CLOSED, false);
    sim_advance(b->sim, 2000);
    struct motor_status faulted = status_of(b);
    assert_true(faulted.fault == FAULT_DOOR && !faulted.laser_on && !faulted.motors_on);
    assert_int_equal(ops->clear_fault(b->motor, FAULT_DOOR, &b->err), ST_DEVICE);
    sim_chain(b->sim, HAL_IN_DOOR_CLOSED, true);
    pass(b, 100);
    assert_int_equal(ops->clear_fault(b->motor, FAULT_ESTOP, &b->err), ST_INVALID);
    assert_int_equal(ops->clear_fault(b->motor, FAULT_DOOR, &b->err), ST_OK);
    assert_int_equal(status_of(b).state, CTLSTATE_IDLE);
}

static void reads_every_event_once(void **state) {
    struct bench *b = *state;
    struct index_event event[8];
    power_up(b);
    uint64_t next = 0, lost = 1, revolution = 0;
    size_t count;
    do {
        assert_int_equal(
            b->motor->ops->read_events(b->motor, next, event, 8, &count, &lost, &b->err), ST_OK);
        assert_int_equal(lost, 0);
        for (size_t i = 0; i < count; i++) {
            assert_int_equal(event[i].seq, next++);
            assert_int_equal(event[i].kind, INDEX_EVENT_INDEX);
            assert_int_equal(event[i].revolution, ++revolution);
        }
    } while (count == 8);
    assert_true(next > 10);
    assert_int_equal(b->motor->ops->trigger(b->motor, &b->err), ST_OK);
    sim_advance(b->sim, 50000);
    assert_int_equal(status_of(b).strobes, 1);
}

static void tells_lost_events_and_a_restart(void **state) {
    struct bench *b = *state;
    struct index_event event[8];
    size_t count;
    uint64_t lost;
    power_up(b);
    pass(b, 12000); /* some 100 events: more than the ring of 64 */
    assert_int_equal(b->motor->ops->read_events(b->motor, 0, event, 8, &count, &lost, &b->err),
                     ST_OK);
    assert_true(lost > 10 && count == 8 && event[0].seq == lost);
    uint64_t next = event[7].seq + 1;
    sim_reset(b->sim, RESETCAUSE_PIN);
    assert_int_equal(b->motor->ops->read_events(b->motor, next, event, 8, &count, &lost, &b->err),
                     ST_DAMAGED);
    assert_non_null(strstr(b->err.text, "restarted"));
}

/* --- a line that counts and misbehaves
 * ------------------------------------------------------------------ */

struct false_line {
    int writes, coil_writes;
    bool lose_answer; /* carried out, but the answer is lost: once */
    struct regmap_input in;
    uint32_t next; /* event_next */
    uint32_t first;
    uint16_t count;
};

static int false_read(void *ctx, uint16_t start, unsigned count, uint16_t *out_words,
                      struct errctx *err) {
    struct false_line *line = ctx;
    (void)err;
    return regmap_encode(regmap_inputs, REGMAP_INPUT_COUNT_, &line->in, start, count, out_words)
               ? 0
               : 2;
}

static int false_discrete(void *ctx, uint16_t start, unsigned count, uint8_t *out_bits,
                          struct errctx *err) {
    (void)ctx, (void)start, (void)err;
    memset(out_bits, 0, count);
    return 0;
}

static int answer(struct false_line *line, struct errctx *err) {
    bool lost = line->lose_answer;
    line->lose_answer = false;
    return lost ? errctx_set(err, ST_TIMEOUT, "no answer") : 0;
}

static int false_write(void *ctx, uint16_t start, unsigned count, const uint16_t *words,
                       bool repeat, struct errctx *err) {
    struct false_line *line = ctx;
    (void)count, (void)words, (void)repeat;
    line->writes++;
    if (start == REGMAP_ADDR_fault_clear)
        line->in.state = CTLSTATE_IDLE;
    return answer(line, err);
}

static int false_coil(void *ctx, uint16_t coil, bool on, bool repeat, struct errctx *err) {
    struct false_line *line = ctx;
    (void)on;
    assert_false(repeat && coil == REGMAP_COIL_camera_trigger);
    line->coil_writes++;
    if (coil == REGMAP_COIL_home_pan)
        line->in.pan_flags = 1u << 2;
    return answer(line, err);
}

static int false_write_read(void *ctx, uint16_t write_start, unsigned write_count,
                            const uint16_t *words, uint16_t read_start, unsigned read_count,
                            uint16_t *out_words, struct errctx *err) {
    struct false_line *line = ctx;
    (void)write_start, (void)write_count, (void)words, (void)read_start, (void)err;
    memset(out_words, 0, read_count * sizeof *out_words);
    regmap_store_U32(out_words, line->next);
    regmap_store_U32(out_words + 4, line->first);
    out_words[6] = line->count;
    out_words[7] = IDXEVENT_WORDS;
    for (uint32_t i = 0; i < line->count && i < IDXEVENT_WINDOW; i++) {
        struct idxevent e = {.seq = line->first + i, .revolution = i + 1, .flags = IDXEVENT_INDEX};
        idxevent_encode(&e, out_words + IDXEVENT_HEADER + i * IDXEVENT_WORDS);
    }
    return 0;
}

static void false_close(void *ctx) {
    (void)ctx;
}

static struct motor *on_false_line(struct false_line *line) {
    struct motor_line calls = {.ctx = line,
                               .read = false_read,
                               .read_discrete = false_discrete,
                               .write = false_write,
                               .write_coil = false_coil,
                               .write_read = false_write_read,
                               .close = false_close};
    struct motor *motor = NULL;
    assert_int_equal(motor_map_open(&calls, 1, &motor, NULL), ST_OK);
    return motor;
}

static void lost_answers_do_not_repeat_what_must_happen_once(void **state) {
    (void)state;
    struct false_line line = {.lose_answer = true};
    struct motor *motor = on_false_line(&line);
    struct errctx err;
    assert_int_equal(motor->ops->trigger(motor, &err), ST_TIMEOUT);
    assert_int_equal(line.coil_writes, 1);
    line.lose_answer = true;
    assert_int_equal(motor->ops->home(motor, MOTOR_PAN, &err), ST_OK); /* it is homing: heard */
    assert_int_equal(line.coil_writes, 2);
    line.lose_answer = true;
    line.in.state = CTLSTATE_FAULT;
    assert_int_equal(motor->ops->clear_fault(motor, 1, &err), ST_OK); /* it is gone: heard */
    assert_int_equal(line.writes, 1);
    motor_close(motor);
}

static void unwraps_event_numbers_over_32_bits(void **state) {
    (void)state;
    struct false_line line = {.next = 4, .first = 0xfffffffe, .count = 6};
    struct motor *motor = on_false_line(&line);
    struct index_event event[8];
    size_t count;
    uint64_t lost, from = UINT64_C(0x1fffffffc);
    struct errctx err;
    assert_int_equal(motor->ops->read_events(motor, from, event, 8, &count, &lost, &err), ST_OK);
    assert_int_equal(count, 6);
    assert_int_equal(lost, 2);
    assert_true(event[0].seq == UINT64_C(0x1fffffffe) && event[5].seq == UINT64_C(0x200000003));
    motor_close(motor);
}

static void rejects_event_windows_that_make_no_sense(void **state) {
    (void)state;
    struct false_line line = {.next = 100, .first = 90, .count = 9};
    struct motor *motor = on_false_line(&line);
    struct index_event event[8];
    size_t count;
    uint64_t lost;
    struct errctx err;
    assert_int_equal(motor->ops->read_events(motor, 90, event, 8, &count, &lost, &err), ST_DAMAGED);
    line.count = 8;
    assert_int_equal(motor->ops->read_events(motor, 92, event, 8, &count, &lost, &err), ST_DAMAGED);
    motor_close(motor);
}

static void refuses_another_register_map(void **state) {
    (void)state;
    struct false_line line = {.in.map_version = REGMAP_VERSION + 1};
    struct motor *motor = on_false_line(&line);
    struct motor_identity id;
    struct errctx err;
    assert_int_equal(motor->ops->identify(motor, &id, &err), ST_UNSUPPORTED);
    motor_close(motor);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(identifies_the_simulated_controller, set_up, tear_down),
        cmocka_unit_test_setup_teardown(homes_moves_and_scans, set_up, tear_down),
        cmocka_unit_test_setup_teardown(says_why_a_command_is_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(laser_needs_everything_and_fault_is_cleared_by_its_code,
                                        set_up, tear_down),
        cmocka_unit_test_setup_teardown(reads_every_event_once, set_up, tear_down),
        cmocka_unit_test_setup_teardown(tells_lost_events_and_a_restart, set_up, tear_down),
        cmocka_unit_test(lost_answers_do_not_repeat_what_must_happen_once),
        cmocka_unit_test(unwraps_event_numbers_over_32_bits),
        cmocka_unit_test(rejects_event_windows_that_make_no_sense),
        cmocka_unit_test(refuses_another_register_map)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
