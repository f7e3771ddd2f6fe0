#include "base/camera.h"

#include "base/image.h"

#include <math.h>

/* Degree of the domain's boundary polynomials in r. */
enum { DEGREE = 6 };

/* Beyond this radius (a ray 1e-8 rad from sideways) nobody looks for the edge of the domain. */
static const double r_search_max = 1e8;

struct camera camera_pinhole(int32_t width_px, int32_t height_px, double hfov_rad) {
    double f = 0.5 * width_px / tan(0.5 * hfov_rad);
    struct camera cam = {.width_px = width_px,
                         .height_px = height_px,
                         .fx_px = f,
                         .fy_px = f,
                         .cx_px = 0.5 * (width_px - 1),
                         .cy_px = 0.5 * (height_px - 1)};
    return cam;
}

bool camera_is_pinhole(const struct camera *cam) {
    return cam->k1 == 0.0 && cam->k2 == 0.0 && cam->k3 == 0.0 && cam->p1 == 0.0 && cam->p2 == 0.0;
}

enum st camera_check(const struct camera *cam, struct errctx *err) {
    if (cam->width_px < 1 || cam->height_px < 1 || cam->width_px > IMAGE_MAX_SIDE_PX ||
        cam->height_px > IMAGE_MAX_SIDE_PX)
        return errctx_set(err, ST_INVALID, "camera: picture size %dx%d is not within 1..%d",
                          (int)cam->width_px, (int)cam->height_px, IMAGE_MAX_SIDE_PX);
    if (!(cam->fx_px > 0.0) || !(cam->fy_px > 0.0) || !isfinite(cam->fx_px) ||
        !isfinite(cam->fy_px))
        return errctx_set(err, ST_INVALID, "camera: focal lengths %g, %g px are not positive",
                          cam->fx_px, cam->fy_px);
    if (!isfinite(cam->cx_px) || !isfinite(cam->cy_px))
        return errctx_set(err, ST_INVALID, "camera: the principal point is not finite");
    if (!isfinite(cam->k1) || !isfinite(cam->k2) || !isfinite(cam->k3) || !isfinite(cam->p1) ||
        !isfinite(cam->p2))
        return errctx_set(err, ST_INVALID, "camera: a distortion coefficient is not finite");
    return ST_OK;
}

static double polynomial(const double *c, int degree, double r) {
    double v = c[degree];
    for (int i = degree - 1; i >= 0; i--)
        v = v * r + c[i];
    return v;
}

/* The root between low and high, where the polynomial is monotone and changes its sign; to the last
 * bit, on the side of `low`. */
static double bisect(const double *c, int degree, double low, double high) {
    bool low_positive = polynomial(c, degree, low) > 0.0;
    for (;;) {
        double mid = 0.5 * (low + high);
        if (!(mid > low) || !(mid < high))
            return low;
        if ((polynomial(c, degree, mid) > 0.0) == low_positive)
            low = mid;
        else
            high = mid;
    }
}

/* Roots in (0, r_search_max) in rising order, at most `degree`. Between the roots of its derivative
 * a polynomial is monotone, so each interval holds at most one: from degree 1 upward, no start
 * value and no missed root. */
static int positive_roots(const double *c, int degree, double out_r[DEGREE]) {
    double d[DEGREE + 1][DEGREE + 1]; /* d[k]: k-th derivative, degree - k */
    for (int i = 0; i <= degree; i++)
        d[0][i] = c[i];
    for (int k = 1; k < degree; k++)
        for (int i = 0; i <= degree - k; i++)
            d[k][i] = (i + 1) * d[k - 1][i + 1];
    double roots[DEGREE + 2] = {0};
    int n = 0;
    for (int k = degree - 1; k >= 0; k--) {
        double edges[DEGREE + 2];
        edges[0] = 0.0;
        for (int i = 0; i < n; i++)
            edges[i + 1] = roots[i];
        edges[n + 1] = r_search_max;
        int intervals = n + 1;
        n = 0;
        for (int i = 0; i < intervals; i++) {
            bool a = polynomial(d[k], degree - k, edges[i]) > 0.0;
            bool b = polynomial(d[k], degree - k, edges[i + 1]) > 0.0;
            if (a != b)
                roots[n++] = bisect(d[k], degree - k, edges[i], edges[i + 1]);
        }
    }
    for (int i = 0; i < n; i++)
        out_r[i] = roots[i];
    return n;
}

/* The Jacobian is symmetric: J = radial part with eigenvalues h = d(r g)/dr and g, plus a
 * tangential part whose eigenvalues are not below -6 |p| r. While both h and g exceed 6 |p| r it is
 * positive definite, hence the map one-to-one on the disc. h(r) - 6 |p| r and g(r) - 6 |p| r as
 * polynomials in r: */
