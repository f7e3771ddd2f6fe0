/* Private to the `heritage` scene: its dimensions, materials and the parts it is put together from.
 * x runs along the nave to the east, y to the north. */
#ifndef SC_TWIN_HERITAGE_H
#define SC_TWIN_HERITAGE_H

#include "twin/scene_build.h"

#include <math.h>

enum { BAYS = 4 };
static const double heritage_pi = 3.14159265358979323846;
static const double bay_m = 4.5, nave_half_m = 3.5, aisle_out_m = 6.6, west_m = -9, east_m = 9;
static const double wall_m = 0.7, column_top_m = 4.3, arcade_top_m = 6.9, spring_m = 8.4,
                    rise_m = 3.2;
static const double aisle_spring_m = 4.9, aisle_rise_m = 1.9, choir_step_m = 0.36, choir_x_m = 5.2;

struct heritage {
    struct scene *scene;
    double detail;
    uint16_t ashlar, stone, plaster, marble, floor, iron, wood, glass, bronze, gold, velvet, wax,
        flame;
};

static inline struct shaper part_at(const struct heritage *h, uint16_t material, double x, double y,
                                    double z, double yaw) {
    return scene_shaper(h->scene, material, shaper_frame(vec3_make(x, y, z), yaw, 0, 0));
}

/* A frame whose local xy plane is upright: local x along the wall, y up, thickness along -z. */
static inline struct shaper upright(const struct heritage *h, uint16_t material, double x, double y,
                                    double yaw) {
    return scene_shaper(h->scene, material,
                        shaper_frame(vec3_make(x, y, 0), yaw, 0, heritage_pi / 2));
}

struct figure {
    uint32_t seed;
    float raise; /* of the right hand, 0 at the chest .. 1 above the head */
    float turn;  /* of the head */
    int staff;
};

/* A draped figure, 1.75 m, standing at the local origin and facing +x, in any pose. */
void heritage_statue(const struct heritage *h, const struct figure *f, uint16_t material,
                     struct pose world_from_figure);
/* Balustrade, altar, tomb, glass case, chapel with its iron gate, pews, chandeliers. */
void heritage_furnish(const struct heritage *h);

#endif
