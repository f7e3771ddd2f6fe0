#include "twin/trace.h"

/* Embree's headers use C11 atomics-free plain C, but not prototypes with void. */
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wstrict-prototypes"
#pragma GCC diagnostic ignored "-Wpedantic"
#pragma GCC diagnostic ignored "-Wconversion"
#include <embree3/rtcore.h>
#pragma GCC diagnostic pop

#include <stdlib.h>
#include <string.h>
#ifdef __SSE__
#include <xmmintrin.h>
#endif

struct trace {
    RTCDevice device;
    RTCScene scene;
    const struct mesh *mesh;
    struct trace_sphere *spheres;
    size_t sphere_count;
    unsigned triangle_geometry, sphere_geometry; /* RTC_INVALID_GEOMETRY_ID if there are none */
};

static enum st embree_failed(RTCDevice device, struct errctx *err) {
    enum RTCError error = rtcGetDeviceError(device);
    if (error == RTC_ERROR_OUT_OF_MEMORY)
        return errctx_set(err, ST_NOMEM, "ray casting: out of memory");
    return errctx_set(err, ST_INTERNAL, "ray casting: Embree error %d", (int)error);
}

static enum st attach_triangles(struct trace *t, struct errctx *err) {
    const struct mesh *mesh = t->mesh;
    RTCGeometry g = rtcNewGeometry(t->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    if (!g)
        return embree_failed(t->device, err);
    /* A shared buffer would have to be padded; Embree keeps its own copy. */
    float *position = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                              3 * sizeof(float), mesh->vertex_count);
    uint32_t *corner = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                               3 * sizeof(uint32_t), mesh->triangle_count);
    if (!position || !corner) {
        rtcReleaseGeometry(g);
        return embree_failed(t->device, err);
    }
    memcpy(position, mesh->position_m, 3 * sizeof(float) * mesh->vertex_count);
    memcpy(corner, mesh->corner, 3 * sizeof(uint32_t) * mesh->triangle_count);
    rtcCommitGeometry(g);
    t->triangle_geometry = rtcAttachGeometry(t->scene, g);
    rtcReleaseGeometry(g);
    return ST_OK;
}

static enum st attach_spheres(struct trace *t, struct errctx *err) {
    RTCGeometry g = rtcNewGeometry(t->device, RTC_GEOMETRY_TYPE_SPHERE_POINT);
    if (!g)
        return embree_failed(t->device, err);
    float *point = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT4,
                                           4 * sizeof(float), t->sphere_count);
    if (!point) {
        rtcReleaseGeometry(g);
        return embree_failed(t->device, err);
    }
    for (size_t i = 0; i < t->sphere_count; i++) {
        point[4 * i] = (float)t->spheres[i].centre_m.x;
        point[4 * i + 1] = (float)t->spheres[i].centre_m.y;
        point[4 * i + 2] = (float)t->spheres[i].centre_m.z;
        point[4 * i + 3] = (float)t->spheres[i].radius_m;
    }
    rtcCommitGeometry(g);
    t->sphere_geometry = rtcAttachGeometry(t->scene, g);
    rtcReleaseGeometry(g);
    return ST_OK;
}

static enum st build(struct trace *t, const struct trace_sphere *spheres, struct errctx *err) {
    if (t->sphere_count) {
        t->spheres = malloc(t->sphere_count * sizeof *t->spheres);
        if (!t->spheres)
            return errctx_set(err, ST_NOMEM, "ray casting: out of memory");
        memcpy(t->spheres, spheres, t->sphere_count * sizeof *t->spheres);
    }
    /* One thread: a parallel build orders primitives by chance, and with it who wins where two
     * touch. */
    t->device = rtcNewDevice("threads=1");
    if (!t->device)
        return embree_failed(NULL, err);
    t->scene = rtcNewScene(t->device);
    if (!t->scene)
        return embree_failed(t->device, err);
    /* Robust: no ray slips between two triangles that share an edge. */
    rtcSetSceneFlags(t->scene, RTC_SCENE_FLAG_ROBUST);
    enum st st = ST_OK;
    if (t->mesh->triangle_count)
        st = attach_triangles(t, err);
    if (!st && t->sphere_count)
        st = attach_spheres(t, err);
    if (st)
        return st;
    rtcCommitScene(t->scene);
    return rtcGetDeviceError(t->device) == RTC_ERROR_NONE
               ? ST_OK
               : errctx_set(err, ST_NOMEM,
                            "ray casting: cannot build the hierarchy of %zu triangles",
                            t->mesh->triangle_count);
}

