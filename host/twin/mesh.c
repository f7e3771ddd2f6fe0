#include "twin/mesh.h"

#include <stdlib.h>
#include <string.h>

void mesh_fini(struct mesh *mesh) {
    free(mesh->position_m);
    free(mesh->normal);
    free(mesh->corner);
    free(mesh->part);
    memset(mesh, 0, sizeof *mesh);
}

/* Makes *array hold `capacity` elements; false without memory. */
static int grow(void **array, size_t capacity, size_t element) {
    void *bigger = realloc(*array, capacity * element);
    if (!bigger)
        return 0;
    *array = bigger;
    return 1;
}

static int reserve_vertices(struct mesh *mesh) {
    if (mesh->vertex_count < mesh->vertex_capacity)
        return 1;
    size_t capacity = mesh->vertex_capacity ? mesh->vertex_capacity * 2 : 4096;
    void *position = mesh->position_m, *normal = mesh->normal;
    int ok = grow(&position, capacity, 3 * sizeof *mesh->position_m);
    mesh->position_m = position;
    ok = ok && grow(&normal, capacity, 3 * sizeof *mesh->normal);
    mesh->normal = normal;
    if (ok)
        mesh->vertex_capacity = capacity;
    return ok;
}

static int reserve_triangles(struct mesh *mesh) {
    if (mesh->triangle_count < mesh->triangle_capacity)
        return 1;
    size_t capacity = mesh->triangle_capacity ? mesh->triangle_capacity * 2 : 8192;
    void *corner = mesh->corner, *part = mesh->part;
    int ok = grow(&corner, capacity, 3 * sizeof *mesh->corner);
    mesh->corner = corner;
    ok = ok && grow(&part, capacity, sizeof *mesh->part);
    mesh->part = part;
    if (ok)
        mesh->triangle_capacity = capacity;
    return ok;
}

uint32_t mesh_vertex(struct mesh *mesh, struct vec3 p_m, struct vec3 normal) {
    if (!mesh->st && !vec3_is_finite(p_m))
        mesh->st = ST_INVALID;
    if (!mesh->st &&
        (mesh->vertex_count >= 3u * (size_t)MESH_MAX_TRIANGLES || !reserve_vertices(mesh)))
        mesh->st = ST_NOMEM;
    if (mesh->st)
        return 0;
    float *p = mesh->position_m + 3 * mesh->vertex_count;
    float *n = mesh->normal + 3 * mesh->vertex_count;
    p[0] = (float)p_m.x;
    p[1] = (float)p_m.y;
    p[2] = (float)p_m.z;
    n[0] = (float)normal.x;
    n[1] = (float)normal.y;
    n[2] = (float)normal.z;
    return (uint32_t)mesh->vertex_count++;
}

void mesh_triangle(struct mesh *mesh, uint32_t a, uint32_t b, uint32_t c, uint16_t part) {
    if (!mesh->st && (mesh->triangle_count >= MESH_MAX_TRIANGLES || !reserve_triangles(mesh)))
        mesh->st = ST_NOMEM;
    if (mesh->st)
        return;
    uint32_t *corner = mesh->corner + 3 * mesh->triangle_count;
    corner[0] = a;
    corner[1] = b;
    corner[2] = c;
    mesh->part[mesh->triangle_count++] = part;
}

void mesh_smooth(struct mesh *mesh, size_t first_vertex, size_t first_triangle) {
    if (mesh->st)
        return;
    float *normal = mesh->normal;
    for (size_t i = 3 * first_vertex; i < 3 * mesh->vertex_count; i++)
        normal[i] = 0;
    for (size_t t = first_triangle; t < mesh->triangle_count; t++) {
        const uint32_t *corner = mesh->corner + 3 * t;
        struct vec3 a = mesh_position(mesh, corner[0]);
        struct vec3 n = vec3_cross(vec3_sub(mesh_position(mesh, corner[1]), a),
                                   vec3_sub(mesh_position(mesh, corner[2]), a));
        for (int k = 0; k < 3; k++) {
            if (corner[k] < first_vertex)
                continue;
            float *at = normal + 3 * (size_t)corner[k];
            at[0] += (float)n.x;
            at[1] += (float)n.y;
            at[2] += (float)n.z;
        }
    }
    for (size_t v = first_vertex; v < mesh->vertex_count; v++) {
        float *at = normal + 3 * v;
        double length = sqrt((double)at[0] * (double)at[0] + (double)at[1] * (double)at[1] +
                             (double)at[2] * (double)at[2]);
        for (int k = 0; k < 3; k++)
            at[k] = length > 1e-20 ? (float)((double)at[k] / length) : 0;
    }
}
