#include "fusion/reproject.h"

#include "raster/raster.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct reproject_params reproject_params_default(void) {
    struct reproject_params params = {.sigmas = 5.0,
                                      .step_sigmas = 4.0,
                                      .step_grazing_rad = 1.22, /* 70 degrees */
                                      .view_px = 1024,
                                      .trust_no_return = 0,
                                      .max_rounds = 8};
    return params;
}

/* ---- which cells could be skins ---- */

/* Steps between the corners of a cell, against the noise of the two and the slope of a flat
 * surface. */
static bool steps(const struct photo *photo, const double *sigma, const size_t corner[4],
                  double sigmas, double slope) {
    int there = 0;
    double lo = INFINITY, hi = -INFINITY, var = 0.0;
    for (int k = 0; k < 4; k++) {
        double d = (double)photo->disparity_per_m[corner[k]];
        if (isnan(d))
            continue;
        there++;
        lo = fmin(lo, d);
        hi = fmax(hi, d);
        double s = sigma[photo->confidence[corner[k]]];
        var = fmax(var, s * s);
    }
    return there >= 3 && hi - lo > sigmas * sqrt(2.0 * var) + slope * lo;
}

static void sigma_table(double out_sigma[256]) {
    out_sigma[0] = 0.0;
    for (int i = 1; i < 256; i++)
        out_sigma[i] = photo_sigma_from_confidence((uint8_t)i);
}

void reproject_candidates(const struct photo *photo, const struct reproject_params *params,
                          uint8_t *out_cells) {
    double sigma[256];
    sigma_table(sigma);
    size_t width = (size_t)photo->camera.width_px, height = (size_t)photo->camera.height_px;
    /* Across the diagonal of a cell. */
    double slope =
        1.4143 * tan(params->step_grazing_rad) / fmin(photo->camera.fx_px, photo->camera.fy_px);
    memset(out_cells, 0, width * height);
#pragma omp parallel for schedule(static)
    for (size_t y = 0; y < height - 1; y++)
        for (size_t x = 0; x + 1 < width; x++) {
            size_t i = y * width + x, corner[4] = {i, i + 1, i + width, i + width + 1};
            out_cells[i] = steps(photo, sigma, corner, params->step_sigmas, slope);
        }
}

/* ---- what a view says ---- */

/* B made small: each pixel the nearest that anything within it and its margin claims. */
struct witness {
    const struct reproject_view *view;
    struct camera camera;
    struct pose world_from_cam;
    float *nearest_per_m; /* NaN: says nothing */
    float *sigma_per_m;
};

static float claim(const struct photo *photo, size_t i, int trust_no_return) {
    float d = photo->disparity_per_m[i];
    if (!isnan(d))
        return d; /* sky is 0 */
    return trust_no_return && (photo->flags[i] & PHOTO_NO_RETURN) ? 0.0f : NAN;
}

/* Pixels of B that touch pixel x of the small view, one more on either side. */
static void span(double scale, int32_t x, int32_t limit, int32_t *out_first, int32_t *out_last) {
    int32_t first = (int32_t)floor((x - 0.5 + 0.5) * scale) - 1;
    int32_t last = (int32_t)ceil((x + 0.5 + 0.5) * scale);
    *out_first = first < 0 ? 0 : first;
    *out_last = last >= limit ? limit - 1 : last;
}

static void witness_pixel(const struct photo *photo, const double *sigma, const int32_t box[4],
                          int trust_no_return, float *out_nearest, float *out_sigma) {
    float nearest = -1.0f;
    double noise = 0.0;
    for (int32_t y = box[2]; y <= box[3]; y++)
        for (int32_t x = box[0]; x <= box[1]; x++) {
            size_t i = (size_t)y * (size_t)photo->camera.width_px + (size_t)x;
            float d = claim(photo, i, trust_no_return);
            if (isnan(d)) {
                *out_nearest = NAN;
                return;
            }
            nearest = d > nearest ? d : nearest;
            noise = fmax(noise, sigma[photo->confidence[i]]);
        }
    *out_nearest = nearest;
    *out_sigma = (float)noise;
}

