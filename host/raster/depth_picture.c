#include "raster/depth_picture.h"

#include <math.h>
#include <stdlib.h>

enum { SAMPLE_MAX = 65536, ANCHORS = 7 };

/* From far to near, evenly spaced; luma 20 to 240. */
static const uint8_t anchors[ANCHORS][3] = {{22, 14, 58},   {58, 32, 122},  {112, 44, 140},
                                            {176, 64, 120}, {228, 102, 82}, {248, 164, 76},
                                            {252, 240, 170}};

static int by_value(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

enum st depth_picture_range(const float *depth, size_t count, struct depth_range *out_range) {
    float *sample = malloc(SAMPLE_MAX * sizeof *sample);
    if (!sample)
        return ST_NOMEM;
    size_t n = 0, step = count / SAMPLE_MAX + 1;
    for (size_t i = 0; i < count; i += step)
        if (isfinite(depth[i]))
            sample[n++] = depth[i];
    struct depth_range range = {0.0f, 1.0f};
    if (n) {
        qsort(sample, n, sizeof *sample, by_value);
        range.far_depth = sample[n / 200];
        range.near_depth = sample[n - 1 - n / 200];
    }
    free(sample);
    *out_range = range;
    return ST_OK;
}

void depth_picture_colour(const float *depth, size_t count, struct depth_range range,
                          uint8_t *out_rgb) {
    float span = range.near_depth - range.far_depth;
    for (size_t i = 0; i < count; i++) {
        uint8_t *rgb = out_rgb + 3 * i;
        if (isnan(depth[i])) {
            rgb[0] = rgb[1] = rgb[2] = 128;
            continue;
        }
        float t = span > 0.0f ? (depth[i] - range.far_depth) / span : 0.5f;
        t = fminf(fmaxf(t, 0.0f), 1.0f) * (ANCHORS - 1);
        int k = t < ANCHORS - 2 ? (int)t : ANCHORS - 2;
        float f = t - (float)k;
        for (int c = 0; c < 3; c++)
            rgb[c] =
                (uint8_t)((1.0f - f) * (float)anchors[k][c] + f * (float)anchors[k + 1][c] + 0.5f);
    }
}

void depth_picture_u16(const float *depth, size_t count, double unit_m, uint16_t *out_steps) {
    for (size_t i = 0; i < count; i++) {
        double steps = 1.0 / ((double)depth[i] * unit_m) + 0.5;
        out_steps[i] = isnan(depth[i])                   ? 0
                       : steps >= 1.0 && steps < 65535.0 ? (uint16_t)steps
                       : steps < 1.0                     ? 1
                                                         : 65535;
    }
}
