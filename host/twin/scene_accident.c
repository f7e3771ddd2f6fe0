/* `accident`: a road at night. A red car has run into the left side of a silver one; debris, a
 * dummy, cones and evidence markers lie about; trees on one side, houses on the other; the crew's
 * flood lights and a street lamp. */
#include "twin/accident.h"
#include "twin/noise3.h"

#include <stdio.h>

/* What differs from a matt, rough, patterned surface; 0 takes the default. */
struct look {
    const char *name;
    enum material_kind kind;
    enum material_texture texture;
    float rgb[3], rgb2[3];
    float albedo_ir, f0, roughness, scale_m;
};

static uint16_t add_look(const struct accident *a, struct look k) {
    struct material m = {.kind = k.kind,
                         .texture = k.texture,
                         .albedo_ir = k.albedo_ir,
                         .f0 = k.f0 > 0 ? k.f0 : 0.03f,
                         .roughness = k.roughness > 0 ? k.roughness : 0.7f,
                         .bump = 0.5f,
                         .scale_m = k.scale_m > 0 ? k.scale_m : 1,
                         .seed =
                             (uint32_t)a->scene->seed + 31u * (uint32_t)a->scene->material_count};
    for (int i = 0; i < 3; i++) {
        m.rgb[i] = k.rgb[i];
        m.rgb2[i] = k.rgb2[i];
    }
    (void)snprintf(m.name, sizeof m.name, "%s", k.name);
    if (k.kind == MATERIAL_RETRO)
        m.retro = k.texture == TEXTURE_PLAIN ? 12 : 40;
    if (k.kind == MATERIAL_GLASS)
        m.transmission_ir = 0.78f;
    if (k.kind == MATERIAL_EMITTER)
        for (int i = 0; i < 3; i++)
            m.emission[i] = 20 * k.rgb[i];
    return scene_add_material(a->scene, m);
}

/* Shorthands for the tables below: name, texture, colour, second colour, infrared albedo, ... */
#define MATT(name, texture, r, g, b, r2, g2, b2, ir, f0, rough, scale)                             \
    add_look(a, (struct look){                                                                     \
                    name, MATERIAL_MATT, texture, {r, g, b}, {r2, g2, b2}, ir, f0, rough, scale})
#define COATED(name, texture, r, g, b, r2, g2, b2, ir, f0, rough, scale)                           \
    add_look(a,                                                                                    \
             (struct look){                                                                        \
                 name, MATERIAL_COATED, texture, {r, g, b}, {r2, g2, b2}, ir, f0, rough, scale})
#define RETRO(name, texture, r, g, b, scale)                                                       \
    add_look(a, (struct look){name,                                                                \
                              MATERIAL_RETRO,                                                      \
                              texture,                                                             \
                              {r, g, b},                                                           \
                              {r * 0.6f, g * 0.6f, b * 0.6f},                                      \
                              0.6f,                                                                \
                              0.04f,                                                               \
                              0.3f,                                                                \
                              scale})

static void add_ground_looks(struct accident *a) {
    a->asphalt = MATT("asphalt", TEXTURE_ASPHALT, 0.075f, 0.075f, 0.08f, 0.04f, 0.04f, 0.04f, 0.14f,
                      0.04f, 0.5f, 1);
    a->mark = MATT("road marking", TEXTURE_ROAD_MARK, 0.62f, 0.62f, 0.58f, 0.09f, 0.09f, 0.09f,
                   0.6f, 0.04f, 0.6f, 1);
    a->skid = MATT("tyre mark", TEXTURE_ASPHALT, 0.02f, 0.02f, 0.021f, 0.02f, 0.02f, 0.02f, 0.05f,
                   0.04f, 0.5f, 1);
    a->kerb =
        MATT("kerb", TEXTURE_CONCRETE, 0.36f, 0.35f, 0.33f, 0.22f, 0.21f, 0.2f, 0.4f, 0, 0, 0.5f);
    a->pavement =
        MATT("paving", TEXTURE_ASHLAR, 0.3f, 0.29f, 0.28f, 0.16f, 0.15f, 0.14f, 0.36f, 0, 0, 0.4f);
    a->grass =
        MATT("grass", TEXTURE_GRASS, 0.07f, 0.13f, 0.03f, 0.16f, 0.14f, 0.06f, 0.5f, 0, 0.9f, 1);
    a->oil = COATED("oil", TEXTURE_PLAIN, 0.008f, 0.007f, 0.006f, 0, 0, 0, 0.02f, 0.05f, 0.03f, 1);
}

