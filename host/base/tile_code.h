/* One tile of a 3D photograph as bytes: disparities quantised to the error asked for or replaced by
 * a plane, colours, flags and confidences, each predicted and compressed (zstd).
 *
 * A coded tile is complete by itself: up to 33 x 33 samples, with the row and column that its
 * border cells share with the neighbours. Decoding trusts nothing. */
#ifndef SC_BASE_TILE_CODE_H
#define SC_BASE_TILE_CODE_H

#include "base/st.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    TILE_CODE_SIDE = 33,
    TILE_CODE_SAMPLES = TILE_CODE_SIDE * TILE_CODE_SIDE,
    TILE_CODE_MAX_BYTES = 16384 /* of one coded tile */
};

/* Samples of a tile, row after row without gaps. */
struct tile_samples {
    int32_t width, height; /* 1..33, apron included */
    uint8_t rgb[3 * TILE_CODE_SAMPLES];
    float disparity_per_m[TILE_CODE_SAMPLES]; /* NaN: none; 0: sky */
    uint8_t flags[TILE_CODE_SAMPLES];
    uint8_t confidence[TILE_CODE_SAMPLES];
};

enum tile_code_kind {
    TILE_CODE_SAMPLED = 1, /* a disparity for every sample */
    TILE_CODE_PLANE = 2    /* disparity = c0 + cu u + cv v, u and v from the tile's first sample */
};

struct tile_code_options {
    double step_per_m;   /* of the quantised disparities; error at most half; 0: exact float32 */
    int32_t plane;       /* 1: store as a plane where the samples are one within their noise */
    double plane_sigmas; /* no sample may be further from the plane than so many sigmas */
    int32_t confidence_step; /* confidences are rounded down to multiples: 1 keeps them */
    int32_t zstd_level;
};
/* step as given, planes within 5 sigmas, confidence step 4, zstd 9. */
struct tile_code_options tile_code_options_default(double step_per_m);

/* What the coder decided, for whoever wants to know why. */
struct tile_code_stats {
    enum tile_code_kind kind;
    double
        plane_chi2; /* mean squared residual over sigma^2 of the best plane; NaN: no plane fits */
    float plane[3]; /* c0, cu, cv */
    double bits_disparity;         /* per sample, after compression, and so on */
    double bits_colour, bits_rest; /* rest: flags and confidences */
    int32_t levels_bits;           /* bits that the span needs at this step, before prediction */
    double error_max_per_m;        /* largest change of a disparity */
};

/* Encodes to out_bytes (room for TILE_CODE_MAX_BYTES). out_stats may be NULL. ST_INVALID for bad
 * sizes, options, negative or infinite disparities. About 100 us. Allocates inside zstd only. */
ST_MUST_CHECK enum st tile_code_encode(const struct tile_samples *samples,
                                       const struct tile_code_options *options, uint8_t *out_bytes,
                                       size_t *out_size, struct tile_code_stats *out_stats);

/* Decodes; out_kind may be NULL. ST_FORMAT for bytes that are no tile. About 20 us. */
ST_MUST_CHECK enum st tile_code_decode(const uint8_t *bytes, size_t size,
                                       struct tile_samples *out_samples,
                                       enum tile_code_kind *out_kind);

/* Least-squares plane through the samples with a disparity, weighted with their confidence. Returns
 * the number of samples; out_chi2 is the mean of (residual / sigma)^2, out_worst the largest
 * |residual| / sigma. Fewer than 3 samples, or all on a line: 0. */
int32_t tile_code_plane(const struct tile_samples *samples, float out_plane[3], double *out_chi2,
                        double *out_worst);

#ifdef __cplusplus
}
#endif
#endif
