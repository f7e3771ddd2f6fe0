#include "raster/skin.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

struct skin_params skin_params_default(void) {
    /* Four sigmas of a difference: one cell in 16 000 by chance. 80 degrees: at 3 m and 1 mrad a
     * sample, a step of 17 mm. Unknown noise: half a pixel of parallax at one pixel baseline is
     * nothing. */
    struct skin_params params = {.sigmas = 4.0, .grazing_rad = 80.0 * 3.14159265358979 / 180.0};
    return params;
}

struct marker {
    const struct photo *photo;
    double sigmas, graze_x, graze_y, sigma_unknown;
    double sigma_per_m[256];
};

static struct marker marker_make(const struct photo *photo, const struct skin_params *params) {
    struct marker m = {.photo = photo, .sigmas = params->sigmas};
    m.graze_x = tan(params->grazing_rad) / photo->camera.fx_px;
    m.graze_y = tan(params->grazing_rad) / photo->camera.fy_px;
    m.sigma_unknown = params->sigma_unknown_px / photo->camera.fx_px;
    m.sigma_per_m[0] = NAN;
    for (int i = 1; i < 256; i++)
        m.sigma_per_m[i] = photo_sigma_from_confidence((uint8_t)i);
    return m;
}

static double sigma_at(const struct marker *m, size_t i) {
    double sigma = m->sigma_per_m[m->photo->confidence[i]];
    return isnan(sigma) ? m->sigma_unknown * (double)m->photo->disparity_per_m[i] : sigma;
}

/* Does the surface break between pixels i and i + step? `before` and `after` say whether i - step
 * and i + 2 step are in the picture. */
static bool breaks(const struct marker *m, size_t i, size_t step, bool before, bool after,
                   double graze) {
    const float *d = m->photo->disparity_per_m;
    double a = (double)d[i], b = (double)d[i + step];
    double jump = fabs(b - a);
    double sa = sigma_at(m, i), sb = sigma_at(m, i + step);
    double noise = m->sigmas * sqrt(sa * sa + sb * sb);
    double limit = graze * fmin(a, b) + noise;
    if (!(jump > limit))
        return false;
    /* An affine continuation errs by three times the noise of a single disparity at most. */
    double slack = 2.0 * noise;
    if (before && !isnan(d[i - step]) &&
        fabs(2.0 * a - (double)d[i - step] - b) <= fmax(slack, 0.1 * jump))
        return false;
    if (after && !isnan(d[i + 2 * step]) &&
        fabs(2.0 * b - (double)d[i + 2 * step] - a) <= fmax(slack, 0.1 * jump))
        return false;
    return true;
}

/* Marks both pixels of a break, and the cells that have the pair for an edge. */
static void mark_break(struct photo *photo, size_t i, size_t step, size_t across, bool has_before) {
    const float *d = photo->disparity_per_m;
    size_t far_side = d[i] < d[i + step] ? i : i + step;
    photo->flags[i] |= PHOTO_SILHOUETTE | PHOTO_SKIN;
    photo->flags[i + step] |= PHOTO_SILHOUETTE;
    photo->flags[far_side] |= PHOTO_MIXED;
    if (has_before)
        photo->flags[i - across] |= PHOTO_SKIN;
}

int64_t skin_mark(struct photo *photo, const struct skin_params *params) {
    size_t w = (size_t)photo->camera.width_px, h = (size_t)photo->camera.height_px;
    struct marker m = marker_make(photo, params);
    const float *d = photo->disparity_per_m;
    for (size_t i = 0; i < w * h; i++)
        photo->flags[i] &= (uint8_t) ~(PHOTO_SKIN | PHOTO_SILHOUETTE);
    for (size_t y = 0; y < h; y++)
        for (size_t x = 0; x < w; x++) {
            size_t i = y * w + x;
            if (isnan(d[i]))
                continue;
            if (x + 1 < w && !isnan(d[i + 1]) && breaks(&m, i, 1, x > 0, x + 2 < w, m.graze_x))
                mark_break(photo, i, 1, w, y > 0);
            if (y + 1 < h && !isnan(d[i + w]) && breaks(&m, i, w, y > 0, y + 2 < h, m.graze_y))
                mark_break(photo, i, w, 1, x > 0);
        }
    int64_t count = 0;
    for (size_t i = 0; i < w * h; i++)
        count += (photo->flags[i] & PHOTO_SKIN) != 0;
    return count;
}

/* ---- cracks ---- */

/* Fills the run of `n` pixels after pixel i if what bounds it is one surface. */
static int64_t fill_run(struct photo *photo, const struct marker *m, size_t i, size_t step,
                        size_t n, double graze) {
    float *d = photo->disparity_per_m;
    size_t end = i + (n + 1) * step;
    double a = (double)d[i], b = (double)d[end];
    double sa = sigma_at(m, i), sb = sigma_at(m, end);
    double limit = graze * fmin(a, b) * (double)(n + 1) + m->sigmas * sqrt(sa * sa + sb * sb);
    if (!(fabs(b - a) <= limit))
        return 0;
    uint8_t worse = photo->confidence[i] < photo->confidence[end] ? photo->confidence[i]
                                                                  : photo->confidence[end];
    for (size_t k = 1; k <= n; k++) {
        size_t at = i + k * step;
        d[at] = (float)(a + (b - a) * (double)k / (double)(n + 1));
        photo->flags[at] = (uint8_t)((photo->flags[at] & ~PHOTO_DROPPED) | PHOTO_FILLED);
        photo->confidence[at] = worse;
    }
    return (int64_t)n;
}

