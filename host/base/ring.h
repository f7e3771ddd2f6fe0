/* Ring between one producer thread and one consumer thread, in memory of the caller. No locks, no
 * waiting, no allocation: safe on the real-time path. A full ring refuses, counts what was refused
 * and goes on. */
#ifndef SC_BASE_RING_H
#define SC_BASE_RING_H

#include "base/atomic.h"
#include "base/st.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Positions count elements since the start and wrap with their type; the slot is position & mask.
 * Each side keeps the other's last seen position, so that it rarely touches the other's cache line.
 */
struct ring {
    /* constant after init */
    unsigned char *slots;
    size_t mask, elem_bytes;
    unsigned char gap0[40]; /* keeps the two sides on cache lines of their own */
    /* producer writes */
    SC_ATOMIC(size_t) head;
    size_t tail_seen;
    SC_ATOMIC(uint64_t) refused;
    unsigned char gap1[40];
    /* consumer writes */
    SC_ATOMIC(size_t) tail;
    size_t head_seen;
    SC_ATOMIC(size_t) peak; /* most elements that were waiting at once */
};

/* Up to two pieces of the ring, in order; the second is not empty only where the first meets the
 * end. */
struct ring_regions {
    void *first, *second;
    size_t first_count, second_count;
};

/* `memory` holds capacity elements of elem_bytes. ST_INVALID unless capacity is a power of two
 * (from 1 to 2^31) and the rest is not 0. Before the threads start. */
ST_MUST_CHECK enum st ring_init(struct ring *ring, void *memory, size_t capacity,
                                size_t elem_bytes);

/* Producer: all the room there is. Fill elements in order, then publish as many as were filled (at
 * most the room). Elements not published are not seen. */
struct ring_regions ring_room(struct ring *ring);
void ring_publish(struct ring *ring, size_t count);

/* Producer: copies as many of the elements as fit, in order; the rest is counted as refused.
 * Returns the number taken. */
size_t ring_push(struct ring *ring, const void *elements, size_t count);

/* Producer: counts elements that it did not even try to push. */
void ring_count_refused(struct ring *ring, uint64_t count);

/* Consumer: all that waits. Use it in place, then release as much as was used (at most what
 * waited). */
struct ring_regions ring_waiting(struct ring *ring);
void ring_release(struct ring *ring, size_t count);

/* Consumer: copies out up to `capacity` elements; returns how many. */
size_t ring_pop(struct ring *ring, void *out_elements, size_t capacity);

/* Any thread: elements refused so far; most that waited at once, as the consumer saw it. */
uint64_t ring_refused(const struct ring *ring);
size_t ring_peak(const struct ring *ring);

#ifdef __cplusplus
}
#endif
#endif
