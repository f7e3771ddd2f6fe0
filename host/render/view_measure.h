/* Measuring on screen: the surface point under a pixel with its error, and what follows from two or
 * three of them.
 *
 * The point lies on the pixel's ray, so its error does, too. Around the sample that is drawn there
 * the samples of the same surface (up to 7 x 7) give a plane in disparity by weighted least
 * squares, delta = c . (u, v, 1); over the tile's own coordinates y = (u, v, 1) / delta that is c .
 * y = 1, the ray e + t d meets it at one t, and var t = y' cov(c) y / (N . d)^2. cov(c) is
 * shared out by the residuals: chi^2 of it averages over the samples, the rest (1 - chi^2) of a
 * sample's variance is common to all of them and stays, whatever their number. Errors of the
 * stations' poses are not in it: points from one station have them in common, a distance does not
 * see them. */
#ifndef SC_RENDER_VIEW_MEASURE_H
#define SC_RENDER_VIEW_MEASURE_H

#include "render/render.h"

#ifdef __cplusplus
extern "C" {
#endif

struct view_point {
    struct vec3 p_m;     /* world */
    struct vec3 along;   /* unit, the direction of its error */
    double sigma_m;      /* standard deviation along it; NaN where the samples do not say */
    double range_m;      /* from the photograph's camera */
    int32_t samples;     /* behind it */
    double spread_sigma; /* rms of their residuals in their own sigmas */
    uint32_t input;
};

/* Items are those on screen. ST_NOT_FOUND: nothing was measured under that pixel. Cost: the tiles
 * under the pixel are drawn once into one pixel. */
ST_MUST_CHECK enum st view_measure_pick(const struct render_item *items, size_t item_count,
                                        const struct raster_view *view, double x_px, double y_px,
                                        struct view_point *out_point, struct errctx *err);

/* A value with its standard deviation, which is NaN if one of the points' is. */
struct view_value {
    double value, sigma;
};
/* Half the width of the 95 % interval. */
double view_measure_half95(struct view_value value);

struct view_value view_measure_distance_m(const struct view_point *a, const struct view_point *b);
struct view_value view_measure_height_m(const struct view_point *a, const struct view_point *b);
/* At b, between a and c. NaN if two of them are one. */
struct view_value view_measure_angle_rad(const struct view_point *a, const struct view_point *b,
                                         const struct view_point *c);

#ifdef __cplusplus
}
#endif
#endif
