/* The time that devices and capture live in. Real: the host's monotonic clock, and waiting sleeps.
 * Virtual: a simulation's host clock, which stands still but in wait_until(), where it runs as fast
 * as the machine can; then one thread drives everything and the same input gives the same bytes.
 *
 * All device times (`t_ns`) are this clock's. */
#ifndef SC_DEVICE_HOSTTIME_H
#define SC_DEVICE_HOSTTIME_H

#include "base/st.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct hosttime {
    void *ctx;
    /* The host's monotonic clock now. Any thread if it is real. */
    int64_t (*now_ns)(void *ctx);
    /* Returns at t_ns or later, at once if that has passed. ST_CANCELLED: this world has ended (the
     * simulated power went). Never returns early with ST_OK. */
    enum st (*wait_until)(void *ctx, int64_t t_ns, struct errctx *err);
    bool is_virtual; /* one thread must drive all devices of this host time */
};

static inline int64_t hosttime_now_ns(const struct hosttime *hosttime) {
    return hosttime->now_ns(hosttime->ctx);
}

static inline enum st hosttime_wait_until(const struct hosttime *hosttime, int64_t t_ns,
                                          struct errctx *err) {
    return hosttime->wait_until(hosttime->ctx, t_ns, err);
}

/* The host's own clock. */
extern const struct hosttime hosttime_real;

#ifdef __cplusplus
}
#endif
#endif
