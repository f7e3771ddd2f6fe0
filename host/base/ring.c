#include "base/ring.h"

#include <assert.h>
#include <stdbool.h>
#include <string.h>

enum st ring_init(struct ring *ring, void *memory, size_t capacity, size_t elem_bytes) {
    const size_t capacity_max = (size_t)1 << 31;
    bool power_of_two = capacity && (capacity & (capacity - 1)) == 0;
    if (!memory || !elem_bytes || !power_of_two || capacity > capacity_max)
        return ST_INVALID;
    memset(ring, 0, sizeof *ring);
    ring->slots = memory;
    ring->mask = capacity - 1;
    ring->elem_bytes = elem_bytes;
    atomic_init(&ring->head, 0);
    atomic_init(&ring->refused, 0);
    atomic_init(&ring->tail, 0);
    atomic_init(&ring->peak, 0);
    return ST_OK;
}

/* `count` slots from a position on. */
static struct ring_regions regions_at(const struct ring *ring, size_t position, size_t count) {
    size_t slot = position & ring->mask;
    size_t to_end = ring->mask + 1 - slot;
    size_t first = count < to_end ? count : to_end;
    struct ring_regions r = {ring->slots + slot * ring->elem_bytes, ring->slots, first,
                             count - first};
    return r;
}

struct ring_regions ring_room(struct ring *ring) {
    size_t head = atomic_load_explicit(&ring->head, memory_order_relaxed); /* our own */
    /* acquire: the consumer has finished reading what it released */
    ring->tail_seen = atomic_load_explicit(&ring->tail, memory_order_acquire);
    return regions_at(ring, head, ring->mask + 1 - (head - ring->tail_seen));
}

void ring_publish(struct ring *ring, size_t count) {
    size_t head = atomic_load_explicit(&ring->head, memory_order_relaxed);
    assert(count <= ring->mask + 1 - (head - ring->tail_seen));
    /* release: the elements are written before they can be seen */
    atomic_store_explicit(&ring->head, head + count, memory_order_release);
}

size_t ring_push(struct ring *ring, const void *elements, size_t count) {
    size_t head = atomic_load_explicit(&ring->head, memory_order_relaxed);
    size_t room = ring->mask + 1 - (head - ring->tail_seen);
    if (room < count) {
        ring->tail_seen = atomic_load_explicit(&ring->tail, memory_order_acquire);
        room = ring->mask + 1 - (head - ring->tail_seen);
    }
    size_t taken = count < room ? count : room;
    struct ring_regions r = regions_at(ring, head, taken);
    const unsigned char *from = elements;
    if (r.first_count)
        memcpy(r.first, from, r.first_count * ring->elem_bytes);
    if (r.second_count)
        memcpy(r.second, from + r.first_count * ring->elem_bytes,
               r.second_count * ring->elem_bytes);
    ring_publish(ring, taken);
    if (taken < count)
        ring_count_refused(ring, count - taken);
    return taken;
}

void ring_count_refused(struct ring *ring, uint64_t count) {
    uint64_t refused = atomic_load_explicit(&ring->refused, memory_order_relaxed);
    atomic_store_explicit(&ring->refused, refused + count, memory_order_relaxed);
}

struct ring_regions ring_waiting(struct ring *ring) {
    size_t tail = atomic_load_explicit(&ring->tail, memory_order_relaxed); /* our own */
    /* acquire: the elements were written before the producer published them */
    ring->head_seen = atomic_load_explicit(&ring->head, memory_order_acquire);
    size_t waiting = ring->head_seen - tail;
    if (waiting > atomic_load_explicit(&ring->peak, memory_order_relaxed))
        atomic_store_explicit(&ring->peak, waiting, memory_order_relaxed);
    return regions_at(ring, tail, waiting);
}

void ring_release(struct ring *ring, size_t count) {
    size_t tail = atomic_load_explicit(&ring->tail, memory_order_relaxed);
    assert(count <= ring->head_seen - tail);
    /* release: reading is over before the producer may write there */
    atomic_store_explicit(&ring->tail, tail + count, memory_order_release);
}

size_t ring_pop(struct ring *ring, void *out_elements, size_t capacity) {
    struct ring_regions r = ring_waiting(ring);
    size_t first = r.first_count < capacity ? r.first_count : capacity;
    size_t left = capacity - first;
    size_t second = r.second_count < left ? r.second_count : left;
    unsigned char *to = out_elements;
    if (first)
        memcpy(to, r.first, first * ring->elem_bytes);
    if (second)
        memcpy(to + first * ring->elem_bytes, r.second, second * ring->elem_bytes);
    ring_release(ring, first + second);
    return first + second;
}

uint64_t ring_refused(const struct ring *ring) {
    return atomic_load_explicit(&ring->refused, memory_order_relaxed);
}

size_t ring_peak(const struct ring *ring) {
    return atomic_load_explicit(&ring->peak, memory_order_relaxed);
}
