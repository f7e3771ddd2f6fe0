/* The USB backend: the real libusb on a bus that umockdev simulates. */
#include "base/head_packet.h"
#include "capture/backends/head_usb.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/head_sim.h"
#include "tests/support/umock.h"

#include <errno.h>
#include <string.h>

enum { PACKETS = 400, ROUNDS_MAX = 4000 };

static uint8_t sent[PACKETS * HEAD_PACKET_MAX_BYTES], got[sizeof sent];
static size_t sent_size, got_size;

static void take(void *ctx, const uint8_t *bytes, size_t size, int64_t t_host_ns) {
    (void)ctx;
    assert_true(t_host_ns > 0 && size <= sizeof got - got_size);
    memcpy(got + got_size, bytes, size);
    got_size += size;
}

static const struct head_sink sink = {NULL, take};
static const struct head_sim_device one = {0x1209, 0x5c41, 0x0100, "H0001"};

/* `count` packets of 34 samples, the last one with 5 if `short_end`. */
static void make_packets(unsigned count, bool short_end) {
    sent_size = 0;
    for (unsigned i = 0; i < count; i++) {
        struct head_packet p = {.packet_seq = i,
                                .first_sample_seq = i * HEAD_PACKET_MAX_SAMPLES,
                                .head_t_ns = (int64_t)i * 1360000,
                                .interval_ns = 40000,
                                .sample_count = HEAD_PACKET_MAX_SAMPLES};
        if (short_end && i + 1 == count)
            p.sample_count = 5;
        size_t size = 0;
        assert_int_equal(head_packet_encode(&p, sent + sent_size, &size), ST_OK);
        sent_size += size;
    }
}

static struct head *open_head(void) {
    struct head_usb_config config = head_usb_default();
    struct head *head = NULL;
    struct errctx err = {0};
    if (head_usb_open(&config, &head, &err))
        fail_msg("%s", err.text);
    return head;
}

static struct head *started_head(void) {
    struct errctx err = {0};
    struct head *head = open_head();
    if (head->ops->start(head, &err))
        fail_msg("%s", err.text);
    return head;
}

/* Pumps until `size` bytes have come or an op fails. Bounded. */
static enum st pump(struct head *head, size_t size, struct errctx *err) {
    enum st st = ST_OK;
    for (int i = 0; i < ROUNDS_MAX && !st && got_size < size; i++)
        st = head->ops->pump(head, 1, &sink, err);
    return st;
}

static void hands_over_every_byte_in_order(void **state) {
    (void)state;
    struct errctx err = {0};
    struct head_stats stats;
    struct head *head = started_head();
    make_packets(PACKETS, true);
    head_sim_send(sent, sent_size);
    assert_int_equal(pump(head, sent_size, &err), ST_OK);
    assert_int_equal(got_size, sent_size);
    assert_memory_equal(got, sent, sent_size);
    head->ops->stats(head, &stats);
    assert_int_equal(stats.bytes, sent_size);
    assert_int_equal(stats.transfer_errors, 0);
    assert_int_equal(head_sim_most_in_flight(), head_usb_default().transfers);
    assert_int_equal(head->ops->stop(head, &sink, &err), ST_OK);
    head_close(head);
}

static void knows_the_head_by_its_descriptors_and_packets(void **state) {
    (void)state;
    struct errctx err = {0};
    struct head_identity id;
    struct head *head = started_head();
    assert_int_equal(head->ops->identify(head, &id, &err), ST_OK);
    assert_string_equal(id.product, "simulated head");
    assert_string_equal(id.serial, "H0001");
    assert_int_equal(id.protocol_version, HEAD_PACKET_VERSION);
    assert_int_equal(id.interval_ns, 0);
    make_packets(2, false);
    head_sim_send(sent, sent_size);
    assert_int_equal(pump(head, sent_size, &err), ST_OK);
    assert_int_equal(head->ops->identify(head, &id, &err), ST_OK);
    assert_int_equal(id.interval_ns, 40000);
    head_close(head);
}

static void nothing_coming_is_no_error(void **state) {
    (void)state;
    struct errctx err = {0};
    struct head *head = started_head();
    assert_int_equal(head->ops->pump(head, 1, &sink, &err), ST_OK);
    assert_int_equal(got_size, 0);
    assert_int_equal(head->ops->stop(head, NULL, &err), ST_OK);
    assert_int_equal(head->ops->stop(head, NULL, &err), ST_OK);
    assert_int_equal(head->ops->pump(head, 1, &sink, &err), ST_INVALID);
    head_close(head);
}

static void a_stall_is_cleared_and_the_stream_goes_on(void **state) {
    (void)state;
    struct errctx err = {0};
    struct head_stats stats;
    struct head *head = started_head();
    make_packets(PACKETS, false);
    head_sim_send(sent, sent_size / 2);
    assert_int_equal(pump(head, sent_size / 2, &err), ST_OK);
    head_sim_fail(EPIPE, 1);
    head_sim_send(sent + sent_size / 2, sent_size / 2);
    assert_int_equal(pump(head, sent_size, &err), ST_OK);
    assert_int_equal(got_size, sent_size);
    assert_memory_equal(got, sent, sent_size);
    head->ops->stats(head, &stats);
    assert_int_equal(stats.transfer_errors, 1);
    assert_int_equal(head_sim_halts_cleared(), 1);
    head_close(head);
}

static void single_bad_transfers_are_sent_again(void **state) {
    (void)state;
    struct errctx err = {0};
    struct head_stats stats;
    struct head *head = started_head();
    make_packets(PACKETS, false);
    head_sim_send(sent, sent_size);
    head_sim_fail(EPROTO, 3);
    assert_int_equal(pump(head, sent_size, &err), ST_OK);
    assert_memory_equal(got, sent, sent_size);
    head->ops->stats(head, &stats);
    assert_int_equal(stats.transfer_errors, 3);
    head_close(head);
}

