/* How long a photograph takes, how that grows with the samples, and the peer's task. */
#include "../support/analytic.h"
#include "bench_fusion.h"
#include "fusion/face.h"
#include "raster/skin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 1600, HEIGHT = 1250 }; /* 2 megapixels */
static const double sigma_m = 0.004;

static struct camera camera_of(void) {
    return camera_pinhole(WIDTH, HEIGHT, 1.25);
}

static struct analytic_scan scan_of(double samples, double spot_rad) {
    struct analytic_scan scan = analytic_scan_default();
    scan.azimuth_min_rad = -0.9, scan.azimuth_max_rad = 0.9;
    scan.elevation_min_rad = -0.75, scan.elevation_max_rad = 0.75;
    double step = sqrt(1.8 * 1.5 / samples);
    scan.azimuth_step_rad = scan.elevation_step_rad = step;
    scan.sigma_m = sigma_m;
    scan.spot_rad = spot_rad;
    scan.smear_rad = spot_rad > 0 ? step : 0.0;
    return scan;
}

struct timing {
    double wall_s, cpu_s;
    struct resolve_counts counts;
};

static struct timing one(const struct scatter_sample *samples, size_t count, double beam_rad) {
    struct camera camera = camera_of();
    struct pose pose = face_station_from_cam(0);
    struct layer_params lp = layer_params_default();
    struct resolve_params rp = resolve_params_default();
    struct layer_image image;
    struct photo photo;
    struct timing t;
    struct errctx err;
    rp.beam_rad = beam_rad;
    double wall = bench_wall_s(), cpu = bench_cpu_s();
    bench_check(layer_create(&camera, &pose, &lp, &image, &err), &err);
    bench_check(layer_add(&image, samples, count), NULL);
    bench_check(photo_create(&camera, &photo, &err), &err);
    bench_check(resolve_photo(&image, &rp, 1, &photo, &t.counts, &err), &err);
    struct skin_params skins = skin_params_default();
    (void)skin_mark(&photo, &skins);
    t.wall_s = bench_wall_s() - wall;
    t.cpu_s = bench_cpu_s() - cpu;
    layer_destroy(&image);
    photo_destroy(&photo);
    return t;
}

int bench_speed(bool quick) {
    static const double millions[3] = {1.25, 5.0, 20.0};
    struct analytic_scene room = analytic_room();
    int rounds = quick ? 1 : 5, sizes = quick ? 2 : 3;
    (void)fprintf(stderr, "photograph of 2 Mpx, planarity skins included; best of %d\n", rounds);
    (void)fprintf(stderr, "  samples      wall s    cpu s   ns a sample (cpu)\n");
    for (int k = 0; k < sizes; k++) {
        struct analytic_scan scan = scan_of(millions[k] * 1e6, 0.0);
        size_t count = analytic_scan_count(&scan);
        struct scatter_sample *samples = malloc(count * sizeof *samples);
        if (!samples)
            return 1;
        analytic_scan_run(&room, &scan, samples);
        struct timing best = {.wall_s = 1e9, .cpu_s = 1e9};
        for (int r = 0; r < rounds; r++) {
            struct timing t = one(samples, count, 0.0);
            best.wall_s = fmin(best.wall_s, t.wall_s);
            best.cpu_s = fmin(best.cpu_s, t.cpu_s);
        }
        char name[64];
        (void)snprintf(name, sizeof name, "photo_2mpx_%gM_samples_s", millions[k]);
        bench_figure(name, best.wall_s, "s");
        (void)snprintf(name, sizeof name, "photo_2mpx_%gM_samples_cpu_s", millions[k]);
        bench_figure(name, best.cpu_s, "s");
        (void)fprintf(stderr, "  %8.2f M   %7.2f   %6.2f   %8.0f\n", (double)count * 1e-6,
                      best.wall_s, best.cpu_s, 1e9 * best.cpu_s / (double)count);
        free(samples);
    }
    return 0;
}

/* ---- a peer on the same points ---- */

/* 2.5 M samples with a beam as wide as two pixels: silhouettes float if they are averaged. */
static struct scatter_sample *peer_samples(size_t *out_count, double *out_beam_rad) {
    struct analytic_scene room = analytic_room();
    struct analytic_scan scan = scan_of(2.5e6, 1.5e-3);
    struct scatter_sample *samples = malloc(analytic_scan_count(&scan) * sizeof *samples);
    if (!samples)
        return NULL;
    analytic_scan_run(&room, &scan, samples);
    *out_count = analytic_scan_count(&scan);
    *out_beam_rad = scan.spot_rad + scan.smear_rad;
    return samples;
}

