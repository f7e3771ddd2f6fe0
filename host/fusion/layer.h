/* The layered image: scattered samples splatted bilinearly onto an image plane (Nyland et al. 1999,
 * section 4.3), one bounded list of layers a pixel (see cluster.h).
 *
 * Memory is 128 bytes a pixel and does not depend on the number of samples. Samples are projected
 * in parallel, sorted into bands of rows without losing their order, and each band is filled by one
 * thread, so the bytes are the same for any number of threads. */
#ifndef SC_FUSION_LAYER_H
#define SC_FUSION_LAYER_H

#include "base/camera.h"
#include "base/pose.h"
#include "base/st.h"
#include "fusion/cluster.h"
#include "fusion/scatter.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct layer_params {
    double splat_px;        /* half width of the bilinear weight, 1..LAYER_MAX_SPLAT_PX: larger
                               fills larger holes */
    double cluster_sigmas;  /* threshold of the clustering */
    double grazing_rad;     /* steepest incidence that the threshold makes room for */
    double sigma_default_m; /* for samples that do not know their own */
    double sigma_floor_m;   /* no sample is believed better than this; > 0 */
    double intensity_scale; /* grey = 255 (scale * intensity)^(1/2.2) */
};
enum { LAYER_MAX_SPLAT_PX = 16 };

/* splat 1, 3 sigmas, 68 degrees (steeper surfaces are joined once their gradient is known), 5 mm,
 * 0.1 mm, 1. */
struct layer_params layer_params_default(void);

struct layer_image {
    struct camera camera; /* a pinhole */
    struct pose station_from_cam;
    struct layer_params params;
    struct cluster_pixel *px; /* [height][width] */
    int64_t sample_count;     /* samples that touched the image */
    void *scratch;            /* the projector's buffers */
};

/* ST_INVALID for a distorted camera or senseless parameters, ST_NOMEM. */
ST_MUST_CHECK enum st layer_create(const struct camera *camera, const struct pose *station_from_cam,
                                   const struct layer_params *params, struct layer_image *out_image,
                                   struct errctx *err);
void layer_destroy(struct layer_image *image); /* takes NULL or zeroed */

/* Adds samples; those behind the image plane or outside the image are ignored, NaN points count as
 * dropped without a direction, that is not at all. The result depends on the order of the samples
 * only. Threads: OpenMP inside. Errors: ST_NOMEM. */
ST_MUST_CHECK enum st layer_add(struct layer_image *image, const struct scatter_sample *samples,
                                size_t count);

/* Adds all that a source has, from its start. */
ST_MUST_CHECK enum st layer_add_source(struct layer_image *image,
                                       const struct scatter_source *source, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
