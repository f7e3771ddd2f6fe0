#include "fusion/resolve.h"

#include "base/pages.h"
#include "fusion/resolve_work.h"
#include "fusion/sky.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double rad_per_deg = 0.017453292519943295;

struct resolve_params resolve_params_default(void) {
    struct resolve_params params = {.min_weight = 0.001,
                                    .mixed_ratio = 0.4,
                                    .agree_sigmas = 3.0,
                                    .sigma_angle_rad = 0.0,
                                    .beam_rad = 0.0,
                                    .sigma_system_m = 0.0,
                                    .low_confidence = 0.01,
                                    .low_confidence_m = 0.02,
                                    .sky_elevation_rad = 20.0 * rad_per_deg,
                                    .refuse_mixed = 1,
                                    .plain_mean = 0};
    return params;
}

/* ---- choosing a cluster ---- */

const struct cluster_layer *resolve_heaviest(const struct resolve_work *w, size_t i) {
    const struct cluster_pixel *pixel = w->image->px + i;
    uint32_t at = w->refused[i];
    if (at >= pixel->layer_count)
        return NULL;
    const struct cluster_layer *layer = pixel->layers + at;
    if (layer->weight < (float)w->params->min_weight || layer->weight < pixel->none_weight)
        return NULL;
    return layer;
}

void resolve_choose(struct resolve_work *w, size_t i) {
    const struct cluster_layer *layer = resolve_heaviest(w, i);
    struct candidate *c = w->candidates + i;
    c->disparity_per_m = NAN;
    if (!layer)
        return;
    c->disparity_per_m = layer->disparity_per_m;
    c->sigma_per_m = cluster_sigma(layer);
    c->u_px = (float)(i % (size_t)w->width) + layer->du_px;
    c->v_px = (float)(i / (size_t)w->width) + layer->dv_px;
}

/* For comparison with the literature: all layers averaged. */
static void flatten(struct cluster_pixel *pixel) {
    if (pixel->layer_count < 2)
        return;
    struct cluster_layer *a = pixel->layers;
    for (uint32_t j = 1; j < pixel->layer_count; j++) {
        const struct cluster_layer *b = pixel->layers + j;
        float share = b->weight / (a->weight + b->weight);
        a->weight += b->weight;
        a->var_sum += b->var_sum;
        a->disparity_per_m += share * (b->disparity_per_m - a->disparity_per_m);
        a->du_px += share * (b->du_px - a->du_px);
        a->dv_px += share * (b->dv_px - a->dv_px);
    }
    pixel->layer_count = 1;
}

static void choose_first(struct resolve_work *w) {
    size_t pixels = (size_t)w->width * (size_t)w->height;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < pixels; i++) {
        if (w->params->plain_mean)
            flatten(w->image->px + i);
        else
            cluster_merge(w->image->px + i, &w->rule, NAN, NAN);
        memset(w->candidates + i, 0, sizeof w->candidates[i]);
        resolve_choose(w, i);
    }
}

/* ---- gradient ---- */

/* True if five candidates in a row, (x, y) the one at place `at` of 0..4, lie on one line: a
 * surface however steep. Their slope goes to out_slope. */
static bool steep_line(const struct resolve_work *w, int32_t x, int32_t y, int32_t dx, int32_t dy,
                       int32_t at, float *out_slope) {
    const struct candidate *c[5];
    for (int k = 0; k < 5; k++) {
        c[k] = neighbour(w, x + (k - at) * dx * w->stride, y + (k - at) * dy * w->stride);
        if (!c[k])
            return false;
    }
    float t[5], mean_t = 0, mean_d = 0;
    for (int k = 0; k < 5; k++) {
        t[k] = dx ? c[k]->u_px - c[2]->u_px : c[k]->v_px - c[2]->v_px;
        mean_t += t[k] / 5.0f;
        mean_d += c[k]->disparity_per_m / 5.0f;
    }
    float stt = 0, std = 0;
    for (int k = 0; k < 5; k++) {
        stt += (t[k] - mean_t) * (t[k] - mean_t);
        std += (t[k] - mean_t) * (c[k]->disparity_per_m - mean_d);
    }
    if (!(stt > 1.0f))
        return false;
    float slope = std / stt;
    for (int k = 0; k < 5; k++) {
        float off = c[k]->disparity_per_m - mean_d - slope * (t[k] - mean_t);
        /* A tenth of a pixel of the slope itself: places are known no better. */
        if (fabsf(off) > (float)w->params->agree_sigmas * c[k]->sigma_per_m + 0.1f * fabsf(slope))
            return false;
    }
    *out_slope = slope;
    return true;
}

