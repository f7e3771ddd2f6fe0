/* What firmware and host share: register map, frames, records, rings. */
#include "firmware/shared/faultcode.h"
#include "firmware/shared/idxevent.h"
#include "firmware/shared/mbframe.h"
#include "firmware/shared/regmap.h"
#include "firmware/shared/ring16.h"
#include "tests/support/cmocka_all.h"

#include <string.h>

static void tables_are_sorted_and_do_not_overlap(void **state) {
    (void)state;
    uint32_t end = 0;
    for (int i = 0; i < REGMAP_INPUT_COUNT_; i++) {
        assert_true(regmap_inputs[i].address >= end);
        end = regmap_inputs[i].address + regmap_type_words(regmap_inputs[i].type);
    }
    assert_true(end <= IDXEVENT_FIRST_ADDR);
    end = IDXEVENT_WINDOW_ADDR + IDXEVENT_WINDOW_WORDS;
    for (int i = 0; i < REGMAP_HOLDING_COUNT_; i++) {
        assert_true(regmap_holdings[i].address >= end);
        end = regmap_holdings[i].address + regmap_type_words(regmap_holdings[i].type);
    }
}

static void values_at_reset_lie_in_their_ranges(void **state) {
    (void)state;
    for (int i = 0; i < REGMAP_HOLDING_COUNT_; i++) {
        const struct regmap_entry *entry = &regmap_holdings[i];
        bool key = i == REGMAP_HOLDING_fault_clear || i == REGMAP_HOLDING_commission_save;
        int64_t value = regmap_value(entry, &regmap_holding_initial);
        if (!key) /* these two are written only, and read as 0 */
            assert_in_range(value - entry->min, 0, entry->max - entry->min);
    }
}

static void every_row_has_its_texts(void **state) {
    (void)state;
    for (int i = 0; i < REGMAP_INPUT_COUNT_; i++)
        assert_true(strlen(regmap_input_text[i].doc) > 5 && regmap_input_text[i].scale > 0);
    for (int i = 0; i < REGMAP_HOLDING_COUNT_; i++)
        assert_true(strlen(regmap_holding_text[i].doc) > 5 && regmap_holding_text[i].scale > 0);
    for (int i = 0; i < REGMAP_COIL_COUNT_; i++)
        assert_int_equal(regmap_coil_text[i].address, i);
    for (int i = 0; i < REGMAP_DISCRETE_COUNT_; i++)
        assert_int_equal(regmap_discrete_text[i].address, i);
}

static void codes_have_texts_and_unknown_ones_say_so(void **state) {
    (void)state;
    for (int i = 0; i < FAULT_COUNT_; i++)
        assert_non_null(faultcode_text(i));
    for (int i = 0; i < REFUSAL_COUNT_; i++)
        assert_non_null(refusal_text(i));
    assert_string_equal(faultcode_name(FAULT_ESTOP), "ESTOP");
    assert_string_equal(faultcode_text(999), "unknown");
    assert_string_equal(faultcode_text(-1), "unknown");
    assert_string_equal(faultcode_context(FAULT_COUNT_), "unknown");
    assert_string_equal(faultcode_name(-5), "unknown");
    assert_string_equal(refusal_text(REFUSAL_COUNT_), "unknown");
}

static void encode_and_decode_are_inverse(void **state) {
    (void)state;
    struct regmap_holding in = regmap_holding_initial, out;
    in.pan_target = -123456789;
    in.temperature_max = -5; /* out of range, but a host decodes what it gets */
    in.event_from = 0xfedcba98;
    memset(&out, 0, sizeof out);
    uint16_t block[8];
    for (int i = 0; i < REGMAP_HOLDING_COUNT_; i++) {
        const struct regmap_entry *entry = &regmap_holdings[i];
        unsigned words = regmap_type_words(entry->type);
        assert_true(regmap_encode(regmap_holdings, REGMAP_HOLDING_COUNT_, &in, entry->address,
                                  words, block));
        assert_int_equal(regmap_decode(regmap_holdings, REGMAP_HOLDING_COUNT_, &out, entry->address,
                                       words, block),
                         1);
        assert_true(regmap_value(entry, &in) == regmap_value(entry, &out));
    }
}

static void block_may_begin_and_end_inside_a_value(void **state) {
    (void)state;
    struct regmap_input in;
    memset(&in, 0, sizeof in);
    in.uptime_us = 0x0123456789abcdef;
    uint16_t block[4];
    assert_true(regmap_encode(regmap_inputs, REGMAP_INPUT_COUNT_, &in, REGMAP_ADDR_uptime_us + 1, 2,
                              block));
    assert_int_equal(block[0], 0x4567);
    assert_int_equal(block[1], 0x89ab);
    struct regmap_input out = {.uptime_us = 42};
    assert_int_equal(regmap_decode(regmap_inputs, REGMAP_INPUT_COUNT_, &out,
                                   REGMAP_ADDR_uptime_us + 1, 2, block),
                     0);
    assert_true(out.uptime_us == 42); /* half a value is none */
}

