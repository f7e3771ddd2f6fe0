#include "fusion/layer.h"

#include "base/image.h"
#include "base/pages.h"

#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

/* Samples in one round, rows in one band: the round's hits stay in the caches, and a round has work
 * for many bands. */
enum { ROUND_SAMPLES = 1 << 17, BAND_ROWS = 16, GREY_STEPS = 4096 };

static const double rad_per_deg = 0.017453292519943295;

enum hit_kind { HIT_SURFACE, HIT_NONE, HIT_DROPPED };

/* A sample on the image plane. */
struct hit {
    float u_px, v_px, disparity_per_m, sigma_per_m;
    uint8_t rgb[3], kind;
    int16_t band_first, band_last; /* first > last: not on the image */
};

struct layer_scratch {
    struct hit hits[ROUND_SAMPLES];
    struct scatter_sample samples[ROUND_SAMPLES]; /* of a source */
    uint8_t grey[GREY_STEPS];
    uint32_t *order; /* hits by band */
    size_t order_capacity;
    size_t *band_start; /* [bands + 1] */
    int32_t bands;
};

struct layer_params layer_params_default(void) {
    struct layer_params params = {.splat_px = 1.0,
                                  .cluster_sigmas = 3.0,
                                  .grazing_rad = 68.0 * rad_per_deg,
                                  .sigma_default_m = 0.005,
                                  .sigma_floor_m = 1e-4,
                                  .intensity_scale = 1.0};
    return params;
}

static enum st params_check(const struct layer_params *p, struct errctx *err) {
    if (!(p->splat_px >= 1.0 && p->splat_px <= LAYER_MAX_SPLAT_PX))
        return errctx_set(err, ST_INVALID, "splat of %g px: use 1 to %d", p->splat_px,
                          LAYER_MAX_SPLAT_PX);
    if (!(p->cluster_sigmas > 0.0 && p->cluster_sigmas < 1e3) ||
        !(p->grazing_rad >= 0.0 && p->grazing_rad < 1.57))
        return errctx_set(err, ST_INVALID, "clustering by %g sigma and %g rad makes no sense",
                          p->cluster_sigmas, p->grazing_rad);
    if (!(p->sigma_floor_m > 0.0) || !(p->sigma_default_m > 0.0) || !isfinite(p->sigma_default_m) ||
        !isfinite(p->sigma_floor_m) || !(p->intensity_scale >= 0.0) ||
        !isfinite(p->intensity_scale))
        return errctx_set(err, ST_INVALID, "noise of %g m (floor %g m): use positive numbers",
                          p->sigma_default_m, p->sigma_floor_m);
    return ST_OK;
}

enum st layer_create(const struct camera *camera, const struct pose *station_from_cam,
                     const struct layer_params *params, struct layer_image *out_image,
                     struct errctx *err) {
    enum st st = camera_check(camera, err);
    if (st)
        return st;
    if (!camera_is_pinhole(camera))
        return errctx_set(err, ST_INVALID, "a photograph needs an undistorted camera");
    st = params_check(params, err);
    if (st)
        return st;
    size_t pixels = (size_t)camera->width_px * (size_t)camera->height_px;
    if (pixels > (size_t)IMAGE_MAX_PIXELS)
        return errctx_set(err, ST_NOMEM, "%d x %d px is more than one image may have",
                          camera->width_px, camera->height_px);
    struct layer_image image = {
        .camera = *camera, .station_from_cam = *station_from_cam, .params = *params};
    struct layer_scratch *scratch = calloc(1, sizeof *scratch);
    image.px = pages_alloc(pixels, sizeof *image.px);
    image.scratch = scratch;
    if (scratch) {
        scratch->bands = (camera->height_px + BAND_ROWS - 1) / BAND_ROWS;
        scratch->band_start = calloc((size_t)scratch->bands + 2, sizeof *scratch->band_start);
    }
    if (!scratch || !image.px || !scratch->band_start) {
        layer_destroy(&image);
        return errctx_set(err, ST_NOMEM, "no memory for %zu layered pixels", pixels);
    }
    for (int i = 0; i < GREY_STEPS; i++)
        scratch->grey[i] = (uint8_t)lrint(255.0 * pow((i + 0.5) / GREY_STEPS, 1.0 / 2.2));
    *out_image = image;
    return ST_OK;
}

void layer_destroy(struct layer_image *image) {
    if (!image)
        return;
    struct layer_scratch *scratch = image->scratch;
    if (scratch) {
        free(scratch->order);
        free(scratch->band_start);
    }
    free(scratch);
    pages_free(image->px, (size_t)image->camera.width_px * (size_t)image->camera.height_px,
               sizeof *image->px);
    memset(image, 0, sizeof *image);
}

