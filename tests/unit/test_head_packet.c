/* The head's packets: what is encoded is decoded, and nothing else is. */
#include "base/head_packet.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

static struct head_packet example(unsigned count, uint32_t seq) {
    struct head_packet p = {.packet_seq = seq,
                            .first_sample_seq = seq * HEAD_PACKET_MAX_SAMPLES,
                            .head_t_ns = 123456789012345 + seq,
                            .interval_ns = 40000,
                            .status = HEAD_STATUS_LASER_ON,
                            .flags = HEAD_PACKET_RESET,
                            .sample_count = (uint8_t)count};
    for (unsigned i = 0; i < count; i++) {
        p.samples[i].position = head_position_from_counts(1000.25 + i);
        p.samples[i].range = head_range_from_m(1.5 + 0.01 * i);
        p.samples[i].intensity = (uint16_t)(100 * i);
        p.samples[i].ambient = (uint16_t)(7 * i);
        p.samples[i].flags = (uint8_t)(i & 3);
        p.samples[i].seq8 = (uint8_t)(p.first_sample_seq + i);
    }
    return p;
}

static void full_packet_is_512_bytes(void **state) {
    (void)state;
    assert_int_equal(head_packet_bytes(HEAD_PACKET_MAX_SAMPLES), HEAD_PACKET_MAX_BYTES);
}

static void decodes_what_was_encoded(void **state) {
    (void)state;
    for (unsigned count = 0; count <= HEAD_PACKET_MAX_SAMPLES; count++) {
        struct head_packet in = example(count, 7), out;
        memset(&out, 0, sizeof out);
        uint8_t bytes[HEAD_PACKET_MAX_BYTES];
        size_t size = 0, used = 0;
        assert_int_equal(head_packet_encode(&in, bytes, &size), ST_OK);
        assert_int_equal(size, head_packet_bytes(count));
        assert_int_equal(head_packet_decode(bytes, size, &out, &used), ST_OK);
        assert_int_equal(used, size);
        assert_int_equal(out.packet_seq, in.packet_seq);
        assert_int_equal(out.first_sample_seq, in.first_sample_seq);
        assert_true(out.head_t_ns == in.head_t_ns);
        assert_int_equal(out.interval_ns, in.interval_ns);
        assert_int_equal(out.status, in.status);
        assert_int_equal(out.flags, in.flags);
        assert_memory_equal(out.samples, in.samples, count * sizeof in.samples[0]);
    }
}

static void rejects_every_single_bit_error(void **state) {
    (void)state;
    struct head_packet in = example(5, 3), out;
    uint8_t bytes[HEAD_PACKET_MAX_BYTES];
    size_t size = 0, used = 0;
    assert_int_equal(head_packet_encode(&in, bytes, &size), ST_OK);
    for (size_t bit = 0; bit < size * 8; bit++) {
        bytes[bit / 8] ^= (uint8_t)(1u << (bit % 8));
        assert_int_not_equal(head_packet_decode(bytes, size, &out, &used), ST_OK);
        bytes[bit / 8] ^= (uint8_t)(1u << (bit % 8));
    }
}

static void asks_for_more_on_every_prefix(void **state) {
    (void)state;
    struct head_packet in = example(5, 3), out;
    uint8_t bytes[HEAD_PACKET_MAX_BYTES];
    size_t size = 0, used = 0;
    assert_int_equal(head_packet_encode(&in, bytes, &size), ST_OK);
    for (size_t n = 0; n < size; n++)
        assert_int_equal(head_packet_decode(bytes, n, &out, &used), ST_TIMEOUT);
}

static void refuses_to_encode_what_the_protocol_cannot_carry(void **state) {
    (void)state;
    uint8_t bytes[HEAD_PACKET_MAX_BYTES];
    size_t size = 0;
    struct head_packet p = example(3, 1);
    p.sample_count = HEAD_PACKET_MAX_SAMPLES + 1;
    assert_int_equal(head_packet_encode(&p, bytes, &size), ST_INVALID);
    p = example(3, 1);
    p.head_t_ns = -1;
    assert_int_equal(head_packet_encode(&p, bytes, &size), ST_INVALID);
    p = example(3, 1);
    p.interval_ns = HEAD_INTERVAL_MAX_NS + 1;
    assert_int_equal(head_packet_encode(&p, bytes, &size), ST_INVALID);
}