int bench_peer_write(const char *path) {
    size_t count = 0;
    double beam_rad = 0;
    struct scatter_sample *samples = peer_samples(&count, &beam_rad);
    FILE *out = samples ? fopen(path, "wb") : NULL;
    if (!out) {
        free(samples);
        return 1;
    }
    struct camera c = camera_of();
    struct pose pose = face_station_from_cam(0), cam_from_station = pose_inverse(&pose);
    float head[6] = {(float)c.width_px, (float)c.height_px, (float)c.fx_px,
                     (float)c.fy_px,    (float)c.cx_px,     (float)c.cy_px};
    (void)fwrite(head, sizeof head, 1, out);
    for (size_t i = 0; i < count; i++) {
        const float *p = samples[i].p_m;
        struct vec3 q =
            pose_apply(&cam_from_station, vec3_make((double)p[0], (double)p[1], (double)p[2]));
        float xyz[3] = {(float)q.x, (float)q.y, (float)q.z};
        if (!samples[i].flags || samples[i].flags == SAMPLE_INTENSITY)
            (void)fwrite(xyz, sizeof xyz, 1, out);
    }
    struct timing best = one(samples, count, beam_rad);
    for (int r = 0; r < 3; r++) {
        struct timing t = one(samples, count, beam_rad);
        best = t.wall_s < best.wall_s ? t : best;
    }
    bench_figure("peer_task_scancart_s", best.wall_s, "s");
    bench_figure("peer_task_scancart_cpu_s", best.cpu_s, "s");
    (void)fprintf(stderr, "the peer's task here: %.2f s wall, %.2f s cpu\n", best.wall_s,
                  best.cpu_s);
    free(samples);
    return fclose(out) ? 1 : 0;
}

static int64_t count_floating(const float *range_m, const struct camera *camera) {
    struct analytic_scene room = analytic_room();
    struct pose pose = face_station_from_cam(0);
    int64_t floating = 0;
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            double r = (double)range_m[y * WIDTH + x];
            if (!(r > 0 && isfinite(r)))
                continue;
            struct vec3 p = vec3_scale(vec3_unit(camera_pinhole_ray(camera, x, y)), r);
            floating += analytic_distance(&room, pose_apply(&pose, p)) > 5 * sigma_m;
        }
    return floating;
}

/* The peer's file: WIDTH x HEIGHT ranges. */
int bench_peer_read(const char *path, double seconds) {
    float *range = malloc(WIDTH * HEIGHT * sizeof *range);
    FILE *in = range ? fopen(path, "rb") : NULL;
    if (!in || fread(range, sizeof *range, WIDTH * HEIGHT, in) != (size_t)WIDTH * HEIGHT)
        return 1;
    (void)fclose(in);
    struct camera camera = camera_of();
    int64_t theirs = count_floating(range, &camera), valid = 0, own_valid = 0;
    for (int i = 0; i < WIDTH * HEIGHT; i++)
        valid += range[i] > 0 && isfinite(range[i]);
    size_t count = 0;
    double beam_rad = 0;
    struct scatter_sample *samples = peer_samples(&count, &beam_rad);
    struct layer_params lp = layer_params_default();
    struct resolve_params rp = resolve_params_default();
    struct pose pose = face_station_from_cam(0);
    struct layer_image image;
    struct photo photo;
    struct errctx err;
    rp.beam_rad = beam_rad;
    bench_check(layer_create(&camera, &pose, &lp, &image, &err), &err);
    bench_check(layer_add(&image, samples, count), NULL);
    bench_check(photo_create(&camera, &photo, &err), &err);
    bench_check(resolve_photo(&image, &rp, 0, &photo, NULL, &err), &err);
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        double norm = vec3_norm(camera_pinhole_ray(&camera, i % WIDTH, (double)(i / WIDTH)));
        range[i] = (float)(norm / (double)photo.disparity_per_m[i]);
        own_valid += photo.disparity_per_m[i] > 0;
    }
    int64_t ours = count_floating(range, &camera);
    bench_figure("peer_pcl_s", seconds, "s");
    bench_figure("peer_pcl_floating_share", (double)theirs / (double)valid, "1");
    bench_figure("peer_scancart_floating_share", (double)ours / (double)own_valid, "1");
    (void)fprintf(stderr, "peer: %.2f s, %lld of %lld pixels float; here: %lld of %lld\n", seconds,
                  (long long)theirs, (long long)valid, (long long)ours, (long long)own_valid);
    free(samples);
    free(range);
    layer_destroy(&image);
    photo_destroy(&photo);
    return 0;
}
