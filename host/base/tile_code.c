#include "base/tile_code.h"

#include "base/photo.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>
#include <zstd.h>

/* Layout, little-endian:
 *    0  u8 kind, u8 width, u8 height, u8 confidence step
 *    4  u8 disparity predictor, u8 colour predictor, u8 bytes of a disparity residual, u8 0
 *    8  f32 base, f32 step    value = base + step * level; step 0: the levels are float32 as they
 * are 16  f32 x 3 plane          of a plane tile; or what the plane predictor foretells 28  u16 x 3
 * bytes of the packed parts: disparity, colour, rest 34  the parts, each one zstd frame, or raw
 * where that is not smaller disparity: residuals of samples that have one, zigzag, all low bytes,
 * then the next bytes. colour: residuals of green, red - green, blue - green. rest: mask of samples
 * with a coded disparity (a bit each), flags, confidences / step. */
enum { HEADER_BYTES = 34, PARTS = 3, MASK_BYTES = (TILE_CODE_SAMPLES + 7) / 8 };
enum part { PART_DISPARITY, PART_COLOUR, PART_REST };
enum predictor { PREDICT_PLANE, PREDICT_SMOOTH, PREDICT_MEDIAN, PREDICTORS };
enum { LEVEL_MAX = 1 << 24 };

struct parts {
    uint8_t bytes[PARTS][4 * TILE_CODE_SAMPLES];
    size_t size[PARTS];
};

struct tile_code_options tile_code_options_default(double step_per_m) {
    struct tile_code_options options = {.step_per_m = step_per_m,
                                        .plane = 1,
                                        .plane_sigmas = 5.0,
                                        .confidence_step = 4,
                                        .zstd_level = 9};
    return options;
}

/* ---- planes ---- */

static double sample_sigma(uint8_t confidence) {
    return confidence ? photo_sigma_from_confidence(confidence) : (double)NAN;
}

/* Solves the symmetric 3 x 3 system by Cramer's rule; false if it is singular. */
static bool solve3(const double a[6], const double b[3], double out_x[3]) {
    double c00 = a[3] * a[5] - a[4] * a[4], c01 = a[2] * a[4] - a[1] * a[5];
    double c02 = a[1] * a[4] - a[2] * a[3];
    double det = a[0] * c00 + a[1] * c01 + a[2] * c02;
    if (!(fabs(det) > 1e-9 * fabs(a[0] * a[3] * a[5])))
        return false;
    double c11 = a[0] * a[5] - a[2] * a[2], c12 = a[1] * a[2] - a[0] * a[4];
    double c22 = a[0] * a[3] - a[1] * a[1];
    out_x[0] = (c00 * b[0] + c01 * b[1] + c02 * b[2]) / det;
    out_x[1] = (c01 * b[0] + c11 * b[1] + c12 * b[2]) / det;
    out_x[2] = (c02 * b[0] + c12 * b[1] + c22 * b[2]) / det;
    return true;
}

int32_t tile_code_plane(const struct tile_samples *s, float out_plane[3], double *out_chi2,
                        double *out_worst) {
    double a[6] = {0}, b[3] = {0}, x[3], weight_sum = 0;
    int32_t n = 0;
    for (int32_t i = 0; i < s->width * s->height; i++) {
        double d = (double)s->disparity_per_m[i], sigma = sample_sigma(s->confidence[i]);
        if (isnan(d) || isnan(sigma))
            continue;
        double u = i % s->width, v = i / s->width, w = 1e-12 / (sigma * sigma);
        a[0] += w, a[1] += w * u, a[2] += w * v;
        a[3] += w * u * u, a[4] += w * u * v, a[5] += w * v * v;
        b[0] += w * d, b[1] += w * d * u, b[2] += w * d * v;
        weight_sum += w;
        n++;
    }
    if (n < 3 || !(weight_sum > 0) || !solve3(a, b, x))
        return 0;
    double chi2 = 0, worst = 0;
    for (int32_t i = 0; i < s->width * s->height; i++) {
        double d = (double)s->disparity_per_m[i], sigma = sample_sigma(s->confidence[i]);
        if (isnan(d) || isnan(sigma))
            continue;
        double r = (d - x[0] - x[1] * (i % s->width) - x[2] * (i / s->width)) / sigma;
        chi2 += r * r;
        worst = fmax(worst, fabs(r));
    }
    for (int k = 0; k < 3; k++)
        out_plane[k] = (float)x[k];
    *out_chi2 = n > 3 ? chi2 / (n - 3) : chi2;
    *out_worst = worst;
    return n;
}

