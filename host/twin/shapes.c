#include "twin/shapes.h"

#include <stdlib.h>

static const double pi = 3.14159265358979323846;
static const struct vec3 flat = {0, 0, 0};

struct shaper shaper_at(const struct shaper *s, struct pose local_from_inner) {
    struct shaper inner = *s;
    inner.world_from_local = pose_compose(&s->world_from_local, &local_from_inner);
    return inner;
}

struct pose shaper_frame(struct vec3 t_m, double yaw_rad, double pitch_rad, double roll_rad) {
    struct mat3 z = so3_exp(vec3_make(0, 0, yaw_rad)), y = so3_exp(vec3_make(0, pitch_rad, 0));
    struct mat3 x = so3_exp(vec3_make(roll_rad, 0, 0));
    struct mat3 zy = mat3_mul(&z, &y);
    struct pose frame = {mat3_mul(&zy, &x), t_m};
    return frame;
}

static uint32_t put(const struct shaper *s, struct vec3 p) {
    return mesh_vertex(s->mesh, pose_apply(&s->world_from_local, p), flat);
}

void shape_quad(const struct shaper *s, struct vec3 a, struct vec3 b, struct vec3 c,
                struct vec3 d) {
    uint32_t ia = put(s, a), ib = put(s, b), ic = put(s, c), id = put(s, d);
    mesh_triangle(s->mesh, ia, ib, ic, s->part);
    mesh_triangle(s->mesh, ia, ic, id, s->part);
}

void shape_shard(const struct shaper *s, struct vec3 a, struct vec3 b, struct vec3 c) {
    mesh_triangle(s->mesh, put(s, a), put(s, b), put(s, c), s->part);
}

/* Component `axis` of a vector, and a vector from components along permuted axes. */
static struct vec3 along(int axis, double a, double b, double c) {
    return axis == 0 ? vec3_make(a, b, c) : axis == 1 ? vec3_make(c, a, b) : vec3_make(b, c, a);
}

void shape_box(const struct shaper *s, struct vec3 min, struct vec3 max, double bevel_m) {
    struct vec3 c = vec3_scale(vec3_add(min, max), 0.5), h = vec3_scale(vec3_sub(max, min), 0.5);
    double half[3] = {h.x, h.y, h.z}, e = bevel_m;
    for (int k = 0; k < 3; k++)
        if (e > 0.49 * half[k])
            e = 0.49 * half[k];
    for (int axis = 0; axis < 3; axis++) {
        double a = half[axis], b = half[(axis + 1) % 3], d = half[(axis + 2) % 3];
        for (int side = -1; side <= 1; side += 2) {
            double f = side, u = b - e, v = d - e; /* the face */
            struct vec3 q[4] = {along(axis, f * a, -f * u, -v), along(axis, f * a, f * u, -v),
                                along(axis, f * a, f * u, v), along(axis, f * a, -f * u, v)};
            shape_quad(s, vec3_add(c, q[0]), vec3_add(c, q[1]), vec3_add(c, q[2]),
                       vec3_add(c, q[3]));
            if (e <= 0)
                continue;
            for (int turn = -1; turn <= 1; turn += 2) { /* bevel towards the next axis */
                double g = turn;
                struct vec3 p[4] = {along(axis, f * a, g * u, -v), along(axis, f * u, 0, 0), flat,
                                    along(axis, f * a, g * u, v)};
                p[1] = along(axis, f * (a - e), g * b, -v);
                p[2] = along(axis, f * (a - e), g * b, v);
                if (f * g > 0)
                    shape_quad(s, vec3_add(c, p[0]), vec3_add(c, p[1]), vec3_add(c, p[2]),
                               vec3_add(c, p[3]));
                else
                    shape_quad(s, vec3_add(c, p[3]), vec3_add(c, p[2]), vec3_add(c, p[1]),
                               vec3_add(c, p[0]));
            }
        }
    }
    if (e <= 0)
        return;
    for (int i = 0; i < 8; i++) { /* corners */
        double sx = i & 1 ? 1 : -1, sy = i & 2 ? 1 : -1, sz = i & 4 ? 1 : -1;
        struct vec3 x = vec3_make(sx * h.x, sy * (h.y - e), sz * (h.z - e));
        struct vec3 y = vec3_make(sx * (h.x - e), sy * h.y, sz * (h.z - e));
        struct vec3 z = vec3_make(sx * (h.x - e), sy * (h.y - e), sz * h.z);
        if (sx * sy * sz > 0)
            shape_shard(s, vec3_add(c, x), vec3_add(c, y), vec3_add(c, z));
        else
            shape_shard(s, vec3_add(c, x), vec3_add(c, z), vec3_add(c, y));
    }
}

