#include "twin/sdf.h"

#include <stdint.h>
#include <stdlib.h>

/* Cells of a block that is evaluated or skipped as a whole. */
enum { BLOCK = 16 };
static const size_t max_points = (size_t)1 << 28;

struct grid {
    const struct sdf_job *job;
    int n[3];        /* points along each axis, a multiple of BLOCK plus 1 */
    float origin[3]; /* of point 0 0 0 */
    float cell;
    float *value;        /* [n2][n1][n0] */
    int32_t *vertex;     /* vertex in each cell, from 0; -1 none */
    int32_t vertex_base; /* number in the mesh of vertex 0 */
};

static size_t at(const struct grid *g, int x, int y, int z) {
    return ((size_t)z * (size_t)g->n[1] + (size_t)y) * (size_t)g->n[0] + (size_t)x;
}

static float evaluate(const struct grid *g, float x, float y, float z) {
    return g->job->distance(g->job->ctx, sdf_at(x, y, z));
}

/* Values at the points of a cube of `size` cells (its upper faces belong to the next cubes, or to
 * the border). A cube that the surface cannot reach gets the value of its middle, which has the
 * right sign; one that it may reach is cut into eight, down to 4 cells, then evaluated point by
 * point. */
static void fill_cube(const struct grid *g, int x0, int y0, int z0, int size) {
    float half = 0.5f * (float)size * g->cell;
    float cx = g->origin[0] + (float)x0 * g->cell + half;
    float cy = g->origin[1] + (float)y0 * g->cell + half;
    float cz = g->origin[2] + (float)z0 * g->cell + half;
    float centre = evaluate(g, cx, cy, cz);
    /* 1.8 > sqrt(3): the cube's corner, with a margin of a cell for the neighbours */
    int far = fabsf(centre) > (float)g->job->slack * (1.8f * half + 2 * g->cell);
    if (!far && size > 4) {
        for (int i = 0; i < 8; i++)
            fill_cube(g, x0 + (i & 1) * size / 2, y0 + (i >> 1 & 1) * size / 2,
                      z0 + (i >> 2) * size / 2, size / 2);
        return;
    }
    int x1 = x0 + size + (x0 + size == g->n[0] - 1), y1 = y0 + size + (y0 + size == g->n[1] - 1);
    int z1 = z0 + size + (z0 + size == g->n[2] - 1);
    for (int z = z0; z < z1; z++)
        for (int y = y0; y < y1; y++)
            for (int x = x0; x < x1; x++)
                g->value[at(g, x, y, z)] = far ? centre
                                               : evaluate(g, g->origin[0] + (float)x * g->cell,
                                                          g->origin[1] + (float)y * g->cell,
                                                          g->origin[2] + (float)z * g->cell);
}

/* Gradient and value from four evaluations at the corners of a small tetrahedron. */
static struct vec3 gradient(const struct grid *g, float x, float y, float z, double *value) {
    float e = 0.2f * g->cell;
    double a = (double)evaluate(g, x + e, y - e, z - e),
           b = (double)evaluate(g, x - e, y - e, z + e);
    double c = (double)evaluate(g, x - e, y + e, z - e),
           d = (double)evaluate(g, x + e, y + e, z + e);
    double k = 0.25 / (double)e;
    *value = 0.25 * (a + b + c + d);
    return vec3_make(k * (a - b - c + d), k * (c - a - b + d), k * (b - a - c + d));
}

/* Mean of the sign changes on the edges of a cell, in cells from its corner; false if there are
 * none. */
static int crossing(const struct grid *g, int x, int y, int z, float out[3]) {
    float corner[8];
    int negative = 0;
    for (int i = 0; i < 8; i++) {
        corner[i] = g->value[at(g, x + (i & 1), y + (i >> 1 & 1), z + (i >> 2))];
        negative += corner[i] < 0;
    }
    if (negative == 0 || negative == 8)
        return 0;
    float sum[3] = {0, 0, 0};
    int count = 0;
    for (int i = 0; i < 8; i++) {
        for (int axis = 0; axis < 3; axis++) {
            int j = i | 1 << axis;
            if (j == i || (corner[i] < 0) == (corner[j] < 0))
                continue;
            float t = corner[i] / (corner[i] - corner[j]);
            for (int k = 0; k < 3; k++)
                sum[k] += k == axis ? t : (float)(i >> k & 1);
            count++;
        }
    }
    for (int k = 0; k < 3; k++)
        out[k] = sum[k] / (float)count;
    return 1;
}

struct placed {
    float p[3], normal[3]; /* local frame */
};

