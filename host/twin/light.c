#include "twin/light.h"

#include "twin/noise3.h"

#include <string.h>

static const double pi = 3.14159265358979323846;
static const double off_m = 2e-5; /* start of secondary rays, above the float resolution at 50 m */

enum { MAX_PANES = 6 };

static void axes(struct vec3 n, struct vec3 *u, struct vec3 *v) {
    struct vec3 pick = fabs(n.z) < 0.9 ? vec3_make(0, 0, 1) : vec3_make(1, 0, 0);
    *u = vec3_unit(vec3_cross(n, pick));
    *v = vec3_cross(n, *u);
}

static struct vec3 cosine_direction(struct vec3 n, struct rng *rng) {
    struct vec3 u, v;
    axes(n, &u, &v);
    double a = 2 * pi * rng_uniform(rng), q = rng_uniform(rng), r = sqrt(q);
    struct vec3 d = vec3_madd(vec3_scale(u, r * cos(a)), v, r * sin(a));
    return vec3_unit(vec3_madd(d, n, sqrt(1 - q)));
}

static struct trace_ray ray_from(struct vec3 p, struct vec3 normal, struct vec3 dir, double t_max) {
    struct trace_ray ray = {vec3_madd(p, normal, off_m), dir, off_m, t_max};
    return ray;
}

static struct vec3 mirror(struct vec3 d, struct vec3 n) {
    return vec3_madd(d, n, -2 * vec3_dot(d, n));
}

/* ---- sky ---- */

static float stars(struct vec3 d) {
    float x = (float)d.x * 180, y = (float)d.y * 180, z = (float)d.z * 180;
    struct noise3_cells c = noise3_worley(x, y, z, 77);
    float magnitude = (float)(c.id >> 4 & 255) / 255.0f;
    return c.f1 < 0.09f ? magnitude * magnitude * magnitude * (1 - c.f1 / 0.09f) : 0;
}

void light_sky(const struct scene *scene, struct vec3 dir, double factor, float out_rgb[3]) {
    const struct scene_sky *sky = &scene->sky;
    double up = dir.z > 0 ? 1 - pow(1 - dir.z, 4) : 0;
    double glow = exp(-fabs(dir.z) * 9);
    for (int i = 0; i < 3; i++) {
        double c =
            dir.z < 0 ? sky->ground[i] : sky->horizon[i] + (sky->zenith[i] - sky->horizon[i]) * up;
        out_rgb[i] = (float)(factor * (c + (dir.z < 0 ? 0 : 0.25 * glow * sky->horizon[i])));
    }
    if (sky->stars && dir.z > 0.05) {
        float s = stars(dir) * (float)factor * 0.25f * noise3_smooth(0.05f, 0.4f, (float)dir.z);
        out_rgb[0] += s;
        out_rgb[1] += s;
        out_rgb[2] += 1.1f * s;
    }
}

/* ---- lamps ---- */

/* A random point's direction, distance, and unshadowed irradiance on n. */
static int lamp_sample(const struct scene_light *light, struct vec3 p, struct vec3 n,
                       struct rng *rng, struct vec3 *dir, double *distance_m, double e[3]) {
    struct vec3 to = vec3_sub(light->position_m, p), off = rng_direction(rng);
    if (light->cos_outer > -1) /* a spot is a disc before its housing */
        off = vec3_madd(off, light->dir, -vec3_dot(off, light->dir));
    else if (vec3_dot(off, to) > 0) /* a ball shows its near half */
        off = vec3_scale(off, -1);
    to = vec3_madd(to, off, light->radius_m);
    double d2 = vec3_dot(to, to), d = sqrt(d2);
    if (d < 1e-4)
        return 0;
    *dir = vec3_scale(to, 1 / d);
    *distance_m = d;
    double cos_i = vec3_dot(*dir, n);
    if (cos_i <= 0)
        return 0;
    double cone = 1;
    if (light->cos_outer > -1) {
        double c = -vec3_dot(*dir, light->dir);
        double t = (c - light->cos_outer) / (light->cos_inner - light->cos_outer + 1e-9);
        t = t < 0 ? 0 : t > 1 ? 1 : t;
        cone = t * t * (3 - 2 * t);
    }
    double k = cone * cos_i / (d2 + light->radius_m * light->radius_m);
    for (int i = 0; i < 3; i++)
        e[i] = light->rgb[i] * k;
    return k > 0;
}