void shape_grid(const struct shaper *s, shape_surface *at, const void *ctx, int nu, int nv,
                unsigned flags) {
    size_t first_vertex = s->mesh->vertex_count, first_triangle = s->mesh->triangle_count;
    int cu = flags & SHAPE_CLOSED_U ? nu : nu + 1, cv = flags & SHAPE_CLOSED_V ? nv : nv + 1;
    uint32_t base = 0;
    for (int j = 0; j < cv; j++)
        for (int i = 0; i < cu; i++) {
            uint32_t v = put(s, at(ctx, (double)i / nu, (double)j / nv));
            if (i == 0 && j == 0)
                base = v;
        }
    for (int j = 0; j < nv; j++)
        for (int i = 0; i < nu; i++) {
            uint32_t i1 = (uint32_t)((i + 1) % cu), j1 = (uint32_t)((j + 1) % cv), w = (uint32_t)cu;
            uint32_t a = base + (uint32_t)j * w + (uint32_t)i, b = base + (uint32_t)j * w + i1;
            uint32_t c = base + j1 * w + i1, d = base + j1 * w + (uint32_t)i;
            mesh_triangle(s->mesh, a, b, c, s->part);
            mesh_triangle(s->mesh, a, c, d, s->part);
        }
    if (!(flags & SHAPE_FLAT))
        mesh_smooth(s->mesh, first_vertex, first_triangle);
}

/* One band of a lathe between two profile points. */
struct lathe_run {
    const struct vec2 *points;
    int count;
};

static struct vec3 lathe_at(const void *ctx, double u, double v) {
    const struct lathe_run *run = ctx;
    int i = (int)(v * (run->count - 1) + 0.5);
    double a = 2 * pi * u;
    return vec3_make(run->points[i].x * cos(a), run->points[i].x * sin(a), run->points[i].y);
}

void shape_lathe(const struct shaper *s, const struct vec2 *profile, int count, int segments) {
    const double sharp = cos(40 * pi / 180);
    int start = 0;
    for (int i = 1; i < count; i++) {
        int last = i == count - 1;
        if (!last) {
            double ax = profile[i].x - profile[i - 1].x, ay = profile[i].y - profile[i - 1].y;
            double bx = profile[i + 1].x - profile[i].x, by = profile[i + 1].y - profile[i].y;
            double dot = ax * bx + ay * by, norm = sqrt((ax * ax + ay * ay) * (bx * bx + by * by));
            if (norm <= 0 || dot > sharp * norm)
                continue;
        }
        struct lathe_run run = {profile + start, i - start + 1};
        shape_grid(s, lathe_at, &run, segments, i - start, SHAPE_CLOSED_U);
        start = i;
    }
}

/* A unit vector normal to d. */
static struct vec3 any_normal(struct vec3 d) {
    struct vec3 pick = fabs(d.z) < 0.9 ? vec3_make(0, 0, 1) : vec3_make(1, 0, 0);
    return vec3_unit(vec3_cross(d, pick));
}

void shape_tube(const struct shaper *s, const struct vec3 *path, const double *radius_m, int count,
                int segments) {
    if (count < 2)
        return;
    size_t first_vertex = s->mesh->vertex_count, first_triangle = s->mesh->triangle_count;
    struct vec3 side = any_normal(vec3_unit(vec3_sub(path[1], path[0])));
    uint32_t before = 0;
    for (int i = 0; i < count; i++) {
        struct vec3 d = vec3_sub(path[i + 1 < count ? i + 1 : i], path[i > 0 ? i - 1 : 0]);
        if (vec3_norm(d) < 1e-12)
            d = vec3_make(0, 0, 1);
        d = vec3_unit(d);
        side = vec3_madd(side, d, -vec3_dot(side, d)); /* carried along without twist */
        side = vec3_norm(side) > 1e-9 ? vec3_unit(side) : any_normal(d);
        struct vec3 other = vec3_cross(d, side);
        uint32_t ring = 0;
        for (int k = 0; k < segments; k++) {
            double a = 2 * pi * k / segments;
            struct vec3 p = vec3_madd(path[i], side, radius_m[i] * cos(a));
            uint32_t v = put(s, vec3_madd(p, other, radius_m[i] * sin(a)));
            ring = k == 0 ? v : ring;
        }
        for (int k = 0; i > 0 && k < segments; k++) {
            uint32_t k0 = (uint32_t)k, k1 = (uint32_t)((k + 1) % segments);
            mesh_triangle(s->mesh, before + k0, before + k1, ring + k1, s->part);
            mesh_triangle(s->mesh, before + k0, ring + k1, ring + k0, s->part);
        }
        if (i == 0 || i == count - 1) {
            for (int k = 1; k + 1 < segments; k++) {
                uint32_t k0 = (uint32_t)k;
                if (i == 0)
                    mesh_triangle(s->mesh, ring, ring + k0 + 1, ring + k0, s->part);
                else
                    mesh_triangle(s->mesh, ring, ring + k0, ring + k0 + 1, s->part);
            }
        }
        before = ring;
    }
    mesh_smooth(s->mesh, first_vertex, first_triangle);
}

