/* Each quality against the truth of the twin's scenes: seconds, errors, honesty, what floats. */
#include "bench_fusion.h"

#include "app/fuse_settings.h"
#include "base/head_packet.h"
#include "base/rig.h"
#include "base/rng.h"
#include "fusion/face.h"
#include "fusion/noise.h"
#include "raster/skin.h"
#include "twin/optics.h"
#include "twin/scene.h"
#include "twin/twin_config.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double two_pi = 6.283185307179586;

/* What a scan is made and reconstructed with. */
struct condition {
    const char *name;
    bool nominal; /* the samples are placed with the design's rig, not with the true one */
    bool bias;    /* the detector errs with the echo's strength, which no rig describes */
};

/* The head on its stand, seen from which everything is relative. */
struct stand {
    struct scene *scene;
    struct vec3 from_m;
    double spacing_rad;
    struct rig true_rig, rig; /* the second is what fusion believes */
    struct optics optics;
    double encoder_noise_counts, sigma_system_m;
    bool nominal;
    struct scatter_sample *samples;
    size_t count;
    struct noise_model noise; /* as measured */
};

/* One sample at encoder and pan positions as the cart reports them: shot along the true rig's beam,
 * placed along the believed one's. */
static void sample_at(const struct stand *s, double counts, double pan_steps, struct rng *rng,
                      struct scatter_sample *out, float *out_range) {
    const struct rig *t = &s->true_rig, *r = &s->rig;
    double pan = rig_pan_angle(t, pan_steps, 1);
    double theta = rig_mirror_angle(t, counts - s->encoder_noise_counts * rng_normal(rng));
    double tilt = rig_tilt_angle(t, 0.0), half = 0.5 * s->spacing_rad;
    struct rig_beam beam = rig_direction(t, theta, tilt, pan);
    struct rig_beam from = rig_direction(t, theta - half, tilt, pan);
    struct rig_beam to = rig_direction(t, theta + half, tilt, pan);
    struct optics_beam shot = {.origin_m = vec3_add(s->from_m, beam.origin_m), .dir = beam.dir};
    struct optics_echo echo;
    struct optics_reading reading;
    shot.sweep = vec3_sub(to.dir, from.dir);
    optics_shoot(s->scene, &s->optics, &shot, rng, &echo);
    optics_detect(&s->optics, &echo, s->scene->ambient, rng, &reading);
    memset(out, 0, sizeof *out);
    *out_range = NAN;
    double theta_r = rig_mirror_angle(r, counts), tilt_r = rig_tilt_angle(r, 0.0);
    double pan_r = rig_pan_angle(r, pan_steps, 1);
    struct vec3 p = rig_direction(r, theta_r, tilt_r, pan_r).dir;
    if (reading.flags & HEAD_SAMPLE_NO_RETURN) {
        out->flags = SAMPLE_NO_RETURN;
    } else if ((reading.flags & HEAD_SAMPLE_DROPPED) || isnan(reading.distance_m)) {
        out->flags = SAMPLE_DROPPED;
    } else {
        double range_m = rig_range(t, reading.distance_m);
        p = rig_point(r, theta_r, tilt_r, pan_r, range_m);
        out->flags = SAMPLE_INTENSITY;
        out->intensity = (float)reading.intensity;
        *out_range = (float)range_m;
    }
    out->p_m[0] = (float)p.x, out->p_m[1] = (float)p.y, out->p_m[2] = (float)p.z;
}

/* One vertical line of samples. */
static void scan_line(const struct stand *s, size_t column, size_t rows, double pan_rad,
                      struct scatter_sample *out, float *out_range) {
    struct rng rng = rng_stream(77, column);
    double phase =
        rng_uniform(&rng); /* the mirror turns on, the pan too: lines lean and start anywhere */
    struct rig nominal = rig_nominal();
    for (size_t r = 0; r < rows; r++) {
        double theta = -1.2 + s->spacing_rad * ((double)r + phase);
        double pan = pan_rad + s->spacing_rad * (double)r / (double)rows;
        sample_at(s, rig_encoder_counts(&nominal, theta),
                  nominal.pan_zero_steps + pan * nominal.pan_steps_per_turn / two_pi, &rng, out + r,
                  out_range + r);
    }
}

