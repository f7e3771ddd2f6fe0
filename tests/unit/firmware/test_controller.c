/* The whole controller by its registers, on the simulated cart. */
#include "firmware/hal/hal_flash.h"
#include "firmware/shared/idxevent.h"
#include "tests/support/simcart.h"

#include <string.h>

static struct sim *fresh(void) {
    struct sim_config config = simcart_config();
    return simcart_commissioned(&config);
}

static void identifies_itself(void **state) {
    (void)state;
    struct sim *sim = fresh();
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_map_version), REGMAP_VERSION);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_board_id), 3);
    assert_int_equal(simcart_get32(sim, REGMAP_ADDR_serial), 1);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_reset_cause), RESETCAUSE_POWER);
    uint8_t reply[MBFRAME_MAX];
    const uint8_t request[] = {1, 0x2b, 0x0e, 4, 5};
    size_t have = sim_transact(sim, request, sizeof request, reply, 100000);
    assert_int_equal(have, 13);
    assert_memory_equal(reply + 10, "sim", 3);
    sim_destroy(sim);
}

static void every_register_can_be_read_alone_and_in_its_block(void **state) {
    (void)state;
    struct sim *sim = fresh();
    uint16_t words[125];
    for (int i = 0; i < REGMAP_INPUT_COUNT_; i++)
        assert_int_equal(sim_read(sim, regmap_inputs[i].address,
                                  regmap_type_words(regmap_inputs[i].type), words),
                         0);
    for (int i = 0; i < REGMAP_HOLDING_COUNT_; i++)
        assert_int_equal(sim_read(sim, regmap_holdings[i].address,
                                  regmap_type_words(regmap_holdings[i].type), words),
                         0);
    assert_int_equal(sim_read(sim, IDXEVENT_WINDOW_ADDR, IDXEVENT_WINDOW_WORDS, words), 0);
    assert_int_equal(sim_read(sim, IDXEVENT_FIRST_ADDR + 3, 20, words), 0);
    assert_int_equal(sim_read(sim, IDXEVENT_WINDOW_ADDR, IDXEVENT_WINDOW_WORDS + 1, words), 2);
    assert_int_equal(sim_read(sim, 0x0f00, 1, words), 2);
    assert_int_equal(sim_read(sim, REGMAP_ADDR_temperature_max, 2, words), 2);
    sim_destroy(sim);
}

static void function_4_reads_inputs_only_and_function_3_both(void **state) {
    (void)state;
    struct sim *sim = fresh();
    uint8_t reply[MBFRAME_MAX], request[] = {1, 4, 0x10, 0x01, 0, 1};
    assert_int_equal(sim_transact(sim, request, sizeof request, reply, 100000), 3);
    assert_int_equal(reply[2], MBEXC_ADDRESS);
    request[1] = 3;
    assert_int_equal(sim_transact(sim, request, sizeof request, reply, 100000), 5);
    request[1] = 4;
    request[2] = request[3] = 0;
    assert_int_equal(sim_transact(sim, request, sizeof request, reply, 100000), 5);
    sim_destroy(sim);
}

static void every_value_outside_its_range_gets_3_and_changes_nothing(void **state) {
    (void)state;
    struct sim *sim = fresh();
    for (int i = 0; i < REGMAP_HOLDING_COUNT_; i++) {
        const struct regmap_entry *entry = &regmap_holdings[i];
        unsigned words = regmap_type_words(entry->type);
        int64_t top = words == 2 ? UINT32_MAX : UINT16_MAX, bottom = 0;
        if (entry->type == REGMAP_I16 || entry->type == REGMAP_I32) {
            top = words == 2 ? INT32_MAX : INT16_MAX;
            bottom = -top - 1;
        }
        const int64_t wrong[] = {entry->min - 1, entry->max + 1, top, bottom};
        for (size_t k = 0; k < 4; k++) {
            if (wrong[k] < bottom || wrong[k] > top ||
                (wrong[k] >= entry->min && wrong[k] <= entry->max))
                continue;
            struct regmap_holding before = sim_firmware(sim)->holding;
            int result = words == 2 ? sim_write32(sim, entry->address, (uint32_t)wrong[k])
                                    : sim_write1(sim, entry->address, (uint16_t)wrong[k]);
            assert_int_equal(result, MBEXC_VALUE);
            assert_memory_equal(&before, &sim_firmware(sim)->holding, sizeof before);
            assert_int_equal(sim_firmware(sim)->refusal, REFUSAL_RANGE);
            assert_int_equal(sim_firmware(sim)->refusal_address, entry->address);
        }
    }
    sim_destroy(sim);
}

