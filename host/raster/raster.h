/* The portable rasteriser: tiles of 3D photographs to pixels and depths, no GL.
 *
 * It is the oracle for every other renderer, the fast path where there is no GPU, and what fusion
 * reprojects one photograph into another's view with.
 *
 * Method (Nyland et al. 1999, section 5). Per tile C = P V M in double, relative to the eye, 4 x 4:
 *   [x y d w]^T = C [u v 1 delta]^T,   pixel = (x / w, y / w),   depth = d / w
 * then in float along rows of 32 samples. `depth` is larger for what is nearer, 0 is infinity, and
 * nothing is ever divided by a disparity.
 *
 * Determinism. Same inputs, same bytes, whatever the number of threads. The winner of a pixel is
 * the largest of (depth, r, g, b) over all that covers it, a total order that does not know in
 * which order photographs and tiles came: any order gives the same colours and depths. Only the
 * item buffer asks for the order given, where two samples agree in depth and in colour: the
 * smallest item wins. */
#ifndef SC_RASTER_RASTER_H
#define SC_RASTER_RASTER_H

#include "base/camera.h"
#include "base/photo.h"
#include "base/pose.h"
#include "base/st.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ---- what is drawn ---- */

/* One photograph, or any other set of tiles. */
struct raster_input {
    const struct tile *tiles;
    size_t tile_count;
    /* Size of the photograph that the tiles are views into, so that a texture filter may read
     * beyond a tile's border; 0 x 0: the tiles stand alone and the filter clamps at their border.
     */
    int32_t photo_width_px, photo_height_px;
    uint32_t id; /* goes into the item buffer, below RASTER_MAX_INPUT_ID */
};

/* ---- from where ---- */

enum raster_projection {
    RASTER_PINHOLE,     /* depth = 1 / Z, in 1/m */
    RASTER_ORTHOGRAPHIC /* depth = (far_m - Z) / (far_m - near_m); nothing outside 0..1 is drawn */
};

struct raster_view {
    enum raster_projection projection;
    int32_t width_px, height_px; /* 1..RASTER_MAX_SIDE_PX, also the target's size */
    /* Pinhole: u = fx X/Z + cx, v = fy Y/Z + cy. Orthographic: u = fx X + cx, fx in px/m. */
    double fx, fy, cx_px, cy_px;
    double near_m; /* what is nearer along the optical axis is not drawn; >= 0 */
    double far_m;  /* orthographic only */
    /* The eye: p_cam = cam_from_world_r (p_world - eye_m). Tiles' origins are taken relative to
     * eye_m in double before anything is rounded to float. */
    struct mat3 cam_from_world_r;
    struct vec3 eye_m;
};

enum {
    RASTER_MAX_SIDE_PX = 32768,
    RASTER_MAX_INPUT_ID = 1 << 20,
    RASTER_MAX_TILES = 1 << 22 /* of one input */
};

/* The view of a pinhole camera (its distortion is ignored) standing at world_from_cam; near_m = 0.
 */
struct raster_view raster_view_pinhole(const struct camera *camera,
                                       const struct pose *world_from_cam);

/* Parallel view along world_from_cam's z, centred, px_per_m pixels to the metre, from near_m to
 * far_m. */
struct raster_view raster_view_orthographic(int32_t width_px, int32_t height_px, double px_per_m,
                                            double near_m, double far_m,
                                            const struct pose *world_from_cam);

/* The same view with n times as many pixels each way: sub-pixel centres tile the pixels exactly, so
 * that raster_downsample() by n gives the anti-aliased picture of `view`. */
struct raster_view raster_view_supersampled(const struct raster_view *view, int32_t n);

/* ---- how ---- */

enum raster_primitive {
    RASTER_POINTS, /* each sample is one pixel */
    RASTER_SPLATS, /* quadratic splats: discs in one colour, depth falls quadratically */
    RASTER_MESH    /* cells of 2 x 2 samples as two triangles each, one where a corner is missing */
};

enum raster_radius {
    RASTER_RADIUS_AREA,    /* from the projected area: grows in proportion to the magnification */
    RASTER_RADIUS_CUBEROOT /* the paper's cube root of the determinant: with its 2/3 power */
};

/* What happens to mesh cells flagged PHOTO_SKIN, with any primitive. "Guess": a corner of the cell
 * is flagged PHOTO_DROPPED and yet has a disparity (see skin_bound_unknown()); such samples are
 * never drawn themselves. Skins in skin_rgb hide what lies behind them in the same input and have
 * alpha RASTER_ALPHA_UNKNOWN; with UNKNOWN and COLOUR they yield to any surface of another input,
 * which has looked there. */
enum raster_skins {
    RASTER_SKINS_LEAVE_OUT,
    RASTER_SKINS_UNKNOWN, /* those with a guess in skin_rgb, no others */
    RASTER_SKINS_COLOUR,  /* all in skin_rgb: "nobody saw what is here" */
    RASTER_SKINS_DRAW,    /* like any other cell */
    RASTER_SKINS_ONLY     /* nothing but skins, in skin_rgb: the frontier of the unknown */
};

/* Colour inside a mesh cell. */
enum raster_filter {
    RASTER_FILTER_NEAREST,
    RASTER_FILTER_LINEAR, /* bilinear in (u, v) */
    RASTER_FILTER_CUBIC   /* Catmull-Rom in (u, v), 4 x 4 pixels of the photograph */
};

