/* Step and direction outputs of the two stepper drivers, and the drive of the mirror motor. Drive
 * power is not here: hal_safety.h. */
#ifndef SC_HAL_AXIS_H
#define SC_HAL_AXIS_H

#include <stdbool.h>
#include <stdint.h>

enum hal_axis { HAL_PAN, HAL_TILT, HAL_AXES };

/* Gives one step pulse, long enough for the driver (by a one-shot or a short wait, 2 us at most).
 * Interrupts only. */
void hal_axis_step(enum hal_axis axis);

/* Sets the direction signal; the core leaves at least 20 us before the next step. Interrupts, or
 * the main loop under hal_irq_save. Budget 1 us. */
void hal_axis_direction(enum hal_axis axis, bool positive);

/* Mirror motor drive, 0 to 10000 (0.01 %). Any context. Budget 1 us. */
void hal_axis_mirror_drive(uint16_t drive);

#endif
