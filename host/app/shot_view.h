/* The view of a picture from what a user says about it. */
#ifndef SC_APP_SHOT_VIEW_H
#define SC_APP_SHOT_VIEW_H

#include "base/st.h"
#include "raster/raster.h"
#include "site/site.h"

#include <stddef.h>
#include <stdint.h>

/* As typed; NULL or 0: not given. */
struct shot_view_words {
    const char *photo;        /* name: that photograph's own view, the start of all others */
    const char *offset;       /* "x,y,z" metres in its camera frame: right, down, forward */
    const char *rotate;       /* "yaw,pitch,roll" degrees: to the right, up, clockwise */
    const char *eye, *target; /* "x,y,z" metres in the world */
    const char *up;           /* "x,y,z", default 0,0,1 */
    const char *size;         /* "WIDTHxHEIGHT" or "WIDTH" */
    double fov_deg;           /* horizontal */
    double width_m;           /* a parallel view, so many metres wide */
    double near_m;
};

/* ST_INVALID with one line for anything that cannot be read or that contradicts itself;
 * ST_NOT_FOUND for a photograph that is not there. A size alone scales the photograph's view and
 * keeps its horizontal field; without any size a view from an eye has 1280x720 pixels. */
ST_MUST_CHECK enum st shot_view_make(struct site *site, const struct shot_view_words *words,
                                     struct raster_view *out_view, struct errctx *err);

/* Exactly n numbers separated by commas. */
ST_MUST_CHECK enum st shot_view_numbers(const char *text, size_t n, const char *what,
                                        double *out_values, struct errctx *err);

#endif
