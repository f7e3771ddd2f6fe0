/* Homing, backlash, mirror, encoder, scan and camera on the simulated cart. */
#include "firmware/shared/idxevent.h"
#include "tests/support/simcart.h"

#include <math.h>
#include <string.h>

static struct sim *cart_at(double pan_start, double pan_backlash) {
    struct sim_config config = simcart_config();
    config.axis[HAL_PAN].start = pan_start;
    config.axis[HAL_PAN].backlash = pan_backlash;
    return simcart_commissioned(&config);
}

static void home(struct sim *sim, uint16_t coil) {
    const struct axis *axis =
        &sim_firmware(sim)->axis[coil == REGMAP_COIL_home_pan ? HAL_PAN : HAL_TILT];
    assert_int_equal(sim_coil(sim, coil, true), 0);
    for (int i = 0; axis->homing; i++) {
        assert_true(i < 500);
        simcart_wait(sim, 100000);
    }
}

/* --- homing and backlash --------------------------------------------------------------------- */

static void homing_finds_the_edge_to_the_step_from_anywhere(void **state) {
    (void)state;
    /* outside and inside the zone, on its edge, beyond the limit switch, at the far end */
    const double starts[] = {0, -13799, -13800, -13801, -13900, -14199, -14300, 14000};
    const double plays[] = {0, 25, 39};
    for (size_t i = 0; i < sizeof starts / sizeof starts[0]; i++) {
        for (size_t k = 0; k < 3; k++) {
            struct sim *sim = cart_at(starts[i], plays[k]);
            assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
            home(sim, REGMAP_COIL_home_pan);
            const struct axis *pan = &sim_firmware(sim)->axis[HAL_PAN];
            assert_true(pan->homed);
            assert_int_equal(sim_firmware(sim)->estop.fault, FAULT_NONE);
            /* the controller's position is the plant's, as the edge lies at home_position */
            assert_true(sim_truth(sim).motor_steps[HAL_PAN] == pan->position);
            assert_true(sim_truth(sim).head_steps[HAL_PAN] == pan->position);
            sim_destroy(sim);
        }
    }
}

static void tilt_homes_as_well_and_both_at_once(void **state) {
    (void)state;
    struct sim *sim = cart_at(0, 25);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_home_tilt, true), 0);
    home(sim, REGMAP_COIL_home_pan);
    const struct firmware *fw = sim_firmware(sim);
    assert_true(fw->axis[HAL_PAN].homed && fw->axis[HAL_TILT].homed);
    assert_true(sim_truth(sim).motor_steps[HAL_TILT] == fw->axis[HAL_TILT].position);
    sim_destroy(sim);
}

static void homing_again_tells_how_many_steps_were_lost(void **state) {
    (void)state;
    struct sim *sim = cart_at(0, 25);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    home(sim, REGMAP_COIL_home_pan);
    assert_int_equal((int32_t)simcart_get32(sim, REGMAP_ADDR_pan_home_error), 0);
    assert_true(sim_fault_at(sim, SIM_FAULT_PAN_MISSED, 0, 7));
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, (uint32_t)-12000), 0);
    simcart_settle(sim);
    home(sim, REGMAP_COIL_home_pan);
    /* 7 steps in positive direction were lost: the switch is met 7 counts later than expected */
    assert_int_equal((int32_t)simcart_get32(sim, REGMAP_ADDR_pan_home_error), 7);
    assert_true(sim_truth(sim).motor_steps[HAL_PAN] == sim_firmware(sim)->axis[HAL_PAN].position);
    sim_destroy(sim);
}

static void homing_without_switch_fails_at_the_limit_and_recovers(void **state) {
    (void)state;
    struct sim *sim = cart_at(-13000, 25);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    assert_true(sim_fault_at(sim, SIM_FAULT_HOME_DEAD, 0, 1));
    home(sim, REGMAP_COIL_home_pan);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_PAN_HOMING);
    assert_int_equal(simcart_get32(sim, REGMAP_ADDR_fault_context), AXIS_HOMING_FAILED);
    assert_false(sim_firmware(sim)->axis[HAL_PAN].homed);
    assert_true(sim_fault_at(sim, SIM_FAULT_HOME_DEAD, 0, 0));
    simcart_wait(sim, 1000);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_fault_clear, FAULT_PAN_HOMING), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    home(sim, REGMAP_COIL_home_pan);
    assert_true(sim_firmware(sim)->axis[HAL_PAN].homed);
    sim_destroy(sim);
}