/* The same at the border of a surface, for slopes that the fit below leaves out. */
static bool steep_border(const struct resolve_work *w, int32_t x, int32_t y, int32_t dx, int32_t dy,
                         float *out_slope) {
    float most = w->rule.slope_per_px * neighbour(w, x, y)->disparity_per_m, slope;
    for (int32_t at = 0; at <= 4; at += 4)
        if (steep_line(w, x, y, dx, dy, at, &slope) && fabsf(slope) > most) {
            *out_slope = slope;
            return true;
        }
    return false;
}

struct plane_sums {
    float n, u, v, d, uu, uv, vv, ud, vd; /* relative to the pixel's own mean place */
    float same;                           /* pixels that share its samples, itself included */
};

/* Gradient by least squares over the neighbours that agree; false if they do not determine it.
 *
 * Moving the mean by -c to the centre takes d_i - c.g with g = S^-1 sum (p_j - p) d_j. Where
 * samples are few, `same` pixels share the very sample of this one, and the variance of the result
 * is, in units of its own, 1 - 2 same c.S^-1 (p_i - p) + same c.S^-1 c. */
static bool gradient_fit(const struct plane_sums *s, int32_t x, int32_t y,
                         const struct candidate *me, struct candidate *out) {
    if (s->n < 3.0f)
        return false;
    float uu = s->uu - s->u * s->u / s->n, uv = s->uv - s->u * s->v / s->n;
    float vv = s->vv - s->v * s->v / s->n;
    float ud = s->ud - s->u * s->d / s->n, vd = s->vd - s->v * s->d / s->n;
    float det = uu * vv - uv * uv;
    if (!(det > 0.25f)) /* px^4; a 3 x 3 grid has 36, three neighbours in an L about 0.5 */
        return false;
    out->gu = (ud * vv - vd * uv) / det;
    out->gv = (vd * uu - ud * uv) / det;
    float cu = me->u_px - (float)x, cv = me->v_px - (float)y;
    float hu = (cu * vv - cv * uv) / det, hv = (cv * uu - cu * uv) / det; /* S^-1 c */
    float self = -hu * s->u / s->n - hv * s->v / s->n, all = hu * cu + hv * cv;
    float factor = 1.0f - 2.0f * s->same * self + s->same * all;
    out->var_factor = factor < 0.25f ? 0.25f : factor > 4.0f ? 4.0f : factor;
    return true;
}

static void gradient_at(const struct resolve_work *w, int32_t x, int32_t y, struct candidate *out) {
    const struct candidate *me = neighbour(w, x, y);
    out->gu = out->gv = 0.0f;
    out->var_factor = 1.0f;
    if (!me)
        return;
    struct plane_sums s = {0};
    float slope = w->rule.slope_per_px * me->disparity_per_m;
    for (int32_t dy = -1; dy <= 1; dy++)
        for (int32_t dx = -1; dx <= 1; dx++) {
            const struct candidate *c = neighbour(w, x + dx, y + dy);
            if (!c)
                continue;
            float u = c->u_px - me->u_px, v = c->v_px - me->v_px;
            float d = c->disparity_per_m - me->disparity_per_m;
            if (fabsf(d) > noise_of(w, me, c) + slope * (fabsf(u) + fabsf(v)))
                continue;
            s.n += 1.0f;
            s.u += u, s.v += v, s.d += d;
            s.uu += u * u, s.uv += u * v, s.vv += v * v;
            s.ud += u * d, s.vd += v * d;
            float away = fabsf(u) + fabsf(v);
            s.same += away < 0.5f ? 1.0f - 2.0f * away : 0.0f;
        }
    bool found = gradient_fit(&s, x, y, me, out);
    if (found && s.n >= 8.0f)
        return;
    (void)(steep_line(w, x, y, 1, 0, 2, &out->gu) || steep_border(w, x, y, 1, 0, &out->gu));
    (void)(steep_line(w, x, y, 0, 1, 2, &out->gv) || steep_border(w, x, y, 0, 1, &out->gv));
}

int32_t resolve_next_mark(const uint8_t *row, int32_t from, int32_t width) {
    const uint8_t *at = from < width ? memchr(row + from, 1, (size_t)(width - from)) : NULL;
    return at ? (int32_t)(at - row) : width;
}

void resolve_gradients(struct resolve_work *w, const uint8_t *only) {
#pragma omp parallel for schedule(dynamic, 8)
    for (int32_t y = 0; y < w->height; y++) {
        size_t row = (size_t)y * (size_t)w->width;
        for (int32_t x = 0; x < w->width; x++) {
            if (only && (x = resolve_next_mark(only + row, x, w->width)) >= w->width)
                break;
            gradient_at(w, x, y, w->candidates + row + (size_t)x);
        }
    }
}

void resolve_mark_around(const struct resolve_work *w, uint8_t *marks, int32_t x, int32_t y) {
    int32_t reach = 2 * w->strip + 1;
    for (int32_t j = y - reach; j <= y + reach; j++)
        for (int32_t i = x - reach; i <= x + reach; i++)
            if (i >= 0 && j >= 0 && i < w->width && j < w->height)
                marks[(size_t)j * (size_t)w->width + (size_t)i] = 1;
}

