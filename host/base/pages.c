#define _DEFAULT_SOURCE /* madvise */

#include "base/pages.h"

#include <stdint.h>
#include <sys/mman.h>

void *pages_alloc(size_t count, size_t elem_bytes) {
    if (!count || !elem_bytes || count > PTRDIFF_MAX / elem_bytes)
        return NULL;
    void *memory =
        mmap(NULL, count * elem_bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED)
        return NULL;
    (void)madvise(memory, count * elem_bytes, MADV_HUGEPAGE); /* a wish */
    return memory;
}

void pages_free(void *memory, size_t count, size_t elem_bytes) {
    if (memory)
        (void)munmap(memory, count * elem_bytes);
}
