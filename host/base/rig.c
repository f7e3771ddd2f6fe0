#include "base/rig.h"

#include <stddef.h>

static const double pi = 3.14159265358979323846;

struct rig rig_nominal(void) {
    struct rig rig = {.shaft = {0, -1, 0},
                      .laser = {0, 1, 0},
                      .mirror_angle_rad = pi / 4,
                      .range_scale = 1,
                      .encoder_counts_per_turn = 4096,
                      .encoder_horizon_counts = 1024,
                      .pan_steps_per_turn = 28000,
                      .tilt_steps_per_turn = 28000};
    return rig;
}

/* A named value and the closed interval it must lie in. */
struct bound {
    const char *name, *unit;
    double value, min, max;
};

enum st rig_check(const struct rig *rig, struct errctx *err) {
    const double axis_tolerance = 1e-9; /* a normalised double vector is within 1e-15 */
    const struct bound bounds[] = {
        {"shaft length", "", vec3_norm(rig->shaft), 1 - axis_tolerance, 1 + axis_tolerance},
        {"laser length", "", vec3_norm(rig->laser), 1 - axis_tolerance, 1 + axis_tolerance},
        {"mirror_angle", "rad", rig->mirror_angle_rad, 0.5, 1.1},
        {"mirror offset", "m", vec3_norm(rig->mirror_m), 0, 1},
        {"mirror_path", "m", rig->mirror_path_m, -1, 1},
        {"range_scale", "", rig->range_scale, 0.5, 2},
        {"range_offset", "m", rig->range_offset_m, -10, 10},
        {"encoder_counts_per_turn", "counts", rig->encoder_counts_per_turn, 16, 16777216},
        {"encoder_horizon", "counts", rig->encoder_horizon_counts, -16777216, 16777216},
        {"encoder_ecc_cos", "rad", rig->encoder_ecc_cos_rad, -0.1, 0.1},
        {"encoder_ecc_sin", "rad", rig->encoder_ecc_sin_rad, -0.1, 0.1},
        {"pan_steps_per_turn", "steps", rig->pan_steps_per_turn, 100, 1e8},
        {"pan_zero", "steps", rig->pan_zero_steps, -1e9, 1e9},
        {"pan_backlash", "rad", rig->pan_backlash_rad, 0, 0.1},
        {"tilt_steps_per_turn", "steps", rig->tilt_steps_per_turn, 100, 1e8},
        {"tilt_zero", "steps", rig->tilt_zero_steps, -1e9, 1e9},
    };
    for (size_t i = 0; i < sizeof bounds / sizeof bounds[0]; i++) {
        const struct bound *b = &bounds[i];
        if (!(b->value >= b->min && b->value <= b->max)) /* NaN fails too */
            return errctx_set(err, ST_INVALID, "rig: %s is %g %s, expected %g to %g", b->name,
                              b->value, b->unit, b->min, b->max);
    }
    if (vec3_dot(rig->shaft, rig->laser) > -0.5)
        return errctx_set(err, ST_INVALID,
                          "rig: the laser must shine against the shaft axis within 60 degrees");
    return ST_OK;
}

double rig_mirror_angle(const struct rig *rig, double encoder_counts) {
    double turn = 2 * pi / rig->encoder_counts_per_turn;
    double phase = turn * encoder_counts;
    return turn * (encoder_counts - rig->encoder_horizon_counts) +
           rig->encoder_ecc_cos_rad * cos(phase) + rig->encoder_ecc_sin_rad * sin(phase);
}

double rig_encoder_counts(const struct rig *rig, double mirror_angle_rad) {
    double turn = 2 * pi / rig->encoder_counts_per_turn;
    double phase = mirror_angle_rad + turn * rig->encoder_horizon_counts;
    double target = phase;
    /* f(phase) = phase + ecc(phase) - target; f' > 0.5, Newton converges quadratically. */
    for (int i = 0; i < 8; i++) {
        double c = cos(phase), s = sin(phase);
        double f = phase + rig->encoder_ecc_cos_rad * c + rig->encoder_ecc_sin_rad * s - target;
        double step = f / (1 - rig->encoder_ecc_cos_rad * s + rig->encoder_ecc_sin_rad * c);
        phase -= step;
        if (fabs(step) < 1e-15)
            break;
    }
    return phase / turn;
}