/* Scans a quarter of the surroundings and believes the noise that it measures. */
static void scan(struct stand *s) {
    size_t columns = (size_t)(1.9 / s->spacing_rad), rows = (size_t)(2.4 / s->spacing_rad);
    float *range = malloc(rows * columns * sizeof *range);
    struct noise_meter *meter = malloc(sizeof *meter);
    s->noise = noise_model_constant(0.005, 0.0);
    s->count = columns * rows;
    s->samples = malloc(s->count * sizeof *s->samples);
    if (!range || !meter || !s->samples)
        exit(1);
#pragma omp parallel for schedule(dynamic, 4)
    for (size_t c = 0; c < columns; c++)
        scan_line(s, c, rows, -0.95 + s->spacing_rad * (double)c, s->samples + c * rows,
                  range + c * rows);
    noise_meter_init(meter);
    for (size_t i = 0; i < s->count; i++) {
        if (i % rows == 0)
            noise_meter_add(meter, (double)NAN, (double)NAN);
        noise_meter_add(meter, (double)range[i], (double)s->samples[i].intensity);
    }
    (void)noise_meter_read(meter, 1e-4, &s->noise);
    for (size_t i = 0; i < s->count; i++)
        s->samples[i].sigma_m = (float)noise_sigma(&s->noise, (double)s->samples[i].intensity,
                                                   isnan(range[i]) ? 1.0 : (double)range[i]);
    free(range);
    free(meter);
}

/* ---- truth ---- */

struct truth {
    float range_m; /* along the pixel's ray; NaN: nothing */
    uint16_t part;
    bool odd; /* glass, a mirror, leaves, grass: more than one answer is right, or none */
};

static bool is_odd(const struct scene *scene, uint16_t part) {
    const struct material *m = &scene->material[scene->part[part].material];
    bool mirror = m->kind == MATERIAL_GLASS || m->kind == MATERIAL_METAL ||
                  (m->kind == MATERIAL_COATED && m->roughness < 0.25f);
    return mirror || m->texture == TEXTURE_LEAF || m->texture == TEXTURE_GRASS;
}

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
        t[i].odd = found && is_odd(s->scene, hit.part);
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
        if (!(fabs(bend) < 1e-3) || m[0].odd || m[step].part != m[0].part ||
            m[-step].part != m[0].part)
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

/* Something odd within so many pixels: the beam of a sample that the pixel got may have met it. */
enum { ODD_REACH_PX = 6 };

static bool near_odd(const struct truth *t, const struct camera *c, int x, int y) {
    for (int v = y - ODD_REACH_PX; v <= y + ODD_REACH_PX; v++)
        for (int u = x - ODD_REACH_PX; u <= x + ODD_REACH_PX; u++)
            if (u >= 0 && v >= 0 && u < c->width_px && v < c->height_px &&
                t[(size_t)v * (size_t)c->width_px + (size_t)u].odd)
                return true;
    return false;
}

/* Another surface than the one that the ray through the pixel's centre meets: a wire thinner than
 * the pixel. Counted apart, it would be all that the rms tells. */
static const double gross_m = 0.1;

/* Pixels that show something but float; and of those where something is to be seen, within range,
 * how many show it: within 5 cm or 1 % of the truth. */
struct floating {
    int64_t solid, solid_floats, odd, odd_floats;
    int64_t solid_true, solid_shown, odd_true, odd_shown;
};

struct score {
    double error2; /* relative to the sigma of one sample over root n */
    double error2_m, wall_s, cpu_s;
    int64_t inside, covered, valid, gross;
    struct floating clustered, averaged;
};

static void count_shown(const struct stand *s, const struct photo *photo, const struct truth *truth,
                        struct floating *out) {
    const struct camera *c = &photo->camera;
    for (int y = 0; y < c->height_px; y++)
        for (int x = 0; x < c->width_px; x++) {
            size_t i = (size_t)y * (size_t)c->width_px + (size_t)x;
            double t = (double)truth[i].range_m;
            if (!(t < s->optics.max_range_m))
                continue;
            double range =
                vec3_norm(camera_pinhole_ray(c, x, y)) / (double)photo->disparity_per_m[i];
            bool shown = fabs(range - t) < fmax(0.05, 0.01 * t);
            *(truth[i].odd ? &out->odd_true : &out->solid_true) += 1;
            *(truth[i].odd ? &out->odd_shown : &out->solid_shown) += shown;
        }
}

