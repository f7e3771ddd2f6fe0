/* A range scan as its instrument's grid, and its drawing onto a picture: which neighbours lie on
 * one surface, and what every pixel of a pinhole or panorama then sees. For pictures of raw scans;
 * fusion makes better photographs from several. */
#ifndef SC_BASE_SAMPLE_GRID_H
#define SC_BASE_SAMPLE_GRID_H

#include "base/camera.h"
#include "base/pose.h"
#include "base/sample.h"
#include "base/st.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* [rows][columns]; a place that holds no sample has flags 0 and a NaN azimuth: nobody looked there.
 */
struct sample_grid {
    int32_t rows, columns;
    struct polar_sample *samples;
};

/* Sorts samples into a grid by their row and column; of two at one place the later stays.
 * ST_INVALID for a sample without a finite direction, ST_NOMEM where the grid would have more than
 * 16 places a sample and 65536 more. Free with sample_grid_destroy(), which takes a zeroed one or
 * NULL. */
ST_MUST_CHECK enum st sample_grid_create(const struct polar_sample *samples, size_t count,
                                         struct sample_grid *out_grid, struct errctx *err);
void sample_grid_destroy(struct sample_grid *grid);

/* Unit vector of a sample's direction; its point relative to the stream's origin (NaN without a
 * range). */
struct vec3 sample_direction(const struct polar_sample *sample);
struct vec3 sample_point(const struct polar_sample *sample);

/* The sample at a point seen from the origin: azimuth, elevation and range are set, the rest is 0.
 */
struct polar_sample sample_from_point(struct vec3 p_m);

/* Median angle between neighbours along rows and along columns, rad; NaN if there are no two. */
struct sample_spacing {
    double along_row_rad, along_column_rad;
};
ST_MUST_CHECK enum st sample_grid_spacing(const struct sample_grid *grid,
                                          struct sample_spacing *out_spacing);

/* Where a direction falls. */
enum sample_view_kind {
    SAMPLE_VIEW_PINHOLE, /* `camera` (without distortion) looking along station_from_cam's z */
    SAMPLE_VIEW_PANORAMA /* equal angles: u = (left - azimuth) / step, v = (top - elevation) / step
                          */
};
struct sample_view {
    enum sample_view_kind kind;
    int32_t width_px, height_px;
    struct camera camera;         /* pinhole */
    struct mat3 station_from_cam; /* pinhole; the eye is the origin of the rays */
    double left_rad, top_rad,
        step_rad_per_px; /* panorama: direction of pixel (0, 0) and pixel size */
};

struct sample_draw_options {
    double range_sigma_m;   /* of one sample: how rough a surface may look */
    double slope_limit_rad; /* two neighbours are one surface up to this angle of incidence, or if
                             * they continue the plane of a neighbour; default 60 deg */
};

/* What a picture holds, [height][width] each, the caller's; NULL where not wanted. */
struct sample_picture {
    float *inverse_per_m; /* pinhole: 1 / Z; panorama: 1 / range; NaN where there is no surface */
    uint8_t *flags;       /* enum photo_flag */
    int32_t *sample;      /* index of the nearest sample, -1 where nobody looked */
};

/* Draws the grid. Between samples of one surface 1 / Z is interpolated linearly, which is exact on
 * planes (in a panorama: 1 / range, nearly so); across a discontinuity each pixel takes the nearest
 * sample, so nothing is invented between two surfaces, and says PHOTO_SILHOUETTE. PHOTO_FILLED: no
 * sample of its own. Of two surfaces the nearer is kept. PHOTO_NO_RETURN and PHOTO_DROPPED where
 * the nearest sample says so; neither where nobody looked. A surface more than 8 spacings apart is
 * not bridged. Cost: a visit to each cell and to each pixel of it; scratch 9 bytes a pixel and 1 a
 * sample. */
ST_MUST_CHECK enum st sample_grid_draw(const struct sample_grid *grid,
                                       const struct sample_view *view,
                                       const struct sample_draw_options *options,
                                       struct sample_picture *out_picture, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
