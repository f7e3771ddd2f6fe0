/* Each quality against the truth of the twin's scenes: seconds, errors, honesty, what floats. */
#include "bench_fusion.h"

#include "app/fuse_settings.h"
#include "base/head_packet.h"
#include "base/rng.h"
#include "fusion/face.h"
#include "fusion/noise.h"
#include "raster/skin.h"
#include "twin/optics.h"
#include "twin/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The head on its stand, seen from which everything is relative. */
struct stand {
    struct scene *scene;
    struct vec3 from_m;
    double spacing_rad;
    double max_range_m;
    struct scatter_sample *samples;
    size_t count;
};

static struct vec3 direction(double az, double el) {
    return vec3_make(cos(el) * cos(az), cos(el) * sin(az), sin(el));
}

/* One vertical line of samples, with the twin's optics. */
static void scan_line(const struct stand *s, const struct optics *optics, size_t column,
                      size_t rows, double az, struct scatter_sample *out, float *out_range) {
    struct rng rng = rng_stream(77, column);
    double phase =
        rng_uniform(&rng); /* the mirror turns on, the pan too: lines lean and start anywhere */
    for (size_t r = 0; r < rows; r++) {
        double step = s->spacing_rad;
        double el = -1.2 + step * ((double)r + phase), a = az + step * (double)r / (double)rows;
        struct optics_beam beam = {.origin_m = s->from_m, .dir = direction(a, el)};
        beam.sweep = vec3_scale(vec3_make(-sin(el) * cos(a), -sin(el) * sin(a), cos(el)), step);
        struct optics_echo echo;
        struct optics_reading reading;
        optics_shoot(s->scene, optics, &beam, &rng, &echo);
        optics_detect(optics, &echo, s->scene->ambient, &rng, &reading);
        struct vec3 p = beam.dir;
        memset(&out[r], 0, sizeof out[r]);
        if (reading.flags & HEAD_SAMPLE_NO_RETURN) {
            out[r].flags = SAMPLE_NO_RETURN;
        } else if ((reading.flags & HEAD_SAMPLE_DROPPED) || isnan(reading.distance_m)) {
            out[r].flags = SAMPLE_DROPPED;
        } else {
            p = vec3_scale(beam.dir, reading.distance_m);
            out[r].flags = SAMPLE_INTENSITY;
            out[r].intensity = (float)reading.intensity;
        }
        out_range[r] = out[r].flags == SAMPLE_INTENSITY ? (float)reading.distance_m : NAN;
        out[r].p_m[0] = (float)p.x, out[r].p_m[1] = (float)p.y, out[r].p_m[2] = (float)p.z;
    }
}

/* Scans a quarter of the surroundings and believes the noise that it measures. */
static void scan(struct stand *s, const struct optics *optics) {
    size_t columns = (size_t)(1.9 / s->spacing_rad), rows = (size_t)(2.4 / s->spacing_rad);
    float *range = malloc(rows * columns * sizeof *range);
    struct noise_meter *meter = malloc(sizeof *meter);
    struct noise_model model = noise_model_constant(0.005, 0.0);
    s->count = columns * rows;
    s->samples = malloc(s->count * sizeof *s->samples);
    if (!range || !meter || !s->samples)
        exit(1);
#pragma omp parallel for schedule(dynamic, 4)
    for (size_t c = 0; c < columns; c++)
        scan_line(s, optics, c, rows, -0.95 + s->spacing_rad * (double)c, s->samples + c * rows,
                  range + c * rows);
    noise_meter_init(meter);
    for (size_t i = 0; i < s->count; i++) {
        if (i % rows == 0)
            noise_meter_add(meter, (double)NAN, (double)NAN);
        noise_meter_add(meter, (double)range[i], (double)s->samples[i].intensity);
    }
    (void)noise_meter_read(meter, 1e-4, &model);
    for (size_t i = 0; i < s->count; i++)
        s->samples[i].sigma_m = (float)noise_sigma(&model, (double)s->samples[i].intensity,
                                                   isnan(range[i]) ? 1.0 : (double)range[i]);
    free(range);
    free(meter);
}

/* ---- truth ---- */

struct truth {
    float range_m; /* along the pixel's ray; NaN: nothing */
    uint16_t part;
};

static struct truth *truth_of(const struct stand *s, const struct camera *camera,
                              const struct pose *pose) {
    size_t pixels = (size_t)camera->width_px * (size_t)camera->height_px;
    struct truth *t = malloc(pixels * sizeof *t);
    if (!t)
        exit(1);
#pragma omp parallel for schedule(dynamic, 64)
    for (size_t i = 0; i < pixels; i++) {
        struct vec3 ray = camera_pinhole_ray(camera, (double)(i % (size_t)camera->width_px),
                                             (double)(i / (size_t)camera->width_px));
        struct trace_ray r = {s->from_m, mat3_mulv(&pose->r, vec3_unit(ray)), 1e-6, 1e4};
        struct trace_hit hit;
        bool found = trace_first(s->scene->trace, &r, &hit);
        t[i].range_m = found ? (float)hit.t_m : NAN;
        t[i].part = found ? hit.part : 0xffff;
    }
    return t;
}

