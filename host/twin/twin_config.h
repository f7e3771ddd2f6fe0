/* The twin's parameters: what the cart is thought to be (nominal) beside what it is (true). Kept in
 * a YAML file whose keys carry their units; every key has bounds, so that a wrong unit does not
 * pass. The defaults are those of the UNC cart (Nyland et al. 1999) where the paper gives them. */
#ifndef SC_TWIN_TWIN_CONFIG_H
#define SC_TWIN_TWIN_CONFIG_H

#include "base/rig.h"
#include "base/st.h"
#include "twin/clocks.h"
#include "twin/optics.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

/* One parameter a line: (name, section, key, has nominal, nominal, true, min, max, what). The unit
 * is the key's suffix. A parameter without nominal is something that nobody would be told. */
#define TWIN_CONFIG_KEYS(X)                                                                        \
    X(MIRROR_ANGLE, "rig", "mirror_angle_deg", 1, 45, 44.8, 30, 60, "mirror normal to shaft")      \
    X(SHAFT_YAW, "rig", "shaft_yaw_mrad", 1, 0, 1.2, -50, 50, "shaft turned about head z")         \
    X(SHAFT_ROLL, "rig", "shaft_roll_mrad", 1, 0, -0.8, -50, 50, "shaft turned about head x")      \
    X(LASER_YAW, "rig", "laser_yaw_mrad", 1, 0, 0.9, -50, 50, "laser turned about head z")         \
    X(LASER_ROLL, "rig", "laser_roll_mrad", 1, 0, 1.1, -50, 50, "laser turned about head x")       \
    X(MIRROR_X, "rig", "mirror_x_mm", 1, 0, 1.5, -200, 200,                                        \
      "laser spot on the mirror, head frame")                                                      \
    X(MIRROR_Y, "rig", "mirror_y_mm", 1, 0, -0.8, -200, 200, "")                                   \
    X(MIRROR_Z, "rig", "mirror_z_mm", 1, 0, 2.1, -200, 200, "")                                    \
    X(MIRROR_PATH, "rig", "mirror_path_mm", 1, 60, 60, 0, 500,                                     \
      "path from the sensor's zero to the mirror")                                                 \
    X(RANGE_SCALE, "rig", "range_scale", 1, 1, 1.0004, 0.9, 1.1, "")                               \
    X(RANGE_OFFSET, "rig", "range_offset_mm", 1, 0, 7, -1000, 1000, "")                            \
    X(HORIZON, "rig", "encoder_horizon_counts", 1, 1024, 1037.4, 0, 4096,                          \
      "count where the beam is level")                                                             \
    X(ECC_COS, "rig", "encoder_ecc_cos_mrad", 1, 0, 0.6, -50, 50,                                  \
      "eccentricity of the encoder disc")                                                          \
    X(ECC_SIN, "rig", "encoder_ecc_sin_mrad", 1, 0, -0.4, -50, 50, "")                             \
    X(PAN_STEPS, "rig", "pan_steps_per_turn", 1, 28000, 28078, 1000, 1000000, "")                  \
    X(BACKLASH, "rig", "pan_backlash_mrad", 1, 0, 0.5, 0, 20, "full play")                         \
    X(TILT_STEPS, "rig", "tilt_steps_per_turn", 1, 28000, 28000, 1000, 1000000, "")                \
    X(TILT_ZERO, "rig", "tilt_zero_steps", 1, 0, 12, -2000, 2000, "")                              \
    X(HEAD_HEIGHT, "cart", "head_height_m", 1, 1.6, 1.6, 0.2, 5,                                   \
      "pan and tilt axes above the ground")                                                        \
    X(LEVEL_X, "cart", "level_x_mrad", 1, 0, 4, -100, 100, "cart off level: turned about its x")   \
    X(LEVEL_Y, "cart", "level_y_mrad", 1, 0, -3, -100, 100, "and about its y")                     \
    X(STAND_SIGMA, "cart", "stand_error_m", 0, 0, 0.12, 0, 10,                                     \
      "the crew's guess of a stand: deviation")                                                    \
    X(STAND_YAW_SIGMA, "cart", "stand_error_deg", 0, 0, 2, 0, 90, "and of its direction")          \
    X(SAMPLE_RATE, "head", "samples_hz", 0, 0, 25000, 100, 2000000, "")                            \
    X(BLIND_ARC, "head", "blind_arc_deg", 0, 0, 90, 0, 350,                                        \
      "around straight down: only the cart is there")                                              \
    X(ENCODER_NOISE, "head", "encoder_noise_counts", 0, 0, 0.02, 0, 10,                            \
      "of the interpolated position")                                                              \
    X(RAYS, "head", "rays_per_sample", 0, 0, 4, 1, 16, "sub-rays of the footprint")                \
    X(DIVERGENCE, "head", "divergence_mrad", 0, 0, 0.7, 0, 20, "full angle")                       \
    X(APERTURE, "head", "aperture_mm", 0, 0, 3, 0, 50, "beam at the mirror")                       \
    X(MIN_RANGE, "head", "min_range_m", 0, 0, 0.2, 0, 10, "")                                      \
    X(MAX_RANGE, "head", "max_range_m", 0, 0, 0, 0, 1000, "0: the scene's, or 6 m")                \
    X(AMBIGUITY, "head", "ambiguity_m", 0, 0, 30, 1, 10000, "the modulation repeats")              \
    X(ECHO_SEEN, "head", "echo_seen", 0, 0, 0.00012, 0, 1, "weaker: no return")                    \
    X(ECHO_USABLE, "head", "echo_usable", 0, 0, 0.0003, 0, 1, "weaker: dropped")                   \
    X(ECHO_SATURATES, "head", "echo_saturates", 0, 0, 1.6, 0.001, 1e9,                             \
      "stronger: flagged and biased")                                                              \
    X(ECHO_REFERENCE, "head", "echo_reference", 0, 0, 0.05, 1e-6, 10,                              \
      "where noise and bias are quoted")                                                           \
    X(SIGMA_FLOOR, "head", "sigma_floor_mm", 0, 0, 1.2, 0, 1000, "range noise of a perfect echo")  \
    X(SIGMA_SHOT, "head", "sigma_shot_mm", 0, 0, 1.2, 0, 1000,                                     \
      "range noise at the reference echo")                                                         \
    X(AMBIENT_NOISE, "head", "ambient_noise", 0, 0, 6, 0, 1000, "added variance in full light")    \
    X(BIAS_DECADE, "head", "bias_per_decade_mm", 0, 0, -1.5, -100, 100,                            \
      "range bias by echo strength")                                                               \
    X(SATURATION_BIAS, "head", "saturation_bias_mm", 0, 0, 4, -1000, 1000, "")                     \
    X(INTENSITY_NOISE, "head", "intensity_noise", 0, 0, 0.03, 0, 1, "relative")                    \
    X(OUTLIERS, "head", "outlier_probability", 0, 0, 0.0001, 0, 1, "")                             \
    X(DROPOUTS, "head", "dropout_probability", 0, 0, 0.0005, 0, 1, "")                             \
    X(QUANTUM, "head", "range_step_mm", 0, 0, 0.25, 0, 100, "quantisation")                        \
    X(MIRROR_HZ, "mirror", "speed_hz", 0, 0, 4, 0.5, 50, "")                                       \
    X(MIRROR_WANDER, "mirror", "wander", 0, 0, 0.003, 0, 0.2,                                      \
      "slow relative deviation of the speed")                                                      \
    X(MIRROR_RIPPLE, "mirror", "ripple", 0, 0, 0.001, 0, 0.2, "relative deviation within a turn")  \
    X(MIRROR_SPIN_UP, "mirror", "spin_up_s", 0, 0, 1.5, 0.05, 60, "time constant")                 \
    X(PAN_PER_REV, "pan", "steps_per_revolution", 0, 0, 4, 0.01, 10000, "during a sweep")          \
    X(PAN_FROM, "pan", "from_deg", 0, 0, -90, -360, 360, "")                                       \
    X(PAN_TO, "pan", "to_deg", 0, 0, 90, -360, 360,                                                \
      "180 deg see all around: the beam goes both ways")                                           \
    X(PAN_SLEW, "pan", "slew_deg_s", 0, 0, 20, 0.1, 360, "between positions")                      \
    X(PAN_ACCELERATION, "pan", "acceleration_deg_s2", 0, 0, 60, 0.1, 10000, "")                    \
    X(HEAD_OFFSET, "clocks", "head_offset_s", 0, 0, 12.75, 0, 1e6, "")                             \
    X(HEAD_DRIFT, "clocks", "head_drift_ppm", 0, 0, 21, -1000, 1000, "")                           \
    X(HEAD_WANDER, "clocks", "head_wander_us", 0, 0, 20, 0, 1e6, "")                               \
    X(CONTROLLER_OFFSET, "clocks", "controller_offset_s", 0, 0, 3.5, 0, 1e6, "")                   \
    X(CONTROLLER_DRIFT, "clocks", "controller_drift_ppm", 0, 0, -33, -1000, 1000, "")              \
    X(CONTROLLER_WANDER, "clocks", "controller_wander_us", 0, 0, 30, 0, 1e6, "")                   \
    X(CONTROLLER_JITTER, "clocks", "controller_jitter_us", 0, 0, 0.3, 0, 1e6,                      \
      "of a hardware capture")                                                                     \
    X(HOST_OFFSET, "clocks", "host_offset_s", 0, 0, 1000, 0, 1e6, "")                              \
    X(HOST_DRIFT, "clocks", "host_drift_ppm", 0, 0, 8, -1000, 1000, "")                            \
    X(HOST_WANDER, "clocks", "host_wander_us", 0, 0, 15, 0, 1e6, "")                               \
    X(HOST_LATENCY, "clocks", "host_latency_us", 0, 0, 60, 0, 1e6,                                 \
      "mean wake-up time: exponential")                                                            \
    X(CAMERA_WIDTH, "camera", "width_px", 0, 0, 576, 16, 8192, "portrait")                         \
    X(CAMERA_HEIGHT, "camera", "height_px", 0, 0, 864, 16, 8192, "")                               \
    X(CAMERA_FX, "camera", "focal_x", 1, 0.921, 0.9228, 0.1, 10, "focal length over the width")    \
    X(CAMERA_ASPECT, "camera", "aspect", 1, 1, 1.0004, 0.5, 2,                                     \
      "vertical focal length over horizontal")                                                     \
    X(CAMERA_CX, "camera", "centre_x", 1, 0.5, 0.5026, 0, 1, "principal point over the width")     \
    X(CAMERA_CY, "camera", "centre_y", 1, 0.5, 0.4981, 0, 1, "principal point over the height")    \
    X(CAMERA_K1, "camera", "k1", 1, 0, -0.031, -1, 1,                                              \
      "radial: 30 px at the corners of 1728 x 1152")                                               \
    X(CAMERA_K2, "camera", "k2", 1, 0, 0.0011, -1, 1, "")                                          \
    X(CAMERA_P1, "camera", "p1", 1, 0, 0.0002, -0.1, 0.1, "")                                      \
    X(CAMERA_P2, "camera", "p2", 1, 0, -0.0001, -0.1, 0.1, "")                                     \
    X(CAMERA_X, "camera", "nodal_x_mm", 1, 0, 0, -500, 500, "nodal point in the head frame")       \
    X(CAMERA_Y, "camera", "nodal_y_mm", 1, 0, 0, -500, 500, "")                                    \
    X(CAMERA_Z, "camera", "nodal_z_mm", 1, 0, 0, -500, 500, "")                                    \
    X(CAMERA_YAW, "camera", "yaw_mrad", 1, 0, 6, -200, 200, "camera turned in its mount")          \
    X(CAMERA_PITCH, "camera", "pitch_mrad", 1, 0, -4, -200, 200, "")                               \
    X(CAMERA_ROLL, "camera", "roll_mrad", 1, 0, 5, -200, 200, "")                                  \
    X(CAMERA_VIGNETTE, "camera", "vignetting", 0, 0, 0.35, 0, 1, "light lost in the corners")      \
    X(CAMERA_NOISE, "camera", "noise", 0, 0, 0.004, 0, 1, "read noise, part of white")             \
    X(CAMERA_WELL, "camera", "full_well", 0, 0, 20000, 10, 1e7, "electrons at white")              \
    X(CAMERA_SAMPLES, "camera", "rays_per_pixel", 0, 0, 8, 1, 4096, "")                            \
    X(CAMERA_STEP, "camera", "step_deg", 0, 0, 40, 1, 360, "pan between frames")                   \
    X(CAMERA_TILT, "camera", "tilt_deg", 0, 0, 0, -60, 60, "tilt during frames")