static void blocked_axis_does_not_home_for_ever(void **state) {
    (void)state;
    struct sim *sim = cart_at(0, 25);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    assert_true(sim_fault_at(sim, SIM_FAULT_PAN_STALL, 0, 1));
    home(sim, REGMAP_COIL_home_pan);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_PAN_HOMING);
    sim_destroy(sim);
}

static void homing_is_ended_by_stop_and_refused_while_busy(void **state) {
    (void)state;
    struct sim *sim = cart_at(0, 25);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_home_pan, true), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_home_pan, true), MBEXC_BUSY);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 5), MBEXC_BUSY);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_refusal), REFUSAL_BUSY);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_home_pan, false), 0);
    simcart_settle(sim);
    assert_false(sim_firmware(sim)->axis[HAL_PAN].homed);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_home_pan, true), 0);
    simcart_wait(sim, 200000);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_stop, true), 0);
    simcart_settle(sim);
    assert_int_equal(sim_firmware(sim)->axis[HAL_PAN].homing, AXIS_HOMING_OFF);
    sim_destroy(sim);
}

static void targets_are_approached_in_positive_direction(void **state) {
    (void)state;
    struct sim *sim = cart_at(0, 25);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    const int32_t targets[] = {500, 400, 401, 399, -10, 0, 1, 0, -13990, -14000};
    for (size_t i = 0; i < sizeof targets / sizeof targets[0]; i++) {
        assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, (uint32_t)targets[i]), 0);
        simcart_settle(sim);
        const struct axis *pan = &sim_firmware(sim)->axis[HAL_PAN];
        assert_int_equal(pan->position, targets[i]);
        if (targets[i] >= -14000 + 40) { /* below there is no room for the whole run-up */
            assert_true(sim_truth(sim).head_steps[HAL_PAN] == targets[i]);
            assert_true(simcart_get(sim, REGMAP_ADDR_pan_flags) & AXIS_POSITIVE);
        }
    }
    sim_destroy(sim);
}

static void moving_away_from_a_closed_limit_is_allowed_and_into_it_is_not(void **state) {
    (void)state;
    struct sim *sim = cart_at(0, 25);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 5000), 0);
    assert_true(sim_fault_at(sim, SIM_FAULT_PAN_LIMIT, sim_now_us(sim) + 500000, 1));
    simcart_wait(sim, 600000);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_PAN_LIMIT);
    int32_t at = (int32_t)simcart_get32(sim, REGMAP_ADDR_pan_actual);
    assert_int_equal((int32_t)simcart_get32(sim, REGMAP_ADDR_fault_context), at);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_fault_clear, FAULT_PAN_LIMIT), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, (uint32_t)(at + 10)), MBEXC_DEVICE);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_refusal), REFUSAL_LIMIT);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, (uint32_t)(at - 100)), 0);
    simcart_wait(sim, 20000); /* on its way in negative direction */
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_NONE);
    sim_destroy(sim);
}

/* --- mirror, encoder, events ----------------------------------------------------------------- */

static void mirror_settles_at_the_speed_asked_for(void **state) {
    (void)state;
    const uint16_t speeds[] = {2500, 4000, 10000};
    for (size_t i = 0; i < 3; i++) {
        struct sim_config config = simcart_config();
        config.mirror_jitter = 0.003;
        config.mirror_gain_rps = 17; /* the feed forward is off by 15 % */
        struct sim *sim = simcart_commissioned(&config);
        assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
        assert_int_equal(sim_write1(sim, REGMAP_ADDR_mirror_target, speeds[i]), 0);
        simcart_wait(sim, 20000000);
        for (int k = 0; k < 10; k++) {
            simcart_wait(sim, 500000);
            double error = sim_truth(sim).mirror_rps - speeds[i] * 1e-3;
            assert_true(fabs(error) < 0.01 * speeds[i] * 1e-3);
        }
        sim_destroy(sim);
    }
}

