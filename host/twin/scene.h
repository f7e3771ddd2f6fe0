/* A scene: surfaces with materials, lights, sky, and places where the cart would stand. Procedural
 * and seeded, or a user's mesh. World frame: z up, metres, origin near the middle of the ground. */
#ifndef SC_TWIN_SCENE_H
#define SC_TWIN_SCENE_H

#include "base/pose.h"
#include "base/st.h"
#include "twin/material.h"
#include "twin/mesh.h"
#include "twin/trace.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    SCENE_MAX_PARTS = 4096,
    SCENE_MAX_MATERIALS = 256,
    SCENE_MAX_LIGHTS = 32,
    SCENE_MAX_SPHERES = 64,
    SCENE_MAX_STANDS = 8
};

/* A connected piece with one material. */
struct scene_part {
    uint16_t material;
    struct pose local_from_world; /* the frame of its pattern */
};

/* A lamp: a ball (soft shadows) that shines into a cone. */
struct scene_light {
    struct vec3 position_m, dir; /* dir: unit, middle of the cone */
    double radius_m;
    double cos_inner, cos_outer; /* full strength inside, none outside; -1 -1: all around */
    double rgb[3];               /* radiant intensity; irradiance at distance d is rgb / d^2 */
};

struct scene_sky {
    double zenith[3], horizon[3], ground[3]; /* radiance */
    struct vec3 sun_dir;                     /* unit, towards the sun; zero: none */
    double sun_rgb[3];                       /* irradiance */
    double sun_angle_rad;                    /* half angle of its disc, for soft shadows */
    bool stars;
};

struct scene_stand {
    char name[24];
    struct vec3 position_m; /* where the cart touches the ground */
    double yaw_rad;         /* direction of pan = 0 */
};

struct scene {
    char name[32];
    uint64_t seed;
    struct mesh mesh;
    struct trace_sphere sphere[SCENE_MAX_SPHERES];
    size_t sphere_count;
    struct scene_part *part; /* [part_count], room for SCENE_MAX_PARTS */
    size_t part_count;
    struct material *material; /* [material_count], room for SCENE_MAX_MATERIALS */
    size_t material_count;
    struct scene_light light[SCENE_MAX_LIGHTS];
    size_t light_count;
    struct scene_sky sky;
    struct scene_stand stand[SCENE_MAX_STANDS];
    size_t stand_count;
    double max_range_m;  /* the head's range setting for this scene; 0: its default */
    double ambient;      /* level of background infrared, 0 night .. 1 sunlit */
    double exposure;     /* camera: radiance that becomes white, suggested */
    struct trace *trace; /* made last */
};

/* A procedural scene by its name. */
struct scene_kind {
    const char *name, *summary;
    void (*build)(struct scene *scene, double detail);
};

/* The scenes there are; *out_count of them. */
const struct scene_kind *scene_kinds(size_t *out_count);

/* Builds a procedural scene. `detail` 0.2..1 scales the number of triangles (1: for pictures and
 * figures). Same name, seed and detail: same triangles. ST_NOT_FOUND lists the names. */
ST_MUST_CHECK enum st scene_create(const char *name, uint64_t seed, double detail,
                                   struct scene **out_scene, struct errctx *err);

/* A scene from a mesh file, OBJ or PLY (ASCII or binary), metres, z up. The ground is where the
 * mesh's lowest point is; one stand in the middle of its bounding box, one beside it. ST_FORMAT,
 * ST_NOMEM, ST_INVALID (no triangle, a coordinate that is not finite) name the file and what is
 * wrong. */
ST_MUST_CHECK enum st scene_load(const char *path, struct scene **out_scene, struct errctx *err);

void scene_destroy(struct scene *scene); /* takes NULL */

/* For builders. A new part in the frame world_from_local; numbers. Past the bounds the scene's mesh
 * remembers ST_NOMEM. */
uint16_t scene_add_material(struct scene *scene, struct material material);
uint16_t scene_add_part(struct scene *scene, uint16_t material, struct pose world_from_local);
void scene_add_light(struct scene *scene, struct scene_light light);
void scene_add_sphere(struct scene *scene, struct trace_sphere sphere);
void scene_add_stand(struct scene *scene, const char *name, double x_m, double y_m, double yaw_rad);
/* Ends building: checks the mesh and makes the ray caster. */
ST_MUST_CHECK enum st scene_finish(struct scene *scene, struct errctx *err);

/* Truth for a ray: the first surface, and if that is glass the next one behind it that is not. */
struct scene_truth {
    bool hit, behind; /* a first surface; a second one behind glass */
    struct trace_hit first, second;
    uint16_t first_material, second_material;
};
void scene_truth_of(const struct scene *scene, const struct trace_ray *ray,
                    struct scene_truth *out_truth);

/* The material pattern at a hit; coarse as in material_sample_at(). */
void scene_sample(const struct scene *scene, const struct trace_hit *hit, bool coarse,
                  struct material_sample *out);

/* ST_INVALID with a reason if a sensor cannot be at this place: surfaces within clearance_m, or
 * inside a closed body. */
ST_MUST_CHECK enum st scene_check_place(const struct scene *scene, struct vec3 p_m,
                                        double clearance_m, struct errctx *err);

#endif
