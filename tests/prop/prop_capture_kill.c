/* A capture that dies at any instant: killed 200 times (SCANCART_KILLS for more), each time the
 * site is good, lacks at most a second, and the scan goes on; in the end the union is what an
 * undisturbed run covers. */
#define _DEFAULT_SOURCE /* MAP_ANONYMOUS */
#include "base/clock.h"
#include "site/site_check.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/fake_scan.h"
#include "tests/support/prop.h"
#include "tests/support/tempdir.h"

#include <math.h>
#include <signal.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <time.h>

enum { KILLS = 200, KILLS_A_SITE = 8, SAMPLE_HZ = 2000 };
static const double degrees = 8;

static char dir[TEMPDIR_MAX];
static _Atomic uint64_t *handed_over; /* shared with the child */

static int set_up(void **state) {
    (void)state;
    handed_over =
        mmap(NULL, sizeof *handed_over, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    return handed_over == MAP_FAILED || !tempdir_make(dir);
}

static int tear_down(void **state) {
    (void)state;
    tempdir_remove(dir);
    return 0;
}

static enum st scan(const char *path, struct errctx *err) {
    struct scan_plan plan = fake_scan_plan(degrees);
    struct fake_cart_spec spec = {
        .sample_hz = SAMPLE_HZ, .host_offset_ns = 7000000000, .handed_over = handed_over};
    struct session_result result;
    return fake_scan_run(path, &plan, &spec, &result, err);
}

/* Starts a scan, kills it after `us` (0: lets it end). Returns true if it was killed. */
static bool scan_and_kill(const char *path, uint32_t us) {
    int status = 0;
    *handed_over = 0;
    (void)fflush(NULL);
    pid_t child = fork();
    assert_true(child >= 0);
    if (!child) {
        struct errctx err = {0};
        enum st st = scan(path, &err);
        if (st)
            (void)printf("scan: %s\n", err.text);
        (void)fflush(NULL);
        _exit(st ? 1 : 0);
    }
    if (us) {
        struct timespec t = {us / 1000000, (long)(us % 1000000) * 1000};
        (void)nanosleep(&t, NULL);
        assert_int_equal(kill(child, SIGKILL), 0);
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    if (WIFSIGNALED(status))
        return true;
    assert_int_equal(WEXITSTATUS(status), 0); /* it never fails by itself */
    return false;
}

static void verify(const char *path) {
    struct site_check_result result = {0};
    struct errctx err = {0};
    enum st st = site_check(path, NULL, &result, &err);
    if (st == ST_NOT_FOUND)
        return; /* killed before there was a site */
    if (st || result.errors)
        fail_msg("%s %s: %s", err.text, result.first.where, result.first.what);
}

/* Stored by the newest session against what it had been given: at most a second is missing. */
static int64_t lost_packets(const char *path, uint32_t sessions_before, struct resume *after) {
    if (!fake_scan_state(path, after) || after->sessions <= sessions_before)
        return 0; /* it had not begun to measure */
    return (int64_t)*handed_over - fake_scan_packets(path);
}

static void killed_at_any_instant_it_goes_on_and_the_union_is_whole(void **state) {
    (void)state;
    static struct resume whole, at, before;
    struct rng rng = rng_make(prop_seed());
    const char *more = getenv("SCANCART_KILLS");
    int kills = more ? atoi(more) : KILLS, killed = 0, sites = 0, resumed = 0;
    int64_t worst = 0, start_ns = clock_now_ns();
    char path[TEMPDIR_MAX + 32];
    (void)snprintf(path, sizeof path, "%.500s/whole", dir);
    assert_false(scan_and_kill(path, 0));
    uint32_t took_us = (uint32_t)((clock_now_ns() - start_ns) / 1000);
    const uint32_t longest_us = 250000; /* measured while others worked, it may be far too long */
    took_us = took_us < longest_us ? took_us : longest_us;
    assert_true(fake_scan_state(path, &whole) && whole.complete && whole.spans == 1);
    while (killed < kills) {
        (void)snprintf(path, sizeof path, "%.500s/site%d", dir, sites++);
        bool ended = false;
        for (int i = 0; i < KILLS_A_SITE && killed < kills && !ended; i++) {
            memset(&before, 0, sizeof before);
            (void)fake_scan_state(path, &before);
            ended = !scan_and_kill(path, 1 + rng_below(&rng, took_us));
            killed += !ended;
            verify(path);
            memset(&at, 0, sizeof at);
            int64_t lost = lost_packets(path, before.sessions, &at);
            worst = lost > worst ? lost : worst;
            assert_in_range(lost, 0, SAMPLE_HZ / 34 + 1);
            assert_true(at.covered >= before.covered); /* what was there stays */
            assert_true(at.photos >= before.photos);
        }
        assert_false(scan_and_kill(path, 0));
        verify(path);
        if (sites % 20 == 0) {
            (void)printf("%d kills, at most %lld packets lost\n", killed, (long long)worst);
            (void)fflush(stdout);
        }
        assert_true(fake_scan_state(path, &at));
        assert_true(at.complete);
        resumed += at.sessions > 1;
        /* the same positions, but for the part of a turn that chance decides at either end */
        double turn = at.plan.steps_per_revolution;
        assert_int_equal(at.spans, 1);
        assert_true(fabs(at.span[0].from_steps - whole.span[0].from_steps) <= turn);
        assert_true(fabs(at.span[0].to_steps - whole.span[0].to_steps) <= turn);
        assert_memory_equal(at.photo, whole.photo, sizeof at.photo);
        tempdir_remove(path);
    }
    (void)printf("%d kills of %d scans (%d went on in parts), at most %lld of %d packets a second "
                 "lost\n",
                 killed, sites, resumed, (long long)worst, SAMPLE_HZ / 34);
    assert_true(resumed > 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(killed_at_any_instant_it_goes_on_and_the_union_is_whole,
                                        set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
