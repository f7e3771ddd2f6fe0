/* Head samples to points: the rig model over whole packets, fast, and its derivatives.
 *
 * The kernel computes what sweep_point() of base does for one sample, for thousands at a time: the
 * mirror's normal is A + C cos(theta) + S sin(theta) with constant vectors, so a sample costs three
 * sines and cosines and some thirty multiplications. sweep_point() is its oracle. */
#ifndef SC_FUSION_RAYS_H
#define SC_FUSION_RAYS_H

#include "base/head_packet.h"
#include "base/rig.h"
#include "base/st.h"
#include "base/sweep.h"
#include "fusion/noise.h"
#include "fusion/scatter.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What became of the samples. */
struct rays_counts {
    int64_t samples, returns, no_returns, dropped;
    int64_t unplaced;  /* no index pulse before or after them */
    int64_t outside;   /* taken on the way to the sweep's start: left out */
    int64_t laser_off; /* nothing was sent: left out */
    int64_t own_cart;  /* nearer than the cart itself reaches: left out */
};

struct rays_params {
    double min_range_m;       /* from the station's origin; what is nearer is the cart itself */
    int32_t sweep_only;       /* 1: leave out samples taken while the head moved to its place */
    double saturated_sigma_m; /* added to the sigma of samples near the detector's limit */
};
/* 0.15 m, sweep only, 5 mm. */
struct rays_params rays_params_default(void);

enum { RAYS_BATCH_PACKETS = 256 };

/* State of one station's stream; 420 kB, for the heap. */
struct rays {
    struct rig rig;
    struct rays_params params;
    struct noise_model noise;
    struct sweep sweep;
    struct rays_counts counts;
    struct sweep_place places[RAYS_BATCH_PACKETS][HEAD_PACKET_MAX_SAMPLES]; /* scratch */
};

/* `index` must be sorted by revolution and outlive the state. ST_INVALID for a bad rig. */
ST_MUST_CHECK enum st rays_init(struct rays *rays, const struct rig *rig,
                                const struct rays_params *params, const struct noise_model *noise,
                                const struct sweep_index *index, size_t index_count,
                                struct errctx *err);

/* Packets, in the order they were sent, to samples in the station frame. `out_samples` has room for
 * HEAD_PACKET_MAX_SAMPLES a packet. count <= RAYS_BATCH_PACKETS. Bounded memory: none but the
 * caller's and the stack's. Threads: OpenMP inside, same bytes for any number. */
size_t rays_packets(struct rays *rays, const struct head_packet *packets, const int64_t *t_host_ns,
                    size_t count, struct scatter_sample *out_samples);

/* ---- the kernel ---- */

/* Points p (3 x count, x then y then z) of samples with encoder counts, pan and tilt angles and
 * reported ranges. NaN ranges give the unit direction instead and out_is_direction 1. */
struct rays_batch {
    size_t count;
    const double *encoder_counts, *pan_rad, *tilt_rad, *range_m; /* [count] */
    double *x_m, *y_m, *z_m;                                     /* [count] */
};
void rays_points(const struct rig *rig, const struct rays_batch *batch);

/* ---- derivatives ---- */

/* What a point depends on, in the order of the Jacobian's columns. Rotations are small turns about
 * axes of the head frame, applied after what is there: a' = exp([w]x) a. */
enum rays_parameter {
    RAYS_SHAFT_X,
    RAYS_SHAFT_Z, /* turn of the shaft about head x, z, rad */
    RAYS_LASER_X,
    RAYS_LASER_Z,      /* turn of the laser, rad */
    RAYS_MIRROR_ANGLE, /* rad */
    RAYS_MIRROR_X,
    RAYS_MIRROR_Y,
    RAYS_MIRROR_Z, /* m */
    RAYS_MIRROR_PATH,
    RAYS_RANGE_SCALE,
    RAYS_RANGE_OFFSET,
    RAYS_HORIZON, /* counts */
    RAYS_ECC_COS,
    RAYS_ECC_SIN, /* rad */
    RAYS_PAN_STEPS_PER_TURN,
    RAYS_PAN_ZERO,
    RAYS_PAN_BACKLASH,
    RAYS_TILT_STEPS_PER_TURN,
    RAYS_TILT_ZERO,
    RAYS_PARAMETERS
};
enum rays_measure { RAYS_COUNTS, RAYS_PAN_STEPS, RAYS_TILT_STEPS, RAYS_RANGE, RAYS_MEASURES };

struct rays_jacobian {
    struct vec3 p_m;
    double dp_dparameter[3][RAYS_PARAMETERS];
    double dp_dmeasure[3][RAYS_MEASURES]; /* of what was measured: m/count, m/step, m/step, m/m */
};

/* The point of one sample and its derivatives (analytic; the rig's own equations, see rig.h). */
void rays_differentiate(const struct rig *rig, const struct sweep_place *place, double range_m,
                        struct rays_jacobian *out_jacobian);

#ifdef __cplusplus
}
#endif
#endif
