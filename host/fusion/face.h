/* Where no camera is: six pinhole photographs, the faces of a cube around the station, coloured by
 * the samples themselves. And how fine a picture the samples of a station can carry. */
#ifndef SC_FUSION_FACE_H
#define SC_FUSION_FACE_H

#include "base/camera.h"
#include "base/pose.h"
#include "fusion/scatter.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { FACE_COUNT = 6 };

/* Face names for people: "front", "left", "back", "right", "up", "down"; "?" for others. */
const char *face_name(int face);

/* A pinhole of 90 degrees plus one pixel each way, so that the meshes of neighbours overlap by a
 * cell and no seam opens. size_px >= 4. */
struct camera face_camera(int32_t size_px);

/* Faces look along station +x, +y, -x, -y (up in the picture = +z), +z (up = -x), -z (up = +x). */
struct pose face_station_from_cam(int face);

/* What the directions of a stream say about a picture: */
struct face_survey {
    int64_t sample_count, return_count;
    int64_t seen[FACE_COUNT]; /* returns a face sees */
    double spacing_rad;       /* typical distance of neighbouring samples, the larger way */
    float range_min_m, range_max_m;
    float intensity_high; /* 99th percentile, for the grey scale; 0: no intensities */
    int has_colour;
    /* Where the samples look, if they all look the same way: the cone around `axis` that holds
     * them. Half angle above 50 degrees: NaN, they look around. */
    struct vec3 axis;
    double half_angle_rad;
};

/* One or two passes over the stream, 50 MiB of scratch. spacing_rad: the size of the cells of a
 * cube map that hold about one sample each, between 0.18 and 100 mrad. An empty stream gives zeroes
 * and 0.2 rad. */
ST_MUST_CHECK enum st face_survey_source(const struct scatter_source *source,
                                         struct face_survey *out_survey, struct errctx *err);

/* Size of a face in px so that a pixel in its middle is `spacing_rad` wide: whole tiles of 32 px,
 * within 32..max_px. */
int32_t face_size_px(double spacing_rad, int32_t max_px);

/* One photograph for samples that look one way: a pinhole along the survey's axis (up = station z,
 * or x where that is the axis) that holds the cone, pixels `spacing_rad` wide, at most max_px each
 * way. */
void face_narrow(const struct face_survey *survey, double spacing_rad, int32_t max_px,
                 struct camera *out_camera, struct pose *out_station_from_cam);

#ifdef __cplusplus
}
#endif
#endif
