/* The ring of index and strobe events. Interrupts add; the main loop reads by sequence number and
 * never removes, so a lost reply is simply asked for again. The oldest is overwritten; what the
 * reader had not passed by then is counted. */
#ifndef SC_CORE_EVRING_H
#define SC_CORE_EVRING_H

#include "firmware/shared/idxevent.h"
#include <stdbool.h>

#define EVRING_SIZE 64u /* events, a power of two: 6 s of a mirror at 10 rev/s */

struct evring {
    struct idxevent events[EVRING_SIZE];
    uint32_t next;    /* sequence number of the next event; event seq lies at seq % EVRING_SIZE */
    uint32_t from;    /* the reader wants this one first */
    uint32_t overrun; /* overwritten before `from` had passed them */
};

void evring_init(struct evring *ring);

/* Adds an event; its seq is filled in. Interrupts. Budget 2 us. */
void evring_add(struct evring *ring, const struct idxevent *event);

/* The reader has all before `seq`. Under the interrupt lock. */
void evring_seek(struct evring *ring, uint32_t seq);

/* Copies up to `capacity` events from the reader's place on (or from the oldest kept if that is
 * later; nothing if the place lies in the future). Takes the interrupt lock for each. Main loop.
 * Returns the number. */
unsigned evring_read(const struct evring *ring, struct idxevent *out_events, unsigned capacity);

#endif
