/* Ray casting against a scene's triangles and exact spheres (Embree 3 finds the primitive; the
 * point on it is then computed in double from the primitive itself, so a hit lies on its surface to
 * about 1e-12 m).
 *
 * Not found: a surface nearer than t_min or farther than t_max. Triangles are hit from both sides.
 */
#ifndef SC_TWIN_TRACE_H
#define SC_TWIN_TRACE_H

#include "base/st.h"
#include "base/vec.h"
#include "twin/mesh.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* A sphere of exactly known size. */
struct trace_sphere {
    struct vec3 centre_m;
    double radius_m;
    uint16_t part;
    bool hollow; /* a shell: inside is where one can stand */
};

struct trace_ray {
    struct vec3 origin_m, dir; /* dir: unit */
    double t_min_m, t_max_m;
};

struct trace_hit {
    double t_m;          /* along the ray */
    struct vec3 p_m;     /* origin + t dir */
    struct vec3 normal;  /* unit, of the primitive, on the side that the ray came from */
    struct vec3 shading; /* unit, interpolated, same side */
    uint16_t part;
    bool inside; /* the ray came from the primitive's back */
};

struct trace; /* the acceleration structure */

/* Builds it. The mesh must outlive it and not change. ST_INVALID without any primitive; ST_NOMEM.
 * Takes about 1 s a million triangles on two cores; 150 bytes a triangle. */
ST_MUST_CHECK enum st trace_create(const struct mesh *mesh, const struct trace_sphere *spheres,
                                   size_t sphere_count, struct trace **out_trace,
                                   struct errctx *err);
void trace_destroy(struct trace *trace); /* takes NULL */

/* First surface along the ray; false if there is none. Any thread; no allocation. */
bool trace_first(const struct trace *trace, const struct trace_ray *ray, struct trace_hit *out_hit);

/* The same for four rays at once, which is faster if they are close together. Bit i of the result:
 * ray i hit. `count` 1..4. */
unsigned trace_first4(const struct trace *trace, const struct trace_ray *rays, int count,
                      struct trace_hit *out_hits);

/* True if anything is between t_min and t_max. */
bool trace_blocked(const struct trace *trace, const struct trace_ray *ray);

#endif
