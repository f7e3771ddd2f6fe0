/* The 3D photograph: a colour image with, per pixel, generalised disparity, flags and confidence; and its
 * cut into tiles, the unit of culling, streaming, level of detail and drawing.
 *
 * Geometry (McMillan and Bishop 1995; Nyland et al. 1999, section 4.3). A photograph is an undistorted
 * pinhole image. ray = K^-1 [u v 1]^T in `cam`; the surface point seen at pixel (u, v) is
 *   p_cam = ray / delta,   delta = |ray| / range = 1 / Z   [1/m]
 * so delta is the inverse depth along the optical axis, 0 is infinity, and over a plane delta is affine in
 * (u, v). In homogeneous coordinates [ray; delta] is the point, valid from contact to infinity. */
#ifndef SC_BASE_PHOTO_H
#define SC_BASE_PHOTO_H

#include "base/camera.h"
#include "base/pose.h"
#include "base/st.h"
#include "base/vec.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* One flag byte a pixel. A pixel whose disparity is NaN carries no surface; which of the first two bits is
 * set says why, and neither set means that nothing looked there. */
enum photo_flag {
    PHOTO_NO_RETURN = 1u << 0,     /* the beam met nothing in range: a statement about space */
    PHOTO_DROPPED = 1u << 1,       /* the sensor gave nothing usable: no statement */
    PHOTO_FILLED = 1u << 2,        /* disparity from neighbours, no sample of its own */
    PHOTO_MIXED = 1u << 3,         /* a second strong surface was seen in this pixel */
    PHOTO_SILHOUETTE = 1u << 4,    /* on a depth discontinuity */
    PHOTO_SKIN = 1u << 5,          /* the mesh cell right-below this pixel bridges a discontinuity */
    PHOTO_LOW_CONFIDENCE = 1u << 6,
    PHOTO_SKY = 1u << 7            /* at infinity by decision; disparity is then 0, not NaN */
};

/* A skin is a mesh cell; its flag stands at the cell's top-left pixel. Skins that another view has seen
 * through are disproved: nothing is there. The others are the frontier of the unknown: nobody has looked at
 * what they hide. At a pixel with a disparity PHOTO_NO_RETURN means nothing by itself; beside PHOTO_SKIN it
 * marks the cell as disproved. */
enum { PHOTO_SKIN_DISPROVED = PHOTO_SKIN | PHOTO_NO_RETURN };

/* Confidence byte: the standard deviation of the disparity on a logarithmic scale. 0: unknown;
 * c in 1..255: sigma = 1e-6 * 2^((255 - c) / 10) 1/m, that is 1e-6 (c = 255) to about 42 (c = 1),
 * in steps of 7 %. */
double photo_sigma_from_confidence(uint8_t confidence); /* NaN for 0 */
/* Never claims more confidence than sigma justifies: rounds sigma up; NaN, <= 0 or infinite gives 0. */
uint8_t photo_confidence_from_sigma(double sigma_per_m);

/* A photograph in memory. All planes are [height][width], tightly packed. */
struct photo {
    struct camera camera;           /* a pinhole: distortion already removed */
    struct pose station_from_cam;   /* metres; the station's pose in the world is the site's to know */
    uint8_t *rgb;                   /* [height][width][3], sRGB */
    float *disparity_per_m;         /* NaN: none; 0: infinity */
    uint8_t *flags;                 /* enum photo_flag */
    uint8_t *confidence;
};

/* Allocates planes for camera->width_px x height_px: rgb 0, disparity NaN, flags 0, confidence 0.
 * ST_INVALID for a bad or distorted camera, ST_NOMEM. Sizes of 0 are refused, 1x1 is fine. */
ST_MUST_CHECK enum st photo_create(const struct camera *camera, struct photo *out_photo,
                                   struct errctx *err);
void photo_destroy(struct photo *photo); /* takes NULL or zeroed */

enum { PHOTO_TILE_PX = 32 };

/* A tile: up to 33x33 samples of a photograph (the last row and column are the next tile's first, so that
 * the mesh cells on the border belong to exactly one tile), seen as a view into the photograph's planes.
 *
 *   [X; w] = m * [u v 1 delta]^T,   position = origin_m + X / w   (w = delta; w = 0 is the direction X)
 *
 * with (u, v) counted from the tile's first pixel. m is R E T of Nyland et al., eq. 1, with the translation
 * relative to origin_m (the camera's centre in the world), so that world coordinates of 1e7 m never meet a
 * float: for X = R ray exactly. */
struct tile {
    const uint8_t *rgb;              /* first pixel; next row is + 3 * stride_px */
    const float *disparity_per_m;    /* first pixel; next row is + stride_px */
    const uint8_t *flags;
    const uint8_t *confidence;
    int32_t stride_px;
    int32_t u0_px, v0_px;            /* place of the first pixel in the photograph */
    int32_t width_px, height_px;     /* samples that the tile owns: 1..32 */
    int32_t cells_x, cells_y;        /* mesh cells it owns: width - 1 or width where a neighbour follows */
    float disparity_min_per_m, disparity_max_per_m; /* over the cells' samples too; min > max if none */
    int32_t valid_count;             /* owned samples with a disparity */
    struct mat4 m;                   /* rows 0..2: X; row 3: w */
    struct vec3 origin_m;            /* world */
};

/* How many tiles a photograph of that size has. */
size_t photo_tile_count(int32_t width_px, int32_t height_px);

/* Cuts the photograph into tiles, row by row. `out_tiles` has room for photo_tile_count(). The tiles point
 * into `photo`, which must outlive them. world_from_station may be NULL: identity. One pass over the
 * disparities. */
void photo_tiles(const struct photo *photo, const struct pose *world_from_station,
                 struct tile *out_tiles);

#ifdef __cplusplus
}
#endif
#endif
