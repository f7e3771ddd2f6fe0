#include "firmware/core/stepsched.h"
#include "firmware/core/firmware.h"
#include "firmware/core/timebase.h"
#include "firmware/hal/hal_safety.h"
#include "firmware/hal/hal_time.h"
#include <stddef.h>

void stepsched_arm(struct firmware *fw) {
    const struct axis *first = NULL;
    for (unsigned i = 0; i < HAL_AXES; i++) {
        const struct axis *axis = &fw->axis[i];
        if (axis_pending(axis) && (!first || axis->ramp.t_fine < first->ramp.t_fine))
            first = axis;
    }
    if (first)
        hal_time_alarm((uint32_t)ramp_due_us(&first->ramp));
    else
        hal_time_alarm_off();
}

uint8_t stepsched_switches(uint32_t pins, enum hal_axis axis) {
    uint32_t bits = axis == HAL_PAN ? pins : pins >> 3; /* tilt's follow pan's, see hal_safety.h */
    unsigned flags = 0;
    flags |= bits & HAL_IN_PAN_LIMIT_MIN ? AXIS_AT_LIMIT_MIN : 0u;
    flags |= bits & HAL_IN_PAN_LIMIT_MAX ? AXIS_AT_LIMIT_MAX : 0u;
    flags |= bits & HAL_IN_PAN_HOME ? AXIS_AT_HOME : 0u;
    return (uint8_t)flags;
}

/* One step of each axis at most: a burst that is due shows up as the alarm firing again at once,
 * and the other interrupts come in between. */
void stepsched_alarm(struct firmware *fw) {
    uint64_t now_us = timebase_now(fw);
    for (unsigned i = 0; i < HAL_AXES; i++) {
        struct axis *axis = &fw->axis[i];
        if (!axis_pending(axis) || ramp_due_us(&axis->ramp) > now_us)
            continue;
        bool was_positive = axis->positive; /* of this step; the next may turn back */
        uint8_t switches = stepsched_switches(hal_safety_inputs(), (enum hal_axis)i);
        if (axis_step(axis, switches, now_us) && fw->step_slips < UINT16_MAX)
            fw->step_slips++;
        if (i == HAL_PAN) {
            strobe_pan(&fw->strobe, axis->position, was_positive, now_us);
            scanprog_pan(&fw->scan, axis, now_us);
        }
    }
    stepsched_arm(fw);
}
