/* The mirror is the clock: passes, events and edges are matched whatever goes wrong; each fault is
 * noticed once, and the fit goes on after it. */
#include "base/clock_solve.h"
#include "base/clock_track.h"
#include "base/pan_curve.h"
#include "base/rng.h"
#include "base/sweep.h"
#include "clock_runs.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

/* What a fault may add to a sample's pan, steps: a twentieth of what is asked of the whole (0.05
 * mrad are 0.22 steps). Without a fault a thousandth is reached. */
static const double placed_steps = 0.01;
/* The encoder after a slip: its noise over the four samples that a slip is measured by. */
static const double slip_counts = 0.1;

/* A short, sparse world; the pan sweeps all along, so that no ramp is in it. */
static struct clock_world_spec quick(uint64_t seed) {
    struct clock_world_spec s = clock_world_default(seed, 16);
    s.sample_hz = 4000;
    s.missing = s.missing_edges = s.late_share = 0;
    s.pan_start_s = -1;
    s.pan_stop_s = 100;
    return s;
}

struct both {
    struct clock_runs run[2]; /* on line, off line */
};

static struct both run(const struct clock_world_spec *spec) {
    struct cart_clock_params params = cart_clock_params_default();
    return (struct both){{clock_runs_online(spec, &params), clock_runs_offline(spec, &params)}};
}

/* Samples are where they should be, both ways; `least`: share of them that is placed at all (some
 * lie before the first event, and an on line lock takes six turns). */
static void assert_placed(const struct both *b, double least) {
    for (int i = 0; i < 2; i++) {
        const struct clock_runs_errors *e = &b->run[i].error;
        assert_true((double)e->placed > least * (double)e->samples);
        assert_true(e->rms_steps < placed_steps && e->max_steps < 10 * placed_steps);
        assert_true(e->worst_counts < slip_counts);
    }
}

static uint64_t told(const struct both *b, int i, enum cart_clock_kind kind) {
    return b->run[i].report.incidents[kind];
}

/* Only these kinds of incidents (bits), both ways. */
static void assert_only(const struct both *b, unsigned kinds) {
    for (int i = 0; i < 2; i++)
        for (unsigned k = 0; k < CART_CLOCK_KINDS; k++)
            assert_true(!told(b, i, (enum cart_clock_kind)k) == !(kinds & 1u << k));
}

static void matches_everything_when_nothing_is_wrong(void **state) {
    (void)state;
    struct clock_world_spec s = quick(1);
    struct both b = run(&s);
    assert_placed(&b, 0.9);
    assert_only(&b, 1u << CART_CLOCK_LOCKED);
    for (int i = 0; i < 2; i++) {
        const struct cart_clock_report *r = &b.run[i].report;
        assert_true(r->head.pairs > 50 && r->head.outliers == 0 && r->head.segments == 1);
        assert_true(r->missing_events == 0 && r->spurious_events == 0 && r->unseen_turns == 0);
        assert_true(r->missing_edges == 0 && r->spurious_edges == 0 && r->host.segments == 1);
        /* -100 ppm, and what the wander adds over 12 s: 2 x 50 us */
        assert_true(fabs(r->head.drift_ppm + 100) < 10);
        assert_true(fabs(r->host.drift_ppm - 100) < 5 * r->host.drift_sigma_ppm + 10);
        assert_true(r->host.rms_ns > 5e5 && r->host.rms_ns < 2e6); /* the 1 ms of the host */
    }
}

static void missing_events_and_edges_are_counted_and_bridged(void **state) {
    (void)state;
    struct clock_world_spec s = quick(2);
    s.missing = s.missing_edges = 0.2;
    struct both b = run(&s);
    assert_placed(&b, 0.85);
    for (int i = 0; i < 2; i++) { /* those before the lock are not known to be missing */
        uint64_t seen = b.run[i].report.missing_events, were = b.run[i].done.missing_events;
        assert_true(seen <= were && seen + 3 >= were && seen > 5);
        assert_true(b.run[i].report.missing_edges > 3);
    }
}

