#include "twin/twin_world.h"

#include "base/clock.h"

#include <errno.h>
#include <time.h>

static const int64_t longest_ns = 250000000; /* of one advance */

int64_t twin_world_host_ns(const struct twin_devices *twin, int64_t cart_host_ns) {
    return twin->real_time ? twin->zero_ns + cart_host_ns : cart_host_ns;
}

int64_t twin_world_now_ns(const struct twin_devices *twin) {
    return twin->real_time ? clock_now_ns() : cart_clock_ns(twin->cart, TWIN_CLOCK_HOST);
}

int twin_world_put(struct twin_world_queue *queue, int capacity) {
    if (queue->put - queue->taken >= (uint64_t)capacity) {
        queue->lost++;
        return -1;
    }
    return (int)(queue->put++ % (uint64_t)capacity);
}

/* Lets the cart run to true time t_ns, in the entered world. */
static void run_to(struct twin_devices *twin, int64_t t_ns) {
    if (twin->ended)
        return;
    twin->ended = cart_advance(twin->cart, t_ns, &twin->why);
    (void)pthread_cond_broadcast(&twin->news);
}

enum st twin_world_enter(struct twin_devices *twin, struct errctx *err) {
    (void)pthread_mutex_lock(&twin->lock);
    int64_t now_ns = twin->real_time ? clock_now_ns() - twin->zero_ns : cart_time_ns(twin->cart);
    run_to(twin, now_ns);
    if (!twin->ended)
        return ST_OK;
    enum st st = errctx_set(err, twin->ended, "%s", twin->why.text);
    (void)pthread_mutex_unlock(&twin->lock);
    return st;
}

void twin_world_leave(struct twin_devices *twin) {
    (void)pthread_mutex_unlock(&twin->lock);
}

/* Virtual time: a little further, at most to the host's until_ns. */
static void step_towards(struct twin_devices *twin, int64_t until_ns, int64_t step_ns) {
    int64_t left_ns = until_ns - twin_world_now_ns(twin);
    left_ns = left_ns < 1000 ? 1000 : left_ns;
    run_to(twin, cart_time_ns(twin->cart) + (left_ns < step_ns ? left_ns : step_ns));
}

enum st twin_world_await(struct twin_devices *twin, int64_t until_ns, bool *out_over,
                         struct errctx *err) {
    *out_over = twin_world_now_ns(twin) >= until_ns;
    if (*out_over)
        return ST_OK;
    if (twin->real_time) {
        struct timespec until = {(time_t)(until_ns / 1000000000), (long)(until_ns % 1000000000)};
        (void)pthread_cond_timedwait(&twin->news, &twin->lock, &until);
    } else {
        step_towards(twin, until_ns, 1000000);
    }
    if (!twin->ended)
        return ST_OK;
    enum st st = errctx_set(err, twin->ended, "%s", twin->why.text);
    twin_world_leave(twin);
    return st;
}

int64_t twin_world_time_now(void *ctx) {
    struct twin_devices *twin = ctx;
    if (twin->real_time)
        return clock_now_ns();
    (void)pthread_mutex_lock(&twin->lock);
    int64_t now_ns = twin_world_now_ns(twin);
    (void)pthread_mutex_unlock(&twin->lock);
    return now_ns;
}

/* Sleeps until then, whatever signals come. */
static void sleep_until(int64_t t_ns) {
    struct timespec until = {(time_t)(t_ns / 1000000000), (long)(t_ns % 1000000000)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL) == EINTR) {
    }
}

enum st twin_world_time_wait(void *ctx, int64_t t_ns, struct errctx *err) {
    struct twin_devices *twin = ctx;
    if (twin->real_time)
        sleep_until(t_ns);
    enum st st = twin_world_enter(twin, err);
    if (st)
        return st;
    while (!twin->ended && twin_world_now_ns(twin) < t_ns)
        step_towards(twin, t_ns, longest_ns);
    if (twin->ended)
        st = errctx_set(err, twin->ended, "%s", twin->why.text);
    twin_world_leave(twin);
    return st;
}

void twin_world_follow(struct twin_devices *twin) {
    const int64_t beat_ns = 2000000;
    int64_t next_ns = clock_now_ns();
    for (bool more = true; more;) {
        next_ns += beat_ns;
        int64_t now_ns = clock_now_ns();
        next_ns = next_ns < now_ns - 10 * beat_ns ? now_ns : next_ns; /* far behind: no rush */
        sleep_until(next_ns);
        (void)pthread_mutex_lock(&twin->lock);
        run_to(twin, clock_now_ns() - twin->zero_ns);
        more = !twin->stopping && !twin->ended;
        (void)pthread_mutex_unlock(&twin->lock);
    }
}

enum st twin_world_request_begins(void *ctx, struct errctx *err) {
    return twin_world_enter(ctx, err);
}

enum st twin_world_request_ends(void *ctx, struct errctx *err) {
    struct twin_devices *twin = ctx;
    (void)err;
    int64_t reached_ns = cart_time_ns(twin->cart);
    (void)pthread_cond_broadcast(&twin->news);
    twin_world_leave(twin);
    if (twin->real_time) /* the request took that long */
        sleep_until(twin->zero_ns + reached_ns);
    return ST_OK;
}

int64_t twin_world_request_now(void *ctx) {
    return twin_world_time_now(ctx);
}