/* One row or column of `count` pixels. */
static int64_t fill_line(struct photo *photo, const struct marker *m, size_t first, size_t count,
                         size_t step, double graze) {
    int64_t filled = 0;
    size_t last = count; /* the last pixel with a disparity; count: none yet */
    bool free_space = false;
    for (size_t k = 0; k < count; k++) {
        size_t i = first + k * step;
        if (isnan(photo->disparity_per_m[i])) {
            free_space = free_space || photo->flags[i] & PHOTO_NO_RETURN;
            continue;
        }
        size_t gap = last < count ? k - last - 1 : 0;
        if (gap && gap <= SKIN_CRACK_PX && !free_space)
            filled += fill_run(photo, m, first + last * step, step, gap, graze);
        last = k;
        free_space = false;
    }
    return filled;
}

int64_t skin_fill_cracks(struct photo *photo, const struct skin_params *params) {
    size_t w = (size_t)photo->camera.width_px, h = (size_t)photo->camera.height_px;
    struct marker m = marker_make(photo, params);
    int64_t filled = 0;
    for (size_t y = 0; y < h; y++)
        filled += fill_line(photo, &m, y * w, w, 1, m.graze_x);
    for (size_t x = 0; x < w; x++)
        filled += fill_line(photo, &m, x, h, w, m.graze_y);
    return filled;
}

/* ---- the unknown ---- */

static float farther(float a, float b) {
    return isnan(a) || b < a ? b : a;
}

/* One sweep over rows or columns: the nearest seen disparity before each unknown pixel lowers its
 * guess. */
static void sweep(const struct photo *photo, float *guess, size_t first, size_t count,
                  ptrdiff_t step) {
    float last = NAN;
    ptrdiff_t at = (ptrdiff_t)first;
    for (size_t k = 0; k < count; k++, at += step) {
        float d = photo->disparity_per_m[at];
        if (!isnan(d))
            last = d;
        else if (!isnan(last))
            guess[at] = farther(guess[at], last);
    }
}

/* Marks in `wide` the unknown pixels that lie in a block of HOLE_PX x HOLE_PX unknown ones: the
 * opening of the unknown by that block. */
enum { HOLE_PX = 3 };

static bool block_unknown(const struct photo *photo, const float *guess, size_t x, size_t y) {
    size_t w = (size_t)photo->camera.width_px;
    for (size_t j = 0; j < HOLE_PX; j++)
        for (size_t i = 0; i < HOLE_PX; i++) {
            size_t at = (y + j) * w + x + i;
            if (isnan(guess[at]) || photo->flags[at] & PHOTO_NO_RETURN)
                return false;
        }
    return true;
}

static void mark_wide(const struct photo *photo, const float *guess, uint8_t *wide) {
    size_t w = (size_t)photo->camera.width_px, h = (size_t)photo->camera.height_px;
    for (size_t y = 0; y + HOLE_PX <= h; y++)
        for (size_t x = 0; x + HOLE_PX <= w; x++)
            if (block_unknown(photo, guess, x, y))
                for (size_t j = 0; j < HOLE_PX; j++)
                    memset(wide + (y + j) * w + x, 1, HOLE_PX);
}

enum st skin_bound_unknown(struct photo *photo, int64_t *out_count) {
    size_t w = (size_t)photo->camera.width_px, h = (size_t)photo->camera.height_px;
    float *guess = malloc(w * h * sizeof *guess);
    uint8_t *wide = calloc(w * h, 1);
    if (!guess || !wide) {
        free(guess);
        free(wide);
        return ST_NOMEM;
    }
    for (size_t i = 0; i < w * h; i++)
        guess[i] = NAN;
    for (size_t y = 0; y < h; y++) {
        sweep(photo, guess, y * w, w, 1);
        sweep(photo, guess, y * w + w - 1, w, -1);
    }
    for (size_t x = 0; x < w; x++) {
        sweep(photo, guess, x, h, (ptrdiff_t)w);
        sweep(photo, guess, (h - 1) * w + x, h, -(ptrdiff_t)w);
    }
    mark_wide(photo, guess, wide);
    int64_t count = 0;
    for (size_t y = 0; y < h; y++)
        for (size_t x = 0; x < w; x++) {
            size_t i = y * w + x;
            if (!wide[i])
                continue;
            photo->disparity_per_m[i] = guess[i];
            photo->flags[i] |= PHOTO_DROPPED | PHOTO_FILLED | PHOTO_SKIN;
            if (x)
                photo->flags[i - 1] |= PHOTO_SKIN;
            if (y)
                photo->flags[i - w] |= PHOTO_SKIN;
            if (x && y)
                photo->flags[i - w - 1] |= PHOTO_SKIN;
            count++;
        }
    free(guess);
    free(wide);
    if (out_count)
        *out_count = count;
    return ST_OK;
}