static void spurious_events_are_told_from_real_ones(void **state) {
    (void)state;
    struct clock_world_spec s = quick(3);
    s.spurious_hz = 1;
    struct both b = run(&s);
    assert_placed(&b, 0.85);
    for (int i = 0; i < 2; i++) {
        uint64_t seen = b.run[i].report.spurious_events, were = b.run[i].done.spurious;
        assert_true(were > 5 && seen <= were && seen + 4 >= were);
        assert_true(b.run[i].report.missing_events == 0);
    }
}

static void lost_packets_cost_their_samples_alone(void **state) {
    (void)state;
    struct clock_world_spec s = quick(4);
    s.packet_loss = 0.05;
    s.silent_at_s = 8;
    s.silent_s = 2;
    struct both b = run(&s);
    assert_placed(&b, 0.85);
    assert_only(&b, 1u << CART_CLOCK_LOCKED | 1u << CART_CLOCK_PACKETS_LOST);
    for (int i = 0; i < 2; i++) /* eight turns in the silence, no event of which is spurious */
        assert_true(b.run[i].report.unseen_turns >= 6 && b.run[i].report.spurious_events == 0);
}

static void a_jump_of_the_hosts_clock_by_a_whole_turn_moves_no_sample(void **state) {
    (void)state;
    struct clock_world_spec s = quick(5);
    s.host_jump_at_s = 8;
    s.host_jump_s = -0.25;
    struct both b = run(&s);
    assert_placed(&b, 0.85);
    assert_only(&b, 1u << CART_CLOCK_LOCKED | 1u << CART_CLOCK_HOST_JUMP);
    for (int i = 0; i < 2; i++)
        assert_true(b.run[i].report.host.segments == 2 && b.run[i].report.head.segments == 1);
}

static void a_reset_head_is_matched_again(void **state) {
    (void)state;
    struct clock_world_spec s = quick(6);
    s.reset_at_s = 8;
    s.reset_silence_s = 0.6;
    struct both b = run(&s);
    assert_placed(&b, 0.85);
    assert_only(&b, 1u << CART_CLOCK_LOCKED | 1u << CART_CLOCK_HEAD_RESET);
    assert_int_equal(told(&b, 1, CART_CLOCK_LOCKED), 2);
}

static void a_jump_of_the_heads_clock_is_matched_again(void **state) {
    (void)state;
    struct clock_world_spec s = quick(7);
    s.head_jump_at_s = 8;
    s.head_jump_s = 0.3;
    struct both b = run(&s);
    assert_placed(&b, 0.85);
    assert_only(&b, 1u << CART_CLOCK_LOCKED | 1u << CART_CLOCK_HEAD_JUMP);
}

static void a_slip_of_disc_and_index_is_taken_out_of_the_counts(void **state) {
    (void)state;
    struct clock_world_spec s = quick(8);
    s.slip_at_s = 8.11;
    s.slip_counts = 3;
    s.slip_moves_index = true;
    struct both b = run(&s);
    assert_placed(&b, 0.85);
    assert_only(&b, 1u << CART_CLOCK_LOCKED | 1u << CART_CLOCK_ENCODER_SLIP);
}

static void lost_counts_are_taken_out_and_the_index_is_found_elsewhere(void **state) {
    (void)state;
    struct clock_world_spec s = quick(9);
    s.slip_at_s = 8.11;
    s.slip_counts = -5;
    struct both b = run(&s);
    assert_placed(&b, 0.85);
    assert_only(&b, 1u << CART_CLOCK_LOCKED | 1u << CART_CLOCK_ENCODER_SLIP |
                        1u << CART_CLOCK_INDEX_SHIFT);
}

static void a_stalled_mirror_is_bridged_by_time(void **state) {
    (void)state;
    struct clock_world_spec s = quick(10);
    s.stall_at_s = 7;
    s.stall_s = 1.2;
    struct both b = run(&s);
    assert_placed(&b, 0.85);
    assert_only(&b, 1u << CART_CLOCK_LOCKED | 1u << CART_CLOCK_MIRROR_SLOW);
}