/* A vertex for the cell with the crossing at `in`, moved onto the surface. */
static struct placed place(const struct grid *g, int x, int y, int z, const float in[3]) {
    float p[3] = {g->origin[0] + ((float)x + in[0]) * g->cell,
                  g->origin[1] + ((float)y + in[1]) * g->cell,
                  g->origin[2] + ((float)z + in[2]) * g->cell};
    double value = 0;
    struct vec3 n = gradient(g, p[0], p[1], p[2], &value);
    double g2 = vec3_dot(n, n);
    if (g2 > 1e-6) { /* one Newton step, no further than half a cell */
        double limit = 0.5 * (double)g->cell, step = value / sqrt(g2);
        step = step > limit ? limit : step < -limit ? -limit : step;
        struct vec3 u = vec3_scale(n, 1 / sqrt(g2));
        p[0] -= (float)(step * u.x);
        p[1] -= (float)(step * u.y);
        p[2] -= (float)(step * u.z);
        n = gradient(g, p[0], p[1], p[2], &value);
    }
    double norm = vec3_norm(n);
    struct vec3 u = norm > 1e-6 ? vec3_scale(n, 1 / norm) : vec3_make(0, 0, 0);
    struct placed v = {{p[0], p[1], p[2]}, {(float)u.x, (float)u.y, (float)u.z}};
    return v;
}

/* Vertices of one slab of cells: counts them (out NULL), or writes them and their numbers from
 * `first` on. */
static int32_t slab(const struct grid *g, int z, int32_t first, struct placed *out) {
    int32_t count = 0;
    for (int y = 0; y < g->n[1] - 1; y++)
        for (int x = 0; x < g->n[0] - 1; x++) {
            float in[3];
            int here = crossing(g, x, y, z, in);
            if (out && here)
                out[first + count] = place(g, x, y, z, in);
            g->vertex[at(g, x, y, z)] = here ? first + count : -1;
            count += here;
        }
    return count;
}

/* All vertices, computed in parallel, added to the mesh in the order of the cells. */
static enum st place_all(const struct shaper *s, struct grid *g) {
    int slabs = g->n[2] - 1;
    int32_t *first = calloc((size_t)slabs + 1, sizeof *first);
    if (!first)
        return ST_NOMEM;
#pragma omp parallel for schedule(dynamic, 4)
    for (int z = 0; z < slabs; z++)
        first[z + 1] = slab(g, z, 0, NULL);
    for (int z = 0; z < slabs; z++)
        first[z + 1] += first[z];
    struct placed *placed = malloc(((size_t)first[slabs] + 1) * sizeof *placed);
    if (!placed) {
        free(first);
        return ST_NOMEM;
    }
#pragma omp parallel for schedule(dynamic, 4)
    for (int z = 0; z < slabs; z++)
        (void)slab(g, z, first[z], placed);
    g->vertex_base = (int32_t)s->mesh->vertex_count;
    const struct pose *w = &s->world_from_local;
    for (int32_t i = 0; i < first[slabs]; i++) {
        const float *p = placed[i].p, *n = placed[i].normal;
        struct vec3 q = vec3_make((double)p[0], (double)p[1], (double)p[2]);
        struct vec3 m = vec3_make((double)n[0], (double)n[1], (double)n[2]);
        (void)mesh_vertex(s->mesh, pose_apply(w, q), mat3_mulv(&w->r, m));
    }
    free(placed);
    free(first);
    return s->mesh->st;
}

/* The vertex where the clip function changes sign between a and b, linearly. */
static uint32_t clip_vertex(const struct shaper *s, uint32_t a, uint32_t b, float fa, float fb) {
    double t = (double)(fa / (fa - fb));
    struct vec3 p = vec3_add(vec3_scale(mesh_position(s->mesh, a), 1 - t),
                             vec3_scale(mesh_position(s->mesh, b), t));
    const float *na = s->mesh->normal + 3 * (size_t)a, *nb = s->mesh->normal + 3 * (size_t)b;
    struct vec3 n = vec3_make((1 - t) * (double)na[0] + t * (double)nb[0],
                              (1 - t) * (double)na[1] + t * (double)nb[1],
                              (1 - t) * (double)na[2] + t * (double)nb[2]);
    double norm = vec3_norm(n);
    return mesh_vertex(s->mesh, p, norm > 1e-6 ? vec3_scale(n, 1 / norm) : n);
}

