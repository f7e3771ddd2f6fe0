/* The mirror that the simulated devices in the virtual machine share: it turns with the machine's
 * monotonic clock, so that head and index line agree. */
#ifndef SC_TESTS_VM_MIRROR_H
#define SC_TESTS_VM_MIRROR_H

#include <stdint.h>

enum { VM_MIRROR_TURN_NS = 250000000, VM_MIRROR_PULSE_NS = 110000000 };

/* Encoder counts 0..4096. */
static inline double vm_mirror_counts(int64_t t_ns) {
    return (double)(t_ns % VM_MIRROR_TURN_NS) / VM_MIRROR_TURN_NS * 4096;
}

/* The index line: longer than the 40 ms in which the chip's driver looks at its lines. */
static inline int vm_mirror_index(int64_t t_ns) {
    return t_ns % VM_MIRROR_TURN_NS < VM_MIRROR_PULSE_NS;
}

#endif
