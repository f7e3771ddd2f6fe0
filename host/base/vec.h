/* Small vectors and matrices, double, by value. Matrices are row-major, vectors are columns. Everything is
 * inline, allocates nothing and is safe on the real-time path. */
#ifndef SC_BASE_VEC_H
#define SC_BASE_VEC_H

#include <math.h>
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

struct vec2 {
    double x, y;
};
struct vec3 {
    double x, y, z;
};
struct vec4 {
    double x, y, z, w;
};
struct mat3 {
    double m[9];
};
struct mat4 {
    double m[16];
};

static inline struct vec3 vec3_make(double x, double y, double z) {
    struct vec3 v = {x, y, z};
    return v;
}
static inline struct vec3 vec3_add(struct vec3 a, struct vec3 b) {
    return vec3_make(a.x + b.x, a.y + b.y, a.z + b.z);
}
static inline struct vec3 vec3_sub(struct vec3 a, struct vec3 b) {
    return vec3_make(a.x - b.x, a.y - b.y, a.z - b.z);
}
static inline struct vec3 vec3_scale(struct vec3 a, double s) {
    return vec3_make(a.x * s, a.y * s, a.z * s);
}
/* a + s b */
static inline struct vec3 vec3_madd(struct vec3 a, struct vec3 b, double s) {
    return vec3_make(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z);
}
static inline double vec3_dot(struct vec3 a, struct vec3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
static inline struct vec3 vec3_cross(struct vec3 a, struct vec3 b) {
    return vec3_make(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static inline double vec3_norm(struct vec3 a) {
    return sqrt(vec3_dot(a, a));
}
/* a / |a|; the zero vector gives NaN components, which is what an undefined direction is. */
static inline struct vec3 vec3_unit(struct vec3 a) {
    return vec3_scale(a, 1.0 / vec3_norm(a));
}
static inline bool vec3_is_finite(struct vec3 a) {
    return isfinite(a.x) && isfinite(a.y) && isfinite(a.z);
}

static inline struct mat3 mat3_identity(void) {
    struct mat3 a = {{1, 0, 0, 0, 1, 0, 0, 0, 1}};
    return a;
}
static inline struct vec3 mat3_mulv(const struct mat3 *a, struct vec3 v) {
    return vec3_make(a->m[0] * v.x + a->m[1] * v.y + a->m[2] * v.z,
                     a->m[3] * v.x + a->m[4] * v.y + a->m[5] * v.z,
                     a->m[6] * v.x + a->m[7] * v.y + a->m[8] * v.z);
}
static inline struct vec3 mat3_tmulv(const struct mat3 *a, struct vec3 v) {
    return vec3_make(a->m[0] * v.x + a->m[3] * v.y + a->m[6] * v.z,
                     a->m[1] * v.x + a->m[4] * v.y + a->m[7] * v.z,
                     a->m[2] * v.x + a->m[5] * v.y + a->m[8] * v.z);
}
static inline struct mat3 mat3_mul(const struct mat3 *a, const struct mat3 *b) {
    struct mat3 c;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            c.m[3 * i + j] = a->m[3 * i] * b->m[j] + a->m[3 * i + 1] * b->m[3 + j] +
                             a->m[3 * i + 2] * b->m[6 + j];
    return c;
}
static inline struct mat3 mat3_transpose(const struct mat3 *a) {
    struct mat3 t = {{a->m[0], a->m[3], a->m[6], a->m[1], a->m[4], a->m[7], a->m[2], a->m[5], a->m[8]}};
    return t;
}
static inline double mat3_det(const struct mat3 *a) {
    const double *m = a->m;
    return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
           m[2] * (m[3] * m[7] - m[4] * m[6]);
}

static inline struct mat4 mat4_identity(void) {
    struct mat4 a = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}};
    return a;
}
static inline struct vec4 mat4_mulv(const struct mat4 *a, struct vec4 v) {
    const double *m = a->m;
    struct vec4 r = {m[0] * v.x + m[1] * v.y + m[2] * v.z + m[3] * v.w,
                     m[4] * v.x + m[5] * v.y + m[6] * v.z + m[7] * v.w,
                     m[8] * v.x + m[9] * v.y + m[10] * v.z + m[11] * v.w,
                     m[12] * v.x + m[13] * v.y + m[14] * v.z + m[15] * v.w};
    return r;
}
static inline struct mat4 mat4_mul(const struct mat4 *a, const struct mat4 *b) {
    struct mat4 c;
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            c.m[4 * i + j] = a->m[4 * i] * b->m[j] + a->m[4 * i + 1] * b->m[4 + j] +
                             a->m[4 * i + 2] * b->m[8 + j] + a->m[4 * i + 3] * b->m[12 + j];
    return c;
}

#ifdef __cplusplus
}
#endif
#endif
