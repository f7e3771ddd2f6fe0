#include "site/tiff_mem.h"

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static tmsize_t mem_read(thandle_t handle, void *buffer, tmsize_t wanted) {
    struct tiff_mem *mem = handle;
    if (wanted < 0 || mem->at >= mem->size)
        return 0;
    size_t n = mem->size - mem->at < (size_t)wanted ? mem->size - mem->at : (size_t)wanted;
    memcpy(buffer, mem->bytes + mem->at, n);
    mem->at += n;
    return (tmsize_t)n;
}

static tmsize_t mem_read_only(thandle_t handle, void *buffer, tmsize_t wanted) {
    (void)handle;
    (void)buffer;
    (void)wanted;
    return -1;
}

static tmsize_t mem_write(thandle_t handle, void *buffer, tmsize_t wanted) {
    struct tiff_mem *mem = handle;
    if (wanted < 0 || (size_t)wanted > SIZE_MAX / 4 - mem->at)
        return -1;
    size_t end = mem->at + (size_t)wanted;
    if (end > mem->capacity) {
        size_t capacity = end + end / 2 + 4096;
        uint8_t *data = realloc(mem->data, capacity);
        if (!data)
            return -1;
        mem->data = data;
        mem->bytes = data;
        mem->capacity = capacity;
    }
    if (mem->at > mem->size) /* a seek beyond the end, then a write: the gap reads as zeros */
        memset(mem->data + mem->size, 0, mem->at - mem->size);
    if (wanted > 0)
        memcpy(mem->data + mem->at, buffer, (size_t)wanted);
    mem->at = end;
    if (end > mem->size)
        mem->size = end;
    return wanted;
}

static toff_t mem_seek(thandle_t handle, toff_t offset, int whence) {
    struct tiff_mem *mem = handle;
    const toff_t base = whence == SEEK_CUR ? mem->at : whence == SEEK_END ? mem->size : 0;
    if (offset > SIZE_MAX / 4 || base + offset > SIZE_MAX / 4)
        return (toff_t)-1;
    mem->at = (size_t)(base + offset);
    return mem->at;
}

static int mem_close(thandle_t handle) {
    (void)handle;
    return 0;
}

static toff_t mem_size(thandle_t handle) {
    const struct tiff_mem *mem = handle;
    return mem->size;
}

/* Keeps the first error, without the line ends that would break our one line. */
static int on_error(TIFF *tiff, void *user_data, const char *module, const char *format,
                    va_list args) {
    (void)tiff;
    (void)module;
    struct tiff_mem *mem = user_data;
    if (!mem->message[0])
        (void)vsnprintf(mem->message, sizeof mem->message, format, args);
    for (char *c = mem->message; *c; c++)
        if ((unsigned char)*c < ' ')
            *c = ' ';
    return 1;
}

static int on_warning(TIFF *tiff, void *user_data, const char *module, const char *format,
                      va_list args) {
    (void)tiff;
    (void)user_data;
    (void)module;
    (void)format;
    (void)args;
    return 1;
}

static TIFF *open_with_options(struct tiff_mem *mem, const char *mode, tmsize_t bound) {
    TIFFOpenOptions *options = TIFFOpenOptionsAlloc();
    if (!options)
        return NULL;
    TIFFOpenOptionsSetErrorHandlerExtR(options, on_error, mem);
    TIFFOpenOptionsSetWarningHandlerExtR(options, on_warning, mem);
    if (bound > 0)
        TIFFOpenOptionsSetMaxSingleMemAlloc(options, bound);
    mem->at = 0;
    TIFF *tiff =
        TIFFClientOpenExt("memory", mode, mem, mem_read, mode[0] == 'r' ? mem_read_only : mem_write,
                          mem_seek, mem_close, mem_size, NULL, NULL, options);
    TIFFOpenOptionsFree(options);
    return tiff;
}

TIFF *tiff_mem_create(struct tiff_mem *mem) {
    memset(mem, 0, sizeof *mem);
    return open_with_options(mem, "wl", 0);
}

/* 'm': libtiff is not to map; 'O' would defer strip tables. */
static TIFF *open_to_read(struct tiff_mem *mem) {
    const size_t bound = ((size_t)64 << 20) + 4 * (mem->size < SIZE_MAX / 8 ? mem->size : 0);
    return open_with_options(mem, "rm", (tmsize_t)bound);
}

TIFF *tiff_mem_open(struct tiff_mem *mem, const void *data, size_t size) {
    memset(mem, 0, sizeof *mem);
    mem->bytes = data;
    mem->size = size;
    return open_to_read(mem);
}

TIFF *tiff_mem_reopen(struct tiff_mem *mem) {
    mem->message[0] = 0;
    return open_to_read(mem);
}

void tiff_mem_fini(struct tiff_mem *mem) {
    free(mem->data);
    memset(mem, 0, sizeof *mem);
}
