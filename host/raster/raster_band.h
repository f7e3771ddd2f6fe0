/* Private to the rasteriser: what its files share. A frame is cut into bands of whole rows; each
 * band is drawn by one thread into keys of its own, so that no two threads meet in a pixel.
 *
 * Key of a pixel: depth in the upper 32 bits, colour in the lower. Depths are not negative, so
 * their float bits ascend like integers; one is added, so that an upper half of 0 says "nothing
 * here". The larger key wins. */
#ifndef SC_RASTER_RASTER_BAND_H
#define SC_RASTER_RASTER_BAND_H

#include "raster/raster.h"

#include <math.h>
#include <string.h>

enum {
    BAND_PAD_PX = 4, /* pixels around a band that may be written and are not read */
    ROW_MAX = 40,    /* samples in a row of a tile and its right neighbour, rounded up */
    SMALL_MAX_PX = 4 /* footprints up to so many pixels wide are drawn without branches */
};

/* Splats never get smaller than half the diagonal of a pixel, so that none falls between pixel
 * centres. */
#define RADIUS_MIN_PX 0.70710678f

/* Inner loops are written as functions that must become part of their caller, so that they are
 * compiled for the instruction set that it was cloned for. */
#define KERNEL static inline __attribute__((always_inline))

struct band {
    int32_t width_px;
    int32_t y0_px, y1_px; /* rows of the target: y0 <= y < y1 */
    ptrdiff_t stride;     /* keys from row to row */
    uint64_t *key;        /* of pixel (0, y0); BAND_PAD_PX more on each side */
    /* The rich variant: as `key`, or NULL in the plain one. */
    uint64_t *item;
    float *depth;
    uint16_t *count;
};

/* What is the same for all tiles of a frame. */
struct frame {
    const struct raster_options *options;
    const struct raster_view *view;
    double clip[12];     /* rows x, y, w of pixel_from_cam over (X, Y, Z) */
    double depth_row[4]; /* over (X, Y, Z, delta) in cam */
    double scale_px;     /* pixels per metre at w = 1 */
    float fall_rel,
        fall_abs;    /* loss of depth at a splat's rim = (fall_rel * depth + fall_abs) * radius */
    float push_gain; /* push_sigma in units of depth; 0: no push-back */
    float depth_max; /* samples above it are nearer than near_m */
    float sigma_per_m[256];
    bool rich;
};

/* A tile that may be seen. */
struct tile_job {
    const struct tile *tile;
    double c[16];    /* rows x, y, d, w over (u, v, 1, delta): [x y d w] = C [u v 1 delta] */
    float lin_px;    /* side of a projected sample = lin_px / w */
    float radius_px; /* splat radius before its bounds = radius_px / w */
    int32_t y_lo_px, y_hi_px;       /* rows it can touch, inclusive */
    uint32_t input;                 /* index of its input */
    float nearest;                  /* depth about its middle, as the view defines it */
    uint64_t item;                  /* raster_item() of its sample (0, 0) */
    int32_t u_lo, u_hi, v_lo, v_hi; /* pixels of the photograph that may be read, inclusive, in the
                                       tile's coordinates */
};

static inline uint32_t float_bits(float f) {
    uint32_t u;
    memcpy(&u, &f, sizeof u);
    return u;
}
static inline float float_from_bits(uint32_t u) {
    float f;
    memcpy(&f, &u, sizeof f);
    return f;
}

/* The upper half of a key; depth >= 0. + 0 turns -0 into 0. */
static inline uint64_t key_depth(float depth) {
    return (uint64_t)(float_bits(depth + 0.0f) + 1u) << 32;
}
static inline uint32_t key_rgba(uint8_t r, uint8_t g, uint8_t b, uint8_t a) {
    return (uint32_t)r | (uint32_t)g << 8 | (uint32_t)b << 16 | (uint32_t)a << 24;
}

/* One fragment of the rich variant. `at` is an index into the band's planes. */
static inline void band_put_rich(const struct band *band, ptrdiff_t at, uint64_t key, uint64_t item,
                                 float depth) {
    if (band->count[at] != UINT16_MAX)
        band->count[at]++;
    if (key < band->key[at] || (key == band->key[at] && item >= band->item[at]))
        return;
    band->key[at] = key;
    band->item[at] = item;
    band->depth[at] = depth;
}

/* Projected area of a sample in octaves above 1/16 px, 0..12, from (side in px)^2; piecewise linear
 * in between, which keeps the order. */
static inline float area_octaves(float area_px) {
    float octaves = (float)((int32_t)float_bits(area_px) - 0x3f800000) * (1.0f / 8388608.0f) + 4.0f;
    octaves = octaves > 0.0f ? octaves : 0.0f;
    return octaves < 12.0f ? octaves : 12.0f;
}

/* Is the sample there at all, to be drawn in its own right? A disparity on a PHOTO_DROPPED pixel is
 * a guess that only bounds skins. */
static inline bool sample_hidden(uint8_t flags, uint8_t leave_out_flags) {
    return (flags & (leave_out_flags | PHOTO_DROPPED)) != 0;
}

/* raster_band.c. A band of up to rows_cap rows lives in raster_band_bytes() of somebody's memory;
 * which rows it is, y0_px and y1_px, is set after it was made. */
size_t raster_band_bytes(int32_t width_px, int32_t rows_cap, bool rich);
struct band raster_band_make(void *memory, int32_t width_px, int32_t rows_cap, bool rich);
void raster_band_clear(const struct band *band);
/* Adds a layer; when all are in, raster_band_unmark() makes ordinary keys again. */
void raster_band_merge(const struct band *layer, const struct band *all);
void raster_band_unmark(const struct band *all);
/* The planes that the caller wants. */
void raster_band_resolve(const struct band *band, const struct raster_target *target,
                         uint32_t background);

/* raster_cull.c: fills `out_job` for a tile, false if it cannot touch the picture. `frame` is set
 * up by raster_cull_frame(). */
void raster_cull_frame(const struct raster_view *view, const struct raster_options *options,
                       bool rich, struct frame *out_frame);
bool raster_cull_tile(const struct frame *frame, const struct raster_input *input,
                      size_t tile_index, struct tile_job *out_job);

/* raster_splat.c, raster_mesh.c: draw a tile into a band; the number of pixels they tested. */
int64_t raster_splat_tile(const struct frame *frame, const struct tile_job *job,
                          const struct band *band);
int64_t raster_mesh_tile(const struct frame *frame, const struct tile_job *job,
                         const struct band *band);

/* raster_mesh_large.c: one triangle of any size, corners as [x y d w u v pushed_d] homogeneous. */
struct mesh_corner {
    double x, y, d, w, u, v, push; /* push: loss of depth / w, not homogeneous */
};
struct mesh_paint {
    const struct tile_job *job;
    bool skin; /* in skin_rgb */
};
int64_t raster_mesh_large_triangle(const struct frame *frame, const struct mesh_paint *paint,
                                   const struct mesh_corner corner[3], const struct band *band);

/* raster_texture.c: colour of the photograph at (u, v) of the tile's coordinates, as key_rgba(). */
uint32_t raster_texture_rgba(const struct frame *frame, const struct mesh_paint *paint, float u,
                             float v);

#endif
