/* Redundant tiles: surfaces that several photographs show are kept where they are shown best.
 *
 * Nyland et al. 1999, section 4.6: rank tiles by intrinsic quality; from worst to best try to
 * reject each, by looking from every other photograph: where the other shows the same surface and
 * samples it better, the pixel is redundant; a tile all of whose pixels are goes.
 *
 * "Better" is the area of the surface that one pixel covers, |n| / (delta^3 fx fy) for a plane n.p
 * = 1: range and obliqueness in one number, times a penalty for pixels flagged as doubtful.
 *
 * No seams: a tile goes only if each of its samples, those shared with its neighbours included,
 * lies within a solid mesh cell, in a tile that stays, of a photograph that shows the same surface.
 */
#ifndef SC_FUSION_CULL_H
#define SC_FUSION_CULL_H

#include "base/photo.h"
#include "base/pose.h"
#include "base/st.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct cull_view {
    const struct photo *photo; /* with skins marked */
    struct pose world_from_station;
    int64_t station;                     /* poses of one station err together */
    double pose_sigma_m, pose_sigma_rad; /* of the station's pose */
    uint8_t *culled; /* [photo_tile_count()]: output, 1 where the tile is redundant */
};

struct cull_params {
    double threshold; /* how much worse a sample may be and still replace another: its pixel may
                         cover so many times the area. 0: cull nothing; 1: only what is shown
                         better; 2: aggressive */
    double sigmas;    /* two samples show one surface if they differ by so many sigmas at most */
    double doubt;     /* penalty factor on the area for flagged pixels */
    int32_t keep_frontier; /* 1: tiles with undisproved skins stay: they say what is unknown */
};
/* threshold 1, 4 sigmas, doubt 4, frontier kept. */
struct cull_params cull_params_default(void);

struct cull_counts {
    int64_t tiles, empty, culled;
    int64_t frontier; /* tiles kept for their frontier only */
};

/* Called now and then; returning false stops with ST_CANCELLED. May be NULL. */
struct cull_progress {
    bool (*step)(void *context, size_t done, size_t total);
    void *context;
};

/* Marks redundant tiles in each view's `culled`. The order is by quality, then view, then tile, so
 * the outcome depends on nothing else. Scratch: 4 bytes a pixel of all photographs. ST_NOMEM,
 * ST_CANCELLED. */
ST_MUST_CHECK enum st cull_tiles(const struct cull_view *views, size_t count,
                                 const struct cull_params *params,
                                 const struct cull_progress *progress,
                                 struct cull_counts *out_counts, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
