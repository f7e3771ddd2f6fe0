/* The simulated port itself: line timing, determinism, instances, faults, races. */
#include "tests/support/simcart.h"

#include <math.h>
#include <string.h>

struct log {
    uint64_t hash;
    long events;
};

static void mix(struct log *log, uint64_t value) {
    log->hash = (log->hash ^ value) * 0x100000001b3u;
    log->events++;
}

static void on_step(void *ctx, uint64_t t_us, enum hal_axis axis, bool positive) {
    mix(ctx, t_us * 4 + (unsigned)axis * 2 + positive);
}

static void on_index(void *ctx, double exact_us, uint64_t turn) {
    uint64_t bits;
    memcpy(&bits, &exact_us, sizeof bits);
    mix(ctx, bits + turn);
}

static const struct sim_observer logger = {.step = on_step, .index = on_index};

static struct sim *noisy(struct log *log, uint64_t seed) {
    struct sim_config config = simcart_config();
    config.mirror_jitter = 0.01;
    config.camera_jitter_s = 0.001;
    config.seed = seed;
    struct sim *sim = simcart_commissioned(&config);
    *log = (struct log){0xcbf29ce484222325u, 0};
    sim_observe(sim, &logger, log);
    return sim;
}

static void start_moving(struct sim *sim) {
    simcart_spin(sim);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 3000), 0);
}

static void same_seed_gives_the_same_run_to_the_bit(void **state) {
    (void)state;
    struct log first, again, other;
    struct sim *a = noisy(&first, 5), *b = noisy(&again, 5), *c = noisy(&other, 6);
    start_moving(a);
    simcart_wait(a, 3000000);
    start_moving(b);
    simcart_wait(b, 3000000);
    start_moving(c);
    simcart_wait(c, 3000000);
    assert_true(first.hash == again.hash && first.events == again.events);
    assert_true(first.hash != other.hash);
    sim_destroy(a);
    sim_destroy(b);
    sim_destroy(c);
}

static void instances_do_not_know_of_each_other(void **state) {
    (void)state;
    struct log alone, first, second;
    struct sim *one = noisy(&alone, 7);
    start_moving(one);
    simcart_wait(one, 2000000);
    struct sim *a = noisy(&first, 7), *b = noisy(&second, 8);
    start_moving(a);
    for (int i = 0; i < 10; i++) { /* interleaved */
        simcart_wait(a, 200000);
        simcart_wait(b, 777777);
    }
    assert_true(alone.hash == first.hash);
    sim_destroy(b);
    sim_destroy(a);
    sim_destroy(one);
}

static void how_time_is_cut_into_advances_does_not_matter(void **state) {
    (void)state;
    struct log coarse, fine;
    struct sim *a = noisy(&coarse, 9), *b = noisy(&fine, 9);
    assert_int_equal(sim_coil(a, REGMAP_COIL_motor_enable, true), 0);
    assert_int_equal(sim_coil(b, REGMAP_COIL_motor_enable, true), 0);
    assert_int_equal(sim_write1(a, REGMAP_ADDR_mirror_target, 4000), 0);
    assert_int_equal(sim_write1(b, REGMAP_ADDR_mirror_target, 4000), 0);
    uint64_t end_us = sim_now_us(a) + 2000000;
    sim_advance_to(a, end_us);
    for (uint64_t us = 1; sim_now_us(b) < end_us; us = us * 7 % 9973)
        sim_advance_to(b, sim_now_us(b) + us < end_us ? sim_now_us(b) + us : end_us);
    assert_true(coarse.hash == fine.hash);
    sim_destroy(a);
    sim_destroy(b);
}

static void line_keeps_its_baud_rate_and_the_reply_waits_for_the_gap(void **state) {
    (void)state;
    struct sim_config config = sim_config_default();
    config.baud = 9600;
    config.poll_us = 10;
    struct sim *sim = sim_create(&config);
    uint8_t frame[8] = {1, 3, 0, 0, 0, 1}, reply[16];
    unsigned count = mbframe_seal(frame, 6);
    sim_advance_to(sim, 100000);
    assert_int_equal(sim_send(sim, frame, count), count);
    /* 8 bytes of 11 bits, the gap of 3.5 characters, then 7 bytes back */
    double byte_us = 11e6 / 9600, end_us = 100000 + (8 + 3.5 + 7) * byte_us;
    sim_advance_to(sim, (uint64_t)(end_us - byte_us));
    assert_in_range(sim_collect(sim, reply, sizeof reply), 5, 6);
    sim_advance_to(sim, (uint64_t)end_us + 50);
    assert_in_range(sim_collect(sim, reply, sizeof reply), 1, 2);
    sim_destroy(sim);
}