static struct floating count_floating(const struct stand *s, const struct photo *photo,
                                      const struct truth *truth) {
    int64_t counts[4] = {0};
    const struct camera *c = &photo->camera;
#pragma omp parallel for schedule(dynamic, 8) reduction(+ : counts[:4])
    for (int y = 0; y < c->height_px; y++)
        for (int x = 0; x < c->width_px; x++) {
            size_t i = (size_t)y * (size_t)c->width_px + (size_t)x;
            double d = (double)photo->disparity_per_m[i];
            if (!(d > 0))
                continue;
            int odd = near_odd(truth, c, x, y);
            counts[2 * odd]++;
            struct vec3 ray = camera_pinhole_ray(c, x, y);
            double grey = (double)photo->rgb[3 * i] / 255.0, range = vec3_norm(ray) / d;
            double reach = 5 * noise_sigma(&s->noise, pow(grey, 2.2), range);
            if (fabs(range - (double)truth[i].range_m) <= reach)
                continue;
            struct vec3 p = vec3_add(
                mat3_mulv(&photo->station_from_cam.r, vec3_scale(ray, 1.0 / d)), s->from_m);
            counts[2 * odd + 1] += is_far_from_all(s, p, reach);
        }
    struct floating f = {
        .solid = counts[0], .solid_floats = counts[1], .odd = counts[2], .odd_floats = counts[3]};
    count_shown(s, photo, truth, &f);
    return f;
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
    rp.sigma_system_m = s->sigma_system_m;
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
            if (!(d > 0) || !inside(truth, c, x, y) || near_odd(truth, c, x, y))
                continue;
            double norm = vec3_norm(camera_pinhole_ray(c, x, y)), t = (double)truth[i].range_m;
            double off = norm / d - t, sigma = photo_sigma_from_confidence(photo.confidence[i]);
            double from_samples = (double)cluster_sigma(image.px[i].layers) * t * t / norm;
            if (fabs(off) > gross_m && !s->nominal) {
                score.gross++;
                continue;
            }
            score.inside++;
            score.error2_m += off * off;
            score.error2 += off * off / (from_samples * from_samples);
            score.covered += fabs(off) < sigma * t * t / norm;
        }
    struct photo plain = shoot(s, settings, 0, 1, &flat);
    if (!s->nominal) { /* with a wrong rig everything is beside its surface */
        score.clustered = count_floating(s, &photo, truth);
        score.averaged = count_floating(s, &plain, truth);
    }
    free(truth);
    photo_destroy(&photo);
    photo_destroy(&plain);
    layer_destroy(&image);
    layer_destroy(&flat);
    return score;
}

static double share_of(int64_t part, int64_t of) {
    return of ? (double)part / (double)of : 0.0;
}
static double in_10000(int64_t part, int64_t of) {
    return 1e4 * share_of(part, of);
}

static void report(const char *scene, const char *condition, const char *quality,
                   const struct score *s) {
    char name[96];
    double rms_mm = 1e3 * sqrt(s->error2_m / (double)s->inside);
    double ratio = sqrt(s->error2 / (double)s->inside);
    double share = (double)s->covered / (double)s->inside;
    double floats = in_10000(s->clustered.solid_floats, s->clustered.solid);
    double averaged = in_10000(s->averaged.solid_floats, s->averaged.solid);
    double odd = in_10000(s->clustered.odd_floats, s->clustered.odd);
    double gross = in_10000(s->gross, s->inside + s->gross);
    const struct floating *c = &s->clustered, *a = &s->averaged;
    double shown = share_of(c->solid_shown, c->solid_true);
    double shown_plain = share_of(a->solid_shown, a->solid_true);
    double leaves = share_of(c->odd_shown, c->odd_true);
    double leaves_plain = share_of(a->odd_shown, a->odd_true);
    (void)fprintf(stderr,
                  "  %-9s %-8s %-8s %5.2f %7.2f  %7.2f   %6.2f   %5.1f %%   %6.2f   %7.1f   %7.1f  "
                  "%5.1f %5.1f  %5.1f %5.1f\n",
                  scene, condition, quality, (double)s->valid * 1e-6, s->cpu_s, rms_mm, ratio,
                  100 * share, floats, averaged, odd, 100 * shown, 100 * shown_plain, 100 * leaves,
                  100 * leaves_plain);
    const struct {
        const char *what;
        double value;
        const char *unit;
    } figures[] = {{"cpu_s", s->cpu_s, "s"},
                   {"wall_s", s->wall_s, "s"},
                   {"rms_mm", rms_mm, "mm"},
                   {"rms_over_sigma", ratio, "1"},
                   {"sigma_covers", share, "1"},
                   {"floating_in_10000", floats, "px"},
                   {"floating_in_10000_averaging", averaged, "px"},
                   {"gross_in_10000", gross, "px"},
                   {"floating_in_10000_glass_leaves", odd, "px"},
                   {"solid_shown", shown, "1"},
                   {"solid_shown_averaging", shown_plain, "1"},
                   {"glass_leaves_shown", leaves, "1"},
                   {"glass_leaves_shown_averaging", leaves_plain, "1"}};
    size_t count = sizeof figures / sizeof figures[0] - (s->clustered.solid ? 0 : 8);
    for (size_t k = 0; k < count; k++) {
        (void)snprintf(name, sizeof name, "%s_%s_%s_%s", scene, condition, quality,
                       figures[k].what);
        bench_figure(name, figures[k].value, figures[k].unit);
    }
}

