#include "fusion/rays.h"

#include "base/simd.h"

#include <math.h>
#include <string.h>

static const double two_pi = 6.283185307179586;

struct rays_params rays_params_default(void) {
    struct rays_params params = {.min_range_m = 0.15, .sweep_only = 1, .saturated_sigma_m = 0.005};
    return params;
}

enum st rays_init(struct rays *rays, const struct rig *rig, const struct rays_params *params,
                  const struct noise_model *noise, const struct sweep_index *index,
                  size_t index_count, struct errctx *err) {
    enum st st = rig_check(rig, err);
    if (st)
        return st;
    memset(rays, 0, sizeof *rays);
    rays->rig = *rig;
    rays->params = *params;
    rays->noise = *noise;
    sweep_init(&rays->sweep, index, index_count);
    return ST_OK;
}

/* ---- the kernel ---- */

/* Sine and cosine by reduction to +-pi/4 and the Taylor series to x^15 and x^16 (error below 1e-16
 * there): no branches, so that compilers vectorise it. Good for |x| up to 1e5. */
static inline void sine_cosine(double x, double *out_sin, double *out_cos) {
    static const double hi = 1.5707963267341256, mid = 6.077100506303966e-11,
                        lo = 2.0222662487959506e-21; /* pi / 2 in three parts */
    double k = floor(x * 0.6366197723675814 + 0.5);
    double r = ((x - k * hi) - k * mid) - k * lo, z = r * r;
    double s =
        r +
        r * z *
            (-1.0 / 6 +
             z * (1.0 / 120 + z * (-1.0 / 5040 +
                                   z * (1.0 / 362880 + z * (-1.0 / 39916800 +
                                                            z * (1.0 / 6227020800.0 +
                                                                 z * (-1.0 / 1307674368000.0)))))));
    double c =
        1.0 + z * (-1.0 / 2 +
                   z * (1.0 / 24 +
                        z * (-1.0 / 720 +
                             z * (1.0 / 40320 + z * (-1.0 / 3628800 +
                                                     z * (1.0 / 479001600.0 +
                                                          z * (-1.0 / 87178291200.0 +
                                                               z * (1.0 / 20922789888000.0))))))));
    double quarter = k - 4.0 * floor(k * 0.25);
    double odd = quarter - 2.0 * floor(quarter * 0.5); /* 0 or 1 */
    double minus_s = quarter >= 2.0 ? -1.0 : 1.0;      /* turns 2, 3 */
    double minus_c = quarter == 1.0 || quarter == 2.0 ? -1.0 : 1.0;
    *out_sin = minus_s * (odd != 0.0 ? c : s);
    *out_cos = minus_c * (odd != 0.0 ? s : c);
}

/* The rig's constant vectors: n(theta) = along + across cos(theta) + around sin(theta). */
struct constants {
    struct vec3 along, across, around, laser, mirror;
    double turn_per_count, horizon, ecc_cos, ecc_sin, scale, offset;
};

static struct constants constants_of(const struct rig *rig) {
    struct vec3 a = rig->shaft;
    struct vec3 e0 = vec3_unit(vec3_madd(vec3_make(1, 0, 0), a, -a.x));
    double c = cos(rig->mirror_angle_rad), s = sin(rig->mirror_angle_rad);
    struct constants k = {.along = vec3_scale(a, c),
                          .across = vec3_scale(e0, s),
                          .around = vec3_scale(vec3_cross(a, e0), s),
                          .laser = rig->laser,
                          .mirror = rig->mirror_m,
                          .turn_per_count = two_pi / rig->encoder_counts_per_turn,
                          .horizon = rig->encoder_horizon_counts,
                          .ecc_cos = rig->encoder_ecc_cos_rad,
                          .ecc_sin = rig->encoder_ecc_sin_rad,
                          .scale = rig->range_scale,
                          .offset = rig->range_offset_m - rig->mirror_path_m};
    return k;
}

SC_SIMD_CLONES
static void points_kernel(const struct constants *k, size_t count, const double *restrict counts,
                          const double *restrict pan, const double *restrict tilt,
                          const double *restrict range, double *restrict x, double *restrict y,
                          double *restrict z) {
    for (size_t i = 0; i < count; i++) {
        double phase_s, phase_c, ts, tc, ps, pc, us, uc;
        sine_cosine(k->turn_per_count * counts[i], &phase_s, &phase_c);
        double theta = k->turn_per_count * (counts[i] - k->horizon) + k->ecc_cos * phase_c +
                       k->ecc_sin * phase_s;
        sine_cosine(theta, &ts, &tc);
        sine_cosine(pan[i], &ps, &pc);
        sine_cosine(tilt[i], &us, &uc);
        double nx = k->along.x + k->across.x * tc + k->around.x * ts;
        double ny = k->along.y + k->across.y * tc + k->around.y * ts;
        double nz = k->along.z + k->across.z * tc + k->around.z * ts;
        double bn = -2.0 * (k->laser.x * nx + k->laser.y * ny + k->laser.z * nz);
        double there = range[i] == range[i] ? 1.0 : 0.0; /* NaN: the direction alone */
        double far = there != 0.0 ? k->scale * range[i] + k->offset : 1.0;
        double hx = there * k->mirror.x + far * (k->laser.x + bn * nx);
        double hy = there * k->mirror.y + far * (k->laser.y + bn * ny);
        double hz = there * k->mirror.z + far * (k->laser.z + bn * nz);
        double lx = uc * hx - us * hz; /* tilt, then pan: rig_station_from_head() */
        x[i] = pc * lx - ps * hy;
        y[i] = ps * lx + pc * hy;
        z[i] = us * hx + uc * hz;
    }
}