static void a_restarted_controller_is_matched_again(void **state) {
    (void)state;
    struct clock_world_spec s = quick(11);
    s.restart_at_s = 8;
    struct both b = run(&s);
    assert_placed(&b, 0.8);
    assert_only(&b, 1u << CART_CLOCK_LOCKED | 1u << CART_CLOCK_CONTROLLER_RESTART);
}

/* Turns and events of a mirror that never varies. */
static void an_even_mirror_is_matched_by_arrivals(void **state) {
    (void)state;
    static struct cart_clock clock;
    struct cart_clock_params params = cart_clock_params_default();
    for (int arrivals = 0; arrivals < 2; arrivals++) {
        cart_clock_init(&clock, &params);
        for (int i = 0; i < 20; i++) {
            int64_t t = 250000000 * (int64_t)i;
            struct head_turn turn = {.t_head_ns = t,
                                     .t_host_ns = t + 1000000000,
                                     .sigma_ns = 1000,
                                     .rate_hz = 4,
                                     .epoch = 1,
                                     .run = 1,
                                     .turn = (uint32_t)i};
            struct index_event event = {.seq = (uint64_t)i,
                                        .t_ns = t + 77000000,
                                        .revolution = (uint64_t)i + 5,
                                        .pan_steps = 4 * i,
                                        .kind = INDEX_EVENT_INDEX};
            cart_clock_turn(&clock, &turn);
            cart_clock_event(&clock, &event,
                             arrivals ? turn.t_host_ns + 30000000 + 100000000 * (i % 3)
                                      : CART_CLOCK_NO_ARRIVAL);
        }
        assert_true(clock.locked == (arrivals == 1));
        assert_int_equal(clock.report.incidents[CART_CLOCK_AMBIGUOUS], arrivals);
        struct sweep_place place;
        cart_clock_place(&clock, 1, 2500000000, 0, &place);
        assert_true(place.verdict == (arrivals ? SWEEP_GOOD : SWEEP_NO_INDEX));
        assert_true(!arrivals || fabs(place.pan_steps - 40) < 0.01);
    }
}

static void what_cannot_be_known_is_not_placed(void **state) {
    (void)state;
    static struct cart_clock clock;
    struct cart_clock_params params = cart_clock_params_default();
    struct sweep_place place;
    cart_clock_init(&clock, &params);
    cart_clock_place(&clock, 0, 5, 0, &place); /* nothing has come */
    assert_true(place.verdict != SWEEP_GOOD);
    clock.head.epoch.number = 1;
    cart_clock_place(&clock, 1, 5, 0, &place); /* it may still come */
    assert_true(place.verdict == SWEEP_LATER && isnan(place.pan_sigma_steps));
    struct sweep sweep; /* off line: a gap between logs, and outside */
    struct sweep_index index[3] = {
        {.head_epoch = 1, .log = 1, .t_head_ns = 100, .t_controller_ns = 100},
        {.head_epoch = 1, .log = 1, .t_head_ns = 200, .t_controller_ns = 200, .pan_steps = 0},
        {.head_epoch = 1, .log = 2, .t_head_ns = 300, .t_controller_ns = 7}};
    sweep_init(&sweep, index, 3);
    const struct {
        uint32_t epoch;
        int64_t t_ns;
        enum sweep_verdict verdict;
    } at[] = {{1, 99, SWEEP_NO_INDEX},  {1, 100, SWEEP_GOOD},     {1, 199, SWEEP_GOOD},
              {1, 250, SWEEP_NO_INDEX}, {1, 301, SWEEP_NO_INDEX}, {2, 150, SWEEP_NO_INDEX},
              {1, 150, SWEEP_GOOD}};
    for (size_t i = 0; i < sizeof at / sizeof at[0]; i++) {
        sweep_at(&sweep.cursor, index, 3, at[i].epoch, at[i].t_ns, 12, &place);
        assert_int_equal(place.verdict, at[i].verdict);
    }
}

