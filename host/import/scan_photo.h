/* Raw scans as 3D photographs, so that every scan can be looked at at once: pinhole faces drawn
 * from the stand, coloured by what the samples bring or by range. Fusion makes better ones of
 * several scans. */
#ifndef SC_IMPORT_SCAN_PHOTO_H
#define SC_IMPORT_SCAN_PHOTO_H

#include "base/photo.h"
#include "base/sample_grid.h"
#include "base/sample_shade.h"
#include "base/st.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { SCAN_PHOTO_FACES_MAX = 6 };

struct scan_photo_options {
    double range_sigma_m; /* standard deviation of one range, > 0: confidence, and what is one
                             surface */
    enum sample_shade_style style;
    struct mat3 world_from_station; /* turns the light of clay to the world's */
};

struct scan_photo_face {
    char name[8]; /* "front", or "x+" "y+" "x-" "y-" "z+" "z-" of the station frame */
    struct camera camera;
    struct mat3 station_from_cam;
};

/* Chooses the faces: one pinhole if all samples lie within 40 deg of their mean direction, else
 * those faces of a cube (each a pixel wider than 90 deg on every side) that a sample falls on.
 * Pixels are as wide as the closest neighbours are apart in the middle of a face, so that no sample
 * of a line is lost; at most 4096 a side. ST_INVALID for an empty grid. */
ST_MUST_CHECK enum st scan_photo_faces(const struct sample_grid *grid,
                                       struct scan_photo_face out_faces[SCAN_PHOTO_FACES_MAX],
                                       int *out_count, struct errctx *err);

/* Draws one face as a photograph standing at origin_m in the station frame. Disparity, flags and
 * colour as sample_grid_draw() and sample_shade() make them; confidence from sigma(1/Z) =
 * sigma(range) / (Z range). Free with photo_destroy(). */
ST_MUST_CHECK enum st scan_photo_draw(const struct sample_grid *grid, struct vec3 origin_m,
                                      const struct scan_photo_face *face,
                                      const struct scan_photo_options *options,
                                      struct photo *out_photo, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
