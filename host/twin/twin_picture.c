#include "twin/twin_picture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;

enum st twin_picture_create(struct twin_picture *picture, int32_t width_px, double bottom_rad,
                            double top_rad) {
    memset(picture, 0, sizeof *picture);
    picture->width_px = width_px;
    picture->step_rad = 2 * pi / width_px;
    picture->top_rad = top_rad;
    picture->height_px = (int32_t)ceil((top_rad - bottom_rad) / picture->step_rad);
    size_t count = (size_t)picture->width_px * (size_t)picture->height_px;
    picture->range_m = malloc(count * sizeof *picture->range_m);
    picture->intensity = calloc(count, sizeof *picture->intensity);
    picture->state = calloc(count, sizeof *picture->state);
    if (!picture->range_m || !picture->intensity || !picture->state) {
        twin_picture_destroy(picture);
        return ST_NOMEM;
    }
    for (size_t i = 0; i < count; i++)
        picture->range_m[i] = NAN;
    return ST_OK;
}

void twin_picture_destroy(struct twin_picture *picture) {
    free(picture->range_m);
    free(picture->intensity);
    free(picture->state);
    memset(picture, 0, sizeof *picture);
}

void twin_picture_add(struct twin_picture *picture, const struct cart_shot *shot,
                      const struct pose *world_from_station) {
    struct vec3 d = mat3_tmulv(&world_from_station->r, shot->beam.dir);
    int32_t x = (int32_t)((pi - atan2(d.y, d.x)) / picture->step_rad);
    int32_t y = (int32_t)((picture->top_rad - asin(d.z > 1    ? 1
                                                   : d.z < -1 ? -1
                                                              : d.z)) /
                          picture->step_rad);
    if (x < 0 || y < 0 || x >= picture->width_px || y >= picture->height_px)
        return;
    size_t at = (size_t)y * (size_t)picture->width_px + (size_t)x;
    uint8_t state = isnan(shot->range_m)
                        ? (shot->reading.flags & HEAD_SAMPLE_DROPPED ? TWIN_PICTURE_DROPPED
                                                                     : TWIN_PICTURE_NO_RETURN)
                        : (shot->echo.mixed ? TWIN_PICTURE_MIXED : TWIN_PICTURE_RANGE);
    picture->state[at] = state > picture->state[at] ? state : picture->state[at];
    if (!isnan(shot->range_m) && !(picture->range_m[at] <= (float)shot->range_m)) {
        picture->range_m[at] = (float)shot->range_m;
        picture->intensity[at] = (float)shot->reading.intensity;
    }
}

/* Fills pixels that no sample met from the nearest neighbour within `reach`; index of the pixel to
 * take. */
static size_t source_of(const struct twin_picture *p, int32_t x, int32_t y) {
    enum { REACH = 4 };
    size_t at = (size_t)y * (size_t)p->width_px + (size_t)x, best = at;
    int nearest = 1 << 20;
    if (p->state[at] != TWIN_PICTURE_UNSEEN)
        return at;
    for (int dy = -REACH; dy <= REACH; dy++)
        for (int dx = -REACH; dx <= REACH; dx++) {
            int32_t u = (x + dx + p->width_px) % p->width_px, v = y + dy;
            int d2 = dx * dx + dy * dy;
            if (v < 0 || v >= p->height_px || d2 >= nearest)
                continue;
            size_t to = (size_t)v * (size_t)p->width_px + (size_t)u;
            if (p->state[to] != TWIN_PICTURE_UNSEEN) {
                best = to;
                nearest = d2;
            }
        }
    return best;
}