static size_t ask_in_two_parts(uint32_t pause_us, unsigned cut) {
    struct sim_config config = sim_config_default();
    struct sim *sim = sim_create(&config);
    uint8_t frame[8] = {1, 3, 0, 0, 0, 1}, reply[16];
    unsigned count = mbframe_seal(frame, 6);
    (void)sim_send(sim, frame, cut);
    sim_send_gap(sim, pause_us);
    (void)sim_send(sim, frame + cut, count - cut);
    sim_advance(sim, 50000);
    size_t have = sim_collect(sim, reply, sizeof reply);
    sim_destroy(sim);
    return have;
}

static void frame_split_by_less_than_the_gap_is_one_frame(void **state) {
    (void)state;
    for (unsigned cut = 1; cut < 8; cut++) {
        assert_int_equal(ask_in_two_parts(1500, cut), 7);
        assert_int_equal(ask_in_two_parts(2000, cut), 0);
    }
}

static void two_frames_with_a_gap_between_are_two_even_if_the_loop_is_slow(void **state) {
    (void)state;
    struct sim_config config = sim_config_default();
    config.poll_us = 30000; /* both have arrived when the loop comes round */
    struct sim *sim = sim_create(&config);
    uint8_t frame[8] = {1, 3, 0, 0, 0, 1}, reply[32];
    unsigned count = mbframe_seal(frame, 6);
    (void)sim_send(sim, frame, count);
    sim_send_gap(sim, 2000);
    (void)sim_send(sim, frame, count);
    sim_advance(sim, 200000);
    assert_int_equal(sim_collect(sim, reply, sizeof reply), 14);
    assert_int_equal(sim_firmware(sim)->slave.frames_ok, 2);
    sim_destroy(sim);
}

static void two_frames_glued_together_get_silence(void **state) {
    (void)state;
    struct sim_config config = sim_config_default();
    struct sim *sim = sim_create(&config);
    uint8_t frame[8] = {1, 3, 0, 0, 0, 1}, reply[32];
    unsigned count = mbframe_seal(frame, 6);
    (void)sim_send(sim, frame, count);
    (void)sim_send(sim, frame, count);
    sim_advance(sim, 100000);
    assert_int_equal(sim_collect(sim, reply, sizeof reply), 0);
    assert_int_equal(sim_firmware(sim)->slave.frames_bad, 1);
    sim_destroy(sim);
}

static void flood_is_counted_and_the_next_request_is_answered(void **state) {
    (void)state;
    struct sim_config config = sim_config_default();
    config.poll_us = 100000; /* the loop is away for longer than the ring holds */
    struct sim *sim = sim_create(&config);
    uint8_t noise[2000] = {0};
    (void)sim_send(sim, noise, sizeof noise);
    sim_advance(sim, 1000000);
    assert_true(sim_firmware(sim)->link.ring.lost > 0);
    assert_int_equal(sim_firmware(sim)->estop.fault, FAULT_LOOP); /* and the loop was noticed */
    uint16_t word;
    sim_advance(sim, 1000000);
    assert_int_equal(sim_read(sim, REGMAP_ADDR_rx_overruns, 1, &word), 0);
    assert_true(word > 0);
    sim_destroy(sim);
}

static void noise_on_the_line_never_gives_a_wrong_value(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    struct sim *sim = sim_create(&config);
    assert_true(sim_fault_at(sim, SIM_FAULT_LINE_NOISE, 0, 0.02));
    int good = 0, silent = 0;
    for (uint16_t i = 0; i < 2000; i++) {
        uint16_t back = 0;
        int written = sim_write1(sim, REGMAP_ADDR_host_timeout_ms, (uint16_t)(100 + i));
        if (written == 0) {
            assert_int_equal(sim_firmware(sim)->holding.host_timeout_ms, 100 + i);
            while (sim_read(sim, REGMAP_ADDR_host_timeout_ms, 1, &back) != 0)
                silent++;
            assert_int_equal(back, 100 + i);
            good++;
        } else {
            assert_int_equal(written, -1);
            silent++;
        }
    }
    assert_true(good > 1400 && silent > 200);
    sim_destroy(sim);
}

static void interrupts_between_any_two_lines_of_the_loop_do_no_harm(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    config.poll_slip_us = 37; /* time passes at every end of an interrupt lock */
    config.mirror_jitter = 0.003;
    struct sim *sim = simcart_commissioned(&config);
    simcart_light(sim);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_velocity_max, 20000000), 0);
    uint16_t words[125];
    int32_t target = 0;
    for (int i = 0; i < 400; i++) {
        target = (int32_t)((unsigned)i * 7919u % 20000u) - 10000;
        assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, (uint32_t)target), 0);
        assert_int_equal(sim_read(sim, 0x0100, 120, words), 0);
        unsigned count = words[6];
        for (unsigned k = 0; k < count; k++)
            assert_int_equal(regmap_load_U32(words + 8 + 14 * k), regmap_load_U32(words + 4) + k);
        assert_int_equal(sim_write32(sim, REGMAP_ADDR_event_from, regmap_load_U32(words)), 0);
        sim_advance(sim, 20011);
    }
    simcart_settle(sim);
    assert_int_equal(sim_truth(sim).pulses[HAL_PAN], target);
    assert_int_equal(sim_firmware(sim)->estop.fault, FAULT_NONE);
    assert_int_equal(simcart_get32(sim, REGMAP_ADDR_event_overrun), 0);
    sim_destroy(sim);
}