static enum st witness_make(const struct reproject_view *view,
                            const struct reproject_params *params, struct witness *out_witness) {
    const struct camera *c = &view->photo->camera;
    int32_t longer = c->width_px > c->height_px ? c->width_px : c->height_px;
    double scale = fmax(1.0, (double)longer / params->view_px);
    struct witness w = {.view = view, .camera = *c};
    w.camera.width_px = (int32_t)floor(c->width_px / scale);
    w.camera.height_px = (int32_t)floor(c->height_px / scale);
    w.camera.width_px = w.camera.width_px < 1 ? 1 : w.camera.width_px;
    w.camera.height_px = w.camera.height_px < 1 ? 1 : w.camera.height_px;
    w.camera.fx_px = c->fx_px / scale;
    w.camera.fy_px = c->fy_px / scale;
    w.camera.cx_px = (c->cx_px + 0.5) / scale - 0.5;
    w.camera.cy_px = (c->cy_px + 0.5) / scale - 0.5;
    w.world_from_cam = pose_compose(&view->world_from_station, &view->photo->station_from_cam);
    size_t pixels = (size_t)w.camera.width_px * (size_t)w.camera.height_px;
    w.nearest_per_m = malloc(pixels * sizeof *w.nearest_per_m);
    w.sigma_per_m = calloc(pixels, sizeof *w.sigma_per_m);
    if (!w.nearest_per_m || !w.sigma_per_m) {
        free(w.nearest_per_m);
        free(w.sigma_per_m);
        return ST_NOMEM;
    }
    double sigma[256];
    sigma_table(sigma);
#pragma omp parallel for schedule(dynamic, 16)
    for (int32_t y = 0; y < w.camera.height_px; y++)
        for (int32_t x = 0; x < w.camera.width_px; x++) {
            size_t i = (size_t)y * (size_t)w.camera.width_px + (size_t)x;
            int32_t box[4];
            span(scale, x, c->width_px, &box[0], &box[1]);
            span(scale, y, c->height_px, &box[2], &box[3]);
            witness_pixel(view->photo, sigma, box, params->trust_no_return, &w.nearest_per_m[i],
                          &w.sigma_per_m[i]);
        }
    *out_witness = w;
    return ST_OK;
}

static void witness_free(struct witness *w) {
    free(w->nearest_per_m);
    free(w->sigma_per_m);
    memset(w, 0, sizeof *w);
}

/* ---- A seen from B ---- */

struct suspect { /* photograph A, drawn as its candidates only */
    const struct reproject_view *view;
    uint8_t *flags; /* PHOTO_SKIN where a cell is still suspected */
    struct tile *tiles;
    struct tile *live; /* those that still hold a suspect */
    size_t tile_count, live_count;
    struct pose world_from_cam;
};

struct sheet_of_items { /* the item buffer, reused for all pairs */
    float *depth;
    uint64_t *item;
    size_t capacity;
    struct raster_scratch scratch;
};

static void suspect_free(struct suspect *s) {
    free(s->flags);
    free(s->tiles);
    free(s->live);
    memset(s, 0, sizeof *s);
}

static enum st suspect_make(const struct reproject_view *view,
                            const struct reproject_params *params, struct suspect *out,
                            int64_t *inout_candidates) {
    const struct photo *photo = view->photo;
    size_t pixels = (size_t)photo->camera.width_px * (size_t)photo->camera.height_px;
    struct suspect s = {.view = view};
    s.tile_count = photo_tile_count(photo->camera.width_px, photo->camera.height_px);
    s.flags = malloc(pixels);
    s.tiles = malloc(s.tile_count * sizeof *s.tiles);
    s.live = malloc(s.tile_count * sizeof *s.live);
    if (!s.flags || !s.tiles || !s.live) {
        suspect_free(&s);
        return ST_NOMEM;
    }
    s.world_from_cam = pose_compose(&view->world_from_station, &photo->station_from_cam);
    reproject_candidates(photo, params, s.flags);
    for (size_t i = 0; i < pixels; i++) {
        *inout_candidates += s.flags[i];
        s.flags[i] = s.flags[i] ? PHOTO_SKIN : 0;
    }
    struct photo drawn = *photo;
    drawn.flags = s.flags;
    photo_tiles(&drawn, &view->world_from_station, s.tiles);
    *out = s;
    return ST_OK;
}

static void suspect_refresh(struct suspect *s) {
    s->live_count = 0;
    for (size_t i = 0; i < s->tile_count; i++) {
        const struct tile *t = s->tiles + i;
        bool any = false;
        for (int32_t y = 0; y < t->height_px && !any; y++)
            any = memchr(t->flags + (size_t)y * (size_t)t->stride_px, PHOTO_SKIN,
                         (size_t)t->width_px) != NULL;
        if (any)
            s->live[s->live_count++] = *t;
    }
}

