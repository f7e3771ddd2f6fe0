#include "fusion/shade.h"

#include <math.h>

/* Plane disparity = a + b u + c v over the pixels around (x, y) that belong to its surface: within
 * a fiftieth of its disparity a pixel. False if it has no neighbours. */
static bool slopes(const struct photo *photo, int32_t x, int32_t y, double *out_gu,
                   double *out_gv) {
    enum { REACH = 2 };
    int32_t w = photo->camera.width_px, h = photo->camera.height_px;
    double here = (double)photo->disparity_per_m[(size_t)y * (size_t)w + (size_t)x];
    double n = 0, u = 0, v = 0, d = 0, uu = 0, uv = 0, vv = 0, ud = 0, vd = 0;
    for (int32_t j = y - REACH; j <= y + REACH; j++)
        for (int32_t i = x - REACH; i <= x + REACH; i++) {
            if (i < 0 || j < 0 || i >= w || j >= h)
                continue;
            double s = (double)photo->disparity_per_m[(size_t)j * (size_t)w + (size_t)i] - here;
            double du = i - x, dv = j - y;
            if (!(fabs(s) <= 0.02 * here * (fabs(du) + fabs(dv))))
                continue; /* NaN too */
            n++, u += du, v += dv, d += s;
            uu += du * du, uv += du * dv, vv += dv * dv, ud += du * s, vd += dv * s;
        }
    if (n < 3)
        return false;
    uu -= u * u / n, uv -= u * v / n, vv -= v * v / n, ud -= u * d / n, vd -= v * d / n;
    double det = uu * vv - uv * uv;
    if (!(det > 0.5))
        return false;
    *out_gu = (ud * vv - vd * uv) / det;
    *out_gv = (vd * uu - ud * uv) / det;
    return true;
}

/* Normal towards the eye, in cam: the plane a x + b y + c = delta has the normal (a, b, c). */
static struct vec3 normal_at(const struct photo *photo, int32_t x, int32_t y) {
    double gu = 0, gv = 0;
    struct vec3 ray = camera_pinhole_ray(&photo->camera, x, y);
    if (!slopes(photo, x, y, &gu, &gv))
        return vec3_scale(vec3_unit(ray), -1.0);
    double d =
        (double)photo->disparity_per_m[(size_t)y * (size_t)photo->camera.width_px + (size_t)x];
    double a = gu * photo->camera.fx_px, b = gv * photo->camera.fy_px;
    return vec3_scale(vec3_unit(vec3_make(a, b, d - a * ray.x - b * ray.y)), -1.0);
}

static uint8_t level(double linear) {
    double s = pow(fmin(fmax(linear, 0.0), 1.0), 1.0 / 2.2);
    return (uint8_t)lrint(255.0 * s);
}

static void shade_pixel(struct photo *photo, const struct mat3 *world_from_cam_r, int32_t x,
                        int32_t y) {
    size_t i = (size_t)y * (size_t)photo->camera.width_px + (size_t)x;
    uint8_t *rgb = photo->rgb + 3 * i;
    if (photo->flags[i] & PHOTO_SKY) {
        rgb[0] = 30, rgb[1] = 38, rgb[2] = 56;
        return;
    }
    if (!(photo->disparity_per_m[i] > 0.0f))
        return;
    struct vec3 n = mat3_mulv(world_from_cam_r, normal_at(photo, x, y));
    struct vec3 sun = vec3_unit(vec3_make(0.5, -0.75, 0.6));
    double facing = vec3_dot(n, sun), up = n.z;
    /* The sky lights from all around, the sun's light wraps softly into the shade. */
    double lit = 0.16 + 0.14 * up + 0.4 * (0.5 + 0.5 * facing) * (0.5 + 0.5 * facing) +
                 0.2 * fmax(0.0, facing);
    rgb[0] = level(lit * (1.0 + 0.16 * up));
    rgb[1] = level(lit * (1.0 + 0.02 * up));
    rgb[2] = level(lit * (1.0 - 0.22 * up));
}

void shade_photo(struct photo *photo, const struct mat3 *world_from_station_r) {
    struct mat3 r = mat3_mul(world_from_station_r, &photo->station_from_cam.r);
#pragma omp parallel for schedule(dynamic, 8)
    for (int32_t y = 0; y < photo->camera.height_px; y++)
        for (int32_t x = 0; x < photo->camera.width_px; x++)
            shade_pixel(photo, &r, x, y);
}
