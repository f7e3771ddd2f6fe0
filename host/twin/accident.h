/* Private to the `accident` scene. World: x along the road, y to the buildings, road surface at z =
 * 0. */
#ifndef SC_TWIN_ACCIDENT_H
#define SC_TWIN_ACCIDENT_H

#include "twin/scene_build.h"

#include <math.h>

static const double accident_pi = 3.14159265358979323846;

/* Materials by number in the scene. */
struct accident {
    struct scene *scene;
    double detail;
    uint16_t asphalt, mark, skid, kerb, pavement, grass, brick, concrete, wood, panes, stone;
    uint16_t red_paint, silver_paint, plastic, tyre, rim, chrome, car_glass, lens, tail, plate,
        seat;
    uint16_t bark, leaf, steel, cone, tent, dummy, lamp, sign_limit, sign_warn, sign_stop, oil;
};

static inline struct shaper accident_part(const struct accident *a, uint16_t material,
                                          struct vec3 at_m, double yaw_rad) {
    return scene_shaper(a->scene, material, shaper_frame(at_m, yaw_rad, 0, 0));
}

/* How a car was hit; local frame of the car: x forward, y left, z up, wheels on z = 0. */
struct car_damage {
    float front_m;       /* how far the front's left corner is pushed in; 0: whole */
    float side_m;        /* depth of the dent in the left side; 0: whole */
    float side_x_m;      /* where along the car */
    int lost_left_glass; /* the left side's panes lie on the road */
    int lost_left_mirror;
    uint32_t seed;
};

/* A saloon car, 4.2 m long, with interior, wheels, lamps, mirrors, panes. `steer_rad` turns the
 * front wheels. */
void accident_car(const struct accident *a, const struct car_damage *damage, uint16_t paint,
                  struct pose world_from_car, double steer_rad);

/* Trees, signs, lamp post, flood lights, cones, dummy, evidence tents, debris. */
void accident_furnish(const struct accident *a);

#endif
