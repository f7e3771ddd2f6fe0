#include "firmware/core/mbslave.h"
#include <stddef.h>

/* A PDU is the frame without unit and CRC: function code first. Handlers get it with its length and
 * write their reply's PDU; all lengths count the function code. */
struct reply {
    uint8_t *pdu;
    unsigned count;
};

void mbslave_init(struct mbslave *slave, uint8_t unit, const struct mbslave_model *model,
                  void *ctx) {
    slave->model = model;
    slave->ctx = ctx;
    slave->unit = unit;
    slave->rx_count = 0;
    slave->rx_spoilt = false;
    slave->frames_ok = 0;
    slave->frames_bad = 0;
    slave->exceptions = 0;
}

void mbslave_byte(struct mbslave *slave, uint8_t byte) {
    if (slave->rx_count < MBFRAME_MAX)
        slave->rx[slave->rx_count++] = byte;
    else
        slave->rx_spoilt = true;
}

void mbslave_spoil(struct mbslave *slave) {
    slave->rx_spoilt = true;
}

/* The first `count` bytes of the request are the reply: 5, 6, 15, 16, 22. */
static void echo(const uint8_t *pdu, unsigned count, struct reply *reply) {
    for (unsigned i = 0; i < count; i++)
        reply->pdu[i] = pdu[i];
    reply->count = count;
}

static void put_words(const uint16_t *words, unsigned count, struct reply *reply) {
    reply->pdu[1] = (uint8_t)(2 * count);
    for (unsigned i = 0; i < count; i++)
        mbframe_put16(reply->pdu + 2 + 2 * i, words[i]);
    reply->count = 2 + 2 * count;
}

static void get_words(const uint8_t *bytes, unsigned count, uint16_t *out_words) {
    for (unsigned i = 0; i < count; i++)
        out_words[i] = mbframe_get16(bytes + 2 * i);
}

/* 1, 2: function, start, quantity -> function, byte count, bits. */
static enum mbexc read_bits(struct mbslave *s, const uint8_t *pdu, unsigned n,
                            struct reply *reply) {
    unsigned quantity = mbframe_get16(pdu + 3);
    if (n != 5 || quantity < 1 || quantity > MBSLAVE_BITS_MAX)
        return MBEXC_VALUE;
    uint8_t *bits = s->scratch.bits;
    uint16_t start = mbframe_get16(pdu + 1);
    enum mbexc exc = pdu[0] == 1 ? s->model->read_coils(s->ctx, start, quantity, bits)
                                 : s->model->read_discrete(s->ctx, start, quantity, bits);
    if (exc)
        return exc;
    unsigned bytes = (quantity + 7) / 8;
    reply->pdu[1] = (uint8_t)bytes;
    for (unsigned i = 0; i < bytes; i++)
        reply->pdu[2 + i] = 0;
    for (unsigned i = 0; i < quantity; i++)
        reply->pdu[2 + i / 8] |= (uint8_t)((bits[i] & 1u) << i % 8);
    reply->count = 2 + bytes;
    return MBEXC_OK;
}

/* 3, 4: function, start, quantity -> function, byte count, words. */
static enum mbexc read_words(struct mbslave *s, const uint8_t *pdu, unsigned n,
                             struct reply *reply) {
    unsigned quantity = mbframe_get16(pdu + 3);
    if (n != 5 || quantity < 1 || quantity > 125)
        return MBEXC_VALUE;
    enum mbexc exc = s->model->read_words(s->ctx, pdu[0] == 3, mbframe_get16(pdu + 1), quantity,
                                          s->scratch.words.out);
    if (!exc)
        put_words(s->scratch.words.out, quantity, reply);
    return exc;
}

/* 5: function, coil, 0x0000 or 0xff00. */
static enum mbexc write_coil(struct mbslave *s, const uint8_t *pdu, unsigned n,
                             struct reply *reply) {
    uint16_t value = mbframe_get16(pdu + 3);
    if (n != 5 || (value != 0 && value != 0xff00))
        return MBEXC_VALUE;
    uint8_t bit = value ? 1 : 0;
    echo(pdu, 5, reply);
    return s->model->write_coils(s->ctx, mbframe_get16(pdu + 1), 1, &bit);
}

