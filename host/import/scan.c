#include "import/scan.h"

#include <stdlib.h>
#include <string.h>

void scan_destroy(struct scan *scan) {
    if (!scan)
        return;
    free(scan->samples);
    memset(scan, 0, sizeof *scan);
}
