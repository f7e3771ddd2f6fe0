/* Where the real data lie that some tests measure against: $SCANCART_DATA, else ../shared/data
 * beside the source tree. Such tests report SKIP (exit status 77) where there is none. */
#ifndef SC_TESTS_REAL_DATA_H
#define SC_TESTS_REAL_DATA_H

#include "base/fileio.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

enum { REAL_DATA_SKIP = 77 };

/* The path of a file or folder of the real data; false, said aloud, if it is not there. */
static inline bool real_data_path(const char *name, char out_path[FILEIO_PATH_MAX]) {
    const char *dir = getenv("SCANCART_DATA");
    const int n = snprintf(out_path, FILEIO_PATH_MAX, "%s/%s",
                           dir && *dir ? dir : SCANCART_SOURCE_DIR "/../shared/data", name);
    if (n > 0 && n < FILEIO_PATH_MAX && fileio_exists(out_path))
        return true;
    (void)printf("SKIP: no %s in the real data ($SCANCART_DATA)\n", name);
    return false;
}

#endif