static void add_house_looks(struct accident *a) {
    a->brick =
        MATT("brick", TEXTURE_BRICK, 0.36f, 0.15f, 0.09f, 0.4f, 0.37f, 0.33f, 0.4f, 0, 0, 0.24f);
    a->stone =
        MATT("dressing", TEXTURE_STONE, 0.5f, 0.46f, 0.4f, 0.3f, 0.28f, 0.25f, 0.5f, 0, 0, 0.3f);
    a->wood = COATED("painted wood", TEXTURE_PAINT, 0.06f, 0.14f, 0.12f, 0.2f, 0.18f, 0.15f, 0.3f,
                     0.04f, 0.3f, 0.2f);
    a->panes = COATED("windows", TEXTURE_WINDOWS, 0.012f, 0.014f, 0.018f, 0.55f, 0.36f, 0.17f,
                      0.05f, 0.05f, 0.02f, 1.2f);
    a->concrete =
        MATT("concrete", TEXTURE_CONCRETE, 0.33f, 0.32f, 0.3f, 0.2f, 0.2f, 0.19f, 0.4f, 0, 0, 1);
}

static void add_car_looks(struct accident *a) {
    a->red_paint = COATED("red paint", TEXTURE_PAINT, 0.30f, 0.016f, 0.014f, 0.16f, 0.14f, 0.11f,
                          0.34f, 0.05f, 0.06f, 1);
    a->silver_paint = COATED("silver paint", TEXTURE_PAINT, 0.28f, 0.30f, 0.32f, 0.16f, 0.14f,
                             0.11f, 0.42f, 0.06f, 0.08f, 1);
    a->plastic = MATT("black plastic", TEXTURE_CLOTH, 0.025f, 0.025f, 0.027f, 0.05f, 0.05f, 0.05f,
                      0.06f, 0.04f, 0.4f, 1);
    a->tyre = MATT("rubber", TEXTURE_TYRE, 0.022f, 0.022f, 0.023f, 0.12f, 0.11f, 0.09f, 0.05f,
                   0.03f, 0.6f, 0.31f);
    a->rim = add_look(a, (struct look){"alloy",
                                       MATERIAL_METAL,
                                       TEXTURE_BRUSHED,
                                       {0.62f, 0.62f, 0.64f},
                                       {0.3f, 0.3f, 0.3f},
                                       0.5f,
                                       0.6f,
                                       0.3f,
                                       1});
    a->chrome = add_look(a, (struct look){"chrome",
                                          MATERIAL_METAL,
                                          TEXTURE_PLAIN,
                                          {0.8f, 0.8f, 0.82f},
                                          {0.5f, 0.5f, 0.5f},
                                          0.03f,
                                          0.8f,
                                          0.04f,
                                          1});
    a->car_glass = add_look(a, (struct look){"car glass",
                                             MATERIAL_GLASS,
                                             TEXTURE_PLAIN,
                                             {0.75f, 0.82f, 0.78f},
                                             {0.5f, 0.5f, 0.5f},
                                             0.03f,
                                             0.06f,
                                             0.01f,
                                             1});
    a->lens = COATED("lamp lens", TEXTURE_PLAIN, 0.6f, 0.64f, 0.66f, 0.5f, 0.5f, 0.5f, 0.35f, 0.06f,
                     0.04f, 1);
    a->tail = RETRO("tail lamp", TEXTURE_PLAIN, 0.5f, 0.012f, 0.01f, 1);
    a->plate = RETRO("number plate", TEXTURE_PLATE, 0.8f, 0.8f, 0.76f, 1);
    a->seat =
        MATT("seat cloth", TEXTURE_CLOTH, 0.10f, 0.10f, 0.12f, 0.1f, 0.1f, 0.1f, 0.3f, 0, 0.9f, 1);
}

