/* Modbus RTU slave: bytes and an idle event in, replies out. No machine in it: no time, no UART, no
 * waiting, no heap; it calls its model for every access.
 *
 * Functions 1 2 3 4 5 6 15 16 22 23 and 43/14. Frames with a bad CRC, a wrong length, for another
 * unit or for nobody (address 248 to 255) get silence. Address 0 is broadcast: 5, 6, 15, 16 and 22
 * are carried out, nothing is answered, all else is ignored. Order of checks, as the
 * specification's state diagrams have it: function (01), quantity and byte count (03), addresses
 * (02), values (03), execution (04, 06). */
#ifndef SC_CORE_MBSLAVE_H
#define SC_CORE_MBSLAVE_H

#include "firmware/shared/mbframe.h"

/* The data behind the slave. All called from mbslave_idle. Each read or write is checked whole
 * before anything is done; a function that does not return MBEXC_OK has changed nothing. All
 * required. */
struct mbslave_model {
    /* `count` 1 to 2000 bits from `start` into out_bits, one byte each, 0 or 1. MBEXC_ADDRESS if
     * one does not exist. */
    enum mbexc (*read_coils)(void *ctx, uint16_t start, unsigned count, uint8_t *out_bits);
    enum mbexc (*read_discrete)(void *ctx, uint16_t start, unsigned count, uint8_t *out_bits);
    /* `count` 1 to 125 words. `holding` tells function 3 and 23 from 4. */
    enum mbexc (*read_words)(void *ctx, bool holding, uint16_t start, unsigned count,
                             uint16_t *out_words);
    /* `count` 1 to 1968 bits, one byte each. */
    enum mbexc (*write_coils)(void *ctx, uint16_t start, unsigned count, const uint8_t *bits);
    /* `count` 1 to 123 words. */
    enum mbexc (*write_words)(void *ctx, uint16_t start, unsigned count, const uint16_t *words);
    /* A request for this unit was accepted by its CRC, before it is carried out. Not for
     * broadcasts. */
    void (*heard)(void *ctx);
    /* Text of device identification object `id`, NULL if there is none. At most 240 characters. */
    const char *(*identity)(void *ctx, uint8_t id);
};

#define MBSLAVE_BITS_MAX 2000

struct mbslave {
    const struct mbslave_model *model;
    void *ctx;
    uint8_t unit; /* 1 to 247 */
    uint8_t rx[MBFRAME_MAX];
    uint16_t rx_count;
    bool rx_spoilt;
    uint8_t tx[MBFRAME_MAX];
    union {
        uint8_t bits[MBSLAVE_BITS_MAX];
        struct {
            uint16_t in[128], out[128];
        } words;
    } scratch;
    uint32_t frames_ok, frames_bad, exceptions;
};

void mbslave_init(struct mbslave *slave, uint8_t unit, const struct mbslave_model *model,
                  void *ctx);

/* One received byte. More than 256 without an idle event: the whole frame is dropped. Constant
 * time. */
void mbslave_byte(struct mbslave *slave, uint8_t byte);

/* A byte was damaged on the line: the frame it belongs to will be dropped. */
void mbslave_spoil(struct mbslave *slave);

/* The line has been silent for the end-of-frame gap: judges and carries out what has come. Returns
 * the length of the reply in slave->tx (0: stay silent), which is valid until the next
 * mbslave_idle. */
unsigned mbslave_idle(struct mbslave *slave);

#endif
