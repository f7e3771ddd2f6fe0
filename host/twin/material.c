#include "twin/material.h"

#include "twin/noise3.h"

#include <math.h>
#include <stddef.h>

/* Work on one sample: position in features (p / scale), position in metres, normal. */
struct shading {
    const struct material *m;
    float x, y, z;    /* metres, local */
    float u, v, w;    /* in units of scale_m */
    float nx, ny, nz; /* normal, local */
    uint32_t seed;
    int coarse; /* octaves to leave out, and no relief */
};

static int octaves(const struct shading *s, int count) {
    return count > s->coarse + 1 ? count - s->coarse : 1;
}

static void set(struct material_sample *out, const float rgb[3], float k) {
    for (int i = 0; i < 3; i++)
        out->rgb[i] = rgb[i] * k;
}

static void blend(struct material_sample *out, const float rgb[3], float k, float t) {
    for (int i = 0; i < 3; i++)
        out->rgb[i] = noise3_mix(out->rgb[i], rgb[i] * k, t);
}

static void scale(struct material_sample *out, float k) {
    for (int i = 0; i < 3; i++)
        out->rgb[i] *= k;
}

/* A relief from three independent noises at `frequency` per metre. */
static void relief(const struct shading *s, struct material_sample *out, float frequency,
                   float strength) {
    float x = s->x * frequency, y = s->y * frequency, z = s->z * frequency,
          k = strength * s->m->bump;
    out->bump.x += (double)(k * noise3_gradient(x, y, z, s->seed + 101));
    out->bump.y += (double)(k * noise3_gradient(x + 31.7f, y, z, s->seed + 102));
    out->bump.z += (double)(k * noise3_gradient(x, y + 17.3f, z, s->seed + 103));
}

/* In-plane coordinates for flat patterns: the two axes across the normal's largest component. */
static void flat_uv(const struct shading *s, float *u, float *v) {
    float ax = fabsf(s->nx), ay = fabsf(s->ny), az = fabsf(s->nz);
    if (az >= ax && az >= ay) {
        *u = s->x;
        *v = s->y;
    } else if (ax >= ay) {
        *u = s->y;
        *v = s->z;
    } else {
        *u = s->x;
        *v = s->z;
    }
}

static void asphalt(const struct shading *s, struct material_sample *out) {
    struct noise3_cells grain = noise3_worley(s->x * 90, s->y * 90, s->z * 90, s->seed);
    float stone = (float)(grain.id & 255) / 255.0f;
    float large = noise3_fbm(s->x * 0.7f, s->y * 0.7f, s->z * 0.7f, octaves(s, 4), s->seed + 1);
    float worn = noise3_fbm(s->x * 5, s->y * 5, s->z * 5, octaves(s, 3), s->seed + 2);
    set(out, s->m->rgb, 0.62f + 0.7f * stone * stone + 0.28f * large + 0.12f * worn);
    if (stone > 0.93f)
        scale(out, 1.7f);
    float crack =
        noise3_worley(s->x * 0.35f + 0.25f * worn, s->y * 0.35f + 0.25f * large, 0.5f, s->seed + 3)
            .f2;
    struct noise3_cells c =
        noise3_worley(s->x * 0.35f + 0.25f * worn, s->y * 0.35f + 0.25f * large, 0.5f, s->seed + 3);
    float line = noise3_smooth(0.012f, 0.004f, crack - c.f1) * noise3_smooth(0.0f, 0.35f, large);
    scale(out, 1 - 0.65f * line);
    /* damp patches shine */
    float damp = noise3_smooth(
        0.15f, 0.45f, noise3_fbm(s->x * 0.45f, s->y * 0.45f, 7, octaves(s, 3), s->seed + 5));
    out->roughness = noise3_mix(s->m->roughness, 0.18f, damp);
    scale(out, 1 - 0.35f * damp);
    relief(s, out, 140, 0.5f * (1 - 0.8f * damp));
}