static void gives_up_when_every_transfer_fails(void **state) {
    (void)state;
    struct errctx err = {0};
    struct head *head = started_head();
    head_sim_fail(EPROTO, 1000);
    assert_int_equal(pump(head, 1, &err), ST_DEVICE);
    assert_non_null(strstr(err.text, "cable"));
    head_close(head);
}

static void an_unplugged_head_is_gone_after_its_last_byte(void **state) {
    (void)state;
    struct errctx err = {0};
    struct head *head = started_head();
    make_packets(20, false);
    head_sim_send(sent, sent_size);
    head_sim_unplug();
    assert_int_equal(pump(head, SIZE_MAX, &err), ST_DEVICE);
    assert_non_null(strstr(err.text, "unplugged"));
    assert_int_equal(got_size, sent_size);
    assert_memory_equal(got, sent, sent_size);
    assert_int_equal(head->ops->pump(head, 1, &sink, &err), ST_DEVICE);
    assert_int_equal(head->ops->stop(head, NULL, &err), ST_OK);
    head_close(head);
}

static void packets_of_another_version_are_refused(void **state) {
    (void)state;
    struct errctx err = {0};
    struct head *head = started_head();
    make_packets(4, false);
    sent[4] = 2;
    head_sim_send(sent, sent_size);
    assert_int_equal(pump(head, SIZE_MAX, &err), ST_UNSUPPORTED);
    assert_non_null(strstr(err.text, "version 2"));
    head_close(head);
}

/* --- which device ----------------------------------------------------------------------------- */

static void refuses(const struct head_sim_device *devices, unsigned count, const char *serial,
                    enum st wanted, const char *word) {
    struct head_usb_config config = head_usb_default();
    struct head *head = NULL;
    struct errctx err = {0};
    head_sim_remove();
    assert_true(head_sim_plug(devices, count));
    config.serial = serial;
    enum st st = head_usb_open(&config, &head, &err);
    if (st != wanted || head || !strstr(err.text, word))
        fail_msg("%s: '%s' (not %s, '%s')", st_name(st), err.text, st_name(wanted), word);
}

static void refuses_absent_ambiguous_and_unknown(void **state) {
    (void)state;
    const struct head_sim_device mouse = {0x046d, 0xc077, 0x0100, "M"};
    const struct head_sim_device two[2] = {one, {0x1209, 0x5c41, 0x0100, "H0002"}};
    const struct head_sim_device newer = {0x1209, 0x5c41, 0x0200, "H0003"};
    refuses(&mouse, 1, NULL, ST_NOT_FOUND, "1209:5c41");
    refuses(&one, 1, "H0009", ST_NOT_FOUND, "H0009");
    refuses(two, 2, NULL, ST_INVALID, "head.serial");
    refuses(&newer, 1, NULL, ST_UNSUPPORTED, "version 2");
}

static void takes_the_one_with_the_serial_number(void **state) {
    (void)state;
    const struct head_sim_device two[2] = {one, {0x1209, 0x5c41, 0x0100, "H0002"}};
    struct head_usb_config config = head_usb_default();
    struct head_identity id;
    struct head *head = NULL;
    struct errctx err = {0};
    head_sim_remove();
    assert_true(head_sim_plug(two, 2));
    config.serial = "H0002";
    assert_int_equal(head_usb_open(&config, &head, &err), ST_OK);
    assert_int_equal(head->ops->identify(head, &id, &err), ST_OK);
    assert_string_equal(id.serial, "H0002");
    head_close(head);
}

static void refuses_forbidden_and_busy(void **state) {
    (void)state;
    struct head_usb_config config = head_usb_default();
    struct head *head = NULL;
    struct errctx err = {0};
    head_sim_deny(true);
    enum st st = head_usb_open(&config, &head, &err);
    head_sim_deny(false);
    assert_int_equal(st, ST_PERMISSION);
    assert_non_null(strstr(err.text, "70-scancart.rules"));
    head_sim_busy();
    assert_int_equal(head_usb_open(&config, &head, &err), ST_BUSY);
    config.transfers = HEAD_USB_TRANSFERS_MAX + 1;
    assert_int_equal(head_usb_open(&config, &head, &err), ST_INVALID);
}

static int set_up(void **state) {
    (void)state;
    got_size = sent_size = 0;
    return !head_sim_plug(&one, 1);
}

static int tear_down(void **state) {
    (void)state;
    head_sim_remove();
    return 0;
}

#define WITH_HEAD(f) cmocka_unit_test_setup_teardown(f, set_up, tear_down)

int main(int argc, char **argv) {
    (void)argc;
    int skip = umock_enter(argv);
    if (skip)
        return skip;
    const struct CMUnitTest tests[] = {
        WITH_HEAD(hands_over_every_byte_in_order),
        WITH_HEAD(knows_the_head_by_its_descriptors_and_packets),
        WITH_HEAD(nothing_coming_is_no_error),
        WITH_HEAD(a_stall_is_cleared_and_the_stream_goes_on),
        WITH_HEAD(single_bad_transfers_are_sent_again),
        WITH_HEAD(gives_up_when_every_transfer_fails),
        WITH_HEAD(an_unplugged_head_is_gone_after_its_last_byte),
        WITH_HEAD(packets_of_another_version_are_refused),
        WITH_HEAD(refuses_absent_ambiguous_and_unknown),
        WITH_HEAD(takes_the_one_with_the_serial_number),
        WITH_HEAD(refuses_forbidden_and_busy),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
