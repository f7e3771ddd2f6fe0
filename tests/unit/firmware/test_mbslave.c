/* The Modbus slave alone, against a model that records what it is asked. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "firmware/core/mbslave.h"
#include <string.h>

#define UNIT 17

/* A memory of 64 words and 2000 bits; writing `poison` words or reading behind the end fails. */
struct model {
    uint16_t words[64];
    uint8_t bits[2048];
    int heard, writes, reads;
    int fail_read_after; /* the n-th read of words fails with MBEXC_DEVICE; 0 none */
    const char *long_text;
};

static enum mbexc read_coils(void *ctx, uint16_t start, unsigned count, uint8_t *out_bits) {
    struct model *m = ctx;
    if (start + count > 2000)
        return MBEXC_ADDRESS;
    memcpy(out_bits, m->bits + start, count);
    return MBEXC_OK;
}

static enum mbexc read_discrete(void *ctx, uint16_t start, unsigned count, uint8_t *out_bits) {
    (void)ctx;
    if (start + count > 2000)
        return MBEXC_ADDRESS;
    for (unsigned i = 0; i < count; i++)
        out_bits[i] = (start + i) % 3 == 0;
    return MBEXC_OK;
}

static enum mbexc read_words(void *ctx, bool holding, uint16_t start, unsigned count,
                             uint16_t *out_words) {
    struct model *m = ctx;
    if (m->fail_read_after && ++m->reads >= m->fail_read_after)
        return MBEXC_DEVICE;
    if (start >= 1000 && start + count <= 1125) { /* a block long enough for the limit */
        for (unsigned i = 0; i < count; i++)
            out_words[i] = (uint16_t)i;
        return MBEXC_OK;
    }
    if (start + count > 64)
        return MBEXC_ADDRESS;
    for (unsigned i = 0; i < count; i++)
        out_words[i] = holding ? m->words[start + i] : (uint16_t)(start + i);
    return MBEXC_OK;
}

static enum mbexc write_coils(void *ctx, uint16_t start, unsigned count, const uint8_t *bits) {
    struct model *m = ctx;
    if (start + count > 2000)
        return MBEXC_ADDRESS;
    m->writes++;
    memcpy(m->bits + start, bits, count);
    return MBEXC_OK;
}

static enum mbexc write_words(void *ctx, uint16_t start, unsigned count, const uint16_t *words) {
    struct model *m = ctx;
    if (start >= 1000 && start + count <= 1125) {
        m->writes++;
        return MBEXC_OK;
    }
    if (start + count > 64)
        return MBEXC_ADDRESS;
    for (unsigned i = 0; i < count; i++)
        if (words[i] == 0xdead)
            return MBEXC_DEVICE;
    m->writes++;
    memcpy(m->words + start, words, count * sizeof *words);
    return MBEXC_OK;
}

static void heard(void *ctx) {
    ((struct model *)ctx)->heard++;
}

static const char *identity(void *ctx, uint8_t id) {
    const struct model *m = ctx;
    static const char *const texts[] = {"maker", "code", "1.0"};
    if (id < 3)
        return texts[id];
    if (m->long_text && (id == 4 || id == 5 || id == 0x80))
        return m->long_text;
    return id == 0x81 ? "extended" : NULL;
}

static const struct mbslave_model model_ops = {read_coils,  read_discrete, read_words, write_coils,
                                               write_words, heard,         identity};

struct bench {
    struct mbslave slave;
    struct model model;
};

static int setup(void **state) {
    static struct bench bench;
    memset(&bench, 0, sizeof bench);
    memset(&bench.slave, 0xa5, sizeof bench.slave);
    mbslave_init(&bench.slave, UNIT, &model_ops, &bench.model);
    for (uint16_t i = 0; i < 64; i++)
        bench.model.words[i] = (uint16_t)(0x1000 + i);
    *state = &bench;
    return 0;
}

static unsigned feed(struct bench *b, const uint8_t *bytes, unsigned count) {
    for (unsigned i = 0; i < count; i++)
        mbslave_byte(&b->slave, bytes[i]);
    return mbslave_idle(&b->slave);
}

/* Seals and feeds a request; returns the reply's length without CRC after checking that. */
static unsigned ask(struct bench *b, const uint8_t *request, unsigned count) {
    uint8_t frame[MBFRAME_MAX];
    memcpy(frame, request, count);
    unsigned have = feed(b, frame, mbframe_seal(frame, count));
    if (!have)
        return 0;
    assert_true(mbframe_ok(b->slave.tx, have));
    assert_int_equal(b->slave.tx[0], UNIT);
    return have - 2;
}

