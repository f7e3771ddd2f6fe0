/* A made-up room for tests and benchmarks: a box of 8 x 6 x 3 m with checked, shaded walls, two
 * pillars and three spheres, ray-cast exactly. What is seen, and from where, is known without any
 * code under test. */
#ifndef SC_TESTS_SUPPORT_ROOM_H
#define SC_TESTS_SUPPORT_ROOM_H

#include "base/photo.h"

/* The 3D photograph of the room by a camera at world_from_cam (kept as station_from_cam). World: z
 * up, floor at z = 0, x in -4..4, y in -3..3, shifted by offset_m (what the camera's position is
 * shifted by as well). With noise_m > 0 ranges along the optical axis get Gaussian noise of that
 * size, from the seed, and confidence says so. Frees nothing: use photo_destroy(). Aborts without
 * memory. */
struct photo room_photo(const struct camera *camera, const struct pose *world_from_cam,
                        struct vec3 offset_m, double noise_m, uint64_t seed);

/* A camera at height 1.5 m at (x, y), looking along azimuth_rad (0: +x), in a room shifted by
 * offset_m. */
struct pose room_pose(double x_m, double y_m, double azimuth_rad, struct vec3 offset_m);

#endif
