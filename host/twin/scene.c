#include "twin/scene.h"

#include "twin/scene_build.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum st scene_allocate(struct scene **out_scene, struct errctx *err) {
    struct scene *scene = calloc(1, sizeof *scene);
    if (scene) {
        scene->part = calloc(SCENE_MAX_PARTS, sizeof *scene->part);
        scene->material = calloc(SCENE_MAX_MATERIALS, sizeof *scene->material);
    }
    if (!scene || !scene->part || !scene->material) {
        scene_destroy(scene);
        return errctx_set(err, ST_NOMEM, "scene: out of memory");
    }
    *out_scene = scene;
    return ST_OK;
}

void scene_destroy(struct scene *scene) {
    if (!scene)
        return;
    trace_destroy(scene->trace);
    mesh_fini(&scene->mesh);
    free(scene->part);
    free(scene->material);
    free(scene);
}

uint16_t scene_add_material(struct scene *scene, struct material material) {
    if (scene->material_count >= SCENE_MAX_MATERIALS) {
        scene->mesh.st = ST_NOMEM;
        return 0;
    }
    scene->material[scene->material_count] = material;
    return (uint16_t)scene->material_count++;
}

uint16_t scene_add_part(struct scene *scene, uint16_t material, struct pose world_from_local) {
    if (scene->part_count >= SCENE_MAX_PARTS) {
        scene->mesh.st = ST_NOMEM;
        return 0;
    }
    struct scene_part part = {material, pose_inverse(&world_from_local)};
    scene->part[scene->part_count] = part;
    return (uint16_t)scene->part_count++;
}

void scene_add_light(struct scene *scene, struct scene_light light) {
    if (scene->light_count < SCENE_MAX_LIGHTS)
        scene->light[scene->light_count++] = light;
}

void scene_add_sphere(struct scene *scene, struct trace_sphere sphere) {
    if (scene->sphere_count < SCENE_MAX_SPHERES)
        scene->sphere[scene->sphere_count++] = sphere;
}

void scene_add_stand(struct scene *scene, const char *name, double x_m, double y_m,
                     double yaw_rad) {
    if (scene->stand_count >= SCENE_MAX_STANDS)
        return;
    struct scene_stand *stand = &scene->stand[scene->stand_count++];
    (void)snprintf(stand->name, sizeof stand->name, "%s", name);
    stand->position_m = vec3_make(x_m, y_m, 0);
    stand->yaw_rad = yaw_rad;
}

enum st scene_finish(struct scene *scene, struct errctx *err) {
    if (scene->mesh.st == ST_INVALID)
        return errctx_set(err, ST_INVALID, "scene %s: a vertex coordinate is not a finite number",
                          scene->name);
    if (scene->mesh.st)
        return errctx_set(err, scene->mesh.st, "scene %s: too many triangles, parts or materials",
                          scene->name);
    enum st st = trace_create(&scene->mesh, scene->sphere, scene->sphere_count, &scene->trace, err);
    return st ? errctx_prefix(err, st, "scene %s", scene->name) : ST_OK;
}

static enum st unknown(const char *name, struct errctx *err) {
    char list[256] = "";
    size_t count = 0, used = 0;
    const struct scene_kind *kinds = scene_kinds(&count);
    for (size_t i = 0; i < count && used < sizeof list - 1; i++) {
        int n = snprintf(list + used, sizeof list - used, "%s%s", i ? ", " : "", kinds[i].name);
        used += n > 0 ? (size_t)n : 0;
    }
    return errctx_set(err, ST_NOT_FOUND,
                      "there is no scene '%s': it is one of %s, or a file ending in .obj or .ply",
                      name, list);
}

enum st scene_create(const char *name, uint64_t seed, double detail, struct scene **out_scene,
                     struct errctx *err) {
    size_t count = 0;
    const struct scene_kind *kinds = scene_kinds(&count), *kind = NULL;
    for (size_t i = 0; i < count; i++)
        kind = strcmp(kinds[i].name, name) ? kind : &kinds[i];
    if (!kind)
        return unknown(name, err);
    if (!(detail >= 0.1 && detail <= 2))
        return errctx_set(err, ST_INVALID, "scene detail is %g, expected 0.1 to 2", detail);
    struct scene *scene = NULL;
    enum st st = scene_allocate(&scene, err);
    if (st)
        return st;
    strncat(scene->name, kind->name, sizeof scene->name - 1);
    scene->seed = seed;
    kind->build(scene, detail);
    st = scene_finish(scene, err);
    if (st) {
        scene_destroy(scene);
        return st;
    }
    *out_scene = scene;
    return ST_OK;
}

static uint16_t material_of(const struct scene *scene, const struct trace_hit *hit) {
    return scene->part[hit->part].material;
}

void scene_truth_of(const struct scene *scene, const struct trace_ray *ray,
                    struct scene_truth *out_truth) {
    const double past_m = 1e-5; /* beyond a pane, above the float resolution of a scene of 50 m */
    memset(out_truth, 0, sizeof *out_truth);
    out_truth->hit = trace_first(scene->trace, ray, &out_truth->first);
    if (!out_truth->hit)
        return;
    out_truth->first_material = material_of(scene, &out_truth->first);
    if (scene->material[out_truth->first_material].kind != MATERIAL_GLASS)
        return;
    struct trace_ray on = *ray;
    on.t_min_m = out_truth->first.t_m + past_m;
    for (int panes = 0; panes < 16; panes++) {
        if (!trace_first(scene->trace, &on, &out_truth->second))
            return;
        out_truth->second_material = material_of(scene, &out_truth->second);
        if (scene->material[out_truth->second_material].kind != MATERIAL_GLASS) {
            out_truth->behind = true;
            return;
        }
        on.t_min_m = out_truth->second.t_m + past_m;
    }
}

void scene_sample(const struct scene *scene, const struct trace_hit *hit, bool coarse,
                  struct material_sample *out) {
    const struct scene_part *part = &scene->part[hit->part];
    const struct pose *local = &part->local_from_world;
    material_sample_at(&scene->material[part->material], pose_apply(local, hit->p_m),
                       mat3_mulv(&local->r, hit->shading), coarse, out);
    out->bump = mat3_tmulv(&local->r, out->bump);
}

enum st scene_check_place(const struct scene *scene, struct vec3 p_m, double clearance_m,
                          struct errctx *err) {
    enum { RAYS = 194 };
    int from_inside = 0, hits = 0;
    double nearest = INFINITY;
    for (int i = 0; i < RAYS; i++) { /* spiral over the sphere */
        double z = 1 - 2 * (i + 0.5) / RAYS, r = sqrt(1 - z * z), a = 2.399963229728653 * i;
        struct trace_ray ray = {p_m, {r * cos(a), r * sin(a), z}, 0, INFINITY};
        struct trace_hit hit;
        if (!trace_first(scene->trace, &ray, &hit))
            continue;
        hits++;
        from_inside += hit.inside;
        nearest = hit.t_m < nearest ? hit.t_m : nearest;
    }
    if (nearest < clearance_m)
        return errctx_set(
            err, ST_INVALID,
            "the head at (%.2f, %.2f, %.2f) m is %.0f mm from a surface, it needs %.0f mm; "
            "move the stand",
            p_m.x, p_m.y, p_m.z, nearest * 1000, clearance_m * 1000);
    if (hits == RAYS && from_inside > RAYS * 9 / 10)
        return errctx_set(err, ST_INVALID,
                          "the head at (%.2f, %.2f, %.2f) m is inside a solid body; move the stand",
                          p_m.x, p_m.y, p_m.z);
    return ST_OK;
}