static void boundary_polynomials(const struct camera *cam, double h[DEGREE + 1],
                                 double g[DEGREE + 1]) {
    double p6 = 6.0 * hypot(cam->p1, cam->p2);
    const double h_of[DEGREE + 1] = {1, -p6, 3 * cam->k1, 0, 5 * cam->k2, 0, 7 * cam->k3};
    const double g_of[DEGREE + 1] = {1, -p6, cam->k1, 0, cam->k2, 0, cam->k3};
    for (int i = 0; i <= DEGREE; i++) {
        h[i] = h_of[i];
        g[i] = g_of[i];
    }
}

/* Largest radius of the domain, INFINITY if unbounded. */
static double r_max(const struct camera *cam) {
    double c[2][DEGREE + 1];
    boundary_polynomials(cam, c[0], c[1]);
    double r = INFINITY;
    for (int i = 0; i < 2; i++) {
        double roots[DEGREE];
        int degree = DEGREE;
        while (degree > 0 && c[i][degree] == 0.0)
            degree--;
        if (degree > 0 && positive_roots(c[i], degree, roots) > 0)
            r = fmin(r, roots[0]);
    }
    return r;
}

double camera_s_max(const struct camera *cam) {
    if (camera_is_pinhole(cam))
        return INFINITY;
    /* Points near the edge of one camera come by the thousand: the last answer is kept. */
    static _Thread_local struct {
        struct camera cam;
        double s_max;
        bool known;
    } last;
    const struct camera *c = &last.cam;
    if (!last.known || c->k1 != cam->k1 || c->k2 != cam->k2 || c->k3 != cam->k3 ||
        c->p1 != cam->p1 || c->p2 != cam->p2) {
        double r = r_max(cam);
        last.cam = *cam;
        last.s_max = r * r;
        last.known = true;
    }
    return last.s_max;
}

/* s <= s_max. Most points are decided by a lower bound of the boundary polynomials that falls with
 * r (negative terms only), without finding roots. NaN is outside. */
static bool in_domain(const struct camera *cam, double s) {
    double drop =
        6.0 * sqrt((cam->p1 * cam->p1 + cam->p2 * cam->p2) * s) -
        s * (fmin(3 * cam->k1, 0) + s * (fmin(5 * cam->k2, 0) + s * fmin(7 * cam->k3, 0)));
    if (drop < 1.0)
        return true;
    return s <= camera_s_max(cam);
}

/* (x, y) to (x', y') and the symmetric Jacobian j = {xx, xy, yy}. */
static void distort(const struct camera *cam, double x, double y, double out_d[2],
                    double out_j[3]) {
    double s = x * x + y * y;
    double g = 1.0 + s * (cam->k1 + s * (cam->k2 + s * cam->k3));
    double dg_ds = cam->k1 + s * (2.0 * cam->k2 + s * 3.0 * cam->k3);
    out_d[0] = x * g + 2.0 * cam->p1 * x * y + cam->p2 * (s + 2.0 * x * x);
    out_d[1] = y * g + cam->p1 * (s + 2.0 * y * y) + 2.0 * cam->p2 * x * y;
    out_j[0] = g + 2.0 * x * x * dg_ds + 2.0 * cam->p1 * y + 6.0 * cam->p2 * x;
    out_j[1] = 2.0 * x * y * dg_ds + 2.0 * cam->p1 * x + 2.0 * cam->p2 * y;
    out_j[2] = g + 2.0 * y * y * dg_ds + 6.0 * cam->p1 * y + 2.0 * cam->p2 * x;
}

enum st camera_project(const struct camera *cam, struct vec3 p_cam, struct vec2 *out_q_px,
                       double out_dq_dp[6]) {
    if (!(p_cam.z > 0.0))
        return ST_DOMAIN;
    double x = p_cam.x / p_cam.z, y = p_cam.y / p_cam.z;
    if (!isfinite(x) || !isfinite(y) || !in_domain(cam, x * x + y * y))
        return ST_DOMAIN;
    double d[2], j[3];
    distort(cam, x, y, d, j);
    out_q_px->x = cam->fx_px * d[0] + cam->cx_px;
    out_q_px->y = cam->fy_px * d[1] + cam->cy_px;
    if (out_dq_dp) {
        double fx = cam->fx_px / p_cam.z, fy = cam->fy_px / p_cam.z;
        out_dq_dp[0] = fx * j[0];
        out_dq_dp[1] = fx * j[1];
        out_dq_dp[2] = -fx * (j[0] * x + j[1] * y);
        out_dq_dp[3] = fy * j[1];
        out_dq_dp[4] = fy * j[2];
        out_dq_dp[5] = -fy * (j[1] * x + j[2] * y);
    }
    return ST_OK;
}

/* Residual below which (x', y') is met: 1e-12 of a focal length, relative beyond 45 degrees. */
static double residual_max(const double d[2]) {
    return 1e-12 * fmax(1.0, hypot(d[0], d[1]));
}

