#include "fusion/lod.h"

#include "base/tile_pack.h"
#include "raster/skin.h"

#include <math.h>
#include <string.h>

struct lod_params lod_params_default(void) {
    struct lod_params params = {.sigmas = 4.0, .grazing_rad = 1.3}; /* 75 degrees */
    return params;
}

struct halver {
    const struct photo *fine;
    struct photo *coarse;
    double sigmas, slope_per_px;
    double sigma[256];
    float linear[256];
};

struct child {
    float disparity_per_m, sigma_per_m;
    float du_px, dv_px; /* from the coarse pixel's centre, in fine pixels: +-0.5 */
    size_t at;
};

static float to_linear(int value) {
    double c = value / 255.0;
    return (float)(c <= 0.04045 ? c / 12.92 : pow((c + 0.055) / 1.055, 2.4));
}

static uint8_t to_srgb(float linear) {
    double c = (double)linear;
    double s = c <= 0.0031308 ? 12.92 * c : 1.055 * pow(c, 1.0 / 2.4) - 0.055;
    return (uint8_t)lrint(fmin(fmax(255.0 * s, 0.0), 255.0));
}

static bool same_surface(const struct halver *h, const struct child *a, const struct child *b) {
    float lo = a->disparity_per_m < b->disparity_per_m ? a->disparity_per_m : b->disparity_per_m;
    double away = (double)(fabsf(a->du_px - b->du_px) + fabsf(a->dv_px - b->dv_px));
    double room = h->sigmas * hypot((double)a->sigma_per_m, (double)b->sigma_per_m) +
                  h->slope_per_px * away * (double)lo;
    return (double)fabsf(a->disparity_per_m - b->disparity_per_m) <= room;
}

/* Bits of the children that agree with child k: the largest such set, nearest first where two are
 * equal. */
static unsigned heaviest_set(const struct halver *h, const struct child *c, int n) {
    unsigned best = 0;
    int best_count = 0;
    float best_disparity = -1.0f;
    for (int k = 0; k < n; k++) {
        unsigned set = 0;
        int count = 0;
        for (int j = 0; j < n; j++)
            if (same_surface(h, c + k, c + j)) {
                set |= 1u << j;
                count++;
            }
        if (count > best_count || (count == best_count && c[k].disparity_per_m > best_disparity)) {
            best = set;
            best_count = count;
            best_disparity = c[k].disparity_per_m;
        }
    }
    return best;
}

/* Disparity at the centre: the mean where the members surround it (all four, or two across); three
 * members are a plane; one or two on one side continue nothing and keep their mean. */
static float centre_disparity(const struct child *c, int n, unsigned set) {
    float sum = 0, du = 0, dv = 0;
    int count = 0;
    for (int k = 0; k < n; k++)
        if (set >> k & 1u) {
            sum += c[k].disparity_per_m;
            du += c[k].du_px;
            dv += c[k].dv_px;
            count++;
        }
    if (count != 3)
        return sum / (float)count;
    /* Of three corners the two that lie across from each other have the centre between them. */
    for (int a = 0; a < n; a++)
        for (int b = a + 1; b < n; b++)
            if ((set >> a & 1u) && (set >> b & 1u) && c[a].du_px == -c[b].du_px &&
                c[a].dv_px == -c[b].dv_px)
                return 0.5f * (c[a].disparity_per_m + c[b].disparity_per_m);
    return sum / (float)count;
}

static void write_colour(const struct halver *h, const size_t *at, int n, uint8_t *out_rgb) {
    for (int k = 0; k < 3; k++) {
        float sum = 0;
        for (int i = 0; i < n; i++)
            sum += h->linear[h->fine->rgb[3 * at[i] + (size_t)k]];
        out_rgb[k] = n ? to_srgb(sum / (float)n) : 0;
    }
}

