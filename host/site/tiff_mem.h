/* libtiff on memory instead of files, its messages captured, its allocations bounded. */
#ifndef SC_SITE_TIFF_MEM_H
#define SC_SITE_TIFF_MEM_H

#include "base/st.h"

#include <stddef.h>
#include <stdint.h>
#include <tiffio.h>

/* A file in memory. Writing grows `data` (malloc'ed); reading takes the caller's bytes. */
struct tiff_mem {
    uint8_t *data;        /* writing: owned */
    const uint8_t *bytes; /* what is read: data, or the caller's */
    size_t size, capacity, at;
    char message[256]; /* first error that libtiff reported since it was opened */
};

/* A new little-endian classic TIFF to write; `mem` must outlive it. Close with TIFFClose(), then
 * tiff_mem_fini() unless the caller takes mem->data. NULL: out of memory. */
TIFF *tiff_mem_create(struct tiff_mem *mem);

/* The caller's bytes to read; no single allocation above 64 MiB plus four times their size. NULL:
 * not a TIFF, mem->message says why. */
TIFF *tiff_mem_open(struct tiff_mem *mem, const void *data, size_t size);

/* The same again for what was written by tiff_mem_create() and closed. */
TIFF *tiff_mem_reopen(struct tiff_mem *mem);

void tiff_mem_fini(struct tiff_mem *mem); /* takes a zeroed one */

#endif