static void add_street_looks(struct accident *a) {
    a->bark =
        MATT("bark", TEXTURE_BARK, 0.14f, 0.10f, 0.07f, 0.10f, 0.13f, 0.06f, 0.35f, 0, 0.9f, 1);
    a->leaf = MATT("leaves", TEXTURE_LEAF, 0.09f, 0.17f, 0.03f, 0.22f, 0.19f, 0.04f, 0.55f, 0.04f,
                   0.5f, 1);
    a->steel = MATT("galvanised steel", TEXTURE_CONCRETE, 0.3f, 0.31f, 0.32f, 0.22f, 0.22f, 0.22f,
                    0.4f, 0.2f, 0.4f, 0.2f);
    a->cone = MATT("traffic cone", TEXTURE_STRIPES, 0.75f, 0.12f, 0.01f, 0.75f, 0.75f, 0.72f, 0.6f,
                   0.04f, 0.4f, 0.17f);
    a->tent = MATT("evidence marker", TEXTURE_PLAIN, 0.8f, 0.62f, 0.02f, 0.02f, 0.02f, 0.02f, 0.6f,
                   0.04f, 0.4f, 1);
    a->dummy =
        MATT("dummy", TEXTURE_DUMMY, 0.55f, 0.42f, 0.28f, 0.1f, 0.1f, 0.1f, 0.5f, 0.04f, 0.5f, 1);
    a->lamp = add_look(a, (struct look){"lamp",
                                        MATERIAL_EMITTER,
                                        TEXTURE_PLAIN,
                                        {1, 0.95f, 0.85f},
                                        {1, 1, 1},
                                        0.2f,
                                        0.04f,
                                        0.5f,
                                        1});
    a->sign_limit = RETRO("limit sign", TEXTURE_SIGN_LIMIT, 0.6f, 0.02f, 0.02f, 0.3f);
    a->sign_warn = RETRO("warning sign", TEXTURE_SIGN_WARN, 0.6f, 0.02f, 0.02f, 0.3f);
    a->sign_stop = RETRO("stop sign", TEXTURE_SIGN_STOP, 0.55f, 0.02f, 0.02f, 0.3f);
}

/* ---- ground ---- */

static struct vec3 verge_at(const void *ctx, double u, double v) {
    const uint32_t *seed = ctx;
    double x = -16 + 32 * u, y = -14 + 10.2 * v;
    float far = noise3_smooth(-3.9f, -5.5f, (float)y);
    float bumps = noise3_fbm((float)x * 0.6f, (float)y * 0.6f, 0, 4, *seed);
    return vec3_make(x, y, 0.11 + (double)(far * (0.16f * bumps + 0.05f)));
}

static void add_blades(const struct accident *a, const uint32_t *seed) {
    struct rng rng = rng_stream(a->scene->seed, 50);
    struct shaper s = accident_part(a, a->grass, vec3_make(0, 0, 0), 0);
    for (int i = 0, n = scene_scaled(14000, a->detail, 1500); i < n; i++) {
        double y = -3.86 - 3.2 * pow(rng_uniform(&rng), 1.6), x = rng_range(&rng, -10, 10);
        double t = rng_range(&rng, 0, 2 * accident_pi), h = rng_range(&rng, 0.04, 0.15);
        struct vec3 p = verge_at(seed, (x + 16) / 32, (y + 14) / 10.2);
        struct vec3 left = vec3_add(p, vec3_make(0.005 * cos(t), 0.005 * sin(t), -0.01));
        struct vec3 right = vec3_add(p, vec3_make(-0.005 * cos(t), -0.005 * sin(t), -0.01));
        double lean_x = 0.4 * h * rng_normal(&rng), lean_y = 0.4 * h * rng_normal(&rng);
        shape_shard(&s, left, right, vec3_add(p, vec3_make(lean_x, lean_y, h)));
    }
}

static void add_ground(const struct accident *a) {
    struct shaper s = accident_part(a, a->asphalt, vec3_make(0, 0, 0), 0);
    shape_quad(&s, vec3_make(-25, -3.8, 0), vec3_make(25, -3.8, 0), vec3_make(25, 3.8, 0),
               vec3_make(-25, 3.8, 0));
    for (int side = -1; side <= 1; side += 2)
        for (int i = -16; i < 16; i++) { /* kerb stones, laid by hand */
            struct shaper kerb = accident_part(a, a->kerb, vec3_make(i, side * 3.72, 0), 0);
            double lift = 0.004 * ((i * 7 + side) & 3);
            shape_box(&kerb, vec3_make(0.004, -0.09, -0.1), vec3_make(0.994, 0.09, 0.12 + lift),
                      0.018);
        }
    struct shaper paving = accident_part(a, a->pavement, vec3_make(0, 0, 0), 0);
    shape_quad(&paving, vec3_make(-16, 3.8, 0.115), vec3_make(16, 3.8, 0.115),
               vec3_make(16, 6.6, 0.13), vec3_make(-16, 6.6, 0.13));
    uint32_t seed = (uint32_t)a->scene->seed;
    struct shaper verge = accident_part(a, a->grass, vec3_make(0, 0, 0), 0);
    shape_grid(&verge, verge_at, &seed, scene_scaled(400, a->detail, 80),
               scene_scaled(130, a->detail, 30), 0);
    add_blades(a, &seed);
}

