#include "analytic.h"

#include "base/rng.h"

#include <math.h>
#include <string.h>

static void add(struct analytic_scene *s, enum analytic_kind kind, struct vec3 at, struct vec3 size,
                double albedo) {
    struct analytic_shape shape = {kind, at, size, albedo};
    s->shapes[s->count++] = shape;
}

static struct vec3 v3(double x, double y, double z) {
    return vec3_make(x, y, z);
}

struct analytic_scene analytic_room(void) {
    struct analytic_scene s = {0};
    add(&s, ANALYTIC_PLANE, v3(0, 0, -1.2), v3(0, 0, 1), 0.35);
    add(&s, ANALYTIC_PLANE, v3(0, 0, 1.8), v3(0, 0, -1), 0.8);
    add(&s, ANALYTIC_PLANE, v3(4, 0, 0), v3(-1, 0, 0), 0.7);
    add(&s, ANALYTIC_PLANE, v3(-4, 0, 0), v3(1, 0, 0), 0.6);
    add(&s, ANALYTIC_PLANE, v3(0, 3, 0), v3(0, -1, 0), 0.65);
    add(&s, ANALYTIC_PLANE, v3(0, -3, 0), v3(0, 1, 0), 0.5);
    add(&s, ANALYTIC_BOX, v3(2.2, 1.4, 0.3), v3(0.2, 0.2, 1.5), 0.45);    /* pillar */
    add(&s, ANALYTIC_BOX, v3(2.0, -1.2, -0.85), v3(0.6, 0.4, 0.35), 0.3); /* crate */
    add(&s, ANALYTIC_BOX, v3(2.1, -1.3, -0.35), v3(0.25, 0.2, 0.15), 0.6);
    add(&s, ANALYTIC_SPHERE, v3(1.6, 0.3, -0.6), v3(0.3, 0, 0), 0.55);
    add(&s, ANALYTIC_SPHERE, v3(-2.0, 1.0, 0.2), v3(0.5, 0, 0), 0.4);
    add(&s, ANALYTIC_BOX, v3(1.8, 0.9, 0.3), v3(0.01, 0.01, 1.5), 0.5);   /* pole, 2 cm */
    add(&s, ANALYTIC_BOX, v3(-1.5, -1.5, -0.7), v3(0.5, 0.3, 0.02), 0.6); /* table top */
    add(&s, ANALYTIC_BOX, v3(-1.9, -1.7, -0.96), v3(0.03, 0.03, 0.24), 0.6);
    add(&s, ANALYTIC_BOX, v3(-1.1, -1.7, -0.96), v3(0.03, 0.03, 0.24), 0.6);
    add(&s, ANALYTIC_BOX, v3(-1.9, -1.3, -0.96), v3(0.03, 0.03, 0.24), 0.6);
    add(&s, ANALYTIC_BOX, v3(-1.1, -1.3, -0.96), v3(0.03, 0.03, 0.24), 0.6);
    add(&s, ANALYTIC_BOX, v3(3.8, 0, 0.4), v3(0.12, 1.0, 0.02), 0.5); /* shelf */
    return s;
}

struct analytic_scene analytic_yard(void) {
    struct analytic_scene s = {0};
    add(&s, ANALYTIC_PLANE, v3(0, 0, -1.2), v3(0, 0, 1), 0.3);
    add(&s, ANALYTIC_BOX, v3(12, 3, 1.8), v3(3, 5, 3), 0.6);
    add(&s, ANALYTIC_BOX, v3(-3, 14, 2.8), v3(6, 3, 4), 0.5);
    add(&s, ANALYTIC_BOX, v3(5, -3, -0.5), v3(2.1, 0.9, 0.7), 0.4);
    add(&s, ANALYTIC_BOX, v3(4, 2, 1.8), v3(0.06, 0.06, 3), 0.5);
    add(&s, ANALYTIC_SPHERE, v3(6, 0.5, -0.4), v3(0.8, 0, 0), 0.5);
    return s;
}

