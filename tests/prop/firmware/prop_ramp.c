/* Velocity ramps against the ideal trapezoid in long double, over random moves. With a file name in
 * SCANCART_MOTION_CSV it also writes the histogram of interval errors that the manual plots. */
#include "firmware/core/ramp.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/prop.h"

#include <math.h>

enum { MOVES = 10000, RETARGETS = 4000, LONGEST = 20000, BINS = 201 };

/* An interval is the difference of two times that were rounded to ticks: off by one tick at most,
 * plus what the integer roots and the 1/256 us of the ramp's own time contribute. */
static const double interval_tolerance_us = 1.02;

static uint64_t seed;
static long histogram[BINS]; /* interval errors, -1 to 1 us */

/* The ideal move: time at which way x is reached, from rest to rest over `way` with velocity v and
 * acceleration a. */
struct ideal {
    long double way, v, a, t_ramp, x_ramp, t_end;
};

static struct ideal ideal_make(uint32_t way, uint32_t velocity_max, uint32_t acceleration) {
    struct ideal m = {.way = way, .v = velocity_max / 1000.0L, .a = acceleration};
    m.x_ramp = m.v * m.v / (2 * m.a);
    if (2 * m.x_ramp > m.way) { /* a triangle: the limit is never reached */
        m.x_ramp = m.way / 2;
        m.v = sqrtl(2 * m.a * m.x_ramp);
    }
    m.t_ramp = m.v / m.a;
    m.t_end = 2 * m.t_ramp + (m.way - 2 * m.x_ramp) / m.v;
    return m;
}

static long double ideal_time(const struct ideal *m, uint32_t step) {
    long double x = step;
    if (x <= m->x_ramp)
        return sqrtl(2 * x / m->a);
    if (m->way - x <= m->x_ramp)
        return m->t_end - sqrtl(2 * (m->way - x) / m->a);
    return m->t_ramp + (x - m->x_ramp) / m->v;
}

static uint32_t log_uniform(struct rng *rng, double low, double high) {
    return (uint32_t)(low * pow(high / low, rng_uniform(rng)));
}

struct limits {
    uint32_t velocity_max, acceleration;
};

/* Limits at which the time base still resolves single steps: 0.1 to 20 000 steps/s. */
static struct limits random_limits(struct rng *rng) {
    return (struct limits){log_uniform(rng, 100, 20000001), log_uniform(rng, 100, 1000001)};
}

static void intervals_are_within_a_tick_of_the_ideal_ramp(void **state) {
    (void)state;
    long steps = 0;
    double worst_interval = 0, worst_time = 0;
    for (uint64_t i = 0; i < MOVES; i++) {
        struct rng rng = rng_stream(seed, i);
        struct limits limits = random_limits(&rng);
        uint32_t way = log_uniform(&rng, 1, LONGEST), made = 0;
        uint64_t start_us = rng_u64(&rng) >> 20;
        struct ideal ideal = ideal_make(way, limits.velocity_max, limits.acceleration);
        struct ramp ramp;
        ramp_init(&ramp);
        ramp_start(&ramp, start_us * RAMP_FINE, way, limits.velocity_max, limits.acceleration);
        uint64_t last_us = start_us;
        long double last_ideal = 0;
        do {
            uint64_t due_us = ramp_due_us(&ramp);
            long double ideal_us = 1e6L * ideal_time(&ideal, ++made);
            double interval = (double)((long double)(due_us - last_us) - (ideal_us - last_ideal));
            double time = (double)((long double)(due_us - start_us) - ideal_us);
            worst_interval = fmax(worst_interval, fabs(interval));
            worst_time = fmax(worst_time, fabs(time));
            long bin = lround((interval + 1) * (BINS - 1) / 2);
            histogram[bin < 0 ? 0 : bin >= BINS ? BINS - 1 : bin]++;
            if (fabs(interval) > interval_tolerance_us)
                fail_msg("move %llu (%u steps, v %u, a %u), step %u: interval off by %.3f us",
                         (unsigned long long)i, way, limits.velocity_max, limits.acceleration, made,
                         interval);
            last_us = due_us;
            last_ideal = ideal_us;
            steps++;
        } while (ramp_advance(&ramp));
        assert_int_equal(made, way); /* exact arrival */
        assert_false(ramp.pending);
    }
    print_message("%d moves, %ld steps: worst interval error %.3f us, worst time error %.3f us\n",
                  MOVES, steps, worst_interval, worst_time);
}

/* Least time for one step from w0 to w1 (squares of 0.001 steps/s) within the limits: up as far as
 * they allow, then down. */