#define ASK(b, ...) ask(b, (const uint8_t[]){__VA_ARGS__}, sizeof((const uint8_t[]){__VA_ARGS__}))

static void expect_reply(struct bench *b, unsigned have, const uint8_t *want, unsigned count) {
    assert_int_equal(have, count);
    assert_memory_equal(b->slave.tx + 1, want, count - 1);
}

#define EXPECT(b, have, ...)                                                                       \
    expect_reply(b, have, (const uint8_t[]){__VA_ARGS__},                                          \
                 1 + sizeof((const uint8_t[]){__VA_ARGS__}))

#define EXPECT_EXCEPTION(b, have, function, exception) EXPECT(b, have, (function) | 0x80, exception)

static void reads_bits_of_both_tables(void **state) {
    struct bench *b = *state;
    b->model.bits[3] = b->model.bits[12] = 1;
    EXPECT(b, ASK(b, UNIT, 1, 0, 3, 0, 10), 1, 2, 0x01, 0x02);
    EXPECT(b, ASK(b, UNIT, 2, 0, 0, 0, 4), 2, 1, 0x09);
    assert_int_equal(ASK(b, UNIT, 1, 0, 0, 0x07, 0xd0), 3 + 250);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 1, 0, 0, 0, 0), 1, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 2, 0, 0, 0x07, 0xd1), 2, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 2, 0x07, 0xd0, 0, 1), 2, 2);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 1, 0, 0, 0, 1, 9), 1, 3);
}

static void reads_words_of_both_tables(void **state) {
    struct bench *b = *state;
    EXPECT(b, ASK(b, UNIT, 3, 0, 2, 0, 2), 3, 4, 0x10, 2, 0x10, 3);
    EXPECT(b, ASK(b, UNIT, 4, 0, 2, 0, 2), 4, 4, 0, 2, 0, 3);
    assert_int_equal(ASK(b, UNIT, 4, 0x03, 0xe8, 0, 125), 3 + 250);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 3, 0, 0, 0, 0), 3, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 3, 0, 0, 0, 126), 3, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 4, 0, 64, 0, 1), 4, 2);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 4, 0, 0, 0), 4, 3);
}

static void writes_one_coil_with_two_values_only(void **state) {
    struct bench *b = *state;
    EXPECT(b, ASK(b, UNIT, 5, 0, 7, 0xff, 0), 5, 0, 7, 0xff, 0);
    assert_int_equal(b->model.bits[7], 1);
    EXPECT(b, ASK(b, UNIT, 5, 0, 7, 0, 0), 5, 0, 7, 0, 0);
    assert_int_equal(b->model.bits[7], 0);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 5, 0, 7, 0, 1), 5, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 5, 0, 7, 0xff), 5, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 5, 0x20, 7, 0xff, 0), 5, 2);
    assert_int_equal(b->model.writes, 2);
}

static void writes_one_word(void **state) {
    struct bench *b = *state;
    EXPECT(b, ASK(b, UNIT, 6, 0, 9, 0xab, 0xcd), 6, 0, 9, 0xab, 0xcd);
    assert_int_equal(b->model.words[9], 0xabcd);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 6, 0, 9, 0xab), 6, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 6, 0, 64, 0, 1), 6, 2);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 6, 0, 9, 0xde, 0xad), 6, 4);
    assert_int_equal(b->model.words[9], 0xabcd);
}

static void writes_many_coils(void **state) {
    struct bench *b = *state;
    EXPECT(b, ASK(b, UNIT, 15, 0, 8, 0, 10, 2, 0x05, 0x02), 15, 0, 8, 0, 10);
    assert_int_equal(b->model.bits[8] + 2 * b->model.bits[9] + 4 * b->model.bits[10], 5);
    assert_int_equal(b->model.bits[17], 1);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 15, 0, 8, 0), 15, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 15, 0, 8, 0, 0, 0), 15, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 15, 0, 8, 0x07, 0xb1, 247, 0), 15, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 15, 0, 8, 0, 10, 1, 0x05), 15, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 15, 0, 8, 0, 10, 2, 0x05), 15, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 15, 0x07, 0xd0, 0, 1, 1, 1), 15, 2);
    assert_int_equal(b->model.writes, 1);
}