/* Every sample there, none at infinity, none flagged as an edge or a hole, and all on one plane.
 * Neighbours share laser samples, so the scatter of chi^2 is that of a quarter as many. */
static bool is_plane(const struct tile_samples *s, const struct tile_code_options *o,
                     struct tile_code_stats *stats) {
    double worst = 0;
    stats->plane_chi2 = NAN;
    for (int32_t i = 0; i < s->width * s->height; i++)
        if (!(s->disparity_per_m[i] > 0.0f) ||
            (s->flags[i] & (PHOTO_SKIN | PHOTO_SILHOUETTE | PHOTO_SKY)))
            return false;
    int32_t n = tile_code_plane(s, stats->plane, &stats->plane_chi2, &worst);
    if (n != s->width * s->height || n < 9)
        return false;
    return stats->plane_chi2 <= 1.0 + 4.0 * sqrt(2.0 * 4.0 / n) && worst <= o->plane_sigmas;
}

/* Value of a stored plane; the decoder's own arithmetic, so that both agree to the bit. */
static float plane_at(const float plane[3], int32_t u, int32_t v) {
    return plane[0] + plane[1] * (float)u + plane[2] * (float)v;
}

static bool plane_positive(const float plane[3], int32_t width, int32_t height) {
    for (int k = 0; k < 4; k++) {
        float d = plane_at(plane, (k & 1) * (width - 1), (k >> 1) * (height - 1));
        if (!(d > 0.0f && isfinite(d)))
            return false;
    }
    return true;
}

/* ---- little-endian ---- */

static void put_u16(uint8_t *p, uint32_t x) {
    p[0] = (uint8_t)x;
    p[1] = (uint8_t)(x >> 8);
}
static uint32_t get_u16(const uint8_t *p) {
    return (uint32_t)p[0] | (uint32_t)p[1] << 8;
}
static void put_f32(uint8_t *p, float f) {
    uint32_t x;
    memcpy(&x, &f, sizeof x);
    put_u16(p, x & 0xffffu);
    put_u16(p + 2, x >> 16);
}
static float get_f32(const uint8_t *p) {
    uint32_t x = get_u16(p) | get_u16(p + 2) << 16;
    float f;
    memcpy(&f, &x, sizeof f);
    return f;
}

/* ---- prediction ---- */

static uint32_t zigzag(int32_t x) {
    return ((uint32_t)x << 1) ^ (uint32_t)(x < 0 ? -1 : 0);
}
static int32_t unzigzag(uint32_t z) {
    return (int32_t)(z >> 1) ^ -(int32_t)(z & 1u);
}

/* Median predictor of LOCO-I (Weinberger et al. 2000): keeps edges. */
static int64_t predict_median(int64_t w, int64_t n, int64_t nw) {
    int64_t hi = w > n ? w : n, lo = w > n ? n : w;
    return nw >= hi ? lo : nw <= lo ? hi : w + n - nw;
}

/* From the three neighbours that exist; (3 w + 3 n - 2 nw) / 4 continues a plane with 1.4 times the
 * variance of one sample, w + n - nw would have 3. */
static int64_t predict_neighbours(const int32_t *q, const uint8_t *have, int32_t width, int32_t i,
                                  enum predictor predictor) {
    bool w = i % width > 0 && have[i - 1], n = i >= width && have[i - width];
    bool nw = i % width > 0 && i >= width && have[i - width - 1];
    if (w && n && nw) {
        int64_t a = q[i - 1], b = q[i - width], c = q[i - width - 1];
        return predictor == PREDICT_MEDIAN ? predict_median(a, b, c)
                                           : (3 * a + 3 * b - 2 * c + 2) >> 2;
    }
    return w ? q[i - 1] : n ? q[i - width] : 0;
}