static double cast_box(const struct analytic_shape *b, struct vec3 o, struct vec3 d) {
    double near = -INFINITY, far = INFINITY;
    double oo[3] = {o.x - b->at_m.x, o.y - b->at_m.y, o.z - b->at_m.z};
    double dd[3] = {d.x, d.y, d.z}, h[3] = {b->size_m.x, b->size_m.y, b->size_m.z};
    for (int k = 0; k < 3; k++) {
        if (fabs(dd[k]) < 1e-15) {
            if (fabs(oo[k]) > h[k])
                return (double)NAN;
            continue;
        }
        double t0 = (-h[k] - oo[k]) / dd[k], t1 = (h[k] - oo[k]) / dd[k];
        near = fmax(near, fmin(t0, t1));
        far = fmin(far, fmax(t0, t1));
    }
    if (near > far || far <= 0)
        return (double)NAN;
    return near > 0 ? near : far;
}

static double cast_sphere(const struct analytic_shape *s, struct vec3 o, struct vec3 d) {
    struct vec3 q = vec3_sub(o, s->at_m);
    double b = vec3_dot(q, d), c = vec3_dot(q, q) - s->size_m.x * s->size_m.x;
    double disc = b * b - c;
    if (disc < 0)
        return (double)NAN;
    double t = -b - sqrt(disc);
    if (t <= 0)
        t = -b + sqrt(disc);
    return t > 0 ? t : (double)NAN;
}

static double cast_plane(const struct analytic_shape *p, struct vec3 o, struct vec3 d) {
    double t = vec3_dot(vec3_sub(p->at_m, o), p->size_m) / vec3_dot(d, p->size_m);
    return t > 0 && isfinite(t) ? t : (double)NAN;
}

double analytic_cast(const struct analytic_scene *scene, struct vec3 from_m, struct vec3 dir,
                     double *out_albedo) {
    double best = (double)NAN;
    for (int i = 0; i < scene->count; i++) {
        const struct analytic_shape *s = scene->shapes + i;
        double t = s->kind == ANALYTIC_BOX      ? cast_box(s, from_m, dir)
                   : s->kind == ANALYTIC_SPHERE ? cast_sphere(s, from_m, dir)
                                                : cast_plane(s, from_m, dir);
        if (t > 0 && !(best <= t)) {
            best = t;
            if (out_albedo)
                *out_albedo = s->albedo;
        }
    }
    return best;
}

double analytic_distance(const struct analytic_scene *scene, struct vec3 p) {
    double best = INFINITY;
    for (int i = 0; i < scene->count; i++) {
        const struct analytic_shape *s = scene->shapes + i;
        struct vec3 q = vec3_sub(p, s->at_m);
        double d;
        if (s->kind == ANALYTIC_PLANE) {
            d = fabs(vec3_dot(q, s->size_m));
        } else if (s->kind == ANALYTIC_SPHERE) {
            d = fabs(vec3_norm(q) - s->size_m.x);
        } else {
            double x = fabs(q.x) - s->size_m.x, y = fabs(q.y) - s->size_m.y;
            double z = fabs(q.z) - s->size_m.z;
            double out = vec3_norm(v3(fmax(x, 0), fmax(y, 0), fmax(z, 0)));
            d = out > 0 ? out : fabs(fmax(x, fmax(y, z)));
        }
        best = fmin(best, d);
    }
    return best;
}

struct analytic_scan analytic_scan_default(void) {
    struct analytic_scan scan = {.elevation_step_rad = 1.0 / 500,
                                 .azimuth_step_rad = 1.0 / 500,
                                 .elevation_min_rad = -1.0,
                                 .elevation_max_rad = 1.0,
                                 .azimuth_min_rad = -3.14159265358979,
                                 .azimuth_max_rad = 3.14159265358979,
                                 .sigma_m = 0.004,
                                 .sigma_per_m = 0.0,
                                 .spot_rad = 0.0,
                                 .smear_rad = 0.0,
                                 .max_range_m = 60.0,
                                 .jitter = 0.5,
                                 .dropped_share = 0.0,
                                 .seed = 1};
    return scan;
}

static size_t rows_of(const struct analytic_scan *s) {
    return (size_t)floor((s->elevation_max_rad - s->elevation_min_rad) / s->elevation_step_rad) + 1;
}
static size_t columns_of(const struct analytic_scan *s) {
    return (size_t)floor((s->azimuth_max_rad - s->azimuth_min_rad) / s->azimuth_step_rad) + 1;
}

size_t analytic_scan_count(const struct analytic_scan *scan) {
    return rows_of(scan) * columns_of(scan);
}

static struct vec3 direction(double az, double el) {
    return v3(cos(el) * cos(az), cos(el) * sin(az), sin(el));
}

