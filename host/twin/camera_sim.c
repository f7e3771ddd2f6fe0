#include "twin/camera_sim.h"

#include "twin/film.h"
#include "twin/light.h"

#include <stdlib.h>
#include <string.h>

struct camera_sim camera_sim_at(const struct camera *camera, const struct pose *world_from_cam) {
    struct camera_sim sim = {
        .camera = *camera, .world_from_cam = *world_from_cam, .rays = 8, .exposure = 1, .light = 1};
    return sim;
}

struct camera_sim camera_sim_on_cart(const struct twin_config *config,
                                     const struct pose *world_from_station, double pan_rad,
                                     double tilt_rad, uint64_t seed) {
    struct rig_camera camera = twin_config_camera(config, true);
    struct pose station_from_cam = rig_camera_pose(&camera, tilt_rad, pan_rad);
    struct pose world_from_cam = pose_compose(world_from_station, &station_from_cam);
    struct camera_sim sim = camera_sim_at(&camera.camera, &world_from_cam);
    sim.rays = (int)(twin_config_real(config, TWIN_CONFIG_CAMERA_SAMPLES) + 0.5);
    sim.vignetting = twin_config_real(config, TWIN_CONFIG_CAMERA_VIGNETTE);
    sim.noise = twin_config_real(config, TWIN_CONFIG_CAMERA_NOISE);
    sim.full_well = sim.noise > 0 ? twin_config_real(config, TWIN_CONFIG_CAMERA_WELL) : 0;
    sim.seed = seed;
    return sim;
}

/* Sums over a pixel. */
struct pixel {
    float albedo[3], direct[3], indirect[3], added[3], normal[3], depth_m;
    float luminance2; /* sum of squares of the direct light's luminance */
    int lit, surfaces;
};

/* Point k of n within the pixel: a rank-1 lattice, shifted at random. */
static struct vec2 place(int k, int n, double sx, double sy) {
    double u = (k + 0.5) / n + sx, v = k * 0.6180339887498949 + sy;
    struct vec2 q = {u - floor(u) - 0.5, v - floor(v) - 0.5};
    return q;
}

static void see(const struct scene *scene, const struct camera_sim *sim, struct vec3 dir,
                int gather, struct rng *rng, struct pixel *px) {
    struct trace_ray ray = {sim->world_from_cam.t_m, dir, 0, 1e6};
    struct light_surface s;
    light_look(scene, &ray, sim->light, rng, &s);
    for (int i = 0; i < 3; i++) {
        float limit = (float)(60 * scene->exposure);
        px->added[i] += s.added[i] > limit ? limit : s.added[i];
    }
    if (!s.found)
        return;
    double mirrored = material_fresnel_rough((double)s.material.f0, (double)s.material.roughness,
                                             -vec3_dot(s.hit.shading, dir));
    float body = s.kind == MATERIAL_METAL ? 0 : (float)(1 - mirrored);
    for (int i = 0; i < 3; i++)
        px->albedo[i] += s.through[i] * body * s.material.rgb[i];
    px->normal[0] += (float)s.hit.shading.x;
    px->normal[1] += (float)s.hit.shading.y;
    px->normal[2] += (float)s.hit.shading.z;
    px->depth_m += (float)s.hit.t_m;
    px->surfaces++;
    if (!gather)
        return;
    struct light_arriving light;
    light_gather(scene, &s, sim->light, rng, &light);
    for (int i = 0; i < 3; i++) {
        px->direct[i] += light.direct[i];
        px->indirect[i] += light.indirect[i];
        float m = s.through[i] * light.mirrored[i], limit = (float)(30 * scene->exposure);
        px->added[i] += (m > limit ? limit : m) * (float)gather;
    }
    float l = 0.2126f * light.direct[0] + 0.7152f * light.direct[1] + 0.0722f * light.direct[2];
    px->luminance2 += l * l;
    px->lit++;
}

