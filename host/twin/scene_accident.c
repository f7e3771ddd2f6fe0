#include "twin/car.h"
#include "twin/scene_build.h"

void scene_accident(struct scene *scene, double detail) {
    struct material road = {.name = "asphalt",
                            .kind = MATERIAL_MATT,
                            .texture = TEXTURE_ASPHALT,
                            .rgb = {0.055f, 0.055f, 0.058f},
                            .albedo_ir = 0.1f,
                            .f0 = 0.04f,
                            .roughness = 0.6f,
                            .bump = 0.6f,
                            .scale_m = 1};
    struct shaper s = scene_shaper(scene, scene_add_material(scene, road), pose_identity());
    shape_quad(&s, vec3_make(-30, -30, 0), vec3_make(30, -30, 0), vec3_make(30, 30, 0),
               vec3_make(-30, 30, 0));
    struct car a = {
        .model = CAR_SALOON, .paint = {0.02f, 0.05f, 0.12f}, .paint_ir = 0.2f, .flat_tyre = -1};
    struct car b = {
        .model = CAR_HATCHBACK,
        .paint = {0.45f, 0.02f, 0.015f},
        .paint_ir = 0.5f,
        .flat_tyre = 0,
        .steer_rad = 0.3f,
        .lamps_on = 1,
        .dents = 1,
        .dent = {{{2.0f, 0.5f, 0.65f}, {0.9f, 0.9f, 0.8f}, {-0.35f, -0.12f, 0.02f}, 0.06f}}};
    car_add(scene, &a, shaper_frame(vec3_make(0, 1.2, 0), 0.2, 0, 0), detail);
    car_add(scene, &b, shaper_frame(vec3_make(1, -2.2, 0), 2.6, 0, 0), detail);
    struct scene_light l = {.position_m = {5, -5, 4},
                            .dir = {0, 0, -1},
                            .radius_m = 0.2,
                            .cos_inner = -1,
                            .cos_outer = -1,
                            .rgb = {60, 60, 56}};
    scene_add_light(scene, l);
    l.position_m = vec3_make(-5, 6, 4);
    scene_add_light(scene, l);
    struct scene_sky sky = {.zenith = {0.01, 0.015, 0.035},
                            .horizon = {0.05, 0.06, 0.09},
                            .ground = {0.01, 0.01, 0.01},
                            .stars = true};
    scene->sky = sky;
    scene->exposure = 1;
    scene_add_stand(scene, "a", 4, 4, 0);
}
