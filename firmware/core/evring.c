#include "firmware/core/evring.h"
#include "firmware/hal/hal_time.h"

void evring_init(struct evring *ring) {
    ring->next = 0;
    ring->from = 0;
    ring->overrun = 0;
}

/* Sequence number of the oldest event kept. */
static uint32_t oldest(const struct evring *ring) {
    return ring->next > EVRING_SIZE ? ring->next - EVRING_SIZE : 0;
}

void evring_add(struct evring *ring, const struct idxevent *event) {
    /* 2^32 events are 13 years at 10 rev/s: seq does not wrap. */
    if (ring->next >= EVRING_SIZE && ring->from <= ring->next - EVRING_SIZE)
        ring->overrun++;
    struct idxevent *slot = &ring->events[ring->next % EVRING_SIZE];
    *slot = *event;
    slot->seq = ring->next;
    ring->next++;
}

void evring_seek(struct evring *ring, uint32_t seq) {
    ring->from = seq;
}

unsigned evring_read(const struct evring *ring, struct idxevent *out_events, unsigned capacity) {
    unsigned count = 0;
    uint32_t seq = ring->from;
    for (bool more = true; more && count < capacity;) {
        uint32_t saved = hal_irq_save();
        if (seq < oldest(ring))
            seq = oldest(ring);
        more = seq < ring->next;
        if (more) {
            out_events[count++] = ring->events[seq % EVRING_SIZE];
            seq++;
        }
        hal_irq_restore(saved);
    }
    return count;
}
