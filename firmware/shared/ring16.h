/* A ring of 16-bit words between one producer and one consumer (an interrupt and the main loop, or
 * two threads). Caller's memory, power of two; a full ring refuses and counts, it never waits or
 * overwrites. */
#ifndef SC_SHARED_RING16_H
#define SC_SHARED_RING16_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct ring16 {
    uint16_t *words;
    uint32_t mask;         /* capacity - 1 */
    _Atomic uint32_t head; /* written by the producer */
    _Atomic uint32_t tail; /* written by the consumer */
    uint32_t lost;         /* words refused; producer's, read by the consumer as a hint */
};

/* `capacity` is a power of two, at least 2. */
static inline void ring16_init(struct ring16 *ring, uint16_t *words, uint32_t capacity) {
    ring->words = words;
    ring->mask = capacity - 1;
    atomic_init(&ring->head, 0);
    atomic_init(&ring->tail, 0);
    ring->lost = 0;
}

/* Producer. False if full. Release order: the word is visible before the index. */
static inline bool ring16_put(struct ring16 *ring, uint16_t word) {
    uint32_t head = atomic_load_explicit(&ring->head, memory_order_relaxed);
    if (head - atomic_load_explicit(&ring->tail, memory_order_acquire) > ring->mask) {
        ring->lost++;
        return false;
    }
    ring->words[head & ring->mask] = word;
    atomic_store_explicit(&ring->head, head + 1, memory_order_release);
    return true;
}

/* Consumer. False if empty; `out_word` is written only on success. */
static inline bool ring16_get(struct ring16 *ring, uint16_t *out_word) {
    uint32_t tail = atomic_load_explicit(&ring->tail, memory_order_relaxed);
    if (tail == atomic_load_explicit(&ring->head, memory_order_acquire))
        return false;
    *out_word = ring->words[tail & ring->mask];
    atomic_store_explicit(&ring->tail, tail + 1, memory_order_release);
    return true;
}

/* Words waiting; exact for the consumer, a lower bound of the fill for the producer's view. */
static inline uint32_t ring16_count(const struct ring16 *ring) {
    return atomic_load_explicit(&ring->head, memory_order_acquire) -
           atomic_load_explicit(&ring->tail, memory_order_acquire);
}

#endif
