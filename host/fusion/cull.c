#include "fusion/cull.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct cull_params cull_params_default(void) {
    struct cull_params params = {.threshold = 1.0, .sigmas = 4.0, .doubt = 4.0, .keep_frontier = 1};
    return params;
}

/* A view, ready to be looked from. */
struct eye {
    const struct cull_view *view;
    struct pose world_from_cam;
    float *area_m2; /* of the surface a pixel covers, with penalty; NaN: no surface. Sky: of the
                       unit sphere */
    int32_t width, height, tiles_x, tiles_y;
};

struct candidate_tile {
    uint32_t view, tile;
    float badness; /* larger is worse */
    bool frontier;
};

struct culler {
    const struct cull_params *params;
    struct eye *eyes;
    size_t eye_count;
    double sigma[256];
};

/* ---- intrinsic quality ---- */

/* Slope of the disparity along one axis from the neighbours on the same surface: central where both
 * are, else one-sided, else 0. A neighbour is on the same surface if no skin lies between. */
static double slope(const float *d, const uint8_t *flags, size_t i, size_t step, bool before,
                    bool after) {
    double back = NAN, forth = NAN;
    if (before && d[i - step] > 0.0f && !(flags[i - step] & PHOTO_SKIN))
        back = (double)d[i] - (double)d[i - step];
    if (after && d[i + step] > 0.0f && !(flags[i] & PHOTO_SKIN))
        forth = (double)d[i + step] - (double)d[i];
    if (isnan(back))
        return isnan(forth) ? 0.0 : forth;
    return isnan(forth) ? back : 0.5 * (back + forth);
}

static float area_at(const struct eye *eye, const struct cull_params *params, int32_t x,
                     int32_t y) {
    const struct photo *photo = eye->view->photo;
    const struct camera *c = &photo->camera;
    size_t i = (size_t)y * (size_t)eye->width + (size_t)x;
    const float *d = photo->disparity_per_m;
    uint8_t flags = photo->flags[i];
    struct vec3 ray = camera_pinhole_ray(c, x, y);
    if (flags & PHOTO_SKY) {
        double r = vec3_norm(ray);
        return (float)(1.0 / (c->fx_px * c->fy_px * r * r * r));
    }
    if (!(d[i] > 0.0f))
        return NAN;
    double a = c->fx_px * slope(d, photo->flags, i, 1, x > 0, x + 1 < eye->width);
    double b = c->fy_px * slope(d, photo->flags, i, (size_t)eye->width, y > 0, y + 1 < eye->height);
    double delta = (double)d[i], n = delta - a * ray.x - b * ray.y;
    double area = sqrt(a * a + b * b + n * n) / (delta * delta * delta * c->fx_px * c->fy_px);
    if (flags & (PHOTO_LOW_CONFIDENCE | PHOTO_MIXED | PHOTO_SILHOUETTE))
        area *= params->doubt;
    return (float)area;
}

static enum st eye_open(const struct cull_view *view, const struct cull_params *params,
                        struct eye *out) {
    struct eye eye = {.view = view,
                      .width = view->photo->camera.width_px,
                      .height = view->photo->camera.height_px};
    eye.tiles_x = (eye.width + PHOTO_TILE_PX - 1) / PHOTO_TILE_PX;
    eye.tiles_y = (eye.height + PHOTO_TILE_PX - 1) / PHOTO_TILE_PX;
    eye.world_from_cam = pose_compose(&view->world_from_station, &view->photo->station_from_cam);
    eye.area_m2 = malloc((size_t)eye.width * (size_t)eye.height * sizeof *eye.area_m2);
    if (!eye.area_m2)
        return ST_NOMEM;
#pragma omp parallel for schedule(static)
    for (int32_t y = 0; y < eye.height; y++)
        for (int32_t x = 0; x < eye.width; x++)
            eye.area_m2[(size_t)y * (size_t)eye.width + (size_t)x] = area_at(&eye, params, x, y);
    *out = eye;
    return ST_OK;
}

/* Mean of the logarithm of the area, plus the share of flagged pixels; NAN for a tile that holds
 * nothing. */