/* Of the mesh: FRONT is what its photograph saw. */
enum raster_faces { RASTER_FACES_BOTH, RASTER_FACES_FRONT };

struct raster_options {
    enum raster_primitive primitive;
    enum raster_filter filter;
    enum raster_skins skins;
    enum raster_faces faces;
    enum raster_radius radius;
    /* Splat radius = radius_k half diagonals of the projected sample, at least half a pixel's
     * diagonal; 1.2 to 1.4 closes surfaces. radius_max_px bounds what one splat can cost. */
    double radius_k, radius_max_px;
    /* Depth of a splat's rim, in splat radii behind its centre. The border between two splats lies
     * at most a quarter of their distance off the middle where the surface's slope is below falloff
     * / 2; a surface that far behind another shows through its rims. */
    double falloff;
    /* Confidence push-back: a sample goes back by push_sigma * sigma(depth) * log2(projected area
     * in px), counted from 1/16 px and up to 256 px, so that of two samples of one surface, equally
     * uncertain, the one twice as dense lies push_sigma sigmas in front. 0: off. A sample of
     * unknown confidence has sigma_unknown_per_m for the sigma of its disparity. */
    double push_sigma, sigma_unknown_per_m;
    uint8_t leave_out_flags; /* samples with any of these photo flags are not there */
    uint8_t skin_rgb[3];
    uint8_t background_rgb[3];
    int threads; /* 0: as many as OpenMP would take */
};

/* Splats by area, k 1.3, falloff 6, radius at most 64 px, no push-back, linear filter, no skins,
 * both faces, background 0. */
struct raster_options raster_options_default(void);

/* With push-back, a splat also goes back by this share of its fall-off: what it is wrong by itself.
 */
#define RASTER_SPLAT_RIM 0.2f

/* ---- where to ---- */

/* Planes of [height][width], tightly packed, row by row; the caller owns them and leaves NULL what
 * it does not want. Everything is overwritten. */
struct raster_target {
    int32_t width_px, height_px;
    uint8_t *rgba;   /* [..][4]; alpha: RASTER_ALPHA_..., the background where nothing is */
    float *depth;    /* as the view defines it; without falloff and push-back if `item` is asked for
                        too; NaN where nothing is */
    uint64_t *item;  /* raster_item(); RASTER_NO_ITEM where nothing is */
    uint16_t *count; /* samples or triangles that cover the pixel, hidden ones too; saturates */
};

enum { RASTER_ALPHA_NOTHING = 0, RASTER_ALPHA_UNKNOWN = 128, RASTER_ALPHA_SURFACE = 255 };

#define RASTER_NO_ITEM UINT64_MAX

/* Input id, index of the tile in its input, place in the tile (mesh: the sample nearest to the
 * pixel). */
static inline uint64_t raster_item(uint32_t input_id, uint32_t tile, uint32_t u_px, uint32_t v_px) {
    return (uint64_t)input_id << 40 | (uint64_t)tile << 16 | (uint64_t)v_px << 8 | u_px;
}
static inline uint32_t raster_item_input(uint64_t item) {
    return (uint32_t)(item >> 40);
}
static inline uint32_t raster_item_tile(uint64_t item) {
    return (uint32_t)(item >> 16) & 0xffffffu;
}
static inline uint32_t raster_item_v(uint64_t item) {
    return (uint32_t)(item >> 8) & 0xffu;
}
static inline uint32_t raster_item_u(uint64_t item) {
    return (uint32_t)item & 0xffu;
}

/* ---- the work ---- */

struct raster_stats {
    int64_t tiles_total, tiles_rejected; /* by the frustum, or because they hold nothing */
    int64_t samples_total;               /* with a disparity, in all tiles */
    int64_t samples_drawn;               /* of those, in tiles that were not rejected */
    int64_t bytes_touched; /* planes read, depth and colour written; not what the cache saved */
    double reject_s, draw_s, total_s; /* wall clock */
};

/* Buffers that grow to what a frame needs and are then reused. Starts zeroed. One frame at a time.
 */
struct raster_scratch {
    void *tiles, *bands;
    size_t tiles_bytes, bands_bytes;
};
void raster_scratch_fini(struct raster_scratch *scratch); /* takes NULL or zeroed */

/* Draws `inputs` into `target`, which has the view's size. out_stats may be NULL. Samples whose
 * disparity is NaN, negative or infinite are not there. Cost: one pass over the samples of the
 * tiles in view, at most radius_max_px^2 pixels a splat. Allocates only in `scratch`. Threads:
 * OpenMP inside. Errors: ST_INVALID (sizes differ, a view or an option that makes no sense, ids out
 * of range), ST_NOMEM. */
ST_MUST_CHECK enum st
raster_draw(const struct raster_input *inputs, size_t input_count, const struct raster_view *view,
            const struct raster_options *options, const struct raster_target *target,
            struct raster_scratch *scratch, struct raster_stats *out_stats, struct errctx *err);

/* Averages n x n blocks of `fine` (rgba and, where both have it, depth; other planes are left
 * alone) into `out`, in linear light and over the covered sub-pixels only; a pixel is covered if at
 * least half of its sub-pixels are. Depth is the median of the covered ones, so that no depth is
 * invented between surfaces. `fine` must be n times as wide and high. background_rgb fills the
 * rest. */
ST_MUST_CHECK enum st raster_downsample(const struct raster_target *fine, int32_t n,
                                        const uint8_t background_rgb[3],
                                        const struct raster_target *out);

#ifdef __cplusplus
}
#endif
#endif