struct quantiser {
    float base, step, plane[3];
    enum predictor predictor;
};

static int64_t predict_level(const struct quantiser *k, const int32_t *q, const uint8_t *have,
                             int32_t width, int32_t i) {
    if (k->predictor != PREDICT_PLANE)
        return predict_neighbours(q, have, width, i, k->predictor);
    double level =
        ((double)plane_at(k->plane, i % width, i / width) - (double)k->base) / (double)k->step;
    return level > -LEVEL_MAX && level < 2.0 * LEVEL_MAX ? (int64_t)floor(level + 0.5) : 0;
}

/* Residuals fit 32 bits: levels are below 2^24, predictions below 2^26. */
static int32_t residual_at(const struct quantiser *k, const int32_t *q, const uint8_t *have,
                           int32_t width, int32_t i) {
    return (int32_t)(q[i] - predict_level(k, q, have, width, i));
}

static double cost_of(const struct quantiser *k, const int32_t *q, const uint8_t *have,
                      int32_t width, int32_t count) {
    double bits = 0.0;
    for (int32_t i = 0; i < count; i++)
        if (have[i])
            bits += log2(1.0 + fabs((double)residual_at(k, q, have, width, i)));
    return bits;
}

/* ---- encoding ---- */

static bool is_coded(const struct tile_samples *s, int32_t i) {
    return !isnan(s->disparity_per_m[i]) && !(s->flags[i] & PHOTO_SKY);
}

static void store_residuals(const uint32_t *z, size_t count, struct parts *parts,
                            uint8_t *out_bytes_each) {
    uint32_t largest = 0;
    for (size_t i = 0; i < count; i++)
        largest |= z[i];
    unsigned each = 1;
    while (each < 4 && largest >> (8 * each))
        each++;
    for (unsigned b = 0; b < each; b++)
        for (size_t i = 0; i < count; i++)
            parts->bytes[PART_DISPARITY][b * count + i] = (uint8_t)(z[i] >> (8 * b));
    parts->size[PART_DISPARITY] = each * count;
    *out_bytes_each = (uint8_t)each;
}

/* Disparities as they are, all first bytes, all second bytes, ... */
static void disparity_exact(const struct tile_samples *s, const uint8_t *have, struct parts *parts,
                            uint8_t *header) {
    int32_t count = s->width * s->height;
    uint32_t z[TILE_CODE_SAMPLES];
    size_t n = 0;
    for (int32_t i = 0; i < count; i++)
        if (have[i])
            memcpy(&z[n++], &s->disparity_per_m[i], sizeof z[0]);
    for (size_t b = 0; b < 4; b++)
        for (size_t i = 0; i < n; i++)
            parts->bytes[PART_DISPARITY][b * n + i] = (uint8_t)(z[i] >> (8 * b));
    parts->size[PART_DISPARITY] = 4 * n;
    header[6] = 4;
    put_f32(header + 12, 0.0f);
}

/* Chooses step and base; false if the span is too wide for the step. */
static bool quantiser_make(const struct tile_samples *s, const uint8_t *have, double step,
                           struct quantiser *out, double *out_levels) {
    float lo = INFINITY, hi = -INFINITY;
    for (int32_t i = 0; i < s->width * s->height; i++)
        if (have[i]) {
            lo = s->disparity_per_m[i] < lo ? s->disparity_per_m[i] : lo;
            hi = s->disparity_per_m[i] > hi ? s->disparity_per_m[i] : hi;
        }
    memset(out, 0, sizeof *out);
    out->base = isfinite(lo) ? lo : 0.0f;
    out->step = (float)step;
    *out_levels = isfinite(lo) ? ((double)hi - (double)lo) / step + 1.0 : 1.0;
    return out->step > 0.0f && isfinite(out->step) && *out_levels < LEVEL_MAX / 2;
}

