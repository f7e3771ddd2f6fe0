#include "base/rng.h"
#include "tests/support/cmocka_all.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void first_numbers_are_those_of_the_published_generator(void **state) {
    (void)state;
    /* xoshiro256** from the state 1, 2, 3, 4: worked by hand from its definition */
    struct rng rng = {.s = {1, 2, 3, 4}};
    assert_true(rng_u64(&rng) == 11520); /* rotl(2 * 5, 7) * 9 */
    assert_true(rng_u64(&rng) == 0);     /* s1 became 2 ^ 3 ^ 1 = 0 */
    assert_true(rng_u64(&rng) == 1509978240);
}

static void same_seed_same_numbers_other_seed_others(void **state) {
    (void)state;
    struct rng a = rng_make(7), b = rng_make(7), c = rng_make(8);
    int equal = 0;
    for (int i = 0; i < 1000; i++) {
        uint64_t x = rng_u64(&a);
        assert_true(x == rng_u64(&b));
        equal += x == rng_u64(&c);
    }
    assert_int_equal(equal, 0);
}

static void streams_share_nothing_with_their_neighbours(void **state) {
    (void)state;
    enum { STREAMS = 64, DRAWS = 64 };
    /* bits of neighbouring streams agree half of the time: 64 * 64 * 64 coin throws, 6 sigma */
    double agree = 0, throws = 0;
    for (uint64_t i = 0; i < STREAMS; i++) {
        struct rng a = rng_stream(1, i), b = rng_stream(1, i + 1), c = rng_stream(2, i);
        for (int k = 0; k < DRAWS; k++) {
            uint64_t x = rng_u64(&a);
            agree += 64 - __builtin_popcountll(x ^ rng_u64(&b));
            agree += 64 - __builtin_popcountll(x ^ rng_u64(&c));
            throws += 128;
        }
    }
    assert_true(fabs(agree - throws / 2) < 6 * sqrt(throws) / 2);
}

static void jump_leaves_the_sequence_behind(void **state) {
    (void)state;
    struct rng a = rng_make(1), b = a, c = a;
    rng_jump(&b);
    rng_jump(&c);
    assert_memory_equal(b.s, c.s, sizeof b.s);
    assert_true(rng_u64(&a) != rng_u64(&b));
    /* jump and step commute: both are powers of one linear map */
    struct rng d = rng_make(1);
    (void)rng_u64(&d);
    rng_jump(&d);
    assert_memory_equal(b.s, d.s, sizeof b.s);
}

enum { DRAWS = 200000 };

static void uniform_has_the_moments_of_its_range(void **state) {
    (void)state;
    struct rng rng = rng_make(3);
    double sum = 0, sum2 = 0;
    for (int i = 0; i < DRAWS; i++) {
        double x = rng_range(&rng, -1, 3);
        assert_true(x >= -1 && x < 3);
        sum += x;
        sum2 += x * x;
    }
    double mean = sum / DRAWS, sigma = 4 / sqrt(12.0);
    assert_true(fabs(mean - 1) < 5 * sigma / sqrt(DRAWS));
    assert_true(fabs(sum2 / DRAWS - mean * mean - sigma * sigma) < 0.02);
}

static void normal_has_unit_variance_and_gaussian_tails(void **state) {
    (void)state;
    struct rng rng = rng_make(4);
    double sum = 0, sum2 = 0, beyond_2 = 0;
    for (int i = 0; i < DRAWS; i++) {
        double x = rng_normal(&rng);
        sum += x;
        sum2 += x * x;
        beyond_2 += fabs(x) > 2;
    }
    assert_true(fabs(sum / DRAWS) < 5 / sqrt(DRAWS));
    assert_true(fabs(sum2 / DRAWS - 1) < 5 * sqrt(2.0 / DRAWS));
    assert_true(fabs(beyond_2 / DRAWS - 0.0455) < 5 * sqrt(0.0455 / DRAWS));
}

static void below_is_even_and_in_range(void **state) {
    (void)state;
    struct rng rng = rng_make(5);
    int count[7] = {0};
    for (int i = 0; i < 70000; i++)
        count[rng_below(&rng, 7)]++;
    for (int i = 0; i < 7; i++)
        assert_true(abs(count[i] - 10000) < 500);
    assert_int_equal(rng_below(&rng, 0), 0);
    assert_int_equal(rng_below(&rng, 1), 0);
}

static void directions_have_unit_length_and_no_preference(void **state) {
    (void)state;
    struct rng rng = rng_make(6);
    struct vec3 sum = {0, 0, 0};
    for (int i = 0; i < DRAWS / 10; i++) {
        struct vec3 d = rng_direction(&rng);
        assert_true(fabs(vec3_norm(d) - 1) < 1e-14);
        sum = vec3_add(sum, d);
    }
    assert_true(vec3_norm(sum) < 6 * sqrt(DRAWS / 10.0));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(first_numbers_are_those_of_the_published_generator),
        cmocka_unit_test(same_seed_same_numbers_other_seed_others),
        cmocka_unit_test(streams_share_nothing_with_their_neighbours),
        cmocka_unit_test(jump_leaves_the_sequence_behind),
        cmocka_unit_test(uniform_has_the_moments_of_its_range),
        cmocka_unit_test(normal_has_unit_variance_and_gaussian_tails),
        cmocka_unit_test(below_is_even_and_in_range),
        cmocka_unit_test(directions_have_unit_length_and_no_preference),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