static void takes_the_longest_block_of_coils(void **state) {
    struct bench *b = *state;
    uint8_t request[7 + 246] = {UNIT, 15, 0, 0, 0x07, 0xb0, 246};
    request[sizeof request - 1] = 0x80;
    EXPECT(b, ask(b, request, sizeof request), 15, 0, 0, 0x07, 0xb0);
    assert_int_equal(b->model.bits[1967], 1);
}

static void writes_many_words_whole_or_not_at_all(void **state) {
    struct bench *b = *state;
    EXPECT(b, ASK(b, UNIT, 16, 0, 1, 0, 2, 4, 0, 10, 0, 11), 16, 0, 1, 0, 2);
    assert_int_equal(b->model.words[2], 11);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 16, 0, 1, 0, 2, 4, 0, 99, 0xde, 0xad), 16, 4);
    assert_int_equal(b->model.words[1], 10);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 16, 0, 1, 0), 16, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 16, 0, 1, 0, 0, 0), 16, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 16, 0, 1, 0, 124, 248, 1), 16, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 16, 0, 1, 0, 2, 3, 0, 1, 0, 1), 16, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 16, 0, 1, 0, 2, 4, 0, 1, 0), 16, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 16, 0, 63, 0, 2, 4, 0, 1, 0, 1), 16, 2);
}

static void takes_the_longest_block_of_words(void **state) {
    struct bench *b = *state;
    uint8_t request[7 + 246] = {UNIT, 16, 0x03, 0xe8, 0, 123, 246};
    EXPECT(b, ask(b, request, sizeof request), 16, 0x03, 0xe8, 0, 123);
}

static void masks_a_word(void **state) {
    struct bench *b = *state;
    b->model.words[4] = 0x0012;
    EXPECT(b, ASK(b, UNIT, 22, 0, 4, 0, 0xf2, 0, 0x25), 22, 0, 4, 0, 0xf2, 0, 0x25);
    assert_int_equal(b->model.words[4], 0x0017); /* the specification's own example */
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 22, 0, 4, 0, 0xf2, 0), 22, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 22, 0, 64, 0, 0, 0, 0), 22, 2);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 22, 0, 4, 0, 0, 0xde, 0xad), 22, 4);
}

static void writes_then_reads_in_one_request(void **state) {
    struct bench *b = *state;
    EXPECT(b, ASK(b, UNIT, 23, 0, 0, 0, 2, 0, 1, 0, 1, 2, 0xab, 0xcd), 23, 4, 0x10, 0, 0xab, 0xcd);
    /* a read that cannot work keeps the write from happening */
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 23, 0, 63, 0, 2, 0, 1, 0, 1, 2, 1, 1), 23, 2);
    assert_int_equal(b->model.words[1], 0xabcd);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 23, 0, 0, 0, 2, 0, 64, 0, 1, 2, 1, 1), 23, 2);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 23, 0, 0, 0, 2, 0, 1, 0), 23, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 23, 0, 0, 0, 0, 0, 1, 0, 1, 2, 1, 1), 23, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 23, 0, 0, 0, 126, 0, 1, 0, 1, 2, 1, 1), 23, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 23, 0, 0, 0, 2, 0, 1, 0, 0, 0), 23, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 23, 0, 0, 0, 2, 0, 1, 0, 122, 244, 1), 23, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 23, 0, 0, 0, 2, 0, 1, 0, 1, 3, 1, 1), 23, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 23, 0, 0, 0, 2, 0, 1, 0, 1, 2, 1), 23, 3);
    b->model.fail_read_after = 2; /* the model breaks between check and read */
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 23, 0, 0, 0, 2, 0, 1, 0, 1, 2, 1, 1), 23, 4);
}

static void identifies_the_device(void **state) {
    struct bench *b = *state;
    EXPECT(b, ASK(b, UNIT, 0x2b, 0x0e, 1, 0), 0x2b, 0x0e, 1, 0x82, 0, 0, 3, 0, 5, 'm', 'a', 'k',
           'e', 'r', 1, 4, 'c', 'o', 'd', 'e', 2, 3, '1', '.', '0');
    EXPECT(b, ASK(b, UNIT, 0x2b, 0x0e, 1, 2), 0x2b, 0x0e, 1, 0x82, 0, 0, 1, 2, 3, '1', '.', '0');
    EXPECT(b, ASK(b, UNIT, 0x2b, 0x0e, 4, 1), 0x2b, 0x0e, 4, 0x82, 0, 0, 1, 1, 4, 'c', 'o', 'd',
           'e');
    EXPECT(b, ASK(b, UNIT, 0x2b, 0x0e, 3, 0x81), 0x2b, 0x0e, 3, 0x82, 0, 0, 1, 0x81, 8, 'e', 'x',
           't', 'e', 'n', 'd', 'e', 'd');
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 0x2b, 0x0e, 4, 9), 0x2b, 2);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 0x2b, 0x0e, 0, 0), 0x2b, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 0x2b, 0x0e, 5, 0), 0x2b, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 0x2b, 0x0e, 1), 0x2b, 3);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 0x2b, 0x0d, 1, 0), 0x2b, 1);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 0x2b), 0x2b, 1);
}