static void a_known_acceleration_makes_a_ramp_exact(void **state) {
    (void)state;
    struct sweep_index index[8];
    memset(index, 0, sizeof index);
    const double rate = 16, acceleration = 400, start_s = 0.61; /* a ramp of 40 ms */
    for (int i = 0; i < 8; i++) {
        double t = 0.25 * i - start_s, ramp_s = rate / acceleration;
        index[i].log = 1;
        index[i].t_controller_ns = 250000000 * (int64_t)i;
        index[i].pan_moving = t > 0;
        index[i].pan_steps = t <= 0       ? 0
                             : t < ramp_s ? 0.5 * acceleration * t * t
                                          : rate * (t - 0.5 * ramp_s);
    }
    struct pan_curve_params params = {.noise_steps = 1e-6, .acceleration_steps_s2 = acceleration};
    struct pan_curve curve;
    for (int known = 0; known < 2; known++) {
        params.acceleration_steps_s2 = known ? acceleration : 0;
        assert_true(pan_curve_make(index, 8, 2, &params, &curve));
        assert_int_equal(curve.shape, PAN_CURVE_CORNER);
        for (int k = 0; k <= 50; k++) {
            double x = 0.005 * k, t = 0.5 + x - start_s, ramp_s = rate / acceleration;
            double truth = t <= 0       ? 0
                           : t < ramp_s ? 0.5 * acceleration * t * t
                                        : rate * (t - 0.5 * ramp_s);
            struct pan_curve_point p = pan_curve_at(&curve, x);
            double off = fabs(p.pan_steps - truth);
            assert_true(known ? off < 1e-6 : off <= 3 * p.pan_sigma_steps + 1e-6);
        }
    }
}

static void a_pan_that_stepped_between_two_events_says_so(void **state) {
    (void)state;
    struct sweep_index index[2] = {{.log = 1, .t_controller_ns = 0, .pan_steps = 8},
                                   {.log = 1, .t_controller_ns = 250000000, .pan_steps = 12}};
    struct pan_curve_params params = {.noise_steps = 0};
    struct pan_curve curve;
    assert_true(pan_curve_make(index, 2, 0, &params, &curve));
    assert_int_equal(curve.shape, PAN_CURVE_UNKNOWN);
    assert_true(pan_curve_at(&curve, 0.1).pan_sigma_steps > 1); /* 4 steps over sqrt 12 */
    index[1].pan_steps = 8;
    assert_true(pan_curve_make(index, 2, 0, &params, &curve));
    assert_int_equal(curve.shape, PAN_CURVE_STANDS);
    assert_true(pan_curve_at(&curve, 0.1).pan_sigma_steps < 1e-4);
}

/* A clock that wanders by sines, pairs with noise: smoothed from both sides it is better than
 * followed, and both know how good they are. */
static void a_wandering_clock_is_followed_and_smoothed_within_its_sigma(void **state) {
    (void)state;
    enum { N = 4000 };
    static int64_t from[N], to[N];
    static double sigma[N], truth[N];
    static struct clock_track_state smoothed[N];
    struct rng rng = rng_make(12);
    struct clock_track track;
    double sum = 0, sum_smooth = 0, inside = 0, inside_smooth = 0;
    for (int i = 0; i < N; i++) {
        double t = 0.25 * i;
        truth[i] = 5e4 * t + 20000 * sin(t * 0.15) + 30000 * sin(t * 0.06 + 1);
        from[i] = 250000000 * (int64_t)i + 1000000000000;
        to[i] = from[i] - 77 + (int64_t)llround(truth[i] + 3000 * rng_normal(&rng));
        sigma[i] = 5000; /* the noise is less than was said */
        if (i)
            clock_track_update(&track, from[i], to[i], sigma[i]);
        else
            clock_track_start(&track, from[i], to[i], sigma[i], 200);
        struct clock_track_state s = clock_track_at(&track, from[i]);
        double off = (double)(clock_track_apply(&s, from[i], NULL) - from[i] + 77) - truth[i];
        if (i < 100)
            continue;
        sum += off * off;
        inside += fabs(off) < s.sigma_ns;
    }
    struct clock_track_pairs pairs = {N, from, to, sigma};
    assert_int_equal(clock_track_smooth(&pairs, 200, smoothed), ST_OK);
    for (int i = 100; i < N; i++) {
        int64_t at = clock_track_apply(&smoothed[i], from[i], NULL);
        double off = (double)(at - from[i] + 77) - truth[i];
        sum_smooth += off * off;
        inside_smooth += fabs(off) < smoothed[i].sigma_ns;
        int64_t back = clock_track_invert(&smoothed[i], at, NULL);
        assert_true(back - from[i] <= 1 && from[i] - back <= 1);
    }
    double n = N - 100;
    assert_true(fabs(clock_track_scale(&track) - 0.6) < 0.06);
    assert_true(sqrt(sum / n) < 1500 && sum_smooth < 0.6 * sum);
    assert_true(inside / n > 0.6 && inside / n < 0.76);
    assert_true(inside_smooth / n > 0.6 && inside_smooth / n < 0.8);
}

