/* Any bytes as points of a spinning laser. */
#include "import/scan_spin.h"

#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct scan scan;
    struct errctx err = {0};
    if (scan_spin_parse(data, size, &scan, &err)) {
        if (!err.text[0])
            abort();
        return 0;
    }
    for (size_t i = 0; i < scan.count; i++)
        if (scan.samples[i].row >= (uint32_t)scan.rows ||
            scan.samples[i].column >= (uint32_t)scan.columns || !(scan.samples[i].range_m > 0.0f))
            abort();
    scan_destroy(&scan);
    return 0;
}
