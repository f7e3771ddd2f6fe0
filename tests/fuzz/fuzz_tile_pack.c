/* Tile packs and coded tiles from anywhere: no crash, no lies about what was read. */
#include "base/tile_pack.h"

#include <math.h>
#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check(const struct tile_samples *s) {
    for (int32_t i = 0; i < s->width * s->height; i++) {
        float d = s->disparity_per_m[i];
        if (!(isnan(d) || (d >= 0.0f && isfinite(d))))
            abort();
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static struct tile_samples samples;
    if (size && !tile_code_decode(data + 1, size - 1, &samples, NULL))
        check(&samples);
    struct tile_pack *pack = NULL;
    struct errctx err;
    if (tile_pack_open_memory(data, size, &pack, &err))
        return 0;
    int64_t count = tile_pack_get_index(pack)->node_count;
    for (int64_t node = 0; node < count && node < 64; node++)
        if (!tile_pack_read(pack, node, &samples, &err))
            check(&samples);
    tile_pack_close(pack);
    return 0;
}