static void the_same_recording_gives_the_same_bytes(void **state) {
    (void)state;
    struct clock_world_spec s = quick(13);
    s.packet_loss = 0.02;
    struct both a = run(&s), b = run(&s);
    assert_memory_equal(&a, &b, sizeof a);
}

static void repeated_and_lost_events_are_counted(void **state) {
    (void)state;
    static struct cart_clock clock;
    struct cart_clock_params params = cart_clock_params_default();
    cart_clock_init(&clock, &params);
    struct index_event e = {.seq = 5, .t_ns = 1000000, .kind = INDEX_EVENT_INDEX};
    cart_clock_event(&clock, &e, 0);
    cart_clock_event(&clock, &e, 0);
    e.seq = 9, e.t_ns = 2000000;
    cart_clock_event(&clock, &e, 0);
    struct cart_clock_report r;
    cart_clock_report(&clock, &r);
    assert_true(r.repeated_events == 1 && r.lost_events == 3 && r.events == 2);
    assert_true(r.incidents[CART_CLOCK_CONTROLLER_RESTART] == 0);
    assert_true(isnan(r.head.drift_ppm) && r.pan_noise_steps < 0);
    e.seq = 0, e.t_ns = 500;
    cart_clock_event(&clock, &e, 0);
    assert_int_equal(clock.report.incidents[CART_CLOCK_CONTROLLER_RESTART], 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(matches_everything_when_nothing_is_wrong),
        cmocka_unit_test(missing_events_and_edges_are_counted_and_bridged),
        cmocka_unit_test(spurious_events_are_told_from_real_ones),
        cmocka_unit_test(lost_packets_cost_their_samples_alone),
        cmocka_unit_test(a_jump_of_the_hosts_clock_by_a_whole_turn_moves_no_sample),
        cmocka_unit_test(a_reset_head_is_matched_again),
        cmocka_unit_test(a_jump_of_the_heads_clock_is_matched_again),
        cmocka_unit_test(a_slip_of_disc_and_index_is_taken_out_of_the_counts),
        cmocka_unit_test(lost_counts_are_taken_out_and_the_index_is_found_elsewhere),
        cmocka_unit_test(a_stalled_mirror_is_bridged_by_time),
        cmocka_unit_test(a_restarted_controller_is_matched_again),
        cmocka_unit_test(an_even_mirror_is_matched_by_arrivals),
        cmocka_unit_test(what_cannot_be_known_is_not_placed),
        cmocka_unit_test(a_known_acceleration_makes_a_ramp_exact),
        cmocka_unit_test(a_pan_that_stepped_between_two_events_says_so),
        cmocka_unit_test(a_wandering_clock_is_followed_and_smoothed_within_its_sigma),
        cmocka_unit_test(the_same_recording_gives_the_same_bytes),
        cmocka_unit_test(repeated_and_lost_events_are_counted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
