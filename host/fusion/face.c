#include "fusion/face.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

const char *face_name(int face) {
    static const char *const names[FACE_COUNT] = {"front", "left", "back", "right", "up", "down"};
    return face >= 0 && face < FACE_COUNT ? names[face] : "?";
}

struct camera face_camera(int32_t size_px) {
    /* The 45 degree planes pass through the second and the last but one pixel. */
    double f = 0.5 * (size_px - 3), c = 0.5 * (size_px - 1);
    struct camera camera = {
        .width_px = size_px, .height_px = size_px, .fx_px = f, .fy_px = f, .cx_px = c, .cy_px = c};
    return camera;
}

struct pose face_station_from_cam(int face) {
    /* Columns: right, down, forward, in the station. */
    static const double columns[FACE_COUNT][9] = {
        {0, 0, 1, -1, 0, 0, 0, -1, 0},  /* +x: right is -y, down is -z */
        {1, 0, 0, 0, 0, 1, 0, -1, 0},   /* +y: right is +x */
        {0, 0, -1, 1, 0, 0, 0, -1, 0},  /* -x: right is +y */
        {-1, 0, 0, 0, 0, -1, 0, -1, 0}, /* -y: right is -x */
        {0, 1, 0, -1, 0, 0, 0, 0, 1},   /* +z: right is -y, down is +x */
        {0, -1, 0, -1, 0, 0, 0, 0, -1}, /* -z: right is -y, down is -x */
    };
    struct pose pose = pose_identity();
    memcpy(pose.r.m, columns[face], sizeof pose.r.m);
    return pose;
}

int32_t face_size_px(double spacing_rad, int32_t max_px) {
    double px = 2.0 / spacing_rad; /* f = 1 / spacing in the middle, f = size / 2 */
    int32_t steps = px < 2048.0 * 32.0 ? (int32_t)ceil(px / 32.0) : 2048;
    int32_t most = (max_px - 1) / 32;
    if (steps > most)
        steps = most;
    return 32 * (steps < 1 ? 1 : steps) + 1;
}

/* ---- survey ---- */

enum { FINE = 8192 / 2, BINS = 1024, CHUNK = 8192 }; /* FINE: cells along a face, 0.5 mrad */

struct survey_scratch {
    uint32_t bits[FACE_COUNT][FINE * FINE / 32];
    int64_t histogram[BINS]; /* of intensities 0..1 */
    struct scatter_sample samples[CHUNK];
};

/* Face and place -1..1 on it of a direction. */
static int face_of(const float d[3], float out_st[2]) {
    float x = d[0], y = d[1], z = d[2], ax = fabsf(x), ay = fabsf(y), az = fabsf(z);
    float s, t, m;
    int face;
    if (ax >= ay && ax >= az) {
        face = x >= 0.0f ? 0 : 2;
        m = ax, s = y, t = z;
    } else if (ay >= az) {
        face = y >= 0.0f ? 1 : 3;
        m = ay, s = x, t = z;
    } else {
        face = z >= 0.0f ? 4 : 5;
        m = az, s = x, t = y;
    }
    if (!(m > 0.0f))
        return -1;
    out_st[0] = s / m;
    out_st[1] = t / m;
    return face;
}

static void survey_sample(struct survey_scratch *scratch, const struct scatter_sample *s,
                          struct face_survey *survey) {
    float st[2];
    int face = face_of(s->p_m, st);
    if (face < 0)
        return;
    survey->sample_count++;
    int x = (int)((st[0] * 0.5f + 0.5f) * FINE), y = (int)((st[1] * 0.5f + 0.5f) * FINE);
    x = x < 0 ? 0 : x >= FINE ? FINE - 1 : x;
    y = y < 0 ? 0 : y >= FINE ? FINE - 1 : y;
    size_t cell = (size_t)y * FINE + (size_t)x;
    scratch->bits[face][cell / 32] |= 1u << (cell % 32);
    if (s->flags & (SAMPLE_NO_RETURN | SAMPLE_DROPPED))
        return;
    survey->return_count++;
    survey->seen[face]++;
    float range = sqrtf(s->p_m[0] * s->p_m[0] + s->p_m[1] * s->p_m[1] + s->p_m[2] * s->p_m[2]);
    if (survey->return_count == 1 || range < survey->range_min_m)
        survey->range_min_m = range;
    if (survey->return_count == 1 || range > survey->range_max_m)
        survey->range_max_m = range;
    if (s->flags & SAMPLE_COLOUR)
        survey->has_colour = 1;
    if ((s->flags & SAMPLE_INTENSITY) && s->intensity >= 0.0f) {
        int bin = s->intensity < 1.0f ? (int)(s->intensity * BINS) : BINS - 1;
        scratch->histogram[bin]++;
    }
}

