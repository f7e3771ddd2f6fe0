/* The clocks over many random carts: is the pan angle of each sample within 0.05 mrad, and is its
 * stated sigma true? Prints the figures that docs/clocks.md gives. */
#include "../support/prop.h"
#include "clock_sums.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

static double log_range(struct rng *rng, double low, double high) {
    return low * pow(high / low, rng_uniform(rng));
}

/* Everything that a cart may be; what goes wrong is `wrong`. */
static struct clock_world_spec random_world(struct rng *rng, int wrong) {
    struct clock_world_spec s = clock_world_default(rng_u64(rng), 24);
    s.sample_hz = log_range(rng, 4000, 12000);
    s.mirror_hz = log_range(rng, 2, 15);
    s.mirror_wander = log_range(rng, 3e-4, 0.01);
    s.mirror_ripple = log_range(rng, 1e-4, 0.003);
    s.blind_turns = rng_range(rng, 0, 0.3);
    s.encoder_noise_counts = log_range(rng, 0.005, 0.1);
    for (int i = 0; i < 3; i++) {
        s.drift_ppm[i] = rng_range(rng, -50, 50);
        s.wander_us[i] = log_range(rng, 1, 30);
        s.offset_s[i] = rng_range(rng, 1, 5000);
    }
    s.latency_us = log_range(rng, 50, 2000);
    s.poll_s = log_range(rng, 0.02, 0.5);
    s.late_share = rng_range(rng, 0, 0.03);
    s.missing = rng_range(rng, 0, 0.03);
    s.missing_edges = rng_range(rng, 0, 0.03);
    /* beyond the ramps: what they are is told by their neighbours, which is another test */
    s.pan_start_s = -1;
    s.pan_stop_s = 100;
    s.pan_rate_steps_s = s.mirror_hz * log_range(rng, 1, 20);
    double at = rng_range(rng, 9, 15);
    if (wrong == 1)
        s.spurious_hz = 0.1 * s.mirror_hz;
    if (wrong == 2)
        s.packet_loss = 0.03, s.silent_at_s = at, s.silent_s = rng_range(rng, 0.1, 2);
    if (wrong == 3)
        s.host_jump_at_s = at, s.host_jump_s = rng_range(rng, -1, 1);
    if (wrong == 4)
        s.reset_at_s = at, s.reset_silence_s = rng_range(rng, 0.05, 1);
    if (wrong == 5)
        s.slip_at_s = at, s.slip_counts = rng_range(rng, 2, 9), s.slip_moves_index = at > 12;
    if (wrong == 6)
        s.stall_at_s = at, s.stall_s = rng_range(rng, 0.3, 2);
    if (wrong == 7)
        s.head_jump_at_s = at, s.head_jump_s = rng_range(rng, 0.05, 0.5);
    return s;
}

static const char *const wrongs[] = {"missing events",  "and spurious ones", "and lost packets",
                                     "and a host jump", "and a head reset",  "and an encoder slip",
                                     "and a stall",     "and a head jump"};

static void random_carts_keep_what_is_asked_whatever_goes_wrong(void **state) {
    (void)state;
    enum { ROUNDS = 12, WRONGS = sizeof wrongs / sizeof wrongs[0] };
    uint64_t seed = prop_seed();
    struct cart_clock_params params = cart_clock_params_default();
    struct sums all[2] = {{0}, {0}};
    print_head();
    for (int wrong = 0; wrong < WRONGS; wrong++) {
        struct sums sums[2] = {{0}, {0}};
        for (uint64_t round = 0; round < ROUNDS; round++) {
            struct rng rng = rng_stream(seed, round + 1000 * (uint64_t)wrong);
            struct clock_world_spec s = random_world(&rng, wrong);
            for (int i = 0; i < 2; i++) {
                struct clock_runs r =
                    i ? clock_runs_offline(&s, &params) : clock_runs_online(&s, &params);
                add(&sums[i], &r);
                add(&all[i], &r);
                assert_true(r.error.rms_steps > 0);
                assert_true(clock_runs_mrad(r.error.rms_steps) < asked_mrad);
            }
        }
        print(wrongs[wrong], "on line", &sums[0]);
        print("", "off line", &sums[1]);
    }
    for (int i = 0; i < 2; i++) { /* of one case alone it would be chance */
        print("all", i ? "off line" : "on line", &all[i]);
        double share = all[i].ones / (double)all[i].moving;
        assert_true(share > share_low && share < share_high);
        assert_true((double)all[i].placed > 0.85 * (double)all[i].samples);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_carts_keep_what_is_asked_whatever_goes_wrong),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
