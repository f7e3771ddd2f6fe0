/* UART0 of the MPS2 board behind hal_uart.h: one interrupt a byte each way. */
#ifndef SC_PORT_UART_MPS2_H
#define SC_PORT_UART_MPS2_H

/* Interrupts of the UART's own; the port's vector table points to the handlers. */
void uart_mps2_init(void);
void uart_mps2_isr_rx(void);
void uart_mps2_isr_tx(void);

#endif