static double least_time_us(double w0, double w1, double g, double w_max, double acceleration) {
    double peak = fmin((w0 + w1 + g) / 2, fmax(w_max, fmax(w0, w1)));
    double ramps = (2 * sqrt(peak) - sqrt(w0) - sqrt(w1)) / (1000 * acceleration);
    double way_left = g - (peak - w0) - (peak - w1);
    return 1e6 * (ramps + fmax(way_left, 0) / g * 1000 / sqrt(peak));
}

static void limits_hold_through_any_change_of_target(void **state) {
    (void)state;
    long changes = 0, steps = 0;
    for (uint64_t i = 0; i < RETARGETS; i++) {
        struct rng rng = rng_stream(seed ^ 0x5eed, i);
        struct limits limits = random_limits(&rng);
        uint32_t expected = log_uniform(&rng, 1, 3000), made = 0;
        struct ramp ramp;
        ramp_init(&ramp);
        ramp_start(&ramp, 0, expected, limits.velocity_max, limits.acceleration);
        double last_w = 0, last_us = 0;
        bool running = true;
        while (running) {
            double w = (double)ramp.w, g = 2e6 * limits.acceleration;
            double w_max = (double)limits.velocity_max * limits.velocity_max;
            double interval_us = (double)ramp_due_us(&ramp) - last_us;
            double least_us = least_time_us(last_w, w, g, w_max, limits.acceleration);
            assert_true(fabs(w - last_w) <= g);
            assert_true(w <= fmax(w_max, last_w));
            if (interval_us < least_us - 1.1)
                fail_msg("case %llu: a step took %.2f us, limits allow %.2f", (unsigned long long)i,
                         interval_us, least_us);
            last_w = w;
            last_us = (double)ramp_due_us(&ramp);
            made++;
            steps++;
            if (rng_below(&rng, 50) == 0 && changes < 1000000) {
                uint32_t stop = ramp_stopping(&ramp, limits.acceleration);
                uint32_t left = stop + rng_below(&rng, 1000);
                uint32_t faster = log_uniform(&rng, 100, 20000001);
                assert_true(ramp_retarget(&ramp, left, faster, limits.acceleration));
                if (stop)
                    assert_false(ramp_retarget(&ramp, stop - 1, faster, limits.acceleration));
                limits.velocity_max = faster;
                expected = made + left;
                changes++;
            }
            running = ramp_advance(&ramp) && made < 200000;
        }
        if (made < 200000)
            assert_int_equal(made, expected);
    }
    print_message("%d moves, %ld changes, %ld steps: no limit exceeded\n", RETARGETS, changes,
                  steps);
}

static void late_step_shifts_the_rest_and_loses_nothing(void **state) {
    (void)state;
    struct ramp ramp, late;
    ramp_init(&ramp);
    ramp_start(&ramp, 0, 500, 4000000, 8000);
    late = ramp;
    ramp_delay(&late, 12345 * RAMP_FINE);
    for (int i = 0; i < 499; i++) {
        assert_int_equal(ramp_due_us(&late), ramp_due_us(&ramp) + 12345);
        assert_true(ramp_advance(&ramp));
        assert_true(ramp_advance(&late));
    }
    assert_false(ramp_advance(&late));
}

static void root_is_the_floor_of_the_square_root(void **state) {
    (void)state;
    struct rng rng = rng_make(seed);
    for (int i = 0; i < 100000; i++) {
        uint64_t x = rng_u64(&rng) >> rng_below(&rng, 64), root = ramp_isqrt(x);
        assert_true(root * root <= x);
        assert_true(root == UINT32_MAX || (root + 1) * (root + 1) > x);
    }
    assert_int_equal(ramp_isqrt(UINT64_MAX), UINT32_MAX);
    assert_int_equal(ramp_isqrt(0), 0);
}

static int write_histogram(void) {
    const char *path = getenv("SCANCART_MOTION_CSV");
    FILE *file = path ? fopen(path, "w") : NULL;
    if (!file)
        return path ? 1 : 0;
    for (int i = 0; i < BINS; i++)
        (void)fprintf(file, "%.2f %ld\n", -1 + 2.0 * i / (BINS - 1), histogram[i]);
    return fclose(file);
}

int main(void) {
    seed = prop_seed();
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(intervals_are_within_a_tick_of_the_ideal_ramp),
        cmocka_unit_test(limits_hold_through_any_change_of_target),
        cmocka_unit_test(late_step_shifts_the_rest_and_loses_nothing),
        cmocka_unit_test(root_is_the_floor_of_the_square_root),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    return write_histogram() || failed;
}
