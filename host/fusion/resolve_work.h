/* What resolve.c and mixed.c share: the candidate of each pixel. Internal to fusion. */
#ifndef SC_FUSION_RESOLVE_WORK_H
#define SC_FUSION_RESOLVE_WORK_H

#include "fusion/resolve.h"

#include <math.h>

/* The candidate of a pixel: its heaviest cluster so far. */
struct candidate {
    float disparity_per_m; /* NaN: none */
    float sigma_per_m;     /* of the mean, from the samples */
    float u_px, v_px;      /* mean place of the samples, in the image */
    float gu, gv;          /* gradient of the surface, 1/m per px; 0 where unknown */
    float var_factor;      /* variance at the pixel's centre over that of the mean */
};

struct resolve_work {
    struct layer_image *image;
    const struct resolve_params *params;
    struct cluster_rule rule;
    struct candidate *candidates; /* [height][width] */
    uint8_t *refused;             /* layers refused so far */
    uint8_t *support;             /* directions from which a surface leads up to the pixel, 0..8 */
    int32_t width, height;
    int32_t stride; /* pixels this far apart do not share their samples */
    int32_t strip;  /* how wide a strip of split beams can be, px */
};

/* The candidate at (x, y); NULL outside the image and where there is none. */
static inline const struct candidate *neighbour(const struct resolve_work *w, int32_t x,
                                                int32_t y) {
    if (x < 0 || y < 0 || x >= w->width || y >= w->height)
        return NULL;
    const struct candidate *c = w->candidates + (size_t)y * (size_t)w->width + (size_t)x;
    return isnan(c->disparity_per_m) ? NULL : c;
}

/* How far two candidates may differ for noise alone. */
static inline float noise_of(const struct resolve_work *w, const struct candidate *a,
                             const struct candidate *b) {
    return (float)w->params->agree_sigmas *
           sqrtf(a->sigma_per_m * a->sigma_per_m + b->sigma_per_m * b->sigma_per_m);
}

/* The heaviest layer that is not refused; NULL if there is none, or what is there is too light or
 * outweighed by samples without return. */
const struct cluster_layer *resolve_heaviest(const struct resolve_work *w, size_t i);

/* Makes the heaviest layer that is not refused the pixel's candidate, without a gradient. */
void resolve_choose(struct resolve_work *w, size_t i);

/* Gradients anew where `only` is 1; NULL: everywhere. Threads: OpenMP inside. */
void resolve_gradients(struct resolve_work *w, const uint8_t *only);

/* The first pixel of a row from `from` on whose mark is 1; width: none. */
int32_t resolve_next_mark(const uint8_t *row, int32_t from, int32_t width);

/* Sets the marks of what a change at (x, y) can influence. */
void resolve_mark_around(const struct resolve_work *w, uint8_t *marks, int32_t x, int32_t y);

/* Refuses the clusters that float, until none is left that does. Adds to *out_refused.
 * Errors: ST_NOMEM. */
enum st mixed_refuse(struct resolve_work *w, int64_t *out_refused);

/* Only samples on one side touch the pixel, and on the other side no surface goes on: what it shows
 * lies at the edge of its surface, and the gradient must not carry it farther. */
bool mixed_overhangs(const struct resolve_work *w, int32_t x, int32_t y);

#endif