static double skid_y(double x, int side) {
    double run = x + 9.5;
    return -1.05 + side * 0.75 + 0.009 * run * run;
}

static void add_markings(const struct accident *a) {
    struct shaper s = accident_part(a, a->mark, vec3_make(0, 0, 0), 0);
    for (int i = -5; i <= 5; i++)
        shape_box(&s, vec3_make(3 * i - 0.75, -0.06, -0.01), vec3_make(3 * i + 0.75, 0.06, 0.003),
                  0);
    for (int side = -1; side <= 1; side += 2)
        shape_box(&s, vec3_make(-16, side * 3.3 - 0.06, -0.01),
                  vec3_make(16, side * 3.3 + 0.06, 0.003), 0);
    for (int i = 0; i < 7; i++)
        shape_box(&s, vec3_make(6.2, -2.95 + 0.9 * i, -0.01), vec3_make(9.2, -2.5 + 0.9 * i, 0.003),
                  0);
    struct shaper skid = accident_part(a, a->skid, vec3_make(0, 0, 0), 0);
    for (int side = -1; side <= 1; side += 2)
        for (int i = 0; i < 40; i++) {
            double x0 = -9.5 + 0.16 * i, x1 = x0 + 0.16, y0 = skid_y(x0, side),
                   y1 = skid_y(x1, side);
            shape_quad(&skid, vec3_make(x0, y0 - 0.09, 0.0012), vec3_make(x1, y1 - 0.09, 0.0012),
                       vec3_make(x1, y1 + 0.09, 0.0012), vec3_make(x0, y0 + 0.09, 0.0012));
        }
}

/* ---- houses ---- */

static void add_window(const struct accident *a, double x, double z0, double z1, double half_m) {
    struct shaper pane = accident_part(a, a->panes, vec3_make(x, 6.78, 0), 0);
    shape_quad(&pane, vec3_make(-half_m, 0, z0), vec3_make(half_m, 0, z0), vec3_make(half_m, 0, z1),
               vec3_make(-half_m, 0, z1));
    struct shaper frame = accident_part(a, a->wood, vec3_make(x, 6.76, 0), 0);
    for (int i = 0; i < 3; i++) {
        double fx = -half_m + i * half_m, fz = z0 + (z1 - z0) * (i == 0 ? 0 : i == 1 ? 0.62 : 1);
        shape_box(&frame, vec3_make(fx - 0.03, -0.04, z0), vec3_make(fx + 0.03, 0.02, z1), 0.006);
        shape_box(&frame, vec3_make(-half_m, -0.035, fz - 0.03), vec3_make(half_m, 0.02, fz + 0.03),
                  0.006);
    }
    struct shaper sill = accident_part(a, a->stone, vec3_make(x, 6.6, 0), 0);
    shape_box(&sill, vec3_make(-half_m - 0.1, -0.09, z0 - 0.12),
              vec3_make(half_m + 0.1, 0.18, z0 - 0.02), 0.01);
    shape_box(&sill, vec3_make(-half_m - 0.12, -0.025, z1 + 0.02),
              vec3_make(half_m + 0.12, 0.18, z1 + 0.24), 0.01);
}

static void add_door(const struct accident *a, double x) {
    struct shaper door = accident_part(a, a->wood, vec3_make(x, 6.72, 0.13), 0);
    shape_box(&door, vec3_make(-0.62, -0.03, 0), vec3_make(0.62, 0.03, 2.4), 0.01);
    for (int i = 0; i < 4; i++) {
        double px = i % 2 ? 0.06 : -0.42, pz = i / 2 ? 1.15 : 0.2;
        shape_box(&door, vec3_make(px, -0.05, pz), vec3_make(px + 0.36, -0.02, pz + 0.75), 0.015);
    }
    struct shaper knob = accident_part(a, a->chrome, vec3_make(x + 0.5, 6.66, 1.2), 0);
    shape_ellipsoid(&knob, vec3_make(0, 0, 0), vec3_make(0.03, 0.03, 0.03), 20);
    struct shaper step = accident_part(a, a->stone, vec3_make(x, 6.5, 0), 0);
    shape_box(&step, vec3_make(-0.7, -0.22, 0), vec3_make(0.7, 0.3, 0.22), 0.015);
}