static void identification_stream_from_an_unknown_object_starts_over(void **state) {
    struct bench *b = *state;
    unsigned have = ASK(b, UNIT, 0x2b, 0x0e, 2, 0x60);
    assert_int_equal(b->slave.tx[7], 3);
    assert_int_equal(b->slave.tx[8], 0);
    assert_int_equal(have, 1 + 7 + 3 * 2 + 5 + 4 + 3);
}

static void identification_too_long_for_a_frame_goes_on_in_the_next(void **state) {
    struct bench *b = *state;
    char text[151];
    memset(text, 'x', sizeof text - 1);
    text[sizeof text - 1] = 0;
    b->model.long_text = text;
    unsigned have = ASK(b, UNIT, 0x2b, 0x0e, 2, 0);
    assert_in_range(have, 1, MBFRAME_MAX - 2);
    assert_int_equal(b->slave.tx[5], 0xff); /* more follows */
    assert_int_equal(b->slave.tx[6], 5);    /* from object 5 */
    assert_int_equal(b->slave.tx[7], 4);
    have = ASK(b, UNIT, 0x2b, 0x0e, 2, 5);
    assert_int_equal(have, 1 + 7 + 2 + 150);
    assert_int_equal(b->slave.tx[5], 0);
}

static void unknown_functions_get_exception_1(void **state) {
    struct bench *b = *state;
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 7), 7, 1);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 100, 1, 2, 3), 100, 1);
    EXPECT_EXCEPTION(b, ASK(b, UNIT, 0), 0, 1);
    assert_int_equal(b->slave.exceptions, 3);
}

static void broadcast_writes_are_done_in_silence(void **state) {
    struct bench *b = *state;
    assert_int_equal(ASK(b, 0, 6, 0, 5, 0, 77), 0);
    assert_int_equal(b->model.words[5], 77);
    assert_int_equal(ASK(b, 0, 5, 0, 5, 0xff, 0), 0);
    assert_int_equal(ASK(b, 0, 15, 0, 6, 0, 1, 1, 1), 0);
    assert_int_equal(ASK(b, 0, 16, 0, 6, 0, 1, 2, 0, 78), 0);
    assert_int_equal(ASK(b, 0, 22, 0, 6, 0, 0, 0, 79), 0);
    assert_int_equal(b->model.words[6], 79);
    assert_int_equal(b->model.bits[5] + b->model.bits[6], 2);
    assert_int_equal(b->model.heard, 0);
}

static void broadcast_reads_and_nonsense_are_ignored(void **state) {
    struct bench *b = *state;
    assert_int_equal(ASK(b, 0, 3, 0, 0, 0, 1), 0);
    assert_int_equal(ASK(b, 0, 23, 0, 0, 0, 1, 0, 1, 0, 1, 2, 1, 1), 0);
    assert_int_equal(ASK(b, 0, 99), 0);
    assert_int_equal(ASK(b, 0, 6, 0, 64, 0, 1), 0);
    assert_int_equal(b->model.writes, 0);
}

static void other_units_are_not_answered(void **state) {
    struct bench *b = *state;
    assert_int_equal(ASK(b, UNIT + 1, 6, 0, 5, 0, 77), 0);
    assert_int_equal(ASK(b, 255, 6, 0, 5, 0, 77), 0);
    assert_int_equal(b->model.writes + b->model.heard, 0);
    assert_int_equal(b->slave.frames_ok, 0);
}

