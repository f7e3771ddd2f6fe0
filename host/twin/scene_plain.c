/* The metrology room and the degenerate scenes: little to look at, everything known. */
#include "twin/scene_build.h"

#include <stdio.h>

static const double pi = 3.14159265358979323846;

static uint16_t matt(struct scene *scene, const char *name, enum material_texture texture, float r,
                     float g, float b, float ir) {
    struct material m = {.kind = MATERIAL_MATT,
                         .texture = texture,
                         .rgb = {r, g, b},
                         .rgb2 = {0.35f, 0.33f, 0.3f},
                         .albedo_ir = ir,
                         .f0 = 0.03f,
                         .roughness = 0.7f,
                         .bump = 0.4f,
                         .scale_m = 1,
                         .seed = (uint32_t)scene->seed + (uint32_t)scene->material_count * 977u};
    (void)snprintf(m.name, sizeof m.name, "%s", name);
    return scene_add_material(scene, m);
}

/* The inside of a box: walls, floor and ceiling facing inwards. */
static void shell(struct scene *scene, struct vec3 min, struct vec3 max, uint16_t wall,
                  uint16_t floor, uint16_t ceiling) {
    struct pose id = pose_identity();
    struct shaper s = scene_shaper(scene, floor, id);
    double x0 = min.x, y0 = min.y, z0 = min.z, x1 = max.x, y1 = max.y, z1 = max.z;
    shape_quad(&s, vec3_make(x0, y0, z0), vec3_make(x1, y0, z0), vec3_make(x1, y1, z0),
               vec3_make(x0, y1, z0));
    s = scene_shaper(scene, ceiling, id);
    shape_quad(&s, vec3_make(x0, y0, z1), vec3_make(x0, y1, z1), vec3_make(x1, y1, z1),
               vec3_make(x1, y0, z1));
    s = scene_shaper(scene, wall, id);
    shape_quad(&s, vec3_make(x0, y0, z0), vec3_make(x0, y1, z0), vec3_make(x0, y1, z1),
               vec3_make(x0, y0, z1));
    shape_quad(&s, vec3_make(x1, y1, z0), vec3_make(x1, y0, z0), vec3_make(x1, y0, z1),
               vec3_make(x1, y1, z1));
    s = scene_shaper(scene, wall, id);
    shape_quad(&s, vec3_make(x1, y0, z0), vec3_make(x0, y0, z0), vec3_make(x0, y0, z1),
               vec3_make(x1, y0, z1));
    shape_quad(&s, vec3_make(x0, y1, z0), vec3_make(x1, y1, z0), vec3_make(x1, y1, z1),
               vec3_make(x0, y1, z1));
}

static void lamp(struct scene *scene, double x, double y, double z, double power) {
    struct scene_light light = {.position_m = {x, y, z},
                                .dir = {0, 0, -1},
                                .radius_m = 0.15,
                                .cos_inner = -1,
                                .cos_outer = -1,
                                .rgb = {power, power * 0.95, power * 0.86}};
    scene_add_light(scene, light);
}

/* A checkerboard of 8 x 6 squares with a white border, standing in the frame's xy plane. */
static void board(struct scene *scene, uint16_t checks, uint16_t border, struct pose frame,
                  double square_m) {
    double w = 8 * square_m, h = 6 * square_m, e = square_m * 0.75;
    struct shaper s = scene_shaper(scene, border, frame);
    shape_box(&s, vec3_make(-e, -e, -0.012), vec3_make(w + e, h + e, -0.0005), 0);
    s = scene_shaper(scene, checks, frame);
    shape_quad(&s, vec3_make(0, 0, 0), vec3_make(w, 0, 0), vec3_make(w, h, 0), vec3_make(0, h, 0));
}

/* A frame whose z is `normal` (horizontal), x to the right seen from that side, y up. */
static struct pose upright(struct vec3 at, double normal_yaw_rad) {
    struct vec3 z = vec3_make(cos(normal_yaw_rad), sin(normal_yaw_rad), 0), y = vec3_make(0, 0, 1);
    struct vec3 x = vec3_cross(y, z);
    struct pose frame = {{{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}}, at};
    return frame;
}

static void tripod(struct scene *scene, uint16_t metal, double x, double y, double top_z) {
    struct pose id = pose_identity();
    struct shaper s = scene_shaper(scene, metal, id);
    shape_bar(&s, vec3_make(x, y, top_z - 0.35), vec3_make(x, y, top_z), 0.012, 12);
    for (int i = 0; i < 3; i++) {
        double a = 2 * pi * i / 3 + 0.4;
        shape_bar(&s, vec3_make(x, y, top_z - 0.3),
                  vec3_make(x + 0.38 * cos(a), y + 0.38 * sin(a), 0.01), 0.01, 10);
    }
}

