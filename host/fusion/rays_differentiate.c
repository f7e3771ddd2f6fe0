/* Derivatives of the rig model. With p = Q h, h = m + d r, d = scale range + offset - path,
 * r = b - 2 (b.n) n, n = a cos(phi) + sin(phi) (e cos(theta) + a x e sin(theta)):
 *   dr = db - 2 [(db.n + b.dn) n + (b.n) dn],   dp = Q (dm + dd r + d dr) + dQ h */
#include "fusion/rays.h"

#include <math.h>

static const double two_pi = 6.283185307179586;

struct chain {
    const struct rig *rig;
    struct mat3 q; /* station_from_head */
    struct vec3 a, e, ae, b, n, r, h;
    double theta, distance_m;
};

static struct vec3 dr_of(const struct chain *c, struct vec3 db, struct vec3 dn) {
    double bn = vec3_dot(c->b, c->n), dbn = vec3_dot(db, c->n) + vec3_dot(c->b, dn);
    return vec3_sub(db, vec3_scale(vec3_add(vec3_scale(c->n, dbn), vec3_scale(dn, bn)), 2.0));
}

/* n as the shaft turns by da; e is head x made normal to a, so it turns too. */
static struct vec3 dn_of_shaft(const struct chain *c, struct vec3 da) {
    struct vec3 x = {1, 0, 0}, w = vec3_madd(x, c->a, -c->a.x);
    struct vec3 dw = vec3_add(vec3_scale(c->a, -da.x), vec3_scale(da, -c->a.x));
    struct vec3 de = vec3_scale(vec3_madd(dw, c->e, -vec3_dot(c->e, dw)), 1.0 / vec3_norm(w));
    struct vec3 dae = vec3_add(vec3_cross(da, c->e), vec3_cross(c->a, de));
    double cp = cos(c->rig->mirror_angle_rad), sp = sin(c->rig->mirror_angle_rad);
    return vec3_add(vec3_scale(da, cp), vec3_add(vec3_scale(de, sp * cos(c->theta)),
                                                 vec3_scale(dae, sp * sin(c->theta))));
}

static void set(double column[3][RAYS_PARAMETERS], int at, struct vec3 v) {
    column[0][at] = v.x;
    column[1][at] = v.y;
    column[2][at] = v.z;
}

static void set_measure(double column[3][RAYS_MEASURES], int at, struct vec3 v) {
    column[0][at] = v.x;
    column[1][at] = v.y;
    column[2][at] = v.z;
}

/* d/d pan and d/d tilt of Q h. */
static void turn_derivatives(const struct chain *c, double pan, double tilt, struct vec3 *out_pan,
                             struct vec3 *out_tilt) {
    struct vec3 p = mat3_mulv(&c->q, c->h);
    *out_pan = vec3_make(-p.y, p.x, 0.0);
    double ct = cos(tilt), st = sin(tilt), lx = -st * c->h.x - ct * c->h.z;
    *out_tilt = vec3_make(cos(pan) * lx, sin(pan) * lx, ct * c->h.x - st * c->h.z);
}

static void axis_columns(const struct chain *c, double columns[3][RAYS_PARAMETERS]) {
    const struct vec3 zero = {0, 0, 0}, axes[2] = {{1, 0, 0}, {0, 0, 1}};
    for (int k = 0; k < 2; k++) {
        struct vec3 dn = dn_of_shaft(c, vec3_cross(axes[k], c->a));
        struct vec3 db = vec3_cross(axes[k], c->b);
        set(columns, RAYS_SHAFT_X + k,
            mat3_mulv(&c->q, vec3_scale(dr_of(c, zero, dn), c->distance_m)));
        set(columns, RAYS_LASER_X + k,
            mat3_mulv(&c->q, vec3_scale(dr_of(c, db, zero), c->distance_m)));
    }
    double cp = cos(c->rig->mirror_angle_rad), sp = sin(c->rig->mirror_angle_rad);
    struct vec3 around =
        vec3_add(vec3_scale(c->e, cos(c->theta)), vec3_scale(c->ae, sin(c->theta)));
    struct vec3 dn_dphi = vec3_madd(vec3_scale(around, cp), c->a, -sp);
    set(columns, RAYS_MIRROR_ANGLE,
        mat3_mulv(&c->q, vec3_scale(dr_of(c, zero, dn_dphi), c->distance_m)));
}