static float tile_badness(const struct eye *eye, uint32_t tile, bool *out_frontier) {
    int32_t u0 = (int32_t)(tile % (uint32_t)eye->tiles_x) * PHOTO_TILE_PX;
    int32_t v0 = (int32_t)(tile / (uint32_t)eye->tiles_x) * PHOTO_TILE_PX;
    double sum = 0;
    int64_t count = 0, flagged = 0;
    *out_frontier = false;
    for (int32_t v = v0; v < v0 + PHOTO_TILE_PX && v < eye->height; v++)
        for (int32_t u = u0; u < u0 + PHOTO_TILE_PX && u < eye->width; u++) {
            size_t i = (size_t)v * (size_t)eye->width + (size_t)u;
            uint8_t f = eye->view->photo->flags[i];
            if (isnan(eye->area_m2[i]))
                continue;
            if ((f & PHOTO_SKIN_DISPROVED) == PHOTO_SKIN)
                *out_frontier = true;
            sum += log((double)eye->area_m2[i]);
            count++;
            flagged += (f & (PHOTO_SKIN | PHOTO_LOW_CONFIDENCE | PHOTO_MIXED)) != 0;
        }
    return count ? (float)((sum + (double)flagged) / (double)count) : NAN;
}

/* ---- one sample seen from another photograph ---- */

/* Tile that owns the mesh cell at (x, y). */
static size_t owner(const struct eye *eye, int32_t x, int32_t y) {
    return (size_t)(y / PHOTO_TILE_PX) * (size_t)eye->tiles_x + (size_t)(x / PHOTO_TILE_PX);
}

struct look {
    bool covered, better;
};

static struct look look_at_sky(const struct eye *b, double x, double y, float area,
                               double threshold) {
    struct look look = {false, false};
    int32_t u = (int32_t)floor(x + 0.5), v = (int32_t)floor(y + 0.5);
    if (u < 0 || v < 0 || u >= b->width || v >= b->height)
        return look;
    size_t i = (size_t)v * (size_t)b->width + (size_t)u;
    look.covered = (b->view->photo->flags[i] & PHOTO_SKY) && !b->view->culled[owner(b, u, v)];
    look.better = look.covered && (double)b->area_m2[i] <= threshold * (double)area;
    return look;
}

/* Is the sample of A at `q` (homogeneous in B: [x y z; delta]) on a solid cell of B, and is B
 * better? */
static struct look look_from(const struct culler *c, const struct eye *a, const struct eye *b,
                             struct vec3 q, double delta, double sigma_a, float area) {
    struct look look = {false, false};
    const struct photo *photo = b->view->photo;
    if (!(q.z > 1e-9))
        return look;
    double x = photo->camera.fx_px * q.x / q.z + photo->camera.cx_px;
    double y = photo->camera.fy_px * q.y / q.z + photo->camera.cy_px;
    if (!(x >= 0.0 && y >= 0.0 && x < b->width - 1.0 && y < b->height - 1.0))
        return look;
    if (delta == 0.0)
        return look_at_sky(b, x, y, area, c->params->threshold);
    int32_t u = (int32_t)x, v = (int32_t)y;
    size_t i = (size_t)v * (size_t)b->width + (size_t)u, w = (size_t)b->width;
    const float *d = photo->disparity_per_m;
    if (!(d[i] > 0.0f && d[i + 1] > 0.0f && d[i + w] > 0.0f && d[i + w + 1] > 0.0f) ||
        (photo->flags[i] & PHOTO_SKIN) || b->view->culled[owner(b, u, v)])
        return look;
    double fx = x - u, fy = y - v;
    double here = (1 - fy) * ((1 - fx) * (double)d[i] + fx * (double)d[i + 1]) +
                  fy * ((1 - fx) * (double)d[i + w] + fx * (double)d[i + w + 1]);
    double seen = delta / q.z, sigma_b = c->sigma[photo->confidence[i]];
    double sa = sigma_a * seen * seen, sp = 0.0;
    if (a->view->station != b->view->station) {
        double sigma_m = hypot(a->view->pose_sigma_m, b->view->pose_sigma_m);
        double sigma_rad = hypot(a->view->pose_sigma_rad, b->view->pose_sigma_rad);
        /* Stations that do not fit to a pixel of B cannot stand in for each other. */
        if (photo->camera.fx_px * (sigma_m * seen + sigma_rad) > 1.0)
            return look;
        sp = sigma_m * seen * seen;
    }
    /* Half a pixel of B's own slope: places are known no better. */
    double lean =
        0.25 * (fabs((double)d[i + 1] - (double)d[i]) + fabs((double)d[i + w] - (double)d[i]));
    double room = c->params->sigmas * sqrt(sa * sa + sigma_b * sigma_b + sp * sp) + lean;
    look.covered = fabs(here - seen) <= room;
    size_t nearest = (size_t)(v + (fy >= 0.5)) * w + (size_t)(u + (fx >= 0.5));
    look.better =
        look.covered && (double)b->area_m2[nearest] <= c->params->threshold * (double)area;
    return look;
}

