/* Outputs and inputs of the safety chain. Only core/estop.c may call the two setters. */
#ifndef SC_HAL_SAFETY_H
#define SC_HAL_SAFETY_H

#include <stdbool.h>
#include <stdint.h>

/* Input bits, 1 = as named. The order is that of the discrete inputs 0 to 9 of the register map.
 * A broken wire must read as 0 for the three chains and as 1 for limit switches. */
enum hal_input {
    HAL_IN_ESTOP_CLOSED = 1 << 0,
    HAL_IN_INTERLOCK_CLOSED = 1 << 1,
    HAL_IN_DOOR_CLOSED = 1 << 2,
    HAL_IN_PAN_LIMIT_MIN = 1 << 3,
    HAL_IN_PAN_LIMIT_MAX = 1 << 4,
    HAL_IN_PAN_HOME = 1 << 5,
    HAL_IN_TILT_LIMIT_MIN = 1 << 6,
    HAL_IN_TILT_LIMIT_MAX = 1 << 7,
    HAL_IN_TILT_HOME = 1 << 8,
    HAL_IN_LASER_CURRENT = 1 << 9
};

/* Laser enable output. Off at reset, before any code runs (pull resistor). Any core context. Budget
 * 1 us. */
void hal_safety_laser(bool on);

/* Enable output of all motor drives (pan, tilt, mirror). Off at reset. Any core context. Budget 1
 * us. */
void hal_safety_motors(bool on);

/* All inputs at one instant, not debounced. Any core context. Budget 1 us. */
uint32_t hal_safety_inputs(void);

/* Last board temperature, 0.1 C; a background conversion, never waits. False if the sensor is open,
 * shorted or has given nothing for 1 s. Interrupts. Budget 2 us. */
bool hal_safety_temperature(int16_t *out_decidegrees);

/* Free stack in bytes: the least so far by the paint below the stack pointer (may be looked up in
 * slices), 0 if the guard word at the stack's end is damaged, 65535 unknown. Interrupts. Budget 2
 * us. */
uint16_t hal_safety_stack_free(void);

/* True while the clock source the port runs on is the one it was started with (clock security
 * system or the like). Interrupts. Budget 1 us. */
bool hal_safety_clock_ok(void);

/* Restarts the independent watchdog (0.5 s or longer than the longest flash erase). Main loop.
 * Budget 1 us. */
void hal_safety_watchdog_kick(void);

#endif
