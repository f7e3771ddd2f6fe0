/* Camera model: pinhole with Brown-Conrady distortion (Brown 1971): radial k1 k2 k3, tangential p1
 * p2. Frame `cam`: x right, y down, z forward. Pixel (0,0) is the centre of the top-left pixel.
 *
 * Model. With x = X/Z, y = Y/Z, s = x^2 + y^2:
 *   g  = 1 + k1 s + k2 s^2 + k3 s^3
 *   x' = x g + 2 p1 x y + p2 (s + 2 x^2)
 *   y' = y g + p1 (s + 2 y^2) + 2 p2 x y
 *   u  = fx x' + cx,  v = fy y' + cy
 *
 * Domain. Z > 0 and s <= s_max = r_max^2. r_max is the first r > 0 (infinity if none below 1e8)
 * where min(d(r g)/dr, g) = 6 |(p1, p2)| r, without tangential distortion the first stationary
 * point of the radial map r g(r^2). Up to there the map's (symmetric) Jacobian is positive
 * definite, so that a pixel has one ray; beyond, it may have several and the model refuses. */
#ifndef SC_BASE_CAMERA_H
#define SC_BASE_CAMERA_H

#include "base/st.h"
#include "base/vec.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct camera {
    int32_t width_px, height_px;
    double fx_px, fy_px, cx_px, cy_px;
    double k1, k2, p1, p2, k3; /* all 0: a plain pinhole */
};

/* Pinhole with square pixels, the given horizontal field of view, principal point at the centre. */
struct camera camera_pinhole(int32_t width_px, int32_t height_px, double hfov_rad);

/* True if all distortion coefficients are 0. */
bool camera_is_pinhole(const struct camera *cam);

/* ST_INVALID with a reason unless sizes are in 1..65536, focal lengths positive and everything
 * finite. */
ST_MUST_CHECK enum st camera_check(const struct camera *cam, struct errctx *err);

/* s_max of the domain (see above), in squared normalised coordinates; INFINITY where unbounded.
 * Cost: the first positive root of two polynomials of degree 6, some 50 us, once for each camera in
 * a row that a thread asks for. */
double camera_s_max(const struct camera *cam);

/* Point in cam (metres, any positive scale) to pixel. out_dq_dp, if not NULL, is 2x3 row-major,
 * px/m. ST_DOMAIN behind the camera or beyond s_max. No allocation. */
ST_MUST_CHECK enum st camera_project(const struct camera *cam, struct vec3 p_cam,
                                     struct vec2 *out_q_px, double out_dq_dp[6]);

/* Pixel to the ray (x, y, 1). out_dr_dq, if not NULL, is 2x2 row-major: d(x, y) / d(u, v), 1/px.
 * Newton from a fixed-point start, damped within the domain where that fails, to 1e-12; ST_DOMAIN
 * where no ray of the domain projects there. */
ST_MUST_CHECK enum st camera_unproject(const struct camera *cam, struct vec2 q_px,
                                       struct vec3 *out_ray, double out_dr_dq[4]);

/* The pinhole ray K^-1 [u v 1]^T, ignoring distortion: what an undistorted photograph uses. */
static inline struct vec3 camera_pinhole_ray(const struct camera *cam, double u_px, double v_px) {
    return vec3_make((u_px - cam->cx_px) / cam->fx_px, (v_px - cam->cy_px) / cam->fy_px, 1.0);
}

#ifdef __cplusplus
}
#endif
#endif