static void room_targets(struct scene *scene) {
    uint16_t ball = matt(scene, "target sphere", TEXTURE_PLAIN, 0.85f, 0.85f, 0.83f, 0.85f);
    uint16_t metal = matt(scene, "tripod", TEXTURE_PLAIN, 0.08f, 0.08f, 0.09f, 0.1f);
    static const double at[6][4] = {/* x, y, z, radius */
                                    {2.2, 1.6, 1.1, 0.0725}, {-2.1, 1.5, 1.5, 0.0725},
                                    {-2.3, -1.2, 0.8, 0.1},  {1.9, -1.7, 1.6, 0.1},
                                    {0.4, 2.0, 1.0, 0.15},   {0.2, -1.9, 1.3, 0.0725}};
    for (int i = 0; i < 6; i++) {
        struct trace_sphere sphere = {.centre_m = {at[i][0], at[i][1], at[i][2]},
                                      .radius_m = at[i][3],
                                      .part = scene_add_part(scene, ball, pose_identity())};
        scene_add_sphere(scene, sphere);
        tripod(scene, metal, at[i][0], at[i][1], at[i][2] - at[i][3]);
    }
    uint16_t black = matt(scene, "checks", TEXTURE_CHECKER, 0.03f, 0.03f, 0.03f, 0.04f);
    scene->material[black].scale_m = 0.08f;
    for (int i = 0; i < 3; i++) {
        scene->material[black].rgb2[i] = 0.85f;
        scene->material[black].rgb[i] = 0.03f;
    }
    uint16_t white = matt(scene, "board", TEXTURE_PLAIN, 0.85f, 0.85f, 0.85f, 0.8f);
    board(scene, black, white, upright(vec3_make(2.985, -0.5, 1.0), pi), 0.08);
    board(scene, black, white, upright(vec3_make(-0.6, 2.485, 1.2), -pi / 2), 0.08);
    board(scene, black, white, upright(vec3_make(-2.985, 0.4, 0.9), 0), 0.08);
    board(scene, black, white, upright(vec3_make(0.9, -2.485, 1.1), pi / 2), 0.08);
    /* plates from black to white, and a chrome and a glass one */
    for (int i = 0; i < 6; i++) {
        float a = 0.04f + 0.16f * (float)i;
        char name[24];
        (void)snprintf(name, sizeof name, "plate %d", i);
        struct shaper s = scene_shaper(scene, matt(scene, name, TEXTURE_PLAIN, a, a, a, a),
                                       upright(vec3_make(2.9, 1.3 - 0.3 * i, 2.1), pi));
        shape_box(&s, vec3_make(-0.12, -0.12, -0.01), vec3_make(0.12, 0.12, 0), 0);
    }
}

static void room_furniture(struct scene *scene) {
    uint16_t wood = matt(scene, "wood", TEXTURE_WOOD, 0.45f, 0.28f, 0.14f, 0.5f);
    scene->material[wood].rgb2[0] = 0.32f;
    scene->material[wood].rgb2[1] = 0.18f;
    scene->material[wood].rgb2[2] = 0.08f;
    scene->material[wood].scale_m = 0.25f;
    struct shaper s = scene_shaper(scene, wood, shaper_frame(vec3_make(-1.5, -1.7, 0), 0.5, 0, 0));
    shape_box(&s, vec3_make(-0.6, -0.35, 0.70), vec3_make(0.6, 0.35, 0.74), 0.005);
    for (int i = 0; i < 4; i++) {
        double x = i & 1 ? 0.52 : -0.58, y = i & 2 ? 0.27 : -0.33;
        shape_box(&s, vec3_make(x, y, 0), vec3_make(x + 0.06, y + 0.06, 0.70), 0.004);
    }
    uint16_t metal = matt(scene, "step gauge", TEXTURE_PLAIN, 0.6f, 0.6f, 0.62f, 0.55f);
    s = scene_shaper(scene, metal, shaper_frame(vec3_make(1.2, -2.2, 0), 0, 0, 0));
    for (int i = 0; i < 8; i++) /* steps of exactly 10, 20, ... mm in depth */
        shape_box(&s, vec3_make(0.12 * i, -0.3, 0.6),
                  vec3_make(0.12 * (i + 1), 0.005 * i * (i + 1), 0.9), 0);
}