static void half_a_value_cannot_be_written(void **state) {
    (void)state;
    struct sim *sim = fresh();
    uint16_t words[3] = {0, 1, 0};
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_scan_from, 5), MBEXC_ADDRESS);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_scan_from + 1, 5), MBEXC_ADDRESS);
    assert_int_equal(sim_write(sim, REGMAP_ADDR_scan_from, 3, words), MBEXC_ADDRESS);
    assert_int_equal(sim_write(sim, REGMAP_ADDR_scan_from + 1, 2, words), MBEXC_ADDRESS);
    assert_int_equal(sim_write(sim, REGMAP_ADDR_temperature_max, 2, words), MBEXC_ADDRESS);
    assert_int_equal(sim_write(sim, REGMAP_ADDR_map_version, 1, words), MBEXC_ADDRESS);
    assert_int_equal(sim_firmware(sim)->holding.scan_from, 0);
    sim_destroy(sim);
}

static void block_with_one_bad_value_changes_nothing(void **state) {
    (void)state;
    struct sim *sim = fresh();
    uint16_t words[8] = {0};
    regmap_put_scan_from(words, 0x1020, 100);
    regmap_put_scan_to(words, 0x1020, 200);
    regmap_put_scan_rate(words, 0x1020, 5000);
    regmap_put_scan_mode(words, 0x1020, 2); /* there is no mode 2 */
    regmap_put_scan_steps(words, 0x1020, 4);
    struct regmap_holding before = sim_firmware(sim)->holding;
    assert_int_equal(sim_write(sim, 0x1020, 8, words), MBEXC_VALUE);
    assert_memory_equal(&before, &sim_firmware(sim)->holding, sizeof before);
    regmap_put_scan_mode(words, 0x1020, 1);
    assert_int_equal(sim_write(sim, 0x1020, 8, words), 0);
    assert_int_equal(sim_firmware(sim)->holding.scan_to, 200);
    sim_destroy(sim);
}

static void targets_outside_the_soft_limits_get_3(void **state) {
    (void)state;
    struct sim *sim = fresh();
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 14001), MBEXC_VALUE);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_tilt_target, (uint32_t)-3501), MBEXC_VALUE);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_mirror_target, 15001), MBEXC_VALUE);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_mirror_target, 15000), 0);
    /* pan would be fine, tilt is not: neither moves */
    uint16_t words[4] = {0, 100, 0, 9999};
    assert_int_equal(sim_write(sim, REGMAP_ADDR_pan_target, 4, words), MBEXC_VALUE);
    assert_false(sim_firmware(sim)->axis[HAL_PAN].active);
    sim_destroy(sim);
}

static void moving_needs_motors(void **state) {
    (void)state;
    struct sim *sim = fresh();
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 100), MBEXC_DEVICE);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_refusal), REFUSAL_MOTORS_OFF);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_refusal_address), REGMAP_ADDR_pan_target);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_mirror_target, 4000), MBEXC_DEVICE);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_home_pan, true), MBEXC_DEVICE);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_scan_run, true), MBEXC_DEVICE);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_laser_enable, true), MBEXC_DEVICE);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_mirror_target, 0), 0);
    sim_destroy(sim);
}