static void every_corrupted_bit_gives_silence_and_no_change(void **state) {
    struct bench *b = *state;
    uint8_t frame[8] = {UNIT, 6, 0, 5, 0, 77};
    unsigned count = mbframe_seal(frame, 6);
    for (unsigned bit = 0; bit < 8 * count; bit++) {
        frame[bit / 8] ^= (uint8_t)(1u << bit % 8);
        assert_int_equal(feed(b, frame, count), 0);
        frame[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    assert_int_equal(b->slave.frames_bad, 8 * count);
    assert_int_equal(b->model.writes + b->model.heard, 0);
    assert_int_equal(feed(b, frame, count), count);
}

static void truncated_split_and_glued_frames_give_silence(void **state) {
    struct bench *b = *state;
    uint8_t frame[16] = {UNIT, 3, 0, 0, 0, 1};
    unsigned count = mbframe_seal(frame, 6);
    for (unsigned n = 1; n < count; n++)
        assert_int_equal(feed(b, frame, n), 0); /* both halves of each split are in here */
    for (unsigned n = 1; n < count; n++)
        assert_int_equal(feed(b, frame + n, count - n), 0);
    memcpy(frame + count, frame, count);
    assert_int_equal(feed(b, frame, 2 * count), 0);
    assert_int_equal(feed(b, frame, count), 7);
}

static void noise_before_a_frame_costs_that_frame_only(void **state) {
    struct bench *b = *state;
    uint8_t frame[16] = {0x55, UNIT, 3, 0, 0, 0, 1};
    unsigned count = mbframe_seal(frame + 1, 6);
    assert_int_equal(feed(b, frame, 1 + count), 0);
    assert_int_equal(feed(b, frame + 1, count), 7);
}

static void overlong_frames_are_dropped_whole(void **state) {
    struct bench *b = *state;
    for (int i = 0; i < 1000; i++)
        mbslave_byte(&b->slave, (uint8_t)i);
    assert_int_equal(mbslave_idle(&b->slave), 0);
    assert_int_equal(b->slave.frames_bad, 1);
    EXPECT(b, ASK(b, UNIT, 4, 0, 1, 0, 1), 4, 2, 0, 1);
}

static void damaged_byte_drops_an_otherwise_good_frame(void **state) {
    struct bench *b = *state;
    uint8_t frame[8] = {UNIT, 3, 0, 0, 0, 1};
    unsigned count = mbframe_seal(frame, 6);
    mbslave_spoil(&b->slave);
    assert_int_equal(feed(b, frame, count), 0);
    assert_int_equal(feed(b, frame, count), 7);
    mbslave_spoil(&b->slave); /* nothing else came */
    assert_int_equal(mbslave_idle(&b->slave), 0);
    assert_int_equal(b->slave.frames_bad, 2);
}

static void idle_without_bytes_is_nothing(void **state) {
    struct bench *b = *state;
    assert_int_equal(mbslave_idle(&b->slave), 0);
    assert_int_equal(b->slave.frames_bad, 0);
}

static void request_for_this_unit_feeds_the_host_watchdog_even_if_refused(void **state) {
    struct bench *b = *state;
    (void)ASK(b, UNIT, 3, 0, 0, 0, 1);
    (void)ASK(b, UNIT, 99);
    assert_int_equal(b->model.heard, 2);
    assert_int_equal(b->slave.frames_ok, 2);
}

#define TEST(f) cmocka_unit_test_setup(f, setup)

int main(void) {
    const struct CMUnitTest tests[] = {
        TEST(reads_bits_of_both_tables),
        TEST(reads_words_of_both_tables),
        TEST(writes_one_coil_with_two_values_only),
        TEST(writes_one_word),
        TEST(writes_many_coils),
        TEST(takes_the_longest_block_of_coils),
        TEST(writes_many_words_whole_or_not_at_all),
        TEST(takes_the_longest_block_of_words),
        TEST(masks_a_word),
        TEST(writes_then_reads_in_one_request),
        TEST(identifies_the_device),
        TEST(identification_stream_from_an_unknown_object_starts_over),
        TEST(identification_too_long_for_a_frame_goes_on_in_the_next),
        TEST(unknown_functions_get_exception_1),
        TEST(broadcast_writes_are_done_in_silence),
        TEST(broadcast_reads_and_nonsense_are_ignored),
        TEST(other_units_are_not_answered),
        TEST(every_corrupted_bit_gives_silence_and_no_change),
        TEST(truncated_split_and_glued_frames_give_silence),
        TEST(noise_before_a_frame_costs_that_frame_only),
        TEST(overlong_frames_are_dropped_whole),
        TEST(damaged_byte_drops_an_otherwise_good_frame),
        TEST(idle_without_bytes_is_nothing),
        TEST(request_for_this_unit_feeds_the_host_watchdog_even_if_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