static void faults_have_names_and_nonsense_is_refused(void **state) {
    (void)state;
    for (int i = 0; i < SIM_FAULT_COUNT; i++) {
        assert_int_equal(sim_fault_find(sim_fault_name((enum sim_fault)i)), i);
        assert_true(strlen(sim_fault_text((enum sim_fault)i)) > 5);
    }
    assert_int_equal(sim_fault_find("no such fault"), SIM_FAULT_COUNT);
    assert_string_equal(sim_fault_name(SIM_FAULT_COUNT), "unknown");
    assert_string_equal(sim_fault_text((enum sim_fault)999), "unknown");
    struct sim_config config = simcart_config();
    struct sim *sim = sim_create(&config);
    assert_false(sim_fault_at(sim, SIM_FAULT_ESTOP, 0, NAN));
    assert_false(sim_fault_at(sim, SIM_FAULT_LINE_NOISE, 0, 1.5));
    assert_false(sim_fault_at(sim, SIM_FAULT_FLASH_FLIP, 0, 1e6));
    assert_false(sim_fault_at(sim, SIM_FAULT_STACK, 0, 70000));
    assert_false(sim_fault_at(sim, SIM_FAULT_MIRROR_SURGE, 0, 11));
    assert_false(sim_fault_at(sim, SIM_FAULT_ENCODER_SLIP, 0, 40000));
    assert_false(sim_fault_at(sim, SIM_FAULT_OVER_TEMP, 0, -2000));
    assert_false(sim_fault_at(sim, SIM_FAULT_COUNT, 0, 1));
    for (int i = 0; i < 64; i++)
        assert_true(sim_fault_at(sim, SIM_FAULT_DOOR, 1000000, 0));
    assert_false(sim_fault_at(sim, SIM_FAULT_DOOR, 1000000, 0)); /* full */
    sim_advance(sim, 1000001);
    assert_true(sim_fault_at(sim, SIM_FAULT_DOOR, 2000000, 0));
    sim_destroy(sim);
}

static void every_fault_can_happen_at_any_time_without_harm_to_the_simulator(void **state) {
    (void)state;
    for (int f = 0; f < SIM_FAULT_COUNT; f++) {
        struct sim_config config = simcart_config();
        struct sim *sim = simcart_commissioned(&config);
        simcart_light(sim);
        assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 3000), 0);
        assert_true(sim_fault_at(sim, (enum sim_fault)f, sim_now_us(sim) + 12345, 1));
        sim_advance(sim, 300000);
        assert_true(sim_fault_at(sim, (enum sim_fault)f, sim_now_us(sim) + 111, 0));
        sim_advance(sim, 300000);
        sim_destroy(sim);
    }
}

static void senseless_configurations_give_no_cart(void **state) {
    (void)state;
    struct sim_config good = sim_config_default(), bad;
#define REFUSES(change)                                                                            \
    bad = good;                                                                                    \
    bad.change;                                                                                    \
    assert_null(sim_create(&bad))
    REFUSES(poll_us = 0);
    REFUSES(baud = 0);
    REFUSES(encoder_counts = 0);
    REFUSES(mirror_tau_s = 0);
    REFUSES(mirror_gain_rps = NAN);
    REFUSES(temperature_c = INFINITY);
    REFUSES(axis[0].travel_max = -20000);
    REFUSES(axis[1].start = 1e6);
    REFUSES(axis[1].backlash = -1);
    REFUSES(mirror_ripple = 1);
    REFUSES(capture_jitter_us = -1);
    sim_destroy(NULL);
}

static void power_loss_in_the_middle_of_a_move_leaves_a_working_controller(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    struct sim *sim = simcart_commissioned(&config);
    simcart_light(sim);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 3000), 0);
    assert_true(sim_fault_at(sim, SIM_FAULT_POWER, sim_now_us(sim) + 300000, 1));
    sim_advance(sim, 400000);
    assert_false(sim_truth(sim).laser || sim_truth(sim).motors);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_commission_state), COMMISSION_VALID);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_reset_cause), RESETCAUSE_POWER);
    assert_int_equal((int32_t)simcart_get32(sim, REGMAP_ADDR_pan_actual), 0);
    assert_true(sim_truth(sim).motor_steps[HAL_PAN] > 100); /* the cart stayed where it was */
    sim_destroy(sim);
}

