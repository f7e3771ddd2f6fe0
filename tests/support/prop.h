/* Property tests: many random cases from one printed seed. SCANCART_SEED=n reruns a failure,
 * SCANCART_SEED=time looks for new ones. */
#ifndef SC_TESTS_PROP_H
#define SC_TESTS_PROP_H

#include "base/clock.h"
#include "base/rng.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The seed of this run; prints how to repeat it. */
static inline uint64_t prop_seed(void) {
    const char *text = getenv("SCANCART_SEED");
    uint64_t seed = 1;
    if (text && !strcmp(text, "time"))
        seed = (uint64_t)clock_utc_ns();
    else if (text)
        seed = strtoull(text, NULL, 0);
    (void)printf("SCANCART_SEED=%" PRIu64 "\n", seed);
    return seed;
}

#endif
