/* Scenes of boxes, spheres and planes with exact truth, and a scanner that looks at them: for tests
 * and benchmarks of fusion that must not depend on the twin. */
#ifndef SC_TESTS_ANALYTIC_H
#define SC_TESTS_ANALYTIC_H

#include "base/photo.h"
#include "base/pose.h"
#include "base/vec.h"
#include "fusion/scatter.h"

#include <stddef.h>
#include <stdint.h>

enum analytic_kind { ANALYTIC_BOX, ANALYTIC_SPHERE, ANALYTIC_PLANE };

struct analytic_shape {
    enum analytic_kind kind;
    struct vec3 at_m;   /* centre; any point of a plane */
    struct vec3 size_m; /* box: half sizes; sphere: x = radius; plane: unit normal */
    double albedo;
};

enum { ANALYTIC_MAX_SHAPES = 64 };
struct analytic_scene {
    struct analytic_shape shapes[ANALYTIC_MAX_SHAPES];
    int count;
};

/* A furnished room of 8 x 6 x 3 m around the origin (floor at z = -1.2), pillars, boxes, balls, a
 * pole. */
struct analytic_scene analytic_room(void);
/* A street corner under the open sky: ground, blocks, poles, a ball. */
struct analytic_scene analytic_yard(void);

/* Range along a unit direction to the nearest surface, NaN if none; out_albedo may be NULL. */
double analytic_cast(const struct analytic_scene *scene, struct vec3 from_m, struct vec3 dir,
                     double *out_albedo);
/* Distance of a point to the nearest surface. */
double analytic_distance(const struct analytic_scene *scene, struct vec3 p_m);

struct analytic_scan {
    struct vec3 from_m; /* place of the station in the scene */
    double elevation_step_rad, azimuth_step_rad;
    double elevation_min_rad, elevation_max_rad, azimuth_min_rad, azimuth_max_rad;
    double sigma_m, sigma_per_m;
    double spot_rad;  /* diameter of the beam */
    double smear_rad; /* motion along elevation in one sample */
    double max_range_m;
    double jitter;        /* of the directions, in steps: a scanner's grid is no camera's */
    double dropped_share; /* of samples dropped at random */
    uint64_t seed;
};
struct analytic_scan analytic_scan_default(void);
size_t analytic_scan_count(const struct analytic_scan *scan);

/* Scans: vertical lines, one after the other, points relative to from_m. The range of a sample is
 * the mean over the beam weighted with albedo: at an edge it floats. Room for
 * analytic_scan_count(). */
void analytic_scan_run(const struct analytic_scene *scene, const struct analytic_scan *scan,
                       struct scatter_sample *out_samples);

/* True disparity of each pixel (NaN where nothing is) of a photograph whose station stands at
 * from_m. */
void analytic_truth(const struct analytic_scene *scene, struct vec3 from_m,
                    const struct camera *camera, const struct pose *station_from_cam,
                    float *out_disparity_per_m);

#endif
