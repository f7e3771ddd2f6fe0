#include "fusion/pack.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct pack_params pack_params_default(void) {
    struct pack_params params = {.error_m = 0.001,
                                 .error_range_m = 6.0,
                                 .noise_share = 0.5,
                                 .planes = 1,
                                 .confidence_step = 4,
                                 .zstd_level = 1,
                                 .lod = lod_params_default()};
    return params;
}

double pack_step(const struct pack_params *p, double disparity_min_per_m, double sigma_per_m,
                 int32_t level) {
    double d = disparity_min_per_m;
    /* dZ = dd / d^2 <= error max(1, Z / range); half a step is the error. */
    double allowed = p->error_m * d * d * fmax(1.0, 1.0 / (d * p->error_range_m));
    double step = 2.0 * allowed;
    if (sigma_per_m > 0.0)
        step = fmax(step, p->noise_share * sigma_per_m);
    return ldexp(step, level);
}

void pack_stats_add(struct pack_stats *sum, const struct pack_stats *part) {
    sum->tiles += part->tiles;
    sum->empty += part->empty;
    sum->culled += part->culled;
    sum->sampled += part->sampled;
    sum->planes += part->planes;
    sum->coarse_tiles += part->coarse_tiles;
    sum->coarse_planes += part->coarse_planes;
    sum->samples += part->samples;
    sum->noise_limited += part->noise_limited;
    sum->bytes_level0 += part->bytes_level0;
    sum->bytes_coarse += part->bytes_coarse;
    sum->bytes_disparity += part->bytes_disparity;
    sum->bytes_colour += part->bytes_colour;
    sum->bytes_rest += part->bytes_rest;
    sum->step_sum_per_m += part->step_sum_per_m;
    sum->level_bits_sum += part->level_bits_sum;
}

/* One tile on its way to the pack. */
struct item {
    struct tile_pack_node node;
    struct tile_code_stats stats;
    uint8_t *bytes; /* TILE_CODE_MAX_BYTES */
    double step_per_m;
    enum st st;
    bool noise_limited;
};

static void gather(const struct tile *t, struct tile_samples *out) {
    out->width = t->cells_x + 1 > t->width_px ? t->cells_x + 1 : t->width_px;
    out->height = t->cells_y + 1 > t->height_px ? t->cells_y + 1 : t->height_px;
    for (int32_t y = 0; y < out->height; y++) {
        size_t from = (size_t)y * (size_t)t->stride_px, to = (size_t)(y * out->width);
        size_t n = (size_t)out->width;
        memcpy(out->rgb + 3 * to, t->rgb + 3 * from, 3 * n);
        memcpy(out->disparity_per_m + to, t->disparity_per_m + from, n * sizeof(float));
        memcpy(out->flags + to, t->flags + from, n);
        memcpy(out->confidence + to, t->confidence + from, n);
    }
}

static int by_value(const void *a, const void *b) {
    uint8_t x = *(const uint8_t *)a, y = *(const uint8_t *)b;
    return (x > y) - (x < y);
}

/* Bounds, flags and the median of the noise. */
static double describe(const struct tile *t, const struct tile_samples *s,
                       struct tile_pack_node *node) {
    uint8_t confidences[TILE_CODE_SAMPLES];
    size_t n = 0;
    int low = 0;
    node->disparity_min_per_m = 1.0f;
    node->disparity_max_per_m = 0.0f;
    for (int32_t i = 0; i < s->width * s->height; i++) {
        bool owned = i % s->width < t->width_px && i / s->width < t->height_px;
        float d = s->disparity_per_m[i];
        if (s->flags[i] & PHOTO_SKIN)
            node->flags |= TILE_PACK_SKINS;
        if (s->flags[i] & PHOTO_SKY)
            node->flags |= TILE_PACK_SKY;
        if (isnan(d) || (s->flags[i] & PHOTO_SKY))
            continue;
        if (node->disparity_min_per_m > node->disparity_max_per_m)
            node->disparity_min_per_m = node->disparity_max_per_m = d;
        node->disparity_min_per_m = d < node->disparity_min_per_m ? d : node->disparity_min_per_m;
        node->disparity_max_per_m = d > node->disparity_max_per_m ? d : node->disparity_max_per_m;
        if (s->confidence[i])
            confidences[n++] = s->confidence[i];
        if (owned)
            node->valid_count++;
        low += owned && (s->flags[i] & PHOTO_LOW_CONFIDENCE);
    }
    if (2 * low >= node->valid_count && node->valid_count)
        node->flags |= TILE_PACK_LOW;
    if (!n)
        return (double)NAN;
    qsort(confidences, n, 1, by_value);
    return photo_sigma_from_confidence(confidences[n / 2]);
}

