/* Any bytes as a log of a turned line laser. */
#include "import/scan_fan.h"

#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct scan scan;
    struct errctx err = {0};
    (void)scan_fan_is(data, size);
    if (scan_fan_parse(data, size, &scan, &err)) {
        if (!err.text[0])
            abort();
        return 0;
    }
    if (scan.count != (size_t)scan.rows * (size_t)scan.columns)
        abort();
    scan_destroy(&scan);
    return 0;
}