/* On surfaces steeper than the clustering made room for, one surface has several layers: now that
 * its gradient is known, join them. */
static int64_t merge_steep(struct resolve_work *w, uint8_t *touched) {
    int64_t merged = 0;
#pragma omp parallel for schedule(dynamic, 8) reduction(+ : merged)
    for (int32_t y = 0; y < w->height; y++)
        for (int32_t x = 0; x < w->width; x++) {
            size_t i = (size_t)y * (size_t)w->width + (size_t)x;
            struct cluster_pixel *pixel = w->image->px + i;
            const struct candidate *c = w->candidates + i;
            uint32_t before = pixel->layer_count;
            if (before < 2 || isnan(c->disparity_per_m) || (c->gu == 0.0f && c->gv == 0.0f))
                continue;
            cluster_merge(pixel, &w->rule, c->gu, c->gv);
            w->refused[i] = pixel->layer_count < before; /* borrowed until the loop has ended */
            merged += w->refused[i];
        }
    memset(touched, 0, (size_t)w->width * (size_t)w->height);
    for (int32_t y = 0; merged && y < w->height; y++)
        for (int32_t x = 0; x < w->width; x++) {
            size_t i = (size_t)y * (size_t)w->width + (size_t)x;
            if (!w->refused[i])
                continue;
            w->refused[i] = 0;
            resolve_choose(w, i);
            resolve_mark_around(w, touched, x, y);
        }
    return merged;
}

/* ---- results ---- */

static double sigma_at(const struct resolve_work *w, const struct candidate *c,
                       const struct cluster_layer *layer, double range_m) {
    const struct camera *camera = &w->image->camera;
    double samples = (double)(c->sigma_per_m * c->sigma_per_m * c->var_factor);
    double ju = (double)c->gu * camera->fx_px * w->params->sigma_angle_rad;
    double jv = (double)c->gv * camera->fy_px * w->params->sigma_angle_rad;
    double count = (double)(layer->count & CLUSTER_COUNT_MAX);
    double angle = (ju * ju + jv * jv) * fmin(1.0, 1.78 / count); /* 1.78: bilinear weights */
    double system = w->params->sigma_system_m * (double)c->disparity_per_m / range_m;
    return sqrt(samples + angle + system * system);
}

static uint8_t flags_at(const struct resolve_work *w, size_t i, const struct cluster_layer *layer,
                        double sigma_per_m, double range_m) {
    const struct cluster_pixel *pixel = w->image->px + i;
    const struct resolve_params *p = w->params;
    uint8_t flags = 0;
    if (!(layer->count & CLUSTER_OWN))
        flags |= PHOTO_FILLED;
    float strong = (float)p->mixed_ratio * layer->weight;
    bool mixed = pixel->none_weight > strong || w->refused[i] > 0;
    for (uint32_t k = 0; k < pixel->layer_count; k++)
        if (pixel->layers + k != layer && pixel->layers[k].weight > strong)
            mixed = true;
    if (mixed)
        flags |= PHOTO_MIXED;
    double sigma_m = sigma_per_m * range_m / (double)layer->disparity_per_m;
    if (sigma_m > p->low_confidence * range_m && sigma_m > p->low_confidence_m)
        flags |= PHOTO_LOW_CONFIDENCE;
    return flags;
}

static uint8_t nothing_at(const struct resolve_work *w, size_t i) {
    const struct cluster_pixel *pixel = w->image->px + i;
    float heaviest_weight = pixel->layer_count ? pixel->layers[0].weight : 0.0f;
    if (w->refused[i])
        return PHOTO_DROPPED | PHOTO_MIXED;
    if (pixel->none_weight > (float)w->params->min_weight && pixel->none_weight > heaviest_weight &&
        pixel->none_weight >= pixel->dropped_weight)
        return PHOTO_NO_RETURN;
    if (pixel->dropped_weight > 0.0f || heaviest_weight > 0.0f || pixel->none_weight > 0.0f)
        return PHOTO_DROPPED;
    return 0;
}

