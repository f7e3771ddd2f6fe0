/* USART1 with RS-485 driver enable. The idle interrupt marks the first silent character; TIM7
 * counts the rest of the end-of-frame gap, so that frames end by hardware and not by when the main
 * loop happens to look. */
#include "firmware/core/firmware.h"
#include "firmware/hal/hal_time.h"
#include "firmware/hal/hal_uart.h"
#include "firmware/port/stm32f4/stm32f4.h"

#define USART_CR1_PCE (1u << 10) /* parity, even */
#define USART_CR1_M   (1u << 12) /* 9 bits, the last is the parity */

enum { CHARACTER_BITS = 11, GAP_TIMER_MAX_US = 60000 };

static const uint8_t *send_next;
static volatile unsigned send_left;
static volatile bool send_busy;

void uart_stm32f4_init(uint32_t gap_us) {
    const struct stm32f4_clocks *clocks = clock_stm32f4();
    RCC->APB2ENR |= RCC_APB2_USART1;
    cortexm_barrier();
    USART1->BRR = (clocks->apb2_hz + BOARD_BAUD / 2) / BOARD_BAUD;
    USART1->CR1 = USART_CR1_UE | USART_CR1_M | USART_CR1_PCE | USART_CR1_TE | USART_CR1_RE |
                  USART_CR1_RXNEIE | USART_CR1_IDLEIE;

    TIM7->CR1 = TIM_CR1_OPM | TIM_CR1_URS;
    TIM7->PSC = clocks->apb1_timer_hz / 1000000u - 1;
    TIM7->ARR = gap_us - CHARACTER_BITS * 1000000u / BOARD_BAUD;
    TIM7->EGR = TIM_EGR_UG;
    TIM7->DIER = gap_us <= GAP_TIMER_MAX_US ? TIM_DIER_UIE : 0;
}

static void gap_timer_stop(void) {
    TIM7->CR1 &= ~TIM_CR1_CEN;
    TIM7->SR = 0;
}

/* Gives the transmitter what it can take; drops driver enable when the last stop bit has left. From
 * the interrupt, and from the main loop under the lock: so a lost interrupt delays a reply and
 * cannot hang it. */
static void send_more(void) {
    uint32_t status = USART1->SR;
    if (send_left) {
        if (status & USART_SR_TXE) {
            USART1->DR = *send_next++;
            if (!--send_left)
                USART1->CR1 = (USART1->CR1 & ~USART_CR1_TXEIE) | USART_CR1_TCIE;
        }
    } else if (send_busy && (status & USART_SR_TC)) {
        USART1->CR1 &= ~USART_CR1_TCIE;
        STM32F4_CLEAR(RS485_DE);
        send_busy = false;
    }
}

/* Byte received, line idle, transmitter ready. Budget: that of firmware_isr_rx and 2 us. */
void uart_stm32f4_isr(void) {
    uint32_t status = USART1->SR;
    if (status & (USART_SR_RXNE | USART_SR_ERRORS)) {
        uint8_t byte = (uint8_t)USART1->DR; /* clears the flags read in status */
        gap_timer_stop();
        if (status & USART_SR_ERRORS)
            firmware_isr_rx_error(hal_time_now());
        else
            firmware_isr_rx(byte, hal_time_now());
    } else if (status & USART_SR_IDLE) {
        (void)USART1->DR;
        TIM7->CNT = 0;
        TIM7->CR1 |= TIM_CR1_CEN;
    }
    send_more();
}

/* The end-of-frame gap is over. Budget: that of firmware_isr_rx_idle. */
void uart_stm32f4_isr_tim7(void) {
    if (!(TIM7->SR & TIM_SR_UIF)) /* a byte came at the last moment */
        return;
    TIM7->SR = 0;
    firmware_isr_rx_idle();
}

void hal_uart_send(const uint8_t *bytes, unsigned count) {
    uint32_t lock = hal_irq_save();
    STM32F4_SET(RS485_DE);
    send_next = bytes;
    send_left = count;
    send_busy = true;
    USART1->CR1 |= USART_CR1_TXEIE;
    send_more();
    hal_irq_restore(lock);
}

bool hal_uart_sending(void) {
    if (send_busy) {
        uint32_t lock = hal_irq_save();
        send_more();
        hal_irq_restore(lock);
    }
    return send_busy;
}
