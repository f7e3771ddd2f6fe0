/* Shapes from which procedural scenes are built. A shaper adds triangles of one part to a mesh
 * through a local frame; shapes never fail, the mesh remembers (mesh.h). Sizes in metres, local
 * frame z up. */
#ifndef SC_TWIN_SHAPES_H
#define SC_TWIN_SHAPES_H

#include "base/pose.h"
#include "twin/mesh.h"

struct shaper {
    struct mesh *mesh;
    struct pose world_from_local;
    uint16_t part;
};

/* The same shaper with another frame: local_from_inner is applied first. */
struct shaper shaper_at(const struct shaper *s, struct pose local_from_inner);
/* Moved by t, turned by yaw about z, then by pitch about y, then by roll about x. */
struct pose shaper_frame(struct vec3 t_m, double yaw_rad, double pitch_rad, double roll_rad);

/* Flat quad, corners counter-clockwise seen from outside. */
void shape_quad(const struct shaper *s, struct vec3 a, struct vec3 b, struct vec3 c, struct vec3 d);

/* Box between two corners with edges cut by `bevel_m` (0: sharp). */
void shape_box(const struct shaper *s, struct vec3 min, struct vec3 max, double bevel_m);

/* Surface point for (u, v) in [0, 1]^2. Outside is du x dv. */
typedef struct vec3 shape_surface(const void *ctx, double u, double v);
enum shape_flag {
    SHAPE_CLOSED_U = 1, /* u = 1 is u = 0 */
    SHAPE_CLOSED_V = 2,
    SHAPE_FLAT = 4 /* no smooth shading */
};
/* A grid of nu x nv cells over the surface. */
void shape_grid(const struct shaper *s, shape_surface *at, const void *ctx, int nu, int nv,
                unsigned flags);

/* A profile of (x = radius, y = height) points turned about z, from bottom to top for an outside
 * facing away from the axis. Corners sharper than 40 deg stay sharp. */
void shape_lathe(const struct shaper *s, const struct vec2 *profile, int count, int segments);

/* A tube along points with a radius each; ends closed. */
void shape_tube(const struct shaper *s, const struct vec3 *path, const double *radius_m, int count,
                int segments);
/* A straight round bar. */
void shape_bar(const struct shaper *s, struct vec3 a, struct vec3 b, double radius_m, int segments);

/* An axis-aligned ellipsoid. */
void shape_ellipsoid(const struct shaper *s, struct vec3 centre, struct vec3 radii, int segments);

/* A polygon in the local xy plane (counter-clockwise, simple), raised from z0 to z1. Both faces and
 * the sides. */
void shape_prism(const struct shaper *s, const struct vec2 *outline, int count, double z0_m,
                 double z1_m);

/* One triangle seen from both sides (leaves, shards). */
void shape_shard(const struct shaper *s, struct vec3 a, struct vec3 b, struct vec3 c);

#endif