static int blocked(const struct scene *scene, struct vec3 p, struct vec3 normal, struct vec3 dir,
                   double distance_m) {
    struct trace_ray ray = ray_from(p, normal, dir, distance_m);
    struct trace_hit hit;
    /* Glass lets light through: go on behind up to a few panes. */
    for (int i = 0; i < 4; i++) {
        if (!trace_first(scene->trace, &ray, &hit))
            return 0;
        enum material_kind kind = scene->material[scene->part[hit.part].material].kind;
        if (kind == MATERIAL_EMITTER)
            return 0;
        if (kind != MATERIAL_GLASS)
            return 1;
        ray.t_min_m = hit.t_m + off_m;
    }
    return 1;
}

/* Lamps seen in a mirror direction: the radiance of those whose ball the ray meets, blurred by
 * `blur` (rad), over the visibility. */
static void glints(const struct scene *scene, struct vec3 p, struct vec3 normal, struct vec3 dir,
                   double blur, double factor, float out[3]) {
    for (size_t l = 0; l < scene->light_count; l++) {
        const struct scene_light *light = &scene->light[l];
        struct vec3 to = vec3_sub(light->position_m, p);
        double d = vec3_norm(to), cos_off = vec3_dot(to, dir) / d;
        if (!(cos_off > 0.9) || d < 0.05)
            continue;
        double size = light->radius_m / d + blur, off = sqrt(2 * (1 - (cos_off < 1 ? cos_off : 1)));
        double cone =
            light->cos_outer > -1 && -vec3_dot(to, light->dir) / d < light->cos_outer ? 0.05 : 1;
        double k = 1 - off / size;
        if (k <= 0 || blocked(scene, p, normal, vec3_scale(to, 1 / d), d))
            continue;
        /* intensity / (pi size^2 d^2) is the radiance of a disc of that angular size */
        k = cone * (k < 0.3 ? k / 0.3 : 1) / (pi * size * size * d * d);
        for (int i = 0; i < 3; i++) {
            double limit = 40 * scene->exposure, v = factor * light->rgb[i] * k;
            out[i] += (float)(v > limit ? limit : v);
        }
    }
}

/* What a glossy surface sends towards -dir of light from `to` (GGX, Walter et al. 2007), over the
 * irradiance. */
static double gloss(const struct light_surface *s, struct vec3 to) {
    double alpha = (double)(s->material.roughness * s->material.roughness);
    alpha = alpha < 0.004 ? 0.004 : alpha;
    struct vec3 h = vec3_unit(vec3_sub(to, s->dir));
    double nh = vec3_dot(s->normal, h), nv = -vec3_dot(s->normal, s->dir), a2 = alpha * alpha;
    if (nh <= 0 || nv <= 0)
        return 0;
    double q = nh * nh * (a2 - 1) + 1, d = a2 / (pi * q * q);
    double f = material_fresnel((double)s->material.f0, vec3_dot(h, to));
    return f * d / (4 * (nv > 0.05 ? nv : 0.05));
}

