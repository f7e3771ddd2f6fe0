/* A whole session against the small simulated cart, in virtual time: what is in the site, what the
 * ledger says, in what state the cart ends. */
#include "base/fileio.h"
#include "capture/session.h"
#include "firmware/shared/faultcode.h"
#include "site/site_check.h"
#include "site/station.h"
#include "site/stream.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/fake_cart.h"
#include "tests/support/tempdir.h"

#include <math.h>
#include <string.h>

struct bench {
    char dir[TEMPDIR_MAX], path[TEMPDIR_MAX + 8];
    struct fake_cart *cart;
    struct cart_devices devices;
    struct site *site;
    int64_t station_id;
    struct scan_plan plan;
    struct session_config config;
    struct session *session;
    struct session_result result;
    struct errctx err;
    /* what a test does while the scan runs */
    void (*meddle)(struct bench *b, const struct session_status *status);
    int meddled;
};

static void on_report(void *ctx, const struct session_status *status) {
    struct bench *b = ctx;
    if (b->meddle)
        b->meddle(b, status);
}

static void open_site(struct bench *b) {
    struct site_info info = {0};
    struct station_pose pose = {.world_from_station = pose_identity()};
    (void)snprintf(pose.source, sizeof pose.source, "nominal");
    assert_int_equal(site_create(b->path, &info, &b->site, &b->err), ST_OK);
    assert_int_equal(station_add(b->site, "a", NULL, &pose, &b->station_id, &b->err), ST_OK);
}

static int set_up(void **state) {
    static struct bench bench;
    memset(&bench, 0, sizeof bench);
    struct bench *b = *state = &bench;
    if (!tempdir_make(b->dir))
        return -1;
    (void)snprintf(b->path, sizeof b->path, "%.500s/site", b->dir);
    struct fake_cart_spec spec = {.host_offset_ns = 5000000000};
    b->cart = fake_cart_open(&spec);
    if (!b->cart)
        return -1;
    b->devices = fake_cart_devices(b->cart);
    open_site(b);
    b->plan = scan_plan_default(SCAN_PLAN_PREVIEW);
    scan_plan_set_range(&b->plan, -3, 3);
    b->plan.pass[0].count = 2;
    b->config = (struct session_config){.devices = &b->devices,
                                        .plan = &b->plan,
                                        .site = b->site,
                                        .station_id = b->station_id,
                                        .device = "fake",
                                        .report = on_report,
                                        .report_ctx = b};
    return 0;
}

static int tear_down(void **state) {
    struct bench *b = *state;
    session_close(b->session);
    (void)site_close(b->site, NULL);
    fake_cart_close(b->cart);
    tempdir_remove(b->dir);
    return 0;
}

static enum st run(struct bench *b) {
    enum st st = session_open(&b->config, &b->session, &b->err);
    return st ? st : session_run(b->session, &b->result, &b->err);
}

/* The site is good, and all that the ledger's totals say is what the site holds. */
static void verify(struct bench *b) {
    struct site_check_result result = {0};
    assert_int_equal(site_close(b->site, &b->err), ST_OK);
    b->site = NULL;
    enum st st = site_check(b->path, NULL, &result, &b->err);
    if (st || result.errors)
        fail_msg("%s %s: %s", b->err.text, result.first.where, result.first.what);
    assert_int_equal(site_open(b->path, SITE_READ, &b->site, &b->err), ST_OK);
    struct stream stream;
    struct stream_state at;
    assert_int_equal(stream_find(b->site, b->station_id, "head", NULL, &stream, &b->err), ST_OK);
    assert_int_equal(stream_get_state(b->site, stream.id, &at, &b->err), ST_OK);
    const struct head_ledger_totals *t = &b->result.last.counts.head;
    assert_int_equal(at.item_count, t->packets);
    assert_int_equal(at.missing_count, head_ledger_lost_packets(t));
}

static void assert_dark(struct bench *b) {
    struct sim_truth truth = sim_truth(fake_cart_sim(b->cart));
    assert_false(truth.laser);
    assert_false(truth.motors);
}

static void assert_says(struct bench *b, const char *words) {
    if (!strstr(b->err.text, words))
        fail_msg("'%s' is not in '%s'", words, b->err.text);
}

static void stores_everything_that_the_head_numbered(void **state) {
    struct bench *b = *state;
    enum st st = run(b);
    if (st)
        fail_msg("%s", b->err.text);
    const struct head_ledger_totals *t = &b->result.last.counts.head;
    assert_true(b->result.complete);
    assert_true(t->samples > 10000);
    assert_int_equal(head_ledger_lost_packets(t), 0);
    assert_int_equal(t->packets, fake_cart_packets(b->cart));
    /* the blind arc after the last packet was numbered, but no packet tells of it */
    uint64_t numbered = t->samples + t->not_sent;
    assert_in_range(fake_cart_samples(b->cart) - numbered, 0, 700);
    assert_int_equal(b->result.last.photos, 2);
    assert_dark(b);
    verify(b);
}

static void loses_packets_and_says_so(void **state) {
    struct bench *b = *state;
    fake_cart_lose(b->cart, 50, 3);
    fake_cart_spoil(b->cart, 100);
    fake_cart_repeat(b->cart, 120);
    assert_int_equal(run(b), ST_OK);
    const struct head_ledger_totals *t = &b->result.last.counts.head;
    assert_int_equal(t->lost_packets[HEAD_LEDGER_USB_LOST], 3);
    assert_int_equal(t->lost_packets[HEAD_LEDGER_CRC], 1);
    assert_int_equal(t->repeated, 1);
    assert_int_equal(t->packets, fake_cart_packets(b->cart) - 4);
    assert_true(t->lost_samples[HEAD_LEDGER_USB_LOST] > 34);
    verify(b);
}