static void choose_predictor(const struct tile_samples *s, const int32_t *q, const uint8_t *have,
                             struct quantiser *k) {
    double chi2, worst, best = INFINITY;
    bool flat = tile_code_plane(s, k->plane, &chi2, &worst) > 0;
    enum predictor chosen = PREDICT_SMOOTH;
    for (int p = flat ? PREDICT_PLANE : PREDICT_SMOOTH; p < PREDICTORS; p++) {
        k->predictor = (enum predictor)p;
        double cost = cost_of(k, q, have, s->width, s->width * s->height);
        if (cost < best) {
            best = cost;
            chosen = (enum predictor)p;
        }
    }
    k->predictor = chosen;
    if (chosen != PREDICT_PLANE)
        memset(k->plane, 0, sizeof k->plane);
}

static float dequantise(const struct quantiser *k, int32_t level) {
    return (float)((double)k->base + (double)k->step * level);
}

static void disparity_quantised(const struct tile_samples *s, const uint8_t *have, double step,
                                struct parts *parts, uint8_t *header,
                                struct tile_code_stats *stats) {
    struct quantiser k;
    double levels;
    if (!quantiser_make(s, have, step, &k, &levels)) {
        disparity_exact(s, have, parts, header);
        return;
    }
    int32_t q[TILE_CODE_SAMPLES] = {0}, count = s->width * s->height;
    for (int32_t i = 0; i < count; i++)
        if (have[i]) {
            double d = (double)s->disparity_per_m[i];
            q[i] = (int32_t)floor((d - (double)k.base) / (double)k.step + 0.5);
            stats->error_max_per_m =
                fmax(stats->error_max_per_m, fabs((double)dequantise(&k, q[i]) - d));
        }
    choose_predictor(s, q, have, &k);
    uint32_t z[TILE_CODE_SAMPLES];
    size_t n = 0;
    for (int32_t i = 0; i < count; i++)
        if (have[i])
            z[n++] = zigzag(residual_at(&k, q, have, s->width, i));
    store_residuals(z, n, parts, &header[6]);
    header[4] = (uint8_t)k.predictor;
    put_f32(header + 8, k.base);
    put_f32(header + 12, k.step);
    for (int i = 0; i < 3; i++)
        put_f32(header + 16 + 4 * i, k.plane[i]);
    stats->levels_bits = (int32_t)ceil(log2(levels));
}

/* Channel c of the transformed colour: green, red - green, blue - green, modulo 256. */
static uint8_t colour_get(const uint8_t *rgb, int c) {
    return c == 0 ? rgb[1] : (uint8_t)(rgb[c == 1 ? 0 : 2] - rgb[1]);
}

static uint8_t colour_predict(const uint8_t *plane, int32_t width, int32_t i, int predictor) {
    bool w = i % width > 0, n = i >= width;
    if (!w || !n)
        return w ? plane[i - 1] : n ? plane[i - width] : 0;
    int a = plane[i - 1], b = plane[i - width], c = plane[i - width - 1];
    int p = predictor == PREDICT_MEDIAN ? (int)predict_median(a, b, c)
                                        : (3 * a + 3 * b - 2 * c + 2) >> 2;
    return (uint8_t)(p < 0 ? 0 : p > 255 ? 255 : p);
}

static double colour_part(const struct tile_samples *s, int predictor, uint8_t *out_bytes) {
    int32_t count = s->width * s->height;
    uint8_t plane[TILE_CODE_SAMPLES];
    double cost = 0.0;
    for (int c = 0; c < 3; c++) {
        for (int32_t i = 0; i < count; i++) {
            /* chroma is signed: centre it for the predictor */
            plane[i] = (uint8_t)(colour_get(s->rgb + 3 * i, c) + (c ? 128 : 0));
            int8_t r = (int8_t)(plane[i] - colour_predict(plane, s->width, i, predictor));
            out_bytes[c * count + i] = (uint8_t)zigzag(r);
            cost += fabs((double)r);
        }
    }
    return cost;
}