static struct vec3 scaled(struct vec3 v, double s) {
    return vec3_scale(v, s);
}

void rays_differentiate(const struct rig *rig, const struct sweep_place *place, double range_m,
                        struct rays_jacobian *out) {
    double pan = rig_pan_angle(rig, place->pan_steps, place->pan_direction);
    double tilt = rig_tilt_angle(rig, place->tilt_steps);
    struct chain c = {.rig = rig,
                      .q = rig_station_from_head(tilt, pan),
                      .a = rig->shaft,
                      .b = rig->laser,
                      .theta = rig_mirror_angle(rig, place->counts),
                      .distance_m = rig_distance(rig, range_m)};
    c.e = vec3_unit(vec3_madd(vec3_make(1, 0, 0), c.a, -c.a.x));
    c.ae = vec3_cross(c.a, c.e);
    c.n = rig_mirror_normal(rig, c.theta);
    c.r = vec3_madd(c.b, c.n, -2.0 * vec3_dot(c.b, c.n));
    c.h = vec3_madd(rig->mirror_m, c.r, c.distance_m);
    out->p_m = mat3_mulv(&c.q, c.h);
    double(*d)[RAYS_PARAMETERS] = out->dp_dparameter;
    axis_columns(&c, d);
    struct vec3 along = mat3_mulv(&c.q, c.r), zero = {0, 0, 0};
    for (int k = 0; k < 3; k++)
        set(d, RAYS_MIRROR_X + k, vec3_make(c.q.m[k], c.q.m[3 + k], c.q.m[6 + k]));
    set(d, RAYS_MIRROR_PATH, scaled(along, -1.0));
    set(d, RAYS_RANGE_SCALE, scaled(along, range_m));
    set(d, RAYS_RANGE_OFFSET, along);
    double sp = sin(rig->mirror_angle_rad);
    struct vec3 dn_dtheta =
        vec3_add(scaled(c.e, -sp * sin(c.theta)), scaled(c.ae, sp * cos(c.theta)));
    struct vec3 dp_dtheta = mat3_mulv(&c.q, scaled(dr_of(&c, zero, dn_dtheta), c.distance_m));
    double turn = two_pi / rig->encoder_counts_per_turn, phase = turn * place->counts;
    set(d, RAYS_HORIZON, scaled(dp_dtheta, -turn));
    set(d, RAYS_ECC_COS, scaled(dp_dtheta, cos(phase)));
    set(d, RAYS_ECC_SIN, scaled(dp_dtheta, sin(phase)));
    struct vec3 dp_dpan, dp_dtilt;
    turn_derivatives(&c, pan, tilt, &dp_dpan, &dp_dtilt);
    double pan_step = two_pi / rig->pan_steps_per_turn,
           tilt_step = two_pi / rig->tilt_steps_per_turn;
    set(d, RAYS_PAN_STEPS_PER_TURN,
        scaled(dp_dpan,
               -pan_step * (place->pan_steps - rig->pan_zero_steps) / rig->pan_steps_per_turn));
    set(d, RAYS_PAN_ZERO, scaled(dp_dpan, -pan_step));
    set(d, RAYS_PAN_BACKLASH, scaled(dp_dpan, -0.5 * place->pan_direction));
    set(d, RAYS_TILT_STEPS_PER_TURN,
        scaled(dp_dtilt,
               -tilt_step * (place->tilt_steps - rig->tilt_zero_steps) / rig->tilt_steps_per_turn));
    set(d, RAYS_TILT_ZERO, scaled(dp_dtilt, -tilt_step));
    double theta_count = turn * (1.0 - rig->encoder_ecc_cos_rad * sin(phase) +
                                 rig->encoder_ecc_sin_rad * cos(phase));
    set_measure(out->dp_dmeasure, RAYS_COUNTS, scaled(dp_dtheta, theta_count));
    set_measure(out->dp_dmeasure, RAYS_PAN_STEPS, scaled(dp_dpan, pan_step));
    set_measure(out->dp_dmeasure, RAYS_TILT_STEPS, scaled(dp_dtilt, tilt_step));
    set_measure(out->dp_dmeasure, RAYS_RANGE, scaled(along, rig->range_scale));
}
