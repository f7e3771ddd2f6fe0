/* Interrupt lock, SysTick, interrupt enables. */
#include "firmware/port/cortexm/cortexm.h"

#include "firmware/hal/hal_time.h"

uint32_t hal_irq_save(void) {
    uint32_t primask;
    __asm__ volatile("mrs %0, primask\n\tcpsid i" : "=r"(primask)::"memory");
    return primask;
}

void hal_irq_restore(uint32_t saved) {
    __asm__ volatile("msr primask, %0" ::"r"(saved) : "memory");
}

void cortexm_systick_start(uint32_t clocks) {
    CORTEXM_SYST_CSR = 0;
    CORTEXM_SYST_RVR = clocks - 1;
    CORTEXM_SYST_CVR = 0;
    CORTEXM_SYST_CSR = CORTEXM_SYST_ENABLE | CORTEXM_SYST_INTERRUPT | CORTEXM_SYST_CPU_CLOCK;
}

void cortexm_irq_enable(unsigned number) {
    volatile uint32_t *iser = &CORTEXM_NVIC_ISER;
    iser[number / 32] = UINT32_C(1) << (number % 32);
}