static void concrete(const struct shading *s, struct material_sample *out) {
    float a = noise3_fbm(s->x * 2, s->y * 2, s->z * 2, octaves(s, 5), s->seed);
    float b = noise3_fbm(s->x * 40, s->y * 40, s->z * 40, octaves(s, 2), s->seed + 1);
    float stain = noise3_smooth(
        0.1f, 0.5f, noise3_fbm(s->x * 0.8f, s->y * 0.8f, s->z * 0.25f, octaves(s, 4), s->seed + 2));
    set(out, s->m->rgb, 1 + 0.22f * a + 0.12f * b - 0.3f * stain);
    struct noise3_cells pore = noise3_worley(s->x * 30, s->y * 30, s->z * 30, s->seed + 3);
    if (pore.f1 < 0.12f)
        scale(out, 0.6f);
    relief(s, out, 60, 0.35f);
}

static void plaster(const struct shading *s, struct material_sample *out) {
    float a = noise3_fbm(s->x * 1.3f, s->y * 1.3f, s->z * 1.3f, octaves(s, 5), s->seed);
    float b = noise3_fbm(s->x * 25, s->y * 25, s->z * 25, octaves(s, 3), s->seed + 1);
    set(out, s->m->rgb, 1 + 0.12f * a + 0.06f * b);
    float flake = noise3_smooth(
        0.36f, 0.44f,
        noise3_fbm(s->x * 0.9f, s->y * 0.9f, s->z * 0.9f, octaves(s, 5), s->seed + 2));
    blend(out, s->m->rgb2, 1 + 0.25f * b, flake);
    float streak = noise3_smooth(
        0.1f, 0.6f, noise3_fbm(s->x * 3, s->y * 3, s->z * 0.3f, octaves(s, 4), s->seed + 3));
    scale(out, 1 - 0.2f * streak);
    relief(s, out, 45, 0.25f);
}

/* Rows of blocks w x h with joints; gives joint 0..1 and the block's random number. */
static float blocks(const struct shading *s, float w, float h, float joint_m, uint32_t *id,
                    float *lu, float *lv) {
    float u, v;
    flat_uv(s, &u, &v);
    if (fabsf(s->nz) > 0.8f)
        v = s->y;
    float row = floorf(v / h);
    float shift = (float)((int)row & 1) * 0.5f;
    float col = floorf(u / w + shift);
    float fu = (u / w + shift - col) * w, fv = (v / h - row) * h;
    *id = noise3_hash((int32_t)col, (int32_t)row, 7, s->seed);
    *lu = fu;
    *lv = fv;
    float edge = fminf(fminf(fu, w - fu), fminf(fv, h - fv));
    float wave = 0.3f * noise3_gradient(u * 40, v * 40, 0.5f, s->seed + 9);
    return noise3_smooth(joint_m * 1.3f, joint_m * 0.7f, edge + joint_m * wave);
}

static void brick(const struct shading *s, struct material_sample *out) {
    uint32_t id;
    float lu, lv, joint = blocks(s, 0.25f, 0.075f, 0.006f, &id, &lu, &lv);
    float tone = (float)(id & 255) / 255.0f, burn = (float)(id >> 8 & 255) / 255.0f;
    float b = noise3_fbm(s->x * 35, s->y * 35, s->z * 35, octaves(s, 3), s->seed + 1);
    set(out, s->m->rgb, 0.7f + 0.5f * tone + 0.25f * b);
    if (burn > 0.85f)
        scale(out, 0.5f);
    float soot = noise3_fbm(s->x * 0.5f, s->y * 0.5f, s->z * 0.5f, octaves(s, 4), s->seed + 2);
    scale(out, 1 + 0.25f * soot);
    blend(out, s->m->rgb2, 0.9f + 0.3f * b, joint);
    relief(s, out, 70, 0.35f);
}

