/* Any bytes as a .3d file: an answer, and samples that lie in the grid they claim. */
#include "import/scan_3dtk.h"

#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const struct scan_3dtk_options options = {0};
    struct scan scan = {0};
    struct turned_grid grid;
    struct errctx err = {0};
    if (scan_3dtk_parse(data, size, &options, &scan, &grid, &err)) {
        if (!err.text[0])
            abort();
        return 0;
    }
    for (size_t i = 0; i < scan.count; i++)
        if (scan.samples[i].row >= (uint32_t)grid.rows ||
            scan.samples[i].column >= (uint32_t)grid.columns)
            abort();
    turned_grid_fini(&grid);
    scan_destroy(&scan);
    return 0;
}
