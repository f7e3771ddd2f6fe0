/* Triangles of a scene. Positions are float and exact: the surface *is* these triangles, so truth
 * about it is computed in double from them. Grows on the heap; a failed growth is remembered and
 * all later additions are ignored, so that scene builders check once at the end. */
#ifndef SC_TWIN_MESH_H
#define SC_TWIN_MESH_H

#include "base/st.h"
#include "base/vec.h"

#include <stddef.h>
#include <stdint.h>

enum { MESH_MAX_TRIANGLES = 40000000 }; /* 40 million: 1.9 GB with its hierarchy */

struct mesh {
    float *position_m; /* [vertex_count][3] */
    float *normal;     /* [vertex_count][3], unit shading normal; 0 0 0: use the triangle's own */
    uint32_t *corner;  /* [triangle_count][3] vertex numbers, counter-clockwise seen from outside */
    uint16_t *part;    /* [triangle_count] which part of the scene */
    size_t vertex_count, triangle_count;
    size_t vertex_capacity, triangle_capacity;
    enum st st; /* first failure: ST_NOMEM or ST_INVALID (a vertex that is not finite) */
};

void mesh_fini(struct mesh *mesh); /* takes zeroed */

/* Adds a vertex and returns its number; normal may be the zero vector. */
uint32_t mesh_vertex(struct mesh *mesh, struct vec3 p_m, struct vec3 normal);
/* Adds a triangle of existing vertices. */
void mesh_triangle(struct mesh *mesh, uint32_t a, uint32_t b, uint32_t c, uint16_t part);

/* Sets the shading normals of vertices [first_vertex, count) to the area-weighted mean of the
 * triangles [first_triangle, count) that use them. */
void mesh_smooth(struct mesh *mesh, size_t first_vertex, size_t first_triangle);

static inline struct vec3 mesh_position(const struct mesh *mesh, uint32_t vertex) {
    const float *p = mesh->position_m + 3 * (size_t)vertex;
    return vec3_make((double)p[0], (double)p[1], (double)p[2]);
}

#endif
