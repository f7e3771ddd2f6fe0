/* The ramps are integer arithmetic: natively and on the target core they give the same steps, to
 * the tick. The expected hash is that of the native build; a change of core/ramp that moves any
 * step changes it. */
#include "firmware/core/ramp.h"
#include "tests/support/cmocka_all.h"

enum { MOVES = 60, STEPS_MAX = 400 };

static uint32_t xorshift(uint32_t *state) {
    *state ^= *state << 13;
    *state ^= *state >> 17;
    *state ^= *state << 5;
    return *state;
}

/* FNV-1a over the 64-bit value. */
static uint32_t mix(uint32_t hash, uint64_t value) {
    for (int i = 0; i < 8; i++)
        hash = (hash ^ (uint8_t)(value >> 8 * i)) * 16777619u;
    return hash;
}

static void same_steps_on_every_machine(void **state) {
    (void)state;
    struct ramp ramp;
    uint32_t random = 2463534242u, hash = 2166136261u;
    uint64_t now_fine = 0;
    long steps = 0;
    for (int move = 0; move < MOVES; move++) {
        uint32_t way = 1 + xorshift(&random) % STEPS_MAX;
        uint32_t velocity = 100 + xorshift(&random) % 20000000;
        uint32_t acceleration = 100 + xorshift(&random) % 100000;
        ramp_init(&ramp);
        ramp_start(&ramp, now_fine, way, velocity, acceleration);
        do {
            hash = mix(hash, ramp_due_us(&ramp));
            hash = mix(hash, ramp_velocity(&ramp));
            steps++;
            if (xorshift(&random) % 64 == 0)
                (void)ramp_retarget(&ramp, xorshift(&random) % STEPS_MAX, velocity, acceleration);
            now_fine = ramp.t_fine;
        } while (ramp_advance(&ramp));
    }
    print_message("%ld steps, hash 0x%08lx\n", steps, (unsigned long)hash);
    assert_int_equal(hash, 0x857ea609u);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(same_steps_on_every_machine)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
