/* Reset, stack watch and the fault handler. The stack lies at the very start of RAM: what runs over
 * its end leaves RAM and faults; the guard word there shows what stopped just short of it. */
#include "firmware/port/cortexm/cortexm.h"

/* Set by the linker script. */
extern uint32_t ld_stack_start[], ld_stack_end[];
extern const uint32_t ld_data_load[];
extern uint32_t ld_data_start[], ld_data_end[];
extern uint32_t ld_bss_start[], ld_bss_end[];

enum { STACK_SLICE_WORDS = 16 };
static const uint32_t stack_guard = 0x57ac6a4du;
static const uint32_t stack_paint = 0xa5a5a5a5u;

/* Words known to be painted above the guard, and where the next slice begins. */
static uint16_t painted_words;
static uint16_t painted_cursor;

void cortexm_reset(void) {
    /* Down to here the stack is in use; 32 bytes are left for this function's own pushes. */
    const uint32_t *here = (const uint32_t *)__builtin_frame_address(0);
    ld_stack_start[0] = stack_guard;
    for (volatile uint32_t *p = ld_stack_start + 1; p < here - 8; p++)
        *p = stack_paint;

    const uint32_t *from = ld_data_load;
    for (volatile uint32_t *to = ld_data_start; to < ld_data_end; to++)
        *to = *from++;
    for (volatile uint32_t *to = ld_bss_start; to < ld_bss_end; to++)
        *to = 0;

    painted_words = (uint16_t)(here - 8 - (ld_stack_start + 1));
    port_main();
}

uint16_t cortexm_stack_free(void) {
    const volatile uint32_t *base = ld_stack_start;
    if (base[0] != stack_guard)
        return 0;
    base++;
    unsigned stop = painted_cursor + STACK_SLICE_WORDS;
    if (stop > painted_words)
        stop = painted_words;
    for (unsigned i = painted_cursor; i < stop; i++) {
        if (base[i] != stack_paint) {
            painted_words = (uint16_t)i;
            break;
        }
    }
    painted_cursor = (uint16_t)(stop >= painted_words ? 0 : stop);
    return (uint16_t)(painted_words * sizeof(uint32_t));
}

void cortexm_fault(void) {
    cortexm_irq_off();
    port_make_safe();
    for (;;) /* the watchdog ends this; the start after it latches a fault */
        ;
}