static void mirror_that_does_not_start_is_a_fault(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    struct sim *sim = simcart_commissioned(&config);
    assert_true(sim_fault_at(sim, SIM_FAULT_MIRROR_STALL, 0, 1));
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_mirror_target, 4000), 0);
    simcart_wait(sim, 7900000);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_NONE);
    simcart_wait(sim, 200000);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_MIRROR_STALL);
    assert_int_equal(sim_firmware(sim)->mirror.drive, 0);
    sim_destroy(sim);
}

static void dead_encoder_switches_the_laser_off(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    struct sim *sim = simcart_commissioned(&config);
    simcart_light(sim);
    assert_true(sim_fault_at(sim, SIM_FAULT_ENCODER_DEAD, sim_now_us(sim) + 1000, 1));
    sim_advance(sim, 2500);
    assert_false(sim_truth(sim).laser);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_fault_code), FAULT_MIRROR_SLOW);
    sim_destroy(sim);
}

static void
missing_and_spurious_index_pulses_are_counted_and_the_revolution_stays_right(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    config.mirror_jitter = 0.003;
    struct sim *sim = simcart_commissioned(&config);
    simcart_light(sim);
    uint32_t before = simcart_get32(sim, REGMAP_ADDR_latch_revolution);
    double turned = floor(sim_truth(sim).mirror_rev);
    assert_true(sim_fault_at(sim, SIM_FAULT_INDEX_MISSING, sim_now_us(sim), 1));
    simcart_wait(sim, 1100000);
    for (int i = 0; i < 20; i++)
        assert_true(
            sim_fault_at(sim, SIM_FAULT_INDEX_EXTRA, sim_now_us(sim) + 37137u * (unsigned)i, 1));
    simcart_wait(sim, 3000000);
    uint32_t after = simcart_get32(sim, REGMAP_ADDR_latch_revolution);
    assert_int_equal(after - before, (uint32_t)(floor(sim_truth(sim).mirror_rev) - turned));
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_index_missed), 1);
    assert_in_range(simcart_get(sim, REGMAP_ADDR_index_rejected), 17, 20);
    assert_true(
        sim_truth(sim).laser); /* one lost pulse is no danger: the encoder sees the mirror turn */
    sim_destroy(sim);
}

static void latch_is_one_instant_with_a_fraction(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    struct sim *sim = simcart_commissioned(&config);
    simcart_spin(sim);
    simcart_wait(sim, 20000000); /* as steady as it gets */
    double worst = 0;
    uint16_t words[14];
    for (int i = 0; i < 200; i++) {
        sim_advance(sim, 137);
        assert_int_equal(sim_read(sim, REGMAP_ADDR_latch_time_us, 14, words), 0);
        double t_us = (double)regmap_get_latch_time_us(words, REGMAP_ADDR_latch_time_us);
        double counts = regmap_get_latch_phase(words, REGMAP_ADDR_latch_time_us) +
                        regmap_get_latch_fraction(words, REGMAP_ADDR_latch_time_us) / 65536.0;
        /* the reply came some ms later: truth by the speed, which is steady */
        double rev = sim_truth(sim).mirror_rev -
                     ((double)sim_now_us(sim) - t_us) * 1e-6 * sim_truth(sim).mirror_rps;
        double true_counts = (rev - floor(rev)) * 4096 + 0.5; /* the index lies in mid-count */
        double error = remainder(counts - true_counts, 4096);
        worst = fmax(worst, fabs(error));
    }
    print_message("worst error of the latched encoder angle: %.3f counts\n", worst);
    assert_true(worst < 0.1); /* 1 us is 0.016 counts; the speed still drifts a little */
    sim_destroy(sim);
}

/* Reads what is new in the window, as a host does. Returns the number; `*seq` is the next wanted.
 */