/* 6: function, register, word. */
static enum mbexc write_word(struct mbslave *s, const uint8_t *pdu, unsigned n,
                             struct reply *reply) {
    if (n != 5)
        return MBEXC_VALUE;
    uint16_t word = mbframe_get16(pdu + 3);
    echo(pdu, 5, reply);
    return s->model->write_words(s->ctx, mbframe_get16(pdu + 1), 1, &word);
}

/* 15: function, start, quantity, byte count, bits. */
static enum mbexc write_coils(struct mbslave *s, const uint8_t *pdu, unsigned n,
                              struct reply *reply) {
    unsigned quantity = mbframe_get16(pdu + 3), bytes = (quantity + 7) / 8;
    if (n < 6 || quantity < 1 || quantity > 1968 || pdu[5] != bytes || n != 6 + bytes)
        return MBEXC_VALUE;
    for (unsigned i = 0; i < quantity; i++)
        s->scratch.bits[i] = (uint8_t)((unsigned)pdu[6 + i / 8] >> i % 8 & 1u);
    echo(pdu, 5, reply);
    return s->model->write_coils(s->ctx, mbframe_get16(pdu + 1), quantity, s->scratch.bits);
}

/* 16: function, start, quantity, byte count, words. */
static enum mbexc write_words(struct mbslave *s, const uint8_t *pdu, unsigned n,
                              struct reply *reply) {
    unsigned quantity = mbframe_get16(pdu + 3);
    if (n < 6 || quantity < 1 || quantity > 123 || pdu[5] != 2 * quantity || n != 6 + 2 * quantity)
        return MBEXC_VALUE;
    get_words(pdu + 6, quantity, s->scratch.words.in);
    echo(pdu, 5, reply);
    return s->model->write_words(s->ctx, mbframe_get16(pdu + 1), quantity, s->scratch.words.in);
}

/* 22: function, register, and-mask, or-mask. */
static enum mbexc mask_word(struct mbslave *s, const uint8_t *pdu, unsigned n,
                            struct reply *reply) {
    if (n != 7)
        return MBEXC_VALUE;
    uint16_t address = mbframe_get16(pdu + 1), word;
    unsigned and_mask = mbframe_get16(pdu + 3), or_mask = mbframe_get16(pdu + 5);
    enum mbexc exc = s->model->read_words(s->ctx, true, address, 1, &word);
    if (exc)
        return exc;
    word = (uint16_t)((word & and_mask) | (or_mask & ~and_mask));
    echo(pdu, 7, reply);
    return s->model->write_words(s->ctx, address, 1, &word);
}

/* 23: function, read start, read quantity, write start, write quantity, byte count, words -> as 3.
 * The write comes first; it is done only if the read will work. */
static enum mbexc read_write(struct mbslave *s, const uint8_t *pdu, unsigned n,
                             struct reply *reply) {
    if (n < 10)
        return MBEXC_VALUE;
    uint16_t read_at = mbframe_get16(pdu + 1), write_at = mbframe_get16(pdu + 5);
    unsigned reads = mbframe_get16(pdu + 3), writes = mbframe_get16(pdu + 7);
    if (reads < 1 || reads > 125 || writes < 1 || writes > 121 || pdu[9] != 2 * writes ||
        n != 10 + 2 * writes)
        return MBEXC_VALUE;
    uint16_t *in = s->scratch.words.in, *out = s->scratch.words.out;
    get_words(pdu + 10, writes, in);
    enum mbexc exc = s->model->read_words(s->ctx, true, read_at, reads, out);
    if (!exc)
        exc = s->model->write_words(s->ctx, write_at, writes, in);
    if (!exc)
        exc = s->model->read_words(s->ctx, true, read_at, reads, out);
    if (!exc)
        put_words(out, reads, reply);
    return exc;
}

/* Appends object `id` to the reply; false if it does not fit. */
static bool put_object(uint8_t id, const char *text, struct reply *reply) {
    unsigned length = 0;
    while (text[length])
        length++;
    if (reply->count + 2 + length > MBFRAME_MAX - 3)
        return false;
    reply->pdu[reply->count++] = id;
    reply->pdu[reply->count++] = (uint8_t)length;
    for (unsigned i = 0; i < length; i++)
        reply->pdu[reply->count++] = (uint8_t)text[i];
    reply->pdu[6]++;
    return true;
}