static void ashlar(const struct shading *s, struct material_sample *out) {
    uint32_t id;
    float lu, lv, joint = blocks(s, s->m->scale_m * 1.9f, s->m->scale_m, 0.005f, &id, &lu, &lv);
    float tone = (float)(id & 255) / 255.0f, warm = (float)(id >> 8 & 255) / 255.0f;
    float a = noise3_fbm(s->x * 2.5f, s->y * 2.5f, s->z * 5, octaves(s, 5), s->seed + (id & 15));
    float b = noise3_fbm(s->x * 40, s->y * 40, s->z * 40, octaves(s, 2), s->seed + 1);
    set(out, s->m->rgb, 0.82f + 0.26f * tone + 0.2f * a + 0.1f * b);
    out->rgb[2] *= 1.06f - 0.18f * warm;
    float damp = noise3_smooth(
        0.15f, 0.55f,
        noise3_fbm(s->x * 0.4f, s->y * 0.4f, s->z * 0.4f, octaves(s, 5), s->seed + 3));
    scale(out, 1 - 0.22f * damp);
    blend(out, s->m->rgb2, 0.85f + 0.2f * b, joint * 0.8f);
    relief(s, out, 50, 0.3f);
    relief(s, out, 9, 0.12f);
}

static void marble(const struct shading *s, struct material_sample *out) {
    float q = noise3_fbm(s->u, s->v, s->w, octaves(s, 5), s->seed);
    float vein = 1 - fabsf(sinf(3.1f * (s->u * 0.6f + s->v * 0.35f + s->w * 0.45f) + 5 * q));
    vein = vein * vein * vein;
    set(out, s->m->rgb, 0.96f + 0.12f * q);
    blend(out, s->m->rgb2, 1, 0.75f * vein);
}

static void stone(const struct shading *s, struct material_sample *out) {
    float a = noise3_fbm(s->x * 1.6f, s->y * 1.6f, s->z * 3.4f, octaves(s, 5), s->seed);
    float b = noise3_fbm(s->x * 45, s->y * 45, s->z * 45, octaves(s, 3), s->seed + 1);
    set(out, s->m->rgb, 0.95f + 0.2f * a + 0.14f * b);
    float crust = noise3_smooth(
        0.2f, 0.55f,
        noise3_fbm(s->x * 3, s->y * 3, s->z * 1.2f, octaves(s, 4), s->seed + 2) - 0.25f * s->nz);
    blend(out, s->m->rgb2, 1 + 0.3f * b, 0.6f * crust);
    relief(s, out, 60, 0.3f);
    relief(s, out, 14, 0.12f);
}

static void paint(const struct shading *s, struct material_sample *out) {
    uint32_t flake = noise3_hash((int32_t)floorf(s->x * 900), (int32_t)floorf(s->y * 900),
                                 (int32_t)floorf(s->z * 900), s->seed);
    set(out, s->m->rgb, 0.94f + 0.12f * (float)(flake & 255) / 255.0f);
    float dirt = noise3_fbm(s->x * 4, s->y * 4, s->z * 6, octaves(s, 5), s->seed + 1);
    float low = noise3_smooth(0.75f, 0.15f, s->z + 0.22f * dirt);
    float film = 0.06f * noise3_smooth(-0.2f, 0.5f, dirt) + 0.72f * low * low;
    blend(out, s->m->rgb2, 0.8f + 0.3f * dirt, film);
    out->roughness = noise3_mix(s->m->roughness, 0.6f, film);
    out->f0 = s->m->f0 * (1 - 0.8f * film);
}

static void wood(const struct shading *s, struct material_sample *out) {
    float bend = noise3_fbm(s->u * 0.5f, s->v * 0.5f, s->w * 0.12f, octaves(s, 3), s->seed);
    float rings = sinf(18 * (sqrtf(s->u * s->u + s->v * s->v) + 0.6f * bend));
    float fibre = noise3_fbm(s->x * 120, s->y * 120, s->z * 6, octaves(s, 3), s->seed + 1);
    set(out, s->m->rgb, 0.92f + 0.2f * fibre);
    blend(out, s->m->rgb2, 1 + 0.2f * fibre, 0.5f + 0.5f * rings);
    relief(s, out, 90, 0.15f);
}

static void bark(const struct shading *s, struct material_sample *out) {
    float a = noise3_ridged(s->x * 9, s->y * 9, s->z * 2.2f, octaves(s, 4), s->seed);
    float b = noise3_fbm(s->x * 30, s->y * 30, s->z * 30, octaves(s, 3), s->seed + 1);
    set(out, s->m->rgb, 0.35f + 0.95f * a * a + 0.2f * b);
    float moss =
        noise3_smooth(0.1f, 0.5f, noise3_fbm(s->x, s->y, s->z * 0.6f, octaves(s, 4), s->seed + 2));
    blend(out, s->m->rgb2, 0.7f + 0.4f * b, 0.5f * moss);
    relief(s, out, 16, 0.9f);
}

