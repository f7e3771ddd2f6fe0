/* Layers to a 3D photograph: the heaviest cluster of each pixel becomes its disparity, with a
 * standard deviation, and flags say what was left out.
 *
 * Within a surface the samples' mean place is not the pixel's centre; on an inclined surface the
 * mean disparity is therefore off by gradient times that offset. The gradient is estimated from the
 * neighbours' layers and the mean moved to the centre: over a plane disparity is affine in (u, v),
 * so this is exact.
 *
 * sigma^2 = samples' variance of the mean + (gradient noise x offset)^2 + (gradient x angle
 * jitter)^2 / n
 *           + (systematic sigma)^2
 *
 * A cluster that its neighbourhood does not bear out beside or between other surfaces is what a beam
 * split by an edge returns ("mixed pixel", see mixed.c); it is refused, and the next heaviest
 * cluster takes the pixel, or nothing does. What is known only from beyond the pixel, with nothing
 * on its other side, keeps the samples' own disparity: a gradient is not carried past an edge.
 */
#ifndef SC_FUSION_RESOLVE_H
#define SC_FUSION_RESOLVE_H

#include "base/photo.h"
#include "fusion/layer.h"

#ifdef __cplusplus
extern "C" {
#endif

struct resolve_params {
    double min_weight;        /* clusters lighter than this are not believed */
    double mixed_ratio;       /* a second cluster this heavy, relative to the first, is flagged */
    double agree_sigmas;      /* neighbours agree within so many sigmas */
    double sigma_angle_rad;   /* noise of one sample's direction */
    double beam_rad;          /* width of what one sample averages: spot and motion; sets how wide a
                                 floating strip may be and still be refused */
    double sigma_system_m;    /* of the range, that does not average out */
    double low_confidence;    /* sigma of the range above this share of the range is flagged */
    double low_confidence_m;  /* ... and at least this much */
    double sky_elevation_rad; /* no-return regions that reach this elevation in the station frame
                                 and are large are sky; NaN: never */
    int32_t refuse_mixed;     /* 0: keep what floats (for comparison) */
    int32_t plain_mean;       /* 1: mean over all layers instead of the heaviest (for comparison) */
};
struct resolve_params resolve_params_default(void);

struct resolve_counts {
    int64_t valid, filled, mixed, no_return, dropped, sky, low_confidence, refused, unseen;
};

/* Writes disparity, flags and confidence, and rgb from the samples where `colour` is not 0.
 * `out_photo` was made by photo_create() with the image's camera; station_from_cam is copied. The
 * layers are merged in place (see cluster_merge()), so resolve only once. Threads: OpenMP inside,
 * same bytes for any number. Errors: ST_INVALID (sizes differ), ST_NOMEM (25 bytes a pixel of
 * scratch). */
ST_MUST_CHECK enum st resolve_photo(struct layer_image *image, const struct resolve_params *params,
                                    int colour, struct photo *out_photo,
                                    struct resolve_counts *out_counts, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
