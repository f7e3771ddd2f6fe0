#include "base/pose.h"

#include <float.h>

struct pose pose_identity(void) {
    struct pose p = {mat3_identity(), {0, 0, 0}};
    return p;
}

struct pose pose_compose(const struct pose *a_from_b, const struct pose *b_from_c) {
    struct pose a_from_c = {mat3_mul(&a_from_b->r, &b_from_c->r),
                            pose_apply(a_from_b, b_from_c->t_m)};
    return a_from_c;
}

struct pose pose_inverse(const struct pose *a_from_b) {
    struct pose b_from_a = {mat3_transpose(&a_from_b->r),
                            vec3_scale(mat3_tmulv(&a_from_b->r, a_from_b->t_m), -1.0)};
    return b_from_a;
}

struct mat4 pose_to_mat4(const struct pose *a_from_b) {
    const double *r = a_from_b->r.m;
    struct vec3 t = a_from_b->t_m;
    struct mat4 h = {
        {r[0], r[1], r[2], t.x, r[3], r[4], r[5], t.y, r[6], r[7], r[8], t.z, 0, 0, 0, 1}};
    return h;
}

/* a I + b K + c K^2, K = [w]x. K^2 = w w^T - |w|^2 I. */
static struct mat3 skew_polynomial(double a, double b, double c, struct vec3 w) {
    double s = a - c * vec3_dot(w, w);
    struct mat3 p = {{s + c * w.x * w.x, c * w.x * w.y - b * w.z, c * w.x * w.z + b * w.y,
                      c * w.x * w.y + b * w.z, s + c * w.y * w.y, c * w.y * w.z - b * w.x,
                      c * w.x * w.z - b * w.y, c * w.y * w.z + b * w.x, s + c * w.z * w.z}};
    return p;
}

/* sin(t)/t without a division by zero; the quotient itself loses nothing for small t. */
static double sinc(double t) {
    return t > 0.0 ? sin(t) / t : 1.0;
}

/* (1 - cos t)/t^2 = (sin(t/2)/(t/2))^2 / 2: no cancellation. */
static double half_versine_ratio(double t) {
    double q = sinc(0.5 * t);
    return 0.5 * q * q;
}

/* (t - sin t)/t^3. Below 0.5 the difference cancels: Taylor series to 1e-16. */
static double sine_defect_ratio(double t) {
    double s = t * t;
    if (t > 0.5)
        return (t - sin(t)) / (s * t);
    return 1.0 / 6 -
           s * (1.0 / 120 -
                s * (1.0 / 5040 - s * (1.0 / 362880 - s * (1.0 / 39916800 - s / 6227020800.0))));
}

/* (1 - (t/2) cot(t/2))/t^2. Below 0.25: Taylor series to 1e-15. */
static double cot_defect_ratio(double t) {
    double s = t * t;
    if (t > 0.25)
        return (1.0 - 0.5 * t * cos(0.5 * t) / sin(0.5 * t)) / s;
    return 1.0 / 12 + s * (1.0 / 720 + s * (1.0 / 30240 + s * (1.0 / 1209600 + s / 47900160.0)));
}

struct mat3 so3_exp(struct vec3 w_rad) {
    double t = vec3_norm(w_rad);
    return skew_polynomial(1.0, sinc(t), half_versine_ratio(t), w_rad);
}

/* Unit quaternion, scalar part last, from the largest of its four components (Shepperd 1978): no
 * cancellation at any angle. */
static struct vec4 quat_from_rotation(const struct mat3 *r) {
    const double *m = r->m;
    double trace = m[0] + m[4] + m[8];
    struct vec4 q;
    if (trace >= m[0] && trace >= m[4] && trace >= m[8]) {
        q = (struct vec4){m[7] - m[5], m[2] - m[6], m[3] - m[1], 1.0 + trace};
    } else if (m[0] >= m[4] && m[0] >= m[8]) {
        q = (struct vec4){1.0 + m[0] - m[4] - m[8], m[1] + m[3], m[2] + m[6], m[7] - m[5]};
    } else if (m[4] >= m[8]) {
        q = (struct vec4){m[1] + m[3], 1.0 - m[0] + m[4] - m[8], m[5] + m[7], m[2] - m[6]};
    } else {
        q = (struct vec4){m[2] + m[6], m[5] + m[7], 1.0 - m[0] - m[4] + m[8], m[3] - m[1]};
    }
    double k = 1.0 / sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
    return (struct vec4){k * q.x, k * q.y, k * q.z, k * q.w};
}

/* Of v and -v the one whose component of largest magnitude is positive. */
static struct vec3 vec3_canonical(struct vec3 v) {
    double ax = fabs(v.x), ay = fabs(v.y), az = fabs(v.z);
    double largest = ax >= ay && ax >= az ? v.x : ay >= az ? v.y : v.z;
    return largest < 0.0 ? vec3_scale(v, -1.0) : v;
}