static void addresses_without_register_are_refused(void **state) {
    (void)state;
    struct regmap_input in;
    memset(&in, 0, sizeof in);
    uint16_t block[256];
    assert_false(regmap_encode(regmap_inputs, REGMAP_INPUT_COUNT_, &in, 0x000e, 1, block));
    assert_false(regmap_encode(regmap_inputs, REGMAP_INPUT_COUNT_, &in, 0x000a, 5, block));
    assert_false(regmap_encode(regmap_inputs, REGMAP_INPUT_COUNT_, &in, 0xffff, 2, block));
    assert_false(regmap_encode(regmap_holdings, REGMAP_HOLDING_COUNT_, &in, 0, 1, block));
    assert_null(regmap_find(regmap_holdings, REGMAP_HOLDING_COUNT_, 0x0fff));
}

static void accessors_find_their_value_in_a_block(void **state) {
    (void)state;
    uint16_t block[16] = {0};
    regmap_put_pan_target(block, 0x1010, -7);
    regmap_put_tilt_velocity_max(block, 0x1010, 0x12345678);
    assert_int_equal(regmap_get_pan_target(block, 0x1010), -7);
    assert_int_equal(regmap_get_tilt_velocity_max(block, 0x1010), 0x12345678);
    assert_int_equal(block[0], 0xffff);
    assert_int_equal(block[6], 0x1234);
    const uint16_t input[4] = {0x0001, 0x0203, 0x0405, 0x0607};
    assert_true(regmap_get_uptime_us(input, REGMAP_ADDR_uptime_us) == 0x0001020304050607);
    const uint16_t cold[1] = {0xffce};
    assert_int_equal(regmap_get_temperature(cold, REGMAP_ADDR_temperature), -50);
}

static void crc_matches_the_published_example(void **state) {
    (void)state;
    /* request 02 07: CRC 1241, low byte first on the wire (Modbus over serial line, appendix B) */
    uint8_t frame[4] = {0x02, 0x07};
    assert_int_equal(mbframe_seal(frame, 2), 4);
    assert_int_equal(frame[2], 0x41);
    assert_int_equal(frame[3], 0x12);
    assert_int_equal(mbframe_crc((const uint8_t *)"123456789", 9), 0x4b37);
    assert_true(mbframe_ok(frame, 4));
    assert_false(mbframe_ok(frame, 3));
    frame[3] ^= 1;
    assert_false(mbframe_ok(frame, 4));
    uint8_t longest[300] = {0};
    assert_false(mbframe_ok(longest, 257));
}

static void frame_gap_follows_the_baud_rate_up_to_19200(void **state) {
    (void)state;
    assert_in_range(mbframe_gap_us(9600), 4010, 4011);
    assert_in_range(mbframe_gap_us(19200), 2005, 2006);
    assert_int_equal(mbframe_gap_us(115200), 1750);
    assert_int_equal(mbframe_gap_us(0), 1750);
}

static void event_record_survives_its_words(void **state) {
    (void)state;
    const struct idxevent event = {.seq = 0x89abcdef,
                                   .time_us = 0x0123456789abcdef,
                                   .revolution = 77,
                                   .pan_steps = -28000,
                                   .tilt_steps = -1,
                                   .pan_phase = 65535,
                                   .flags = IDXEVENT_STROBE | IDXEVENT_LASER};
    uint16_t words[IDXEVENT_WORDS];
    idxevent_encode(&event, words);
    struct idxevent back = idxevent_decode(words);
    assert_true(back.seq == event.seq && back.time_us == event.time_us);
    assert_true(back.revolution == 77 && back.pan_steps == -28000 && back.tilt_steps == -1);
    assert_true(back.pan_phase == 65535 && back.flags == event.flags);
}

static void full_ring_refuses_counts_and_keeps_order(void **state) {
    (void)state;
    uint16_t words[8], word;
    struct ring16 ring;
    ring16_init(&ring, words, 8);
    for (uint16_t round = 0; round < 100; round++) { /* wraps many times */
        for (uint16_t i = 0; i < 8; i++)
            assert_true(ring16_put(&ring, (uint16_t)(round + i)));
        assert_false(ring16_put(&ring, 999));
        assert_int_equal(ring16_count(&ring), 8);
        for (uint16_t i = 0; i < 8; i++) {
            assert_true(ring16_get(&ring, &word));
            assert_int_equal(word, round + i);
        }
        word = 4711;
        assert_false(ring16_get(&ring, &word));
        assert_int_equal(word, 4711);
    }
    assert_int_equal(ring.lost, 100);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tables_are_sorted_and_do_not_overlap),
        cmocka_unit_test(values_at_reset_lie_in_their_ranges),
        cmocka_unit_test(every_row_has_its_texts),
        cmocka_unit_test(codes_have_texts_and_unknown_ones_say_so),
        cmocka_unit_test(encode_and_decode_are_inverse),
        cmocka_unit_test(block_may_begin_and_end_inside_a_value),
        cmocka_unit_test(addresses_without_register_are_refused),
        cmocka_unit_test(accessors_find_their_value_in_a_block),
        cmocka_unit_test(crc_matches_the_published_example),
        cmocka_unit_test(frame_gap_follows_the_baud_rate_up_to_19200),
        cmocka_unit_test(event_record_survives_its_words),
        cmocka_unit_test(full_ring_refuses_counts_and_keeps_order),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
