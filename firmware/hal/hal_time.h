/* Time base, the one step timer and the interrupt lock.
 *
 * The seam of the firmware: these functions are declared once, here, and each port defines them.
 * They are bound at link time, there is one port in an image. All core interrupts (firmware.h) run
 * at one priority: none preempts another; each preempts the main loop. */
#ifndef SC_HAL_TIME_H
#define SC_HAL_TIME_H

#include <stdint.h>

/* Ticks a second of hal_time_now, of the step alarm and of all captures. */
#define HAL_TIME_HZ 1000000u

/* Period of firmware_isr_tick. */
#define HAL_TICK_US 500u

/* Free-running microseconds, wraps at 2^32 (71 min). Any context. Budget 1 us. Captured times
 * (index, strobe, encoder edge, received byte) are on the same scale. */
uint32_t hal_time_now(void);

/* Arms the step timer: firmware_isr_alarm shall be called once at time `at_us`, or at once if that
 * has passed by less than 2^31. Replaces an alarm set before. From interrupts, or from the main
 * loop under hal_irq_save. Budget 1 us. */
void hal_time_alarm(uint32_t at_us);

/* Disarms the step timer: no call of firmware_isr_alarm until armed again. Context as
 * hal_time_alarm. */
void hal_time_alarm_off(void);

/* Masks all core interrupts; returns what hal_irq_restore needs. Nests. The core holds it for at
 * most 5 us. */
uint32_t hal_irq_save(void);
void hal_irq_restore(uint32_t saved);

#endif
