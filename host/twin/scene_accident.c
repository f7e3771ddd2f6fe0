/* Being written: the real accident scene replaces this within the hour. */
#include "twin/scene_build.h"

void scene_accident(struct scene *scene, double detail) {
    scene_room(scene, detail);
}