/* A street front of bays 3 m wide: piers, lintels and parapets of brick around windows and doors.
 */
static void add_houses(const struct accident *a) {
    const double front = 6.6, back = 6.95, half = 0.62;
    static const double level[3][3] = {{0.1, 1.0, 2.5}, {2.9, 3.9, 5.3}, {5.7, 0, 0}};
    struct shaper s = accident_part(a, a->brick, vec3_make(0, 0, 0), 0);
    struct shaper plinth = accident_part(a, a->concrete, vec3_make(0, front, 0), 0);
    for (int bay = -5; bay <= 5; bay++) {
        double x = 3 * bay, x0 = x - 1.5, x1 = x + 1.5;
        int door = bay == -1 || bay == 3;
        for (int f = 0; f < 2; f++) {
            int is_door = f == 0 && door;
            double z0 = level[f][0], sill = is_door ? z0 : level[f][1], top = level[f][2];
            double next = level[f + 1][0];
            shape_box(&s, vec3_make(x0, front, z0), vec3_make(x - half, back, next), 0);
            shape_box(&s, vec3_make(x + half, front, z0), vec3_make(x1, back, next), 0);
            shape_box(&s, vec3_make(x - half, front, top), vec3_make(x + half, back, next), 0);
            if (is_door) {
                add_door(a, x);
            } else {
                shape_box(&s, vec3_make(x - half, front, z0), vec3_make(x + half, back, sill), 0);
                add_window(a, x, sill, top, half);
            }
        }
        if (!door)
            shape_box(&plinth, vec3_make(x0, -0.05, 0.1), vec3_make(x1, 0.05, 0.55), 0.01);
    }
    struct shaper trim = accident_part(a, a->stone, vec3_make(0, front, 0), 0);
    shape_box(&trim, vec3_make(-16.5, -0.08, 2.72), vec3_make(16.5, 0.1, 2.9), 0.02);
    shape_box(&trim, vec3_make(-16.5, -0.16, 5.6), vec3_make(16.5, 0.1, 5.85), 0.03);
    struct shaper pipe = accident_part(a, a->steel, vec3_make(4.5, 6.5, 0), 0);
    shape_bar(&pipe, vec3_make(0, 0, 0.15), vec3_make(0, 0, 5.7), 0.05, 16);
}

void scene_accident(struct scene *scene, double detail) {
    struct accident a = {.scene = scene, .detail = detail};
    add_ground_looks(&a);
    add_house_looks(&a);
    add_car_looks(&a);
    add_street_looks(&a);
    add_ground(&a);
    add_markings(&a);
    add_houses(&a);
    struct car_damage hit_front = {.front_m = 0.38f, .lost_left_mirror = 1, .seed = 11};
    struct car_damage hit_side = {
        .side_m = 0.27f, .side_x_m = -0.25f, .lost_left_glass = 1, .seed = 23};
    accident_car(&a, &hit_front, a.red_paint, shaper_frame(vec3_make(-2.35, -0.35, 0), 0.12, 0, 0),
                 -0.3);
    accident_car(&a, &hit_side, a.silver_paint, shaper_frame(vec3_make(0.62, 0.25, 0), 1.78, 0, 0),
                 0.15);
    accident_furnish(&a);
    struct scene_sky night = {.zenith = {0.004, 0.006, 0.014},
                              .horizon = {0.03, 0.022, 0.018},
                              .ground = {0.006, 0.006, 0.006},
                              .stars = true};
    scene->sky = night;
    scene->max_range_m = 12;
    scene->ambient = 0.02;
    scene->exposure = 0.7;
    scene_add_stand(scene, "south-west", -3.4, -3.3, 0.75);
    scene_add_stand(scene, "east", 4.0, -0.5, 3.0);
    scene_add_stand(scene, "north", -0.6, 3.1, -1.57);
}