/* The first stand of a scene, scanned; its scene and samples are the caller's. */
static struct stand open_stand(const char *name, const struct condition *how, bool quick) {
    struct scene *scene = NULL;
    struct errctx err = {0};
    struct twin_config config = twin_config_default();
    bench_check(scene_create(name, 1, quick ? 0.3 : 1.0, &scene, &err), &err);
    struct vec3 p = scene->stand[0].position_m;
    struct stand s = {.scene = scene,
                      .from_m = vec3_make(p.x, p.y, p.z + 1.6),
                      .spacing_rad = quick ? 4e-3 : 1.5e-3,
                      .true_rig = twin_config_rig(&config, true),
                      .optics = optics_default()};
    s.nominal = how->nominal;
    s.rig = how->nominal ? twin_config_rig(&config, false) : s.true_rig;
    s.encoder_noise_counts = config.value[TWIN_CONFIG_ENCODER_NOISE].real;
    s.optics.max_range_m = scene->max_range_m > 0 ? scene->max_range_m : 12.0;
    s.sigma_system_m = how->bias ? fuse_settings_make(FUSE_FIELD).sigma_system_m : 0.0;
    if (!how->bias)
        s.optics.bias_per_decade_m = s.optics.saturation_bias_m = 0.0;
    scan(&s);
    return s;
}

static const struct condition conditions[] = {
    {"true", false, false}, {"biased", false, true}, {"nominal", true, true}};

struct photo bench_scene_photo(const char *scene_name, bool quick) {
    struct stand s = open_stand(scene_name, &conditions[1], quick);
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

static void one_scene(const char *name, const struct condition *how, bool quick) {
    struct stand s = open_stand(name, how, quick);
    for (int q = FUSE_PREVIEW; q <= FUSE_SURVEY; q++) {
        struct fuse_settings settings = fuse_settings_make((enum fuse_quality)q);
        struct score score = judge(&s, &settings);
        report(name, how->name, fuse_settings_name((enum fuse_quality)q), &score);
    }
    free(s.samples);
    scene_destroy(s.scene);
}

int bench_accuracy(bool quick) {
    static const char *const scenes[] = {"room", "accident", "heritage"};
    (void)fprintf(
        stderr,
        "One face of a cube, samples 1.5 mrad apart, the twin's optics and rig; rms against "
        "truth,\n"
        "the same over sigma / root n of its samples, and the share that the reported sigma "
        "covers\n"
        "(68.3 %% if honest), inside surfaces; pixels that float, farther than 5 sigma of a "
        "sample\n"
        "from any surface, in 10 000: clustered, plainly averaged, and clustered where glass,\n"
        "mirrors, leaves or grass are within 6 pixels; shown: the share in %% of what is within "
        "range\n"
        "that is there, to 5 cm or 1 %%, clustered and averaged, then the same for glass, "
        "mirrors,\n"
        "leaves and grass. Inside pixels more than 0.1 m off are not in the rms. true: the true "
        "rig; biased: and the\n"
        "detector errs with the echo's strength, as the twin's does; nominal: the design's rig.\n"
        "  scene     rig      quality    Mpx   cpu s   rms mm  /(s/rt n)  covers   floats  "
        "averaged   "
        "glass..   shown aver.  glass..\n");
    for (size_t k = 0; k < (quick ? 1 : 3); k++)
        for (size_t c = 0; c < sizeof conditions / sizeof conditions[0]; c++)
            one_scene(scenes[k], &conditions[c], quick);
    return 0;
}