/* Mean range over the beam; NaN if less than half of it hits. */
static double beam(const struct analytic_scene *scene, const struct analytic_scan *scan, double az,
                   double el, double *out_albedo) {
    if (scan->spot_rad <= 0 && scan->smear_rad <= 0)
        return analytic_cast(scene, scan->from_m, direction(az, el), out_albedo);
    enum { SPOT = 7, SMEAR = 3 };
    static const double disc[SPOT][2] = {{0, 0},          {0.7, 0},        {-0.7, 0},
                                         {0.35, 0.6062},  {0.35, -0.6062}, {-0.35, 0.6062},
                                         {-0.35, -0.6062}};
    double weight = 0, sum = 0;
    int hits = 0;
    for (int m = 0; m < SMEAR; m++)
        for (int k = 0; k < SPOT; k++) {
            double a = az + 0.5 * scan->spot_rad * disc[k][0] / fmax(cos(el), 0.05);
            double e = el + 0.5 * scan->spot_rad * disc[k][1] + scan->smear_rad * (m - 1) / 3.0;
            double albedo = 0, r = analytic_cast(scene, scan->from_m, direction(a, e), &albedo);
            if (!(r <= scan->max_range_m))
                continue;
            hits++;
            weight += albedo;
            sum += albedo * r;
        }
    if (2 * hits < SPOT * SMEAR)
        return (double)NAN;
    *out_albedo = weight / hits;
    return sum / weight;
}

static void scan_sample(const struct analytic_scene *scene, const struct analytic_scan *scan,
                        double az, double el, struct rng *rng, struct scatter_sample *out) {
    double albedo = 0, range_m = beam(scene, scan, az, el, &albedo);
    struct vec3 dir = direction(az, el), p = dir;
    memset(out, 0, sizeof *out);
    double noise = rng_normal(rng), luck = rng_uniform(rng);
    if (luck < scan->dropped_share) {
        out->flags = SAMPLE_DROPPED;
    } else if (!(range_m <= scan->max_range_m)) {
        out->flags = SAMPLE_NO_RETURN;
    } else {
        double sigma = hypot(scan->sigma_m, scan->sigma_per_m * range_m);
        p = vec3_scale(dir, fmax(range_m + sigma * noise, 1e-3));
        out->sigma_m = (float)sigma;
        out->intensity = (float)(albedo * 0.8);
        out->flags = SAMPLE_INTENSITY;
    }
    out->p_m[0] = (float)p.x;
    out->p_m[1] = (float)p.y;
    out->p_m[2] = (float)p.z;
}

void analytic_scan_run(const struct analytic_scene *scene, const struct analytic_scan *scan,
                       struct scatter_sample *out_samples) {
    size_t rows = rows_of(scan), columns = columns_of(scan);
#pragma omp parallel for schedule(dynamic, 8)
    for (size_t c = 0; c < columns; c++) {
        struct rng rng = rng_stream(scan->seed, c);
        for (size_t r = 0; r < rows; r++) {
            double ja = scan->jitter * rng_range(&rng, -0.5, 0.5);
            double je = scan->jitter * rng_range(&rng, -0.5, 0.5);
            double az = scan->azimuth_min_rad + ((double)c + ja) * scan->azimuth_step_rad;
            double el = scan->elevation_min_rad + ((double)r + je) * scan->elevation_step_rad;
            scan_sample(scene, scan, az, el, &rng, out_samples + c * rows + r);
        }
    }
}

void analytic_truth(const struct analytic_scene *scene, struct vec3 from_m,
                    const struct camera *camera, const struct pose *station_from_cam,
                    float *out_disparity_per_m) {
    struct vec3 eye = vec3_add(from_m, station_from_cam->t_m);
#pragma omp parallel for schedule(dynamic, 8)
    for (int32_t y = 0; y < camera->height_px; y++)
        for (int32_t x = 0; x < camera->width_px; x++) {
            struct vec3 ray = camera_pinhole_ray(camera, x, y);
            double norm = vec3_norm(ray);
            struct vec3 dir = mat3_mulv(&station_from_cam->r, vec3_scale(ray, 1.0 / norm));
            double range = analytic_cast(scene, eye, dir, NULL);
            out_disparity_per_m[(size_t)y * (size_t)camera->width_px + (size_t)x] =
                (float)(norm / range);
        }
}
