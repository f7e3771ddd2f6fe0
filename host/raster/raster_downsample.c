/* Box filter of a supersampled picture, in linear light. */
#include "raster/raster.h"

#include <math.h>

enum { SIDE_MAX = 16 };

/* sRGB (IEC 61966-2-1) to linear 0..1 and back. */
static float linear_from_srgb(int value) {
    float s = (float)value / 255.0f;
    return s <= 0.04045f ? s / 12.92f : powf((s + 0.055f) / 1.055f, 2.4f);
}

static uint8_t srgb_from_linear(float linear) {
    float s = linear <= 0.0031308f ? 12.92f * linear : 1.055f * powf(linear, 1.0f / 2.4f) - 0.055f;
    float scaled = 255.0f * s + 0.5f;
    return scaled <= 0.0f ? 0 : scaled >= 255.0f ? 255 : (uint8_t)scaled;
}

/* One block: who covers most of it, surface, unknown or nothing. */
static uint8_t block_alpha(const uint8_t *block, size_t stride, int32_t n) {
    int32_t surface = 0, unknown = 0;
    for (int32_t j = 0; j < n; j++)
        for (int32_t i = 0; i < n; i++) {
            uint8_t alpha = block[(size_t)j * stride + 4 * (size_t)i + 3];
            surface += alpha == RASTER_ALPHA_SURFACE;
            unknown += alpha == RASTER_ALPHA_UNKNOWN;
        }
    if (2 * surface >= n * n)
        return RASTER_ALPHA_SURFACE;
    return 2 * (surface + unknown) >= n * n ? RASTER_ALPHA_UNKNOWN : RASTER_ALPHA_NOTHING;
}

static void block_colour(const uint8_t *block, size_t stride, int32_t n, const float *linear,
                         const uint8_t background_rgb[3], uint8_t out[4]) {
    uint8_t alpha = block_alpha(block, stride, n);
    float sum[3] = {0};
    int32_t count = 0;
    bool same = true;
    const uint8_t *first = NULL;
    for (int32_t j = 0; j < n; j++)
        for (int32_t i = 0; i < n; i++) {
            const uint8_t *px = block + (size_t)j * stride + 4 * (size_t)i;
            if (px[3] != alpha)
                continue;
            first = first ? first : px;
            same = same && px[0] == first[0] && px[1] == first[1] && px[2] == first[2];
            for (int k = 0; k < 3; k++)
                sum[k] += linear[px[k]];
            count++;
        }
    out[3] = alpha;
    for (int k = 0; k < 3; k++) {
        if (alpha == RASTER_ALPHA_NOTHING || !count)
            out[k] = background_rgb[k];
        else
            out[k] = same ? first[k] : srgb_from_linear(sum[k] / (float)count);
    }
}

/* Median of the depths that are there; the upper one (the nearer) of an even number. */
static float block_depth(const float *block, size_t stride, int32_t n) {
    float sorted[SIDE_MAX * SIDE_MAX];
    int32_t count = 0;
    for (int32_t j = 0; j < n; j++)
        for (int32_t i = 0; i < n; i++) {
            float d = block[(size_t)j * stride + (size_t)i];
            if (isnan(d))
                continue;
            int32_t k = count++;
            for (; k > 0 && sorted[k - 1] > d; k--)
                sorted[k] = sorted[k - 1];
            sorted[k] = d;
        }
    return count ? sorted[count / 2] : NAN;
}

enum st raster_downsample(const struct raster_target *fine, int32_t n,
                          const uint8_t background_rgb[3], const struct raster_target *out) {
    if (n < 1 || n > SIDE_MAX || fine->width_px != n * out->width_px ||
        fine->height_px != n * out->height_px)
        return ST_INVALID;
    float linear[256];
    for (int i = 0; i < 256; i++)
        linear[i] = linear_from_srgb(i);
    size_t fine_w = (size_t)fine->width_px, w = (size_t)out->width_px;
#pragma omp parallel for schedule(static)
    for (int32_t y = 0; y < out->height_px; y++)
        for (size_t x = 0; x < w; x++) {
            size_t from = (size_t)y * (size_t)n * fine_w + x * (size_t)n, to = (size_t)y * w + x;
            uint8_t rgba[4] = {0, 0, 0, RASTER_ALPHA_SURFACE};
            if (fine->rgba && out->rgba) {
                block_colour(fine->rgba + 4 * from, 4 * fine_w, n, linear, background_rgb, rgba);
                for (int k = 0; k < 4; k++)
                    out->rgba[4 * to + (size_t)k] = rgba[k];
            }
            if (fine->depth && out->depth)
                out->depth[to] = rgba[3] == RASTER_ALPHA_NOTHING
                                     ? NAN
                                     : block_depth(fine->depth + from, fine_w, n);
        }
    return ST_OK;
}