static void encode_tile(const struct tile *t, int32_t level, bool culled,
                        const struct pack_params *params, struct item *item) {
    struct tile_samples samples;
    gather(t, &samples);
    memset(&item->node, 0, sizeof item->node);
    double sigma = describe(t, &samples, &item->node);
    bool sky = (item->node.flags & TILE_PACK_SKY) != 0;
    if (culled)
        item->node.flags |= TILE_PACK_CULLED;
    if (culled || (!item->node.valid_count && !sky))
        return;
    struct tile_code_options o = tile_code_options_default(0.0);
    double farthest = (double)item->node.disparity_min_per_m;
    bool surface = item->node.disparity_min_per_m <= item->node.disparity_max_per_m &&
                   item->node.disparity_min_per_m > 0.0f;
    struct pack_params strict = *params;
    strict.noise_share = 0.0;
    o.step_per_m = surface ? pack_step(params, farthest, sigma, level) : 0.0;
    item->noise_limited = surface && o.step_per_m > pack_step(&strict, farthest, sigma, level);
    o.plane = params->planes;
    o.confidence_step = params->confidence_step;
    o.zstd_level = params->zstd_level;
    size_t size = 0;
    item->step_per_m = o.step_per_m;
    item->st = tile_code_encode(&samples, &o, item->bytes, &size, &item->stats);
    item->node.size_bytes = (uint32_t)size;
    item->node.kind = item->stats.kind == TILE_CODE_PLANE ? TILE_PACK_PLANE : TILE_PACK_SAMPLED;
}

static void count_item(const struct item *item, const struct tile *t, int32_t level,
                       struct pack_stats *stats) {
    int64_t bytes = item->node.size_bytes;
    bool plane = item->node.kind == TILE_PACK_PLANE;
    if (level) {
        stats->coarse_tiles += bytes > 0;
        stats->coarse_planes += plane;
        stats->bytes_coarse += bytes;
        return;
    }
    stats->tiles++;
    if (item->node.flags & TILE_PACK_CULLED)
        stats->culled += 1;
    else if (!bytes)
        stats->empty++;
    if (!bytes)
        return;
    int64_t coded = ((int64_t)t->cells_x + 1) * (t->cells_y + 1);
    stats->planes += plane;
    stats->sampled += !plane;
    stats->samples += item->node.valid_count;
    stats->noise_limited += item->noise_limited && !plane;
    stats->bytes_level0 += bytes;
    stats->bytes_disparity += (int64_t)(item->stats.bits_disparity * (double)coded / 8.0);
    stats->bytes_colour += (int64_t)(item->stats.bits_colour * (double)coded / 8.0);
    stats->bytes_rest += (int64_t)(item->stats.bits_rest * (double)coded / 8.0);
    if (!plane) {
        stats->step_sum_per_m += item->step_per_m;
        stats->level_bits_sum += item->stats.levels_bits;
    }
}

