#include "twin/film.h"

#include "base/rng.h"

#include <math.h>
#include <string.h>

static float luminance(const float *c) {
    return 0.2126f * c[0] + 0.7152f * c[1] + 0.0722f * c[2];
}

/* One pass with holes of `step` pixels from `in` to `out`. sigma: how different light may be,
 * relative; 0: any. */
static void pass(const struct film *f, const float *in, float *out, int step, float sigma) {
    static const float kernel[5] = {1 / 16.0f, 1 / 4.0f, 3 / 8.0f, 1 / 4.0f, 1 / 16.0f};
    int w = f->width_px, h = f->height_px;
#pragma omp parallel for schedule(dynamic, 4)
    for (int y = 0; y < h; y++) {
        for (int x = 0; x < w; x++) {
            size_t at = (size_t)y * (size_t)w + (size_t)x;
            const float *n = f->normal + 3 * at;
            float depth = f->depth_m[at], here = luminance(in + 3 * at), total = 0,
                  sum[3] = {0, 0, 0};
            for (int dy = -2; dy <= 2; dy++) {
                for (int dx = -2; dx <= 2; dx++) {
                    int u = x + dx * step, v = y + dy * step;
                    if (u < 0 || v < 0 || u >= w || v >= h)
                        continue;
                    size_t to = (size_t)v * (size_t)w + (size_t)u;
                    const float *m = f->normal + 3 * to;
                    float k = kernel[dx + 2] * kernel[dy + 2];
                    float dot = n[0] * m[0] + n[1] * m[1] + n[2] * m[2];
                    float d = (f->depth_m[to] - depth) / (0.02f * depth * (float)step + 1e-3f);
                    if (dot <= 0.5f || d * d > 9)
                        continue;
                    dot *= dot;
                    dot *= dot;
                    dot *= dot;
                    k *= dot * dot / (1 + d * d);
                    if (sigma > 0) {
                        float l = (luminance(in + 3 * to) - here) / (sigma * (here + 0.02f));
                        k /= 1 + l * l;
                    }
                    total += k;
                    for (int i = 0; i < 3; i++)
                        sum[i] += k * in[3 * to + (size_t)i];
                }
            }
            for (int i = 0; i < 3; i++)
                out[3 * at + (size_t)i] = total > 0 ? sum[i] / total : in[3 * at + (size_t)i];
        }
    }
}

static void filter_plane(struct film *f, float *plane, int passes, float sigma) {
    size_t bytes = (size_t)f->width_px * (size_t)f->height_px * 3 * sizeof *plane;
    for (int i = 0; i < passes; i++) {
        pass(f, plane, f->scratch, 1 << i, sigma);
        memcpy(plane, f->scratch, bytes);
    }
}

void film_filter(struct film *film) {
    filter_plane(film, film->indirect, 5, 0);
    filter_plane(film, film->direct, 2, 0.5f);
}

/* Box blur of rows (stride 3) or columns with radius r. */
static void blur_line(float *line, size_t stride, int count, int r, float *copy) {
    for (int c = 0; c < 3; c++) {
        double sum = 0;
        for (int i = 0; i < count; i++)
            copy[i] = line[(size_t)i * stride + (size_t)c];
        for (int i = -r; i <= r; i++)
            sum += (double)copy[i < 0 ? 0 : i >= count ? count - 1 : i];
        for (int i = 0; i < count; i++) {
            line[(size_t)i * stride + (size_t)c] = (float)(sum / (2 * r + 1));
            int in = i + r + 1 < count ? i + r + 1 : count - 1, out = i - r > 0 ? i - r : 0;
            sum += (double)copy[in] - (double)copy[out];
        }
    }
}

/* Adds `strength` of what is brighter than white, spread with about `radius_px`. */
static void add_glare(struct film *f, double white, int radius_px, float strength) {
    int w = f->width_px, h = f->height_px;
    size_t count = (size_t)w * (size_t)h * 3;
    float *g = f->scratch, *copy = f->indirect; /* no longer needed */
    for (size_t i = 0; i < count; i++) {
        float over = f->direct[i] - (float)white;
        g[i] = over > 0 ? (over < 40 * (float)white ? over : 40 * (float)white) : 0;
    }
    for (int round = 0; round < 3; round++) { /* three boxes are nearly a bell */
        for (int y = 0; y < h; y++)
            blur_line(g + (size_t)y * (size_t)w * 3, 3, w, radius_px, copy);
        for (int x = 0; x < w; x++)
            blur_line(g + (size_t)x * 3, (size_t)w * 3, h, radius_px, copy);
    }
    for (size_t i = 0; i < count; i++)
        f->direct[i] += strength * g[i];
}

void film_compose(struct film *film, double white) {
    size_t count = (size_t)film->width_px * (size_t)film->height_px * 3;
    for (size_t i = 0; i < count; i++)
        film->direct[i] = film->albedo[i] * (film->direct[i] + film->indirect[i]) + film->added[i];
    int side = film->width_px < film->height_px ? film->width_px : film->height_px;
    add_glare(film, white, side / 160 + 1, 0.25f);
    add_glare(film, white, side / 28 + 1, 0.35f);
}

/* Shoulder and toe of a print (Narkowicz 2015), then the sRGB transfer function. */
static double tone(double x) {
    double y = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14);
    y = y < 0 ? 0 : y > 1 ? 1 : y;
    return y <= 0.0031308 ? 12.92 * y : 1.055 * pow(y, 1 / 2.4) - 0.055;
}

void film_develop(const struct film *film, const struct film_sensor *sensor, uint8_t *out_rgb) {
    int w = film->width_px, h = film->height_px;
    double corner2 = 0.25 * ((double)w * w + (double)h * h);
#pragma omp parallel for schedule(static)
    for (int y = 0; y < h; y++) {
        struct rng rng = rng_stream(sensor->seed ^ 0xf11f11u, (uint64_t)y);
        for (int x = 0; x < w; x++) {
            size_t at = 3 * ((size_t)y * (size_t)w + (size_t)x);
            double dx = x - 0.5 * (w - 1), dy = y - 0.5 * (h - 1);
            double fall = 1 - sensor->vignetting * (dx * dx + dy * dy) / corner2;
            for (size_t i = 0; i < 3; i++) {
                double v = (double)film->direct[at + i] / sensor->white * fall;
                if (sensor->full_well > 0) {
                    double shot = sqrt((v > 0 ? v : 0) / sensor->full_well);
                    v += sqrt(shot * shot + sensor->noise * sensor->noise) * rng_normal(&rng);
                }
                out_rgb[at + i] = (uint8_t)(255 * tone(v > 0 ? v : 0) + 0.5);
            }
        }
    }
}