static void leaf(const struct shading *s, struct material_sample *out) {
    uint32_t h = noise3_hash((int32_t)floorf(s->x * 7), (int32_t)floorf(s->y * 7),
                             (int32_t)floorf(s->z * 7), s->seed);
    float t = (float)(h & 255) / 255.0f;
    set(out, s->m->rgb, 0.7f + 0.6f * t);
    blend(out, s->m->rgb2, 1, 0.7f * (float)(h >> 8 & 255) / 255.0f);
}

static void grass(const struct shading *s, struct material_sample *out) {
    float a = noise3_fbm(s->x * 0.8f, s->y * 0.8f, s->z, octaves(s, 4), s->seed);
    float b = noise3_fbm(s->x * 35, s->y * 35, s->z * 20, octaves(s, 3), s->seed + 1);
    set(out, s->m->rgb, 0.8f + 0.6f * b + 0.2f * a);
    blend(out, s->m->rgb2, 0.8f + 0.5f * b, noise3_smooth(-0.15f, 0.5f, a));
    relief(s, out, 60, 0.9f);
}

static void checker(const struct shading *s, struct material_sample *out) {
    int odd = ((int)floorf(s->u) + (int)floorf(s->v)) & 1;
    set(out, odd ? s->m->rgb2 : s->m->rgb, 1);
}

static void road_mark(const struct shading *s, struct material_sample *out) {
    float a = noise3_fbm(s->x * 12, s->y * 12, s->z, octaves(s, 4), s->seed);
    float b = noise3_fbm(s->x * 1.1f, s->y * 1.1f, s->z, octaves(s, 3), s->seed + 1);
    set(out, s->m->rgb, 0.9f + 0.15f * a);
    struct noise3_cells grain = noise3_worley(s->x * 90, s->y * 90, s->z * 90, s->seed + 2);
    float worn = noise3_smooth(0.12f, 0.32f, 0.6f * b + 0.4f * a + 0.25f * (grain.f1 - 0.4f));
    blend(out, s->m->rgb2, 0.8f, 0.85f * worn);
    relief(s, out, 140, 0.3f);
}

/* Distance to the edge of a regular polygon of inradius 1 about the origin; negative inside. */
static float polygon(float u, float v, int sides, float turn) {
    float best = -1e9f;
    for (int i = 0; i < sides; i++) {
        float a = turn + 6.2831853f * (float)i / (float)sides;
        best = fmaxf(best, u * cosf(a) + v * sinf(a) - 1);
    }
    return best;
}

/* Bars of a letter on a 3 x 5 grid (u to the right, v up, both 0..1): enough to be read from afar.
 */
static int glyph(const char rows[5][4], float u, float v) {
    int col = (int)floorf(u * 3), row = 4 - (int)floorf(v * 5);
    return col >= 0 && col < 3 && row >= 0 && row < 5 && rows[row][col] == '#';
}

static const char glyph_s[5][4] = {"###", "#..", "###", "..#", "###"};
static const char glyph_t[5][4] = {"###", ".#.", ".#.", ".#.", ".#."};
static const char glyph_o[5][4] = {"###", "#.#", "#.#", "#.#", "###"};
static const char glyph_p[5][4] = {"###", "#.#", "###", "#..", "#.."};
static const char glyph_5[5][4] = {"###", "#..", "###", "..#", "###"};
static const char glyph_0[5][4] = {"###", "#.#", "#.#", "#.#", "###"};
static const char glyph_a[5][4] = {".#.", "#.#", "###", "#.#", "#.#"};
static const char glyph_c[5][4] = {"###", "#..", "#..", "#..", "###"};
static const char glyph_7[5][4] = {"###", "..#", ".#.", ".#.", ".#."};
static const char glyph_4[5][4] = {"#.#", "#.#", "###", "..#", "..#"};