enum st trace_create(const struct mesh *mesh, const struct trace_sphere *spheres,
                     size_t sphere_count, struct trace **out_trace, struct errctx *err) {
    if (!mesh->triangle_count && !sphere_count)
        return errctx_set(err, ST_INVALID, "the scene has no surface");
    struct trace *t = calloc(1, sizeof *t);
    if (!t)
        return errctx_set(err, ST_NOMEM, "ray casting: out of memory");
    t->mesh = mesh;
    t->sphere_count = sphere_count;
    t->triangle_geometry = t->sphere_geometry = RTC_INVALID_GEOMETRY_ID;
    enum st st = build(t, spheres, err);
    if (st) {
        trace_destroy(t);
        return st;
    }
    *out_trace = t;
    return ST_OK;
}

void trace_destroy(struct trace *trace) {
    if (!trace)
        return;
    if (trace->scene)
        rtcReleaseScene(trace->scene);
    if (trace->device)
        rtcReleaseDevice(trace->device);
    free(trace->spheres);
    free(trace);
}

/* Normals on the ray's side. */
static void face_ray(struct trace_hit *hit, struct vec3 dir) {
    hit->inside = vec3_dot(hit->normal, dir) > 0;
    if (hit->inside) {
        hit->normal = vec3_scale(hit->normal, -1);
        hit->shading = vec3_scale(hit->shading, -1);
    }
    if (vec3_dot(hit->shading, dir) >
        -1e-3) { /* interpolation bent it away: no light from behind */
        struct vec3 s = vec3_madd(hit->shading, dir, -vec3_dot(hit->shading, dir) - 1e-3);
        double norm = vec3_norm(s);
        hit->shading = norm > 1e-6 ? vec3_scale(s, 1 / norm) : hit->normal;
    }
}

/* The exact point on a triangle's plane; t_float is Embree's, used where the ray lies in the plane.
 */
static void refine_triangle(const struct trace *trace, const struct trace_ray *ray,
                            uint32_t triangle, double t_float, struct trace_hit *out) {
    const struct mesh *mesh = trace->mesh;
    const uint32_t *corner = mesh->corner + 3 * (size_t)triangle;
    struct vec3 a = mesh_position(mesh, corner[0]);
    struct vec3 e1 = vec3_sub(mesh_position(mesh, corner[1]), a);
    struct vec3 e2 = vec3_sub(mesh_position(mesh, corner[2]), a);
    struct vec3 n = vec3_cross(e1, e2);
    double area2 = vec3_norm(n), along = vec3_dot(n, ray->dir);
    struct vec3 to = vec3_sub(a, ray->origin_m);
    double t = fabs(along) > 1e-12 * area2 ? vec3_dot(n, to) / along : t_float;
    out->t_m = t;
    out->p_m = vec3_madd(ray->origin_m, ray->dir, t);
    out->part = mesh->part[triangle];
    out->normal = area2 > 0 ? vec3_scale(n, 1 / area2) : vec3_scale(ray->dir, -1);
    /* barycentric coordinates by areas */
    struct vec3 q = vec3_sub(out->p_m, a);
    double inv = area2 > 0 ? 1 / (area2 * area2) : 0;
    double u = vec3_dot(vec3_cross(q, e2), n) * inv, v = vec3_dot(vec3_cross(e1, q), n) * inv;
    const float *n0 = mesh->normal + 3 * (size_t)corner[0],
                *n1 = mesh->normal + 3 * (size_t)corner[1];
    const float *n2 = mesh->normal + 3 * (size_t)corner[2];
    double w = 1 - u - v;
    struct vec3 s = vec3_make(w * (double)n0[0] + u * (double)n1[0] + v * (double)n2[0],
                              w * (double)n0[1] + u * (double)n1[1] + v * (double)n2[1],
                              w * (double)n0[2] + u * (double)n1[2] + v * (double)n2[2]);
    double norm = vec3_norm(s);
    out->shading = norm > 0.1 ? vec3_scale(s, 1 / norm) : out->normal;
    if (vec3_dot(out->shading, out->normal) < 0)
        out->shading = vec3_scale(out->shading, -1);
    face_ray(out, ray->dir);
}

static void refine_sphere(const struct trace *trace, const struct trace_ray *ray, uint32_t number,
                          double t_float, struct trace_hit *out) {
    const struct trace_sphere *s = &trace->spheres[number];
    struct vec3 oc = vec3_sub(ray->origin_m, s->centre_m);
    double b = vec3_dot(oc, ray->dir), c = vec3_dot(oc, oc) - s->radius_m * s->radius_m;
    double d = b * b - c, root = sqrt(d > 0 ? d : 0);
    double near = -b - root, far = -b + root;
    out->t_m = fabs(near - t_float) <= fabs(far - t_float) ? near : far;
    out->p_m = vec3_madd(ray->origin_m, ray->dir, out->t_m);
    out->part = s->part;
    out->normal = vec3_scale(vec3_sub(out->p_m, s->centre_m), 1 / s->radius_m);
    out->shading = out->normal;
    face_ray(out, ray->dir);
    out->inside = out->inside != s->hollow;
}

