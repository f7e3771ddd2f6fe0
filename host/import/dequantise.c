#include "import/dequantise.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* Below PARALLEL_MIN_PX threads cost more than they bring. */
enum { PARALLEL_MIN_PX = 1 << 16 };
enum { LEVELS_MAX = 12, LEVEL_SIDE_MIN_PX = 8, ITERATIONS_DEFAULT = 120 };

/* Bits of the link map. A pixel's right or lower link is intact if both ends are known and differ
 * by one step at most; a second difference is used if all the links it crosses are intact. */
enum link { LINK_RIGHT = 1, LINK_DOWN = 2, LINK_KNOWN = 4, USE_UU = 8, USE_VV = 16, USE_UV = 32 };

struct level {
    int32_t w, h;
    float *d;      /* [h][w] stored value; unknown: 0 */
    float *x;      /* the iterate */
    float *y;      /* its extrapolation */
    float *q[3];   /* second differences uu, vv, uv at y */
    uint8_t *link; /* enum link */
};

static void level_fini(struct level *l) {
    free(l->d);
    free(l->x);
    free(l->y);
    for (int i = 0; i < 3; i++)
        free(l->q[i]);
    free(l->link);
    memset(l, 0, sizeof *l);
}

static enum st level_init(struct level *l, int32_t w, int32_t h) {
    memset(l, 0, sizeof *l);
    l->w = w;
    l->h = h;
    size_t n = (size_t)w * (size_t)h;
    float **planes[] = {&l->d, &l->x, &l->y, &l->q[0], &l->q[1], &l->q[2]};
    for (size_t i = 0; i < sizeof planes / sizeof planes[0]; i++)
        if (!(*planes[i] = calloc(n, sizeof(float))))
            goto fail;
    if (!(l->link = calloc(n, 1)))
        goto fail;
    return ST_OK;
fail:
    level_fini(l);
    return ST_NOMEM;
}

/* From LINK_RIGHT and LINK_DOWN, which second differences count. */
static void mark_uses(struct level *l) {
    const int32_t w = l->w, h = l->h;
    for (int32_t v = 0; v < h; v++)
        for (int32_t u = 0; u < w; u++) {
            uint8_t *k = l->link + (size_t)v * (size_t)w + u;
            if (u > 0 && (k[0] & LINK_RIGHT) && (k[-1] & LINK_RIGHT))
                k[0] |= USE_UU;
            if (v > 0 && (k[0] & LINK_DOWN) && (k[-w] & LINK_DOWN))
                k[0] |= USE_VV;
            if ((k[0] & LINK_RIGHT) && (k[0] & LINK_DOWN) && (k[1] & LINK_DOWN) &&
                (k[w] & LINK_RIGHT))
                k[0] |= USE_UV;
        }
}

static void finest_from_map(struct level *l, const struct image_f32 *map, float step) {
    const float jump = step * 1.001f; /* one step, whatever the rounding of the map's unit */
    const int32_t w = l->w, h = l->h;
    for (int32_t v = 0; v < h; v++)
        for (int32_t u = 0; u < w; u++) {
            size_t i = (size_t)v * (size_t)w + (size_t)u;
            float a = *image_f32_at(map, u, v);
            if (!isfinite(a))
                continue;
            l->d[i] = a;
            l->link[i] = LINK_KNOWN;
            if (u + 1 < w && fabsf(*image_f32_at(map, u + 1, v) - a) <= jump)
                l->link[i] |= LINK_RIGHT;
            if (v + 1 < h && fabsf(*image_f32_at(map, u, v + 1) - a) <= jump)
                l->link[i] |= LINK_DOWN;
        }
    mark_uses(l);
}

/* A coarse pixel is known where its four fine pixels hang together; coarse neighbours are linked
 * where both fine links across their border are intact. */
static void coarse_from_fine(struct level *c, const struct level *f) {
    const int32_t w = f->w;
    for (int32_t v = 0; v < c->h; v++)
        for (int32_t u = 0; u < c->w; u++) {
            const size_t i = (size_t)v * (size_t)c->w + (size_t)u;
            const size_t j = (size_t)(2 * v) * (size_t)w + (size_t)(2 * u);
            const uint8_t *k = f->link + j;
            if (!((k[0] & LINK_RIGHT) && (k[0] & LINK_DOWN) && (k[1] & LINK_DOWN) &&
                  (k[w] & LINK_RIGHT)))
                continue;
            c->d[i] =
                0.25f * (f->d[j] + f->d[j + 1] + f->d[j + (size_t)w] + f->d[j + (size_t)w + 1]);
            c->link[i] = LINK_KNOWN;
            if (u + 1 < c->w && (k[1] & LINK_RIGHT) && (k[w + 1] & LINK_RIGHT))
                c->link[i] |= LINK_RIGHT;
            if (v + 1 < c->h && (k[w] & LINK_DOWN) && (k[w + 1] & LINK_DOWN))
                c->link[i] |= LINK_DOWN;
        }
    for (int32_t v = 0; v < c->h; v++) /* a link needs both ends */
        for (int32_t u = 0; u < c->w; u++) {
            uint8_t *k = c->link + (size_t)v * (size_t)c->w + u;
            if ((k[0] & LINK_RIGHT) && !(k[1] & LINK_KNOWN))
                k[0] = (uint8_t)(k[0] & ~LINK_RIGHT);
            if ((k[0] & LINK_DOWN) && !(k[c->w] & LINK_KNOWN))
                k[0] = (uint8_t)(k[0] & ~LINK_DOWN);
        }
    mark_uses(c);
}

