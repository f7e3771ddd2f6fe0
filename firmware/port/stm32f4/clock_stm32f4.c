/* Clock tree: crystal, PLL, clock security system. */
#include "firmware/port/stm32f4/stm32f4.h"

#include "firmware/hal/hal_safety.h"

enum { READY_TRIES = 20000 }; /* at least 5 ms at 16 MHz, ten times what the crystal takes */

static struct stm32f4_clocks rates;
static volatile bool failed;

const struct stm32f4_clocks *clock_stm32f4(void) {
    return &rates;
}

void clock_stm32f4_failed(void) {
    failed = true;
}

bool hal_safety_clock_ok(void) {
    return rates.from_crystal && !failed;
}

static bool wait_for(volatile uint32_t *reg, uint32_t mask, uint32_t value) {
    for (unsigned i = 0; i < READY_TRIES; i++)
        if ((*reg & mask) == value)
            return true;
    return false;
}

static bool start_pll(void) {
    RCC->CR |= RCC_CR_HSEON;
    if (!wait_for(&RCC->CR, RCC_CR_HSERDY, RCC_CR_HSERDY))
        return false;
    RCC->PLLCFGR = BOARD_PLL_M | BOARD_PLL_N << 6 | (BOARD_PLL_P / 2 - 1) << 16 | RCC_PLLCFGR_HSE |
                   BOARD_PLL_Q << 24;
    RCC->CR |= RCC_CR_PLLON;
    if (!wait_for(&RCC->CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY))
        return false;
    FLASH->ACR = FLASH_ACR_5WS | FLASH_ACR_CACHES; /* 168 MHz at 2.7 to 3.6 V */
    RCC->CFGR = RCC_CFGR_APB1_BY4 | RCC_CFGR_APB2_BY2;
    RCC->CFGR |= RCC_CFGR_SW_PLL;
    if (!wait_for(&RCC->CFGR, RCC_CFGR_SWS, RCC_CFGR_SWS_PLL))
        return false;
    RCC->CR |= RCC_CR_CSSON; /* crystal fails later: non-maskable interrupt */
    return true;
}

void clock_stm32f4_init(void) {
    if (start_pll()) {
        uint32_t cpu = BOARD_HSE_HZ / BOARD_PLL_M * BOARD_PLL_N / BOARD_PLL_P;
        rates = (struct stm32f4_clocks){.cpu_hz = cpu,
                                        .apb2_hz = cpu / 2,
                                        .apb1_timer_hz = cpu / 2,
                                        .apb2_timer_hz = cpu,
                                        .from_crystal = true};
    } else {
        /* Good enough to say over the serial line what is wrong; the clock fault keeps all off. */
        const uint32_t hsi = 16000000u;
        RCC->CFGR = 0;
        rates = (struct stm32f4_clocks){
            .cpu_hz = hsi, .apb2_hz = hsi, .apb1_timer_hz = hsi, .apb2_timer_hz = hsi};
    }
}
