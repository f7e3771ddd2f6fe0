/* A capture that dies at any instant: killed 200 times (SCANCART_KILLS for more), each time the
 * site is good, lacks at most a second, and the scan goes on; in the end the union is what an
 * undisturbed run covers. The same where the power goes after each of the batches in turn, which
 * needs no luck. What fails is told with the state of the site; SCANCART_KEEP=1 leaves the site
 * where it is, SCANCART_KILL_US=n chooses instants within the first n microseconds. */
#define _DEFAULT_SOURCE /* MAP_ANONYMOUS */
#include "base/clock.h"
#include "site/site_check.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/fake_scan.h"
#include "tests/support/prop.h"
#include "tests/support/tempdir.h"

#include <limits.h>
#include <math.h>
#include <signal.h>
#include <stdarg.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <time.h>

enum { KILLS = 200, KILLS_A_SITE = 8, SAMPLE_HZ = 2000, CUT_MS = 200, LONGEST_US = 250000 };
static const double degrees = 8;

struct shared { /* with the child */
    _Atomic uint64_t handed_over;
    char text[1024]; /* what its scan ended with */
};

static char dir[TEMPDIR_MAX];
static char path[TEMPDIR_MAX + 32]; /* of the site at hand */
static struct shared *shared;
static struct resume whole, before, at; /* undisturbed; before and after the last kill */
static char last_kill[160];             /* how to tell it */

static int set_up(void **state) {
    (void)state;
    shared = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    return shared == MAP_FAILED || !tempdir_make(dir);
}

static int tear_down(void **state) {
    (void)state;
    if (getenv("SCANCART_KEEP"))
        (void)printf("kept: %s\n", dir);
    else
        tempdir_remove(dir);
    return 0;
}

/* ---- what is told where a claim does not hold ---- */

static void tell_resume(const char *name, const struct resume *r) {
    double turn = r->plan.steps_per_revolution;
    (void)printf("  %s: %u sessions, the newest on stream %lld; %.4f covered, %u photographs, %s\n",
                 name, r->sessions, (long long)r->last_stream_id, r->covered, r->photos,
                 r->complete ? "complete" : "not complete");
    (void)printf("    planned %d..%d steps, %g a turn; left %d..%d; has", r->plan.pan_from_steps,
                 r->plan.pan_to_steps, turn, r->rest.pan_from_steps, r->rest.pan_to_steps);
    for (size_t i = 0; i < r->spans; i++)
        (void)printf(" %.2f..%.2f", r->span[i].from_steps, r->span[i].to_steps);
    (void)printf("\n");
}

static void tell_files(void) {
    DIR *entries = opendir(path);
    (void)printf("  files:");
    for (struct dirent *e = entries ? readdir(entries) : NULL; e; e = readdir(entries)) {
        char name[sizeof path + 260];
        struct stat info = {0};
        (void)snprintf(name, sizeof name, "%s/%s", path, e->d_name);
        if (e->d_name[0] != '.' && !stat(name, &info))
            (void)printf(" %s (%lld)", e->d_name, (long long)info.st_size);
    }
    (void)printf("\n");
    if (entries)
        (void)closedir(entries);
}

/* Fails with all that is known of the site, where the claim does not hold. */
static void claim(bool holds, const char *fmt, ...) ST_PRINTF(2, 3);
static void claim(bool holds, const char *fmt, ...) {
    char text[400];
    va_list args;
    if (holds)
        return;
    va_start(args, fmt);
    (void)vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    struct site_check_result result = {0};
    struct errctx err = {0};
    (void)printf("FAILED: %s\n  %s\n", text, last_kill);
    enum st st = site_check(path, NULL, &result, &err);
    (void)printf("  check: %s, %llu errors %s %s %s\n", st_name(st),
                 (unsigned long long)result.errors, st ? err.text : "", result.first.where,
                 result.first.what);
    (void)printf("  head: %llu packets handed over, %lld stored; the scan said: %s\n",
                 (unsigned long long)shared->handed_over, (long long)fake_scan_packets(path),
                 shared->text[0] ? shared->text : "nothing");
    tell_resume("undisturbed", &whole);
    tell_resume("before", &before);
    tell_resume("after", &at);
    tell_files();
    (void)fflush(stdout);
    fail_msg("%s; %s", text, last_kill);
}

