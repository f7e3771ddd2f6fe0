/* The parts of capture that need no cart: the ledger, spans, plans, events on the wire. */
#include "capture/event_wire.h"
#include "capture/head_ledger.h"
#include "capture/resume.h"
#include "capture/scan_plan_json.h"
#include "capture/status.h"
#include "tests/support/cmocka_all.h"

#include <math.h>
#include <string.h>

static struct head_packet packet(uint32_t seq, uint32_t first_sample, unsigned count) {
    struct head_packet p;
    memset(&p, 0, sizeof p);
    p.packet_seq = seq;
    p.first_sample_seq = first_sample;
    p.sample_count = (uint8_t)count;
    return p;
}

static struct head_ledger_verdict feed(struct head_ledger *ledger, uint32_t seq, uint32_t sample) {
    struct head_packet p = packet(seq, sample, 34);
    return head_ledger_packet(ledger, &p);
}

static void ledger_splits_a_gap_into_damaged_and_lost(void **state) {
    (void)state;
    struct head_ledger l;
    head_ledger_init(&l);
    assert_int_equal(feed(&l, 100, 3400).item, 0);
    head_ledger_damaged(&l, 600); /* two packets' worth */
    struct head_ledger_verdict v = feed(&l, 106, 3604);
    assert_int_equal(v.item, 6);
    assert_int_equal(v.gaps, 2);
    assert_int_equal(v.gap[0].reason, HEAD_LEDGER_CRC);
    assert_int_equal(v.gap[0].end_item - v.gap[0].first_item, 2);
    assert_int_equal(v.gap[1].reason, HEAD_LEDGER_USB_LOST);
    assert_int_equal(v.gap[1].end_item, 6);
    assert_int_equal(head_ledger_lost_samples(&l.totals), 5 * 34);
}

static void ledger_tells_the_blind_arc_from_a_loss(void **state) {
    (void)state;
    struct head_ledger l;
    head_ledger_init(&l);
    (void)feed(&l, 1, 0);
    (void)feed(&l, 2, 34 + 500);
    assert_int_equal(l.totals.not_sent, 500);
    assert_int_equal(head_ledger_lost_samples(&l.totals), 0);
    struct head_packet p = packet(3, 34 + 500 + 34 + 20, 34);
    p.status = HEAD_STATUS_OVERRUN;
    (void)head_ledger_packet(&l, &p);
    assert_int_equal(l.totals.lost_samples[HEAD_LEDGER_HEAD_OVERRUN], 20);
}

static void ledger_goes_on_over_the_wrap_of_all_numbers(void **state) {
    (void)state;
    struct head_ledger l;
    head_ledger_init(&l);
    (void)feed(&l, UINT32_MAX, UINT32_MAX - 10);
    struct head_ledger_verdict v = feed(&l, 2, 23 + 2 * 34);
    assert_int_equal(v.item, 3);
    assert_int_equal(l.totals.lost_packets[HEAD_LEDGER_USB_LOST], 2);
    assert_int_equal(l.totals.lost_samples[HEAD_LEDGER_USB_LOST], 68);
}

static void ledger_believes_no_packet_number_against_the_samples(void **state) {
    (void)state;
    struct head_ledger l;
    head_ledger_init(&l);
    (void)feed(&l, 10, 0);
    struct head_ledger_verdict v = feed(&l, 1011, 34); /* one wrong number */
    assert_int_equal(v.gaps, 0);
    assert_int_equal(feed(&l, 12, 68).gaps, 0);
    assert_int_equal(l.totals.sequence, 1);
    (void)feed(&l, 5000000, 102); /* counting from there on for good */
    assert_int_equal(feed(&l, 5000001, 136).gaps, 0);
    assert_int_equal(feed(&l, 5000002, 170).gaps, 0);
    assert_int_equal(l.totals.sequence, 2);
    assert_int_equal(l.next_item, 6);
}

static void ledger_takes_a_reset_as_a_new_count_and_a_repetition_as_none(void **state) {
    (void)state;
    struct head_ledger l;
    head_ledger_init(&l);
    (void)feed(&l, 500, 17000);
    assert_false(feed(&l, 500, 17000).counts);
    struct head_packet p = packet(0, 0, 34);
    p.flags = HEAD_PACKET_RESET;
    struct head_ledger_verdict v = head_ledger_packet(&l, &p);
    assert_int_equal(v.item, 1);
    assert_int_equal(v.gaps, 0);
    assert_int_equal(l.totals.resets, 1);
    assert_int_equal(l.totals.repeated, 1);
}

static void ledger_counts_what_never_came_to_an_end(void **state) {
    (void)state;
    struct head_ledger l;
    struct head_ledger_gap gaps[HEAD_LEDGER_MAX_GAPS];
    head_ledger_init(&l);
    (void)feed(&l, 0, 0);
    assert_int_equal(head_ledger_end(&l, gaps), 0);
    head_ledger_damaged(&l, 10);
    head_ledger_ring_full(&l, 3);
    assert_int_equal(head_ledger_end(&l, gaps), 2);
    assert_int_equal(gaps[0].reason, HEAD_LEDGER_CRC);
    assert_int_equal(gaps[1].end_item, 5);
}