static unsigned read_events(struct sim *sim, uint32_t *seq, struct idxevent *out, uint32_t *lost) {
    uint8_t reply[MBFRAME_MAX];
    uint8_t request[] = {1, 23, 1, 0, 0, IDXEVENT_WINDOW_WORDS, 0x10, 0x04, 0, 2, 4, 0, 0, 0, 0};
    mbframe_put16(request + 11, (uint16_t)(*seq >> 16));
    mbframe_put16(request + 13, (uint16_t)(*seq & 0xffff));
    assert_int_equal(sim_transact(sim, request, sizeof request, reply, 100000),
                     3 + 2 * IDXEVENT_WINDOW_WORDS);
    uint16_t words[IDXEVENT_WINDOW_WORDS];
    for (unsigned i = 0; i < IDXEVENT_WINDOW_WORDS; i++)
        words[i] = mbframe_get16(reply + 3 + 2 * i);
    unsigned count = regmap_get_event_count(words, IDXEVENT_WINDOW_ADDR);
    uint32_t first = regmap_get_event_first(words, IDXEVENT_WINDOW_ADDR);
    if (count)
        *lost += first - *seq;
    for (unsigned i = 0; i < IDXEVENT_WINDOW; i++) {
        out[i] = idxevent_decode(words + IDXEVENT_HEADER + IDXEVENT_WORDS * i);
        if (i < count)
            assert_int_equal(out[i].seq, first + i);
        else
            assert_int_equal(out[i].flags, 0);
    }
    if (count)
        *seq = first + count;
    return count;
}

struct edges {
    double us[4096];
    unsigned count;
};

static void on_index(void *ctx, double exact_us, uint64_t turn) {
    struct edges *edges = ctx;
    (void)turn;
    if (edges->count < 4096)
        edges->us[edges->count++] = exact_us;
}

static void every_index_pulse_becomes_an_event_with_its_time(void **state) {
    (void)state;
    static struct edges edges;
    static const struct sim_observer observer = {.index = on_index};
    edges.count = 0;
    struct sim_config config = simcart_config();
    config.mirror_jitter = 0.003;
    struct sim *sim = simcart_commissioned(&config);
    sim_observe(sim, &observer, &edges);
    simcart_spin(sim);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 14000), 0);
    struct idxevent events[IDXEVENT_WINDOW];
    uint32_t seq = 0, lost = 0, seen = 0;
    for (int i = 0; i < 60; i++) {
        unsigned n = read_events(sim, &seq, events, &lost);
        for (unsigned k = 0; k < n; k++, seen++) {
            assert_int_equal(events[k].seq, seen);
            assert_true(events[k].time_us == (uint64_t)edges.us[seen]);
            assert_int_equal(events[k].revolution, seen + 1);
            assert_int_equal(events[k].flags & IDXEVENT_KIND, IDXEVENT_INDEX);
        }
        sim_advance(sim, 200000);
    }
    assert_true(seen > 30);
    assert_int_equal(lost, 0);
    assert_int_equal(simcart_get32(sim, REGMAP_ADDR_event_overrun), 0);
    sim_destroy(sim);
}

static void asking_again_gives_the_same_events(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    struct sim *sim = simcart_commissioned(&config);
    simcart_spin(sim);
    simcart_wait(sim, 3000000);
    struct idxevent first[IDXEVENT_WINDOW], again[IDXEVENT_WINDOW];
    uint32_t seq = 2, same = 2, lost = 0;
    assert_int_equal(read_events(sim, &seq, first, &lost), IDXEVENT_WINDOW);
    assert_int_equal(read_events(sim, &same, again, &lost), IDXEVENT_WINDOW);
    for (unsigned i = 0; i < IDXEVENT_WINDOW; i++)
        assert_true(first[i].seq == again[i].seq && first[i].time_us == again[i].time_us);
    uint32_t future = 1000000;
    assert_int_equal(read_events(sim, &future, first, &lost), 0);
    assert_int_equal(lost, 0);
    sim_destroy(sim);
}

static void host_that_comes_late_knows_how_many_it_lost(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    struct sim *sim = simcart_commissioned(&config);
    simcart_spin(sim);
    simcart_wait(sim, 30000000); /* some 120 revolutions, the ring holds 64 */
    struct idxevent events[IDXEVENT_WINDOW];
    uint32_t seq = 0, lost = 0, seen = 0;
    for (unsigned n = IDXEVENT_WINDOW; n == IDXEVENT_WINDOW; seen += n)
        n = read_events(sim, &seq, events, &lost);
    assert_in_range(seen, EVRING_SIZE - 1, EVRING_SIZE + 2);
    assert_int_equal(lost + seen, seq);
    assert_in_range(lost, 40, 70);
    assert_in_range(simcart_get32(sim, REGMAP_ADDR_event_overrun), lost - 2, lost + 1);
    sim_destroy(sim);
}

