/* From noisy light to a picture: filtering guided by shape, the lens's glare, the sensor, the tone
 * curve. */
#ifndef SC_TWIN_FILM_H
#define SC_TWIN_FILM_H

#include "base/st.h"

#include <stdint.h>

/* Planes of [height][width][3] floats, except depth and normal. All owned by the caller. */
struct film {
    int width_px, height_px;
    float *albedo; /* what the light falls on, through glass */
    float *direct; /* irradiance / pi */
    float *indirect;
    float *added;    /* light that is there already: lamps, sky, mirrored */
    float *normal;   /* [..][3] */
    float *depth_m;  /* [..]; 0 where there is no surface */
    float *variance; /* [..] of the luminance of `direct`, as its samples show it */
    float *scratch;  /* [..][3] */
};

/* Smooths the light, not the picture, across pixels of like normal and depth only: single pixels
 * that stick out are clipped to their neighbours; `indirect` is smoothed widely, `direct` as far as
 * its own noise asks for (edge-avoiding a-trous wavelets, Dammertz et al. 2010, steered by
 * variance, Schied et al. 2017). */
void film_filter(struct film *film);

/* albedo * (direct + indirect) + added into `direct`, then glare from what is brighter than white.
 */
void film_compose(struct film *film, double white);

struct film_sensor {
    double white; /* radiance that becomes 1 */
    double vignetting, noise, full_well;
    uint64_t seed;
};

/* `direct` to 8-bit sRGB pixels, [height][width][3], through sensor and tone curve. */
void film_develop(const struct film *film, const struct film_sensor *sensor, uint8_t *out_rgb);

#endif