void rays_points(const struct rig *rig, const struct rays_batch *b) {
    struct constants k = constants_of(rig);
    points_kernel(&k, b->count, b->encoder_counts, b->pan_rad, b->tilt_rad, b->range_m, b->x_m,
                  b->y_m, b->z_m);
}

/* ---- packets ---- */

/* One packet's worth of work space. */
struct lane {
    double counts[HEAD_PACKET_MAX_SAMPLES], pan[HEAD_PACKET_MAX_SAMPLES];
    double tilt[HEAD_PACKET_MAX_SAMPLES], range[HEAD_PACKET_MAX_SAMPLES];
    double x[HEAD_PACKET_MAX_SAMPLES], y[HEAD_PACKET_MAX_SAMPLES], z[HEAD_PACKET_MAX_SAMPLES];
};

static void lane_points(const struct rig *rig, const struct constants *k,
                        const struct head_packet *packet, const struct sweep_place *places,
                        struct lane *lane) {
    for (unsigned i = 0; i < packet->sample_count; i++) {
        lane->counts[i] = places[i].counts;
        lane->pan[i] = rig_pan_angle(rig, places[i].pan_steps, places[i].pan_direction);
        lane->tilt[i] = rig_tilt_angle(rig, places[i].tilt_steps);
        lane->range[i] = head_range_m(packet->samples[i].range);
    }
    points_kernel(k, packet->sample_count, lane->counts, lane->pan, lane->tilt, lane->range,
                  lane->x, lane->y, lane->z);
}

/* Writes the sample, or says why it is left out. */
static bool write_sample(const struct rays *rays, const struct head_sample *in,
                         const struct sweep_place *place, struct vec3 p, struct rays_counts *counts,
                         struct scatter_sample *out) {
    counts->samples++;
    if (place->verdict != SWEEP_GOOD) {
        counts->unplaced++;
        return false;
    }
    if (rays->params.sweep_only && !place->sweep) {
        counts->outside++;
        return false;
    }
    if (in->flags & HEAD_SAMPLE_LASER_OFF) {
        counts->laser_off++;
        return false;
    }
    double range_m = head_range_m(in->range), intensity = in->intensity / 65535.0;
    memset(out, 0, sizeof *out);
    if (in->flags & HEAD_SAMPLE_NO_RETURN) {
        out->flags = SAMPLE_NO_RETURN;
        counts->no_returns++;
    } else if ((in->flags & HEAD_SAMPLE_DROPPED) || isnan(range_m)) {
        out->flags = SAMPLE_DROPPED;
        counts->dropped++;
    } else if (vec3_norm(p) < rays->params.min_range_m) {
        counts->own_cart++;
        return false;
    } else {
        double sigma = noise_sigma(&rays->noise, intensity, range_m);
        if (in->flags & HEAD_SAMPLE_SATURATED)
            sigma = hypot(sigma, rays->params.saturated_sigma_m);
        out->flags = SAMPLE_INTENSITY;
        out->intensity = (float)intensity;
        out->sigma_m = (float)sigma;
        counts->returns++;
    }
    out->p_m[0] = (float)p.x;
    out->p_m[1] = (float)p.y;
    out->p_m[2] = (float)p.z;
    return true;
}

static void add_counts(struct rays_counts *sum, const struct rays_counts *part) {
    sum->samples += part->samples;
    sum->returns += part->returns;
    sum->no_returns += part->no_returns;
    sum->dropped += part->dropped;
    sum->unplaced += part->unplaced;
    sum->outside += part->outside;
    sum->laser_off += part->laser_off;
    sum->own_cart += part->own_cart;
}

size_t rays_packets(struct rays *rays, const struct head_packet *packets, const int64_t *t_host_ns,
                    size_t count, struct scatter_sample *out_samples) {
    struct sweep_place(*placed)[HEAD_PACKET_MAX_SAMPLES] = rays->places;
    struct rays_counts counts[RAYS_BATCH_PACKETS];
    uint8_t written[RAYS_BATCH_PACKETS];
    struct constants k = constants_of(&rays->rig);
    if (count > RAYS_BATCH_PACKETS)
        count = RAYS_BATCH_PACKETS;
    for (size_t n = 0; n < count; n++) /* order matters here, and only here */
        sweep_packet(&rays->sweep, packets + n, t_host_ns[n], placed[n]);
#pragma omp parallel for schedule(static)
    for (size_t n = 0; n < count; n++) {
        struct lane lane;
        memset(&counts[n], 0, sizeof counts[n]);
        lane_points(&rays->rig, &k, packets + n, placed[n], &lane);
        uint8_t at = 0;
        for (unsigned i = 0; i < packets[n].sample_count; i++)
            at = (uint8_t)(at + write_sample(rays, &packets[n].samples[i], &placed[n][i],
                                             vec3_make(lane.x[i], lane.y[i], lane.z[i]), &counts[n],
                                             out_samples + n * HEAD_PACKET_MAX_SAMPLES + at));
        written[n] = at;
    }
    size_t total = 0;
    for (size_t n = 0; n < count; n++) { /* close the gaps */
        memmove(out_samples + total, out_samples + n * HEAD_PACKET_MAX_SAMPLES,
                written[n] * sizeof *out_samples);
        total += written[n];
        add_counts(&rays->counts, &counts[n]);
    }
    return total;
}
