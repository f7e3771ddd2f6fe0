#include "firmware/port/mps2/uart_mps2.h"

#include "boards/qemu_mps2/board.h"
#include "firmware/core/firmware.h"
#include "firmware/hal/hal_time.h"
#include "firmware/hal/hal_uart.h"
#include "firmware/port/mps2/mps2.h"

static const uint8_t *send_next;
static volatile unsigned send_left; /* bytes not yet given to the UART */
static volatile bool send_busy;     /* the last byte's interrupt has not come yet */

void uart_mps2_init(void) {
    MPS2_UART_BAUDDIV(MPS2_UART0) = MPS2_CLOCK_HZ / BOARD_BAUD;
    MPS2_UART_CTRL(MPS2_UART0) = MPS2_UART_CTRL_TX | MPS2_UART_CTRL_RX |
                                 MPS2_UART_CTRL_TX_INTERRUPT | MPS2_UART_CTRL_RX_INTERRUPT;
}

/* A byte has come. Budget: that of firmware_isr_rx and 1 us. */
void uart_mps2_isr_rx(void) {
    MPS2_UART_CLEAR(MPS2_UART0) = MPS2_UART_CLEAR_RX;
    while (MPS2_UART_STATE(MPS2_UART0) & MPS2_UART_RX_FULL) {
        uint8_t byte = (uint8_t)MPS2_UART_DATA(MPS2_UART0);
        firmware_isr_rx(byte, hal_time_now());
    }
    if (MPS2_UART_STATE(MPS2_UART0) & MPS2_UART_RX_OVERRUN) {
        MPS2_UART_STATE(MPS2_UART0) = MPS2_UART_RX_OVERRUN; /* written 1 clears */
        firmware_isr_rx_error(hal_time_now());
    }
}

static void send_more(void) {
    while (send_left && !(MPS2_UART_STATE(MPS2_UART0) & MPS2_UART_TX_FULL)) {
        send_left--;
        MPS2_UART_DATA(MPS2_UART0) = *send_next++;
    }
}

/* The UART has taken a byte. Budget 1 us. */
void uart_mps2_isr_tx(void) {
    MPS2_UART_CLEAR(MPS2_UART0) = MPS2_UART_CLEAR_TX;
    send_more();
    if (!send_left && !(MPS2_UART_STATE(MPS2_UART0) & MPS2_UART_TX_FULL))
        send_busy = false;
}

void hal_uart_send(const uint8_t *bytes, unsigned count) {
    uint32_t lock = hal_irq_save();
    send_next = bytes;
    send_left = count;
    send_busy = true;
    send_more();
    hal_irq_restore(lock);
}

bool hal_uart_sending(void) {
    return send_busy;
}