static void encode_colour(const struct tile_samples *s, struct parts *parts, uint8_t *header) {
    double smooth = colour_part(s, PREDICT_SMOOTH, parts->bytes[PART_COLOUR]);
    double median = colour_part(s, PREDICT_MEDIAN, parts->bytes[PART_COLOUR]);
    header[5] = PREDICT_MEDIAN;
    if (smooth < median) {
        header[5] = PREDICT_SMOOTH;
        (void)colour_part(s, PREDICT_SMOOTH, parts->bytes[PART_COLOUR]);
    }
    parts->size[PART_COLOUR] = 3 * (size_t)(s->width * s->height);
}

static void encode_rest(const struct tile_samples *s, const uint8_t *have, int32_t step,
                        struct parts *parts) {
    size_t count = (size_t)(s->width * s->height), mask = (count + 7) / 8;
    uint8_t *p = parts->bytes[PART_REST];
    memset(p, 0, mask);
    for (size_t i = 0; i < count; i++)
        p[i / 8] |= (uint8_t)(have[i] << (i % 8));
    memcpy(p + mask, s->flags, count);
    for (size_t i = 0; i < count; i++)
        p[mask + count + i] = (uint8_t)(s->confidence[i] / step);
    parts->size[PART_REST] = mask + 2 * count;
}

static enum st pack(struct parts *parts, int level, uint8_t *out_bytes, size_t *inout_size,
                    uint8_t *header, double out_bits[PARTS]) {
    size_t at = *inout_size;
    for (int k = 0; k < PARTS; k++) {
        size_t raw = parts->size[k], room = TILE_CODE_MAX_BYTES - at;
        size_t packed = ZSTD_compress(out_bytes + at, room, parts->bytes[k], raw, level);
        if (ZSTD_isError(packed) || packed >= raw) {
            if (raw > room)
                return ST_INTERNAL;
            memcpy(out_bytes + at, parts->bytes[k], raw);
            packed = raw;
        }
        put_u16(header + 28 + 2 * k, (uint32_t)packed);
        out_bits[k] = 8.0 * (double)packed;
        at += packed;
    }
    *inout_size = at;
    return ST_OK;
}

static enum st check(const struct tile_samples *s, const struct tile_code_options *o) {
    if (s->width < 1 || s->height < 1 || s->width > TILE_CODE_SIDE || s->height > TILE_CODE_SIDE ||
        !(o->step_per_m >= 0.0) || !isfinite(o->step_per_m) || o->confidence_step < 1 ||
        o->confidence_step > 64)
        return ST_INVALID;
    for (int32_t i = 0; i < s->width * s->height; i++) {
        float d = s->disparity_per_m[i];
        if (!isnan(d) && !(d >= 0.0f && isfinite(d)))
            return ST_INVALID;
        if ((s->flags[i] & PHOTO_SKY) && !(d == 0.0f)) /* sky is at infinity, always */
            return ST_INVALID;
    }
    return ST_OK;
}

enum st tile_code_encode(const struct tile_samples *s, const struct tile_code_options *o,
                         uint8_t *out_bytes, size_t *out_size, struct tile_code_stats *out_stats) {
    enum st st = check(s, o);
    if (st)
        return st;
    struct tile_code_stats stats = {.kind = TILE_CODE_SAMPLED, .plane_chi2 = NAN};
    struct parts parts = {.size = {0}};
    uint8_t header[HEADER_BYTES] = {0}, have[TILE_CODE_SAMPLES];
    int32_t count = s->width * s->height;
    for (int32_t i = 0; i < count; i++)
        have[i] = is_coded(s, i);
    if (o->plane && is_plane(s, o, &stats) && plane_positive(stats.plane, s->width, s->height)) {
        stats.kind = TILE_CODE_PLANE;
        for (int k = 0; k < 3; k++)
            put_f32(header + 16 + 4 * k, stats.plane[k]);
        for (int32_t i = 0; i < count; i++)
            stats.error_max_per_m =
                fmax(stats.error_max_per_m,
                     fabs((double)plane_at(stats.plane, i % s->width, i / s->width) -
                          (double)s->disparity_per_m[i]));
    } else if (o->step_per_m > 0.0) {
        disparity_quantised(s, have, o->step_per_m, &parts, header, &stats);
    } else {
        disparity_exact(s, have, &parts, header);
    }
    header[0] = (uint8_t)stats.kind;
    header[1] = (uint8_t)s->width;
    header[2] = (uint8_t)s->height;
    header[3] = (uint8_t)o->confidence_step;
    encode_colour(s, &parts, header);
    encode_rest(s, have, o->confidence_step, &parts);
    size_t size = HEADER_BYTES;
    double bits[PARTS];
    st = pack(&parts, o->zstd_level, out_bytes, &size, header, bits);
    if (st)
        return st;
    memcpy(out_bytes, header, HEADER_BYTES);
    stats.bits_disparity = bits[PART_DISPARITY] / count;
    stats.bits_colour = bits[PART_COLOUR] / count;
    stats.bits_rest = bits[PART_REST] / count;
    *out_size = size;
    if (out_stats)
        *out_stats = stats;
    return ST_OK;
}

