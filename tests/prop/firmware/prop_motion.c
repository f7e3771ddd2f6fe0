/* The whole firmware on the simulated cart, moved by random Modbus commands: targets at rest and in
 * motion, stops, new limits. Every step pulse is watched. */
#include "firmware/core/firmware.h"
#include "firmware/port/sim/sim.h"
#include "firmware/shared/regmap.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/prop.h"

#include <math.h>

enum { MOVES = 10000 };

static uint64_t seed;

struct watch {
    uint64_t last_us[HAL_AXES];
    bool positive[HAL_AXES];
    int64_t position[HAL_AXES];    /* counted from the pulses alone */
    double velocity_max[HAL_AXES]; /* highest limit since the axis was last at rest, steps/s */
    double fastest;                /* worst ratio of step rate to that limit */
    long steps;
    bool too_fast;
};

static void on_step(void *ctx, uint64_t t_us, enum hal_axis axis, bool positive) {
    struct watch *w = ctx;
    double interval_us = (double)(t_us - w->last_us[axis]);
    /* One tick of rounding; after a reversal the axis was at rest, and the interval is longer
     * anyway. */
    double rate = 1e6 / (interval_us + 1);
    w->fastest = fmax(w->fastest, rate / w->velocity_max[axis]);
    w->too_fast = w->too_fast || rate > w->velocity_max[axis];
    w->last_us[axis] = t_us;
    w->positive[axis] = positive;
    w->position[axis] += positive ? 1 : -1;
    w->steps++;
}

static struct sim *moving_cart(struct watch *watch) {
    static const struct sim_observer observer = {.step = on_step};
    struct sim_config config = sim_config_default();
    config.lossless_line = true;
    config.poll_us = 1000;
    struct sim *sim = sim_create(&config);
    assert_non_null(sim);
    sim_observe(sim, &observer, watch);
    assert_int_equal(sim_write1(sim, REGMAP_ADDR_host_timeout_ms, 5000), 0);
    assert_int_equal(sim_coil(sim, REGMAP_COIL_motor_enable, true), 0);
    return sim;
}

static void set_limits(struct sim *sim, struct rng *rng, struct watch *watch) {
    for (int i = 0; i < HAL_AXES; i++) {
        /* 300 to 20 000 steps/s, 3000 to 10^6 steps/s^2 */
        uint32_t v = (uint32_t)(1000 * 300 * pow(66, rng_uniform(rng)));
        uint32_t a = (uint32_t)(3000 * pow(333, rng_uniform(rng)));
        uint16_t at = (uint16_t)(i ? REGMAP_ADDR_tilt_velocity_max : REGMAP_ADDR_pan_velocity_max);
        uint16_t acc = (uint16_t)(i ? REGMAP_ADDR_tilt_acceleration : REGMAP_ADDR_pan_acceleration);
        assert_int_equal(sim_write32(sim, at, v), 0);
        assert_int_equal(sim_write32(sim, acc, a), 0);
        watch->velocity_max[i] = v / 1000.0;
    }
}

static void wait_for_rest(struct sim *sim) {
    const struct firmware *fw = sim_firmware(sim);
    uint16_t word;
    for (int i = 0; fw->axis[HAL_PAN].active || fw->axis[HAL_TILT].active; i++) {
        assert_true(i < 10000);
        assert_int_equal(sim_read(sim, REGMAP_ADDR_state, 1, &word), 0); /* keeps the host alive */
        sim_advance(sim, 20000);
    }
}

/* Position by the registers, by the pulses and by the motor agree; the head has been pushed in
 * positive direction. */
static void check_arrival(struct sim *sim, const struct watch *watch, const int32_t *target) {
    struct sim_truth truth = sim_truth(sim);
    uint16_t words[4];
    assert_int_equal(sim_read(sim, REGMAP_ADDR_pan_actual, 4, words), 0);
    for (int i = 0; i < HAL_AXES; i++) {
        assert_int_equal(regmap_load_I32(words + 2 * i), target[i]);
        assert_int_equal(watch->position[i], target[i]);
        assert_int_equal(truth.pulses[i], target[i]);
        assert_true(truth.motor_steps[i] == target[i]);
        assert_true(truth.head_steps[i] == truth.motor_steps[i]);
    }
}

