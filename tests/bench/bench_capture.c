/* Capture measured: from a head's packets to committed rows at a rate, in real time with all its
 * threads; and an hour of virtual time with flat memory.
 *
 * Usage: bench_capture throughput FOLDER SAMPLES_PER_S SECONDS
 *        bench_capture soak FOLDER SECONDS_OF_VIRTUAL_TIME
 * Prints a JSON list on stdout, words on stderr; 1 if something was lost that should not be. */
#include "base/clock.h"
#include "site/site_check.h"
#include "site/station.h"
#include "tests/support/fake_cart.h"
#include "tests/support/fake_scan.h"
#include "tests/support/fast_cart.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

static double processor_s(void) {
    struct rusage u;
    (void)getrusage(RUSAGE_SELF, &u);
    return (double)(u.ru_utime.tv_sec + u.ru_stime.tv_sec) +
           (double)(u.ru_utime.tv_usec + u.ru_stime.tv_usec) * 1e-6;
}

static double resident_mb(void) {
    long pages = 0, ignored = 0;
    FILE *f = fopen("/proc/self/statm", "r");
    if (!f || fscanf(f, "%ld %ld", &ignored, &pages) != 2)
        pages = 0;
    if (f)
        (void)fclose(f);
    return (double)pages * (double)sysconf(_SC_PAGESIZE) * 1e-6;
}

static void row(const char *name, double value, const char *unit, bool last) {
    (void)printf("  {\"name\": \"%s\", \"value\": %.6g, \"unit\": \"%s\"}%s\n", name, value, unit,
                 last ? "" : ",");
}

static struct site *new_site(const char *path, int64_t *out_station) {
    struct errctx err = {0};
    struct site *site = NULL;
    struct site_info info = {0};
    struct station_pose pose = {.world_from_station = pose_identity()};
    (void)snprintf(pose.source, sizeof pose.source, "nominal");
    if (site_create(path, &info, &site, &err) ||
        station_add(site, "a", NULL, &pose, out_station, &err)) {
        (void)fprintf(stderr, "bench_capture: %s\n", err.text);
        exit(1);
    }
    return site;
}

/* ---- throughput ---- */

static void on_status(void *ctx, const struct session_status *s) {
    (void)ctx;
    (void)fprintf(
        stderr, "  %5.1f s: %.1f M samples, %llu packets lost, ring %.0f %% full at most\n",
        s->elapsed_s, (double)s->counts.head.samples * 1e-6,
        (unsigned long long)head_ledger_lost_packets(&s->counts.head), s->ring_peak * 100);
}

static int throughput(const char *path, double sample_hz, double seconds) {
    int64_t station = 0;
    struct errctx err = {0};
    struct site *site = new_site(path, &station);
    struct fast_cart *cart = fast_cart_open(sample_hz);
    struct cart_devices devices = fast_cart_devices(cart);
    struct scan_plan plan = scan_plan_default(SCAN_PLAN_FIELD);
    plan.mirror_hz = 20;
    plan.steps_per_revolution = 5; /* 100 steps/s */
    plan.pan_from_steps = 0;
    plan.pan_to_steps = (int32_t)(100 * seconds);
    plan.pass_count = 0;
    struct session_config config = {.devices = &devices,
                                    .plan = &plan,
                                    .site = site,
                                    .station_id = station,
                                    .device = "fast",
                                    .sample_hz = sample_hz,
                                    .report = on_status};
    struct session *session = NULL;
    struct session_result result = {0};
    enum st st = session_open(&config, &session, &err);
    double before_s = processor_s();
    int64_t start_ns = clock_now_ns();
    if (!st)
        st = session_run(session, &result, &err);
    double took_s = (double)(clock_now_ns() - start_ns) * 1e-9, used_s = processor_s() - before_s;
    const struct recorder_counts *c = &result.last.counts;
    uint64_t lost = head_ledger_lost_packets(&c->head) + c->unstored_packets;
    if (st)
        (void)fprintf(stderr, "bench_capture: %s\n", err.text);
    if (result.realtime_note[0])
        (void)fprintf(stderr, "  %s\n", result.realtime_note);
    (void)printf("[\n");
    row("capture.rate", sample_hz, "samples/s", false);
    row("capture.samples", (double)c->head.samples, "samples", false);
    row("capture.ledger", (double)lost, "packets", false);
    row("capture.sent_late", (double)fast_cart_late(cart), "transfers", false);
    row("capture.processor_share", 100 * used_s / took_s, "% of one", false);
    row("capture.written", (double)c->stored_bytes * 1e-6, "MB", false);
    row("capture.batches", (double)c->batches, "", false);
    row("capture.longest_batch", (double)c->longest_batch_ns * 1e-6, "ms", false);
    row("capture.ring_peak", 100 * result.last.ring_peak, "%", true);
    (void)printf("]\n");
    bool all = c->head.packets + lost == fast_cart_packets(cart);
    if (!all)
        (void)fprintf(stderr, "bench_capture: %llu packets were handed over\n",
                      (unsigned long long)fast_cart_packets(cart));
    session_close(session);
    fast_cart_close(cart);
    st = st ? st : site_close(site, &err);
    return st || !all ? 1 : 0;
}

