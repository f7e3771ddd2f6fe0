#include "base/arena.h"
#include "tests/support/cmocka_all.h"

#include <string.h>

static void allocations_are_aligned_and_apart(void **state) {
    (void)state;
    unsigned char block[1024];
    struct arena arena;
    arena_init(&arena, block + 1, sizeof block - 1); /* a block of no alignment */
    unsigned char *end = block;
    for (size_t n = 1; n < 100; n += 13) {
        unsigned char *p = arena_alloc(&arena, n, 1);
        assert_non_null(p);
        assert_int_equal((uintptr_t)p % ARENA_ALIGN_BYTES, 0);
        assert_true(p >= end && p + n <= block + sizeof block);
        end = p + n;
    }
}

static void overflow_gives_null_and_changes_nothing(void **state) {
    (void)state;
    unsigned char block[512];
    struct arena arena;
    arena_init(&arena, block, sizeof block);
    assert_non_null(ARENA_NEW(&arena, double, 8));
    size_t used = arena.used_bytes;
    assert_null(arena_alloc(&arena, 1000, 1));
    assert_null(arena_alloc(&arena, SIZE_MAX / 2, 4)); /* the product wraps */
    assert_null(arena_alloc(&arena, SIZE_MAX, 1));
    assert_int_equal(arena.used_bytes, used);
    assert_int_equal(arena.refused, 3);
    assert_non_null(ARENA_NEW(&arena, double, 8));
}

static void reports_what_did_not_fit(void **state) {
    (void)state;
    unsigned char block[128];
    struct arena arena;
    arena_init(&arena, block, sizeof block);
    struct errctx err = {0};
    void *p = NULL;
    assert_int_equal(arena_take(&arena, 100, 8, "tile list", &p, &err), ST_NOMEM);
    assert_null(p);
    assert_string_equal(err.text, "no room for tile list: 100 x 8 bytes asked, 128 of 128 left");
    assert_int_equal(arena_take(&arena, 4, 8, "tile list", &p, &err), ST_OK);
    assert_non_null(p);
}

static void rewind_gives_back_to_the_mark(void **state) {
    (void)state;
    unsigned char block[1024];
    struct arena arena;
    arena_init(&arena, block, sizeof block);
    char *kept = arena_alloc(&arena, 10, 1);
    strcpy(kept, "kept");
    struct arena_mark outer = arena_mark(&arena);
    void *first = arena_alloc(&arena, 100, 1);
    struct arena_mark inner = arena_mark(&arena);
    (void)arena_alloc(&arena, 300, 1);
    arena_rewind(&arena, inner);
    arena_rewind(&arena, outer);
    assert_ptr_equal(arena_alloc(&arena, 100, 1), first);
    assert_string_equal(kept, "kept");
    assert_true(arena.peak_bytes >= 410);
}

static void zeroed_memory_is_zero_after_use(void **state) {
    (void)state;
    unsigned char block[256], zero[64] = {0};
    memset(block, 0xff, sizeof block);
    struct arena arena;
    arena_init(&arena, block, sizeof block);
    unsigned char *p = arena_zalloc(&arena, 16, 4);
    assert_memory_equal(p, zero, 64);
}

static void empty_arena_and_empty_requests_are_harmless(void **state) {
    (void)state;
    struct arena arena;
    arena_init(&arena, NULL, 0);
    assert_null(arena_alloc(&arena, 1, 1));
    unsigned char block[128];
    arena_init(&arena, block, sizeof block);
    assert_non_null(arena_alloc(&arena, 0, 8));
    assert_non_null(arena_alloc(&arena, 8, 0));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(allocations_are_aligned_and_apart),
        cmocka_unit_test(overflow_gives_null_and_changes_nothing),
        cmocka_unit_test(reports_what_did_not_fit),
        cmocka_unit_test(rewind_gives_back_to_the_mark),
        cmocka_unit_test(zeroed_memory_is_zero_after_use),
        cmocka_unit_test(empty_arena_and_empty_requests_are_harmless),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
