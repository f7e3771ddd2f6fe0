/* Both axes from one timer: the alarm is always set to the earlier pending step. */
#ifndef SC_CORE_STEPSCHED_H
#define SC_CORE_STEPSCHED_H

#include "firmware/core/axis.h"

struct firmware;

/* Sets or clears the alarm after axis_move, axis_stop, axis_abort, axis_home. Under the interrupt
 * lock. */
void stepsched_arm(struct firmware *fw);

/* The AXIS_AT_* bits of an axis among the bits of enum hal_input. */
uint8_t stepsched_switches(uint32_t pins, enum hal_axis axis);

/* Step interrupt: makes the due steps of both axes, tells core/strobe and core/scanprog, arms
 * again. Budget 15 us. */
void stepsched_alarm(struct firmware *fw);

#endif