/* Is (u, v) on a stroke of a row of letters, each 0.75 wide and 1 high, starting at 0? */
static int word(const char (*const *letters)[4], int count, float u, float v) {
    int i = (int)floorf(u);
    if (i < 0 || i >= count || v < 0 || v > 1)
        return 0;
    return glyph(letters[i], (u - (float)i) / 0.75f, v);
}

static void sign(const struct shading *s, struct material_sample *out) {
    static const char(*const stop[4])[4] = {glyph_s, glyph_t, glyph_o, glyph_p};
    static const char(*const fifty[2])[4] = {glyph_5, glyph_0};
    static const float white[3] = {0.8f, 0.8f, 0.78f}, black[3] = {0.02f, 0.02f, 0.02f};
    float u = s->u, v = s->v; /* the sign fills -1..1 */
    set(out, white, 1);
    if (s->m->texture == TEXTURE_SIGN_STOP) {
        if (polygon(u, v, 8, 0.3926991f) < -0.08f)
            set(out, s->m->rgb, 1);
        if (word(stop, 4, (u + 0.68f) / 0.36f, (v + 0.3f) / 0.6f))
            set(out, white, 1);
    } else if (s->m->texture == TEXTURE_SIGN_LIMIT) {
        float r = sqrtf(u * u + v * v);
        if (r > 0.76f)
            set(out, s->m->rgb, 1);
        if (word(fifty, 2, (u + 0.46f) / 0.5f, (v + 0.36f) / 0.72f))
            set(out, black, 1);
    } else {
        float tri = polygon(u, v + 0.33f, 3, -1.5707963f);
        if (tri / 1 > -0.45f)
            set(out, s->m->rgb, 1);
        int bar = fabsf(u) < 0.07f && v > -0.05f && v < 0.55f;
        int dot = u * u + (v + 0.2f) * (v + 0.2f) < 0.008f;
        if (bar || dot)
            set(out, black, 1);
    }
    float scratch = noise3_fbm(s->x * 20, s->y * 20, s->z * 20, octaves(s, 4), s->seed);
    scale(out, 0.95f + 0.12f * scratch);
}

static void plate(const struct shading *s, struct material_sample *out) {
    static const char(*const text[7])[4] = {glyph_s, glyph_c, glyph_a, glyph_7,
                                            glyph_4, glyph_0, glyph_5};
    static const float black[3] = {0.02f, 0.02f, 0.03f}, blue[3] = {0.02f, 0.06f, 0.35f};
    set(out, s->m->rgb, 1); /* u: -0.26..0.26 m, v: -0.055..0.055 m */
    if (s->u < -0.225f)
        set(out, blue, 1);
    else if (word(text, 7, (s->u + 0.2f) / 0.062f, (s->v + 0.036f) / 0.072f))
        set(out, black, 1);
    else if (fabsf(s->v) > 0.049f || fabsf(s->u) > 0.254f)
        set(out, black, 1);
}

static void rust(const struct shading *s, struct material_sample *out) {
    float a = noise3_fbm(s->x * 6, s->y * 6, s->z * 6, octaves(s, 5), s->seed);
    float b = noise3_fbm(s->x * 60, s->y * 60, s->z * 60, octaves(s, 2), s->seed + 1);
    set(out, s->m->rgb, 0.9f + 0.3f * b);
    blend(out, s->m->rgb2, 0.8f + 0.5f * b, noise3_smooth(-0.1f, 0.3f, a));
    relief(s, out, 80, 0.5f);
}

static void cloth(const struct shading *s, struct material_sample *out) {
    float weave = sinf(s->x * 1800) * sinf(s->z * 1800 + s->y * 1800);
    float a = noise3_fbm(s->x * 6, s->y * 6, s->z * 6, octaves(s, 4), s->seed);
    set(out, s->m->rgb, 0.9f + 0.08f * weave + 0.2f * a);
    relief(s, out, 22, 0.25f);
}

