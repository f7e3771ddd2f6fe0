/* The part of cmocka that the firmware's tests use, for the target core: the same test sources run
 * there under semihosting. Found before the host's <cmocka.h> by the include path of tests/target.
 */
#ifndef SC_TESTS_TARGET_CMOCKA_H
#define SC_TESTS_TARGET_CMOCKA_H

#include <setjmp.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#define print_message printf

struct CMUnitTest {
    const char *name;
    void (*test_func)(void **state);
    int (*setup_func)(void **state);
    int (*teardown_func)(void **state);
};

#define cmocka_unit_test(f)                                                                        \
    { #f, f, NULL, NULL }
#define cmocka_unit_test_setup(f, s)                                                               \
    { #f, f, s, NULL }
#define cmocka_unit_test_teardown(f, t)                                                            \
    { #f, f, NULL, t }
#define cmocka_unit_test_setup_teardown(f, s, t)                                                   \
    { #f, f, s, t }

typedef int (*CMFixtureFunction)(void **state);
int target_run(const char *group, const struct CMUnitTest *tests, size_t count,
               CMFixtureFunction setup, CMFixtureFunction teardown);
#define cmocka_run_group_tests(tests, setup, teardown)                                             \
    target_run(#tests, tests, sizeof(tests) / sizeof((tests)[0]), setup, teardown)
#define cmocka_run_group_tests_name(name, tests, setup, teardown)                                  \
    target_run(name, tests, sizeof(tests) / sizeof((tests)[0]), setup, teardown)

/* Ends the running test as failed. */
void target_fail(const char *file, int line, const char *fmt, ...)
    __attribute__((noreturn, format(printf, 3, 4)));
void target_same_memory(const void *a, const void *b, size_t size, const char *file, int line);
void target_same_text(const char *a, const char *b, const char *file, int line);

#define fail()             target_fail(__FILE__, __LINE__, "fail()")
#define fail_msg(...)      target_fail(__FILE__, __LINE__, __VA_ARGS__)
#define assert_true(c)     ((c) ? (void)0 : target_fail(__FILE__, __LINE__, "not true: %s", #c))
#define assert_false(c)    ((c) ? target_fail(__FILE__, __LINE__, "not false: %s", #c) : (void)0)
#define assert_null(p)     assert_true((p) == NULL)
#define assert_non_null(p) assert_true((p) != NULL)
#define assert_int_equal(a, b)                                                                     \
    target_compare((uintmax_t)(a), (uintmax_t)(b), 1, #a, #b, __FILE__, __LINE__)
#define assert_int_not_equal(a, b)                                                                 \
    target_compare((uintmax_t)(a), (uintmax_t)(b), 0, #a, #b, __FILE__, __LINE__)
#define assert_in_range(v, low, high)                                                              \
    assert_true((uintmax_t)(v) >= (uintmax_t)(low) && (uintmax_t)(v) <= (uintmax_t)(high))
#define assert_memory_equal(a, b, size) target_same_memory(a, b, size, __FILE__, __LINE__)
#define assert_string_equal(a, b)       target_same_text(a, b, __FILE__, __LINE__)

void target_compare(uintmax_t a, uintmax_t b, int same, const char *a_text, const char *b_text,
                    const char *file, int line);

#endif