double rig_pan_angle(const struct rig *rig, double pan_steps, int direction) {
    return 2 * pi * (pan_steps - rig->pan_zero_steps) / rig->pan_steps_per_turn -
           direction * rig->pan_backlash_rad / 2;
}

double rig_tilt_angle(const struct rig *rig, double tilt_steps) {
    return 2 * pi * (tilt_steps - rig->tilt_zero_steps) / rig->tilt_steps_per_turn;
}

struct vec3 rig_mirror_normal(const struct rig *rig, double mirror_angle_rad) {
    struct vec3 a = rig->shaft;
    struct vec3 e0 =
        vec3_unit(vec3_madd(vec3_make(1, 0, 0), a, -a.x)); /* head x, made normal to a */
    struct vec3 e1 = vec3_cross(a, e0);
    double c = cos(rig->mirror_angle_rad), s = sin(rig->mirror_angle_rad);
    double ct = cos(mirror_angle_rad), st = sin(mirror_angle_rad);
    return vec3_add(vec3_scale(a, c), vec3_add(vec3_scale(e0, s * ct), vec3_scale(e1, s * st)));
}

struct rig_beam rig_head_beam(const struct rig *rig, double mirror_angle_rad) {
    struct vec3 n = rig_mirror_normal(rig, mirror_angle_rad);
    struct vec3 b = rig->laser;
    struct rig_beam beam = {rig->mirror_m, vec3_madd(b, n, -2 * vec3_dot(b, n))};
    return beam;
}

struct mat3 rig_station_from_head(double tilt_rad, double pan_rad) {
    double ct = cos(tilt_rad), st = sin(tilt_rad), cp = cos(pan_rad), sp = sin(pan_rad);
    struct mat3 r = {{cp * ct, -sp, -cp * st, sp * ct, cp, -sp * st, st, 0, ct}};
    return r;
}

struct rig_beam rig_direction(const struct rig *rig, double mirror_angle_rad, double tilt_rad,
                              double pan_rad) {
    struct rig_beam head = rig_head_beam(rig, mirror_angle_rad);
    struct mat3 r = rig_station_from_head(tilt_rad, pan_rad);
    struct rig_beam beam = {mat3_mulv(&r, head.origin_m), mat3_mulv(&r, head.dir)};
    return beam;
}

double rig_distance(const struct rig *rig, double range_m) {
    return rig->range_scale * range_m + rig->range_offset_m - rig->mirror_path_m;
}

double rig_range(const struct rig *rig, double distance_m) {
    return (distance_m + rig->mirror_path_m - rig->range_offset_m) / rig->range_scale;
}

struct vec3 rig_point(const struct rig *rig, double mirror_angle_rad, double tilt_rad,
                      double pan_rad, double range_m) {
    struct rig_beam beam = rig_direction(rig, mirror_angle_rad, tilt_rad, pan_rad);
    return vec3_madd(beam.origin_m, beam.dir, rig_distance(rig, range_m));
}

struct pose rig_camera_pose(const struct rig_camera *cam, double tilt_rad, double pan_rad) {
    struct pose station_from_head = {rig_station_from_head(tilt_rad, pan_rad), {0, 0, 0}};
    struct pose out = {mat3_mul(&station_from_head.r, &cam->head_from_cam.r),
                       mat3_mulv(&station_from_head.r, cam->head_from_cam.t_m)};
    return out;
}

struct pose rig_camera_nominal_pose(void) {
    /* cam x (right) is head -y, cam y (down) is head -z, cam z (forward) is head x */
    struct pose head_from_cam = {{{0, 0, 1, -1, 0, 0, 0, -1, 0}}, {0, 0, 0}};
    return head_from_cam;
}