static int bit_get(const uint32_t *bits, size_t i) {
    return (int)(bits[i / 32] >> (i % 32) & 1u);
}

/* Halves the resolution in place; returns nothing. size: cells along a side before. */
static void halve(uint32_t *bits, size_t size) {
    size_t half = size / 2;
    for (size_t y = 0; y < half; y++)
        for (size_t x = 0; x < half; x++) {
            size_t a = 2 * y * size + 2 * x;
            uint32_t any = (uint32_t)(bit_get(bits, a) | bit_get(bits, a + 1) |
                                      bit_get(bits, a + size) | bit_get(bits, a + size + 1));
            size_t to = y * half + x; /* never ahead of what is still to be read */
            bits[to / 32] = (bits[to / 32] & ~(1u << (to % 32))) | any << (to % 32);
        }
}

/* Share of the cells with all eight neighbours' hull looked at that hold a sample: cells whose left
 * and right or upper and lower neighbour within 8 cells hold one count as looked at. */
static void coverage(const uint32_t *bits, size_t size, int64_t *inout_full, int64_t *inout_all) {
    enum { REACH = 8 };
    for (size_t y = 0; y < size; y++) {
        size_t last = SIZE_MAX;
        for (size_t x = 0; x < size; x++)
            if (bit_get(bits, y * size + x)) {
                size_t gap = last == SIZE_MAX ? 1 : x - last;
                *inout_full += 1;
                *inout_all += gap <= REACH ? (int64_t)gap : 1;
                last = x;
            }
    }
    for (size_t x = 0; x < size; x++) {
        size_t last = SIZE_MAX;
        for (size_t y = 0; y < size; y++)
            if (bit_get(bits, y * size + x)) {
                size_t gap = last == SIZE_MAX ? 1 : y - last;
                *inout_full += 1;
                *inout_all += gap <= REACH ? (int64_t)gap : 1;
                last = y;
            }
    }
}

static double spacing_of(struct survey_scratch *scratch) {
    enum { COARSEST = 16 };
    for (size_t size = FINE; size > COARSEST; size /= 2) {
        int64_t full = 0, all = 0;
        for (int face = 0; face < FACE_COUNT; face++)
            coverage(scratch->bits[face], size, &full, &all);
        if (!full)
            break;
        if ((double)full >= 0.9 * (double)all)
            return 2.0 / (double)size;
        for (int face = 0; face < FACE_COUNT; face++)
            halve(scratch->bits[face], size);
    }
    return 0.2;
}

static float high_intensity(const int64_t histogram[BINS]) {
    int64_t all = 0, below = 0;
    for (int i = 0; i < BINS; i++)
        all += histogram[i];
    if (!all)
        return 0.0f;
    for (int i = 0; i < BINS; i++) {
        below += histogram[i];
        if (below * 100 >= all * 99)
            return (float)(i + 1) / BINS;
    }
    return 1.0f;
}

enum st face_survey_source(const struct scatter_source *source, struct face_survey *out_survey,
                           struct errctx *err) {
    struct face_survey survey = {0};
    struct survey_scratch *scratch = calloc(1, sizeof *scratch);
    if (!scratch)
        return errctx_set(err, ST_NOMEM, "no memory to survey the samples");
    enum st st = source->rewind(source->context, err);
    while (!st) {
        size_t count = 0;
        st = source->next(source->context, scratch->samples, CHUNK, &count, err);
        if (st || !count)
            break;
        for (size_t i = 0; i < count; i++)
            survey_sample(scratch, scratch->samples + i, &survey);
    }
    if (!st) {
        survey.spacing_rad = survey.sample_count ? spacing_of(scratch) : 0.2;
        survey.intensity_high = high_intensity(scratch->histogram);
        *out_survey = survey;
    }
    free(scratch);
    return st;
}
