#include "fusion/scatter.h"

#include <math.h>
#include <string.h>

static enum st array_rewind(void *context, struct errctx *err) {
    (void)err;
    struct scatter_array *state = context;
    state->at = 0;
    return ST_OK;
}

static enum st array_next(void *context, struct scatter_sample *out_samples, size_t capacity,
                          size_t *out_count, struct errctx *err) {
    (void)err;
    struct scatter_array *state = context;
    size_t n = state->count - state->at;
    if (n > capacity)
        n = capacity;
    if (n)
        memcpy(out_samples, state->samples + state->at, n * sizeof *out_samples);
    state->at += n;
    *out_count = n;
    return ST_OK;
}

struct scatter_source scatter_source_array(struct scatter_array *state,
                                           const struct scatter_sample *samples, size_t count) {
    state->samples = samples;
    state->count = count;
    state->at = 0;
    struct scatter_source source = {state, array_rewind, array_next};
    return source;
}

void scatter_from_polar(const struct polar_sample *polar, size_t count, struct vec3 origin_m,
                        const struct scatter_noise *noise, struct scatter_sample *out_samples) {
    for (size_t i = 0; i < count; i++) {
        const struct polar_sample *in = polar + i;
        struct scatter_sample *out = out_samples + i;
        double ce = cos(in->elevation_rad);
        struct vec3 dir = {ce * cos(in->azimuth_rad), ce * sin(in->azimuth_rad),
                           sin(in->elevation_rad)};
        double range_m = (double)in->range_m;
        uint8_t flags = in->flags;
        bool none = (flags & (SAMPLE_NO_RETURN | SAMPLE_DROPPED)) != 0;
        if (!none && !(range_m > 0.0 && isfinite(range_m))) {
            flags |= SAMPLE_DROPPED;
            none = true;
        }
        struct vec3 p = none ? dir : vec3_madd(origin_m, dir, range_m);
        out->p_m[0] = (float)p.x;
        out->p_m[1] = (float)p.y;
        out->p_m[2] = (float)p.z;
        out->sigma_m = none ? NAN : (float)hypot(noise->sigma_m, noise->sigma_per_m * range_m);
        out->intensity = in->intensity;
        out->flags = flags;
        memcpy(out->rgb, in->rgb, sizeof out->rgb);
    }
}
