/* Any bytes as a PLY range grid, through to samples. */
#include "import/ply_grid.h"

#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct ply_grid grid;
    struct scan scan;
    struct errctx err = {0};
    const struct ply_grid_options options = {.up = FRAME_UP_Y};
    if (ply_grid_parse(data, size, &grid, &err)) {
        if (!err.text[0])
            abort();
        return 0;
    }
    if (!ply_grid_to_scan(&grid, &options, &scan, &err)) {
        for (size_t i = 0; i < scan.count; i++)
            if (scan.samples[i].row >= (uint32_t)grid.rows ||
                scan.samples[i].column >= (uint32_t)grid.columns)
                abort();
        scan_destroy(&scan);
    }
    ply_grid_destroy(&grid);
    return 0;
}
