/* Registers of Arm's MPS2 FPGA board with the AN386 image (Cortex-M4F at 25 MHz), as far as this
 * port uses them. */
#ifndef SC_PORT_MPS2_H
#define SC_PORT_MPS2_H

#include "firmware/port/cortexm/cortexm.h"

#define MPS2_CLOCK_HZ  25000000u
#define MPS2_CLOCKS_US (MPS2_CLOCK_HZ / 1000000u)

/* CMSDK APB timers: count down, interrupt at 0. */
#define MPS2_TIMER0_CTRL   CORTEXM_REG(0x40000000u)
#define MPS2_TIMER0_VALUE  CORTEXM_REG(0x40000004u)
#define MPS2_TIMER0_RELOAD CORTEXM_REG(0x40000008u)
#define MPS2_TIMER0_CLEAR  CORTEXM_REG(0x4000000cu)
#define MPS2_TIMER1_CTRL   CORTEXM_REG(0x40001000u)
#define MPS2_TIMER1_VALUE  CORTEXM_REG(0x40001004u)
#define MPS2_TIMER1_RELOAD CORTEXM_REG(0x40001008u)
#define MPS2_TIMER1_CLEAR  CORTEXM_REG(0x4000100cu)
enum { MPS2_TIMER_ENABLE = 1 << 0, MPS2_TIMER_INTERRUPT = 1 << 3 };

/* CMSDK APB UARTs: one byte each way. UART0 is the Modbus line, UART1 the console of the plant. */
#define MPS2_UART0              0x40004000u
#define MPS2_UART1              0x40005000u
#define MPS2_UART_DATA(base)    CORTEXM_REG((base) + 0x00u)
#define MPS2_UART_STATE(base)   CORTEXM_REG((base) + 0x04u)
#define MPS2_UART_CTRL(base)    CORTEXM_REG((base) + 0x08u)
#define MPS2_UART_CLEAR(base)   CORTEXM_REG((base) + 0x0cu)
#define MPS2_UART_BAUDDIV(base) CORTEXM_REG((base) + 0x10u)
enum {
    MPS2_UART_TX_FULL = 1 << 0,
    MPS2_UART_RX_FULL = 1 << 1,
    MPS2_UART_RX_OVERRUN = 1 << 3,
    MPS2_UART_CTRL_TX = 1 << 0,
    MPS2_UART_CTRL_RX = 1 << 1,
    MPS2_UART_CTRL_TX_INTERRUPT = 1 << 2,
    MPS2_UART_CTRL_RX_INTERRUPT = 1 << 3,
    MPS2_UART_CLEAR_TX = 1 << 0,
    MPS2_UART_CLEAR_RX = 1 << 1
};

/* CMSDK APB watchdog: interrupt (non-maskable) at the first end of count, reset at the second. */
#define MPS2_WDOG_LOAD  CORTEXM_REG(0x40008000u)
#define MPS2_WDOG_CTRL  CORTEXM_REG(0x40008008u)
#define MPS2_WDOG_CLEAR CORTEXM_REG(0x4000800cu)
#define MPS2_WDOG_LOCK  CORTEXM_REG(0x40008c00u)
enum { MPS2_WDOG_INTERRUPT = 1 << 0, MPS2_WDOG_RESET = 1 << 1 };
#define MPS2_WDOG_KEY 0x1acce551u

/* FPGA system counter: advances once every PRESCALE + 1 clocks of 25 MHz, 32 bits. */
#define MPS2_FPGAIO_COUNTER  CORTEXM_REG(0x40028018u)
#define MPS2_FPGAIO_PRESCALE CORTEXM_REG(0x4002801cu)

/* 16 MB of PSRAM. Its first KiB stands in for the flash record; a word behind it, which the
 * emulator may fill at start, is the end-of-frame gap in us if it lies in 500 to 1 000 000. */
#define MPS2_PSRAM      0x21000000u
#define MPS2_GAP_OPTION CORTEXM_REG(MPS2_PSRAM + 0x400u)

enum mps2_irq {
    MPS2_IRQ_UART0_RX = 0,
    MPS2_IRQ_UART0_TX = 1,
    MPS2_IRQ_UART1_RX = 2,
    MPS2_IRQ_TIMER0 = 8,
    MPS2_IRQ_TIMER1 = 9,
    MPS2_IRQ_COUNT = 32
};

#endif