static void write_surface(const struct halver *h, const struct child *c, int n, unsigned set,
                          size_t to) {
    const uint8_t *flags = h->fine->flags;
    size_t members[4];
    int count = 0, unknown = 0, low = 0, filled = 0;
    double var = 0;
    uint8_t mixed = 0;
    for (int k = 0; k < n; k++) {
        if (!(set >> k & 1u))
            continue;
        members[count++] = c[k].at;
        var += (double)c[k].sigma_per_m * (double)c[k].sigma_per_m;
        unknown += h->fine->confidence[c[k].at] == 0;
        low += (flags[c[k].at] & PHOTO_LOW_CONFIDENCE) != 0;
        filled += (flags[c[k].at] & PHOTO_FILLED) != 0;
        mixed |= flags[c[k].at] & PHOTO_MIXED;
    }
    float disparity = centre_disparity(c, n, set);
    /* Neighbours share laser samples: four of them average like 2.6 (bilinear weights) to 4. */
    h->coarse->disparity_per_m[to] = disparity;
    h->coarse->confidence[to] =
        unknown ? 0 : photo_confidence_from_sigma(sqrt(var / (count * (1.0 + 0.6 * (count - 1)))));
    h->coarse->flags[to] =
        (uint8_t)(mixed | (2 * low > count ? PHOTO_LOW_CONFIDENCE : 0) |
                  (filled == count ? PHOTO_FILLED : 0) | (count < n ? PHOTO_MIXED : 0));
    write_colour(h, members, count, h->coarse->rgb + 3 * to);
}

/* No surface: sky or a missing return where most of the pixels say so. */
static void write_nothing(const struct halver *h, const size_t *at, int n, size_t to) {
    int sky = 0, none = 0, dropped = 0;
    size_t sky_at[4];
    for (int k = 0; k < n; k++) {
        uint8_t f = h->fine->flags[at[k]];
        if (f & PHOTO_SKY)
            sky_at[sky++] = at[k];
        else if (f & PHOTO_NO_RETURN)
            none++;
        else if (f & PHOTO_DROPPED)
            dropped++;
    }
    h->coarse->confidence[to] = 0;
    if (sky) {
        h->coarse->disparity_per_m[to] = 0.0f;
        h->coarse->flags[to] = PHOTO_SKY;
        write_colour(h, sky_at, sky, h->coarse->rgb + 3 * to);
        return;
    }
    h->coarse->disparity_per_m[to] = NAN;
    h->coarse->flags[to] = none >= dropped && none ? PHOTO_NO_RETURN : dropped ? PHOTO_DROPPED : 0;
    write_colour(h, at, n, h->coarse->rgb + 3 * to);
}

static void coarse_pixel(const struct halver *h, int32_t x, int32_t y) {
    const struct photo *fine = h->fine;
    size_t to = (size_t)y * (size_t)h->coarse->camera.width_px + (size_t)x, at[4];
    struct child c[4];
    int all = 0, n = 0, sky = 0;
    for (int k = 0; k < 4; k++) {
        int32_t u = 2 * x + (k & 1), v = 2 * y + (k >> 1);
        if (u >= fine->camera.width_px || v >= fine->camera.height_px)
            continue;
        size_t i = (size_t)v * (size_t)fine->camera.width_px + (size_t)u;
        at[all++] = i;
        sky += (fine->flags[i] & PHOTO_SKY) != 0;
        if (isnan(fine->disparity_per_m[i]) || (fine->flags[i] & PHOTO_SKY))
            continue;
        double sigma = h->sigma[fine->confidence[i]];
        c[n].disparity_per_m = fine->disparity_per_m[i];
        c[n].sigma_per_m = (float)sigma;
        c[n].du_px = (k & 1) ? 0.5f : -0.5f;
        c[n].dv_px = (k >> 1) ? 0.5f : -0.5f;
        c[n].at = i;
        n++;
    }
    if (!n || sky > n) {
        write_nothing(h, at, all, to);
        return;
    }
    write_surface(h, c, n, heaviest_set(h, c, n), to);
}

