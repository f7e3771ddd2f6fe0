#include "raster/metrics.h"

#include <math.h>
#include <stdbool.h>
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

/* The pictures as they were given. */
struct pair {
    const uint8_t *rgba, *truth, *counts;
    int32_t w, h;
};

static bool counted(const struct pair *p, size_t i) {
    return p->rgba[4 * i + 3] == 255 && (!p->counts || p->counts[i]);
}

static void moments_of(const struct pair *p, size_t i, struct moments *out) {
    const uint8_t *rgba = p->rgba + 4 * i, *truth = p->truth + 3 * i;
    double w = counted(p, i) ? 1.0 : 0.0;
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
static void filter_row(const struct pair *p, int32_t y, const double *g, struct moments *scratch,
                       struct moments *out) {
    int32_t w = p->w;
    for (int32_t x = 0; x < w; x++)
        moments_of(p, (size_t)y * (size_t)w + (size_t)x, &scratch[x]);
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

enum { RING = 2 * WINDOW_HALF + 1 };

/* Sum of SSIM over row y; `rows` is the ring of filtered rows. */
static double ssim_row(const struct pair *p, int32_t y, const double *g,
                       const struct moments *rows) {
    int32_t lo = y > WINDOW_HALF ? y - WINDOW_HALF : 0;
    int32_t hi = y + WINDOW_HALF < p->h ? y + WINDOW_HALF : p->h - 1;
    double total = 0;
    for (int32_t x = 0; x < p->w; x++) {
        if (!counted(p, (size_t)y * (size_t)p->w + (size_t)x))
            continue;
        struct moments sum = {{0}};
        for (int32_t i = lo; i <= hi; i++) {
            const struct moments *at = &rows[(size_t)(i % RING) * (size_t)p->w + (size_t)x];
            for (int k = 0; k < CHANNELS; k++)
                sum.m[k] += g[i - y + WINDOW_HALF] * at->m[k];
        }
        total += ssim_of(&sum);
    }
    return total;
}

static enum st ssim_sum(const struct pair *p, double *out_sum) {
    double g[RING];
    gaussian(g);
    size_t w = (size_t)p->w;
    struct moments *rows = calloc(w * (RING + 1), sizeof *rows);
    if (!rows)
        return ST_NOMEM;
    double total = 0;
    for (int32_t y = 0, ready = 0; y < p->h; y++) {
        for (; ready < p->h && ready <= y + WINDOW_HALF; ready++)
            filter_row(p, ready, g, rows + w * RING, rows + (size_t)(ready % RING) * w);
        total += ssim_row(p, y, g, rows);
    }
    free(rows);
    *out_sum = total;
    return ST_OK;
}

enum st metrics_compare(const uint8_t *rgba, const uint8_t *truth_rgb, const uint8_t *counts,
                        int32_t width_px, int32_t height_px, struct metrics *out_metrics) {
    if (width_px < 1 || height_px < 1)
        return ST_INVALID;
    const struct pair pair = {rgba, truth_rgb, counts, width_px, height_px};
    size_t n = (size_t)width_px * (size_t)height_px;
    int64_t covered = 0, squares = 0, all = 0;
    for (size_t i = 0; i < n; i++) {
        all += !counts || counts[i];
        if (!counted(&pair, i))
            continue;
        covered++;
        for (size_t k = 0; k < 3; k++) {
            int d = rgba[4 * i + k] - truth_rgb[3 * i + k];
            squares += d * d;
        }
    }
    double coverage = all ? (double)covered / (double)all : 0.0;
    struct metrics metrics = {(double)NAN, (double)NAN, coverage, covered};
    if (covered) {
        double sum = 0;
        enum st st = ssim_sum(&pair, &sum);
        if (st)
            return st;
        double mse = (double)squares / (3.0 * (double)covered);
        metrics.psnr_db = squares ? 10.0 * log10(255.0 * 255.0 / mse) : (double)INFINITY;
        metrics.ssim = sum / (double)covered;
    }
    *out_metrics = metrics;
    return ST_OK;
}

/* Clears pixel i if it has the rim's colour and still counts, and puts it on the stack. */
static size_t spread(const uint8_t *rgb, const uint8_t rim_rgb[3], size_t i, uint8_t *counts,
                     size_t *stack, size_t depth) {
    if (!counts[i] || memcmp(rgb + 3 * i, rim_rgb, 3) != 0)
        return depth;
    counts[i] = 0;
    stack[depth] = i;
    return depth + 1;
}

int64_t metrics_rim_mask(const uint8_t *rgb, int32_t width_px, int32_t height_px,
                         const uint8_t rim_rgb[3], uint8_t *out_counts) {
    size_t w = (size_t)width_px, h = (size_t)height_px, depth = 0;
    size_t *stack = malloc(w * h * sizeof *stack);
    if (!stack)
        return -1;
    memset(out_counts, 1, w * h);
    for (size_t x = 0; x < w; x++) {
        depth = spread(rgb, rim_rgb, x, out_counts, stack, depth);
        depth = spread(rgb, rim_rgb, (h - 1) * w + x, out_counts, stack, depth);
    }
    for (size_t y = 0; y < h; y++) {
        depth = spread(rgb, rim_rgb, y * w, out_counts, stack, depth);
        depth = spread(rgb, rim_rgb, y * w + w - 1, out_counts, stack, depth);
    }
    while (depth) {
        size_t i = stack[--depth], x = i % w;
        if (x > 0)
            depth = spread(rgb, rim_rgb, i - 1, out_counts, stack, depth);
        if (x + 1 < w)
            depth = spread(rgb, rim_rgb, i + 1, out_counts, stack, depth);
        if (i >= w)
            depth = spread(rgb, rim_rgb, i - w, out_counts, stack, depth);
        if (i + w < w * h)
            depth = spread(rgb, rim_rgb, i + w, out_counts, stack, depth);
    }
    free(stack);
    int64_t count = 0;
    for (size_t i = 0; i < w * h; i++)
        count += out_counts[i];
    return count;
}
