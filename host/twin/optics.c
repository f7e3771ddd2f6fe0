#include "twin/optics.h"

#include "base/head_packet.h"

#include <string.h>

static const double pi = 3.14159265358979323846;
static const double response_m = 2.0; /* where the echo has fallen to a half */
static const double past_m =
    1e-5; /* start of a ray that goes on: above the float resolution at 50 m */

enum { MAX_ECHOES = OPTICS_MAX_RAYS * 4, MAX_BOUNCES = 5 };

struct optics optics_default(void) {
    struct optics optics = {.rays = 4,
                            .divergence_rad = 0.0007,
                            .aperture_m = 0.003,
                            .min_range_m = 0.2,
                            .max_range_m = 6,
                            .ambiguity_m = 30,
                            .echo_seen = 0.00012,
                            .echo_usable = 0.0003,
                            .echo_saturates = 1.6,
                            .echo_reference = 0.05,
                            .sigma_floor_m = 0.0012,
                            .sigma_shot_m = 0.0012,
                            .ambient_noise = 6,
                            .bias_per_decade_m = -0.0015,
                            .saturation_bias_m = 0.004,
                            .intensity_noise = 0.03,
                            .outlier_probability = 0.0001,
                            .dropout_probability = 0.0005,
                            .quantum_m = 0.00025};
    return optics;
}

struct optics optics_ideal(void) {
    struct optics optics = {.rays = 1,
                            .max_range_m = 1000,
                            .ambiguity_m = 4000,
                            .echo_saturates = 1e9,
                            .echo_reference = 1};
    return optics;
}

struct echo {
    double r_m, energy;
    uint16_t part;
    struct vec3 p_m, normal;
};

struct echoes {
    struct echo list[MAX_ECHOES];
    int count;
    /* albedo of the part met last: a footprint mostly sees one surface, and patterns are costly */
    int cached_part;
    float cached_albedo, cached_roughness, cached_f0;
};

static void add(struct echoes *e, double r_m, double energy, const struct trace_hit *hit) {
    if (e->count < MAX_ECHOES && energy > 0) {
        struct echo one = {r_m, energy, hit->part, hit->p_m, hit->normal};
        e->list[e->count++] = one;
    }
}

/* Strength of a specular lobe straight back (Beckmann 1963), relative to a white Lambert surface.
 */
static double lobe(double reflectance, double roughness, double cos_i) {
    double alpha = roughness * roughness > 0.02 ? roughness * roughness : 0.02;
    double c2 = cos_i * cos_i, a2 = alpha * alpha;
    if (c2 < 1e-4)
        return 0;
    return reflectance * exp(-(1 - c2) / (c2 * a2)) / (4 * a2 * c2 * c2) * cos_i;
}

static void look_up(const struct scene *scene, const struct trace_hit *hit, struct echoes *e) {
    if (e->cached_part == hit->part)
        return;
    struct material_sample sample;
    scene_sample(scene, hit, true, &sample);
    e->cached_part = hit->part;
    e->cached_albedo = sample.albedo_ir;
    e->cached_roughness = sample.roughness;
    e->cached_f0 = sample.f0;
}

/* One surface that the sub-ray meets at path length r with weight *w: adds its echo, and says how
 * the ray goes on: 0 it ends, 1 straight, 2 reflected. *w becomes the weight beyond. */
static int meet(const struct scene *scene, const struct trace_hit *hit, struct vec3 dir, double r_m,
                double *w, struct echoes *e) {
    const struct material *m = &scene->material[scene->part[hit->part].material];
    double cos_i = -vec3_dot(hit->normal, dir);
    double x = r_m / response_m, scale = *w / (1 + x * x);
    look_up(scene, hit, e);
    double albedo = (double)e->cached_albedo, f0 = (double)e->cached_f0;
    double roughness = (double)e->cached_roughness;
    double fresnel = material_fresnel(f0, cos_i);
    switch (m->kind) {
    case MATERIAL_GLASS: {
        add(e, r_m, scale * (albedo * cos_i + lobe(f0, 0.15, cos_i)), hit);
        double through = (double)m->transmission_ir * (1 - fresnel);
        *w *= through * through;
        return *w > 1e-5;
    }
    case MATERIAL_METAL: {
        double rough = roughness > 0.3 ? 0.35 * albedo * cos_i : 0.02 * albedo * cos_i;
        add(e, r_m, scale * (rough + lobe(albedo, roughness, cos_i)), hit);
        if (roughness > 0.3)
            return 0;
        *w *= albedo * albedo * (1 - roughness);
        return *w > 1e-5 ? 2 : 0;
    }
    case MATERIAL_COATED:
        add(e, r_m, scale * (albedo * cos_i * (1 - fresnel) + lobe(f0, roughness, cos_i)), hit);
        *w *= fresnel * fresnel *
              (roughness < 0.25 ? 1 : 0); /* at grazing incidence paint is a mirror */
        return *w > 1e-3 ? 2 : 0;
    case MATERIAL_RETRO: {
        double back = cos_i > 0.3 ? (double)m->retro * (cos_i - 0.3) / 0.7 : 0;
        add(e, r_m, scale * (albedo * cos_i + back), hit);
        return 0;
    }
    case MATERIAL_MATT:
    case MATERIAL_EMITTER:
        add(e, r_m, scale * (albedo * cos_i * (1 - fresnel) + lobe(f0, roughness, cos_i)), hit);
        return 0;
    }
    return 0;
}