static void expose_pixel(const struct scene *scene, const struct camera_sim *sim, int x, int y,
                         struct film *film) {
    size_t at = (size_t)y * (size_t)film->width_px + (size_t)x;
    struct rng rng = rng_stream(sim->seed, at);
    int n = sim->rays < 1 ? 1 : sim->rays, every = n >= 8 ? 4 : n >= 4 ? 2 : 1, seen = 0;
    double sx = rng_uniform(&rng), sy = rng_uniform(&rng);
    struct pixel px;
    memset(&px, 0, sizeof px);
    for (int k = 0; k < n; k++) {
        struct vec2 q = place(k, n, sx, sy);
        struct vec3 ray;
        struct vec2 at_px = {x + q.x, y + q.y};
        if (camera_unproject(&sim->camera, at_px, &ray, NULL))
            continue;
        seen++;
        see(scene, sim, mat3_mulv(&sim->world_from_cam.r, vec3_unit(ray)), k % every ? 0 : every,
            &rng, &px);
    }
    if (!seen)
        return;
    float per_ray = 1 / (float)seen, per_lit = px.lit ? 1 / (float)px.lit : 0;
    for (size_t i = 0; i < 3; i++) {
        film->albedo[3 * at + i] = px.albedo[i] * per_ray;
        film->added[3 * at + i] = px.added[i] * per_ray;
        film->direct[3 * at + i] = px.direct[i] * per_lit;
        film->indirect[3 * at + i] = px.indirect[i] * per_lit;
    }
    if (px.lit > 1) { /* variance of the mean */
        const float *d = film->direct + 3 * at;
        float mean = 0.2126f * d[0] + 0.7152f * d[1] + 0.0722f * d[2];
        float spread = px.luminance2 * per_lit - mean * mean;
        film->variance[at] = (spread > 0 ? spread : 0) / (float)(px.lit - 1);
    }
    float length = sqrtf(px.normal[0] * px.normal[0] + px.normal[1] * px.normal[1] +
                         px.normal[2] * px.normal[2]);
    for (size_t i = 0; i < 3; i++)
        film->normal[3 * at + i] = length > 0 ? px.normal[i] / length : 0;
    film->depth_m[at] = px.surfaces ? px.depth_m / (float)px.surfaces : 0;
}

enum st camera_sim_render(const struct scene *scene, const struct camera_sim *sim,
                          struct image_u8 *out_image, struct errctx *err) {
    enum st st = camera_check(&sim->camera, err);
    if (st)
        return st;
    struct image_u8 image = {.px = NULL};
    struct film film = {.width_px = sim->camera.width_px, .height_px = sim->camera.height_px};
    size_t pixels = (size_t)film.width_px * (size_t)film.height_px;
    st = image_u8_create(&image, film.width_px, film.height_px, 3);
    float *planes = st ? NULL : calloc(pixels * 20, sizeof *planes);
    if (!planes) {
        image_u8_destroy(&image);
        return errctx_set(err, ST_NOMEM, "simulated camera: no memory for %d x %d pixels",
                          film.width_px, film.height_px);
    }
    film.albedo = planes;
    film.direct = planes + pixels * 3;
    film.indirect = planes + pixels * 6;
    film.added = planes + pixels * 9;
    film.normal = planes + pixels * 12;
    film.scratch = planes + pixels * 15;
    film.depth_m = planes + pixels * 18;
    film.variance = planes + pixels * 19;
#pragma omp parallel for schedule(dynamic, 2)
    for (int y = 0; y < film.height_px; y++)
        for (int x = 0; x < film.width_px; x++)
            expose_pixel(scene, sim, x, y, &film);
    film_filter(&film);
    struct film_sensor sensor = {.white = scene->exposure / sim->exposure,
                                 .vignetting = sim->vignetting,
                                 .noise = sim->noise,
                                 .full_well = sim->full_well,
                                 .seed = sim->seed};
    film_compose(&film, sensor.white);
    film_develop(&film, &sensor, image.px);
    free(planes);
    *out_image = image;
    return ST_OK;
}
