#include "device/hosttime.h"

#include "base/clock.h"

#include <errno.h>
#include <time.h>

static int64_t real_now_ns(void *ctx) {
    (void)ctx;
    return clock_now_ns();
}

static enum st real_wait_until(void *ctx, int64_t t_ns, struct errctx *err) {
    (void)ctx;
    (void)err;
    struct timespec t = {(time_t)(t_ns / 1000000000), (long)(t_ns % 1000000000)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR)
        continue;
    return ST_OK;
}

const struct hosttime hosttime_real = {
    .ctx = NULL, .now_ns = real_now_ns, .wait_until = real_wait_until, .is_virtual = false};
