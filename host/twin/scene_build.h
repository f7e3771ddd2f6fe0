/* Private to the scene builders: one function a procedural scene, and helpers that they share. */
#ifndef SC_TWIN_SCENE_BUILD_H
#define SC_TWIN_SCENE_BUILD_H

#include "base/rng.h"
#include "twin/scene.h"
#include "twin/sdf.h"
#include "twin/shapes.h"

void scene_accident(struct scene *scene, double detail);
void scene_heritage(struct scene *scene, double detail);
void scene_room(struct scene *scene, double detail);
void scene_corridor(struct scene *scene, double detail);
void scene_open_field(struct scene *scene, double detail);
void scene_sphere(struct scene *scene, double detail);

/* An empty scene on the heap, without name. */
ST_MUST_CHECK enum st scene_allocate(struct scene **out_scene, struct errctx *err);

/* A shaper for a new part of that material in the frame. */
static inline struct shaper scene_shaper(struct scene *scene, uint16_t material,
                                         struct pose world_from_local) {
    struct shaper s = {&scene->mesh, world_from_local,
                       scene_add_part(scene, material, world_from_local)};
    return s;
}

/* A count scaled by detail, at least `least`. */
static inline int scene_scaled(int count, double detail, int least) {
    int n = (int)(count * detail + 0.5);
    return n < least ? least : n;
}

#endif
