/* The serial line: from received bytes with their times to mbslave, and its replies to the UART. */
#ifndef SC_CORE_MBLINK_H
#define SC_CORE_MBLINK_H

#include "firmware/core/mbslave.h"
#include "firmware/shared/ring16.h"

#define MBLINK_RING 512u    /* received bytes and frame ends on their way to the main loop */
#define MBLINK_BAD  0x4000u /* mark in the ring: a byte was damaged */
#define MBLINK_END  0x8000u /* mark in the ring: a gap lay before the next byte */

struct mblink {
    struct ring16 ring;
    uint16_t words[MBLINK_RING];
    uint32_t gap_us;
    /* receive interrupt; read by the main loop under the lock */
    uint32_t last_us; /* when the last byte came */
    bool open;        /* bytes have come since the last frame end */
};

void mblink_init(struct mblink *link, uint32_t gap_us);

/* Receive interrupt: a byte whose stop bit ended at t_us. Budget 2 us. */
void mblink_rx(struct mblink *link, uint8_t byte, uint32_t t_us);

/* Receive interrupt: a byte was damaged (framing, parity, overrun). */
void mblink_rx_error(struct mblink *link, uint32_t t_us);

/* Receive interrupt: the hardware itself found the end of a frame. */
void mblink_rx_idle(struct mblink *link);

/* Main loop: hands on what has come, sends a reply if there is one. Bytes that arrive while a reply
 * is being sent wait for its end. Returns true if a frame was judged. */
bool mblink_poll(struct mblink *link, struct mbslave *slave);

#endif