/* Pixel of B and depth of a corner of A; false behind B. */
static bool corner_in(const struct suspect *s, const struct witness *b, int32_t u, int32_t v,
                      double out_xyd[3]) {
    const struct photo *photo = s->view->photo;
    double d =
        (double)photo->disparity_per_m[(size_t)v * (size_t)photo->camera.width_px + (size_t)u];
    if (isnan(d))
        return false;
    /* Homogeneous: [R ray + t d; d] in the world, so that infinity needs no case of its own. */
    struct vec3 x = mat3_mulv(&s->world_from_cam.r, camera_pinhole_ray(&photo->camera, u, v));
    struct vec3 base = vec3_sub(s->world_from_cam.t_m, b->world_from_cam.t_m);
    struct vec3 q = mat3_tmulv(&b->world_from_cam.r, vec3_madd(x, base, d));
    if (!(q.z > 0.0))
        return false;
    out_xyd[0] = b->camera.fx_px * q.x / q.z + b->camera.cx_px;
    out_xyd[1] = b->camera.fy_px * q.y / q.z + b->camera.cy_px;
    out_xyd[2] = d / q.z;
    return true;
}

/* How far (x, y) lies outside of a triangle at most, in pixels; and the depth there. */
static double outside(const double a[3], const double b[3], const double c[3], double x, double y,
                      double *out_depth) {
    double det = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
    if (fabs(det) < 1e-9)
        return INFINITY;
    double wb = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / det;
    double wc = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / det;
    double wa = 1.0 - wb - wc, low = fmin(wa, fmin(wb, wc));
    *out_depth = wa * a[2] + wb * b[2] + wc * c[2];
    double extent =
        fmax(fabs(b[0] - a[0]) + fabs(c[0] - a[0]), fabs(b[1] - a[1]) + fabs(c[1] - a[1]));
    return low >= 0.0 ? 0.0 : -low * extent;
}

/* The item buffer knows the sample nearest to the pixel; of the four cells around it, the one that
 * covers the pixel at that depth is meant. Returns its top-left pixel or SIZE_MAX. */
static size_t cell_at(const struct suspect *s, const struct witness *b, int32_t u, int32_t v,
                      double x, double y, double depth) {
    const struct camera *c = &s->view->photo->camera;
    size_t best = SIZE_MAX;
    double best_misfit = 0.05; /* of the depth, and pixels outside: beyond, no cell is meant */
    for (int k = 0; k < 4; k++) {
        int32_t cu = u - (k & 1), cv = v - (k >> 1);
        if (cu < 0 || cv < 0 || cu + 1 >= c->width_px || cv + 1 >= c->height_px)
            continue;
        size_t i = (size_t)cv * (size_t)c->width_px + (size_t)cu;
        if (!s->flags[i])
            continue;
        double q[4][3];
        bool there[4];
        for (int j = 0; j < 4; j++)
            there[j] = corner_in(s, b, cu + (j & 1), cv + (j >> 1), q[j]);
        for (int skip = 0; skip < 4; skip++) { /* both ways to cut a cell into triangles */
            int a = skip == 0 ? 1 : 0, e = skip == 3 ? 2 : 3, m = skip == 1 || skip == 0 ? 2 : 1;
            if (!there[a] || !there[e] || !there[m])
                continue;
            double z = depth;
            double out = outside(q[a], q[m], q[e], x, y, &z);
            double misfit = out + fabs(z - depth) / depth;
            if (misfit < best_misfit) {
                best_misfit = misfit;
                best = i;
            }
        }
    }
    return best;
}