static int compare(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Range and intensity below which the given parts of the samples lie. */
static enum st quantiles(const struct twin_picture *p, const float *plane, float low, float high,
                         float out[2]) {
    size_t count = (size_t)p->width_px * (size_t)p->height_px, n = 0;
    float *sorted = malloc(count * sizeof *sorted);
    if (!sorted)
        return ST_NOMEM;
    for (size_t i = 0; i < count; i++)
        if (!isnan(p->range_m[i]))
            sorted[n++] = plane[i];
    qsort(sorted, n, sizeof *sorted, compare);
    out[0] = n ? sorted[(size_t)((float)(n - 1) * low)] : 0;
    out[1] = n ? sorted[(size_t)((float)(n - 1) * high)] : 1;
    free(sorted);
    return ST_OK;
}

/* Near to far through warm white, orange, magenta, blue: light and hue both fall, so that it reads
 * in grey too. */
static void range_rgb(float t, uint8_t out[3]) {
    static const float stops[7][3] = {{255, 250, 224}, {253, 209, 116}, {244, 137, 73},
                                      {203, 71, 99},   {132, 39, 124},  {63, 24, 112},
                                      {16, 14, 52}};
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    int i = (int)(t * 6);
    i = i > 5 ? 5 : i;
    float f = t * 6 - (float)i;
    for (int k = 0; k < 3; k++)
        out[k] = (uint8_t)(stops[i][k] + f * (stops[i + 1][k] - stops[i][k]) + 0.5f);
}

/* Mean log range of the pixels around (x, y) that belong to the surface at range r. */
static float mean_log(const struct twin_picture *p, int32_t x, int32_t y, float r) {
    float sum = 0;
    int n = 0;
    for (int dy = -2; dy <= 2; dy++)
        for (int dx = -2; dx <= 2; dx++) {
            int32_t u = (x + dx + p->width_px) % p->width_px, v = y + dy;
            float q = v >= 0 && v < p->height_px ? p->range_m[v * p->width_px + u] : NAN;
            if (q > 0.94f * r && q < 1.06f * r) {
                sum += logf(q / r);
                n++;
            }
        }
    return n ? sum / (float)n : 0;
}

/* Light from the upper left on the range picture, so that shape shows: from the slope of log range
 * between four neighbourhoods, so that the range noise does not. */
static float shade(const struct twin_picture *p, size_t at) {
    enum { REACH = 3 };
    int32_t x = (int32_t)(at % (size_t)p->width_px), y = (int32_t)(at / (size_t)p->width_px);
    float r = p->range_m[at], across = (float)(2 * REACH * p->step_rad);
    if (isnan(r))
        return 1;
    float gx = (mean_log(p, x + REACH, y, r) - mean_log(p, x - REACH, y, r)) / across;
    float gy = (mean_log(p, x, y + REACH, r) - mean_log(p, x, y - REACH, r)) / across;
    float n = 1 / sqrtf(1 + gx * gx + gy * gy), s = (1.1f - 0.45f * gx - 0.75f * gy) * n;
    s = s < 0.35f ? 0.35f : s > 1.25f ? 1.25f : s;
    return 0.45f + 0.55f * s;
}

static void pixel(const struct twin_picture *p, enum twin_picture_style style, int32_t x, int32_t y,
                  const float scale[2], uint8_t out[3]) {
    static const uint8_t no_return[3] = {22, 26, 34}, dropped[3] = {96, 30, 60},
                         mixed[3] = {255, 40, 30};
    size_t at = source_of(p, x, y);
    uint8_t state = p->state[at];
    if (state == TWIN_PICTURE_UNSEEN) {
        memset(out, 0, 3);
        return;
    }
    if (state == TWIN_PICTURE_NO_RETURN || state == TWIN_PICTURE_DROPPED) {
        memcpy(out, state == TWIN_PICTURE_DROPPED ? dropped : no_return, 3);
        return;
    }
    if (style == TWIN_PICTURE_STYLE_RANGE) {
        range_rgb(logf(p->range_m[at] / scale[0]) / logf(scale[1] / scale[0]), out);
        float s = shade(p, at);
        for (int k = 0; k < 3; k++) {
            float v = (float)out[k] * s;
            out[k] = (uint8_t)(v > 255 ? 255 : v);
        }
        return;
    }
    /* echoes span decades: a root, with the fall with distance partly taken out */
    float r = p->range_m[at] / 2, v = p->intensity[at] * (1 + r * r);
    v = powf(v / scale[1], 0.45f);
    uint8_t grey = (uint8_t)(v > 1 ? 255 : v * 255);
    memset(out, grey, 3);
    if (style == TWIN_PICTURE_STYLE_MIXED) {
        memset(out, grey / 2, 3);
        if (state == TWIN_PICTURE_MIXED)
            memcpy(out, mixed, 3);
    }
}

enum st twin_picture_draw(const struct twin_picture *picture, enum twin_picture_style style,
                          struct image_u8 *out_image) {
    float scale[2] = {0, 0.75f}, range[2];
    enum st st = quantiles(picture, picture->range_m, 0.02f, 0.98f, range);
    if (st)
        return st;
    if (style == TWIN_PICTURE_STYLE_RANGE) {
        scale[0] = range[0] > 0.01f ? range[0] : 0.01f;
        scale[1] = range[1] > scale[0] * 1.2f ? range[1] : scale[0] * 1.2f;
    }
    st = image_u8_create(out_image, picture->width_px, picture->height_px, 3);
    if (st)
        return st;
#pragma omp parallel for schedule(dynamic, 8)
    for (int32_t y = 0; y < picture->height_px; y++)
        for (int32_t x = 0; x < picture->width_px; x++)
            pixel(picture, style, x, y, scale, image_u8_at(out_image, x, y));
    return ST_OK;
}