static void commands_while_faulted_get_4_and_the_fault_stays(void **state) {
    (void)state;
    struct sim *sim = fresh();
    simcart_light(sim);
    sim_chain(sim, HAL_IN_DOOR_CLOSED, false);
    sim_advance(sim, 2000);
    sim_chain(sim, HAL_IN_DOOR_CLOSED, true);
    sim_advance(sim, 2000);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_DOOR);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 5), MBEXC_DEVICE);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_tilt_target, 5), MBEXC_DEVICE);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_mirror_target, 4000), MBEXC_DEVICE);
    for (uint16_t coil = 0; coil < REGMAP_COIL_COUNT_; coil++)
        if (coil != REGMAP_COIL_stop)
            assert_int_equal(sim_coil(sim, coil, true), MBEXC_DEVICE);
    for (uint16_t coil = 0; coil < REGMAP_COIL_COUNT_; coil++)
        assert_int_equal(sim_coil(sim, coil, false), 0); /* off is never refused */
    assert_int_equal(sim_coil(sim, REGMAP_COIL_stop, true), 0);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_DOOR);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_mirror_target), 0);
    assert_false(sim_truth(sim).laser || sim_truth(sim).motors);
    sim_destroy(sim);
}

static void only_the_code_that_was_read_clears_the_fault(void **state) {
    (void)state;
    struct sim *sim = fresh();
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_fault_clear, FAULT_ESTOP), MBEXC_VALUE);
    sim_chain(sim, HAL_IN_ESTOP_CLOSED, false);
    sim_advance(sim, 1000);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_fault_clear, FAULT_ESTOP), MBEXC_DEVICE);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_refusal), REFUSAL_CONDITION);
    sim_chain(sim, HAL_IN_ESTOP_CLOSED, true);
    sim_advance(sim, 1000);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_fault_clear, FAULT_DOOR), MBEXC_VALUE);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_refusal), REFUSAL_WRONG_FAULT);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_fault_clear, FAULT_ESTOP), 0);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_state), CTLSTATE_IDLE);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_clear), 0);
    sim_destroy(sim);
}

static void fault_tells_code_context_and_time(void **state) {
    (void)state;
    struct sim *sim = fresh();
    assert_true(sim_fault_at(sim, SIM_FAULT_OVER_TEMP, 5000000, 81.2));
    simcart_wait(sim, 6000000);
    uint16_t words[15];
    assert_int_equal(sim_read(sim, REGMAP_ADDR_state, 15, words), 0);
    struct regmap_input got;
    memset(&got, 0, sizeof got);
    (void)regmap_decode(regmap_inputs, REGMAP_INPUT_COUNT_, &got, REGMAP_ADDR_state, 15, words);
    assert_int_equal(got.state, CTLSTATE_FAULT);
    assert_int_equal(got.fault_code, FAULT_OVER_TEMP);
    assert_int_equal(got.fault_context, 812);
    assert_in_range(got.fault_time_us, 5000000, 5000500);
    assert_int_equal(got.fault_count, 1);
    assert_int_equal(got.temperature, 812);
    assert_int_equal(got.conditions, 1u << FAULT_OVER_TEMP);
    sim_destroy(sim);
}

static void laser_is_refused_until_commissioned(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    struct sim *sim = sim_create(&config);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_commission_state), COMMISSION_DEFAULTS);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_host_timeout_ms, 5000), 0);
    simcart_spin(sim);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_laser_enable, true), MBEXC_DEVICE);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_refusal), REFUSAL_UNCOMMISSIONED);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, false), 0);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_commission_save, 0x5afe), 0);
    simcart_spin(sim);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_laser_enable, true), 0);
    sim_destroy(sim);
}