static void new_target(struct sim *sim, struct rng *rng, int32_t *target) {
    int i = (int)rng_below(rng, HAL_AXES);
    int32_t reach = i ? 3460 : 13960; /* soft limits, less the room that a run-up needs */
    if (rng_below(rng, 4) == 0)
        target[i] = (int32_t)rng_below(rng, (uint32_t)(2 * reach + 1)) - reach;
    else /* mostly near moves: reversals, run-ups, single steps */
        target[i] += (int32_t)rng_below(rng, 201) - 100;
    target[i] = target[i] > reach ? reach : target[i] < -reach ? -reach : target[i];
    uint16_t at = (uint16_t)(i ? REGMAP_ADDR_tilt_target : REGMAP_ADDR_pan_target);
    assert_int_equal(sim_write32(sim, at, (uint32_t)target[i]), 0);
}

static void random_moves_arrive_exactly_and_keep_the_limits(void **state) {
    (void)state;
    struct watch watch = {.velocity_max = {4000, 4000}};
    struct sim *sim = moving_cart(&watch);
    struct rng rng = rng_make(seed);
    int32_t target[HAL_AXES] = {0, 0};
    long in_motion = 0;
    for (int move = 0; move < MOVES; move++) {
        if (rng_below(&rng, 3) == 0) {
            wait_for_rest(sim);
            if (move > 100)
                check_arrival(sim, &watch, target);
            set_limits(sim, &rng, &watch);
        }
        const struct firmware *fw = sim_firmware(sim);
        in_motion += fw->axis[HAL_PAN].active || fw->axis[HAL_TILT].active;
        new_target(sim, &rng, target);
        sim_advance(sim, rng_below(&rng, 100000));
        assert_int_equal(fw->estop.fault, FAULT_NONE);
    }
    wait_for_rest(sim);
    check_arrival(sim, &watch, target);
    assert_false(watch.too_fast);
    assert_int_equal(sim_firmware(sim)->step_slips, 0);
    print_message("%d moves, %ld of them changed in motion, %ld steps in %.0f s: position error 0, "
                  "fastest step %.4f of its limit\n",
                  MOVES, in_motion, watch.steps, (double)sim_now_us(sim) * 1e-6, watch.fastest);
    sim_destroy(sim);
}

static void stop_ends_at_rest_where_the_pulses_say(void **state) {
    (void)state;
    struct watch watch = {.velocity_max = {4000, 4000}};
    struct sim *sim = moving_cart(&watch);
    struct rng rng = rng_make(seed + 1);
    for (int move = 0; move < 300; move++) {
        int32_t target[HAL_AXES] = {(int32_t)rng_below(&rng, 28001) - 14000, 0};
        assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, (uint32_t)target[0]), 0);
        sim_advance(sim, rng_below(&rng, 300000));
        int64_t before = watch.position[HAL_PAN];
        assert_int_equal(sim_coil(sim, REGMAP_COIL_stop, true), 0);
        wait_for_rest(sim);
        const struct axis *pan = &sim_firmware(sim)->axis[HAL_PAN];
        assert_int_equal(pan->position, watch.position[HAL_PAN]);
        /* v^2 / 2a at 4000 steps/s and 8000 steps/s^2 is 1000 steps, and what was made during the
         * request */
        assert_true(llabs(watch.position[HAL_PAN] - before) <= 1000 + 40);
    }
    assert_false(watch.too_fast);
    sim_destroy(sim);
}

static void late_interrupts_cost_time_but_no_steps(void **state) {
    (void)state;
    struct watch watch = {.velocity_max = {4000, 4000}};
    struct sim *sim = moving_cart(&watch);
    struct rng rng = rng_make(seed + 2);
    int32_t target[HAL_AXES] = {0, 0};
    for (int move = 0; move < 200; move++) {
        target[0] = (int32_t)rng_below(&rng, 8001) - 4000;
        assert_int_equal(sim_write32(sim, REGMAP_ADDR_pan_target, (uint32_t)target[0]), 0);
        sim_advance(sim, rng_below(&rng, 200000));
        assert_true(
            sim_fault_at(sim, SIM_FAULT_ALARM_LATE, sim_now_us(sim), 1 + rng_below(&rng, 3000)));
        wait_for_rest(sim);
        if (move > 0)
            check_arrival(sim, &watch, target);
    }
    assert_false(watch.too_fast); /* nothing was caught up in a burst */
    assert_true(sim_firmware(sim)->step_slips > 0);
    sim_destroy(sim);
}

int main(void) {
    seed = prop_seed();
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_moves_arrive_exactly_and_keep_the_limits),
        cmocka_unit_test(stop_ends_at_rest_where_the_pulses_say),
        cmocka_unit_test(late_interrupts_cost_time_but_no_steps),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
