/* The serial line to the host. Received bytes go to firmware_isr_rx; this is the way back. */
#ifndef SC_HAL_UART_H
#define SC_HAL_UART_H

#include <stdbool.h>
#include <stdint.h>

/* Starts to send `count` bytes (1 to 256) and returns: by DMA or by interrupt, driver enable of
 * RS-485 included (on before the first bit, off within one character after the last stop bit).
 * `bytes` stays as it is until hal_uart_sending() is false. Main loop only, never while sending.
 * Budget 5 us. */
void hal_uart_send(const uint8_t *bytes, unsigned count);

/* True until the last stop bit has left. Main loop. Budget 1 us. */
bool hal_uart_sending(void);

#endif