static void pan_phase_interpolates_between_steps(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    struct sim *sim = simcart_commissioned(&config);
    simcart_spin(sim);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_velocity_max, 50000), 0); /* 50 steps/s */
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 2000), 0);
    simcart_wait(sim, 1000000);
    struct idxevent events[IDXEVENT_WINDOW];
    uint32_t seq = simcart_get32(sim, REGMAP_ADDR_event_next), lost = 0;
    simcart_wait(sim, 2200000);
    assert_int_equal(read_events(sim, &seq, events, &lost), IDXEVENT_WINDOW);
    for (unsigned i = 1; i < IDXEVENT_WINDOW; i++) {
        double way = events[i].pan_steps - events[0].pan_steps +
                     (events[i].pan_phase - events[0].pan_phase) / 65536.0;
        double expected = (double)(events[i].time_us - events[0].time_us) * 50e-6;
        assert_true(fabs(way - expected) < 0.001); /* whole steps alone would be off by up to one */
    }
    sim_destroy(sim);
}

/* --- scan and camera ------------------------------------------------------------------------- */

static struct sim *scanning_cart(int32_t from, int32_t to, uint16_t mode, uint32_t rate,
                                 uint16_t steps) {
    struct sim_config config = simcart_config();
    config.axis[HAL_PAN].start = -13700;
    struct sim *sim = simcart_commissioned(&config);
    simcart_spin(sim);
    home(sim, REGMAP_COIL_home_pan);
    uint16_t words[8];
    regmap_put_scan_from(words, 0x1020, from);
    regmap_put_scan_to(words, 0x1020, to);
    regmap_put_scan_rate(words, 0x1020, rate);
    regmap_put_scan_mode(words, 0x1020, mode);
    regmap_put_scan_steps(words, 0x1020, steps);
    assert_int_equal(sim_write(sim, 0x1020, 8, words), 0);
    return sim;
}

static void run_scan(struct sim *sim) {
    assert_int_equal(sim_coil(sim, REGMAP_COIL_scan_run, true), 0);
    for (int i = 0; sim_firmware(sim)->scan.state != SCANSTATE_DONE; i++) {
        assert_true(i < 1000);
        simcart_wait(sim, 100000);
    }
}

static void continuous_scan_sweeps_at_its_rate_in_both_directions(void **state) {
    (void)state;
    const int32_t ends[2][2] = {{-13000, -12500}, {-12500, -13000}};
    for (int i = 0; i < 2; i++) {
        struct sim *sim = scanning_cart(ends[i][0], ends[i][1], 0, 60000, 4);
        uint32_t seq = simcart_get32(sim, REGMAP_ADDR_event_next), lost = 0;
        run_scan(sim);
        assert_int_equal((int32_t)simcart_get32(sim, REGMAP_ADDR_pan_actual), ends[i][1]);
        assert_in_range(simcart_get32(sim, REGMAP_ADDR_scan_lines), 32,
                        35); /* 500 / 60 s at 4 Hz */
        struct idxevent events[IDXEVENT_WINDOW], last = {0};
        unsigned checked = 0;
        for (unsigned n = 1; n;) {
            n = read_events(sim, &seq, events, &lost);
            for (unsigned k = 0; k < n; k++) {
                bool sweep = events[k].flags & IDXEVENT_SWEEP;
                if (sweep && last.flags & IDXEVENT_SWEEP && events[k].flags & IDXEVENT_PAN_MOVING) {
                    double way = events[k].pan_steps - last.pan_steps;
                    double dt_s = (double)(events[k].time_us - last.time_us) * 1e-6;
                    assert_true(fabs(fabs(way) - 60 * dt_s) <= 1.01);
                    assert_true(events[k].flags & IDXEVENT_PAN_TAKEN_UP);
                    assert_int_equal(!!(events[k].flags & IDXEVENT_PAN_POSITIVE), i == 0);
                    checked++;
                }
                last = events[k];
            }
        }
        assert_in_range(checked, 28, 35);
        assert_int_equal(lost, 0);
        sim_destroy(sim);
    }
}

