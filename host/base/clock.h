/* Host time. All t_ns of the project are monotonic and mean nothing outside this boot; a date is
 * UTC. */
#ifndef SC_BASE_CLOCK_H
#define SC_BASE_CLOCK_H

#include <stdint.h>
#include <time.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Monotonic time, ns. Real-time safe. */
static inline int64_t clock_now_ns(void) {
    struct timespec t = {0, 0};
    (void)clock_gettime(CLOCK_MONOTONIC, &t); /* cannot fail with this clock */
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

/* The date: ns since 1970-01-01 UTC. It may jump; never use it to measure. */
static inline int64_t clock_utc_ns(void) {
    struct timespec t = {0, 0};
    (void)clock_gettime(CLOCK_REALTIME, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

#ifdef __cplusplus
}
#endif
#endif