/* Index pulses and steps as an observer sees them. */
struct watch {
    struct sim *sim;
    double index_us[64], pulse_us[64];
    unsigned indexes, pulses, steps;
    bool steps_fit;
};

static void watch_index(void *ctx, double exact_us, uint64_t turn) {
    struct watch *w = ctx;
    (void)turn;
    if (w->indexes < 64)
        w->index_us[w->indexes++] = exact_us;
}

static void watch_pulse(void *ctx, double exact_us) {
    struct watch *w = ctx;
    if (w->pulses < 64)
        w->pulse_us[w->pulses++] = exact_us;
}

static void watch_step(void *ctx, uint64_t t_us, enum hal_axis axis, bool positive) {
    struct watch *w = ctx;
    struct sim_step step = sim_step(w->sim, axis);
    if (axis != HAL_PAN)
        return;
    w->steps++;
    w->steps_fit = w->steps_fit && step.positive == positive && step.since_us < (double)t_us &&
                   fabs(step.due_us - (double)t_us) <= 2;
}

static const struct sim_observer watcher = {
    .index = watch_index, .pulse = watch_pulse, .step = watch_step};

static void an_uneven_mirror_gives_even_index_periods_and_uneven_angles(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    config.mirror_ripple = 0.05;
    config.mirror_ripple_phase_rad = 1;
    struct sim *sim = simcart_commissioned(&config);
    simcart_light(sim);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_host_timeout_ms, 5000), 0);
    sim_advance(sim, 3000000);
    struct watch w = {.sim = sim, .steps_fit = true};
    sim_observe(sim, &watcher, &w);
    assert_true(sim_fault_at(sim, SIM_FAULT_INDEX_MISSING, sim_now_us(sim) + 300000, 2));
    static double at_us[2000], rev[2000];
    for (int i = 0; i < 2000; i++) {
        sim_advance(sim, 500);
        at_us[i] = (double)sim_now_us(sim);
        rev[i] = sim_truth(sim).mirror_rev;
    }
    double turn_us = w.index_us[1] - w.index_us[0], widest = 0;
    for (unsigned i = 1; i < w.indexes; i++)
        assert_true(fabs(w.index_us[i] - w.index_us[i - 1] - turn_us) < 0.01 * turn_us);
    for (int i = 0; i < 2000; i++) { /* an even mirror would be at this part of the first turn */
        double even = (at_us[i] - w.index_us[0]) / turn_us;
        if (even > 0 && even < 1)
            widest = fmax(widest, fabs(rev[i] - floor(rev[i]) - even));
    }
    /* sin(angle + phase) less its value at the index, 0.05 / 2 pi of a turn each */
    assert_true(fabs(widest - 0.05 / 6.2832 * (1 + sin(1))) < 0.001);
    assert_int_equal(w.pulses + 2, w.indexes); /* the wires do not carry the missing ones */
    sim_destroy(sim);
}

static void an_observer_knows_the_step_that_is_due(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    struct sim *sim = simcart_commissioned(&config);
    simcart_light(sim);
    struct watch w = {.sim = sim, .steps_fit = true};
    sim_observe(sim, &watcher, &w);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 300), 0);
    sim_advance(sim, 1500000);
    assert_int_equal(w.steps, 300);
    assert_true(w.steps_fit);
    assert_false(sim_step(sim, HAL_PAN).pending);
    assert_int_equal(sim_step(sim, HAL_PAN).counted, 300);
    sim_destroy(sim);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_uneven_mirror_gives_even_index_periods_and_uneven_angles),
        cmocka_unit_test(an_observer_knows_the_step_that_is_due),
        cmocka_unit_test(same_seed_gives_the_same_run_to_the_bit),
        cmocka_unit_test(instances_do_not_know_of_each_other),
        cmocka_unit_test(how_time_is_cut_into_advances_does_not_matter),
        cmocka_unit_test(line_keeps_its_baud_rate_and_the_reply_waits_for_the_gap),
        cmocka_unit_test(frame_split_by_less_than_the_gap_is_one_frame),
        cmocka_unit_test(two_frames_with_a_gap_between_are_two_even_if_the_loop_is_slow),
        cmocka_unit_test(two_frames_glued_together_get_silence),
        cmocka_unit_test(flood_is_counted_and_the_next_request_is_answered),
        cmocka_unit_test(noise_on_the_line_never_gives_a_wrong_value),
        cmocka_unit_test(interrupts_between_any_two_lines_of_the_loop_do_no_harm),
        cmocka_unit_test(faults_have_names_and_nonsense_is_refused),
        cmocka_unit_test(every_fault_can_happen_at_any_time_without_harm_to_the_simulator),
        cmocka_unit_test(senseless_configurations_give_no_cart),
        cmocka_unit_test(power_loss_in_the_middle_of_a_move_leaves_a_working_controller),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