/* Follows one sub-ray whose first hit is known. */
static void follow(const struct scene *scene, const struct trace_ray *first, struct trace_hit hit,
                   struct echoes *e) {
    struct trace_ray ray = *first;
    double w = 1, path_m = 0;
    for (int i = 0; i < MAX_BOUNCES; i++) {
        double r_m = path_m + hit.t_m;
        int on = meet(scene, &hit, ray.dir, r_m, &w, e);
        if (!on)
            return;
        if (on == 2) {
            ray.dir = vec3_unit(vec3_madd(ray.dir, hit.normal, -2 * vec3_dot(ray.dir, hit.normal)));
            ray.origin_m = hit.p_m;
            path_m = r_m;
            ray.t_min_m = past_m;
        } else {
            ray.t_min_m = hit.t_m + past_m;
        }
        if (!trace_first(scene->trace, &ray, &hit))
            return;
    }
}

/* Offsets of sub-ray k of n on the unit disc: sunflower points, turned by `turn`. */
static void disc_point(int k, int n, double turn, double *x, double *y) {
    double r = n > 1 ? sqrt((k + 0.5) / n) : 0, a = turn + 2.399963229728653 * k;
    *x = r * cos(a);
    *y = r * sin(a);
}

/* Does this echo come from another surface than the strongest one? At grazing incidence one surface
 * alone spreads over much range: then the point is in its plane. */
static bool elsewhere(const struct echo *echo, const struct echo *strongest) {
    const double apart_m = 0.05, off_plane_m = 0.02;
    double off_m = vec3_dot(vec3_sub(echo->p_m, strongest->p_m), strongest->normal);
    return fabs(echo->r_m - strongest->r_m) > apart_m && fabs(off_m) > off_plane_m;
}

/* The sum of the echoes. */
static void combine(const struct optics *optics, const struct echoes *e, struct optics_echo *out) {
    int strongest = 0;
    for (int i = 0; i < e->count; i++) {
        out->energy += e->list[i].energy;
        strongest = e->list[i].energy > e->list[strongest].energy ? i : strongest;
    }
    double reference = e->list[strongest].r_m, re = 0, im = 0;
    double k = 2 * pi / optics->ambiguity_m;
    out->nearest_m = out->farthest_m = reference;
    for (int i = 0; i < e->count; i++) {
        double r = e->list[i].r_m, energy = e->list[i].energy;
        re += energy * cos(k * (r - reference));
        im += energy * sin(k * (r - reference));
        if (energy < 0.02 * out->energy)
            continue;
        out->nearest_m = r < out->nearest_m ? r : out->nearest_m;
        out->farthest_m = r > out->farthest_m ? r : out->farthest_m;
    }
    out->distance_m = reference + atan2(im, re) / k;
    out->part = e->list[strongest].part;
    double apart = 0;
    for (int i = 0; i < e->count; i++)
        if (elsewhere(&e->list[i], &e->list[strongest]))
            apart += e->list[i].energy;
    out->mixed = apart >= 0.05 * out->energy;
    out->echoes = (uint8_t)e->count;
}