/* ---- decoding ---- */

static enum st unpack(const uint8_t *bytes, size_t size, struct parts *parts) {
    size_t at = HEADER_BYTES;
    for (int k = 0; k < PARTS; k++) {
        size_t packed = get_u16(bytes + 28 + 2 * k), raw = parts->size[k];
        if (packed > size - at || packed > raw)
            return ST_FORMAT;
        if (packed == raw) {
            memcpy(parts->bytes[k], bytes + at, raw);
        } else {
            size_t got = ZSTD_decompress(parts->bytes[k], raw, bytes + at, packed);
            if (ZSTD_isError(got) || got != raw)
                return ST_FORMAT;
        }
        at += packed;
    }
    return at == size ? ST_OK : ST_FORMAT;
}

static void decode_colour(const struct parts *parts, int predictor, struct tile_samples *s) {
    int32_t count = s->width * s->height;
    uint8_t plane[TILE_CODE_SAMPLES];
    for (int c = 0; c < 3; c++)
        for (int32_t i = 0; i < count; i++) {
            int32_t r = unzigzag(parts->bytes[PART_COLOUR][c * count + i]);
            plane[i] = (uint8_t)(colour_predict(plane, s->width, i, predictor) + r);
            uint8_t value = (uint8_t)(plane[i] - (c ? 128 : 0));
            uint8_t *rgb = s->rgb + 3 * i;
            if (c == 0)
                rgb[1] = value;
            else
                rgb[c == 1 ? 0 : 2] = (uint8_t)(value + rgb[1]);
        }
}

static void decode_rest(const struct parts *parts, int step, struct tile_samples *s,
                        uint8_t *have) {
    size_t count = (size_t)(s->width * s->height), mask = (count + 7) / 8;
    const uint8_t *p = parts->bytes[PART_REST];
    for (size_t i = 0; i < count; i++) {
        have[i] = (uint8_t)((unsigned)p[i / 8] >> (i % 8) & 1u);
        s->flags[i] = p[mask + i];
        s->confidence[i] = (uint8_t)((unsigned)p[mask + count + i] * (unsigned)step);
    }
}

static enum st decode_levels(const struct quantiser *k, const struct parts *parts, unsigned each,
                             const uint8_t *have, struct tile_samples *s) {
    int32_t q[TILE_CODE_SAMPLES] = {0}, count = s->width * s->height;
    size_t n = parts->size[PART_DISPARITY] / each, at = 0;
    for (int32_t i = 0; i < count; i++) {
        if (!have[i])
            continue;
        uint32_t z = 0;
        for (unsigned b = 0; b < each; b++)
            z |= (uint32_t)parts->bytes[PART_DISPARITY][b * n + at] << (8 * b);
        at++;
        if (k->step > 0.0f) {
            int64_t level = predict_level(k, q, have, s->width, i) + unzigzag(z);
            if (level < 0 || level >= LEVEL_MAX)
                return ST_FORMAT;
            q[i] = (int32_t)level;
            s->disparity_per_m[i] = dequantise(k, q[i]);
        } else {
            memcpy(&s->disparity_per_m[i], &z, sizeof z);
        }
        if (!(s->disparity_per_m[i] >= 0.0f && isfinite(s->disparity_per_m[i])))
            return ST_FORMAT;
    }
    return ST_OK;
}