/* Compares one item buffer with what B says; returns how many cells it disproves. */
static int64_t judge(struct suspect *s, const struct witness *b,
                     const struct reproject_params *params, const struct sheet_of_items *sheet,
                     int64_t *inout_unsure) {
    const struct photo *photo = s->view->photo;
    size_t width = (size_t)b->camera.width_px, height = (size_t)b->camera.height_px;
    int64_t disproved = 0;
    double sigma_m = hypot(s->view->pose_sigma_m, b->view->pose_sigma_m);
    double sigma_rad = hypot(s->view->pose_sigma_rad, b->view->pose_sigma_rad);
    for (size_t i = 0; i < width * height; i++) {
        if (sheet->item[i] == RASTER_NO_ITEM || isnan(b->nearest_per_m[i]))
            continue;
        double depth = (double)sheet->depth[i], said = (double)b->nearest_per_m[i];
        const struct tile *t = s->live + raster_item_tile(sheet->item[i]);
        int32_t u = t->u0_px + (int32_t)raster_item_u(sheet->item[i]);
        int32_t v = t->v0_px + (int32_t)raster_item_v(sheet->item[i]);
        size_t at = (size_t)v * (size_t)photo->camera.width_px + (size_t)u;
        /* A's own sigma is of its disparity: the same length is more disparity where B is closer.
         */
        double da = (double)photo->disparity_per_m[at], closer = da > 0.0 ? depth / da : 1.0;
        double sa = photo->confidence[at]
                        ? photo_sigma_from_confidence(photo->confidence[at]) * closer * closer
                        : 0.0;
        double sb = (double)b->sigma_per_m[i], sp = sigma_m * depth * depth;
        double noise2 = sa * sa + sb * sb;
        if (!(depth > said + params->sigmas * sqrt(noise2)))
            continue;
        /* The witness took the nearest claim within a pixel; two sigmas of shift must stay in it.
         */
        if (!(depth > said + params->sigmas * sqrt(noise2 + sp * sp)) ||
            2.0 * b->camera.fx_px * (sigma_m * depth + sigma_rad) > 1.0) {
            (*inout_unsure)++;
            continue;
        }
        size_t cell = cell_at(s, b, u, v, (double)(i % width), (double)(i / width), depth);
        if (cell == SIZE_MAX || !s->flags[cell])
            continue;
        s->flags[cell] = 0;
        disproved++;
    }
    return disproved;
}

static enum st sheet_reserve(struct sheet_of_items *sheet, size_t pixels) {
    if (pixels <= sheet->capacity)
        return ST_OK;
    free(sheet->depth);
    free(sheet->item);
    sheet->depth = malloc(pixels * sizeof *sheet->depth);
    sheet->item = malloc(pixels * sizeof *sheet->item);
    sheet->capacity = sheet->depth && sheet->item ? pixels : 0;
    return sheet->capacity ? ST_OK : ST_NOMEM;
}

/* Warps A to B until B disproves nothing more. */
static enum st warp_pair(struct suspect *s, const struct witness *b,
                         const struct reproject_params *params, struct sheet_of_items *sheet,
                         struct reproject_counts *counts, struct errctx *err) {
    size_t pixels = (size_t)b->camera.width_px * (size_t)b->camera.height_px;
    enum st st = sheet_reserve(sheet, pixels);
    if (st)
        return errctx_set(err, st, "no memory for an item buffer of %zu pixels", pixels);
    struct raster_view view = raster_view_pinhole(&b->camera, &b->world_from_cam);
    struct raster_options options = raster_options_default();
    options.primitive = RASTER_MESH;
    options.skins = RASTER_SKINS_ONLY;
    options.threads = 1; /* photographs are what runs in parallel */
    struct raster_target target = {.width_px = b->camera.width_px,
                                   .height_px = b->camera.height_px,
                                   .depth = sheet->depth,
                                   .item = sheet->item};
    for (int32_t round = 0; round < params->max_rounds && s->live_count; round++) {
        struct raster_input input = {.tiles = s->live,
                                     .tile_count = s->live_count,
                                     .photo_width_px = s->view->photo->camera.width_px,
                                     .photo_height_px = s->view->photo->camera.height_px};
        struct raster_stats stats;
        st = raster_draw(&input, 1, &view, &options, &target, &sheet->scratch, &stats, err);
        if (st)
            return st;
        counts->warps++;
        counts->pairs += round == 0 && stats.tiles_rejected < stats.tiles_total;
        int64_t disproved = stats.tiles_rejected < stats.tiles_total
                                ? judge(s, b, params, sheet, &counts->unsure)
                                : 0;
        counts->disproved += disproved;
        if (!disproved)
            break;
        suspect_refresh(s);
    }
    return ST_OK;
}