static void write_pixel(const struct resolve_work *w, size_t i, int colour, struct photo *photo) {
    int32_t x = (int32_t)(i % (size_t)w->width), y = (int32_t)(i / (size_t)w->width);
    const struct candidate *c = w->candidates + i;
    const struct cluster_layer *layer = resolve_heaviest(w, i);
    if (!layer) {
        photo->disparity_per_m[i] = NAN;
        photo->confidence[i] = 0;
        photo->flags[i] = nothing_at(w, i);
        return;
    }
    float shift = -c->gu * layer->du_px - c->gv * layer->dv_px;
    float delta = layer->disparity_per_m + shift, unmoved = 0.0f;
    /* Steeper than the samples bear out, or at an edge: the samples' own, no better known than by
     * the way to the centre. */
    if (!(delta > 0.0f && isfinite(delta)) ||
        (!w->params->plain_mean && mixed_overhangs(w, x, y))) {
        delta = layer->disparity_per_m;
        unmoved = shift;
    }
    const struct camera *camera = &w->image->camera;
    struct vec3 ray = camera_pinhole_ray(camera, (double)x, (double)y);
    double range_m = vec3_norm(ray) / (double)delta;
    double sigma = hypot(sigma_at(w, c, layer, range_m), (double)unmoved);
    photo->disparity_per_m[i] = delta;
    photo->confidence[i] = photo_confidence_from_sigma(sigma);
    photo->flags[i] = flags_at(w, i, layer, sigma, range_m);
    if (colour)
        for (int k = 0; k < 3; k++)
            photo->rgb[3 * i + (size_t)k] = (uint8_t)(layer->rgb[k] >> 8);
}

static void count_flags(const struct photo *photo, struct resolve_counts *counts) {
    size_t pixels = (size_t)photo->camera.width_px * (size_t)photo->camera.height_px;
    for (size_t i = 0; i < pixels; i++) {
        uint8_t f = photo->flags[i];
        if (isnan(photo->disparity_per_m[i])) {
            counts->no_return += (f & PHOTO_NO_RETURN) != 0;
            counts->dropped += (f & PHOTO_DROPPED) != 0;
            counts->unseen += !(f & (PHOTO_NO_RETURN | PHOTO_DROPPED));
            continue;
        }
        if (f & PHOTO_SKY) {
            counts->sky++;
            continue;
        }
        counts->valid++;
        counts->filled += (f & PHOTO_FILLED) != 0;
        counts->mixed += (f & PHOTO_MIXED) != 0;
        counts->low_confidence += (f & PHOTO_LOW_CONFIDENCE) != 0;
    }
}

static struct resolve_work work_make(struct layer_image *image,
                                     const struct resolve_params *params) {
    double f = fmin(image->camera.fx_px, image->camera.fy_px);
    struct resolve_work w = {.image = image,
                             .params = params,
                             .rule = {.sigmas = (float)image->params.cluster_sigmas,
                                      .slope_per_px = (float)(tan(image->params.grazing_rad) / f)},
                             .width = image->camera.width_px,
                             .height = image->camera.height_px};
    /* The bilinear weight adds half of the splat. */
    double strip_px = params->beam_rad * f + 0.5 * (image->params.splat_px + 1.0);
    w.stride = (int32_t)ceil(image->params.splat_px);
    w.strip = strip_px < 8.0 ? (int32_t)lround(strip_px - 0.25) : 8;
    return w;
}

enum st resolve_photo(struct layer_image *image, const struct resolve_params *params, int colour,
                      struct photo *out_photo, struct resolve_counts *out_counts,
                      struct errctx *err) {
    if (image->camera.width_px != out_photo->camera.width_px ||
        image->camera.height_px != out_photo->camera.height_px)
        return errctx_set(err, ST_INVALID, "the photograph has another size than its layers");
    struct resolve_work w = work_make(image, params);
    size_t pixels = (size_t)w.width * (size_t)w.height;
    struct resolve_counts counts = {0};
    uint8_t *touched = NULL;
    enum st st = ST_OK;
    w.candidates = pages_alloc(pixels, sizeof *w.candidates);
    w.refused = calloc(pixels, 1);
    w.support = calloc(pixels, 1);
    touched = malloc(pixels);
    if (!w.candidates || !w.refused || !w.support || !touched) {
        st = errctx_set(err, ST_NOMEM, "no memory to resolve %zu pixels", pixels);
        goto out;
    }
    choose_first(&w);
    resolve_gradients(&w, NULL);
    if (!params->plain_mean) {
        if (merge_steep(&w, touched))
            resolve_gradients(&w, touched);
        if (params->refuse_mixed)
            st = mixed_refuse(&w, &counts.refused);
        if (st) {
            (void)errctx_set(err, st, "no memory to resolve %zu pixels", pixels);
            goto out;
        }
    }
    out_photo->camera = image->camera;
    out_photo->station_from_cam = image->station_from_cam;
#pragma omp parallel for schedule(static)
    for (size_t i = 0; i < pixels; i++)
        write_pixel(&w, i, colour, out_photo);
    st = sky_mark(out_photo, params->sky_elevation_rad, err);
    if (st)
        goto out;
    count_flags(out_photo, &counts);
    if (out_counts)
        *out_counts = counts;
out:
    pages_free(w.candidates, pixels, sizeof *w.candidates);
    free(w.refused);
    free(w.support);
    free(touched);
    return st;
}