static void floor_tiles(const struct shading *s, struct material_sample *out) {
    float fu = s->u - floorf(s->u), fv = s->v - floorf(s->v);
    int odd = ((int)floorf(s->u) + (int)floorf(s->v)) & 1;
    uint32_t id = noise3_hash((int32_t)floorf(s->u), (int32_t)floorf(s->v), 3, s->seed);
    float tone = (float)(id & 255) / 255.0f;
    struct shading cut = *s;
    cut.w += (float)(id >> 8 & 255); /* each tile from another place of the block */
    float q = noise3_fbm(cut.u * 1.7f, cut.v * 1.7f, cut.w, octaves(s, 5), s->seed + 1);
    float vein = 1 - fabsf(sinf(4 * (cut.u + 0.4f * cut.v) + 6 * q + (float)(id & 7)));
    vein = vein * vein * vein * vein;
    set(out, odd ? s->m->rgb2 : s->m->rgb, 0.82f + 0.3f * tone + 0.15f * q);
    scale(out, odd ? 1 + 1.2f * vein : 1 - 0.35f * vein);
    float edge = fminf(fminf(fu, 1 - fu), fminf(fv, 1 - fv)) * s->m->scale_m;
    float joint = noise3_smooth(0.004f, 0.002f, edge);
    scale(out, 1 - 0.65f * joint);
    float worn = noise3_fbm(s->x * 0.7f, s->y * 0.7f, 0, octaves(s, 4), s->seed + 2);
    out->roughness = s->m->roughness * (1 + 0.8f * noise3_smooth(-0.3f, 0.5f, worn)) + 0.4f * joint;
    out->f0 = s->m->f0 * (1 - 0.8f * joint);
}

static void tyre(const struct shading *s, struct material_sample *out) {
    float dust = noise3_fbm(s->x * 9, s->y * 9, s->z * 9, octaves(s, 4), s->seed);
    set(out, s->m->rgb, 1);
    blend(out, s->m->rgb2, 1, 0.16f + 0.25f * noise3_smooth(-0.1f, 0.5f, dust));
    /* tread: blocks around the tyre, whose axis is y */
    float r = sqrtf(s->x * s->x + s->z * s->z), a = atan2f(s->z, s->x);
    if (r > s->m->scale_m * 0.97f) {
        float groove = fabsf(sinf(a * 34 + 40 * fabsf(s->y))) < 0.25f;
        float ring = fabsf(sinf(s->y * 95)) < 0.22f;
        if (groove > 0 || ring > 0)
            scale(out, 0.35f);
    } else {
        float text = sinf(a * 40) * noise3_gradient(a * 9, r * 40, 0, s->seed + 3);
        float band = noise3_smooth(0.02f, 0.0f, fabsf(r - s->m->scale_m * 0.8f));
        scale(out, 1 + 0.5f * band * (text > 0.15f ? 1.0f : 0.0f));
    }
}

static void stripes(const struct shading *s, struct material_sample *out) {
    int odd = (int)floorf(s->w) & 1;
    float a = noise3_fbm(s->x * 14, s->y * 14, s->z * 14, octaves(s, 4), s->seed);
    set(out, odd ? s->m->rgb2 : s->m->rgb, 0.95f + 0.15f * a);
    scale(out, 1 - 0.3f * noise3_smooth(0.1f, 0.5f, a));
}

static void dummy(const struct shading *s, struct material_sample *out) {
    static const float yellow[3] = {0.75f, 0.5f, 0.02f}, black[3] = {0.02f, 0.02f, 0.02f};
    float a = noise3_fbm(s->x * 8, s->y * 8, s->z * 8, octaves(s, 4), s->seed);
    set(out, s->m->rgb, 0.97f + 0.12f * a);
    struct noise3_cells c = noise3_worley(s->x * 5.5f, s->y * 5.5f, s->z * 5.5f, s->seed + 1);
    if (c.f1 < 0.22f && (c.id & 3) == 0) { /* round markers in quarters */
        int quarter = (noise3_gradient(s->x * 30, s->y * 30, s->z * 30, 5) > 0);
        set(out, quarter ? yellow : black, 1);
    }
}

static void dirt(const struct shading *s, struct material_sample *out) {
    float a = noise3_fbm(s->x * 1.5f, s->y * 1.5f, s->z * 1.5f, octaves(s, 5), s->seed);
    float b = noise3_fbm(s->x * 50, s->y * 50, s->z * 50, octaves(s, 3), s->seed + 1);
    set(out, s->m->rgb, 0.9f + 0.4f * b);
    blend(out, s->m->rgb2, 0.9f + 0.4f * b, noise3_smooth(-0.2f, 0.3f, a));
    relief(s, out, 50, 0.8f);
}