/* A sample is redundant if some eye covers it and, unless it is only shared, shows it better. */
static bool sample_redundant(const struct culler *c, const struct eye *a, const uint16_t *others,
                             size_t other_count, int32_t u, int32_t v, bool owned) {
    const struct photo *photo = a->view->photo;
    size_t i = (size_t)v * (size_t)a->width + (size_t)u;
    float area = a->area_m2[i];
    if (isnan(area))
        return true; /* nothing to lose */
    double delta = (double)photo->disparity_per_m[i];
    struct vec3 ray = mat3_mulv(&a->world_from_cam.r, camera_pinhole_ray(&photo->camera, u, v));
    /* sigma of a length along the ray, m: sigma(delta) / delta^2 */
    double sigma_m = delta > 0.0 ? c->sigma[photo->confidence[i]] / (delta * delta) : 0.0;
    for (size_t k = 0; k < other_count; k++) {
        const struct eye *b = c->eyes + others[k];
        struct vec3 base = vec3_sub(a->world_from_cam.t_m, b->world_from_cam.t_m);
        struct vec3 q = mat3_tmulv(&b->world_from_cam.r, vec3_madd(ray, base, delta));
        struct look look = look_from(c, a, b, q, delta, sigma_m, area);
        if (owned ? look.better : look.covered)
            return true;
    }
    return false;
}

/* ---- one tile ---- */

struct box {
    int32_t u0, v0, u1, v1; /* owned samples, inclusive */
};

static struct box tile_box(const struct eye *eye, uint32_t tile) {
    struct box b = {.u0 = (int32_t)(tile % (uint32_t)eye->tiles_x) * PHOTO_TILE_PX,
                    .v0 = (int32_t)(tile / (uint32_t)eye->tiles_x) * PHOTO_TILE_PX};
    b.u1 = b.u0 + PHOTO_TILE_PX - 1 < eye->width ? b.u0 + PHOTO_TILE_PX - 1 : eye->width - 1;
    b.v1 = b.v0 + PHOTO_TILE_PX - 1 < eye->height ? b.v0 + PHOTO_TILE_PX - 1 : eye->height - 1;
    return b;
}

/* Eyes that see some of a coarse grid of the tile's samples. */
static size_t who_sees(const struct culler *c, size_t a_index, const struct box *box,
                       uint16_t *out_others) {
    const struct eye *a = c->eyes + a_index;
    const struct photo *photo = a->view->photo;
    size_t count = 0;
    for (size_t k = 0; k < c->eye_count; k++) {
        const struct eye *b = c->eyes + k;
        bool seen = false;
        struct vec3 base = vec3_sub(a->world_from_cam.t_m, b->world_from_cam.t_m);
        for (int32_t v = box->v0; k != a_index && !seen && v <= box->v1; v += 5)
            for (int32_t u = box->u0; !seen && u <= box->u1; u += 5) {
                double d = (double)photo->disparity_per_m[(size_t)v * (size_t)a->width + (size_t)u];
                if (isnan(d))
                    continue;
                struct vec3 ray =
                    mat3_mulv(&a->world_from_cam.r, camera_pinhole_ray(&photo->camera, u, v));
                struct vec3 q = mat3_tmulv(&b->world_from_cam.r, vec3_madd(ray, base, d));
                const struct camera *cb = &b->view->photo->camera;
                double x = cb->fx_px * q.x / q.z + cb->cx_px, y = cb->fy_px * q.y / q.z + cb->cy_px;
                seen = q.z > 0 && x > -8 && y > -8 && x < b->width + 8 && y < b->height + 8;
            }
        if (seen)
            out_others[count++] = (uint16_t)k;
    }
    return count;
}

static bool tile_redundant(const struct culler *c, size_t a_index, uint32_t tile,
                           uint16_t *others) {
    const struct eye *a = c->eyes + a_index;
    struct box box = tile_box(a, tile);
    size_t count = who_sees(c, a_index, &box, others);
    if (!count)
        return false;
    int32_t ue = box.u1 + 1 < a->width ? box.u1 + 1 : box.u1;
    int32_t ve = box.v1 + 1 < a->height ? box.v1 + 1 : box.v1;
    /* Scattered samples first: a tile that stays is found out soon. */
    for (int32_t start = 0; start < 4; start++)
        for (int32_t v = box.v0 + (start >> 1); v <= ve; v += 2)
            for (int32_t u = box.u0 + (start & 1); u <= ue; u += 2)
                if (!sample_redundant(c, a, others, count, u, v, u <= box.u1 && v <= box.v1))
                    return false;
    return true;
}

static int worse_first(const void *x, const void *y) {
    const struct candidate_tile *a = x, *b = y;
    if (a->badness != b->badness)
        return a->badness < b->badness ? 1 : -1;
    if (a->view != b->view)
        return a->view < b->view ? -1 : 1;
    return a->tile < b->tile ? -1 : a->tile > b->tile;
}

