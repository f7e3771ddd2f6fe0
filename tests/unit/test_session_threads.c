#define _GNU_SOURCE /* RTLD_NEXT */
/* A session with threads, in the host's real time, at a rate that keeps them busy: nothing is lost,
 * the thread sanitizer is content, and what the devices' threads do between the device and the ring
 * neither allocates, locks, formats nor writes. */
#include "base/clock.h"
#include "capture/session.h"
#include "site/site_check.h"
#include "site/station.h"
#include "site/stream.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/fast_cart.h"
#include "tests/support/tempdir.h"

#include <dlfcn.h>
#include <pthread.h>
#include <stdatomic.h>
#include <string.h>
#include <unistd.h>

static const double sample_hz = 200000;

/* ---- what must not be called on the real-time path ---- */

static _Thread_local volatile int inside; /* volatile: malloc() reads it */
static atomic_int forbidden; /* calls inside */
static atomic_int watched;   /* hand-overs */

static void on_watch(void *ctx, int begins) {
    (void)ctx;
    inside = begins;
    watched += begins;
}

#if !defined(__SANITIZE_THREAD__) && !defined(__SANITIZE_ADDRESS__)
#define INTERPOSED 1
/* The C library's own, found once before the threads start. */
static void *(*real_malloc)(size_t);
static int (*real_lock)(pthread_mutex_t *);
static ssize_t (*real_write)(int, const void *, size_t);
static int (*real_vsnprintf)(char *, size_t, const char *, va_list);

static void note(void) {
    if (inside)
        forbidden++;
}

/* The symbol as a function, past ISO C's missing conversion. */
#define FIND(function, name)                                                                       \
    do {                                                                                           \
        void *found = dlsym(RTLD_NEXT, name);                                                      \
        memcpy(&(function), &found, sizeof(function));                                             \
    } while (0)

void *malloc(size_t size);
void *malloc(size_t size) {
    if (!real_malloc)
        FIND(real_malloc, "malloc");
    note();
    return real_malloc(size);
}

int pthread_mutex_lock(pthread_mutex_t *mutex) {
    if (!real_lock)
        FIND(real_lock, "pthread_mutex_lock");
    note();
    return real_lock(mutex);
}

ssize_t write(int fd, const void *bytes, size_t size) {
    if (!real_write)
        FIND(real_write, "write");
    note();
    return real_write(fd, bytes, size);
}

int vsnprintf(char *text, size_t size, const char *format, va_list args) {
    if (!real_vsnprintf)
        FIND(real_vsnprintf, "vsnprintf");
    note();
    return real_vsnprintf(text, size, format, args);
}
#else
#define INTERPOSED 0
#endif

/* ---- the session ---- */

struct bench {
    char dir[TEMPDIR_MAX], path[TEMPDIR_MAX + 8];
    struct fast_cart *cart;
    struct cart_devices devices;
    struct site *site;
    struct scan_plan plan;
    struct session_config config;
    struct session *session;
    struct session_result result;
    struct errctx err;
    atomic_int reports;
    bool stop;
};

static void on_report(void *ctx, const struct session_status *status) {
    struct bench *b = ctx;
    b->reports++;
    if (b->stop && status->phase == DRIVE_SWEEP)
        session_stop(b->session);
}

static int set_up(void **state) {
    static struct bench bench;
    struct bench *b = *state = &bench;
    memset(b, 0, sizeof *b);
    if (!tempdir_make(b->dir))
        return -1;
    (void)snprintf(b->path, sizeof b->path, "%.500s/site", b->dir);
    struct site_info info = {0};
    struct station_pose pose = {.world_from_station = pose_identity()};
    int64_t station = 0;
    (void)snprintf(pose.source, sizeof pose.source, "nominal");
    b->cart = fast_cart_open(sample_hz);
    if (!b->cart || site_create(b->path, &info, &b->site, &b->err) ||
        station_add(b->site, "a", NULL, &pose, &station, &b->err))
        return -1;
    b->devices = fast_cart_devices(b->cart);
    b->plan = scan_plan_default(SCAN_PLAN_FIELD);
    b->plan.mirror_hz = 20;
    b->plan.steps_per_revolution = 10;
    b->plan.pan_from_steps = 0;
    b->plan.pan_to_steps = 400; /* 2 s */
    b->plan.pass_count = 0;
    b->config = (struct session_config){.devices = &b->devices,
                                        .plan = &b->plan,
                                        .site = b->site,
                                        .station_id = station,
                                        .device = "fast",
                                        .report = on_report,
                                        .report_ctx = b};
    forbidden = watched = 0;
    return 0;
}

static int tear_down(void **state) {
    struct bench *b = *state;
    session_close(b->session);
    (void)site_close(b->site, NULL);
    fast_cart_close(b->cart);
    tempdir_remove(b->dir);
    return 0;
}

static enum st run(struct bench *b) {
    enum st st = session_open(&b->config, &b->session, &b->err);
    return st ? st : session_run(b->session, &b->result, &b->err);
}

static void verify(struct bench *b) {
    struct site_check_result result = {0};
    assert_int_equal(site_close(b->site, &b->err), ST_OK);
    b->site = NULL;
    assert_int_equal(site_check(b->path, NULL, &result, &b->err), ST_OK);
    assert_int_equal(result.errors, 0);
}

static void threads_lose_nothing(void **state) {
    struct bench *b = *state;
    enum st st = run(b);
    if (st)
        fail_msg("%s", b->err.text);
    const struct recorder_counts *c = &b->result.last.counts;
    assert_true(b->result.complete);
    assert_int_equal(c->head.packets + head_ledger_lost_packets(&c->head),
                     fast_cart_packets(b->cart));
    assert_int_equal(head_ledger_lost_packets(&c->head), 0);
    assert_int_equal(c->head.samples, 34 * c->head.packets);
    assert_true(c->head.samples > sample_hz);
    assert_true(c->edges > 100 && c->index_events > 20);
    assert_true(b->reports > 0);
    verify(b);
}

static void threads_stop_on_request(void **state) {
    struct bench *b = *state;
    b->stop = true;
    b->plan.pan_to_steps = 4000;
    int64_t start_ns = clock_now_ns();
    assert_int_equal(run(b), ST_CANCELLED);
    assert_int_equal(b->result.last.phase, DRIVE_STOPPED);
    assert_int_equal(b->result.last.counts.head.packets, fast_cart_packets(b->cart));
    assert_true(clock_now_ns() - start_ns < (int64_t)15 * 1000000000); /* of a sweep of 20 s */
    verify(b);
}

static void the_way_into_the_rings_allocates_locks_and_writes_nothing(void **state) {
    struct bench *b = *state;
    if (!INTERPOSED) {
        (void)printf("SKIP: a sanitizer owns malloc\n");
        skip();
    }
    /* the counter counts at all */
    inside = 1;
    void *volatile one = malloc(1);
    inside = 0;
    free(one);
    assert_true(forbidden > 0);
    forbidden = 0;
    fast_cart_watch(b->cart, on_watch, b);
    b->plan.pan_to_steps = 200;
    assert_int_equal(run(b), ST_OK);
    assert_true(watched > 50);
    assert_int_equal(forbidden, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define T(f) cmocka_unit_test_setup_teardown(f, set_up, tear_down)
        T(threads_lose_nothing),
        T(threads_stop_on_request),
        T(the_way_into_the_rings_allocates_locks_and_writes_nothing),
#undef T
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