static void refine(const struct trace *trace, const struct trace_ray *ray, unsigned geometry,
                   unsigned primitive, double t_float, struct trace_hit *out) {
    if (geometry == trace->triangle_geometry)
        refine_triangle(trace, ray, primitive, t_float, out);
    else
        refine_sphere(trace, ray, primitive, t_float, out);
}

/* Embree wants denormals flushed to zero; set and restored around each call so that the caller's
 * doubles keep theirs. */
static unsigned enter(void) {
#ifdef __SSE__
    unsigned before = _mm_getcsr();
    _mm_setcsr(before | 0x8040u); /* flush results to zero, take operands as zero */
    return before;
#else
    return 0;
#endif
}

static void leave(unsigned before) {
#ifdef __SSE__
    _mm_setcsr(before);
#else
    (void)before;
#endif
}

static float upper(double t_max_m) {
    return t_max_m > 1e30 ? 1e30f : (float)t_max_m;
}

bool trace_first(const struct trace *trace, const struct trace_ray *ray,
                 struct trace_hit *out_hit) {
    struct RTCRayHit r;
    memset(&r, 0, sizeof r);
    r.ray.org_x = (float)ray->origin_m.x;
    r.ray.org_y = (float)ray->origin_m.y;
    r.ray.org_z = (float)ray->origin_m.z;
    r.ray.dir_x = (float)ray->dir.x;
    r.ray.dir_y = (float)ray->dir.y;
    r.ray.dir_z = (float)ray->dir.z;
    r.ray.tnear = (float)ray->t_min_m;
    r.ray.tfar = upper(ray->t_max_m);
    r.ray.mask = 0xffffffffu;
    r.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    unsigned csr = enter();
    rtcIntersect1(trace->scene, &context, &r);
    leave(csr);
    if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID)
        return false;
    refine(trace, ray, r.hit.geomID, r.hit.primID, (double)r.ray.tfar, out_hit);
    return true;
}

unsigned trace_first4(const struct trace *trace, const struct trace_ray *rays, int count,
                      struct trace_hit *out_hits) {
    struct RTCRayHit4 r;
    memset(&r, 0, sizeof r);
    _Alignas(16) int valid[4] = {0, 0, 0, 0};
    for (int i = 0; i < count && i < 4; i++) {
        valid[i] = -1;
        r.ray.org_x[i] = (float)rays[i].origin_m.x;
        r.ray.org_y[i] = (float)rays[i].origin_m.y;
        r.ray.org_z[i] = (float)rays[i].origin_m.z;
        r.ray.dir_x[i] = (float)rays[i].dir.x;
        r.ray.dir_y[i] = (float)rays[i].dir.y;
        r.ray.dir_z[i] = (float)rays[i].dir.z;
        r.ray.tnear[i] = (float)rays[i].t_min_m;
        r.ray.tfar[i] = upper(rays[i].t_max_m);
        r.ray.mask[i] = 0xffffffffu;
        r.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    }
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    unsigned csr = enter();
    rtcIntersect4(valid, trace->scene, &context, &r);
    leave(csr);
    unsigned hits = 0;
    for (int i = 0; i < count && i < 4; i++) {
        if (r.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID)
            continue;
        refine(trace, &rays[i], r.hit.geomID[i], r.hit.primID[i], (double)r.ray.tfar[i],
               &out_hits[i]);
        hits |= 1u << i;
    }
    return hits;
}

bool trace_blocked(const struct trace *trace, const struct trace_ray *ray) {
    struct RTCRay r;
    memset(&r, 0, sizeof r);
    r.org_x = (float)ray->origin_m.x;
    r.org_y = (float)ray->origin_m.y;
    r.org_z = (float)ray->origin_m.z;
    r.dir_x = (float)ray->dir.x;
    r.dir_y = (float)ray->dir.y;
    r.dir_z = (float)ray->dir.z;
    r.tnear = (float)ray->t_min_m;
    r.tfar = upper(ray->t_max_m);
    r.mask = 0xffffffffu;
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    unsigned csr = enter();
    rtcOccluded1(trace->scene, &context, &r);
    leave(csr);
    return r.tfar < 0;
}