static void step_scan_moves_once_a_revolution(void **state) {
    (void)state;
    struct sim *sim = scanning_cart(-13000, -12902, 1, 14000, 4);
    uint32_t seq = simcart_get32(sim, REGMAP_ADDR_event_next), lost = 0;
    run_scan(sim);
    assert_int_equal((int32_t)simcart_get32(sim, REGMAP_ADDR_pan_actual), -12902);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_scan_overruns), 0);
    assert_int_equal(simcart_get32(sim, REGMAP_ADDR_scan_lines), 25); /* 24 times 4, then 2 */
    struct idxevent events[IDXEVENT_WINDOW];
    int32_t expected = -13000;
    for (unsigned n = 1; n;) {
        n = read_events(sim, &seq, events, &lost);
        for (unsigned k = 0; k < n; k++) {
            if (!(events[k].flags & IDXEVENT_SWEEP))
                continue;
            /* the event shows where the pan stood during the revolution that ends with it */
            assert_int_equal(events[k].pan_steps, expected);
            expected = expected + 4 > -12902 ? -12902 : expected + 4;
        }
    }
    sim_destroy(sim);
}

static void step_scan_that_cannot_keep_up_says_so(void **state) {
    (void)state;
    struct sim *sim = scanning_cart(-13000, -12000, 1, 14000, 200);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_velocity_max, 500000), 0); /* 0.4 s for 200 */
    run_scan(sim);
    assert_in_range(simcart_get(sim, REGMAP_ADDR_scan_overruns), 4, 8);
    sim_destroy(sim);
}

static void scan_of_no_width_is_done_at_once_and_wrong_ones_are_refused(void **state) {
    (void)state;
    struct sim *sim = scanning_cart(-13000, -13000, 0, 14000, 4);
    run_scan(sim);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_scan_to, 20000), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_scan_run, true), MBEXC_VALUE);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_scan_to, 0), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_scan_run, true), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_scan_run, true), MBEXC_BUSY);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 0), MBEXC_BUSY);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_home_pan, true), MBEXC_BUSY);
    simcart_wait(sim, 500000);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_scan_run, false), 0);
    simcart_settle(sim);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_scan_state), SCANSTATE_OFF);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, false), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_scan_mode, 1), 0);
    simcart_wait(sim, 5000000); /* the mirror runs down */
    assert_int_equal(sim_coil(sim, REGMAP_COIL_scan_run, true), MBEXC_DEVICE);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_refusal), REFUSAL_MIRROR);
    sim_destroy(sim);
}

static void scan_needs_a_homed_pan(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    struct sim *sim = simcart_commissioned(&config);
    simcart_spin(sim);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_scan_run, true), MBEXC_DEVICE);
    assert_int_equal(simcart_get(sim, REGMAP_ADDR_refusal), REFUSAL_NOT_HOMED);
    sim_destroy(sim);
}

struct camera {
    double strobe_us[16];
    int64_t trigger_pan[16];
    unsigned triggers, strobes;
    const struct sim *sim;
};

static void on_trigger(void *ctx, uint64_t t_us) {
    struct camera *camera = ctx;
    (void)t_us;
    camera->trigger_pan[camera->triggers++ % 16] = sim_truth(camera->sim).pulses[HAL_PAN];
}

static void on_strobe(void *ctx, double exact_us) {
    struct camera *camera = ctx;
    camera->strobe_us[camera->strobes++ % 16] = exact_us;
}

static void camera_triggers_at_pan_positions_and_latches_the_strobe(void **state) {
    (void)state;
    static const struct sim_observer observer = {.trigger = on_trigger, .strobe = on_strobe};
    struct sim_config config = simcart_config();
    config.camera_jitter_s = 0.003;
    struct sim *sim = simcart_commissioned(&config);
    struct camera camera = {.sim = sim};
    sim_observe(sim, &observer, &camera);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_camera_first, 1000), 0);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_camera_interval, 700), 0);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_camera_number, 4), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_camera_auto, true), 0);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 900), 0);
    simcart_settle(sim);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 6000), 0);
    simcart_settle(sim);
    simcart_wait(sim, 100000);
    assert_int_equal(camera.triggers, 4);
    /* armed again at a place that is passed in negative direction only: nothing */
    assert_int_equal(sim_coil(sim, REGMAP_COIL_camera_auto, true), 0);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, 500), 0);
    simcart_settle(sim);
    assert_int_equal(camera.triggers, 4);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_camera_auto, false), 0);
    for (int i = 0; i < 4; i++)
        assert_int_equal(camera.trigger_pan[i], 1000 + 700 * i);
    assert_int_equal(simcart_get32(sim, REGMAP_ADDR_trigger_count), 4);
    assert_int_equal(simcart_get32(sim, REGMAP_ADDR_strobe_count), 4);
    uint16_t words[4];
    assert_int_equal(sim_read(sim, REGMAP_ADDR_strobe_time_us, 4, words), 0);
    assert_true(regmap_load_U64(words) == (uint64_t)camera.strobe_us[3]);
    /* each strobe is also an event */
    struct idxevent events[IDXEVENT_WINDOW];
    uint32_t seq = 0, lost = 0;
    assert_int_equal(read_events(sim, &seq, events, &lost), 4);
    for (int i = 0; i < 4; i++) {
        assert_int_equal(events[i].flags & IDXEVENT_KIND, IDXEVENT_STROBE);
        assert_true(events[i].time_us == (uint64_t)camera.strobe_us[i]);
    }
    sim_destroy(sim);
}

