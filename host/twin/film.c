#include "twin/film.h"

#include "base/rng.h"

#include <math.h>
#include <string.h>

static float luminance(const float *c) {
    return 0.2126f * c[0] + 0.7152f * c[1] + 0.0722f * c[2];
}

/* How alike the surfaces of two pixels are, 0..1: normals within 45 deg, depth within a few per
 * cent. */
static float alike(const struct film *f, size_t at, size_t to, int step) {
    const float *n = f->normal + 3 * at, *m = f->normal + 3 * to;
    float dot = n[0] * m[0] + n[1] * m[1] + n[2] * m[2], depth = f->depth_m[at];
    float d = (f->depth_m[to] - depth) / (0.02f * depth * (float)step + 1e-3f);
    if (dot <= 0.7f || d * d > 9)
        return 0;
    dot *= dot;
    dot *= dot;
    dot *= dot;
    return dot * dot / (1 + d * d);
}

/* One pass with holes of `step` pixels from `in` to `out`. With `tolerance`, light that differs by
 * much more than that does not mix. */
static void pass(const struct film *f, const float *in, float *out, int step,
                 const float *tolerance) {
    static const float kernel[5] = {1 / 16.0f, 1 / 4.0f, 3 / 8.0f, 1 / 4.0f, 1 / 16.0f};
    int w = f->width_px, h = f->height_px;
#pragma omp parallel for schedule(dynamic, 4)
    for (int y = 0; y < h; y++) {
        for (int x = 0; x < w; x++) {
            size_t at = (size_t)y * (size_t)w + (size_t)x;
            float here = luminance(in + 3 * at), total = 0, sum[3] = {0, 0, 0};
            for (int dy = -2; dy <= 2; dy++) {
                for (int dx = -2; dx <= 2; dx++) {
                    int u = x + dx * step, v = y + dy * step;
                    if (u < 0 || v < 0 || u >= w || v >= h)
                        continue;
                    size_t to = (size_t)v * (size_t)w + (size_t)u;
                    float k = kernel[dx + 2] * kernel[dy + 2] * alike(f, at, to, step);
                    if (k > 0 && tolerance)
                        k *= expf(-fabsf(luminance(in + 3 * to) - here) / tolerance[at]);
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

/* The second smallest and second largest luminance of the like neighbours; false if there are few.
 */
static int neighbours(const struct film *f, const float *plane, int x, int y, float out[2]) {
    float low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    int count = 0;
    for (int i = 0; i < 9; i++) {
        int u = x + i % 3 - 1, v = y + i / 3 - 1;
        if (i == 4 || u < 0 || v < 0 || u >= f->width_px || v >= f->height_px)
            continue;
        size_t at = (size_t)y * (size_t)f->width_px + (size_t)x;
        size_t to = (size_t)v * (size_t)f->width_px + (size_t)u;
        if (alike(f, at, to, 1) < 0.05f)
            continue;
        float l = luminance(plane + 3 * to);
        count++;
        low[1] = l < low[0] ? low[0] : l < low[1] ? l : low[1];
        low[0] = l < low[0] ? l : low[0];
        high[1] = l > high[0] ? high[0] : l > high[1] ? l : high[1];
        high[0] = l > high[0] ? l : high[0];
    }
    out[0] = low[1];
    out[1] = high[1];
    return count >= 5;
}

/* Pulls single pixels that stick out to their neighbours' level. */
static void despeckle(struct film *f, float *plane) {
    int w = f->width_px, h = f->height_px;
#pragma omp parallel for schedule(dynamic, 4)
    for (int y = 0; y < h; y++) {
        for (int x = 0; x < w; x++) {
            size_t at = (size_t)y * (size_t)w + (size_t)x;
            float bound[2], here = luminance(plane + 3 * at), to = here;
            if (neighbours(f, plane, x, y, bound))
                to = here < bound[0] ? bound[0] : here > bound[1] ? bound[1] : here;
            for (size_t i = 0; i < 3; i++) {
                float v = plane[3 * at + i];
                f->scratch[3 * at + i] = here > 1e-6f ? v * to / here : to;
            }
        }
    }
    memcpy(plane, f->scratch, (size_t)w * (size_t)h * 3 * sizeof *plane);
}

/* Variance to the difference of light that noise explains: mean over 5 x 5, three deviations and a
 * little. */
static void tolerances(struct film *f, float *out) {
    int w = f->width_px, h = f->height_px;
#pragma omp parallel for schedule(dynamic, 4)
    for (int y = 0; y < h; y++) {
        for (int x = 0; x < w; x++) {
            size_t at = (size_t)y * (size_t)w + (size_t)x;
            float sum = 0, total = 0;
            for (int i = 0; i < 25; i++) {
                int u = x + i % 5 - 2, v = y + i / 5 - 2;
                if (u < 0 || v < 0 || u >= w || v >= h)
                    continue;
                size_t to = (size_t)v * (size_t)w + (size_t)u;
                float k = alike(f, at, to, 1);
                sum += k * f->variance[to];
                total += k;
            }
            float here = luminance(f->direct + 3 * at);
            out[at] = 3 * sqrtf(total > 0 ? sum / total : 0) + 0.03f * here + 1e-4f;
        }
    }
}

void film_filter(struct film *film) {
    size_t count = (size_t)film->width_px * (size_t)film->height_px,
           bytes = count * 3 * sizeof(float);
    despeckle(film, film->direct);
    despeckle(film, film->added);
    tolerances(film, film->scratch);
    memcpy(film->variance, film->scratch, count * sizeof(float));
    for (int i = 0; i < 4; i++) {
        pass(film, film->direct, film->scratch, 1 << i, film->variance);
        memcpy(film->direct, film->scratch, bytes);
        for (size_t k = 0; k < count; k++)
            film->variance[k] *= 0.6f;
    }
    for (int i = 0; i < 5; i++) {
        pass(film, film->indirect, film->scratch, 1 << i, NULL);
        memcpy(film->indirect, film->scratch, bytes);
    }
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
        g[i] = over > 0 ? (over < 15 * (float)white ? over : 15 * (float)white) : 0;
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
    add_glare(film, white, side / 220 + 1, 0.25f);
    add_glare(film, white, side / 60 + 1, 0.07f);
    add_glare(film, white, side / 14 + 1, 0.03f);
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