/* What projection needs, in float: positions relative to the station are good to 0.1 mm at 1 km. */
struct projector {
    float r[9], t[3]; /* cam_from_station */
    float fx, fy, cx, cy, width, height, splat;
    float sigma_default, sigma_floor, intensity_scale;
    const uint8_t *grey;
};

static struct projector projector_make(const struct layer_image *image) {
    struct pose cam_from_station = pose_inverse(&image->station_from_cam);
    const struct camera *c = &image->camera;
    const struct layer_scratch *scratch = image->scratch;
    struct projector p = {.t = {(float)cam_from_station.t_m.x, (float)cam_from_station.t_m.y,
                                (float)cam_from_station.t_m.z},
                          .fx = (float)c->fx_px,
                          .fy = (float)c->fy_px,
                          .cx = (float)c->cx_px,
                          .cy = (float)c->cy_px,
                          .width = (float)c->width_px,
                          .height = (float)c->height_px,
                          .splat = (float)image->params.splat_px,
                          .sigma_default = (float)image->params.sigma_default_m,
                          .sigma_floor = (float)image->params.sigma_floor_m,
                          .intensity_scale = (float)image->params.intensity_scale,
                          .grey = scratch->grey};
    for (int i = 0; i < 9; i++)
        p.r[i] = (float)cam_from_station.r.m[i];
    return p;
}

static void hit_colour(const struct projector *p, const struct scatter_sample *s, struct hit *hit) {
    if (s->flags & SAMPLE_COLOUR) {
        memcpy(hit->rgb, s->rgb, sizeof hit->rgb);
        return;
    }
    uint8_t grey = 128;
    if (s->flags & SAMPLE_INTENSITY) {
        float i = s->intensity * p->intensity_scale;
        int step = i >= 1.0f ? GREY_STEPS - 1 : i > 0.0f ? (int)(i * GREY_STEPS) : 0;
        grey = p->grey[step];
    }
    memset(hit->rgb, grey, sizeof hit->rgb);
}

static void hit_make(const struct projector *p, const struct scatter_sample *s, struct hit *hit) {
    const float *r = p->r, *q = s->p_m;
    int none = (s->flags & (SAMPLE_NO_RETURN | SAMPLE_DROPPED)) != 0;
    float shift = none ? 0.0f : 1.0f; /* directions do not know where the camera stands */
    float x = r[0] * q[0] + r[1] * q[1] + r[2] * q[2] + shift * p->t[0];
    float y = r[3] * q[0] + r[4] * q[1] + r[5] * q[2] + shift * p->t[1];
    float z = r[6] * q[0] + r[7] * q[1] + r[8] * q[2] + shift * p->t[2];
    float delta = 1.0f / z;
    float u = p->fx * x * delta + p->cx, v = p->fy * y * delta + p->cy;
    hit->band_first = 0;
    hit->band_last = -1;
    /* Written so that NaN fails. A disparity that overflows is contact: no pixel can hold it. */
    if (!(z > 0.0f && delta < 1e18f && u > -p->splat && v > -p->splat &&
          u < p->width - 1.0f + p->splat && v < p->height - 1.0f + p->splat))
        return;
    float sigma = s->sigma_m;
    if (!(sigma >= 0.0f && sigma < 1e18f))
        sigma = p->sigma_default;
    if (sigma < p->sigma_floor)
        sigma = p->sigma_floor;
    hit->u_px = u;
    hit->v_px = v;
    hit->disparity_per_m = delta;
    hit->sigma_per_m = sigma * delta / sqrtf(x * x + y * y + z * z);
    hit->kind = (uint8_t)(s->flags & SAMPLE_NO_RETURN ? HIT_NONE
                          : none                      ? HIT_DROPPED
                                                      : HIT_SURFACE);
    hit_colour(p, s, hit);
    float first = ceilf(v - p->splat), last = floorf(v + p->splat);
    if (first < 0.0f)
        first = 0.0f;
    if (last > p->height - 1.0f)
        last = p->height - 1.0f;
    hit->band_first = (int16_t)((int)first / BAND_ROWS);
    hit->band_last = (int16_t)((int)last / BAND_ROWS);
}

/* Counting sort of hit indices by band, keeping their order; a hit on a border is in both bands. */
static enum st sort_bands(struct layer_scratch *scratch, size_t count) {
    size_t *start = scratch->band_start;
    memset(start, 0, ((size_t)scratch->bands + 2) * sizeof *start);
    size_t total = 0;
    for (size_t i = 0; i < count; i++)
        for (int b = scratch->hits[i].band_first; b <= scratch->hits[i].band_last; b++) {
            start[b + 2]++;
            total++;
        }
    if (total > scratch->order_capacity) {
        uint32_t *order = realloc(scratch->order, total * sizeof *order);
        if (!order)
            return ST_NOMEM;
        scratch->order = order;
        scratch->order_capacity = total;
    }
    for (int b = 2; b < scratch->bands + 2; b++)
        start[b] += start[b - 1];
    for (size_t i = 0; i < count; i++)
        for (int b = scratch->hits[i].band_first; b <= scratch->hits[i].band_last; b++)
            scratch->order[start[b + 1]++] = (uint32_t)i;
    return ST_OK;
}

