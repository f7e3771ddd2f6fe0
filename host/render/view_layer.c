#include "render/view_layer.h"

#include <math.h>
#include <string.h>

const char *view_layer_name(enum view_layer layer) {
    static const char *const names[VIEW_LAYERS] = {"colour", "intensity", "range", "confidence",
                                                   "normals"};
    return (int)layer < VIEW_LAYERS ? names[layer] : "?";
}

/* A scale that gets steadily darker, so that it survives grey printing. */
static void scale_rgb(double t, const uint8_t stops[][3], int count, uint8_t out[3]) {
    t = fmin(fmax(t, 0.0), 1.0) * (count - 1);
    int i = (int)t < count - 2 ? (int)t : count - 2;
    double f = t - i;
    for (int k = 0; k < 3; k++)
        out[k] = (uint8_t)(stops[i][k] + f * (stops[i + 1][k] - stops[i][k]) + 0.5);
}

static const uint8_t range_stops[][3] = {
    {255, 244, 180}, {250, 176, 80}, {214, 84, 92}, {122, 44, 122}, {34, 20, 90}};
static const uint8_t sigma_stops[][3] = {
    {40, 170, 90}, {170, 205, 70}, {250, 200, 60}, {225, 90, 50}, {140, 20, 50}};

/* Point of a sample relative to the tile's origin, in the world's axes. */
static struct vec3 point_of(const struct tile *tile, double u, double v, double delta) {
    const double *m = tile->m.m;
    return vec3_make((m[0] * u + m[1] * v + m[2]) / delta, (m[4] * u + m[5] * v + m[6]) / delta,
                     (m[8] * u + m[9] * v + m[10]) / delta);
}

/* Differences over up to two samples each way; sideways where a neighbour is missing. */
static bool normal_of(const struct tile *tile, int32_t u, int32_t v, int32_t w, int32_t h,
                      struct vec3 *out) {
    int32_t u0 = u > 0 ? u - 1 : u, u1 = u + 1 < w ? u + 1 : u;
    int32_t v0 = v > 0 ? v - 1 : v, v1 = v + 1 < h ? v + 1 : v;
    const float *d = tile->disparity_per_m;
    double a = (double)d[v * tile->stride_px + u0], b = (double)d[v * tile->stride_px + u1];
    double c = (double)d[v0 * tile->stride_px + u], e = (double)d[v1 * tile->stride_px + u];
    if (!(a > 0.0 && b > 0.0 && c > 0.0 && e > 0.0))
        return false;
    struct vec3 along = vec3_sub(point_of(tile, u1, v, b), point_of(tile, u0, v, a));
    struct vec3 across = vec3_sub(point_of(tile, u, v1, e), point_of(tile, u, v0, c));
    struct vec3 n = vec3_cross(across, along); /* towards the eye: v runs down */
    double length = vec3_norm(n);
    if (!(length > 0.0))
        return false;
    *out = vec3_scale(n, 1.0 / length);
    return true;
}

static void shade_sample(enum view_layer layer, const struct tile *tile, int32_t u, int32_t v,
                         int32_t w, int32_t h, const uint8_t *rgb, uint8_t *out) {
    ptrdiff_t at = (ptrdiff_t)v * tile->stride_px + u;
    double delta = (double)tile->disparity_per_m[at];
    uint8_t confidence = tile->confidence[at];
    struct vec3 n;
    memset(out, 120, 3);
    switch (layer) {
    case VIEW_LAYER_COLOUR:
        memcpy(out, rgb, 3);
        break;
    case VIEW_LAYER_INTENSITY:
        memset(out, (299 * rgb[0] + 587 * rgb[1] + 114 * rgb[2] + 500) / 1000, 3);
        break;
    case VIEW_LAYER_RANGE:
        if (delta > 0.0)
            scale_rgb(log(2.0 * vec3_norm(point_of(tile, u, v, delta))) / log(100.0), range_stops,
                      5, out);
        break;
    case VIEW_LAYER_CONFIDENCE:
        if (delta > 0.0 && confidence)
            scale_rgb(log10(photo_sigma_from_confidence(confidence) / (delta * delta) * 1e3) / 2.0,
                      sigma_stops, 5, out);
        break;
    case VIEW_LAYER_NORMALS:
        if (normal_of(tile, u, v, w, h, &n)) {
            out[0] = (uint8_t)(127.5 + 127.0 * n.x);
            out[1] = (uint8_t)(127.5 + 127.0 * n.y);
            out[2] = (uint8_t)(127.5 + 127.0 * n.z);
        }
        break;
    }
}

void view_layer_shade(enum view_layer layer, const struct tile *tile, const uint8_t *rgb,
                      int32_t width_px, int32_t height_px, uint8_t *out_rgb) {
    if (layer == VIEW_LAYER_COLOUR) {
        memcpy(out_rgb, rgb, 3 * (size_t)width_px * (size_t)height_px);
        return;
    }
    for (int32_t v = 0; v < height_px; v++)
        for (int32_t u = 0; u < width_px; u++) {
            size_t at = 3 * ((size_t)v * (size_t)width_px + (size_t)u);
            shade_sample(layer, tile, u, v, width_px, height_px, rgb + at, out_rgb + at);
        }
}
