/* The rangefinder's light: a beam with a footprint, swept over the scene while one sample
 * integrates, and what the detector makes of the echoes.
 *
 * A sample is `rays` sub-rays, spread over the integration time and the beam's cross-section. Each
 * gives echoes (distance r, energy E): the first surface, what a mirror-like one shows, what is
 * behind glass. E = w * response(r) * (albedo cos(i) (1 - F) + lobe + retro),   response(r) = 1 /
 * (1 + (r / 2 m)^2) w: what glass and mirrors on the way leave. The detector measures the phase of
 * a modulation that repeats every `ambiguity_m`: r = ambiguity / (2 pi) * arg( sum E exp(2 pi i r /
 * ambiguity) )   mod ambiguity which is the mean range weighted by energy when the echoes are
 * close: at a silhouette, a point floating between two surfaces (Nyland et al. 1999, section 4.3).
 * Noise: sigma^2 = sigma_floor^2 + sigma_shot^2 * (echo_reference / E) * (1 + ambient_noise *
 * ambient) bias    = bias_per_decade * log10(E / echo_reference) Energies are relative: a white
 * Lambert surface at normal incidence right before the head gives 1. */
#ifndef SC_TWIN_OPTICS_H
#define SC_TWIN_OPTICS_H

#include "base/rng.h"
#include "twin/scene.h"

enum { OPTICS_MAX_RAYS = 16 };

struct optics {
    int rays; /* sub-rays a sample, 1..16; 1 is the beam's axis in the middle of the integration */
    double divergence_rad; /* full angle of the beam's cone */
    double aperture_m;     /* diameter of the beam at the mirror */
    double min_range_m, max_range_m;
    double ambiguity_m;
    double echo_seen;      /* weaker: the head says no return */
    double echo_usable;    /* weaker, but seen: dropped */
    double echo_saturates; /* stronger: flagged, and biased; 8 times that: dropped */
    double echo_reference;
    double sigma_floor_m, sigma_shot_m;
    double ambient_noise;
    double bias_per_decade_m;
    double saturation_bias_m;   /* at saturation, per factor of e above */
    double intensity_noise;     /* relative standard deviation of the reported intensity */
    double outlier_probability; /* a range from nowhere, uniform over the measuring range */
    double dropout_probability; /* nothing usable for no visible reason */
    double quantum_m;           /* step of the reported range, 0: none */
};

/* The values of the default head. */
struct optics optics_default(void);
/* One ray, no noise, no bias, no quantisation, all echoes usable. */
struct optics optics_ideal(void);

/* The beam during one integration, from tau = -1/2 to 1/2: axis(tau) = dir + tau * sweep, world
 * frame. */
struct optics_beam {
    struct vec3 origin_m, dir, sweep;
};

/* What happened, before the detector: truth. */
struct optics_echo {
    double energy;     /* 0: nothing in sight */
    double distance_m; /* of the phase, without noise, bias and wrapping; NaN without energy */
    double nearest_m, farthest_m; /* of echoes with at least 2 % of the energy */
    uint16_t part;                /* of the strongest echo */
    uint8_t echoes;
    bool mixed; /* another surface, more than 50 mm nearer or farther, gives at least 5 % */
};

/* What the head reports. */
struct optics_reading {
    double distance_m; /* NaN if flags say so */
    double sigma_m, bias_m;
    double intensity, ambient; /* 0..1 */
    uint8_t flags;             /* enum head_sample_flag */
};

/* Sends one sample's beam into the scene. `rng` turns the footprint. Any thread. */
void optics_shoot(const struct scene *scene, const struct optics *optics,
                  const struct optics_beam *beam, struct rng *rng, struct optics_echo *out_echo);

/* The detector: noise, bias, thresholds. `ambient` 0..1 at the target. */
void optics_detect(const struct optics *optics, const struct optics_echo *echo, double ambient,
                   struct rng *rng, struct optics_reading *out_reading);

#endif