enum twin_config_key {
#define X(name, ...) TWIN_CONFIG_##name,
    TWIN_CONFIG_KEYS(X)
#undef X
        TWIN_CONFIG_COUNT
};

/* A parameter in the unit of its key. Without nominal, .nominal is 0 and means nothing. */
struct twin_config_value {
    double nominal, real;
};

struct twin_config {
    struct twin_config_value value[TWIN_CONFIG_COUNT];
};

enum twin_config_quality { TWIN_PREVIEW, TWIN_FIELD, TWIN_SURVEY };

/* The defaults: quality "field", the figures of the UNC cart. */
struct twin_config twin_config_default(void);

/* A cart without noise, misalignment, play, drift: nominal and true agree, one ray a sample. */
struct twin_config twin_config_ideal(void);

/* Sampling density: preview 12 pan steps a revolution, 1 ray a sample, small frames; field as the
 * UNC cart; survey 3 steps, 8 rays, large frames. */
void twin_config_set_quality(struct twin_config *config, enum twin_config_quality quality);

/* Reads a YAML file over the values already in *config; keys that are absent stay. One line on
 * refusal: file, line, key, bounds. */
ST_MUST_CHECK enum st twin_config_load(const char *path, struct twin_config *config,
                                       struct errctx *err);

/* Sets one value by "section.key=VALUE" (the true one) or "section.key.nominal=VALUE". */
ST_MUST_CHECK enum st twin_config_set(struct twin_config *config, const char *text,
                                      struct errctx *err);

/* Writes all values as YAML with what they mean; ST_IO. */
ST_MUST_CHECK enum st twin_config_write(const struct twin_config *config, FILE *out,
                                        struct errctx *err);

/* The models made of them. */
struct rig twin_config_rig(const struct twin_config *config, bool real);
struct rig_camera twin_config_camera(const struct twin_config *config, bool real);
struct optics twin_config_optics(const struct twin_config *config);

enum twin_config_clock { TWIN_CLOCK_HEAD, TWIN_CLOCK_CONTROLLER, TWIN_CLOCK_HOST };
struct clocks_spec twin_config_clock(const struct twin_config *config,
                                     enum twin_config_clock which);

static inline double twin_config_real(const struct twin_config *config, enum twin_config_key key) {
    return config->value[key].real;
}

#endif
