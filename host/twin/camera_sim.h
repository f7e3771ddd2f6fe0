/* The simulated camera: a picture of the scene through the true lens, on a sensor with noise. */
#ifndef SC_TWIN_CAMERA_SIM_H
#define SC_TWIN_CAMERA_SIM_H

#include "base/camera.h"
#include "base/image.h"
#include "base/pose.h"
#include "twin/scene.h"
#include "twin/twin_config.h"

struct camera_sim {
    struct camera camera; /* true, with distortion */
    struct pose world_from_cam;
    int rays;          /* per pixel for shape and pattern; a quarter of them gather light */
    double exposure;   /* relative to the scene's suggestion */
    double light;      /* factor on all light (a fault) */
    double vignetting; /* part of the light lost in the corners */
    double noise;      /* read noise, part of white */
    double full_well;  /* electrons at white; 0: no noise at all */
    uint64_t seed;     /* same seed, same pixels, for any number of threads */
};

/* Neutral settings for a camera at a pose: no vignetting, no noise, 8 rays. */
struct camera_sim camera_sim_at(const struct camera *camera, const struct pose *world_from_cam);

/* The cart's true camera at world_from_station with the head at those true angles: its lens, rays,
 * vignetting and noise as the parameters say. */
struct camera_sim camera_sim_on_cart(const struct twin_config *config,
                                     const struct pose *world_from_station, double pan_rad,
                                     double tilt_rad, uint64_t seed);

/* Renders into a new RGB image, sRGB. ST_INVALID for a camera that camera_check() refuses,
 * ST_NOMEM. Pixels whose ray is outside the lens model's domain are black. Runs on all threads;
 * about 10 us a pixel and core at 4 rays. */
ST_MUST_CHECK enum st camera_sim_render(const struct scene *scene, const struct camera_sim *sim,
                                        struct image_u8 *out_image, struct errctx *err);

#endif