/* One level: tiles are encoded a row at a time in parallel and written in order. */
static enum st pack_level(struct tile_pack_writer *writer, const struct tile_pack_photo *entry,
                          const struct photo *photo, const struct photo *finer, int32_t level,
                          const uint8_t *culled, const struct pack_params *params,
                          struct pack_stats *stats, struct errctx *err) {
    int32_t tx, ty;
    tile_pack_tiles(&entry->camera, level, &tx, &ty);
    size_t count = (size_t)tx * (size_t)ty;
    struct tile *tiles = malloc(count * sizeof *tiles);
    struct item *items = calloc((size_t)tx, sizeof *items);
    uint8_t *bytes = malloc((size_t)tx * TILE_CODE_MAX_BYTES);
    enum st st = ST_OK;
    if (!tiles || !items || !bytes) {
        st = errctx_set(err, ST_NOMEM, "no memory to pack %zu tiles", count);
        goto out;
    }
    photo_tiles(photo, NULL, tiles);
    for (int32_t j = 0; !st && j < ty; j++) {
        struct tile *row = tiles + (size_t)j * (size_t)tx;
#pragma omp parallel for schedule(dynamic, 1)
        for (int32_t i = 0; i < tx; i++) {
            memset(items + i, 0, sizeof *items);
            items[i].bytes = bytes + (size_t)i * TILE_CODE_MAX_BYTES;
            encode_tile(row + i, level, culled && culled[(size_t)j * (size_t)tx + (size_t)i],
                        params, items + i);
            if (finer && items[i].node.size_bytes) {
                float e = lod_error(finer, photo, row[i].u0_px, row[i].v0_px, PHOTO_TILE_PX);
                items[i].node.error_per_m = isnan(e) ? 0.0f : e;
            }
        }
        for (int32_t i = 0; !st && i < tx; i++) {
            count_item(items + i, row + i, level, stats);
            st = items[i].st ? errctx_set(err, items[i].st, "tile %d, %d does not encode", i, j)
                             : tile_pack_put(writer, tile_pack_node_at(entry, level, i, j),
                                             &items[i].node, items[i].bytes, err);
        }
    }
out:
    free(tiles);
    free(items);
    free(bytes);
    return st;
}

/* A parent is left out if all of its children that exist are. */
static uint8_t *culled_parents(const struct tile_pack_photo *entry, int32_t level,
                               const uint8_t *children) {
    int32_t cx, cy, tx, ty;
    tile_pack_tiles(&entry->camera, level - 1, &cx, &cy);
    tile_pack_tiles(&entry->camera, level, &tx, &ty);
    uint8_t *parents = malloc((size_t)tx * (size_t)ty);
    for (int32_t j = 0; parents && j < ty; j++)
        for (int32_t i = 0; i < tx; i++) {
            uint8_t all = 1;
            for (int32_t v = 2 * j; v < 2 * j + 2 && v < cy; v++)
                for (int32_t u = 2 * i; u < 2 * i + 2 && u < cx; u++)
                    all &= children[(size_t)v * (size_t)cx + (size_t)u] != 0;
            parents[(size_t)j * (size_t)tx + (size_t)i] = all;
        }
    return parents;
}

enum st pack_photo(struct tile_pack_writer *writer, const struct tile_pack_photo *entry,
                   const struct photo *photo, const uint8_t *culled,
                   const struct pack_params *params, struct pack_stats *out_stats,
                   struct errctx *err) {
    struct pack_stats stats = {0};
    struct photo finer = {0}, level_photo = {0};
    uint8_t *mask = NULL;
    enum st st = pack_level(writer, entry, photo, NULL, 0, culled, params, &stats, err);
    for (int32_t level = 1; !st && level < entry->level_count; level++) {
        const struct photo *from = level == 1 ? photo : &finer;
        st = lod_half(from, &params->lod, &level_photo, err);
        if (st)
            break;
        uint8_t *parents = NULL;
        if (culled) {
            parents = culled_parents(entry, level, level == 1 ? culled : mask);
            if (!parents)
                st = errctx_set(err, ST_NOMEM, "no memory for level %d", level);
        }
        free(mask);
        mask = parents;
        if (!st)
            st = pack_level(writer, entry, &level_photo, from, level, mask, params, &stats, err);
        photo_destroy(&finer);
        finer = level_photo;
        memset(&level_photo, 0, sizeof level_photo);
    }
    photo_destroy(&finer);
    free(mask);
    if (!st && out_stats)
        *out_stats = stats;
    return st;
}
