#include "firmware/core/mblink.h"
#include "firmware/hal/hal_time.h"
#include "firmware/hal/hal_uart.h"

void mblink_init(struct mblink *link, uint32_t gap_us) {
    ring16_init(&link->ring, link->words, MBLINK_RING);
    link->gap_us = gap_us;
    link->last_us = 0;
    link->open = false;
}

/* A full ring loses the word and counts it; the frame then fails its CRC. */
static void take(struct mblink *link, uint16_t word, uint32_t t_us) {
    if (link->open && t_us - link->last_us >= link->gap_us)
        (void)ring16_put(&link->ring, MBLINK_END);
    (void)ring16_put(&link->ring, word);
    link->last_us = t_us;
    link->open = true;
}

void mblink_rx(struct mblink *link, uint8_t byte, uint32_t t_us) {
    take(link, byte, t_us);
}

void mblink_rx_error(struct mblink *link, uint32_t t_us) {
    take(link, MBLINK_BAD, t_us);
}

void mblink_rx_idle(struct mblink *link) {
    if (link->open)
        (void)ring16_put(&link->ring, MBLINK_END);
    link->open = false;
}

/* All bytes have been handed on and the line has been silent for the gap. */
static bool line_idle(struct mblink *link) {
    uint32_t saved = hal_irq_save();
    bool idle =
        link->open && !ring16_count(&link->ring) && hal_time_now() - link->last_us >= link->gap_us;
    if (idle)
        link->open = false;
    hal_irq_restore(saved);
    return idle;
}

/* Judges the frame and sends the reply if there is one. */
static bool end_frame(struct mbslave *slave) {
    unsigned count = mbslave_idle(slave);
    if (count)
        hal_uart_send(slave->tx, count);
    return true;
}

bool mblink_poll(struct mblink *link, struct mbslave *slave) {
    if (hal_uart_sending())
        return false;
    uint16_t word;
    while (ring16_get(&link->ring, &word)) {
        if (word == MBLINK_END)
            return end_frame(slave);
        if (word == MBLINK_BAD)
            mbslave_spoil(slave);
        else
            mbslave_byte(slave, (uint8_t)word);
    }
    return line_idle(link) ? end_frame(slave) : false;
}