static void a_head_that_starts_anew_is_counted_on(void **state) {
    struct bench *b = *state;
    fake_cart_reset_head(b->cart, 200);
    assert_int_equal(run(b), ST_OK);
    assert_int_equal(b->result.last.counts.head.resets, 1);
    assert_int_equal(b->result.last.counts.head.packets, fake_cart_packets(b->cart));
    verify(b);
}

static void press(struct bench *b, const struct session_status *status) {
    if (status->phase == DRIVE_SWEEP && !b->meddled++)
        (void)sim_fault_at(fake_cart_sim(b->cart), SIM_FAULT_ESTOP, 0, 1);
}

static void emergency_stop_ends_dark_with_all_stored(void **state) {
    struct bench *b = *state;
    b->meddle = press;
    assert_int_equal(run(b), ST_DEVICE);
    assert_says(b, "emergency stop pressed");
    assert_says(b, "--resume");
    assert_dark(b);
    assert_int_equal(b->result.last.counts.head.packets, fake_cart_packets(b->cart));
    verify(b);
}

static void ask(struct bench *b, const struct session_status *status) {
    if (status->phase == DRIVE_SWEEP)
        session_stop(b->session);
}

static void stops_in_order_on_request(void **state) {
    struct bench *b = *state;
    b->meddle = ask;
    assert_int_equal(run(b), ST_CANCELLED);
    assert_dark(b);
    assert_int_equal(b->result.last.phase, DRIVE_STOPPED);
    assert_int_equal(b->result.last.counts.head.packets, fake_cart_packets(b->cart));
    verify(b);
}

static void fill_disk(struct bench *b, const struct session_status *status) {
    if (status->phase == DRIVE_SWEEP)
        fake_cart_disk_full(b->cart, true);
}

static void full_disk_stops_in_order_and_says_what_was_not_stored(void **state) {
    struct bench *b = *state;
    b->meddle = fill_disk;
    assert_int_equal(run(b), ST_FULL);
    assert_says(b, "full");
    assert_dark(b);
    const struct recorder_counts *c = &b->result.last.counts;
    assert_true(c->unstored_packets > 0);
    struct stream stream;
    struct stream_state at;
    assert_int_equal(stream_find(b->site, b->station_id, "head", NULL, &stream, &b->err), ST_OK);
    assert_int_equal(stream_get_state(b->site, stream.id, &at, &b->err), ST_OK);
    assert_int_equal(at.item_count + (int64_t)c->unstored_packets, c->head.packets);
}

static void refuses_a_disk_too_small_with_the_figure(void **state) {
    struct bench *b = *state;
    b->config.free_bytes = 1000000;
    assert_int_equal(run(b), ST_FULL);
    assert_says(b, "0.0 GB are free");
}

static void cut_line(struct bench *b, const struct session_status *status) {
    if (status->phase == DRIVE_SWEEP && !b->meddled++)
        (void)sim_fault_at(fake_cart_sim(b->cart), SIM_FAULT_LINE_CUT, 0, 1);
}

static void silent_controller_ends_the_scan_and_darkens_itself(void **state) {
    struct bench *b = *state;
    b->meddle = cut_line;
    enum st st = run(b);
    assert_true(st != ST_OK);
    assert_says(b, "answer");
    assert_dark(b);
    verify(b);
}

static void missing_photograph_is_said_and_not_waited_for(void **state) {
    struct bench *b = *state;
    fake_cart_no_frame(b->cart, 0);
    scan_plan_set_range(&b->plan, 0, 0);
    assert_int_equal(run(b), ST_OK);
    assert_int_equal(b->result.last.photos_missed, 2);
    assert_non_null(strstr(b->result.last.warning, "no photograph"));
}

static void power_loss_leaves_what_was_committed(void **state) {
    struct bench *b = *state;
    fake_cart_close(b->cart);
    struct fake_cart_spec spec = {.host_offset_ns = 5000000000, .power_ns = 60000000000};
    b->cart = fake_cart_open(&spec);
    b->devices = fake_cart_devices(b->cart);
    scan_plan_set_range(&b->plan, -30, 30);
    assert_int_equal(run(b), ST_CANCELLED);
    assert_says(b, "power");
    struct stream stream;
    struct stream_state at;
    assert_int_equal(stream_find(b->site, b->station_id, "head", NULL, &stream, &b->err), ST_OK);
    assert_int_equal(stream_get_state(b->site, stream.id, &at, &b->err), ST_OK);
    assert_true(at.item_count > 0);
    /* at most a second of packets is not there */
    assert_in_range(fake_cart_packets(b->cart) - (uint64_t)at.item_count, 0, 2000 / 34 + 4);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define T(f) cmocka_unit_test_setup_teardown(f, set_up, tear_down)
        T(stores_everything_that_the_head_numbered),
        T(loses_packets_and_says_so),
        T(a_head_that_starts_anew_is_counted_on),
        T(emergency_stop_ends_dark_with_all_stored),
        T(stops_in_order_on_request),
        T(full_disk_stops_in_order_and_says_what_was_not_stored),
        T(refuses_a_disk_too_small_with_the_figure),
        T(silent_controller_ends_the_scan_and_darkens_itself),
        T(missing_photograph_is_said_and_not_waited_for),
        T(power_loss_leaves_what_was_committed),
#undef T
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