static void commissioning_survives_a_reset_and_bits_flipped_in_flash_do_not(void **state) {
    (void)state;
    struct sim *sim = fresh();
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_steps_turn, 28078), 0);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_min, (uint32_t)-12000), 0);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_temperature_max, 650), 0);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_commission_state), COMMISSION_CHANGED);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_commission_save, 0x5afe), 0);
    sim_reset(sim, RESETCAUSE_POWER);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_commission_state), COMMISSION_VALID);
    assert_int_equal(simcart_get32(sim, REGMAP_ADDR_pan_steps_turn), 28078);
    assert_int_equal((int32_t)simcart_get32(sim, REGMAP_ADDR_pan_min), -12000);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_temperature_max), 650);
    /* every bit of the record matters */
    uint8_t record[HAL_FLASH_SIZE];
    hal_flash_read(record, sizeof record);
    unsigned used = sizeof record;
    while (record[used - 1] == 0xff)
        used--;
    assert_in_range(used, 60, HAL_FLASH_SIZE);
    for (unsigned bit = 0; bit < 8 * used; bit++) {
        assert_true(sim_fault_at(sim, SIM_FAULT_FLASH_FLIP, 0, bit));
        sim_advance(sim, 1);
        sim_reset(sim, RESETCAUSE_POWER);
        assert_int_equal(sim_firmware(sim)->commission_state, COMMISSION_DAMAGED);
        assert_int_equal(sim_firmware(sim)->holding.pan_steps_turn, 28000);
        assert_true(sim_fault_at(sim, SIM_FAULT_FLASH_FLIP, 0, bit));
        sim_advance(sim, 1);
    }
    sim_destroy(sim);
}

static void commissioning_is_locked_while_energised(void **state) {
    (void)state;
    struct sim *sim = fresh();
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_mirror_safe, 1000), MBEXC_BUSY);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_refusal), REFUSAL_ENERGISED);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_commission_save, 0x5afe), MBEXC_BUSY);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_mirror_safe), 2000);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, false), 0);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_mirror_safe, 1000), 0);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_mirror_max, 1000),
                     MBEXC_VALUE); /* not above safe */
    sim_destroy(sim);
}

static void slow_flash_write_is_no_fault_and_a_failed_one_is_told(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    config.flash_us = 150000; /* longer than the loop's limit */
    struct sim *sim = simcart_commissioned(&config);
    sim_advance(sim, 10000);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_NONE);
    assert_true(sim_fault_at(sim, SIM_FAULT_FLASH_BAD, 0, 1));
    sim_advance(sim, 1000);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_commission_save, 0x5afe), MBEXC_DEVICE);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_refusal), REFUSAL_FLASH);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_commission_state), COMMISSION_CHANGED);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_NONE);
    sim_destroy(sim);
}

static void host_silence_counts_only_while_energised(void **state) {
    (void)state;
    struct sim *sim = fresh();
    sim_advance(sim, 20000000);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_NONE);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    sim_advance(sim, 4990000);
    assert_true(sim_truth(sim).motors);
    sim_advance(sim, 20000);
    assert_false(sim_truth(sim).motors);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_HOST_SILENT);
    assert_in_range(simcart_get32(sim, REGMAP_ADDR_fault_context), 5001, 5002);
    sim_destroy(sim);
}

static void broadcast_is_obeyed_but_does_not_feed_the_host_watchdog(void **state) {
    (void)state;
    struct sim *sim = fresh();
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    uint8_t reply[MBFRAME_MAX];
    const uint8_t stop_all[] = {0, 5, 0, REGMAP_COIL_stop, 0xff, 0};
    for (int i = 0; i < 30; i++) {
        assert_int_equal(sim_transact(sim, stop_all, sizeof stop_all, reply, 10000), 0);
        sim_advance(sim, 190000);
    }
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_HOST_SILENT);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_fault_clear, FAULT_HOST_SILENT), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    const uint8_t motors_off[] = {0, 5, 0, REGMAP_COIL_motor_enable, 0, 0};
    assert_int_equal(sim_transact(sim, motors_off, sizeof motors_off, reply, 10000), 0);
    assert_false(sim_truth(sim).motors);
    sim_destroy(sim);
}