/* ---- one scan ---- */

static enum st scan(int64_t power_ns, struct errctx *err) {
    struct scan_plan plan = fake_scan_plan(degrees);
    struct fake_cart_spec spec = {.sample_hz = SAMPLE_HZ,
                                  .host_offset_ns = 7000000000,
                                  .power_ns = power_ns,
                                  .handed_over = &shared->handed_over};
    struct session_result result;
    return fake_scan_run(path, &plan, &spec, &result, err);
}

/* Starts a scan, kills it after `us` (0: lets it end). Returns true if it was killed. */
static bool scan_and_kill(uint32_t us) {
    int status = 0;
    shared->handed_over = 0;
    shared->text[0] = '\0';
    (void)fflush(NULL);
    pid_t child = fork();
    claim(child >= 0, "no other process can be started");
    if (!child) {
        struct errctx err = {0};
        enum st st = scan(0, &err);
        if (st)
            (void)snprintf(shared->text, sizeof shared->text, "%s: %s", st_name(st), err.text);
        _exit(st ? 1 : 0);
    }
    if (us) {
        struct timespec t = {us / 1000000, (long)(us % 1000000) * 1000};
        (void)nanosleep(&t, NULL);
        claim(!kill(child, SIGKILL), "the child cannot be killed");
    }
    claim(waitpid(child, &status, 0) == child, "the child cannot be waited for");
    if (WIFSIGNALED(status) && us && WTERMSIG(status) == SIGKILL)
        return true;
    claim(WIFEXITED(status) && !WEXITSTATUS(status),
          "a scan failed by itself (wait status 0x%x): %s", (unsigned)status, shared->text);
    return false;
}

static void verify(void) {
    struct site_check_result result = {0};
    struct errctx err = {0};
    enum st st = site_check(path, NULL, &result, &err);
    claim(!st || st == ST_NOT_FOUND, "the site cannot be checked: %s", err.text);
    claim(!result.errors, "the site is not good: %s: %s", result.first.where, result.first.what);
}

/* Stored by the newest session against what it had been given: at most a second is missing. */
static int64_t check_lost(void) {
    memset(&at, 0, sizeof at);
    if (!fake_scan_state(path, &at)) {
        claim(!before.sessions, "what had been scanned cannot be found any more");
        return 0;
    }
    claim(at.sessions >= before.sessions, "a session has gone");
    claim(at.covered >= before.covered, "what was covered is not covered any more");
    claim(at.photos >= before.photos, "a photograph has gone");
    if (at.sessions == before.sessions)
        return 0; /* it had not begun to measure */
    int64_t lost = (int64_t)shared->handed_over - fake_scan_packets(path);
    claim(lost >= 0 && lost <= SAMPLE_HZ / 34 + 1, "%lld packets lost", (long long)lost);
    return lost;
}

static void remember(void) {
    memset(&before, 0, sizeof before);
    (void)fake_scan_state(path, &before);
}

/* The same positions, but for the part of a turn that chance decides at either end. */
static void check_whole(void) {
    verify();
    claim(fake_scan_state(path, &at) && at.complete, "the scan is not complete");
    double turn = at.plan.steps_per_revolution;
    claim(at.spans == 1, "the scan is in %zu pieces", at.spans);
    claim(fabs(at.span[0].from_steps - whole.span[0].from_steps) <= turn, "the scan begins late");
    claim(fabs(at.span[0].to_steps - whole.span[0].to_steps) <= turn, "the scan ends early");
    claim(!memcmp(at.photo, whole.photo, sizeof at.photo), "other photographs");
}

/* Returns how long it took. */
static uint32_t scan_undisturbed(void) {
    int64_t start_ns = clock_now_ns();
    (void)snprintf(path, sizeof path, "%.500s/whole", dir);
    (void)snprintf(last_kill, sizeof last_kill, "undisturbed");
    memset(&before, 0, sizeof before);
    memset(&at, 0, sizeof at);
    memset(&whole, 0, sizeof whole);
    claim(!scan_and_kill(0), "killed by somebody else");
    int64_t took_ns = clock_now_ns() - start_ns;
    claim(fake_scan_state(path, &whole) && whole.complete && whole.spans == 1,
          "an undisturbed scan is not complete");
    tempdir_remove(path);
    return took_ns < LONGEST_US * (int64_t)1000 ? (uint32_t)(took_ns / 1000) : LONGEST_US;
}