static void camera_triggers_by_hand_and_notices_no_strobe(void **state) {
    (void)state;
    struct sim_config config = simcart_config();
    struct sim *sim = simcart_commissioned(&config);
    assert_int_equal(sim_write32(sim, REGMAP_ADDR_camera_interval, 0), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_camera_trigger, true), 0);
    assert_true(sim_truth(sim).trigger);
    simcart_wait(sim, 100000);
    assert_false(sim_truth(sim).trigger);
    assert_true(sim_fault_at(sim, SIM_FAULT_STROBE_MISSING, 0, 1));
    assert_int_equal(sim_coil(sim, REGMAP_COIL_camera_trigger, true), 0);
    simcart_wait(sim, 100000);
    assert_int_equal(simcart_get32(sim, REGMAP_ADDR_trigger_count), 2);
    assert_int_equal(simcart_get32(sim, REGMAP_ADDR_strobe_count), 1);
    /* interval 0: one trigger only, whatever the number */
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_camera_number, 9), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_camera_auto, true), 0);
    assert_int_equal(sim_firmware(sim)->strobe.left, 1);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_camera_auto, false), 0);
    assert_int_equal(sim_firmware(sim)->strobe.left, 0);
    sim_destroy(sim);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(homing_finds_the_edge_to_the_step_from_anywhere),
        cmocka_unit_test(tilt_homes_as_well_and_both_at_once),
        cmocka_unit_test(homing_again_tells_how_many_steps_were_lost),
        cmocka_unit_test(homing_without_switch_fails_at_the_limit_and_recovers),
        cmocka_unit_test(blocked_axis_does_not_home_for_ever),
        cmocka_unit_test(homing_is_ended_by_stop_and_refused_while_busy),
        cmocka_unit_test(targets_are_approached_in_positive_direction),
        cmocka_unit_test(moving_away_from_a_closed_limit_is_allowed_and_into_it_is_not),
        cmocka_unit_test(mirror_settles_at_the_speed_asked_for),
        cmocka_unit_test(mirror_that_does_not_start_is_a_fault),
        cmocka_unit_test(dead_encoder_switches_the_laser_off),
        cmocka_unit_test(
            missing_and_spurious_index_pulses_are_counted_and_the_revolution_stays_right),
        cmocka_unit_test(latch_is_one_instant_with_a_fraction),
        cmocka_unit_test(every_index_pulse_becomes_an_event_with_its_time),
        cmocka_unit_test(asking_again_gives_the_same_events),
        cmocka_unit_test(host_that_comes_late_knows_how_many_it_lost),
        cmocka_unit_test(pan_phase_interpolates_between_steps),
        cmocka_unit_test(continuous_scan_sweeps_at_its_rate_in_both_directions),
        cmocka_unit_test(step_scan_moves_once_a_revolution),
        cmocka_unit_test(step_scan_that_cannot_keep_up_says_so),
        cmocka_unit_test(scan_of_no_width_is_done_at_once_and_wrong_ones_are_refused),
        cmocka_unit_test(scan_needs_a_homed_pan),
        cmocka_unit_test(camera_triggers_at_pan_positions_and_latches_the_strobe),
        cmocka_unit_test(camera_triggers_by_hand_and_notices_no_strobe),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