/* 43/14: 0x2b, 0x0e, access, object -> 0x2b, 0x0e, access, conformity, more, next, number, objects.
 */
static enum mbexc identify(struct mbslave *s, const uint8_t *pdu, unsigned n, struct reply *reply) {
    static const uint8_t last_of[5] = {0, 0x02, 0x7f, 0xff, 0}; /* basic, regular, extended */
    if (n < 2 || pdu[1] != 0x0e)
        return MBEXC_FUNCTION;
    if (n != 4 || pdu[2] < 1 || pdu[2] > 4)
        return MBEXC_VALUE;
    uint8_t access = pdu[2];
    unsigned id = pdu[3], last = access == 4 ? id : last_of[access];
    if (!s->model->identity(s->ctx, (uint8_t)id)) {
        if (access == 4)
            return MBEXC_ADDRESS;
        id = 0; /* a stream from an unknown object starts over */
    }
    echo(pdu, 3, reply);
    reply->pdu[3] = 0x82; /* regular identification, stream and single */
    reply->pdu[4] = 0;
    reply->pdu[5] = 0;
    reply->pdu[6] = 0;
    reply->count = 7;
    for (; id <= last; id++) {
        const char *text = s->model->identity(s->ctx, (uint8_t)id);
        if (!text || put_object((uint8_t)id, text, reply))
            continue;
        reply->pdu[4] = 0xff; /* more follows, from there */
        reply->pdu[5] = (uint8_t)id;
        break;
    }
    return MBEXC_OK;
}

static const struct function {
    uint8_t code;
    bool broadcast;
    enum mbexc (*run)(struct mbslave *s, const uint8_t *pdu, unsigned n, struct reply *reply);
} functions[] = {
    {1, false, read_bits},   {2, false, read_bits},   {3, false, read_words},
    {4, false, read_words},  {5, true, write_coil},   {6, true, write_word},
    {15, true, write_coils}, {16, true, write_words}, {22, true, mask_word},
    {23, false, read_write}, {0x2b, false, identify},
};

static const struct function *find_function(uint8_t code) {
    for (unsigned i = 0; i < sizeof functions / sizeof functions[0]; i++)
        if (functions[i].code == code)
            return &functions[i];
    return NULL;
}

/* Carries out a good frame for this unit or for all; returns the reply's length. */
static unsigned carry_out(struct mbslave *s, unsigned count) {
    bool broadcast = s->rx[0] == 0;
    const struct function *function = find_function(s->rx[1]);
    if (broadcast && (!function || !function->broadcast))
        return 0;
    struct reply reply = {s->tx + 1, 0};
    s->tx[0] = s->unit;
    s->tx[1] = s->rx[1];
    /* Handlers look at up to 5 bytes before they know the length: what lies behind a short frame is
     * its CRC or older bytes, and the length check then rejects it. */
    enum mbexc exc = function ? function->run(s, s->rx + 1, count - 3, &reply) : MBEXC_FUNCTION;
    if (broadcast)
        return 0;
    if (exc) {
        s->exceptions++;
        s->tx[1] = s->rx[1] | 0x80u;
        s->tx[2] = (uint8_t)exc;
        reply.count = 2;
    }
    return mbframe_seal(s->tx, 1 + reply.count);
}

unsigned mbslave_idle(struct mbslave *slave) {
    unsigned count = slave->rx_count;
    bool spoilt = slave->rx_spoilt;
    slave->rx_count = 0;
    slave->rx_spoilt = false;
    if (!count && !spoilt)
        return 0;
    if (spoilt || !mbframe_ok(slave->rx, count)) {
        slave->frames_bad++;
        return 0;
    }
    if (slave->rx[0] != 0 && slave->rx[0] != slave->unit)
        return 0;
    slave->frames_ok++;
    if (slave->rx[0] != 0)
        slave->model->heard(slave->ctx);
    return carry_out(slave, count);
}