/* ---- the claims ---- */

static void killed_at_any_instant_it_goes_on_and_the_union_is_whole(void **state) {
    (void)state;
    uint64_t seed = prop_seed();
    struct rng rng = rng_make(seed);
    const char *more = getenv("SCANCART_KILLS"), *within = getenv("SCANCART_KILL_US");
    int kills = more ? atoi(more) : KILLS, killed = 0, sites = 0, resumed = 0;
    int64_t worst = 0;
    uint32_t within_us = scan_undisturbed(); /* while others work it may be far too long */
    within_us = within && atoi(within) > 0 ? (uint32_t)atoi(within) : within_us;
    while (killed < kills) {
        (void)snprintf(path, sizeof path, "%.500s/site%d", dir, sites++);
        bool ended = false;
        for (int i = 0; i < KILLS_A_SITE && killed < kills && !ended; i++) {
            uint32_t us = 1 + rng_below(&rng, within_us);
            (void)snprintf(last_kill, sizeof last_kill,
                           "seed %llu, site %d, kill %d of it (%d of all), %u us after its start",
                           (unsigned long long)seed, sites - 1, i, killed, us);
            remember();
            ended = !scan_and_kill(us);
            killed += !ended;
            verify();
            int64_t lost = check_lost();
            worst = lost > worst ? lost : worst;
        }
        remember();
        claim(!scan_and_kill(0), "killed by somebody else");
        if (sites % 20 == 0) {
            (void)printf("%d kills, at most %lld packets lost\n", killed, (long long)worst);
            (void)fflush(stdout);
        }
        check_whole();
        resumed += at.sessions > 1;
        tempdir_remove(path);
    }
    (void)printf("%d kills of %d scans (%d went on in parts), at most %lld of %d packets a second "
                 "lost\n",
                 killed, sites, resumed, (long long)worst, SAMPLE_HZ / 34);
    claim(resumed > 0, "no scan went on in parts");
}

/* Cuts the power of a scan after power_ns of its own time. Returns false if it ended before. */
static bool scan_and_cut(int64_t power_ns) {
    struct errctx err = {0};
    shared->handed_over = 0;
    shared->text[0] = '\0';
    enum st st = scan(power_ns, &err);
    (void)snprintf(shared->text, sizeof shared->text, "%s: %s", st_name(st), st ? err.text : "");
    claim(!st || st == ST_CANCELLED, "a scan failed by itself: %s", err.text);
    return st == ST_CANCELLED;
}

/* Cuts a scan at from_ms, from_ms + CUT_MS, ... of its session, until to_ms or its end. Where
 * first_ms > 0 the scan has been cut there before, and the session is the one that goes on. */
static int cut_each(int first_ms, int from_ms, int to_ms) {
    const int64_t ms = 1000000;
    int cuts = 0;
    bool cut = true;
    for (int t_ms = from_ms; cut && t_ms < to_ms; t_ms += CUT_MS) {
        (void)snprintf(path, sizeof path, "%.500s/cut%d-%d", dir, first_ms, cuts++);
        (void)snprintf(last_kill, sizeof last_kill, "power cut at %d, then at %d ms", first_ms,
                       t_ms);
        if (first_ms)
            (void)scan_and_cut(first_ms * ms);
        remember();
        cut = scan_and_cut(t_ms * ms);
        verify();
        (void)check_lost();
        remember();
        (void)scan_and_cut(0);
        check_whole();
        tempdir_remove(path);
    }
    return cuts;
}

static void cut_after_each_batch_it_goes_on_and_the_union_is_whole(void **state) {
    (void)state;
    enum { FROM_MS = 16000, TO_MS = 24000 }; /* around the end of the second session's sweep */
    (void)scan_undisturbed();
    int once = cut_each(0, CUT_MS, INT_MAX);
    int twice = cut_each(19433, FROM_MS, TO_MS) + cut_each(17000, FROM_MS, TO_MS);
    (void)printf("%d scans cut once, %d twice\n", once, twice);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(killed_at_any_instant_it_goes_on_and_the_union_is_whole,
                                        set_up, tear_down),
        cmocka_unit_test_setup_teardown(cut_after_each_batch_it_goes_on_and_the_union_is_whole,
                                        set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
