/* Colour of a photograph between its pixels. */
#include "raster/raster_band.h"

static inline int32_t clamp_index(int32_t i, int32_t lo, int32_t hi) {
    return i < lo ? lo : i > hi ? hi : i;
}

/* Catmull-Rom weights at t in 0..1 for samples at -1, 0, 1, 2. */
static inline void cubic_weights(float t, float w[4]) {
    w[0] = ((-0.5f * t + 1.0f) * t - 0.5f) * t;
    w[1] = (1.5f * t - 2.5f) * t * t + 1.0f;
    w[2] = ((-1.5f * t + 2.0f) * t + 0.5f) * t;
    w[3] = (0.5f * t - 0.5f) * t * t;
}

static inline uint8_t to_byte(float value) {
    float rounded = value + 0.5f;
    return rounded <= 0.0f ? 0 : rounded >= 255.0f ? 255 : (uint8_t)rounded;
}

/* Bilinear: the order of the sum is that of the cubic's inner four. */
static uint32_t linear_rgba(const struct tile_job *job, float u, float v) {
    float u_floor = floorf(u), v_floor = floorf(v);
    float s = u - u_floor, t = v - v_floor;
    int32_t x0 = clamp_index((int32_t)u_floor, job->u_lo, job->u_hi);
    int32_t x1 = clamp_index((int32_t)u_floor + 1, job->u_lo, job->u_hi);
    int32_t y0 = clamp_index((int32_t)v_floor, job->v_lo, job->v_hi);
    int32_t y1 = clamp_index((int32_t)v_floor + 1, job->v_lo, job->v_hi);
    const uint8_t *rgb = job->tile->rgb;
    ptrdiff_t stride = job->tile->stride_px;
    const uint8_t *a = rgb + 3 * (y0 * stride + x0), *b = rgb + 3 * (y0 * stride + x1);
    const uint8_t *c = rgb + 3 * (y1 * stride + x0), *d = rgb + 3 * (y1 * stride + x1);
    float wa = (1.0f - s) * (1.0f - t), wb = s * (1.0f - t), wc = (1.0f - s) * t, wd = s * t;
    uint8_t out[3];
    for (int k = 0; k < 3; k++)
        out[k] = to_byte(wa * (float)a[k] + wb * (float)b[k] + wc * (float)c[k] + wd * (float)d[k]);
    return key_rgba(out[0], out[1], out[2], RASTER_ALPHA_SURFACE);
}

static uint32_t cubic_rgba(const struct tile_job *job, float u, float v) {
    float u_floor = floorf(u), v_floor = floorf(v);
    float wu[4], wv[4], sum[3] = {0};
    cubic_weights(u - u_floor, wu);
    cubic_weights(v - v_floor, wv);
    for (int32_t j = 0; j < 4; j++) {
        if (wv[j] == 0.0f)
            continue;
        int32_t y = clamp_index((int32_t)v_floor + j - 1, job->v_lo, job->v_hi);
        const uint8_t *row = job->tile->rgb + 3 * (ptrdiff_t)y * job->tile->stride_px;
        for (int32_t i = 0; i < 4; i++) {
            int32_t x = clamp_index((int32_t)u_floor + i - 1, job->u_lo, job->u_hi);
            const uint8_t *px = row + 3 * (ptrdiff_t)x;
            float w = wu[i] * wv[j];
            for (int k = 0; k < 3; k++)
                sum[k] += w * (float)px[k];
        }
    }
    return key_rgba(to_byte(sum[0]), to_byte(sum[1]), to_byte(sum[2]), RASTER_ALPHA_SURFACE);
}

uint32_t raster_texture_rgba(const struct frame *frame, const struct mesh_paint *paint, float u,
                             float v) {
    if (paint->skin) {
        const uint8_t *c = frame->options->skin_rgb;
        return key_rgba(c[0], c[1], c[2], RASTER_ALPHA_UNKNOWN);
    }
    if (frame->options->filter == RASTER_FILTER_CUBIC)
        return cubic_rgba(paint->job, u, v);
    if (frame->options->filter == RASTER_FILTER_NEAREST)
        return linear_rgba(paint->job, floorf(u + 0.5f), floorf(v + 0.5f));
    return linear_rgba(paint->job, u, v);
}
