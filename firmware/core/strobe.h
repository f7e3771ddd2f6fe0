/* Camera: triggers by hand or at pan positions, and the latched strobe. */
#ifndef SC_CORE_STROBE_H
#define SC_CORE_STROBE_H

#include <stdbool.h>
#include <stdint.h>

struct strobe {
    int32_t next_pan; /* position of the next automatic trigger */
    int32_t interval;
    uint16_t left; /* automatic triggers still to give */
    uint16_t pulse_us;
    uint32_t trigger_count, strobe_count;
    int32_t trigger_pan, strobe_pan;
    uint64_t trigger_us, strobe_us;
};

void strobe_init(struct strobe *strobe);

/* Arms `number` triggers at first, first + interval, ... Under the interrupt lock. */
void strobe_arm(struct strobe *strobe, int32_t first, int32_t interval, uint16_t number);
void strobe_disarm(struct strobe *strobe);

/* Pan has made a step to `pan`: triggers if that is the next position and it moves the interval's
 * way (so that a run-up does not trigger). Step interrupt. */
void strobe_pan(struct strobe *strobe, int32_t pan, bool positive, uint64_t now_us);

/* One trigger now. Interrupts or under the lock. */
void strobe_trigger(struct strobe *strobe, int32_t pan, uint64_t now_us);

/* The camera's strobe was captured at t_us. Strobe interrupt. */
void strobe_seen(struct strobe *strobe, int32_t pan, uint64_t t_us);

#endif
