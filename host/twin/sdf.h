/* Organic shapes as signed distance functions, turned into triangles: car bodies, statues, rubble.
 * A function gives (a lower bound of) the distance to the surface, negative inside. */
#ifndef SC_TWIN_SDF_H
#define SC_TWIN_SDF_H

#include "twin/shapes.h"

#include <math.h>

struct sdf_point {
    float x, y, z;
};

/* Distance at p, m. Must not overestimate by more than the mesher's `slack`. Called from many
 * threads. */
typedef float sdf_function(const void *ctx, struct sdf_point p);
struct sdf_job {
    sdf_function *distance;
    sdf_function *clip; /* only the surface where this is negative is kept; NULL: all */
    const void *ctx;
    struct vec3 min, max; /* box in the local frame that holds the surface */
    double cell_m;        /* size of a grid cell */
    double slack;         /* >= 1: how much `distance` may overestimate (1 for a true distance) */
};

/* Adds the surface: surface nets (Gibson 1998), each vertex then moved onto the surface along the
 * gradient, which is also its shading normal. Cost: about cells near the surface * 9 evaluations;
 * runs on all threads, result independent of them. Memory: 8 bytes a cell of the box. Boxes above
 * 2^28 cells are refused (the mesh remembers ST_NOMEM). */
void sdf_mesh(const struct shaper *s, const struct sdf_job *job);

/* Building blocks. */
static inline struct sdf_point sdf_at(float x, float y, float z) {
    struct sdf_point p = {x, y, z};
    return p;
}
static inline float sdf_length(float x, float y, float z) {
    return sqrtf(x * x + y * y + z * z);
}
static inline float sdf_ball(struct sdf_point p, float x, float y, float z, float r) {
    return sdf_length(p.x - x, p.y - y, p.z - z) - r;
}
/* Approximate distance to an ellipsoid (first-order: f / |grad f|). */
static inline float sdf_ellipsoid(struct sdf_point p, float x, float y, float z, float rx, float ry,
                                  float rz) {
    float qx = (p.x - x) / rx, qy = (p.y - y) / ry, qz = (p.z - z) / rz;
    float k0 = sdf_length(qx, qy, qz), k1 = sdf_length(qx / rx, qy / ry, qz / rz);
    return k1 > 1e-9f ? k0 * (k0 - 1) / k1 : -fminf(rx, fminf(ry, rz));
}
/* Box with half sizes h about the origin, edges rounded by r. */
static inline float sdf_box(struct sdf_point p, float hx, float hy, float hz, float r) {
    float x = fabsf(p.x) - hx + r, y = fabsf(p.y) - hy + r, z = fabsf(p.z) - hz + r;
    float out = sdf_length(fmaxf(x, 0), fmaxf(y, 0), fmaxf(z, 0));
    return out + fminf(fmaxf(x, fmaxf(y, z)), 0) - r;
}
/* Cone-like capsule from a (radius ra) to b (radius rb). */
static inline float sdf_limb(struct sdf_point p, struct sdf_point a, struct sdf_point b, float ra,
                             float rb) {
    float bx = b.x - a.x, by = b.y - a.y, bz = b.z - a.z;
    float px = p.x - a.x, py = p.y - a.y, pz = p.z - a.z;
    float t = (px * bx + py * by + pz * bz) / (bx * bx + by * by + bz * bz + 1e-12f);
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    return sdf_length(px - t * bx, py - t * by, pz - t * bz) - (ra + (rb - ra) * t);
}
/* Union, intersection and difference with a fillet of about k (polynomial, Quilez). */
static inline float sdf_join(float a, float b, float k) {
    float h = fmaxf(k - fabsf(a - b), 0) / k;
    return fminf(a, b) - h * h * k * 0.25f;
}
static inline float sdf_meet(float a, float b, float k) {
    return -sdf_join(-a, -b, k);
}
static inline float sdf_cut(float a, float b, float k) {
    return -sdf_join(-a, b, k);
}

#endif