static void coils_are_written_all_or_none(void **state) {
    (void)state;
    struct sim *sim = fresh();
    /* motors on and laser on in one request: the laser may not, so the motors stay off */
    uint8_t reply[MBFRAME_MAX];
    const uint8_t both[] = {1, 15, 0, 0, 0, 2, 1, 3};
    assert_int_equal(sim_transact(sim, both, sizeof both, reply, 100000), 3);
    assert_int_equal(reply[2], MBEXC_DEVICE);
    assert_false(sim_truth(sim).motors);
    assert_int_equal(sim_firmware(sim)->refusal_address, REGMAP_COIL_laser_enable);
    const uint8_t beyond[] = {1, 15, 0, 7, 0, 2, 1, 0};
    assert_int_equal(sim_transact(sim, beyond, sizeof beyond, reply, 100000), 3);
    assert_int_equal(reply[2], MBEXC_ADDRESS);
    sim_destroy(sim);
}

static void laser_on_with_motors_off_in_one_request_leaves_both_off(void **state) {
    (void)state;
    struct sim *sim = fresh();
    simcart_spin(sim);
    uint8_t reply[MBFRAME_MAX];
    const uint8_t contradiction[] = {1, 15, 0, 0, 0, 2, 1, 2};
    (void)sim_transact(sim, contradiction, sizeof contradiction, reply, 100000);
    assert_false(sim_truth(sim).laser);
    sim_destroy(sim);
}

static void bits_tell_the_state(void **state) {
    (void)state;
    struct sim *sim = fresh();
    simcart_light(sim);
    uint8_t reply[MBFRAME_MAX];
    const uint8_t discrete[] = {1, 2, 0, 0, 0, REGMAP_DISCRETE_COUNT_};
    assert_int_equal(sim_transact(sim, discrete, sizeof discrete, reply, 100000), 6);
    uint32_t bits = reply[3] | (uint32_t)reply[4] << 8 | (uint32_t)reply[5] << 16;
    const uint32_t expected = 7u | 1u << REGMAP_DISCRETE_laser_current |
                              1u << REGMAP_DISCRETE_motors_on | 1u << REGMAP_DISCRETE_laser_on |
                              1u << REGMAP_DISCRETE_mirror_in_range |
                              1u << REGMAP_DISCRETE_host_alive;
    assert_int_equal(bits, expected);
    const uint8_t coils[] = {1, 1, 0, 0, 0, REGMAP_COIL_COUNT_};
    assert_int_equal(sim_transact(sim, coils, sizeof coils, reply, 100000), 4);
    assert_int_equal(reply[3], 3);
    sim_destroy(sim);
}

static void a_reset_switches_everything_off(void **state) {
    (void)state;
    struct sim *sim = fresh();
    simcart_light(sim);
    sim_reset(sim, RESETCAUSE_WATCHDOG);
    assert_false(sim_truth(sim).laser || sim_truth(sim).motors);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_WATCHDOG);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_reset_cause), RESETCAUSE_WATCHDOG);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_fault_clear, FAULT_WATCHDOG), 0);
    sim_destroy(sim);
}

static void pin_interrupt_is_faster_than_the_tick(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    config.pin_interrupts = true;
    struct sim *sim = simcart_commissioned(&config);
    simcart_light(sim);
    sim_advance(sim, 123);
    sim_chain(sim, HAL_IN_INTERLOCK_CLOSED, false);
    assert_false(sim_truth(sim).laser); /* no time has passed */
    sim_destroy(sim);
}

