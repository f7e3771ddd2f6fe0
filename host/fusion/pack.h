/* Photographs to a tile pack: the pyramid, the primitive and the bits of each tile, chosen by the
 * error asked for. */
#ifndef SC_FUSION_PACK_H
#define SC_FUSION_PACK_H

#include "base/photo.h"
#include "base/tile_pack.h"
#include "fusion/lod.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The error asked for: error_m up to error_range_m, and in proportion to the depth beyond (an
 * angle). A level of detail n may err 2^n times as much: its pixels are that much larger. */
struct pack_params {
    double error_m, error_range_m;
    double noise_share; /* disparities are not stored finer than this share of the tile's own noise;
                           0: exactly as asked */
    int32_t planes;     /* 1: tiles that are planes within their noise are stored as such */
    int32_t confidence_step; /* see tile_code.h */
    int32_t zstd_level;
    struct lod_params lod;
};
/* 1 mm at 6 m, half of the noise, planes, steps of 4, zstd 1. */
struct pack_params pack_params_default(void);

/* Step of the quantised disparities of a tile whose farthest sample has disparity_min_per_m and
 * whose noise is sigma_per_m (NaN: unknown), at a level. */
double pack_step(const struct pack_params *params, double disparity_min_per_m, double sigma_per_m,
                 int32_t level);

/* What was chosen, and what it cost. */
struct pack_stats {
    int64_t tiles, empty, culled, sampled, planes; /* at level 0 */
    int64_t coarse_tiles, coarse_planes;           /* above */
    int64_t samples;                               /* stored at level 0, aprons not counted */
    int64_t noise_limited; /* tiles whose noise, not the error, set the step */
    int64_t bytes_level0, bytes_coarse;
    int64_t bytes_disparity, bytes_colour, bytes_rest; /* of level 0 */
    double step_sum_per_m, level_bits_sum;             /* over the sampled tiles of level 0 */
};
void pack_stats_add(struct pack_stats *sum, const struct pack_stats *part);

/* Adds one photograph to a pack: photo number `at` of the writer's, whose layout is `entry`.
 * `culled` has a byte for each tile of level 0 (see photo_tiles()), not 0: leave it out; NULL:
 * none. Threads: OpenMP inside, same bytes for any number. */
ST_MUST_CHECK enum st pack_photo(struct tile_pack_writer *writer,
                                 const struct tile_pack_photo *entry, const struct photo *photo,
                                 const uint8_t *culled, const struct pack_params *params,
                                 struct pack_stats *out_stats, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