/* One Newton step of distort(x, y) = d. Returns the residual before it; NaN stays NaN. */
static double newton_step(const struct camera *cam, const double d[2], const double xy[2],
                          double out_step[2]) {
    double at[2], j[3];
    distort(cam, xy[0], xy[1], at, j);
    double ex = d[0] - at[0], ey = d[1] - at[1];
    double det = j[0] * j[2] - j[1] * j[1];
    out_step[0] = (j[2] * ex - j[1] * ey) / det;
    out_step[1] = (j[0] * ey - j[1] * ex) / det;
    return hypot(ex, ey);
}

/* Plain Newton from one fixed-point step. True if it met d; whether inside the domain is not known
 * yet. */
static bool invert_fast(const struct camera *cam, const double d[2], double xy[2]) {
    enum { MAX_STEPS = 12 };
    double at[2], j[3];
    distort(cam, d[0], d[1], at, j);
    xy[0] = d[0] - (at[0] - d[0]);
    xy[1] = d[1] - (at[1] - d[1]);
    for (int i = 0; i < MAX_STEPS; i++) {
        double step[2];
        double residual = newton_step(cam, d, xy, step);
        if (residual <= 1e-2 * residual_max(d))
            return true;
        xy[0] += step[0];
        xy[1] += step[1];
    }
    return false;
}

/* Share of `step` to take so as to stay inside |xy| < r: all of it, or most of the way to the
 * circle. */
static double step_share(const double xy[2], const double step[2], double r) {
    double a = step[0] * step[0] + step[1] * step[1];
    double b = xy[0] * step[0] + xy[1] * step[1];
    double c = xy[0] * xy[0] + xy[1] * xy[1] - r * r;
    if (!(a > 0.0))
        return 1.0;
    double t = (-b + sqrt(fmax(b * b - a * c, 0.0))) / a;
    return t > 1.0 ? 1.0 : 0.95 * t;
}

/* Damped Newton that never leaves the disc of the domain, from its centre. There the map is the
 * gradient of a convex function, so the residual always falls toward the one solution, if the disc
 * holds it. */
static bool invert_safe(const struct camera *cam, const double d[2], double r_domain,
                        double xy[2]) {
    enum { MAX_STEPS = 200, MAX_HALVINGS = 40 };
    double step[2];
    xy[0] = xy[1] = 0.0;
    double residual = newton_step(cam, d, xy, step);
    for (int i = 0; i < MAX_STEPS; i++) {
        double t = step_share(xy, step, r_domain);
        double next_residual = INFINITY, next[2], next_step[2] = {0, 0};
        for (int k = 0; k < MAX_HALVINGS; k++, t *= 0.5) {
            next[0] = xy[0] + t * step[0];
            next[1] = xy[1] + t * step[1];
            next_residual = newton_step(cam, d, next, next_step);
            if (next_residual < residual)
                break;
        }
        if (!(next_residual < residual))
            break;
        for (int k = 0; k < 2; k++) {
            xy[k] = next[k];
            step[k] = next_step[k];
        }
        residual = next_residual;
    }
    return residual <= residual_max(d);
}

/* (x', y') to (x, y) within the domain. */
static enum st undistort(const struct camera *cam, const double d[2], double out_xy[2]) {
    double xy[2];
    if (invert_fast(cam, d, xy) && in_domain(cam, xy[0] * xy[0] + xy[1] * xy[1])) {
        out_xy[0] = xy[0];
        out_xy[1] = xy[1];
        return ST_OK;
    }
    double r = sqrt(camera_s_max(cam));
    if (!invert_safe(cam, d, fmin(r, r_search_max), xy) ||
        !(xy[0] * xy[0] + xy[1] * xy[1] <= camera_s_max(cam)))
        return ST_DOMAIN;
    out_xy[0] = xy[0];
    out_xy[1] = xy[1];
    return ST_OK;
}

enum st camera_unproject(const struct camera *cam, struct vec2 q_px, struct vec3 *out_ray,
                         double out_dr_dq[4]) {
    double d[2] = {(q_px.x - cam->cx_px) / cam->fx_px, (q_px.y - cam->cy_px) / cam->fy_px};
    double xy[2] = {d[0], d[1]};
    if (!isfinite(d[0]) || !isfinite(d[1]))
        return ST_DOMAIN;
    if (!camera_is_pinhole(cam)) {
        enum st st = undistort(cam, d, xy);
        if (st)
            return st;
    }
    *out_ray = vec3_make(xy[0], xy[1], 1.0);
    if (out_dr_dq) {
        double at[2], j[3];
        distort(cam, xy[0], xy[1], at, j);
        double det = j[0] * j[2] - j[1] * j[1];
        out_dr_dq[0] = j[2] / (det * cam->fx_px);
        out_dr_dq[1] = -j[1] / (det * cam->fy_px);
        out_dr_dq[2] = -j[1] / (det * cam->fx_px);
        out_dr_dq[3] = j[0] / (det * cam->fy_px);
    }
    return ST_OK;
}
