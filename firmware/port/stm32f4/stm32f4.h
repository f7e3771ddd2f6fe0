/* Between the files of this port: clock rates, pins, starts and interrupt handlers. */
#ifndef SC_PORT_STM32F4_H
#define SC_PORT_STM32F4_H

#include "boards/cart_f405/board.h"
#include "firmware/port/stm32f4/stm32f405.h"

#include <stdbool.h>
#include <stdint.h>

/* Clock rates in use, Hz. */
struct stm32f4_clocks {
    uint32_t cpu_hz, apb2_hz, apb1_timer_hz, apb2_timer_hz;
    bool from_crystal; /* false: the crystal or PLL did not start; running on the internal 16 MHz */
};

/* Starts crystal and PLL; every wait is bounded. At worst 5 ms. */
void clock_stm32f4_init(void);
const struct stm32f4_clocks *clock_stm32f4(void);
/* The clock security system has reported the crystal's failure: from now on the clock is not good.
 */
void clock_stm32f4_failed(void);

/* The port (GPIOx) and number of a signal of boards/cart_f405/board.h: PIN_PORT_x, PIN_x. */
enum stm32f4_pin {
#define X(signal, port, pin, mode, function, pull) PIN_##signal = (pin),
    BOARD_PINS(X)
#undef X
};
enum stm32f4_pin_port {
    STM32F4_PORT_A,
    STM32F4_PORT_B,
    STM32F4_PORT_C,
#define X(signal, port, pin, mode, function, pull) PIN_PORT_##signal = STM32F4_PORT_##port,
    BOARD_PINS(X)
#undef X
};

static inline struct stm32_gpio *stm32f4_port(enum stm32f4_pin_port port) {
    return (struct stm32_gpio *)(uintptr_t)(0x40020000u + 0x400u * (unsigned)port);
}
#define STM32F4_SET(signal)   (stm32f4_port(PIN_PORT_##signal)->BSRR = 1u << PIN_##signal)
#define STM32F4_CLEAR(signal) (stm32f4_port(PIN_PORT_##signal)->BSRR = 0x10000u << PIN_##signal)
#define STM32F4_READ(signal)  ((stm32f4_port(PIN_PORT_##signal)->IDR >> PIN_##signal) & 1u)

/* All pins of the board's table; outputs low first. */
void safety_stm32f4_pins(void);
/* Temperature converter and independent watchdog; the cause of this reset (enum resetcause). */
void safety_stm32f4_init(void);
uint16_t safety_stm32f4_reset_cause(void);
/* A safety chain has opened. */
void safety_stm32f4_isr_exti(void);
/* Every tick: takes a conversion if one is ready. */
void safety_stm32f4_tick(void);

void timers_stm32f4_init(void);
void timers_stm32f4_isr_tim5(void); /* captures and step alarm */
/* Mirror's power stage: the timer's outputs follow only after this, until the next break. */
void timers_stm32f4_mirror_output(bool on);

/* `gap_us`: silence that ends a frame; above 60 ms only the core looks for it. */
void uart_stm32f4_init(uint32_t gap_us);
void uart_stm32f4_isr(void);
void uart_stm32f4_isr_tim7(void); /* rest of the end-of-frame gap */

#endif