/* Verdicts only ever shrink what covers others, so a tile that stays by the state before the batch
 * stays; those that might go are judged again, one after the other. The outcome is that of judging
 * all in order. */
static enum st cull_batch(const struct culler *c, const struct candidate_tile *tiles, size_t count,
                          uint8_t *maybe, struct cull_counts *counts) {
    bool failed = false;
#pragma omp parallel for schedule(dynamic, 4) reduction(|| : failed)
    for (size_t i = 0; i < count; i++) {
        uint16_t *others = malloc(c->eye_count * sizeof *others);
        maybe[i] = others && tile_redundant(c, tiles[i].view, tiles[i].tile, others);
        failed = failed || !others;
        free(others);
    }
    uint16_t *others = malloc(c->eye_count * sizeof *others);
    if (failed || !others) {
        free(others);
        return ST_NOMEM;
    }
    for (size_t i = 0; i < count; i++) {
        if (!maybe[i] || !tile_redundant(c, tiles[i].view, tiles[i].tile, others))
            continue;
        if (tiles[i].frontier) {
            counts->frontier++;
            continue;
        }
        c->eyes[tiles[i].view].view->culled[tiles[i].tile] = 1;
        counts->culled++;
    }
    free(others);
    return ST_OK;
}

static size_t list_tiles(const struct culler *c, struct candidate_tile *out,
                         struct cull_counts *counts) {
    size_t n = 0;
    for (size_t k = 0; k < c->eye_count; k++) {
        const struct eye *eye = c->eyes + k;
        size_t tiles = (size_t)eye->tiles_x * (size_t)eye->tiles_y;
        memset(eye->view->culled, 0, tiles);
        counts->tiles += (int64_t)tiles;
        for (size_t t = 0; t < tiles; t++) {
            struct candidate_tile *x = out + n;
            x->view = (uint32_t)k;
            x->tile = (uint32_t)t;
            x->badness = tile_badness(eye, x->tile, &x->frontier);
            x->frontier = x->frontier && c->params->keep_frontier;
            if (isnan(x->badness))
                counts->empty++;
            else
                n++;
        }
    }
    return n;
}

static enum st cull_all(struct culler *c, const struct cull_progress *progress,
                        struct cull_counts *counts, struct errctx *err) {
    enum { BATCH = 256 };
    size_t tiles = 0;
    for (size_t k = 0; k < c->eye_count; k++)
        tiles += (size_t)c->eyes[k].tiles_x * (size_t)c->eyes[k].tiles_y;
    struct candidate_tile *list = malloc((tiles + 1) * sizeof *list);
    uint8_t maybe[BATCH];
    if (!list)
        return errctx_set(err, ST_NOMEM, "no memory to rank %zu tiles", tiles);
    size_t n = list_tiles(c, list, counts);
    qsort(list, n, sizeof *list, worse_first);
    enum st st = ST_OK;
    for (size_t at = 0; !st && at < n; at += BATCH) {
        size_t count = n - at < BATCH ? n - at : BATCH;
        if (progress && progress->step && !progress->step(progress->context, at, n))
            st = errctx_set(err, ST_CANCELLED, "stopped");
        else if (cull_batch(c, list + at, count, maybe, counts))
            st = errctx_set(err, ST_NOMEM, "no memory to cull %zu tiles", n);
    }
    free(list);
    return st;
}

enum st cull_tiles(const struct cull_view *views, size_t count, const struct cull_params *params,
                   const struct cull_progress *progress, struct cull_counts *out_counts,
                   struct errctx *err) {
    if (count > UINT16_MAX)
        return errctx_set(err, ST_INVALID, "%zu photographs are more than can be compared", count);
    struct cull_counts counts = {0};
    struct culler c = {.params = params};
    for (int i = 1; i < 256; i++)
        c.sigma[i] = photo_sigma_from_confidence((uint8_t)i);
    c.eyes = calloc(count + 1, sizeof *c.eyes);
    enum st st = c.eyes ? ST_OK : ST_NOMEM;
    for (size_t k = 0; !st && k < count; k++, c.eye_count++)
        st = eye_open(views + k, params, c.eyes + k);
    if (st)
        (void)errctx_set(err, st, "no memory to cull %zu photographs", count);
    else
        st = cull_all(&c, progress, &counts, err);
    for (size_t k = 0; c.eyes && k < count; k++)
        free(c.eyes[k].area_m2);
    free(c.eyes);
    if (!st && out_counts)
        *out_counts = counts;
    return st;
}