static void brushed(const struct shading *s, struct material_sample *out) {
    float a = noise3_fbm(s->x * 300, s->y * 300, s->z * 4, octaves(s, 2), s->seed);
    set(out, s->m->rgb, 0.93f + 0.12f * a);
    out->roughness = s->m->roughness * (1 + 0.4f * a);
}

static void windows(const struct shading *s, struct material_sample *out) {
    set(out, s->m->rgb, 1);
    float u, v;
    flat_uv(s, &u, &v);
    uint32_t id =
        noise3_hash((int32_t)floorf(u / s->m->scale_m), (int32_t)floorf(v / 3.0f), 1, s->seed);
    if ((id & 7) < 2) { /* somebody is at home, behind a curtain */
        float fold = 0.75f + 0.25f * sinf(u * 70 + 2 * noise3_gradient(u * 9, v, 0, s->seed));
        float warm = 0.6f + 0.4f * (float)(id >> 8 & 255) / 255.0f;
        for (int i = 0; i < 3; i++)
            out->emission[i] = s->m->rgb2[i] * fold * warm;
    }
}

static void roof(const struct shading *s, struct material_sample *out) {
    uint32_t id;
    float lu, lv, joint = blocks(s, 0.22f, 0.33f, 0.01f, &id, &lu, &lv);
    set(out, s->m->rgb, (0.6f + 0.6f * (float)(id & 255) / 255.0f) * (0.55f + 1.4f * lv));
    scale(out, 1 - 0.6f * joint);
}

static void velvet(const struct shading *s, struct material_sample *out) {
    float a = noise3_fbm(s->x * 7, s->y * 7, s->z * 7, octaves(s, 4), s->seed);
    set(out, s->m->rgb, 0.8f + 0.5f * a);
}

typedef void texture_function(const struct shading *s, struct material_sample *out);

/* In the order of enum material_texture. */
static texture_function *const textures[] = {
    NULL,  asphalt,     concrete, plaster, brick,     ashlar, marble,  stone,   paint, wood,
    bark,  leaf,        grass,    checker, road_mark, sign,   sign,    sign,    plate, rust,
    cloth, floor_tiles, tyre,     stripes, dummy,     dirt,   brushed, windows, roof,  velvet,
};

void material_sample_at(const struct material *m, struct vec3 p, struct vec3 n, bool coarse,
                        struct material_sample *out) {
    struct shading s = {.m = m,
                        .x = (float)p.x,
                        .y = (float)p.y,
                        .z = (float)p.z,
                        .nx = (float)n.x,
                        .ny = (float)n.y,
                        .nz = (float)n.z,
                        .seed = m->seed,
                        .coarse = coarse ? 2 : 0};
    float inverse = m->scale_m > 0 ? 1 / m->scale_m : 1;
    s.u = s.x * inverse;
    s.v = s.y * inverse;
    s.w = s.z * inverse;
    set(out, m->rgb, 1);
    out->roughness = m->roughness;
    out->f0 = m->f0;
    out->bump = vec3_make(0, 0, 0);
    for (int i = 0; i < 3; i++)
        out->emission[i] = m->emission[i];
    if (textures[m->texture])
        textures[m->texture](&s, out);
    out->roughness = out->roughness < 0 ? 0 : out->roughness > 1 ? 1 : out->roughness;
    float mean = 0, own = 0;
    for (int i = 0; i < 3; i++) {
        out->rgb[i] = out->rgb[i] < 0 ? 0 : out->rgb[i] > 0.97f ? 0.97f : out->rgb[i];
        mean += out->rgb[i];
        own += m->rgb[i];
    }
    /* The pattern's contrast carries over to the infrared, but weaker: pigments are alike there. */
    float ratio = own > 1e-6f ? mean / own : 1;
    float ir = m->albedo_ir * (0.4f + 0.6f * ratio);
    out->albedo_ir = ir < 0.002f ? 0.002f : ir > 0.97f ? 0.97f : ir;
}