static void splat_pixel(struct cluster_pixel *pixel, struct cluster_entry *entry, int kind,
                        const struct cluster_rule *rule) {
    if (kind == HIT_NONE)
        pixel->none_weight += entry->weight;
    else if (kind == HIT_DROPPED)
        pixel->dropped_weight += entry->weight;
    else
        cluster_add(pixel, entry, rule);
}

static void splat(struct layer_image *image, const struct hit *hit, int row_first, int row_last,
                  float splat_px, const struct cluster_rule *rule) {
    int x0 = (int)ceilf(hit->u_px - splat_px), x1 = (int)floorf(hit->u_px + splat_px);
    int y0 = (int)ceilf(hit->v_px - splat_px), y1 = (int)floorf(hit->v_px + splat_px);
    x0 = x0 < 0 ? 0 : x0;
    y0 = y0 < row_first ? row_first : y0;
    x1 = x1 >= image->camera.width_px ? image->camera.width_px - 1 : x1;
    y1 = y1 > row_last ? row_last : y1;
    struct cluster_entry entry = {.disparity_per_m = hit->disparity_per_m,
                                  .sigma_per_m = hit->sigma_per_m,
                                  .rgb = {hit->rgb[0], hit->rgb[1], hit->rgb[2]}};
    float inverse = 1.0f / splat_px;
    for (int y = y0; y <= y1; y++) {
        entry.dv_px = hit->v_px - (float)y;
        float wy = 1.0f - fabsf(entry.dv_px) * inverse;
        struct cluster_pixel *row = image->px + (size_t)y * (size_t)image->camera.width_px;
        for (int x = x0; x <= x1; x++) {
            entry.du_px = hit->u_px - (float)x;
            entry.weight = wy * (1.0f - fabsf(entry.du_px) * inverse);
            if (!(entry.weight > 0.0f))
                continue;
            entry.own = fabsf(entry.du_px) <= 0.5f && fabsf(entry.dv_px) <= 0.5f;
            splat_pixel(row + x, &entry, hit->kind, rule);
        }
    }
}

static void fill_band(struct layer_image *image, int band, const struct cluster_rule *rule) {
    const struct layer_scratch *scratch = image->scratch;
    int first = band * BAND_ROWS, last = first + BAND_ROWS - 1;
    if (last >= image->camera.height_px)
        last = image->camera.height_px - 1;
    for (size_t i = scratch->band_start[band]; i < scratch->band_start[band + 1]; i++)
        splat(image, scratch->hits + scratch->order[i], first, last, (float)image->params.splat_px,
              rule);
}

static enum st add_round(struct layer_image *image, const struct scatter_sample *samples,
                         size_t count) {
    struct layer_scratch *scratch = image->scratch;
    struct projector projector = projector_make(image);
    struct cluster_rule rule = {.sigmas = (float)image->params.cluster_sigmas,
                                .slope_per_px =
                                    (float)(tan(image->params.grazing_rad) /
                                            fmin(image->camera.fx_px, image->camera.fy_px))};
    int64_t touched = 0;
#pragma omp parallel for schedule(static) reduction(+ : touched)
    for (size_t i = 0; i < count; i++) {
        hit_make(&projector, samples + i, scratch->hits + i);
        touched += scratch->hits[i].band_first <= scratch->hits[i].band_last;
    }
    enum st st = sort_bands(scratch, count);
    if (st)
        return st;
#pragma omp parallel for schedule(dynamic, 1)
    for (int band = 0; band < scratch->bands; band++)
        fill_band(image, band, &rule);
    image->sample_count += touched;
    return ST_OK;
}

enum st layer_add(struct layer_image *image, const struct scatter_sample *samples, size_t count) {
    for (size_t at = 0; at < count; at += ROUND_SAMPLES) {
        size_t n = count - at < ROUND_SAMPLES ? count - at : ROUND_SAMPLES;
        enum st st = add_round(image, samples + at, n);
        if (st)
            return st;
    }
    return ST_OK;
}

enum st layer_add_source(struct layer_image *image, const struct scatter_source *source,
                         struct errctx *err) {
    struct layer_scratch *scratch = image->scratch;
    enum st st = source->rewind(source->context, err);
    while (!st) {
        size_t count = 0;
        st = source->next(source->context, scratch->samples, ROUND_SAMPLES, &count, err);
        if (st || !count)
            break;
        st = add_round(image, scratch->samples, count);
        if (st)
            (void)errctx_set(err, st, "no memory to splat %zu samples", count);
    }
    return st;
}
