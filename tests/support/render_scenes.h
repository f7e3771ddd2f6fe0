/* Scenes for tests of the renderers: rooms photographed from several places. */
#ifndef SC_TESTS_SUPPORT_RENDER_SCENES_H
#define SC_TESTS_SUPPORT_RENDER_SCENES_H

#include "raster/raster.h"
#include "render/render.h"

enum { RENDER_SCENES_PHOTOS_MAX = 8 };

struct render_scene {
    const char *name;
    struct vec3 offset_m;
    int photo_count;
    struct photo photos[RENDER_SCENES_PHOTOS_MAX];
    struct raster_input inputs[RENDER_SCENES_PHOTOS_MAX];
    size_t tile_count;
};

/* 0: four photographs from one stand, exact; 1: four from two stands, with noise and unknown
 * volumes bounded; 2: two stands of different density, 1e7 m from the origin. Aborts without
 * memory. */
enum { RENDER_SCENES = 3 };
void render_scene_make(int which, struct render_scene *out_scene);
void render_scene_fini(struct render_scene *scene);

/* A view number k of the scene, walkable: eyes between 1 and 2 m above the floor. */
struct raster_view render_scene_view(const struct render_scene *scene, int k, int32_t width_px,
                                     int32_t height_px, double hfov_rad);

/* Share of pixels whose colours differ by more than 2 of 255 in any channel or whose alpha does. */
double render_scene_difference(const uint8_t *a_rgba, const uint8_t *b_rgba, size_t pixels);

#endif
