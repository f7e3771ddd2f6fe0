/* Any single operation of a scan on its database fails, once and for good: the site is always
 * good, one failure loses nothing, and a disk that fails for good ends the scan in order, and it is
 * gone on with when the disk works again. */
#include "base/fileio.h"
#include "site/site_check.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/fake_scan.h"
#include "tests/support/power_vfs.h"
#include "tests/support/tempdir.h"

#include <stdlib.h>
#include <string.h>

enum { SAMPLE_HZ = 500 };
static const double degrees = 1.5;
static char dir[TEMPDIR_MAX];

static int set_up(void **state) {
    (void)state;
    return !tempdir_make(dir);
}

static int tear_down(void **state) {
    (void)state;
    power_vfs_remove();
    tempdir_remove(dir);
    return 0;
}

static enum st scan(const char *path, struct session_result *out_result, struct errctx *err) {
    struct scan_plan plan = fake_scan_plan(degrees);
    struct fake_cart_spec spec = {.sample_hz = SAMPLE_HZ, .host_offset_ns = 7000000000};
    return fake_scan_run(path, &plan, &spec, out_result, err);
}

static void verify(const char *path, int64_t operation, const char *when) {
    struct site_check_result result = {0};
    struct errctx err = {0};
    enum st st = site_check(path, NULL, &result, &err);
    if (st != ST_NOT_FOUND && (st || result.errors))
        fail_msg("operation %lld, %s: %s %s: %s", (long long)operation, when, err.text,
                 result.first.where, result.first.what);
}

static void any_failing_write_leaves_a_good_site_that_can_be_gone_on_with(void **state) {
    (void)state;
    static struct resume at;
    char path[TEMPDIR_MAX + 32];
    struct session_result result;
    struct errctx err = {0};
    int64_t whole, operations, survived = 0, ended = 0;
    (void)snprintf(path, sizeof path, "%.500s/whole", dir);
    power_vfs_install();
    assert_int_equal(scan(path, &result, &err), ST_OK);
    operations = power_vfs_operations();
    power_vfs_remove();
    whole = fake_scan_packets(path);
    assert_true(whole > 20 && operations > 100);
    /* all of them take minutes: a 17th by default, SCANCART_EACH=1 for all */
    int64_t stride = getenv("SCANCART_EACH") ? 1 : 17;
    for (int64_t k = 1; k <= operations; k += stride)
        for (int64_t lasting = 1; lasting <= 100000; lasting += 99999) { /* once; from then on */
            (void)snprintf(path, sizeof path, "%.500s/run", dir);
            power_vfs_install();
            power_vfs_fail_at(k, lasting);
            enum st st = scan(path, &result, &err);
            power_vfs_remove();
            verify(path, k, lasting > 1 ? "for good" : "once");
            const struct recorder_counts *c = &result.last.counts;
            if (result.complete && lasting == 1) { /* one failure is tried again */
                assert_int_equal(c->unstored_packets, 0);
                assert_int_equal(fake_scan_packets(path), whole);
                survived++;
            }
            if (st) { /* what ended it is told, and the cart does not move */
                assert_true(strlen(err.text) > 10);
                assert_false(result.last.laser_on);
                ended++;
            }
            assert_int_equal(scan(path, &result, &err), ST_OK);
            verify(path, k, "afterwards");
            assert_true(fake_scan_state(path, &at) && at.complete);
            tempdir_remove(path);
        }
    (void)printf("each %lldth of %lld operations failed once (%lld scans went on) and for good; "
                 "%lld scans ended\n",
                 (long long)stride, (long long)operations, (long long)survived, (long long)ended);
    assert_true(survived > operations / stride / 4 && ended > 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(
            any_failing_write_leaves_a_good_site_that_can_be_gone_on_with, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
