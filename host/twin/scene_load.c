/* A user's mesh as a scene: daylight, plaster, stands around it or, if it is a room, inside. */
#include "twin/scene_build.h"

#include "twin/mesh_load.h"

#include <stdio.h>
#include <string.h>

static const double pi = 3.14159265358979323846;
static const double eye_m = 1.6;

struct box {
    struct vec3 min, max;
};

static struct box bounds(const struct mesh *mesh) {
    struct box b = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (size_t i = 0; i < mesh->vertex_count; i++) {
        struct vec3 p = mesh_position(mesh, (uint32_t)i);
        b.min = vec3_make(fmin(b.min.x, p.x), fmin(b.min.y, p.y), fmin(b.min.z, p.z));
        b.max = vec3_make(fmax(b.max.x, p.x), fmax(b.max.y, p.y), fmax(b.max.z, p.z));
    }
    return b;
}

/* Moves the mesh so that its middle is above the origin and its lowest point on the ground. */
static void centre(struct mesh *mesh, const struct box *b) {
    float shift[3] = {(float)(0.5 * (b->min.x + b->max.x)), (float)(0.5 * (b->min.y + b->max.y)),
                      (float)b->min.z};
    for (size_t i = 0; i < mesh->vertex_count; i++)
        for (size_t k = 0; k < 3; k++)
            mesh->position_m[3 * i + k] -= shift[k];
}

static void daylight(struct scene *scene) {
    struct scene_sky sky = {.zenith = {0.22, 0.36, 0.7},
                            .horizon = {0.7, 0.76, 0.82},
                            .ground = {0.2, 0.19, 0.17},
                            .sun_dir = vec3_unit(vec3_make(0.45, -0.35, 0.7)),
                            .sun_rgb = {2.2, 2.1, 1.9},
                            .sun_angle_rad = 0.03};
    scene->sky = sky;
    scene->exposure = 1.1;
    scene->ambient = 0.1;
    scene->max_range_m = 15;
}

/* Part of the directions from p that meet a surface from its outside. */
static double enclosed(const struct scene *scene, struct vec3 p) {
    int seen = 0;
    for (int i = 0; i < 200; i++) {
        double z = 1 - 2 * (i + 0.5) / 200, r = sqrt(1 - z * z), a = 2.399963229728653 * i;
        struct trace_ray ray = {p, {r * cos(a), r * sin(a), z}, 0, INFINITY};
        struct trace_hit hit;
        seen += trace_first(scene->trace, &ray, &hit);
    }
    return seen / 200.0;
}

static void choose_stands(struct scene *scene, const struct box *b) {
    struct vec3 size = vec3_sub(b->max, b->min);
    int inside = enclosed(scene, vec3_make(0, 0, eye_m)) > 0.6 && size.z > eye_m + 0.4;
    if (inside) {
        scene_add_stand(scene, "middle", 0, 0, 0);
        scene_add_stand(scene, "east", 0.2 * size.x, 0.1 * size.y, pi);
        scene_add_stand(scene, "west", -0.2 * size.x, -0.1 * size.y, 0);
        return;
    }
    double away = 0.5 * sqrt(size.x * size.x + size.y * size.y) + 2;
    static const char *const names[3] = {"a", "b", "c"};
    for (int i = 0; i < 3; i++) {
        double a = 2 * pi * i / 3 + 0.3;
        scene_add_stand(scene, names[i], away * cos(a), away * sin(a), a + pi);
    }
}

static enum st furnish(struct scene *scene, const char *path, struct errctx *err) {
    struct box b = bounds(&scene->mesh);
    double span = vec3_norm(vec3_sub(b.max, b.min));
    if (!(span > 1e-3 && span < 2000))
        return errctx_set(err, ST_INVALID,
                          "%s: the mesh spans %g m, expected 1 mm to 2 km: is its unit the metre?",
                          path, span);
    centre(&scene->mesh, &b);
    struct material stone = {.name = "surface",
                             .kind = MATERIAL_MATT,
                             .texture = TEXTURE_STONE,
                             .rgb = {0.5f, 0.48f, 0.45f},
                             .rgb2 = {0.4f, 0.38f, 0.36f},
                             .albedo_ir = 0.5f,
                             .f0 = 0.03f,
                             .roughness = 0.7f,
                             .scale_m = 1};
    (void)scene_add_part(scene, scene_add_material(scene, stone), pose_identity());
    daylight(scene);
    enum st st = scene_finish(scene, err);
    if (!st)
        choose_stands(scene, &b);
    return st;
}

enum st scene_load(const char *path, struct scene **out_scene, struct errctx *err) {
    struct scene *scene = NULL;
    enum st st = scene_allocate(&scene, err);
    if (st)
        return st;
    const char *slash = strrchr(path, '/');
    (void)snprintf(scene->name, sizeof scene->name, "%.31s", slash ? slash + 1 : path);
    st = mesh_load(path, &scene->mesh, err);
    if (!st)
        st = furnish(scene, path, err);
    if (st) {
        scene_destroy(scene);
        return st;
    }
    *out_scene = scene;
    return ST_OK;
}
