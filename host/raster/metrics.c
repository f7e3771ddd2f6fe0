#include "raster/metrics.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WINDOW_HALF = 5, CHANNELS = 6 };
#define WINDOW_SIGMA_PX 1.5
#define C1              ((0.01 * 255.0) * (0.01 * 255.0))
#define C2              ((0.03 * 255.0) * (0.03 * 255.0))

static double luma(const uint8_t *rgb) {
    return 0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2];
}

/* Weighted moments of one pixel, or sums of them: weight, a, b, aa, bb, ab. */
struct moments {
    double m[CHANNELS];
};

static void moments_of(const uint8_t *rgba, const uint8_t *truth, struct moments *out) {
    double w = rgba[3] == 255 ? 1.0 : 0.0;
    double a = w * luma(rgba), b = w * luma(truth);
    *out = (struct moments){{w, a, b, a * a, b * b, a * b}};
}

static double ssim_of(const struct moments *s) {
    double w = s->m[0], ma = s->m[1] / w, mb = s->m[2] / w;
    double va = s->m[3] / w - ma * ma, vb = s->m[4] / w - mb * mb, ab = s->m[5] / w - ma * mb;
    return (2.0 * ma * mb + C1) * (2.0 * ab + C2) / ((ma * ma + mb * mb + C1) * (va + vb + C2));
}

static void gaussian(double g[2 * WINDOW_HALF + 1]) {
    for (int i = -WINDOW_HALF; i <= WINDOW_HALF; i++)
        g[i + WINDOW_HALF] = exp(-0.5 * i * i / (WINDOW_SIGMA_PX * WINDOW_SIGMA_PX));
}

/* Row y, filtered along x. */
static void filter_row(const uint8_t *rgba, const uint8_t *truth, int32_t w, const double *g,
                       struct moments *scratch, struct moments *out) {
    for (int32_t x = 0; x < w; x++)
        moments_of(rgba + 4 * (size_t)x, truth + 3 * (size_t)x, &scratch[x]);
    for (int32_t x = 0; x < w; x++) {
        int32_t lo = x > WINDOW_HALF ? x - WINDOW_HALF : 0;
        int32_t hi = x + WINDOW_HALF < w ? x + WINDOW_HALF : w - 1;
        struct moments sum = {{0}};
        for (int32_t i = lo; i <= hi; i++)
            for (int k = 0; k < CHANNELS; k++)
                sum.m[k] += g[i - x + WINDOW_HALF] * scratch[i].m[k];
        out[x] = sum;
    }
}

/* Sum of SSIM over the covered pixels, a ring of filtered rows at a time. */
static enum st ssim_sum(const uint8_t *rgba, const uint8_t *truth, int32_t w, int32_t h,
                        double *out_sum) {
    enum { RING = 2 * WINDOW_HALF + 1 };
    double g[RING];
    gaussian(g);
    struct moments *rows = calloc((size_t)w * (RING + 1), sizeof *rows);
    if (!rows)
        return ST_NOMEM;
    struct moments *scratch = rows + (size_t)w * RING;
    double total = 0;
    for (int32_t y = 0, ready = 0; y < h; y++) {
        for (; ready < h && ready <= y + WINDOW_HALF; ready++)
            filter_row(rgba + 4 * (size_t)ready * (size_t)w, truth + 3 * (size_t)ready * (size_t)w,
                       w, g, scratch, rows + (size_t)(ready % RING) * (size_t)w);
        int32_t lo = y > WINDOW_HALF ? y - WINDOW_HALF : 0;
        int32_t hi = y + WINDOW_HALF < h ? y + WINDOW_HALF : h - 1;
        double row_total = 0;
        for (int32_t x = 0; x < w; x++) {
            if (rgba[4 * ((size_t)y * (size_t)w + (size_t)x) + 3] != 255)
                continue;
            struct moments sum = {{0}};
            for (int32_t i = lo; i <= hi; i++)
                for (int k = 0; k < CHANNELS; k++)
                    sum.m[k] += g[i - y + WINDOW_HALF] *
                                rows[(size_t)(i % RING) * (size_t)w + (size_t)x].m[k];
            row_total += ssim_of(&sum);
        }
        total += row_total;
    }
    free(rows);
    *out_sum = total;
    return ST_OK;
}

enum st metrics_compare(const uint8_t *rgba, const uint8_t *truth_rgb, int32_t width_px,
                        int32_t height_px, struct metrics *out_metrics) {
    if (width_px < 1 || height_px < 1)
        return ST_INVALID;
    size_t n = (size_t)width_px * (size_t)height_px;
    int64_t covered = 0, squares = 0;
    for (size_t i = 0; i < n; i++) {
        if (rgba[4 * i + 3] != 255)
            continue;
        covered++;
        for (size_t k = 0; k < 3; k++) {
            int d = rgba[4 * i + k] - truth_rgb[3 * i + k];
            squares += d * d;
        }
    }
    struct metrics metrics = {NAN, NAN, (double)covered / (double)n, covered};
    if (covered) {
        double sum = 0;
        enum st st = ssim_sum(rgba, truth_rgb, width_px, height_px, &sum);
        if (st)
            return st;
        double mse = (double)squares / (3.0 * (double)covered);
        metrics.psnr_db = squares ? 10.0 * log10(255.0 * 255.0 / mse) : (double)INFINITY;
        metrics.ssim = sum / (double)covered;
    }
    *out_metrics = metrics;
    return ST_OK;
}
