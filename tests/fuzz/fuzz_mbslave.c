/* The frame path: bytes and idle events into the Modbus slave, over a model that checks what it is
 * asked. Input: chunks of one length byte and up to 127 bytes; bit 7 of the length appends a good
 * CRC, 0 is an idle event alone. A chunk of 127 bytes is not followed by an idle event, so that
 * frames can be long. */
#include "firmware/core/mbslave.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

enum { UNIT = 1, WORDS = 200 };

struct model {
    uint16_t words[WORDS];
    uint8_t bits[MBSLAVE_BITS_MAX];
    unsigned heard;
};

static void require(bool condition) {
    if (!condition)
        abort();
}

static enum mbexc read_bits(void *ctx, uint16_t start, unsigned count, uint8_t *out_bits) {
    struct model *m = ctx;
    require(count >= 1 && count <= MBSLAVE_BITS_MAX);
    if (start + count > MBSLAVE_BITS_MAX)
        return MBEXC_ADDRESS;
    memcpy(out_bits, m->bits + start, count);
    return MBEXC_OK;
}

static enum mbexc read_words(void *ctx, bool holding, uint16_t start, unsigned count,
                             uint16_t *out_words) {
    struct model *m = ctx;
    (void)holding;
    require(count >= 1 && count <= 125);
    if (start + count > WORDS)
        return MBEXC_ADDRESS;
    memcpy(out_words, m->words + start, count * sizeof *out_words);
    return MBEXC_OK;
}

static enum mbexc write_coils(void *ctx, uint16_t start, unsigned count, const uint8_t *bits) {
    struct model *m = ctx;
    require(count >= 1 && count <= 1968);
    if (start + count > MBSLAVE_BITS_MAX)
        return MBEXC_ADDRESS;
    for (unsigned i = 0; i < count; i++) {
        require(bits[i] <= 1);
        m->bits[start + i] = bits[i];
    }
    return MBEXC_OK;
}

static enum mbexc write_words(void *ctx, uint16_t start, unsigned count, const uint16_t *words) {
    struct model *m = ctx;
    require(count >= 1 && count <= 123);
    if (start + count > WORDS)
        return MBEXC_ADDRESS;
    if (words[0] == 0x5555)
        return MBEXC_VALUE;
    memcpy(m->words + start, words, count * sizeof *words);
    return MBEXC_OK;
}

static void heard(void *ctx) {
    ((struct model *)ctx)->heard++;
}

static const char *identity(void *ctx, uint8_t id) {
    static const char text[] = "a text of some length, so that a few of them do not fit one frame";
    (void)ctx;
    return id < 7 || id == 0x80 ? text : NULL;
}

static void idle(struct mbslave *slave, struct model *model) {
    struct mbslave before = *slave;
    unsigned heard_before = model->heard;
    unsigned count = mbslave_idle(slave);
    require(slave->rx_count == 0 && !slave->rx_spoilt);
    require(count == 0 || (count >= 5 && mbframe_ok(slave->tx, count) && slave->tx[0] == UNIT));
    bool good = !before.rx_spoilt && mbframe_ok(before.rx, before.rx_count);
    bool ours = good && before.rx[0] == UNIT;
    require((count != 0) == ours); /* an answer to each of our frames, and to nothing else */
    require(model->heard - heard_before == (ours ? 1u : 0u));
    if (count)
        require((slave->tx[1] & 0x7fu) == (before.rx[1] & 0x7fu));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const struct mbslave_model ops = {read_bits,   read_bits, read_words, write_coils,
                                             write_words, heard,     identity};
    static struct model model;
    struct mbslave slave;
    memset(&model, 0, sizeof model);
    memset(&slave, 0xa5, sizeof slave);
    mbslave_init(&slave, UNIT, &ops, &model);
    for (size_t at = 0; at < size;) {
        size_t length = data[at] & 0x7fu;
        bool seal = (data[at] & 0x80u) != 0, whole = length < 127;
        at++;
        length = length < size - at ? length : size - at;
        uint8_t frame[130];
        memcpy(frame, data + at, length);
        at += length;
        size_t count = seal ? mbframe_seal(frame, (unsigned)length) : length;
        for (size_t i = 0; i < count; i++)
            mbslave_byte(&slave, frame[i]);
        if (whole)
            idle(&slave, &model);
    }
    idle(&slave, &model);
    return 0;
}