static void stream_finds_packets_between_garbage(void **state) {
    (void)state;
    static uint8_t stream[16384];
    size_t size = 0;
    for (uint32_t seq = 0; seq < 12; seq++) {
        struct head_packet p = example(seq % 4, seq);
        size_t used = 0;
        for (unsigned i = 0; i < seq; i++)
            stream[size++] = (uint8_t)(i & 1 ? 'S' : 0x43); /* looks like a magic's beginning */
        assert_int_equal(head_packet_encode(&p, stream + size, &used), ST_OK);
        if (seq == 5)
            stream[size + 40] ^= 1;
        size += used;
    }
    struct head_stream_stats stats = {0};
    struct head_packet p;
    size_t offset = 0;
    uint32_t expected = 0;
    while (head_stream_next(stream, size, &offset, &p, &stats) == ST_OK) {
        if (expected == 5)
            expected = 6;
        assert_int_equal(p.packet_seq, expected++);
    }
    assert_int_equal(stats.packets, 11);
    assert_int_equal(stats.damaged, 1);
    assert_int_equal(stats.bytes_skipped, 66 + head_packet_bytes(1));
    assert_int_equal(offset, size);
}

static void stream_fed_in_pieces_gives_the_same_packets(void **state) {
    (void)state;
    uint8_t whole[8192], piece[8192];
    size_t size = 0;
    for (uint32_t seq = 0; seq < 10; seq++) {
        struct head_packet p = example(30, seq);
        size_t used = 0;
        assert_int_equal(head_packet_encode(&p, whole + size, &used), ST_OK);
        size += used;
    }
    for (size_t step = 1; step < 1200; step += 97) {
        size_t have = 0, got = 0;
        struct head_stream_stats stats = {0};
        struct head_packet p;
        for (size_t at = 0; at < size; at += step) {
            size_t n = at + step < size ? step : size - at;
            memcpy(piece + have, whole + at, n);
            have += n;
            size_t offset = 0;
            while (head_stream_next(piece, have, &offset, &p, &stats) == ST_OK)
                assert_int_equal(p.packet_seq, got++);
            memmove(piece, piece + offset, have - offset);
            have -= offset;
        }
        assert_int_equal(got, 10);
        assert_int_equal(stats.bytes_skipped, 0);
    }
}

static void position_and_range_round_to_nearest(void **state) {
    (void)state;
    assert_int_equal(head_position_from_counts(1.0), 1u << 20);
    assert_int_equal(head_position_from_counts(4096.0), 0);
    assert_int_equal(head_position_from_counts(-1.0), 4095u << 20);
    assert_int_equal(head_position_from_counts(4096.0 - 1e-12), 0); /* rounds into the next turn */
    for (double r = 0.001; r < 20; r *= 1.37)
        assert_true(fabs(head_range_m(head_range_from_m(r)) - r) <= 0.5 * HEAD_RANGE_LSB_M);
    assert_int_equal(head_range_from_m((double)NAN), HEAD_RANGE_NONE);
    assert_int_equal(head_range_from_m(-0.1), HEAD_RANGE_NONE);
    assert_int_equal(head_range_from_m(1e6), HEAD_RANGE_NONE);
    assert_true(isnan(head_range_m(HEAD_RANGE_NONE)));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(full_packet_is_512_bytes),
        cmocka_unit_test(decodes_what_was_encoded),
        cmocka_unit_test(rejects_every_single_bit_error),
        cmocka_unit_test(asks_for_more_on_every_prefix),
        cmocka_unit_test(refuses_to_encode_what_the_protocol_cannot_carry),
        cmocka_unit_test(stream_finds_packets_between_garbage),
        cmocka_unit_test(stream_fed_in_pieces_gives_the_same_packets),
        cmocka_unit_test(position_and_range_round_to_nearest),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