/* Writes the outcome into the photograph's own flags. */
static void publish(const struct suspect *s, const struct reproject_params *params,
                    uint8_t *candidates) {
    struct photo *photo = s->view->photo;
    size_t pixels = (size_t)photo->camera.width_px * (size_t)photo->camera.height_px;
    reproject_candidates(photo, params, candidates);
    for (size_t i = 0; i < pixels; i++) {
        if (isnan(photo->disparity_per_m[i]))
            continue;
        photo->flags[i] &= (uint8_t)~PHOTO_NO_RETURN;
        if (candidates[i] && !s->flags[i])
            photo->flags[i] |= PHOTO_SKIN_DISPROVED;
    }
}

static bool meets(const struct reproject_view *a, const struct reproject_view *b) {
    if (a == b)
        return false;
    struct pose pa = pose_compose(&a->world_from_station, &a->photo->station_from_cam);
    struct pose pb = pose_compose(&b->world_from_station, &b->photo->station_from_cam);
    /* From the same place a skin is seen edge on: a camera's nodal offset is no second view. */
    return a->station != b->station || vec3_norm(vec3_sub(pa.t_m, pb.t_m)) > 0.25;
}

/* All that concerns one photograph A: its own flags change, nobody reads them meanwhile (what B
 * claims are its disparities). */
static enum st clear_one(const struct reproject_view *views, size_t count, size_t a,
                         const struct witness *witnesses, const struct reproject_params *params,
                         struct reproject_counts *counts, struct errctx *err) {
    struct sheet_of_items sheet = {0};
    struct suspect s = {0};
    const struct camera *c = &views[a].photo->camera;
    uint8_t *candidates = malloc((size_t)c->width_px * (size_t)c->height_px);
    enum st st = candidates ? suspect_make(views + a, params, &s, &counts->candidates) : ST_NOMEM;
    if (st) {
        free(candidates);
        return errctx_set(err, st, "no memory for the skins of view %zu", a);
    }
    suspect_refresh(&s);
    for (size_t b = 0; !st && b < count; b++)
        if (meets(views + a, views + b))
            st = warp_pair(&s, witnesses + b, params, &sheet, counts, err);
    if (!st)
        publish(&s, params, candidates);
    free(candidates);
    suspect_free(&s);
    free(sheet.depth);
    free(sheet.item);
    raster_scratch_fini(&sheet.scratch);
    return st;
}

static void add_counts(struct reproject_counts *sum, const struct reproject_counts *part) {
    sum->candidates += part->candidates;
    sum->disproved += part->disproved;
    sum->pairs += part->pairs;
    sum->warps += part->warps;
    sum->unsure += part->unsure;
}

/* Photographs are dealt out to threads; the first failure stops the rest. */
static enum st clear_all(const struct reproject_view *views, size_t count,
                         const struct witness *witnesses, const struct reproject_params *params,
                         const struct reproject_progress *progress, struct reproject_counts *counts,
                         struct errctx *err) {
    enum st first = ST_OK;
    size_t done = 0;
#pragma omp parallel for schedule(dynamic, 1)
    for (size_t a = 0; a < count; a++) {
        struct reproject_counts part = {0};
        struct errctx own = {.st = ST_OK};
        enum st st = ST_OK, before;
#pragma omp atomic read
        before = first;
        if (!before)
            st = clear_one(views, count, a, witnesses, params, &part, &own);
#pragma omp critical(reproject_outcome)
        {
            add_counts(counts, &part);
            done++;
            if (!st && !first && progress && progress->step &&
                !progress->step(progress->context, done, count))
                st = errctx_set(&own, ST_CANCELLED, "stopped");
            if (st && !first) {
#pragma omp atomic write
                first = st;
                if (err)
                    *err = own;
            }
        }
    }
    return first;
}

enum st reproject_skins(const struct reproject_view *views, size_t count,
                        const struct reproject_params *params,
                        const struct reproject_progress *progress,
                        struct reproject_counts *out_counts, struct errctx *err) {
    struct reproject_counts counts = {0};
    struct witness *witnesses = calloc(count + 1, sizeof *witnesses);
    enum st st = witnesses ? ST_OK : errctx_set(err, ST_NOMEM, "no memory for %zu views", count);
    for (size_t b = 0; !st && b < count; b++)
        if ((st = witness_make(views + b, params, witnesses + b)))
            (void)errctx_set(err, st, "no memory to look from %zu views", count);
    if (!st)
        st = clear_all(views, count, witnesses, params, progress, &counts, err);
    for (size_t b = 0; witnesses && b < count; b++)
        witness_free(witnesses + b);
    free(witnesses);
    if (!st && out_counts)
        *out_counts = counts;
    return st;
}