/* The truth is one smooth surface for three pixels around. */
static bool inside(const struct truth *t, const struct camera *c, int x, int y) {
    int w = c->width_px;
    if (x < 3 || y < 3 || x >= w - 3 || y >= c->height_px - 3)
        return false;
    const struct truth *m = t + (size_t)y * (size_t)w + (size_t)x;
    for (int k = 0; k < 4; k++) {
        ptrdiff_t step = k == 0 ? 3 : k == 1 ? 3 * w : k == 2 ? 3 * w + 3 : 3 * w - 3;
        double a = 1.0 / (double)m[step].range_m, b = 1.0 / (double)m[-step].range_m;
        double bend = (a + b) * (double)m[0].range_m - 2.0;
        if (!(fabs(bend) < 1e-3) || m[step].part != m[0].part || m[-step].part != m[0].part)
            return false;
    }
    return true;
}

/* Is no surface within `reach` of the point? Rays in 98 directions. */
static bool is_far_from_all(const struct stand *s, struct vec3 p, double reach) {
    for (int i = 0; i < 98; i++) { /* a spiral over the sphere */
        double z = 1.0 - (2.0 * i + 1.0) / 98.0, a = 2.399963229728653 * i, r = sqrt(1.0 - z * z);
        struct trace_ray ray = {p, vec3_make(r * cos(a), r * sin(a), z), 0.0, reach};
        if (trace_blocked(s->scene->trace, &ray))
            return false;
    }
    return true;
}

struct score {
    double error2, expected2; /* relative to the sigma of one sample */
    double error2_m, wall_s, cpu_s;
    int64_t inside, covered, valid, floating, floating_plain, edge;
};

static int64_t count_floating(const struct stand *s, const struct photo *photo,
                              const struct truth *truth) {
    int64_t floating = 0;
    const struct camera *c = &photo->camera;
    size_t pixels = (size_t)c->width_px * (size_t)c->height_px;
#pragma omp parallel for schedule(dynamic, 256) reduction(+ : floating)
    for (size_t i = 0; i < pixels; i++) {
        double d = (double)photo->disparity_per_m[i];
        if (!(d > 0))
            continue;
        struct vec3 ray = camera_pinhole_ray(c, (double)(i % (size_t)c->width_px),
                                             (double)(i / (size_t)c->width_px));
        double range = vec3_norm(ray) / d, reach = 5 * 0.0025; /* 5 sigma of one sample */
        if (fabs(range - (double)truth[i].range_m) <= reach)
            continue;
        struct vec3 p =
            vec3_add(mat3_mulv(&photo->station_from_cam.r, vec3_scale(ray, 1.0 / d)), s->from_m);
        floating += is_far_from_all(s, p, reach);
    }
    return floating;
}

static struct photo shoot(const struct stand *s, const struct fuse_settings *settings, int face,
                          int plain, struct layer_image *out_image) {
    double pixel_rad = settings->pixel_spacings * s->spacing_rad;
    struct camera camera = face_camera(face_size_px(pixel_rad, settings->face_max_px));
    struct pose pose = face_station_from_cam(face);
    struct layer_params lp = settings->layer;
    struct resolve_params rp = settings->resolve;
    struct photo photo;
    struct errctx err;
    lp.splat_px = fmin(fmax(1.0, settings->splat_spacings * s->spacing_rad * camera.fx_px), 16);
    rp.beam_rad = s->spacing_rad;
    rp.sigma_angle_rad = settings->sigma_angle_rad;
    rp.sigma_system_m = settings->sigma_system_m;
    rp.plain_mean = plain;
    bench_check(layer_create(&camera, &pose, &lp, out_image, &err), &err);
    bench_check(layer_add(out_image, s->samples, s->count), NULL);
    bench_check(photo_create(&camera, &photo, &err), &err);
    bench_check(resolve_photo(out_image, &rp, 1, &photo, NULL, &err), &err);
    return photo;
}

