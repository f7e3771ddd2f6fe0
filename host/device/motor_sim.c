#include "device/motor_sim.h"

#include "device/motor_map.h"
#include "firmware/port/sim/sim.h"
#include "firmware/shared/mbframe.h"

#include <stdlib.h>
#include <string.h>

enum { UNIT = 1, TIMEOUT_US = 1000000, TRIES = 3, BLOCK_MS = 1000 };

/* Sends a PDU behind the unit's number in `frame`. Returns the reply's length (unit first, no CRC),
 * minus an exception code, or minus 1000 for silence. */
static int ask(const struct motor_sim_line *line, const uint8_t *frame, size_t count, bool repeat,
               uint8_t *out_reply) {
    for (int attempt = 0; attempt < (repeat ? TRIES : 1); attempt++) {
        size_t got = sim_transact(line->sim, frame, count, out_reply, line->timeout_us);
        if (got >= 3 && out_reply[1] == (frame[1] | 0x80))
            return -(int)out_reply[2];
        if (got >= 2 && out_reply[1] == frame[1])
            return (int)got;
    }
    return -1000;
}

/* The result of a line's call. `want` is the reply's length. */
static int finish(int got, size_t want, struct errctx *err) {
    if (got == -1000)
        return errctx_set(err, ST_TIMEOUT, "the simulated controller does not answer");
    if (got < 0)
        return -got;
    return (size_t)got == want ? 0 : errctx_set(err, ST_DAMAGED, "a reply of %d bytes", got);
}

static void take_words(const uint8_t *bytes, unsigned count, uint16_t *out_words) {
    for (unsigned i = 0; i < count; i++)
        out_words[i] = mbframe_get16(bytes + 2 * i);
}

static int line_read(void *ctx, uint16_t start, unsigned count, uint16_t *out_words,
                     struct errctx *err) {
    uint8_t frame[6] = {UNIT, 3}, reply[MBFRAME_MAX];
    mbframe_put16(frame + 2, start);
    mbframe_put16(frame + 4, (uint16_t)count);
    int result = finish(ask(ctx, frame, sizeof frame, true, reply), 3 + 2 * count, err);
    if (!result)
        take_words(reply + 3, count, out_words);
    return result;
}

static int line_read_discrete(void *ctx, uint16_t start, unsigned count, uint8_t *out_bits,
                              struct errctx *err) {
    uint8_t frame[6] = {UNIT, 2}, reply[MBFRAME_MAX];
    mbframe_put16(frame + 2, start);
    mbframe_put16(frame + 4, (uint16_t)count);
    int result = finish(ask(ctx, frame, sizeof frame, true, reply), 3 + (count + 7) / 8, err);
    for (unsigned i = 0; i < count && !result; i++)
        out_bits[i] = reply[3 + i / 8] >> i % 8 & 1;
    return result;
}

static int line_write(void *ctx, uint16_t start, unsigned count, const uint16_t *words, bool repeat,
                      struct errctx *err) {
    uint8_t frame[MBFRAME_MAX] = {UNIT, 16}, reply[MBFRAME_MAX];
    mbframe_put16(frame + 2, start);
    mbframe_put16(frame + 4, (uint16_t)count);
    frame[6] = (uint8_t)(2 * count);
    for (unsigned i = 0; i < count; i++)
        mbframe_put16(frame + 7 + 2 * i, words[i]);
    return finish(ask(ctx, frame, 7 + 2 * count, repeat, reply), 6, err);
}

static int line_write_coil(void *ctx, uint16_t coil, bool on, bool repeat, struct errctx *err) {
    uint8_t frame[6] = {UNIT, 5}, reply[MBFRAME_MAX];
    mbframe_put16(frame + 2, coil);
    mbframe_put16(frame + 4, on ? 0xff00 : 0);
    return finish(ask(ctx, frame, sizeof frame, repeat, reply), 6, err);
}

static int line_write_read(void *ctx, uint16_t write_start, unsigned write_count,
                           const uint16_t *words, uint16_t read_start, unsigned read_count,
                           uint16_t *out_words, struct errctx *err) {
    uint8_t frame[MBFRAME_MAX] = {UNIT, 23}, reply[MBFRAME_MAX];
    mbframe_put16(frame + 2, read_start);
    mbframe_put16(frame + 4, (uint16_t)read_count);
    mbframe_put16(frame + 6, write_start);
    mbframe_put16(frame + 8, (uint16_t)write_count);
    frame[10] = (uint8_t)(2 * write_count);
    for (unsigned i = 0; i < write_count; i++)
        mbframe_put16(frame + 11 + 2 * i, words[i]);
    int result =
        finish(ask(ctx, frame, 11 + 2 * write_count, true, reply), 3 + 2 * read_count, err);
    if (!result)
        take_words(reply + 3, read_count, out_words);
    return result;
}

static void line_close(void *ctx) {
    (void)ctx; /* the caller's */
}

static void own_line_close(void *ctx) {
    free(ctx); /* the simulation is the caller's */
}

struct motor_line motor_sim_line(struct motor_sim_line *line) {
    return (struct motor_line){.ctx = line,
                               .read = line_read,
                               .read_discrete = line_read_discrete,
                               .write = line_write,
                               .write_coil = line_write_coil,
                               .write_read = line_write_read,
                               .close = line_close};
}

enum st motor_sim_open(struct sim *sim, struct motor **out_motor, struct errctx *err) {
    struct motor_sim_line *own = malloc(sizeof *own);
    if (!own)
        return errctx_set(err, ST_NOMEM, "simulated controller: out of memory");
    *own = (struct motor_sim_line){sim, TIMEOUT_US};
    struct motor_line line = motor_sim_line(own);
    line.close = own_line_close;
    return motor_map_open(&line, BLOCK_MS, out_motor, err);
}
