/* Large zeroed arrays straight from the system, on huge pages where it has them: touching 256 MB of
 * small pages for the first time costs more than the work done in them (a quarter of a second in a
 * virtual machine; a tenth of that on 2 MiB pages). */
#ifndef SC_BASE_PAGES_H
#define SC_BASE_PAGES_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* `count` elements of elem_bytes, all zero; NULL without memory or if the product is 0 or too
 * large. */
void *pages_alloc(size_t count, size_t elem_bytes);
/* Gives them back; the same numbers as given to pages_alloc(). Takes NULL. */
void pages_free(void *memory, size_t count, size_t elem_bytes);

#ifdef __cplusplus
}
#endif
#endif
