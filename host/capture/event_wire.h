/* Index events as a site keeps them: format idxevent.1, the 14 words of the controller's event
 * window (firmware/shared/idxevent.h), high byte first as on the line. */
#ifndef SC_CAPTURE_EVENT_WIRE_H
#define SC_CAPTURE_EVENT_WIRE_H

#include "base/index_event.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { EVENT_WIRE_BYTES = 28 };

/* The record as the window had it: what the host made of it is undone without rounding. */
void event_wire_encode(const struct index_event *event, uint8_t out_bytes[EVENT_WIRE_BYTES]);

/* Counters as they are on the wire, 32 bits. */
struct index_event event_wire_decode(const uint8_t bytes[EVENT_WIRE_BYTES]);

#ifdef __cplusplus
}
#endif
#endif
