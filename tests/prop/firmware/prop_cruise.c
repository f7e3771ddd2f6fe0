/* A thousand million steps at constant velocity: 22 hours of virtual time. */
#include "firmware/core/ramp.h"
#include "tests/support/cmocka_all.h"

#include <math.h>

static void cruise_of_a_thousand_million_steps_does_not_drift(void **state) {
    (void)state;
    const uint32_t velocity_max = 12345679, acceleration = 5003, way = 1000000000;
    const long double v = velocity_max / 1000.0L, t_ramp = v / acceleration;
    const long double x_ramp = v * t_ramp / 2; /* steps in each of the two ramps */
    struct ramp ramp;
    ramp_init(&ramp);
    ramp_start(&ramp, 0, way, velocity_max, acceleration);
    uint32_t made = 1;
    double worst = 0;
    while (ramp_advance(&ramp)) {
        made++;
        if (made % 9973 == 0 && made > x_ramp && way - made > x_ramp) {
            long double ideal_us = 1e6L * (t_ramp + (made - x_ramp) / v);
            worst = fmax(worst, (double)fabsl(ramp_due_us(&ramp) - ideal_us));
        }
    }
    assert_int_equal(made, way);
    long double end_us = 1e6L * (2 * t_ramp + (way - 2 * x_ramp) / v);
    worst = fmax(worst, (double)fabsl(ramp_due_us(&ramp) - end_us));
    print_message("%u steps in %.0f s: worst time error %.3f us\n", made,
                  (double)ramp_due_us(&ramp) * 1e-6, worst);
    assert_true(worst < 0.6); /* half a tick of rounding, and the origin of the phases */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cruise_of_a_thousand_million_steps_does_not_drift),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
