/* Level of detail: a photograph with half as many pixels each way, silhouettes kept.
 *
 * A coarse pixel takes the heaviest cluster of the four it covers: never the mean of two surfaces.
 * Its disparity is that of the surface at its own centre, its sigma that of a mean, its colour the
 * mean (in linear light) of the same pixels. A level is a photograph like any other. */
#ifndef SC_FUSION_LOD_H
#define SC_FUSION_LOD_H

#include "base/photo.h"

#ifdef __cplusplus
extern "C" {
#endif

struct lod_params {
    double sigmas;      /* children of one surface differ by so many sigmas at most ... */
    double grazing_rad; /* ... beyond what a surface seen at this incidence changes from one to the
                           next */
};
struct lod_params lod_params_default(void);

/* Makes the next coarser level; its camera is tile_pack_camera()'s. Skins are marked anew at its
 * own size, and a coarse skin is disproved if one of the cells under it is and none of them is
 * frontier. Allocates the photograph. Threads: OpenMP inside. ST_INVALID for a photograph of one
 * pixel, ST_NOMEM. */
ST_MUST_CHECK enum st lod_half(const struct photo *fine, const struct lod_params *params,
                               struct photo *out_coarse, struct errctx *err);

/* rms difference between the samples of `fine` in columns [2 u0, 2 u0 + 2 n) and rows [2 v0, ..)
 * and what the coarse level interpolates there, 1/m; pixels beside silhouettes do not count. NaN if
 * none is left. */
float lod_error(const struct photo *fine, const struct photo *coarse, int32_t u0_px, int32_t v0_px,
                int32_t n_px);

#ifdef __cplusplus
}
#endif
#endif