/* Slope per pixel along one axis from the intact links, 0 where there is none. */
static float slope(const float *x, const uint8_t *k, ptrdiff_t stride, bool has_before,
                   uint8_t link) {
    float before = has_before && (k[-stride] & link) ? x[0] - x[-stride] : NAN;
    float after = k[0] & link ? x[stride] - x[0] : NAN;
    if (isnan(before))
        return isnan(after) ? 0.0f : after;
    return isnan(after) ? before : 0.5f * (before + after);
}

static inline float clamp(float a, float low, float high) {
    return a < low ? low : a > high ? high : a;
}

/* Starts the fine iterate from the coarse solution, inside the intervals. */
static void refine(struct level *f, const struct level *c, float half) {
    for (int32_t v = 0; v < f->h; v++)
        for (int32_t u = 0; u < f->w; u++) {
            const size_t j = (size_t)v * (size_t)f->w + (size_t)u;
            f->x[j] = f->d[j];
            const int32_t cu = u / 2, cv = v / 2;
            if (!c || cu >= c->w || cv >= c->h)
                continue;
            const size_t i = (size_t)cv * (size_t)c->w + (size_t)cu;
            const uint8_t *k = c->link + i;
            if (!(k[0] & LINK_KNOWN))
                continue;
            float su = slope(c->x + i, k, 1, cu > 0, LINK_RIGHT);
            float sv = slope(c->x + i, k, c->w, cv > 0, LINK_DOWN);
            float a = c->x[i] + (u % 2 ? 0.25f : -0.25f) * su + (v % 2 ? 0.25f : -0.25f) * sv;
            f->x[j] = clamp(a, f->d[j] - half, f->d[j] + half);
        }
}

static void second_differences(struct level *l) {
    const int32_t w = l->w, h = l->h;
#pragma omp parallel for schedule(static) if (h * (int64_t)w >= PARALLEL_MIN_PX)
    for (int32_t v = 0; v < h; v++) {
        const size_t row = (size_t)v * (size_t)w;
        const float *y = l->y + row;
        const uint8_t *k = l->link + row;
        for (int32_t u = 0; u < w; u++) {
            l->q[0][row + (size_t)u] = k[u] & USE_UU ? y[u - 1] - 2.0f * y[u] + y[u + 1] : 0.0f;
            l->q[1][row + (size_t)u] = k[u] & USE_VV ? y[u - w] - 2.0f * y[u] + y[u + w] : 0.0f;
            l->q[2][row + (size_t)u] =
                k[u] & USE_UV ? y[u] - y[u + 1] - y[u + w] + y[u + w + 1] : 0.0f;
        }
    }
}

/* x <- clamp(y - g / 64), y <- x + momentum (x - x_old). 64 bounds the largest eigenvalue of the
 * energy's second derivative: (4 + 4)^2, reached by the checkerboard. */
static void gradient_step(struct level *l, float half, float momentum) {
    const int32_t w = l->w, h = l->h;
#pragma omp parallel for schedule(static) if (h * (int64_t)w >= PARALLEL_MIN_PX)
    for (int32_t v = 0; v < h; v++) {
        const size_t row = (size_t)v * (size_t)w;
        const float *uu = l->q[0] + row, *vv = l->q[1] + row, *uv = l->q[2] + row;
        const float *d = l->d + row;
        float *x = l->x + row, *y = l->y + row;
        for (int32_t u = 0; u < w; u++) {
            float g = -2.0f * (uu[u] + vv[u]) + 2.0f * uv[u];
            g += u > 0 ? uu[u - 1] - 2.0f * uv[u - 1] : 0.0f;
            g += u + 1 < w ? uu[u + 1] : 0.0f;
            g += v > 0 ? vv[u - w] - 2.0f * uv[u - w] : 0.0f;
            g += v + 1 < h ? vv[u + w] : 0.0f;
            g += u > 0 && v > 0 ? 2.0f * uv[u - w - 1] : 0.0f;
            float next = clamp(y[u] - g * (1.0f / 64.0f), d[u] - half, d[u] + half);
            y[u] = next + momentum * (next - x[u]);
            x[u] = next;
        }
    }
}