/* Adds the part of a triangle where the clip function is negative (Sutherland and Hodgman 1974). */
static void emit_clipped(const struct shaper *s, const struct grid *g, const uint32_t t[3]) {
    const struct pose *w = &s->world_from_local;
    float f[3];
    for (int k = 0; k < 3; k++) {
        struct vec3 l = mat3_tmulv(&w->r, vec3_sub(mesh_position(s->mesh, t[k]), w->t_m));
        f[k] = g->job->clip(g->job->ctx, sdf_at((float)l.x, (float)l.y, (float)l.z));
    }
    uint32_t corner[4];
    int count = 0;
    for (int k = 0; k < 3 && !s->mesh->st; k++) {
        int next = (k + 1) % 3;
        if (f[k] < 0)
            corner[count++] = t[k];
        if ((f[k] < 0) != (f[next] < 0))
            corner[count++] = clip_vertex(s, t[k], t[next], f[k], f[next]);
    }
    for (int k = 2; k < count; k++)
        mesh_triangle(s->mesh, corner[0], corner[k - 1], corner[k], s->part);
}

static void emit(const struct shaper *s, const struct grid *g, const int32_t q[4]) {
    for (int half = 0; half < 2; half++) {
        const uint32_t t[3] = {(uint32_t)q[0], (uint32_t)q[1 + half], (uint32_t)q[2 + half]};
        if (s->mesh->st)
            return;
        if (g->job->clip)
            emit_clipped(s, g, t);
        else
            mesh_triangle(s->mesh, t[0], t[1], t[2], s->part);
    }
}

/* The quads around the three edges that leave point (x, y, z) upwards. */
static void connect(const struct shaper *s, const struct grid *g, int x, int y, int z) {
    float here = g->value[at(g, x, y, z)];
    for (int axis = 0; axis < 3; axis++) {
        int d[3] = {axis == 0, axis == 1, axis == 2};
        if (x + d[0] >= g->n[0] || y + d[1] >= g->n[1] || z + d[2] >= g->n[2])
            continue;
        float there = g->value[at(g, x + d[0], y + d[1], z + d[2])];
        if ((here < 0) == (there < 0))
            continue;
        int u = (axis + 1) % 3, v = (axis + 2) % 3;
        int32_t q[4];
        int whole = 1;
        for (int k = 0; k < 4; k++) {
            int c[3] = {x, y, z};
            c[u] -= k == 0 || k == 3;
            c[v] -= k == 0 || k == 1;
            int in = c[0] >= 0 && c[1] >= 0 && c[2] >= 0 && c[0] < g->n[0] - 1 &&
                     c[1] < g->n[1] - 1 && c[2] < g->n[2] - 1;
            q[k] = in ? g->vertex[at(g, c[0], c[1], c[2])] : -1;
            whole = whole && q[k] >= 0;
            q[k] += g->vertex_base;
        }
        if (!whole)
            continue;
        if (here >= 0) { /* outside is on this side */
            int32_t t = q[1];
            q[1] = q[3];
            q[3] = t;
        }
        emit(s, g, q);
    }
}

static void polygonise(const struct shaper *s, struct grid *g) {
    int b0 = (g->n[0] - 1) / BLOCK, b1 = (g->n[1] - 1) / BLOCK, b2 = (g->n[2] - 1) / BLOCK;
    int blocks = b0 * b1 * b2;
#pragma omp parallel for schedule(dynamic, 16)
    for (int b = 0; b < blocks; b++)
        fill_cube(g, b % b0 * BLOCK, b / b0 % b1 * BLOCK, b / b0 / b1 * BLOCK, BLOCK);
    enum st st = place_all(s, g);
    if (st && !s->mesh->st)
        s->mesh->st = st;
    if (s->mesh->st)
        return;
    for (int z = 0; z < g->n[2]; z++)
        for (int y = 0; y < g->n[1]; y++)
            for (int x = 0; x < g->n[0]; x++)
                connect(s, g, x, y, z);
}

void sdf_mesh(const struct shaper *s, const struct sdf_job *job) {
    struct grid g = {.job = job, .cell = (float)job->cell_m};
    const double size[3] = {job->max.x - job->min.x, job->max.y - job->min.y,
                            job->max.z - job->min.z};
    size_t points = 1;
    for (int k = 0; k < 3; k++) {
        int blocks = (int)(size[k] / job->cell_m / BLOCK) + 1;
        g.n[k] = blocks * BLOCK + 1;
        points *= (size_t)g.n[k];
    }
    g.origin[0] = (float)job->min.x;
    g.origin[1] = (float)job->min.y;
    g.origin[2] = (float)job->min.z;
    if (points <= max_points) {
        g.value = malloc(points * sizeof *g.value);
        g.vertex = malloc(points * sizeof *g.vertex);
    }
    if (g.value && g.vertex)
        polygonise(s, &g);
    else
        s->mesh->st = ST_NOMEM;
    free(g.value);
    free(g.vertex);
}