static void spans_are_joined_and_stay_in_order(void **state) {
    (void)state;
    struct resume_span s[4];
    size_t n = 0;
    assert_true(resume_add_span(s, &n, 4, (struct resume_span){10, 20}, 1e-6));
    assert_true(resume_add_span(s, &n, 4, (struct resume_span){40, 50}, 1e-6));
    assert_true(resume_add_span(s, &n, 4, (struct resume_span){0, 5}, 1e-6));
    assert_true(resume_add_span(s, &n, 4, (struct resume_span){60, 70}, 1e-6));
    assert_int_equal(n, 4);
    assert_false(resume_add_span(s, &n, 4, (struct resume_span){80, 90}, 1e-6));
    assert_true(resume_add_span(s, &n, 4, (struct resume_span){20, 40}, 1e-6));
    assert_int_equal(n, 3);
    assert_true(s[1].from_steps == 10 && s[1].to_steps == 50 && s[2].from_steps == 60);
}

static void plan_comes_back_from_its_text(void **state) {
    (void)state;
    struct errctx err;
    char text[1024];
    const double tilt_deg[2] = {0, -25};
    struct scan_plan plan = scan_plan_default(SCAN_PLAN_SURVEY), back;
    scan_plan_set_range(&plan, -33.3, 71);
    assert_int_equal(scan_plan_set_passes(&plan, tilt_deg, 2, 30, &err), ST_OK);
    assert_int_equal(scan_plan_json_write(&plan, text, sizeof text), ST_OK);
    assert_int_equal(scan_plan_json_read(text, &back, &err), ST_OK);
    assert_int_equal(back.pan_from_steps, plan.pan_from_steps);
    assert_int_equal(back.pan_to_steps, plan.pan_to_steps);
    assert_memory_equal(back.pass, plan.pass, sizeof plan.pass);
    assert_int_equal(scan_plan_json_write(&plan, text, 40), ST_NOMEM);
    assert_int_equal(scan_plan_json_read("{\"plan\": {}}", &back, &err), ST_FORMAT);
    assert_int_equal(scan_plan_json_read("nonsense", &back, &err), ST_FORMAT);
    assert_int_equal(scan_plan_json_read("", &back, &err), ST_FORMAT);
}

static void plan_refuses_what_no_cart_can_do(void **state) {
    (void)state;
    struct errctx err;
    struct scan_plan plan = scan_plan_default(SCAN_PLAN_FIELD);
    assert_int_equal(scan_plan_check(&plan, &err), ST_OK);
    plan.mirror_hz = (double)NAN;
    assert_int_equal(scan_plan_check(&plan, &err), ST_INVALID);
    plan = scan_plan_default(SCAN_PLAN_FIELD);
    plan.steps_per_revolution = 1000;
    plan.mirror_hz = 50;
    assert_int_equal(scan_plan_check(&plan, &err), ST_INVALID);
    plan = scan_plan_default(SCAN_PLAN_FIELD);
    scan_plan_set_range(&plan, -200, 0);
    assert_int_equal(scan_plan_check(&plan, &err), ST_INVALID);
    const double steep = 80;
    assert_int_equal(scan_plan_set_passes(&plan, &steep, 1, 40, &err), ST_INVALID);
}

static void events_are_the_same_after_the_wire(void **state) {
    (void)state;
    for (int backward = 0; backward < 2; backward++) {
        struct index_event e = {.seq = 77,
                                .t_ns = 123456789000,
                                .revolution = 12345,
                                .pan_steps = backward ? -100.25 : 99.5,
                                .tilt_steps = -7,
                                .kind = INDEX_EVENT_INDEX,
                                .flags = INDEX_EVENT_SWEEP | INDEX_EVENT_LASER};
        if (!backward)
            e.flags |= INDEX_EVENT_PAN_POSITIVE;
        uint8_t bytes[EVENT_WIRE_BYTES];
        event_wire_encode(&e, bytes);
        struct index_event back = event_wire_decode(bytes);
        assert_int_equal(back.t_ns, e.t_ns);
        assert_true(back.pan_steps == e.pan_steps);
        assert_int_equal(back.flags, e.flags);
        assert_int_equal(back.tilt_steps, e.tilt_steps);
        assert_int_equal(back.revolution, e.revolution);
    }
}

static void status_is_one_line_of_bounded_length(void **state) {
    (void)state;
    struct session_status s;
    char line[STATUS_LINE_MAX];
    memset(&s, 0, sizeof s);
    s.counts.head.samples = UINT64_MAX;
    s.counts.stored_bytes = s.free_bytes = UINT64_MAX;
    s.photos = s.photos_planned = s.photos_missed = UINT32_MAX;
    s.pan_deg = -1e300;
    s.remaining_s = 1e300;
    (void)status_line(&s, line);
    assert_true(strlen(line) < STATUS_LINE_MAX);
    assert_null(strchr(line, '\n'));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ledger_splits_a_gap_into_damaged_and_lost),
        cmocka_unit_test(ledger_tells_the_blind_arc_from_a_loss),
        cmocka_unit_test(ledger_goes_on_over_the_wrap_of_all_numbers),
        cmocka_unit_test(ledger_believes_no_packet_number_against_the_samples),
        cmocka_unit_test(ledger_takes_a_reset_as_a_new_count_and_a_repetition_as_none),
        cmocka_unit_test(ledger_counts_what_never_came_to_an_end),
        cmocka_unit_test(spans_are_joined_and_stay_in_order),
        cmocka_unit_test(plan_comes_back_from_its_text),
        cmocka_unit_test(plan_refuses_what_no_cart_can_do),
        cmocka_unit_test(events_are_the_same_after_the_wire),
        cmocka_unit_test(status_is_one_line_of_bounded_length),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