void shape_bar(const struct shaper *s, struct vec3 a, struct vec3 b, double radius_m,
               int segments) {
    struct vec3 path[2] = {a, b};
    double radius[2] = {radius_m, radius_m};
    shape_tube(s, path, radius, 2, segments);
}

struct ellipsoid {
    struct vec3 centre, radii;
};

static struct vec3 ellipsoid_at(const void *ctx, double u, double v) {
    const struct ellipsoid *e = ctx;
    double a = 2 * pi * u, b = pi * (v - 0.5);
    return vec3_add(e->centre, vec3_make(e->radii.x * cos(b) * cos(a), e->radii.y * cos(b) * sin(a),
                                         e->radii.z * sin(b)));
}

void shape_ellipsoid(const struct shaper *s, struct vec3 centre, struct vec3 radii, int segments) {
    struct ellipsoid e = {centre, radii};
    shape_grid(s, ellipsoid_at, &e, segments, segments / 2 > 2 ? segments / 2 : 2, SHAPE_CLOSED_U);
}

static double corner_area(struct vec2 a, struct vec2 b, struct vec2 c) {
    return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

static int inside(struct vec2 p, struct vec2 a, struct vec2 b, struct vec2 c) {
    return corner_area(a, b, p) >= 0 && corner_area(b, c, p) >= 0 && corner_area(c, a, p) >= 0;
}

/* Fills a simple polygon by cutting ears. */
static void fill(const struct shaper *s, const struct vec2 *o, int count, double z, int up) {
    int left[256];
    if (count > 256 || count < 3)
        return;
    for (int i = 0; i < count; i++)
        left[i] = i;
    for (int n = count; n >= 3;) {
        int cut = -1;
        for (int i = 0; i < n && cut < 0; i++) {
            struct vec2 a = o[left[(i + n - 1) % n]], b = o[left[i]], c = o[left[(i + 1) % n]];
            int ear = corner_area(a, b, c) > 0;
            for (int k = 0; ear && k < n; k++)
                if (k != i && k != (i + 1) % n && k != (i + n - 1) % n &&
                    inside(o[left[k]], a, b, c))
                    ear = 0;
            cut = ear ? i : -1;
        }
        if (cut < 0)
            return; /* not simple: what is filled stays */
        struct vec2 a = o[left[(cut + n - 1) % n]], b = o[left[cut]], c = o[left[(cut + 1) % n]];
        struct vec3 p = vec3_make(a.x, a.y, z), q = vec3_make(b.x, b.y, z),
                    r = vec3_make(c.x, c.y, z);
        shape_shard(s, p, up ? q : r, up ? r : q);
        for (int k = cut; k + 1 < n; k++)
            left[k] = left[k + 1];
        n--;
    }
}

void shape_prism(const struct shaper *s, const struct vec2 *outline, int count, double z0_m,
                 double z1_m) {
    fill(s, outline, count, z1_m, 1);
    fill(s, outline, count, z0_m, 0);
    for (int i = 0; i < count; i++) {
        struct vec2 a = outline[i], b = outline[(i + 1) % count];
        shape_quad(s, vec3_make(a.x, a.y, z0_m), vec3_make(b.x, b.y, z0_m),
                   vec3_make(b.x, b.y, z1_m), vec3_make(a.x, a.y, z1_m));
    }
}
