/* Bands: keys and what goes with them, and how they become planes. */
#include "raster/raster_band.h"

#include "base/simd.h"

/* Set in keys of surfaces while layers are merged: a surface beats the unknown at any depth. Depth
 * bits leave it free. */
#define SURFACE_MARK ((uint64_t)1 << 63)

static size_t plane_elems(int32_t width_px, int32_t rows_cap) {
    size_t n = (size_t)(width_px + 2 * BAND_PAD_PX) * (size_t)(rows_cap + 2 * BAND_PAD_PX);
    return (n + 31) / 32 * 32;
}

size_t raster_band_bytes(int32_t width_px, int32_t rows_cap, bool rich) {
    size_t bytes = plane_elems(width_px, rows_cap) * (rich ? 8 + 8 + 4 + 2 : 8);
    return (bytes + 4095) / 4096 * 4096;
}

struct band raster_band_make(void *memory, int32_t width_px, int32_t rows_cap, bool rich) {
    size_t n = plane_elems(width_px, rows_cap);
    uint64_t *key = memory, *item = key + n;
    float *depth = (float *)(item + n);
    uint16_t *count = (uint16_t *)(depth + n);
    struct band band = {.width_px = width_px, .stride = width_px + 2 * BAND_PAD_PX};
    ptrdiff_t origin = BAND_PAD_PX * band.stride + BAND_PAD_PX;
    band.key = key + origin;
    if (rich) {
        band.item = item + origin;
        band.depth = depth + origin;
        band.count = count + origin;
    }
    return band;
}

void raster_band_clear(const struct band *band) {
    ptrdiff_t origin = BAND_PAD_PX * band->stride + BAND_PAD_PX;
    size_t n = (size_t)band->stride * (size_t)(band->y1_px - band->y0_px + 2 * BAND_PAD_PX);
    memset(band->key - origin, 0, n * sizeof *band->key);
    if (band->item) {
        memset(band->item - origin, 0xff, n * sizeof *band->item);
        memset(band->count - origin, 0, n * sizeof *band->count);
    }
}

static uint64_t marked(uint64_t key) {
    bool surface = key >> 32 && (uint32_t)key >> 24 == RASTER_ALPHA_SURFACE;
    return surface ? key | SURFACE_MARK : key;
}

void raster_band_merge(const struct band *layer, const struct band *all) {
    for (int32_t y = 0; y < all->y1_px - all->y0_px; y++)
        for (int32_t x = 0; x < all->width_px; x++) {
            ptrdiff_t at = y * all->stride + x;
            uint64_t key = marked(layer->key[at]);
            bool win = key > all->key[at];
            if (all->item) {
                int sum = all->count[at] + layer->count[at];
                all->count[at] = sum < UINT16_MAX ? (uint16_t)sum : UINT16_MAX;
                win = win || (key == all->key[at] && layer->item[at] < all->item[at]);
                all->item[at] = win ? layer->item[at] : all->item[at];
                all->depth[at] = win ? layer->depth[at] : all->depth[at];
            }
            all->key[at] = win ? key : all->key[at];
        }
}

void raster_band_unmark(const struct band *all) {
    for (int32_t y = 0; y < all->y1_px - all->y0_px; y++)
        for (int32_t x = 0; x < all->width_px; x++)
            all->key[y * all->stride + x] &= ~SURFACE_MARK;
}

/* Keys to colours and depths, without a branch. */
SC_SIMD_CLONES
static void resolve_row(const uint64_t *key, int32_t n, uint32_t background, uint8_t *rgba,
                        float *depth) {
    if (rgba)
        for (int32_t x = 0; x < n; x++) {
            uint32_t upper = (uint32_t)(key[x] >> 32), lower = (uint32_t)key[x];
            uint32_t value = upper ? lower : background;
            memcpy(rgba + 4 * (ptrdiff_t)x, &value, 4);
        }
    if (depth)
        for (int32_t x = 0; x < n; x++) {
            uint32_t upper = (uint32_t)(key[x] >> 32);
            uint32_t bits = upper ? upper - 1u : 0x7fc00000u; /* NaN */
            memcpy(depth + x, &bits, 4);
        }
}

void raster_band_resolve(const struct band *band, const struct raster_target *target,
                         uint32_t background) {
    int32_t w = band->width_px;
    for (int32_t y = band->y0_px; y < band->y1_px; y++) {
        ptrdiff_t from = (y - band->y0_px) * band->stride;
        size_t to = (size_t)y * (size_t)w;
        const uint64_t *key = band->key + from;
        resolve_row(key, w, background, target->rgba ? target->rgba + 4 * to : NULL,
                    target->depth ? target->depth + to : NULL);
        if (target->depth && band->depth)
            for (int32_t x = 0; x < w; x++)
                if (key[x] >> 32)
                    target->depth[to + (size_t)x] = band->depth[from + x];
        if (target->item)
            memcpy(target->item + to, band->item + from, (size_t)w * sizeof *target->item);
        if (target->count)
            memcpy(target->count + to, band->count + from, (size_t)w * sizeof *target->count);
    }
}