static void clock_failure_interrupt_stops_the_axes_too(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    config.pin_interrupts = true;
    struct sim *sim = simcart_commissioned(&config);
    simcart_light(sim);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 5000), 0);
    sim_advance(sim, 100000);
    uint64_t at_us = sim_now_us(sim) + 123;
    assert_true(sim_fault_at(sim, SIM_FAULT_CLOCK, at_us, 1));
    assert_true(sim_fault_at(sim, SIM_FAULT_CLOCK, at_us + 1, 0)); /* gone before the tick looks */
    sim_advance_to(sim, at_us);
    assert_false(sim_truth(sim).laser || sim_truth(sim).motors);
    sim_advance(sim, 1000);
    int64_t pulses = sim_truth(sim).pulses[HAL_PAN];
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_fault_clear, FAULT_CLOCK), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    sim_advance(sim, 1000000);
    assert_int_equal(sim_truth(sim).pulses[HAL_PAN], pulses);
    assert_int_equal(sim_firmware(sim)->mirror.drive, 0);
    sim_destroy(sim);
}

static void unit_address_changes_at_the_next_reset(void **state) {
    (void)state;
    struct sim *sim = fresh();
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_unit_address, 9), 0);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_commission_save, 0x5afe), 0);
    sim_reset(sim, RESETCAUSE_PIN);
    uint16_t word;
    assert_int_equal(sim_read(sim, REGMAP_ADDR_state, 1, &word), -1);
    uint8_t reply[MBFRAME_MAX];
    const uint8_t request[] = {9, 3, 0x10, 0x41, 0, 1};
    assert_int_equal(sim_transact(sim, request, sizeof request, reply, 100000), 5);
    assert_int_equal(reply[4], 9);
    sim_destroy(sim);
}

static void clock_that_wraps_is_not_noticed(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    config.clock_start = UINT32_MAX - 3000000; /* 3 s before the wrap */
    struct sim *sim = simcart_commissioned(&config);
    simcart_light(sim);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 8000), 0);
    simcart_wait(sim, 6000000);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_NONE);
    assert_int_equal(simcart_get32(sim, REGMAP_ADDR_pan_actual), 8000);
    uint16_t words[4];
    assert_int_equal(sim_read(sim, REGMAP_ADDR_uptime_us, 4, words), 0);
    assert_true(regmap_load_U64(words) > UINT32_MAX);
    sim_destroy(sim);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(identifies_itself),
        cmocka_unit_test(every_register_can_be_read_alone_and_in_its_block),
        cmocka_unit_test(function_4_reads_inputs_only_and_function_3_both),
        cmocka_unit_test(every_value_outside_its_range_gets_3_and_changes_nothing),
        cmocka_unit_test(half_a_value_cannot_be_written),
        cmocka_unit_test(block_with_one_bad_value_changes_nothing),
        cmocka_unit_test(targets_outside_the_soft_limits_get_3),
        cmocka_unit_test(moving_needs_motors),
        cmocka_unit_test(commands_while_faulted_get_4_and_the_fault_stays),
        cmocka_unit_test(only_the_code_that_was_read_clears_the_fault),
        cmocka_unit_test(fault_tells_code_context_and_time),
        cmocka_unit_test(laser_is_refused_until_commissioned),
        cmocka_unit_test(commissioning_survives_a_reset_and_bits_flipped_in_flash_do_not),
        cmocka_unit_test(commissioning_is_locked_while_energised),
        cmocka_unit_test(slow_flash_write_is_no_fault_and_a_failed_one_is_told),
        cmocka_unit_test(host_silence_counts_only_while_energised),
        cmocka_unit_test(broadcast_is_obeyed_but_does_not_feed_the_host_watchdog),
        cmocka_unit_test(coils_are_written_all_or_none),
        cmocka_unit_test(laser_on_with_motors_off_in_one_request_leaves_both_off),
        cmocka_unit_test(bits_tell_the_state),
        cmocka_unit_test(a_reset_switches_everything_off),
        cmocka_unit_test(pin_interrupt_is_faster_than_the_tick),
        cmocka_unit_test(clock_failure_interrupt_stops_the_axes_too),
        cmocka_unit_test(unit_address_changes_at_the_next_reset),
        cmocka_unit_test(clock_that_wraps_is_not_noticed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
