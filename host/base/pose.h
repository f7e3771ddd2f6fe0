/* Rigid poses. `a_from_b` takes coordinates in frame b to frame a, so that frames cancel when read from
 * left to right: a_from_c = a_from_b * b_from_c. */
#ifndef SC_BASE_POSE_H
#define SC_BASE_POSE_H

#include "base/st.h"
#include "base/vec.h"

#ifdef __cplusplus
extern "C" {
#endif

/* p_a = r p_b + t_m; r is a rotation (orthonormal, determinant +1), t_m the origin of b seen in a. */
struct pose {
    struct mat3 r;
    struct vec3 t_m;
};

struct pose pose_identity(void);

/* r p + t */
static inline struct vec3 pose_apply(const struct pose *a_from_b, struct vec3 p_b) {
    return vec3_add(mat3_mulv(&a_from_b->r, p_b), a_from_b->t_m);
}

/* a_from_c = a_from_b * b_from_c */
struct pose pose_compose(const struct pose *a_from_b, const struct pose *b_from_c);

/* b_from_a */
struct pose pose_inverse(const struct pose *a_from_b);

/* The same as a homogeneous 4x4. */
struct mat4 pose_to_mat4(const struct pose *a_from_b);

/* Rotation vector (axis * angle, rad) to matrix and back. so3_log is accurate to 1e-12 rad from 0 to pi,
 * at pi it picks the axis whose largest component is positive. (Rodrigues.) */
struct mat3 so3_exp(struct vec3 w_rad);
struct vec3 so3_log(const struct mat3 *r);

/* Twist (rotation vector w, translation part v) to pose and back: pose = exp([w v]). Series near 0, so
 * it holds from 0 to pi. (Murray, Li, Sastry 1994, eq. 2.36.) */
struct pose se3_exp(struct vec3 w_rad, struct vec3 v_m);
void se3_log(const struct pose *a_from_b, struct vec3 *out_w_rad, struct vec3 *out_v_m);

/* Unit quaternion (x, y, z, w) to rotation; the quaternion is normalised. ST_SINGULAR if its norm is not
 * finite or below 1e-12. */
ST_MUST_CHECK enum st pose_rotation_from_quat(double x, double y, double z, double w, struct mat3 *out_r);

/* Camera pose world_from_cam (cam: x right, y down, z forward) at eye_m looking at target_m, with up_w
 * upward in the picture. ST_SINGULAR if the eye is the target or up is parallel to the view. */
ST_MUST_CHECK enum st pose_look_at(struct vec3 eye_m, struct vec3 target_m, struct vec3 up_w,
                                   struct pose *out_world_from_cam);

/* Largest deviation of r from a rotation: max |R^T R - I|, and |det - 1|. */
double pose_orthonormality_error(const struct mat3 *r);

/* Nearest rotation in the least-squares sense by Newton iteration of the polar decomposition (Higham
 * 1986). ST_SINGULAR if r is singular or a reflection. */
ST_MUST_CHECK enum st pose_orthonormalise(const struct mat3 *r, struct mat3 *out_r);

#ifdef __cplusplus
}
#endif
#endif