static enum st decode_disparity(const uint8_t *bytes, const struct parts *parts,
                                const uint8_t *have, struct tile_samples *s) {
    int32_t count = s->width * s->height;
    struct quantiser k = {.base = get_f32(bytes + 8),
                          .step = get_f32(bytes + 12),
                          .predictor = (enum predictor)bytes[4]};
    for (int i = 0; i < 3; i++)
        k.plane[i] = get_f32(bytes + 16 + 4 * i);
    for (int32_t i = 0; i < count; i++) {
        s->disparity_per_m[i] = s->flags[i] & PHOTO_SKY ? 0.0f : (float)NAN;
        if (have[i] && (s->flags[i] & PHOTO_SKY))
            return ST_FORMAT;
    }
    if (bytes[0] == TILE_CODE_PLANE) {
        if (!plane_positive(k.plane, s->width, s->height))
            return ST_FORMAT;
        for (int32_t i = 0; i < count; i++)
            s->disparity_per_m[i] = plane_at(k.plane, i % s->width, i / s->width);
        return ST_OK;
    }
    if (!(k.base >= 0.0f && isfinite(k.base) && k.step >= 0.0f && isfinite(k.step)) ||
        !isfinite(k.plane[0]) || !isfinite(k.plane[1]) || !isfinite(k.plane[2]))
        return ST_FORMAT;
    return decode_levels(&k, parts, bytes[6], have, s);
}

enum st tile_code_decode(const uint8_t *bytes, size_t size, struct tile_samples *out,
                         enum tile_code_kind *out_kind) {
    if (size < HEADER_BYTES || size > TILE_CODE_MAX_BYTES)
        return ST_FORMAT;
    bool plane = bytes[0] == TILE_CODE_PLANE;
    if ((!plane && bytes[0] != TILE_CODE_SAMPLED) || bytes[1] < 1 || bytes[2] < 1 ||
        bytes[1] > TILE_CODE_SIDE || bytes[2] > TILE_CODE_SIDE || bytes[3] < 1 || bytes[3] > 64 ||
        bytes[4] >= PREDICTORS || (bytes[5] != PREDICT_SMOOTH && bytes[5] != PREDICT_MEDIAN) ||
        bytes[7] != 0 || bytes[6] > 4 || (plane ? bytes[6] != 0 : bytes[6] < 1))
        return ST_FORMAT;
    struct parts parts;
    struct tile_samples s = {.width = bytes[1], .height = bytes[2]};
    uint8_t have[TILE_CODE_SAMPLES];
    size_t count = (size_t)(s.width * s.height);
    parts.size[PART_COLOUR] = 3 * count;
    parts.size[PART_REST] = (count + 7) / 8 + 2 * count;
    /* The number of residuals is the mask's, which is packed behind them: look there first. */
    size_t rest_at = HEADER_BYTES + get_u16(bytes + 28) + get_u16(bytes + 30);
    size_t rest = get_u16(bytes + 32);
    if (rest_at + rest != size || rest > parts.size[PART_REST])
        return ST_FORMAT;
    if (rest == parts.size[PART_REST]) {
        memcpy(parts.bytes[PART_REST], bytes + rest_at, rest);
    } else {
        size_t got =
            ZSTD_decompress(parts.bytes[PART_REST], parts.size[PART_REST], bytes + rest_at, rest);
        if (ZSTD_isError(got) || got != parts.size[PART_REST])
            return ST_FORMAT;
    }
    decode_rest(&parts, bytes[3], &s, have);
    size_t n = 0;
    for (size_t i = 0; i < count; i++)
        n += have[i];
    parts.size[PART_DISPARITY] = plane ? 0 : n * bytes[6];
    enum st st = unpack(bytes, size, &parts);
    if (st)
        return st;
    decode_colour(&parts, bytes[5], &s);
    st = decode_disparity(bytes, &parts, have, &s);
    if (st)
        return st;
    *out = s;
    if (out_kind)
        *out_kind = plane ? TILE_CODE_PLANE : TILE_CODE_SAMPLED;
    return ST_OK;
}