/* A coarse skin is disproved if a cell under it is and none is frontier. */
static void inherit_skins(const struct photo *fine, struct photo *coarse) {
    int32_t w = coarse->camera.width_px, height = coarse->camera.height_px;
    for (int32_t y = 0; y < height; y++)
        for (int32_t x = 0; x < w; x++) {
            size_t to = (size_t)y * (size_t)w + (size_t)x;
            if (!(coarse->flags[to] & PHOTO_SKIN) || isnan(coarse->disparity_per_m[to]))
                continue;
            bool disproved = false, frontier = false;
            for (int32_t v = 2 * y; v < 2 * y + 3 && v < fine->camera.height_px; v++)
                for (int32_t u = 2 * x; u < 2 * x + 3 && u < fine->camera.width_px; u++) {
                    size_t i = (size_t)v * (size_t)fine->camera.width_px + (size_t)u;
                    if (isnan(fine->disparity_per_m[i]) || !(fine->flags[i] & PHOTO_SKIN))
                        continue;
                    bool gone = (fine->flags[i] & PHOTO_NO_RETURN) != 0;
                    disproved |= gone;
                    frontier |= !gone;
                }
            if (disproved && !frontier)
                coarse->flags[to] |= PHOTO_SKIN_DISPROVED;
        }
}

enum st lod_half(const struct photo *fine, const struct lod_params *params,
                 struct photo *out_coarse, struct errctx *err) {
    if (fine->camera.width_px < 2 && fine->camera.height_px < 2)
        return errctx_set(err, ST_INVALID, "one pixel has no coarser level");
    struct camera camera = tile_pack_camera(&fine->camera, 1);
    struct photo coarse = {0};
    enum st st = photo_create(&camera, &coarse, err);
    if (st)
        return st;
    coarse.station_from_cam = fine->station_from_cam;
    struct halver h = {.fine = fine, .coarse = &coarse, .sigmas = params->sigmas};
    h.slope_per_px = tan(params->grazing_rad) / fmin(fine->camera.fx_px, fine->camera.fy_px);
    for (int i = 0; i < 256; i++) {
        h.sigma[i] = i ? photo_sigma_from_confidence((uint8_t)i) : 0.0;
        h.linear[i] = to_linear(i);
    }
#pragma omp parallel for schedule(static)
    for (int32_t y = 0; y < camera.height_px; y++)
        for (int32_t x = 0; x < camera.width_px; x++)
            coarse_pixel(&h, x, y);
    struct skin_params skins = skin_params_default();
    (void)skin_mark(&coarse, &skins);
    inherit_skins(fine, &coarse);
    *out_coarse = coarse;
    return ST_OK;
}

/* Coarse value at a fine pixel: weights 9 3 3 1 of the four coarse pixels around it; NaN unless all
 * four are there and no cell between them is a skin. */
static double interpolate(const struct photo *coarse, int32_t u, int32_t v) {
    int32_t x = u / 2, y = v / 2, dx = u & 1 ? 1 : -1, dy = v & 1 ? 1 : -1;
    int32_t w = coarse->camera.width_px, h = coarse->camera.height_px;
    if (x + dx < 0 || x + dx >= w || y + dy < 0 || y + dy >= h)
        return (double)NAN;
    size_t a = (size_t)y * (size_t)w + (size_t)x, b = (size_t)y * (size_t)w + (size_t)(x + dx);
    size_t c = (size_t)(y + dy) * (size_t)w + (size_t)x;
    size_t d = (size_t)(y + dy) * (size_t)w + (size_t)(x + dx);
    uint8_t edge = coarse->flags[a] | coarse->flags[b] | coarse->flags[c] | coarse->flags[d];
    if (edge & (PHOTO_SILHOUETTE | PHOTO_SKY))
        return (double)NAN;
    const float *p = coarse->disparity_per_m;
    return (9.0 * (double)p[a] + 3.0 * (double)p[b] + 3.0 * (double)p[c] + (double)p[d]) / 16.0;
}

float lod_error(const struct photo *fine, const struct photo *coarse, int32_t u0_px, int32_t v0_px,
                int32_t n_px) {
    double sum = 0;
    int64_t count = 0;
    for (int32_t v = 2 * v0_px; v < 2 * (v0_px + n_px) && v < fine->camera.height_px; v++)
        for (int32_t u = 2 * u0_px; u < 2 * (u0_px + n_px) && u < fine->camera.width_px; u++) {
            size_t i = (size_t)v * (size_t)fine->camera.width_px + (size_t)u;
            if (fine->flags[i] & (PHOTO_SILHOUETTE | PHOTO_SKY))
                continue;
            double off = interpolate(coarse, u, v) - (double)fine->disparity_per_m[i];
            if (isnan(off))
                continue;
            sum += off * off;
            count++;
        }
    return count ? (float)sqrt(sum / (double)count) : NAN;
}