void optics_shoot(const struct scene *scene, const struct optics *optics,
                  const struct optics_beam *beam, struct rng *rng, struct optics_echo *out_echo) {
    struct echoes e = {.count = 0, .cached_part = -1};
    memset(out_echo, 0, sizeof *out_echo);
    out_echo->distance_m = out_echo->nearest_m = out_echo->farthest_m = (double)NAN;
    int n = optics->rays < 1 ? 1 : optics->rays > OPTICS_MAX_RAYS ? OPTICS_MAX_RAYS : optics->rays;
    double turn = n > 1 ? 2 * pi * rng_uniform(rng) : 0;
    struct vec3 pick = fabs(beam->dir.z) < 0.9 ? vec3_make(0, 0, 1) : vec3_make(1, 0, 0);
    struct vec3 e1 = vec3_unit(vec3_cross(beam->dir, pick)), e2 = vec3_cross(beam->dir, e1);
    for (int base = 0; base < n; base += 4) {
        struct trace_ray rays[4];
        struct trace_hit hits[4];
        int count = n - base < 4 ? n - base : 4;
        for (int k = 0; k < count; k++) {
            double x, y, tau = (base + k + 0.5) / n - 0.5;
            disc_point(base + k, n, turn, &x, &y);
            double half = optics->divergence_rad / 2, radius = optics->aperture_m / 2;
            struct vec3 d = vec3_madd(beam->dir, beam->sweep, tau);
            d = n > 1 ? vec3_unit(vec3_madd(vec3_madd(d, e1, half * x), e2, half * y)) : d;
            rays[k].origin_m = vec3_madd(vec3_madd(beam->origin_m, e1, radius * x), e2, radius * y);
            rays[k].dir = d;
            rays[k].t_min_m = 0;
            rays[k].t_max_m = INFINITY;
        }
        unsigned hit = trace_first4(scene->trace, rays, count, hits);
        for (int k = 0; k < count; k++)
            if (hit >> k & 1u)
                follow(scene, &rays[k], hits[k], &e);
    }
    if (!e.count)
        return;
    for (int i = 0; i < e.count; i++)
        e.list[i].energy /= n;
    combine(optics, &e, out_echo);
}

/* Decides whether there is a range at all. */
static uint8_t classify(const struct optics *optics, const struct optics_echo *echo,
                        double wrapped_m, struct rng *rng) {
    if (!(echo->energy > optics->echo_seen) || !(wrapped_m <= optics->max_range_m))
        return HEAD_SAMPLE_NO_RETURN;
    if (echo->energy < optics->echo_usable || echo->energy > 8 * optics->echo_saturates ||
        wrapped_m < optics->min_range_m)
        return HEAD_SAMPLE_DROPPED;
    if (optics->dropout_probability > 0 && rng_uniform(rng) < optics->dropout_probability)
        return HEAD_SAMPLE_DROPPED;
    return echo->energy > optics->echo_saturates ? HEAD_SAMPLE_SATURATED : 0;
}

void optics_detect(const struct optics *optics, const struct optics_echo *echo, double ambient,
                   struct rng *rng, struct optics_reading *out_reading) {
    struct optics_reading *r = out_reading;
    memset(r, 0, sizeof *r);
    double d = echo->distance_m, energy = echo->energy;
    double wrapped_m = d - optics->ambiguity_m * floor(d / optics->ambiguity_m); /* NaN stays */
    r->flags = classify(optics, echo, wrapped_m, rng);
    double shown =
        energy * (1 + optics->intensity_noise * rng_normal(rng)) / 2; /* full scale at 2 */
    r->intensity = shown < 0 ? 0 : shown > 1 ? 1 : shown;
    r->ambient = ambient;
    r->distance_m = r->sigma_m = r->bias_m = (double)NAN;
    if (r->flags & (HEAD_SAMPLE_NO_RETURN | HEAD_SAMPLE_DROPPED))
        return;
    double ratio = energy / optics->echo_reference;
    r->sigma_m = sqrt(optics->sigma_floor_m * optics->sigma_floor_m +
                      optics->sigma_shot_m * optics->sigma_shot_m / ratio *
                          (1 + optics->ambient_noise * ambient));
    r->bias_m = optics->bias_per_decade_m * log10(ratio);
    if (r->flags & HEAD_SAMPLE_SATURATED)
        r->bias_m += optics->saturation_bias_m * log(energy / optics->echo_saturates);
    double measured = wrapped_m + r->bias_m + r->sigma_m * rng_normal(rng);
    if (optics->outlier_probability > 0 && rng_uniform(rng) < optics->outlier_probability)
        measured = rng_range(rng, optics->min_range_m, optics->max_range_m);
    if (optics->quantum_m > 0)
        measured = optics->quantum_m * floor(measured / optics->quantum_m + 0.5);
    r->distance_m = measured > 0 ? measured : 0;
}
