#include "twin/scene_build.h"

static const struct scene_kind kinds[] = {
    {"accident", "a road at night: two damaged cars, debris, signs, trees, a dummy, flood lights",
     scene_accident},
    {"heritage", "a vaulted hall: columns, niches with statues, balustrade, glass case, iron gate",
     scene_heritage},
    {"room", "metrology: spheres and planes of known size and place, checkerboards", scene_room},
    {"corridor", "40 m of bare walls: nothing fixes the position along it", scene_corridor},
    {"open_field", "flat grass to the horizon: mostly no return", scene_open_field},
    {"sphere", "the inside of a sphere of 5 m: nothing fixes the rotation", scene_sphere},
};

const struct scene_kind *scene_kinds(size_t *out_count) {
    *out_count = sizeof kinds / sizeof kinds[0];
    return kinds;
}
