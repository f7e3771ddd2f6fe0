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
    int32_t most = max_px / 32;
    if (steps > most)
        steps = most;
    return 32 * (steps < 1 ? 1 : steps);
}

/* ---- survey ---- */

enum { FINE = 8192, BINS = 1024, CHUNK = 8192 }; /* FINE: cells along a face, 0.24 mrad */

struct survey_scratch {
    uint32_t bits[FACE_COUNT][FINE * FINE / 32];
    int64_t histogram[BINS]; /* of intensities 0..1 */
    struct vec3 sum;         /* of the directions */
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
    double length =
        sqrt((double)(s->p_m[0] * s->p_m[0] + s->p_m[1] * s->p_m[1] + s->p_m[2] * s->p_m[2]));
    scratch->sum =
        vec3_madd(scratch->sum, vec3_make((double)s->p_m[0], (double)s->p_m[1], (double)s->p_m[2]),
                  1.0 / length);
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

/* The even bits of x, packed into the low half. */
static uint32_t even_bits(uint32_t x) {
    x &= 0x55555555u;
    x = (x | x >> 1) & 0x33333333u;
    x = (x | x >> 2) & 0x0f0f0f0fu;
    x = (x | x >> 4) & 0x00ff00ffu;
    return (x | x >> 8) & 0x0000ffffu;
}

/* Halves the resolution in place: a cell holds a sample if one of its four does. size: cells along
 * a side before, a multiple of 64. */
static void halve(uint32_t *bits, size_t size) {
    size_t from = size / 32, to = size / 64;
    for (size_t y = 0; y < size / 2; y++) {
        const uint32_t *a = bits + 2 * y * from, *b = a + from;
        for (size_t k = 0; k < to; k++) { /* never ahead of what is still to be read */
            uint32_t lo = a[2 * k] | b[2 * k], hi = a[2 * k + 1] | b[2 * k + 1];
            bits[y * to + k] = even_bits(lo | lo >> 1) | even_bits(hi | hi >> 1) << 16;
        }
    }
}

static int64_t count_bits(const uint32_t *bits, size_t words) {
    int64_t n = 0;
    for (size_t i = 0; i < words; i++)
        for (uint32_t x = bits[i]; x; x &= x - 1)
            n++;
    return n;
}

/* Where cells are larger than the spacing, four times as many hold a sample at half the size; where
 * they are smaller, a cell holds one with probability (cell / spacing)^2 and the number no longer
 * grows. */
static double spacing_of(struct survey_scratch *scratch) {
    enum { COARSEST = 32, LEVELS = 9 }; /* 8192 down to 32 */
    int64_t cells[LEVELS] = {0};
    for (int level = 0; level < LEVELS; level++) {
        size_t size = (size_t)FINE >> level;
        for (int face = 0; face < FACE_COUNT; face++) {
            cells[level] += count_bits(scratch->bits[face], size * size / 32);
            if (size > COARSEST)
                halve(scratch->bits[face], size);
        }
    }
    /* The finest size at which halving still nearly quadruples the number is where cells and
     * spacing meet; at the coarse end the border of what was looked at counts, so that end says
     * nothing. */
    int level = 0;
    double share = 0.0;
    for (; level < LEVELS - 1; level++) {
        double finer = share;
        share = (double)cells[level] / (4.0 * (double)cells[level + 1]);
        if (share < 0.5)
            continue;
        if (share > 0.9 && level > 0) { /* this size is full: the finer one tells by how much */
            share = finer;
            level--;
        }
        break;
    }
    double cell_rad = 2.0 / (double)((size_t)FINE >> level);
    /* A cell of a cube map covers 0.724 of its size on average over a face. */
    return 0.724 * cell_rad / sqrt(fmin(fmax(share, 0.0625), 1.0));
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

/* Widest angle of a sample from the axis: a second pass. */
static enum st measure_cone(const struct scatter_source *source, struct survey_scratch *scratch,
                            struct face_survey *survey, struct errctx *err) {
    double least = 1.0;
    enum st st = source->rewind(source->context, err);
    while (!st) {
        size_t count = 0;
        st = source->next(source->context, scratch->samples, CHUNK, &count, err);
        if (st || !count)
            break;
        for (size_t i = 0; i < count; i++) {
            const float *p = scratch->samples[i].p_m;
            struct vec3 d = vec3_unit(vec3_make((double)p[0], (double)p[1], (double)p[2]));
            if (vec3_is_finite(d))
                least = fmin(least, vec3_dot(d, survey->axis));
        }
    }
    double widest = acos(fmax(-1.0, fmin(1.0, least)));
    survey->half_angle_rad = widest < 0.873 ? widest : (double)NAN; /* 50 degrees */
    return st;
}

void face_narrow(const struct face_survey *survey, double spacing_rad, int32_t max_px,
                 struct camera *out_camera, struct pose *out_station_from_cam) {
    double t = tan(fmax(survey->half_angle_rad, 1e-3)) * 1.02;
    double px = fmin(fmax(2.0 * t / spacing_rad, 32.0), (double)max_px);
    int32_t size = (int32_t)ceil(px);
    double f = 0.5 * size / t, c = 0.5 * (size - 1);
    struct camera camera = {
        .width_px = size, .height_px = size, .fx_px = f, .fy_px = f, .cx_px = c, .cy_px = c};
    struct vec3 forward = survey->axis;
    struct vec3 up = fabs(forward.z) < 0.99 ? vec3_make(0, 0, 1) : vec3_make(1, 0, 0);
    struct vec3 right = vec3_unit(vec3_cross(forward, up)), down = vec3_cross(forward, right);
    struct pose pose = {
        {{right.x, down.x, forward.x, right.y, down.y, forward.y, right.z, down.z, forward.z}},
        {0, 0, 0}};
    *out_camera = camera;
    *out_station_from_cam = pose;
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
    double length = vec3_norm(scratch->sum);
    survey.half_angle_rad = (double)NAN;
    if (!st && survey.sample_count && length > 0.7 * (double)survey.sample_count) {
        survey.axis = vec3_scale(scratch->sum, 1.0 / length);
        st = measure_cone(source, scratch, &survey, err);
    }
    if (!st) {
        survey.spacing_rad = survey.sample_count ? spacing_of(scratch) : 0.2;
        survey.intensity_high = high_intensity(scratch->histogram);
        *out_survey = survey;
    }
    free(scratch);
    return st;
}
