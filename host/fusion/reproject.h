/* Skins by reprojection: one photograph seen from the place of another.
 *
 * Nyland et al. 1999, section 4.4: warp photograph A to the viewpoint of B. A pixel of B says that
 * space is empty up to its depth. A mesh cell of A that would stand in that empty space does not
 * exist: it is a skin, and B disproves it. Skins hide skins, so A is warped again without them
 * until nothing changes. What no view disproves is a hole in what is known: the frontier of the
 * unknown.
 *
 * Only cells that bridge a step can be skins, so only those are drawn (by host/raster, as an item
 * buffer); the solid surfaces that may hide them are in B's own depths. */
#ifndef SC_FUSION_REPROJECT_H
#define SC_FUSION_REPROJECT_H

#include "base/photo.h"
#include "base/pose.h"
#include "base/st.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* One photograph of the set. */
struct reproject_view {
    struct photo *photo;
    struct pose world_from_station;
    int64_t station; /* views with the same number share their centre: nothing to see from one in
                        the other */
    double pose_sigma_m, pose_sigma_rad; /* of the station's pose; within a station they cancel */
};

struct reproject_params {
    double sigmas;           /* a cell must be nearer than what B says by so many sigmas */
    double step_sigmas;      /* cells with smaller steps cannot be skins ... */
    double step_grazing_rad; /* ... nor those as flat as a surface seen at this incidence */
    int32_t view_px;         /* B is looked at with at most so many pixels a side */
    int32_t trust_no_return; /* 0: only sky and surfaces say that space is empty; 1: so does no
                                return */
    int32_t max_rounds;      /* of warping A to B */
};
struct reproject_params reproject_params_default(void);

struct reproject_counts {
    int64_t candidates;   /* cells that could be skins */
    int64_t disproved;    /* of those */
    int64_t pairs, warps; /* pairs of views that met, item buffers drawn */
    int64_t unsure;       /* pixels that would disprove a cell if the poses were known better */
};

/* Progress: called after each photograph, from any thread, one at a time; returning false stops
 * with ST_CANCELLED. May be NULL. */
struct reproject_progress {
    bool (*step)(void *context, size_t done, size_t total);
    void *context;
};

/* Sets PHOTO_SKIN_DISPROVED on every cell of every photograph that another view disproves, whatever
 * skin_mark() thought of it; clears PHOTO_NO_RETURN on the other pixels with a disparity. Where
 * the poses' own errors may shift a pixel of B by more than its margin, B says nothing. Order of
 * views and number of threads do not matter: what B says never depends on skins. Cost: about
 * candidates plus view_px^2 a pair; photographs in parallel (OpenMP), 12 view_px^2 bytes a thread.
 * Errors: ST_NOMEM, ST_INVALID, ST_CANCELLED. */
ST_MUST_CHECK enum st reproject_skins(const struct reproject_view *views, size_t count,
                                      const struct reproject_params *params,
                                      const struct reproject_progress *progress,
                                      struct reproject_counts *out_counts, struct errctx *err);

/* Marks in out_cells ([height][width], 1 or 0) which cells of a photograph could be skins: all four
 * corners (or three) are there and the step between two of them is more than the parameters call
 * flat. */
void reproject_candidates(const struct photo *photo, const struct reproject_params *params,
                          uint8_t *out_cells);

#ifdef __cplusplus
}
#endif
#endif
