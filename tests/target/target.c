/* Runner of the tests on the target core, and the vectors it starts from. Output and exit status go
 * through semihosting (newlib's rdimon), so the emulator ends with the number of failed tests. */
#include <cmocka.h>

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static jmp_buf failed;

void target_fail(const char *file, int line, const char *fmt, ...) {
    va_list args;
    va_start(args, fmt);
    (void)printf("%s:%d: ", file, line);
    (void)vprintf(fmt, args);
    (void)printf("\n");
    va_end(args);
    longjmp(failed, 1);
}

void target_compare(uintmax_t a, uintmax_t b, int same, const char *a_text, const char *b_text,
                    const char *file, int line) {
    if ((a == b) != same)
        target_fail(file, line, "%s is 0x%lx%08lx, %s is 0x%lx%08lx", a_text,
                    (unsigned long)(a >> 32), (unsigned long)a, b_text, (unsigned long)(b >> 32),
                    (unsigned long)b);
}

void target_same_memory(const void *a, const void *b, size_t size, const char *file, int line) {
    if (memcmp(a, b, size))
        target_fail(file, line, "memory differs");
}

void target_same_text(const char *a, const char *b, const char *file, int line) {
    if (strcmp(a, b))
        target_fail(file, line, "\"%s\" is not \"%s\"", a, b);
}

static int run_one(const struct CMUnitTest *test) {
    void *state = NULL;
    if (setjmp(failed)) {
        (void)printf("FAILED %s\n", test->name);
        return 1;
    }
    if (test->setup_func && test->setup_func(&state))
        target_fail(__FILE__, __LINE__, "set-up of %s", test->name);
    test->test_func(&state);
    if (test->teardown_func)
        (void)test->teardown_func(&state);
    return 0;
}

int target_run(const char *group, const struct CMUnitTest *tests, size_t count,
               CMFixtureFunction setup, CMFixtureFunction teardown) {
    void *state = NULL;
    int bad = setup && setup(&state);
    for (size_t i = 0; i < count; i++)
        bad += run_one(&tests[i]);
    if (teardown)
        (void)teardown(&state);
    (void)printf("%s: %u tests on the target core, %d failed\n", group, (unsigned)count, bad);
    return bad;
}

/* A fault ends the run instead of hanging it. */
static void fault(void) {
    (void)printf("processor fault\n");
    exit(2);
}

extern char target_stack_end[];
extern void _start(void);
union vector {
    char *stack;
    void (*handler)(void);
};
extern const union vector vectors[16];
__attribute__((section(".vectors"), used)) const union vector vectors[16] = {
    [0] = {.stack = target_stack_end}, [1] = {.handler = _start}, [2] = {.handler = fault},
    [3] = {.handler = fault},          [4] = {.handler = fault},  [5] = {.handler = fault},
    [6] = {.handler = fault}};
