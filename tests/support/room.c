#include "tests/support/room.h"

#include "base/rng.h"

#include <stdlib.h>

struct hit {
    double t;
    struct vec3 p, n;
    int what;
};

static void hit_plane(struct vec3 o, struct vec3 d, struct vec3 n, double at, int what,
                      struct hit *hit) {
    double along = vec3_dot(d, n);
    double t = (at - vec3_dot(o, n)) / along;
    if (along < 0.0 && t > 1e-9 && t < hit->t)
        *hit = (struct hit){t, vec3_madd(o, d, t), n, what};
}

static void hit_sphere(struct vec3 o, struct vec3 d, struct vec3 c, double r_m, int what,
                       struct hit *hit) {
    struct vec3 q = vec3_sub(o, c);
    double a = vec3_dot(d, d), b = vec3_dot(q, d), s = b * b - a * (vec3_dot(q, q) - r_m * r_m);
    double t = s > 0.0 ? (-b - sqrt(s)) / a : -1.0;
    if (t > 1e-9 && t < hit->t) {
        struct vec3 p = vec3_madd(o, d, t);
        *hit = (struct hit){t, p, vec3_unit(vec3_sub(p, c)), what};
    }
}

static void hit_pillar(struct vec3 o, struct vec3 d, double x_m, double y_m, double r_m, int what,
                       struct hit *hit) {
    double qx = o.x - x_m, qy = o.y - y_m;
    double a = d.x * d.x + d.y * d.y, b = qx * d.x + qy * d.y;
    double s = b * b - a * (qx * qx + qy * qy - r_m * r_m);
    double t = s > 0.0 && a > 0.0 ? (-b - sqrt(s)) / a : -1.0;
    if (t > 1e-9 && t < hit->t) {
        struct vec3 p = vec3_madd(o, d, t);
        *hit = (struct hit){t, p, vec3_make((p.x - x_m) / r_m, (p.y - y_m) / r_m, 0), what};
    }
}

static struct hit cast(struct vec3 o, struct vec3 d) {
    struct hit hit = {.t = INFINITY, .what = -1};
    hit_plane(o, d, vec3_make(1, 0, 0), -4.0, 0, &hit);
    hit_plane(o, d, vec3_make(-1, 0, 0), -4.0, 1, &hit);
    hit_plane(o, d, vec3_make(0, 1, 0), -3.0, 2, &hit);
    hit_plane(o, d, vec3_make(0, -1, 0), -3.0, 3, &hit);
    hit_plane(o, d, vec3_make(0, 0, 1), 0.0, 4, &hit);
    hit_plane(o, d, vec3_make(0, 0, -1), -3.0, 5, &hit);
    hit_pillar(o, d, 1.5, 1.0, 0.25, 6, &hit);
    hit_pillar(o, d, -1.5, -1.2, 0.2, 7, &hit);
    hit_sphere(o, d, vec3_make(2.4, -0.9, 0.7), 0.7, 8, &hit);
    hit_sphere(o, d, vec3_make(0.2, 2.0, 0.4), 0.4, 9, &hit);
    hit_sphere(o, d, vec3_make(-2.6, 1.2, 1.8), 0.5, 10, &hit);
    return hit;
}

static void shade(const struct hit *hit, struct vec3 d, uint8_t rgb[3]) {
    static const double base[11][3] = {{200, 180, 150}, {150, 180, 200}, {190, 200, 160},
                                       {200, 160, 170}, {140, 130, 120}, {225, 225, 220},
                                       {90, 140, 90},   {120, 90, 140},  {210, 90, 60},
                                       {60, 120, 200},  {230, 200, 70}};
    struct vec3 p = hit->p;
    int check = (int)floor(2.0 * p.x) + (int)floor(2.0 * p.y) + (int)floor(2.0 * p.z);
    double facing = fabs(vec3_dot(vec3_unit(d), hit->n));
    double light = (0.55 + 0.35 * facing) * (check & 1 ? 0.85 : 1.0) +
                   0.06 * sin(11.0 * p.x) * sin(9.0 * p.y) * sin(13.0 * p.z + 1.0);
    for (int k = 0; k < 3; k++)
        rgb[k] = (uint8_t)fmin(fmax(base[hit->what][k] * light + 0.5, 0.0), 255.0);
}

struct photo room_photo(const struct camera *camera, const struct pose *world_from_cam,
                        struct vec3 offset_m, double noise_m, uint64_t seed) {
    struct photo photo;
    struct errctx err = {0};
    if (photo_create(camera, &photo, &err))
        abort();
    photo.station_from_cam = *world_from_cam;
    struct rng rng = rng_make(seed);
    struct vec3 eye = vec3_sub(world_from_cam->t_m, offset_m);
    for (int32_t v = 0; v < camera->height_px; v++)
        for (int32_t u = 0; u < camera->width_px; u++) {
            size_t i = (size_t)v * (size_t)camera->width_px + (size_t)u;
            struct vec3 d = mat3_mulv(&world_from_cam->r, camera_pinhole_ray(camera, u, v));
            struct hit hit = cast(eye, d);
            if (hit.what < 0)
                continue;
            double z_m = hit.t; /* the ray has z = 1 in cam */
            if (noise_m > 0.0)
                z_m += noise_m * rng_normal(&rng);
            photo.disparity_per_m[i] = (float)(1.0 / z_m);
            photo.confidence[i] =
                noise_m > 0.0 ? photo_confidence_from_sigma(noise_m / (hit.t * hit.t)) : 255;
            shade(&hit, d, photo.rgb + 3 * i);
        }
    return photo;
}

struct pose room_pose(double x_m, double y_m, double azimuth_rad, struct vec3 offset_m) {
    struct vec3 eye = vec3_add(vec3_make(x_m, y_m, 1.5), offset_m);
    struct vec3 ahead = vec3_make(cos(azimuth_rad), sin(azimuth_rad), -0.1);
    struct pose pose;
    if (pose_look_at(eye, vec3_add(eye, ahead), vec3_make(0, 0, 1), &pose))
        abort();
    return pose;
}