/* ---- soak ---- */

struct soak {
    double mb_early, mb_late;
    double half_s;
};

static void on_soak(void *ctx, const struct session_status *s) {
    struct soak *k = ctx;
    if (s->elapsed_s > k->half_s * 0.2 && k->mb_early <= 0)
        k->mb_early = resident_mb();
    k->mb_late = resident_mb();
}

static int soak(const char *path, double seconds) {
    int64_t station = 0;
    struct errctx err = {0};
    struct site *site = new_site(path, &station);
    struct fake_cart_spec spec = {.sample_hz = 25000, .host_offset_ns = 1000000000};
    struct fake_cart *cart = fake_cart_open(&spec);
    struct cart_devices devices = fake_cart_devices(cart);
    struct scan_plan plan = scan_plan_default(SCAN_PLAN_FIELD);
    struct soak k = {.half_s = seconds / 2};
    plan.pan_from_steps = -7000;
    plan.pan_to_steps = 7000;
    plan.steps_per_revolution = 14000 / seconds / plan.mirror_hz;
    struct session_config config = {.devices = &devices,
                                    .plan = &plan,
                                    .site = site,
                                    .station_id = station,
                                    .device = "fake",
                                    .report = on_soak,
                                    .report_ctx = &k};
    struct session *session = NULL;
    struct session_result result = {0};
    int64_t start_ns = clock_now_ns();
    enum st st = session_open(&config, &session, &err);
    if (!st)
        st = session_run(session, &result, &err);
    double took_s = (double)(clock_now_ns() - start_ns) * 1e-9;
    if (st)
        (void)fprintf(stderr, "bench_capture: %s\n", err.text);
    const struct recorder_counts *c = &result.last.counts;
    bool all = c->head.packets == fake_cart_packets(cart) && !head_ledger_lost_packets(&c->head);
    (void)printf("[\n");
    row("capture.soak", result.last.elapsed_s, "s of virtual time", false);
    row("capture.soak_took", took_s, "s", false);
    row("capture.soak_samples", (double)c->head.samples, "samples", false);
    row("capture.soak_lost", (double)head_ledger_lost_packets(&c->head), "packets", false);
    row("capture.soak_memory", k.mb_late, "MB", false);
    row("capture.soak_memory_growth", k.mb_late - k.mb_early, "MB", true);
    (void)printf("]\n");
    session_close(session);
    fake_cart_close(cart);
    st = st ? st : site_close(site, &err);
    const double flat_mb = 16; /* page cache of the database, arenas of malloc */
    return st || !all || k.mb_late - k.mb_early > flat_mb ? 1 : 0;
}

int main(int argc, char **argv) {
    if (argc == 5 && !strcmp(argv[1], "throughput"))
        return throughput(argv[2], atof(argv[3]), atof(argv[4]));
    if (argc == 4 && !strcmp(argv[1], "soak"))
        return soak(argv[2], atof(argv[3]));
    (void)fprintf(stderr, "usage: bench_capture throughput FOLDER SAMPLES_PER_S SECONDS\n"
                          "       bench_capture soak FOLDER SECONDS\n");
    return 2;
}
