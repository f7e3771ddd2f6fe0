/* Scattered samples: what fusion eats. One record a laser sample, in the frame of one station, with
 * its own standard deviation; and the stream that delivers them again and again in the same order,
 * so that nothing has to hold a whole panorama in memory. */
#ifndef SC_FUSION_SCATTER_H
#define SC_FUSION_SCATTER_H

#include "base/sample.h"
#include "base/st.h"
#include "base/vec.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* One sample, 24 bytes. The point is relative to the station's origin, so that float is good to 0.1
 * mm at 1 km whatever the site's coordinates are. */
struct scatter_sample {
    float p_m[3];    /* station frame; unit direction if flags say no return or dropped */
    float sigma_m;   /* of the range, along the beam; NaN or < 0: unknown (params decide) */
    float intensity; /* 0..1; meaningful if SAMPLE_INTENSITY */
    uint8_t flags;   /* enum sample_flag */
    uint8_t rgb[3];  /* meaningful if SAMPLE_COLOUR */
};

/* A stream of samples that can be started over. Both are called from one thread. */
struct scatter_source {
    void *context;
    enum st (*rewind)(void *context, struct errctx *err);
    /* Writes up to `capacity` samples; 0 written is the end. */
    enum st (*next)(void *context, struct scatter_sample *out_samples, size_t capacity,
                    size_t *out_count, struct errctx *err);
};

/* A source over an array, which must outlive it; `state` is its storage. */
struct scatter_array {
    const struct scatter_sample *samples;
    size_t count, at;
};
struct scatter_source scatter_source_array(struct scatter_array *state,
                                           const struct scatter_sample *samples, size_t count);

/* How noisy a range is: sigma^2 = sigma_m^2 + (sigma_per_m range)^2. What imports without a noise
 * model of their own use. */
struct scatter_noise {
    double sigma_m, sigma_per_m;
};

/* Direction and range to points: p = origin_m + range (cos el cos az, cos el sin az, sin el). A
 * sample whose range is not positive and finite and that says neither no return nor dropped counts
 * as dropped. `out_samples` has room for `count`. No allocation. */
void scatter_from_polar(const struct polar_sample *polar, size_t count, struct vec3 origin_m,
                        const struct scatter_noise *noise, struct scatter_sample *out_samples);

#ifdef __cplusplus
}
#endif
#endif
