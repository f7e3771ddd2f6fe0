/* The host's end of the simulated serial line. */
#include "firmware/port/sim/simstate.h"
#include "firmware/shared/mbframe.h"
#include <math.h>
#include <string.h>

size_t sim_send(struct sim *sim, const uint8_t *bytes, size_t count) {
    double byte_us = sim->config.lossless_line ? 0 : 11e6 / sim->config.baud;
    uint64_t begin_us = sim->rx_free_us > sim->now_us ? sim->rx_free_us : sim->now_us;
    size_t i = 0;
    for (; i < count && sim->rx_head - sim->rx_tail < SIMSTATE_RX; i++) {
        uint64_t t_us = begin_us + (uint64_t)ceil((double)(i + 1) * byte_us);
        sim->rx[sim->rx_head++ % SIMSTATE_RX] = (struct simline_byte){t_us, bytes[i]};
        sim->rx_free_us = t_us;
    }
    return i;
}

void sim_send_gap(struct sim *sim, uint32_t us) {
    sim->rx_free_us = (sim->rx_free_us > sim->now_us ? sim->rx_free_us : sim->now_us) + us;
}

size_t sim_collect(struct sim *sim, uint8_t *out_bytes, size_t capacity) {
    size_t count = 0;
    while (count < capacity && sim->tx_tail != sim->tx_head &&
           sim->tx[sim->tx_tail % SIMSTATE_TX].t_us <= sim->now_us)
        out_bytes[count++] = sim->tx[sim->tx_tail++ % SIMSTATE_TX].byte;
    return count;
}

/* What is left in the line from before does not belong to the next reply. */
static void flush(struct sim *sim) {
    uint8_t old[256];
    while (sim_collect(sim, old, sizeof old)) {
    }
}

size_t sim_transact(struct sim *sim, const uint8_t *request, size_t count, uint8_t *out_reply,
                    uint64_t timeout_us) {
    uint8_t frame[MBFRAME_MAX];
    if (count < 1 || count > MBFRAME_MAX - 2)
        return 0;
    flush(sim);
    memcpy(frame, request, count);
    (void)sim_send(sim, frame, mbframe_seal(frame, (unsigned)count));
    uint64_t end_us = sim->rx_free_us + timeout_us;
    size_t have = 0;
    while (sim->now_us < end_us) {
        sim_advance(sim, sim->config.poll_us);
        have += sim_collect(sim, out_reply + have, MBFRAME_MAX - have);
        bool complete = sim->tx_tail == sim->tx_head && have;
        if (complete && mbframe_ok(out_reply, (unsigned)have))
            return have - 2;
    }
    return 0;
}

/* 0, the exception, or -1; `count` is the reply's expected length without CRC. */
static int verdict(const uint8_t *reply, size_t have, uint8_t function, size_t count) {
    if (!have)
        return -1;
    if (have == 3 && reply[1] == (function | 0x80u))
        return reply[2];
    return reply[1] == function && have == count ? 0 : -1;
}

/* Silence long enough for any reply at any baud rate in use. */
#define REPLY_US 200000u

int sim_read(struct sim *sim, uint16_t start, unsigned count, uint16_t *out_words) {
    uint8_t request[6] = {1, 3}, reply[MBFRAME_MAX];
    mbframe_put16(request + 2, start);
    mbframe_put16(request + 4, (uint16_t)count);
    size_t have = sim_transact(sim, request, sizeof request, reply, REPLY_US);
    int result = verdict(reply, have, 3, 3 + 2 * (size_t)count);
    for (unsigned i = 0; !result && i < count; i++)
        out_words[i] = mbframe_get16(reply + 3 + 2 * i);
    return result;
}

int sim_write(struct sim *sim, uint16_t start, unsigned count, const uint16_t *words) {
    uint8_t request[MBFRAME_MAX] = {1, 16}, reply[MBFRAME_MAX];
    if (count > 123)
        return -1;
    mbframe_put16(request + 2, start);
    mbframe_put16(request + 4, (uint16_t)count);
    request[6] = (uint8_t)(2 * count);
    for (unsigned i = 0; i < count; i++)
        mbframe_put16(request + 7 + 2 * i, words[i]);
    size_t have = sim_transact(sim, request, 7 + 2 * (size_t)count, reply, REPLY_US);
    return verdict(reply, have, 16, 6);
}

static int write_short(struct sim *sim, uint8_t function, uint16_t address, uint16_t value) {
    uint8_t request[6] = {1, function}, reply[MBFRAME_MAX];
    mbframe_put16(request + 2, address);
    mbframe_put16(request + 4, value);
    size_t have = sim_transact(sim, request, sizeof request, reply, REPLY_US);
    return verdict(reply, have, function, 6);
}

int sim_write1(struct sim *sim, uint16_t address, uint16_t word) {
    return write_short(sim, 6, address, word);
}

int sim_write32(struct sim *sim, uint16_t address, uint32_t value) {
    uint16_t words[2] = {(uint16_t)(value >> 16), (uint16_t)(value & 0xffffu)};
    return sim_write(sim, address, 2, words);
}

int sim_coil(struct sim *sim, uint16_t coil, bool on) {
    return write_short(sim, 5, coil, on ? 0xff00 : 0);
}
