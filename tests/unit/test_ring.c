#include "base/ring.h"
#include "tests/support/cmocka_all.h"

#include <pthread.h>
#include <sched.h>
#include <string.h>

static void keeps_order_across_the_end(void **state) {
    (void)state;
    uint32_t memory[8], out[8];
    struct ring ring;
    assert_int_equal(ring_init(&ring, memory, 8, sizeof memory[0]), ST_OK);
    uint32_t next_in = 0, next_out = 0;
    for (int round = 0; round < 100; round++) {
        uint32_t in[5];
        for (int i = 0; i < 5; i++)
            in[i] = next_in++;
        assert_int_equal(ring_push(&ring, in, 5), 5);
        assert_int_equal(ring_pop(&ring, out, 8), 5);
        for (int i = 0; i < 5; i++)
            assert_int_equal(out[i], next_out++);
    }
    assert_int_equal(ring_refused(&ring), 0);
    assert_int_equal(ring_peak(&ring), 5);
}

static void full_ring_refuses_and_counts(void **state) {
    (void)state;
    uint16_t memory[4], in[6] = {1, 2, 3, 4, 5, 6}, out[4];
    struct ring ring;
    assert_int_equal(ring_init(&ring, memory, 4, sizeof memory[0]), ST_OK);
    assert_int_equal(ring_push(&ring, in, 6), 4);
    assert_int_equal(ring_push(&ring, in, 1), 0);
    assert_int_equal(ring_refused(&ring), 3);
    assert_int_equal(ring_pop(&ring, out, 4), 4);
    assert_memory_equal(out, in, sizeof out);
    assert_int_equal(ring_pop(&ring, out, 4), 0);
}

static void regions_cover_the_ring_in_two_pieces(void **state) {
    (void)state;
    uint8_t memory[8], scratch[8];
    struct ring ring;
    assert_int_equal(ring_init(&ring, memory, 8, 1), ST_OK);
    assert_int_equal(ring_push(&ring, "abcdef", 6), 6);
    assert_int_equal(ring_pop(&ring, scratch, 5), 5);
    struct ring_regions room = ring_room(&ring);
    assert_ptr_equal(room.first, memory + 6);
    assert_int_equal(room.first_count, 2);
    assert_ptr_equal(room.second, memory);
    assert_int_equal(room.second_count, 5);
    memcpy(room.first, "gh", 2);
    memcpy(room.second, "ij", 2);
    ring_publish(&ring, 4);
    struct ring_regions waiting = ring_waiting(&ring);
    assert_int_equal(waiting.first_count, 3);
    assert_memory_equal(waiting.first, "fgh", 3);
    assert_int_equal(waiting.second_count, 2);
    assert_memory_equal(waiting.second, "ij", 2);
    ring_release(&ring, 5);
    assert_int_equal(ring_waiting(&ring).first_count, 0);
}

static void positions_survive_the_wrap_of_their_type(void **state) {
    (void)state;
    uint32_t memory[4], value = 7, out[4];
    struct ring ring;
    assert_int_equal(ring_init(&ring, memory, 4, sizeof memory[0]), ST_OK);
    size_t start = SIZE_MAX - 1; /* as after 2^64 - 2 elements */
    atomic_store(&ring.head, start);
    atomic_store(&ring.tail, start);
    ring.head_seen = ring.tail_seen = start;
    for (uint32_t i = 0; i < 10; i++) {
        value = i;
        assert_int_equal(ring_push(&ring, &value, 1), 1);
        assert_int_equal(ring_pop(&ring, out, 4), 1);
        assert_int_equal(out[0], i);
    }
}

static void refuses_sizes_that_make_no_ring(void **state) {
    (void)state;
    uint8_t memory[8];
    struct ring ring;
    assert_int_equal(ring_init(&ring, memory, 0, 1), ST_INVALID);
    assert_int_equal(ring_init(&ring, memory, 6, 1), ST_INVALID);
    assert_int_equal(ring_init(&ring, memory, 8, 0), ST_INVALID);
    assert_int_equal(ring_init(&ring, NULL, 8, 1), ST_INVALID);
}

enum { SENT = 200000 };

/* Every third burst is written in place, the others are copied. */
static void *produce(void *context) {
    struct ring *ring = context;
    uint64_t next = 0;
    while (next < SENT) {
        struct ring_regions room = ring_room(ring);
        if (room.first_count == 0) {
            (void)sched_yield();
            continue;
        }
        uint64_t burst[7];
        size_t n = room.first_count < 7 ? room.first_count : 7;
        n = n < SENT - next ? n : SENT - next;
        for (size_t i = 0; i < n; i++)
            burst[i] = next + i;
        if (next % 3 == 0) {
            memcpy(room.first, burst, n * sizeof burst[0]);
            ring_publish(ring, n);
        } else {
            (void)ring_push(ring, burst, n);
        }
        next += n;
    }
    return NULL;
}

static void two_threads_pass_everything_once_and_in_order(void **state) {
    (void)state;
    static uint64_t memory[64];
    struct ring ring;
    assert_int_equal(ring_init(&ring, memory, 64, sizeof memory[0]), ST_OK);
    pthread_t producer;
    assert_int_equal(pthread_create(&producer, NULL, produce, &ring), 0);
    uint64_t expected = 0, wrong = 0;
    while (expected < SENT) {
        uint64_t out[5];
        size_t n = ring_pop(&ring, out, 5);
        for (size_t i = 0; i < n; i++)
            wrong += out[i] != expected++;
        if (n == 0)
            (void)sched_yield();
    }
    assert_int_equal(pthread_join(producer, NULL), 0);
    assert_int_equal(wrong, 0);
    assert_int_equal(ring_refused(&ring), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(keeps_order_across_the_end),
        cmocka_unit_test(full_ring_refuses_and_counts),
        cmocka_unit_test(regions_cover_the_ring_in_two_pieces),
        cmocka_unit_test(positions_survive_the_wrap_of_their_type),
        cmocka_unit_test(refuses_sizes_that_make_no_ring),
        cmocka_unit_test(two_threads_pass_everything_once_and_in_order),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
