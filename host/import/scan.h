/* A range scan as read from a foreign file, before it goes into a site. */
#ifndef SC_IMPORT_SCAN_H
#define SC_IMPORT_SCAN_H

#include "base/pose.h"
#include "base/sample.h"
#include "base/vec.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Samples in one file at the most: 5 GB of polar_sample. */
#define SCAN_MAX_SAMPLES ((size_t)1 << 27)

struct scan {
    struct polar_sample *samples; /* in the file's order; row and column are set */
    size_t count;
    int32_t rows, columns;
    struct vec3 origin_m;           /* where the rays start, station frame */
    struct pose world_from_station; /* identity unless the file or its companion says */
    char meta[1024];                /* JSON: how rows and columns lie, what was decided */
};

void scan_destroy(struct scan *scan); /* takes NULL or zeroed */

#ifdef __cplusplus
}
#endif
#endif