void scene_room(struct scene *scene, double detail) {
    (void)detail; /* metrology does not change with it */
    uint16_t wall = matt(scene, "plaster", TEXTURE_PLASTER, 0.72f, 0.7f, 0.66f, 0.7f);
    uint16_t floor = matt(scene, "concrete", TEXTURE_CONCRETE, 0.34f, 0.33f, 0.32f, 0.4f);
    uint16_t ceiling = matt(scene, "ceiling", TEXTURE_PLASTER, 0.8f, 0.8f, 0.79f, 0.75f);
    for (int i = 0; i < 3; i++)
        scene->material[wall].rgb2[i] = 0.5f;
    shell(scene, vec3_make(-3, -2.5, 0), vec3_make(3, 2.5, 2.8), wall, floor, ceiling);
    room_targets(scene);
    room_furniture(scene);
    for (int i = 0; i < 4; i++)
        lamp(scene, i & 1 ? 1.5 : -1.5, i & 2 ? 1.2 : -1.2, 2.6, 1.6);
    for (int i = 0; i < 3; i++)
        scene->sky.ground[i] = scene->sky.horizon[i] = scene->sky.zenith[i] = 0.25;
    scene->exposure = 1.0;
    scene->ambient = 0.02;
    scene_add_stand(scene, "middle", 0, 0, 0);
    scene_add_stand(scene, "corner", 1.4, 0.9, 2.6);
    scene_add_stand(scene, "door", -1.2, 0.3, 0.4);
}

void scene_corridor(struct scene *scene, double detail) {
    (void)detail;
    uint16_t wall = matt(scene, "plaster", TEXTURE_PLASTER, 0.7f, 0.7f, 0.66f, 0.65f);
    uint16_t floor = matt(scene, "concrete", TEXTURE_CONCRETE, 0.32f, 0.32f, 0.32f, 0.35f);
    shell(scene, vec3_make(-20, -1.1, 0), vec3_make(20, 1.1, 2.5), wall, floor, wall);
    for (int i = -4; i <= 4; i++)
        lamp(scene, 4.5 * i, 0, 2.35, 0.8);
    for (int i = 0; i < 3; i++)
        scene->sky.ground[i] = scene->sky.horizon[i] = scene->sky.zenith[i] = 0.2;
    scene->exposure = 1.0;
    scene->ambient = 0.02;
    scene_add_stand(scene, "west", -4, 0, 0);
    scene_add_stand(scene, "middle", 0, 0.1, 0);
    scene_add_stand(scene, "east", 4, -0.1, 0);
}

void scene_open_field(struct scene *scene, double detail) {
    (void)detail;
    uint16_t grass = matt(scene, "grass", TEXTURE_GRASS, 0.1f, 0.16f, 0.04f, 0.45f);
    scene->material[grass].rgb2[0] = 0.22f;
    scene->material[grass].rgb2[1] = 0.2f;
    scene->material[grass].rgb2[2] = 0.08f;
    struct shaper s = scene_shaper(scene, grass, pose_identity());
    double r = 400;
    shape_quad(&s, vec3_make(-r, -r, 0), vec3_make(r, -r, 0), vec3_make(r, r, 0),
               vec3_make(-r, r, 0));
    struct scene_sky sky = {.zenith = {0.16, 0.32, 0.75},
                            .horizon = {0.65, 0.75, 0.85},
                            .ground = {0.1, 0.12, 0.06},
                            .sun_dir = vec3_unit(vec3_make(0.5, 0.4, 0.6)),
                            .sun_rgb = {3.0, 2.8, 2.4},
                            .sun_angle_rad = 0.0047};
    scene->sky = sky;
    scene->exposure = 1.2;
    scene->ambient = 0.6;
    scene->max_range_m = 15;
    scene_add_stand(scene, "a", 0, 0, 0);
    scene_add_stand(scene, "b", 5, 3, 1.0);
}

void scene_sphere(struct scene *scene, double detail) {
    (void)detail;
    uint16_t wall = matt(scene, "dome", TEXTURE_PLASTER, 0.75f, 0.74f, 0.7f, 0.7f);
    struct trace_sphere sphere = {.centre_m = {0, 0, 1.6},
                                  .radius_m = 5,
                                  .part = scene_add_part(scene, wall, pose_identity()),
                                  .hollow = true};
    scene_add_sphere(scene, sphere);
    lamp(scene, 0.5, 0.2, 4.5, 4);
    for (int i = 0; i < 3; i++)
        scene->sky.ground[i] = scene->sky.horizon[i] = scene->sky.zenith[i] = 0.3;
    scene->exposure = 1.0;
    scene_add_stand(scene, "middle", 0, 0, 0);
    scene_add_stand(scene, "aside", 1.3, 0.4, 0.7);
}
