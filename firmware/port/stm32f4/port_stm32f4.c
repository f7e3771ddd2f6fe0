/* Main program and vector table of the STM32F405. All interrupts keep priority 0: none preempts
 * another; only the non-maskable one (crystal failed) does. */
#include "firmware/core/firmware.h"
#include "firmware/hal/hal_board.h"
#include "firmware/hal/hal_time.h"
#include "firmware/port/stm32f4/stm32f4.h"

static struct firmware instance;
static struct hal_board board = {.name = BOARD_NAME,
                                 .board_id = BOARD_ID,
                                 .build_id = BOARD_BUILD_ID,
                                 .baud = BOARD_BAUD,
                                 .frame_gap_us = BOARD_FRAME_GAP_US,
                                 .caps = HAL_CAP_ENCODER | HAL_CAP_LASER_CURRENT,
                                 .stack_min = BOARD_STACK_MIN};

const struct hal_board *hal_board(void) {
    return &board;
}

struct firmware *hal_firmware(void) {
    return &instance;
}

/* Safety tick. Budget: that of firmware_isr_tick and 1 us. */
static void isr_systick(void) {
    safety_stm32f4_tick();
    firmware_isr_tick();
}

/* The crystal has failed; the chip runs on its internal oscillator now. */
static void isr_nmi(void) {
    if (RCC->CIR & RCC_CIR_CSSF) {
        RCC->CIR |= RCC_CIR_CSSC;
        clock_stm32f4_failed();
        firmware_isr_clock_failure();
    }
}

enum { FRAME_GAP_MIN_US = 500, FRAME_GAP_MAX_US = 1000000 };

/* What production wrote into this board. */
static void read_board_data(void) {
    uint32_t serial = CORTEXM_REG(BOARD_DATA_ADDRESS), gap_us = CORTEXM_REG(BOARD_DATA_ADDRESS + 4);
    board.serial = serial == 0xffffffffu ? 0 : serial;
    if (gap_us >= FRAME_GAP_MIN_US && gap_us <= FRAME_GAP_MAX_US)
        board.frame_gap_us = gap_us;
}

void port_main(void) {
    safety_stm32f4_pins(); /* before anything that takes time: laser and motors off */
    board.reset_cause = safety_stm32f4_reset_cause();
    read_board_data();
    clock_stm32f4_init();
    timers_stm32f4_init();
    uart_stm32f4_init(board.frame_gap_us);
    safety_stm32f4_init();
    firmware_init();

    cortexm_irq_enable(STM32_IRQ_EXTI0);
    cortexm_irq_enable(STM32_IRQ_EXTI1);
    cortexm_irq_enable(STM32_IRQ_EXTI10_15);
    cortexm_irq_enable(STM32_IRQ_USART1);
    cortexm_irq_enable(STM32_IRQ_TIM5);
    cortexm_irq_enable(STM32_IRQ_TIM7);
    cortexm_systick_start(clock_stm32f4()->cpu_hz / 1000000u * HAL_TICK_US);
    cortexm_irq_on();
    for (;;)
        firmware_poll();
}

/* Vector table. */
extern uint32_t ld_stack_end[];
extern const union cortexm_vector vectors[CORTEXM_EXCEPTIONS + STM32_IRQ_COUNT];
__attribute__((section(".vectors"), used))
const union cortexm_vector vectors[CORTEXM_EXCEPTIONS + STM32_IRQ_COUNT] = {
    [0] = {.stack = ld_stack_end},
    [1] = {.handler = cortexm_reset},
    [2] = {.handler = isr_nmi},
    CORTEXM_FAULT_VECTORS,
    [15] = {.handler = isr_systick},
    [CORTEXM_EXCEPTIONS + STM32_IRQ_EXTI0] = {.handler = safety_stm32f4_isr_exti},
    [CORTEXM_EXCEPTIONS + STM32_IRQ_EXTI1] = {.handler = safety_stm32f4_isr_exti},
    [CORTEXM_EXCEPTIONS + STM32_IRQ_EXTI10_15] = {.handler = safety_stm32f4_isr_exti},
    [CORTEXM_EXCEPTIONS + STM32_IRQ_USART1] = {.handler = uart_stm32f4_isr},
    [CORTEXM_EXCEPTIONS + STM32_IRQ_TIM5] = {.handler = timers_stm32f4_isr_tim5},
    [CORTEXM_EXCEPTIONS + STM32_IRQ_TIM7] = {.handler = uart_stm32f4_isr_tim7},
};