struct vec3 so3_log(const struct mat3 *r) {
    /* Half a rotation turn is recognised when cos(angle/2) is within rounding of 0. */
    const double half_turn_tolerance = 8 * DBL_EPSILON;
    struct vec4 q = quat_from_rotation(r);
    struct vec3 v = {q.x, q.y, q.z};
    double w = q.w;
    if (fabs(w) < half_turn_tolerance) {
        v = vec3_canonical(v);
        w = fabs(w);
    } else if (w < 0.0) {
        v = vec3_scale(v, -1.0);
        w = -w;
    }
    double n = vec3_norm(v); /* sin(angle/2) */
    if (n == 0.0)            /* below the square root of the smallest double too: angle = 2 v */
        return vec3_scale(v, 2.0);
    return vec3_scale(v, 2.0 * atan2(n, w) / n);
}

struct pose se3_exp(struct vec3 w_rad, struct vec3 v_m) {
    double t = vec3_norm(w_rad);
    struct mat3 v = skew_polynomial(1.0, half_versine_ratio(t), sine_defect_ratio(t), w_rad);
    struct pose p = {so3_exp(w_rad), mat3_mulv(&v, v_m)};
    return p;
}

void se3_log(const struct pose *a_from_b, struct vec3 *out_w_rad, struct vec3 *out_v_m) {
    struct vec3 w = so3_log(&a_from_b->r);
    struct mat3 v_inv = skew_polynomial(1.0, -0.5, cot_defect_ratio(vec3_norm(w)), w);
    *out_v_m = mat3_mulv(&v_inv, a_from_b->t_m);
    *out_w_rad = w;
}

enum st pose_rotation_from_quat(double x, double y, double z, double w, struct mat3 *out_r) {
    const double norm_min = 1e-12;
    double n = sqrt(x * x + y * y + z * z + w * w);
    if (!isfinite(n) || n < norm_min)
        return ST_SINGULAR;
    x /= n;
    y /= n;
    z /= n;
    w /= n;
    struct mat3 r = {{1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
                      2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                      2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)}};
    *out_r = r;
    return ST_OK;
}

enum st pose_look_at(struct vec3 eye_m, struct vec3 target_m, struct vec3 up_w,
                     struct pose *out_world_from_cam) {
    const double sine_min = 1e-9; /* of the angle between view and up */
    struct vec3 z = vec3_unit(vec3_sub(target_m, eye_m));
    struct vec3 x = vec3_cross(z, vec3_unit(up_w));
    double sine = vec3_norm(x);
    if (!(sine > sine_min) || !vec3_is_finite(x) || !vec3_is_finite(eye_m)) /* NaN included */
        return ST_SINGULAR;
    x = vec3_scale(x, 1.0 / sine);
    struct vec3 y = vec3_cross(z, x);
    struct pose p = {{{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}}, eye_m};
    *out_world_from_cam = p;
    return ST_OK;
}

double pose_orthonormality_error(const struct mat3 *r) {
    struct mat3 t = mat3_transpose(r);
    struct mat3 p = mat3_mul(&t, r);
    double worst = fabs(mat3_det(r) - 1.0), sum = worst;
    for (int i = 0; i < 9; i++) {
        double e = fabs(p.m[i] - (i % 4 == 0 ? 1.0 : 0.0));
        worst = e > worst ? e : worst;
        sum += e;
    }
    return isnan(sum) ? sum : worst; /* NaN is the worst */
}

/* The inverse of the transpose: rows are cross products over the determinant. */
static struct mat3 inverse_transpose(const struct mat3 *a, double det) {
    struct vec3 r0 = {a->m[0], a->m[1], a->m[2]};
    struct vec3 r1 = {a->m[3], a->m[4], a->m[5]};
    struct vec3 r2 = {a->m[6], a->m[7], a->m[8]};
    struct vec3 c0 = vec3_scale(vec3_cross(r1, r2), 1.0 / det);
    struct vec3 c1 = vec3_scale(vec3_cross(r2, r0), 1.0 / det);
    struct vec3 c2 = vec3_scale(vec3_cross(r0, r1), 1.0 / det);
    struct mat3 it = {{c0.x, c0.y, c0.z, c1.x, c1.y, c1.z, c2.x, c2.y, c2.z}};
    return it;
}

enum st pose_orthonormalise(const struct mat3 *r, struct mat3 *out_r) {
    enum { MAX_STEPS = 64 };
    const double relative_det_min = 1e-12; /* of |r|^3: below, the nearest rotation is a guess */
    const double converged = 4 * DBL_EPSILON;
    double norm2 = 0.0;
    for (int i = 0; i < 9; i++)
        norm2 += r->m[i] * r->m[i];
    double norm = sqrt(norm2);
    if (!isfinite(norm) || !(norm > 0.0))
        return ST_SINGULAR;
    struct mat3 x;
    for (int i = 0; i < 9; i++) /* the polar factor does not depend on the scale */
        x.m[i] = r->m[i] / norm;
    if (!(mat3_det(&x) > relative_det_min))
        return ST_SINGULAR;
    for (int step = 0; step < MAX_STEPS; step++) {
        /* X <- (X + X^-T) / 2 */
        struct mat3 it = inverse_transpose(&x, mat3_det(&x));
        double change = 0.0;
        for (int i = 0; i < 9; i++) {
            double next = 0.5 * (x.m[i] + it.m[i]);
            change = fmax(change, fabs(next - x.m[i]));
            x.m[i] = next;
        }
        if (change <= converged) {
            *out_r = x;
            return ST_OK;
        }
    }
    return ST_SINGULAR;
}
