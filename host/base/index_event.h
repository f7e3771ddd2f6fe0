/* What the cart's controller logs at each mirror index pulse and at each camera strobe, as the host
 * keeps it: counters unwrapped to 64 bits, so that a long scan has no seam. */
#ifndef SC_BASE_INDEX_EVENT_H
#define SC_BASE_INDEX_EVENT_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum index_event_kind { INDEX_EVENT_INDEX = 1, INDEX_EVENT_STROBE = 2 };

enum index_event_flag {
    INDEX_EVENT_PAN_MOVING = 1 << 0,
    INDEX_EVENT_TILT_MOVING = 1 << 1,
    INDEX_EVENT_PAN_HOMED = 1 << 2,
    INDEX_EVENT_TILT_HOMED = 1 << 3,
    INDEX_EVENT_PAN_POSITIVE = 1 << 4, /* direction of the pan's last step */
    INDEX_EVENT_PAN_TAKEN_UP = 1 << 5, /* backlash taken up in that direction */
    INDEX_EVENT_LASER = 1 << 6,
    INDEX_EVENT_SWEEP = 1 << 7,        /* belongs to a scan's sweep */
    INDEX_EVENT_MIRROR_OK = 1 << 8,    /* mirror was in its speed range */
    INDEX_EVENT_AFTER_MISSED = 1 << 9, /* index pulses were missed before this one */
    INDEX_EVENT_OVERRUN = 1 << 10      /* step mode: the last revolution's step was not finished */
};

struct index_event {
    uint64_t seq;        /* all events since the controller's reset, from 0, no gap */
    int64_t t_ns;        /* controller time of the hardware capture, from the controller's reset */
    uint64_t revolution; /* index pulses since reset, this one and missed ones included */
    double pan_steps;    /* with the fraction of the way to the next step */
    int32_t tilt_steps;
    uint16_t kind;  /* enum index_event_kind */
    uint16_t flags; /* enum index_event_flag */
};

#ifdef __cplusplus
}
#endif
#endif
