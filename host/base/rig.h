/* Rig model: from what the cart's sensors say (encoder position, pan and tilt steps, range) to a
 * point in the station frame. One pure function chain, shared by the simulated cart, calibration
 * and fusion, so that they cannot disagree. Doubles throughout, no allocation, safe on the
 * real-time path.
 *
 * Frames. `head`: origin where the pan and tilt axes meet, x forward, y left, z up at pan = tilt =
 * 0. `station`: same origin, z along the pan axis, fixed to the ground. Positive pan turns x
 * towards y (counter-clockwise from above), positive tilt raises x towards z.
 *
 * Mirror (Nyland et al. 1999, section 3.2). A flat mirror at about 45 deg to a shaft turns about
 * that shaft; the laser shines along the shaft. With the unit vectors b (laser), a (shaft), n0
 * (normal at theta = 0): n(theta) = R(a, theta) n0                 angle(n0, a) = mirror_angle_rad
 *   r        = b - 2 (b . n) n
 *   p_head   = m + (scale * range + offset - d_mirror) r
 * For b = -a, r = cos(2 phi) a + sin(2 phi) e(theta): a cone of half angle 2 phi, a plane at phi =
 * 45 deg. p_station = Rz(pan) Rtilt(tilt) p_head */
#ifndef SC_BASE_RIG_H
#define SC_BASE_RIG_H

#include "base/camera.h"
#include "base/pose.h"
#include "base/st.h"
#include "base/vec.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Everything that the geometry of a sample depends on. Whether a value is nominal, calibrated or
 * true is the holder's to know. */
struct rig {
    struct vec3 shaft; /* a, unit, head frame; nominal (0, -1, 0): theta grows upwards in front */
    struct vec3 laser; /* b, unit, head frame; nominal -a */
    double mirror_angle_rad; /* phi, between n0 and a; nominal 45 deg */
    struct vec3 mirror_m;    /* m, where the laser meets the mirror, head frame; nominal 0 */
    double mirror_path_m;    /* d_mirror: path from the sensor's zero to the mirror */
    double range_scale;      /* nominal 1 */
    double range_offset_m;   /* nominal 0 */

    double encoder_counts_per_turn; /* 4096; the index pulse is at 0 */
    double encoder_horizon_counts;  /* where the beam is level in front at tilt 0 */
    double encoder_ecc_cos_rad, encoder_ecc_sin_rad; /* first harmonic of the disc's eccentricity */

    double pan_steps_per_turn; /* nominal 28 000 */
    double pan_zero_steps;     /* where pan is 0 */
    double pan_backlash_rad; /* full play: the head lags half of it behind the motor, either way */
    double tilt_steps_per_turn;
    double tilt_zero_steps;
};

/* The camera on the same pan-tilt head. */
struct rig_camera {
    struct camera camera;
    struct pose
        head_from_cam; /* t_m is the offset of the nodal point from the head's origin; nominal 0 */
};

/* A beam in some frame: points are origin_m + s * dir, s in metres from the mirror; dir is unit. */
struct rig_beam {
    struct vec3 origin_m, dir;
};

/* The design values: 45 deg, 4096 counts, 28 000 steps, no offset, no misalignment. */
struct rig rig_nominal(void);

/* ST_INVALID with the offending field unless axes are unit vectors within 1e-9, angles, scales and
 * step counts are finite and inside generous physical bounds (a wrong unit does not pass). */
ST_MUST_CHECK enum st rig_check(const struct rig *rig, struct errctx *err);

/* Mirror angle theta for an encoder position, counts of any size and sign (positions beyond one
 * turn add whole turns). theta = 2 pi (c - horizon) / N + ecc_cos cos(2 pi c / N) + ecc_sin sin(2
 * pi c / N). */
double rig_mirror_angle(const struct rig *rig, double encoder_counts);

/* Inverse of rig_mirror_angle() by Newton iteration, to 1e-12 counts relative; needs an
 * eccentricity below 0.5 rad, which rig_check() grants. */
double rig_encoder_counts(const struct rig *rig, double mirror_angle_rad);

/* Pan angle of the head. `direction` is the sign of the last motion that took up the play: +1, -1,
 * or 0 when unknown (the middle of the play). */
double rig_pan_angle(const struct rig *rig, double pan_steps, int direction);
double rig_tilt_angle(const struct rig *rig, double tilt_steps);

/* Mirror normal n(theta), unit, head frame. n0 lies in the half plane of a and the head's x axis.
 */
struct vec3 rig_mirror_normal(const struct rig *rig, double mirror_angle_rad);

/* The beam in the head frame. */
struct rig_beam rig_head_beam(const struct rig *rig, double mirror_angle_rad);

/* station_from_head: Rz(pan) Rtilt(tilt), no translation. */
struct mat3 rig_station_from_head(double tilt_rad, double pan_rad);

/* The beam in the station frame. */
struct rig_beam rig_direction(const struct rig *rig, double mirror_angle_rad, double tilt_rad,
                              double pan_rad);

/* Metres along the beam from the mirror for a reported range: scale * range + offset - d_mirror. */
double rig_distance(const struct rig *rig, double range_m);
/* Its inverse: what an ideal sensor reports for a surface distance_m beyond the mirror. */
double rig_range(const struct rig *rig, double distance_m);

/* The point of a sample, station frame. NaN range gives a NaN point. */
struct vec3 rig_point(const struct rig *rig, double mirror_angle_rad, double tilt_rad,
                      double pan_rad, double range_m);

/* Pose of the camera at a pan-tilt position: station_from_cam. */
struct pose rig_camera_pose(const struct rig_camera *cam, double tilt_rad, double pan_rad);

/* head_from_cam without offset, for a camera whose rows are horizontal: cam z is head x. */
struct pose rig_camera_nominal_pose(void);

#ifdef __cplusplus
}
#endif
#endif