/* Direct light of all lamps and the sun: irradiance / pi, and highlights as radiance. */
static void direct(const struct scene *scene, const struct light_surface *s, double factor,
                   int highlights, struct rng *rng, float out[3], float shine[3]) {
    for (size_t l = 0; l <= scene->light_count; l++) {
        struct vec3 dir;
        double distance_m = 1e6, e[3];
        if (l < scene->light_count) {
            if (!lamp_sample(&scene->light[l], s->hit.p_m, s->normal, rng, &dir, &distance_m, e))
                continue;
        } else {
            const struct scene_sky *sky = &scene->sky;
            if (sky->sun_rgb[0] + sky->sun_rgb[1] + sky->sun_rgb[2] <= 0)
                continue;
            dir = vec3_unit(vec3_madd(sky->sun_dir, rng_direction(rng), sky->sun_angle_rad));
            double cos_i = vec3_dot(dir, s->normal);
            if (cos_i <= 0)
                continue;
            for (int i = 0; i < 3; i++)
                e[i] = sky->sun_rgb[i] * cos_i;
        }
        if (e[0] + e[1] + e[2] < 1e-4 * scene->exposure ||
            blocked(scene, s->hit.p_m, s->hit.normal, dir, distance_m))
            continue;
        double g = highlights ? gloss(s, dir) : 0;
        g = g > 30 ? 30 : g;
        for (int i = 0; i < 3; i++) {
            out[i] += (float)(factor * e[i] / pi);
            shine[i] += (float)(factor * e[i] * g);
        }
    }
}

/* ---- surfaces ---- */

static void describe(const struct scene *scene, const struct trace_hit *hit, struct vec3 dir,
                     bool coarse, struct light_surface *s) {
    s->hit = *hit;
    s->dir = dir;
    s->kind = scene->material[scene->part[hit->part].material].kind;
    scene_sample(scene, hit, coarse, &s->material);
    s->normal = vec3_unit(vec3_add(hit->shading, s->material.bump));
    if (vec3_dot(s->normal, dir) > -0.02)
        s->normal = hit->shading;
    s->found = true;
}

/* Radiance along a secondary ray, roughly: direct light, the sky, lamps; no further bounce. */
static void glimpse(const struct scene *scene, struct trace_ray ray, double factor, struct rng *rng,
                    float out[3]) {
    float weight = 1;
    memset(out, 0, 3 * sizeof *out);
    for (int i = 0; i < 3; i++) {
        struct trace_hit hit;
        if (!trace_first(scene->trace, &ray, &hit)) {
            float sky[3];
            light_sky(scene, ray.dir, factor, sky);
            for (int k = 0; k < 3; k++)
                out[k] += weight * sky[k];
            return;
        }
        struct light_surface s;
        describe(scene, &hit, ray.dir, true, &s);
        for (int k = 0; k < 3; k++)
            out[k] += weight * (float)factor * s.material.emission[k];
        if (s.kind == MATERIAL_EMITTER)
            return;
        if (s.kind == MATERIAL_GLASS) {
            ray.t_min_m = hit.t_m + off_m;
            weight *= 0.85f;
            continue;
        }
        if (s.kind == MATERIAL_METAL) {
            ray = ray_from(hit.p_m, hit.normal, mirror(ray.dir, s.normal), 1e6);
            weight *= s.material.rgb[1];
            continue;
        }
        float lit[3] = {0, 0, 0}, shine[3] = {0, 0, 0}, sky[3];
        direct(scene, &s, factor, 1, rng, lit, shine);
        light_sky(scene, s.normal, factor, sky);
        for (int k = 0; k < 3; k++) /* a quarter of the sky stands for all that is not followed */
            out[k] += weight * (s.material.rgb[k] * (lit[k] + 0.25f * sky[k]) + shine[k]);
        return;
    }
}

static void add_scaled(float out[3], const float in[3], const float by[3], float k) {
    for (int i = 0; i < 3; i++)
        out[i] += in[i] * by[i] * k;
}