static void solve_level(struct level *l, float half, int32_t iterations) {
    memcpy(l->y, l->x, (size_t)l->w * (size_t)l->h * sizeof(float));
    float t = 1.0f;
    for (int32_t i = 0; i < iterations; i++) {
        float t_next = 0.5f * (1.0f + sqrtf(1.0f + 4.0f * t * t));
        second_differences(l);
        gradient_step(l, half, (t - 1.0f) / t_next);
        t = t_next;
    }
}

static enum st build_pyramid(const struct image_f32 *map, float step, struct level *levels,
                             int32_t *out_count) {
    enum st st = level_init(&levels[0], map->width_px, map->height_px);
    if (st)
        return st;
    *out_count = 1;
    finest_from_map(&levels[0], map, step);
    while (*out_count < LEVELS_MAX) {
        const struct level *f = &levels[*out_count - 1];
        if (f->w / 2 < LEVEL_SIDE_MIN_PX || f->h / 2 < LEVEL_SIDE_MIN_PX)
            break;
        st = level_init(&levels[*out_count], f->w / 2, f->h / 2);
        if (st)
            return st;
        coarse_from_fine(&levels[*out_count], f);
        (*out_count)++;
    }
    return ST_OK;
}

/* Where a surface crosses from one stored value to the next its value is known well; in between,
 * the wider the plateau, the less. On surfaces made for it (spheres, waves, cones, planes,
 * paraboloids) the estimate errs by 0.125 steps rms at most where it climbs at 0.01 steps a pixel
 * or faster, and by up to 0.4 steps on plateaus wider than 300 pixels. tests/unit/test_dequantise.c
 * holds that the figure is not below the error on such surfaces. */
static float sigma_steps(float slope_steps_per_px) {
    const float climbing = 0.125f, plateau = 0.4082f /* sqrt(1/6): two uniform errors */;
    if (slope_steps_per_px * plateau <= 0.00125f)
        return plateau;
    return clamp(0.00125f / slope_steps_per_px, climbing, plateau);
}

static float sigma_at(const struct level *l, int32_t u, int32_t v, float step) {
    const size_t i = (size_t)v * (size_t)l->w + (size_t)u;
    const uint8_t *k = l->link + i;
    bool linked = (k[0] & (LINK_RIGHT | LINK_DOWN)) || (u > 0 && (k[-1] & LINK_RIGHT)) ||
                  (v > 0 && (k[-l->w] & LINK_DOWN));
    if (!(k[0] & LINK_KNOWN))
        return NAN;
    if (!linked)
        return step * 0.288675f; /* sqrt(1/12): uniform over the interval */
    float su = slope(l->x + i, k, 1, u > 0, LINK_RIGHT);
    float sv = slope(l->x + i, k, l->w, v > 0, LINK_DOWN);
    return step * sigma_steps(sqrtf(su * su + sv * sv) / step);
}

static void write_result(const struct level *l, float step, struct image_f32 *out_map,
                         struct image_f32 *out_sigma) {
    for (int32_t v = 0; v < l->h; v++)
        for (int32_t u = 0; u < l->w; u++) {
            size_t i = (size_t)v * (size_t)l->w + (size_t)u;
            *image_f32_at(out_map, u, v) = l->link[i] & LINK_KNOWN ? l->x[i] : NAN;
            if (out_sigma)
                *image_f32_at(out_sigma, u, v) = sigma_at(l, u, v, step);
        }
}

enum st dequantise(const struct image_f32 *map, const struct dequantise_options *options,
                   struct image_f32 *out_map, struct image_f32 *out_sigma, struct errctx *err) {
    const int32_t w = map->width_px, h = map->height_px;
    if (!(options->step > 0.0f) || !isfinite(options->step) || options->iterations < 0)
        return errctx_set(err, ST_INVALID, "quantisation step %g is not a positive number",
                          (double)options->step);
    if (map->channels != 1 || out_map->channels != 1 || out_map->width_px != w ||
        out_map->height_px != h ||
        (out_sigma && (out_sigma->width_px != w || out_sigma->height_px != h)))
        return errctx_set(err, ST_INVALID, "the maps have different sizes");
    if (w == 0 || h == 0)
        return ST_OK;

    struct level levels[LEVELS_MAX];
    memset(levels, 0, sizeof levels);
    int32_t count = 0;
    const int32_t iterations = options->iterations ? options->iterations : ITERATIONS_DEFAULT;
    enum st st = build_pyramid(map, options->step, levels, &count);
    if (st) {
        st = errctx_set(err, st, "no memory to dequantise %d x %d pixels", w, h);
        goto out;
    }
    for (int32_t i = count - 1; i >= 0; i--) {
        refine(&levels[i], i + 1 < count ? &levels[i + 1] : NULL, 0.5f * options->step);
        /* Halving the pixels along a side pays for twice the iterations, which a smooth shape
         * needs. */
        solve_level(&levels[i], 0.5f * options->step, iterations << (i < 5 ? i : 5));
    }
    write_result(&levels[0], options->step, out_map, out_sigma);
out:
    for (int32_t i = 0; i < count; i++)
        level_fini(&levels[i]);
    return st;
}
