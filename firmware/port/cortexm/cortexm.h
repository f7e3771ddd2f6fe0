/* What the ports for Cortex-M4 chips share: core registers, start-up, stack watch, interrupt lock.
 * Register addresses and bits are those of the ARMv7-M architecture. */
#ifndef SC_PORT_CORTEXM_H
#define SC_PORT_CORTEXM_H

#include <stdint.h>

/* A 32-bit register at an address that the chip fixes. */
#define CORTEXM_REG(address) (*(volatile uint32_t *)(uintptr_t)(address))

#define CORTEXM_SYST_CSR CORTEXM_REG(0xe000e010u) /* SysTick control */
#define CORTEXM_SYST_RVR CORTEXM_REG(0xe000e014u) /* SysTick reload */
#define CORTEXM_SYST_CVR CORTEXM_REG(0xe000e018u) /* SysTick current */
#define CORTEXM_NVIC_ISER                                                                          \
    CORTEXM_REG(0xe000e100u)                   /* first of the interrupt set-enable registers      \
                                                */
#define CORTEXM_VTOR  CORTEXM_REG(0xe000ed08u) /* vector table */
#define CORTEXM_AIRCR CORTEXM_REG(0xe000ed0cu) /* reset request */
#define CORTEXM_SHCSR CORTEXM_REG(0xe000ed24u) /* fault enables */

enum cortexm_bits {
    CORTEXM_SYST_ENABLE = 1 << 0,
    CORTEXM_SYST_INTERRUPT = 1 << 1,
    CORTEXM_SYST_CPU_CLOCK = 1 << 2,
    CORTEXM_EXCEPTIONS = 16 /* vectors before the first chip interrupt */
};

/* One vector: the first is the stack's start, the others point to handlers; 0 where no interrupt is
 * enabled. The fault vectors of every table. */
union cortexm_vector {
    uint32_t *stack;
    void (*handler)(void);
};
#define CORTEXM_FAULT_VECTORS                                                                      \
    [3] = {.handler = cortexm_fault}, [4] = {.handler = cortexm_fault},                            \
    [5] = {.handler = cortexm_fault}, [6] = {.handler = cortexm_fault},                            \
    [11] = {.handler = cortexm_fault}, [12] = {.handler = cortexm_fault},                          \
    [14] = {.handler = cortexm_fault}

/* Reset vector of every image: guards and paints the stack, fills .data, clears .bss, then runs
 * port_main, which does not return. */
void cortexm_reset(void);

/* Each port's main program. */
void port_main(void) __attribute__((noreturn));

/* Vector for faults and for interrupts nobody asked for: makes outputs safe (port_make_safe), then
 * waits for the hardware watchdog. */
void cortexm_fault(void);

/* Laser and motors off, directly at the pins: the last resort of cortexm_fault, called with an
 * unknown state of everything else. */
void port_make_safe(void);

/* Starts SysTick interrupts every `clocks` processor clocks (2 to 2^24). */
void cortexm_systick_start(uint32_t clocks);

/* Enables a chip interrupt in the interrupt controller. All keep priority 0: none preempts another.
 */
void cortexm_irq_enable(unsigned number);

/* Least free stack so far, looked up in slices: one call examines 16 words of the paint, a whole
 * pass takes stack size / 64 calls. 0 if the guard word at the stack's end is damaged. Budget 1 us
 * at 168 MHz. Interrupts. */
uint16_t cortexm_stack_free(void);

static inline void cortexm_irq_on(void) {
    __asm__ volatile("cpsie i" ::: "memory");
}
static inline void cortexm_irq_off(void) {
    __asm__ volatile("cpsid i" ::: "memory");
}
/* Sleeps until the next interrupt. */
static inline void cortexm_wait(void) {
    __asm__ volatile("wfi" ::: "memory");
}
static inline void cortexm_barrier(void) {
    __asm__ volatile("dsb" ::: "memory");
}

#endif