static struct score judge(const struct stand *s, const struct fuse_settings *settings) {
    struct score score = {0};
    struct layer_image image, flat;
    double wall = bench_wall_s(), cpu = bench_cpu_s();
    struct photo photo = shoot(s, settings, 0, 0, &image);
    score.wall_s = bench_wall_s() - wall;
    score.cpu_s = bench_cpu_s() - cpu;
    struct truth *truth = truth_of(s, &photo.camera, &photo.station_from_cam);
    const struct camera *c = &photo.camera;
    for (int y = 0; y < c->height_px; y++)
        for (int x = 0; x < c->width_px; x++) {
            size_t i = (size_t)y * (size_t)c->width_px + (size_t)x;
            double d = (double)photo.disparity_per_m[i];
            score.valid += d > 0;
            if (!(d > 0) || !inside(truth, c, x, y))
                continue;
            double norm = vec3_norm(camera_pinhole_ray(c, x, y)), t = (double)truth[i].range_m;
            double off = norm / d - t, sigma = photo_sigma_from_confidence(photo.confidence[i]);
            double from_samples = (double)cluster_sigma(image.px[i].layers) * t * t / norm;
            score.inside++;
            score.error2_m += off * off;
            score.error2 += off * off / (from_samples * from_samples);
            score.expected2 += 1.0;
            score.covered += fabs(off) < sigma * t * t / norm;
        }
    struct photo plain = shoot(s, settings, 0, 1, &flat);
    score.floating = count_floating(s, &photo, truth);
    score.floating_plain = count_floating(s, &plain, truth);
    free(truth);
    photo_destroy(&photo);
    photo_destroy(&plain);
    layer_destroy(&image);
    layer_destroy(&flat);
    return score;
}

static void report(const char *scene, const char *quality, const struct score *s) {
    char name[96];
    double rms_mm = 1e3 * sqrt(s->error2_m / (double)s->inside);
    double ratio = sqrt(s->error2 / s->expected2), share = (double)s->covered / (double)s->inside;
    double floats = (double)s->floating / (double)s->valid;
    double plain = (double)s->floating_plain / (double)s->valid;
    (void)fprintf(stderr, "  %-10s %-8s %6.2f %8.2f  %7.2f    %5.2f   %5.1f %%   %8.1f  %10.1f\n",
                  scene, quality, (double)s->valid * 1e-6, s->cpu_s, rms_mm, ratio, 100 * share,
                  1e5 * floats, 1e5 * plain);
    const struct {
        const char *what;
        double value;
        const char *unit;
    } figures[] = {{"cpu_s", s->cpu_s, "s"},
                   {"wall_s", s->wall_s, "s"},
                   {"rms_mm", rms_mm, "mm"},
                   {"rms_over_sigma", ratio, "1"},
                   {"sigma_covers", share, "1"},
                   {"floating_share", floats, "1"},
                   {"floating_share_averaging", plain, "1"}};
    for (size_t k = 0; k < sizeof figures / sizeof figures[0]; k++) {
        (void)snprintf(name, sizeof name, "%s_%s_%s", scene, quality, figures[k].what);
        bench_figure(name, figures[k].value, figures[k].unit);
    }
}

/* The first stand of a scene, scanned; its scene and samples are the caller's. */
static struct stand open_stand(const char *name, bool biased, bool quick) {
    struct scene *scene = NULL;
    struct errctx err = {0};
    bench_check(scene_create(name, 1, quick ? 0.3 : 1.0, &scene, &err), &err);
    struct vec3 p = scene->stand[0].position_m;
    struct stand s = {.scene = scene,
                      .from_m = vec3_make(p.x, p.y, p.z + 1.6),
                      .spacing_rad = quick ? 4e-3 : 1.5e-3};
    struct optics optics = optics_default();
    optics.max_range_m = scene->max_range_m > 0 ? scene->max_range_m : 12.0;
    if (!biased)
        optics.bias_per_decade_m = optics.saturation_bias_m = 0.0;
    scan(&s, &optics);
    return s;
}

struct photo bench_scene_photo(const char *scene_name, bool quick) {
    struct stand s = open_stand(scene_name, false, quick);
    struct fuse_settings settings = fuse_settings_make(FUSE_FIELD);
    struct layer_image image;
    struct photo photo = shoot(&s, &settings, 0, 0, &image);
    struct skin_params skins = skin_params_default();
    (void)skin_mark(&photo, &skins);
    layer_destroy(&image);
    free(s.samples);
    scene_destroy(s.scene);
    return photo;
}

static void one_scene(const char *name, bool biased, bool quick) {
    struct stand s = open_stand(name, biased, quick);
    char label[48];
    (void)snprintf(label, sizeof label, "%s%s", name, biased ? "+bias" : "");
    for (int q = FUSE_PREVIEW; q <= FUSE_SURVEY; q++) {
        struct fuse_settings settings = fuse_settings_make((enum fuse_quality)q);
        struct score score = judge(&s, &settings);
        report(label, fuse_settings_name((enum fuse_quality)q), &score);
    }
    free(s.samples);
    scene_destroy(s.scene);
}

int bench_accuracy(bool quick) {
    (void)fprintf(
        stderr,
        "one face, samples 1.5 mrad apart, the twin's optics; rms and coverage inside surfaces,\n"
        "floating: farther than 12.5 mm from any surface, in 100 000 pixels\n"
        "  scene      quality    Mpx    cpu s   rms mm  /(s/rt n)  covers   floating  averaging\n");
    one_scene("room", false, quick);
    one_scene("room", true, quick);
    if (!quick) {
        one_scene("accident", false, quick);
        one_scene("heritage", false, quick);
    }
    return 0;
}