void light_look(const struct scene *scene, const struct trace_ray *ray, double factor,
                struct rng *rng, struct light_surface *out) {
    struct trace_ray on = *ray;
    memset(out, 0, sizeof *out);
    for (int i = 0; i < 3; i++)
        out->through[i] = 1;
    for (int pane = 0; pane < MAX_PANES; pane++) {
        struct trace_hit hit;
        float light[3];
        if (!trace_first(scene->trace, &on, &hit)) {
            light_sky(scene, on.dir, factor, light);
            add_scaled(out->added, light, out->through, 1);
            return;
        }
        describe(scene, &hit, on.dir, false, out);
        for (int i = 0; i < 3; i++)
            out->added[i] += out->through[i] * (float)factor * out->material.emission[i];
        if (out->kind == MATERIAL_EMITTER) {
            out->found = false;
            return;
        }
        if (out->kind != MATERIAL_GLASS)
            return;
        double f = material_fresnel((double)out->material.f0, -vec3_dot(out->normal, on.dir));
        if (pane < 2) {
            struct vec3 back = mirror(on.dir, out->normal);
            glimpse(scene, ray_from(hit.p_m, hit.normal, back, 1e6), factor, rng, light);
            glints(scene, hit.p_m, hit.normal, back, 0.006, factor, light);
            add_scaled(out->added, light, out->through, (float)f);
        }
        for (int i = 0; i < 3; i++)
            out->through[i] *= out->material.rgb[i] * (float)(1 - f);
        on.t_min_m = hit.t_m + off_m;
    }
    out->found = false;
}

/* A direction near the mirror direction, spread by the roughness. */
static struct vec3 rough_mirror(const struct light_surface *s, struct rng *rng) {
    double alpha = (double)(s->material.roughness * s->material.roughness);
    struct vec3 u, v;
    axes(s->normal, &u, &v);
    double q = rng_uniform(rng), a = 2 * pi * rng_uniform(rng);
    double tan2 = alpha * alpha * q / (1 - q + 1e-9), c = 1 / sqrt(1 + tan2), r = sqrt(1 - c * c);
    struct vec3 h = vec3_madd(vec3_madd(vec3_scale(s->normal, c), u, r * cos(a)), v, r * sin(a));
    struct vec3 d = vec3_unit(mirror(s->dir, h));
    return vec3_dot(d, s->hit.normal) > 0.01 ? d : mirror(s->dir, s->hit.normal);
}

void light_gather(const struct scene *scene, const struct light_surface *surface, double factor,
                  struct rng *rng, struct light_arriving *out) {
    const struct light_surface *s = surface;
    memset(out, 0, sizeof *out);
    float light[3];
    double cos_v = -vec3_dot(s->normal, s->dir);
    if (s->kind == MATERIAL_METAL) {
        glimpse(scene, ray_from(s->hit.p_m, s->hit.normal, rough_mirror(s, rng), 1e6), factor, rng,
                light);
        add_scaled(out->mirrored, light, s->material.rgb, 1);
        return;
    }
    direct(scene, s, factor, 1, rng, out->direct, out->mirrored);
    /* one bounce */
    struct vec3 d = cosine_direction(s->normal, rng);
    if (vec3_dot(d, s->hit.normal) > 0) {
        glimpse(scene, ray_from(s->hit.p_m, s->hit.normal, d, 1e6), factor, rng, out->indirect);
        for (int i = 0; i < 3; i++) { /* fireflies */
            float limit = (float)(4 * scene->exposure);
            out->indirect[i] = out->indirect[i] > limit ? limit : out->indirect[i];
        }
    }
    double f = material_fresnel_rough((double)s->material.f0, (double)s->material.roughness, cos_v);
    double smooth = 1 - (double)s->material.roughness / 0.45;
    if (smooth > 0 && f * smooth > 0.005) {
        glimpse(scene, ray_from(s->hit.p_m, s->hit.normal, rough_mirror(s, rng), 1e6), factor, rng,
                light);
        for (int i = 0; i < 3; i++) {
            float limit = (float)(20 * scene->exposure);
            out->mirrored[i] += (light[i] > limit ? limit : light[i]) *
                                (float)(f * (smooth > 0.5 ? 1 : 2 * smooth));
        }
    }
}
