/* Skins against truth, by the heuristic, by reprojection, by both; and 100 photographs against the
 * clock. */
#include "../support/analytic.h"
#include "base/rng.h"
#include "bench_fusion.h"
#include "fusion/face.h"
#include "fusion/reproject.h"
#include "raster/skin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { STANDS = 3, FACES = 6 };
static const double sigma_m = 0.004;

/* Photographs of one stand from scattered samples, as fusion makes them. */
static void stand_photos(const struct analytic_scene *scene, struct vec3 from_m, int32_t size,
                         uint64_t seed, struct photo out[FACES]) {
    struct analytic_scan scan = analytic_scan_default();
    scan.from_m = from_m;
    scan.seed = seed;
    scan.elevation_step_rad = scan.azimuth_step_rad = 1.6 / size;
    scan.elevation_min_rad = -1.57, scan.elevation_max_rad = 1.57;
    scan.spot_rad = 1e-3, scan.smear_rad = scan.elevation_step_rad;
    size_t count = analytic_scan_count(&scan);
    struct scatter_sample *samples = malloc(count * sizeof *samples);
    if (!samples)
        exit(1);
    analytic_scan_run(scene, &scan, samples);
    for (int face = 0; face < FACES; face++) {
        struct camera camera = face_camera(size);
        struct pose pose = face_station_from_cam(face);
        struct layer_params lp = layer_params_default();
        struct resolve_params rp = resolve_params_default();
        struct layer_image image;
        struct errctx err;
        lp.splat_px = 1.5;
        rp.beam_rad = scan.spot_rad + scan.smear_rad;
        bench_check(layer_create(&camera, &pose, &lp, &image, &err), &err);
        bench_check(layer_add(&image, samples, count), NULL);
        bench_check(photo_create(&camera, &out[face], &err), &err);
        bench_check(resolve_photo(&image, &rp, 1, &out[face], NULL, &err), &err);
        layer_destroy(&image);
    }
    free(samples);
}

/* Largest distance of the cell's surface from a true one; NaN: no cell. */
static double off_surface(const struct analytic_scene *scene, const struct photo *p, size_t i,
                          struct vec3 from_m) {
    size_t w = (size_t)p->camera.width_px, corner[4] = {i, i + 1, i + w, i + w + 1};
    struct vec3 q[4];
    double worst = 0;
    for (int k = 0; k < 4; k++) {
        double d = (double)p->disparity_per_m[corner[k]];
        if (!(d > 0))
            return (double)NAN;
        struct vec3 ray =
            camera_pinhole_ray(&p->camera, (double)(corner[k] % w), (double)(corner[k] / w));
        q[k] = vec3_add(pose_apply(&p->station_from_cam, vec3_scale(ray, 1.0 / d)), from_m);
    }
    for (int a = 0; a < 4; a++)
        for (int b = a + 1; b < 4; b++)
            for (int s = 1; s < 4; s++) {
                struct vec3 m = vec3_add(vec3_scale(q[a], s / 4.0), vec3_scale(q[b], 1 - s / 4.0));
                worst = fmax(worst, analytic_distance(scene, m));
            }
    return worst;
}

struct tally {
    int64_t skins, found[3], marked[3], wrong[3]; /* heuristic, reprojection, both */
};

static void tally_photo(const struct analytic_scene *scene, const struct photo *p,
                        const uint8_t *heuristic, struct vec3 from_m, struct tally *t) {
    size_t w = (size_t)p->camera.width_px, h = (size_t)p->camera.height_px;
    for (size_t y = 0; y + 1 < h; y++)
        for (size_t x = 0; x + 1 < w; x++) {
            size_t i = y * w + x;
            double off = off_surface(scene, p, i, from_m);
            if (isnan(off))
                continue;
            bool skin = off > 6 * sigma_m;
            bool a = (heuristic[i] & PHOTO_SKIN) != 0;
            bool b = (p->flags[i] & PHOTO_SKIN_DISPROVED) == PHOTO_SKIN_DISPROVED;
            bool says[3] = {a, b, a || b};
            t->skins += skin;
            for (int k = 0; k < 3; k++) {
                t->marked[k] += says[k];
                t->found[k] += says[k] && skin;
                t->wrong[k] += says[k] && off < 3 * sigma_m; /* a surface within its noise */
            }
        }
}

static void against_truth(const char *name, const struct analytic_scene *scene,
                          const struct vec3 at[STANDS], int32_t size) {
    static struct photo photos[STANDS * FACES];
    struct reproject_view views[STANDS * FACES];
    uint8_t *heuristic[STANDS * FACES];
    struct tally tally;
    memset(&tally, 0, sizeof tally);
    for (int s = 0; s < STANDS; s++)
        stand_photos(scene, at[s], size, (uint64_t)s + 1, photos + FACES * s);
    for (int i = 0; i < STANDS * FACES; i++) {
        struct skin_params skins = skin_params_default();
        size_t pixels = (size_t)size * (size_t)size;
        (void)skin_mark(&photos[i], &skins);
        heuristic[i] = malloc(pixels);
        if (!heuristic[i])
            exit(1);
        memcpy(heuristic[i], photos[i].flags, pixels);
        views[i] = (struct reproject_view){
            .photo = &photos[i], .station = i / FACES, .pose_sigma_m = 1e-3};
        views[i].world_from_station = pose_identity();
        views[i].world_from_station.t_m = at[i / FACES];
    }
    struct reproject_params params = reproject_params_default();
    struct reproject_counts counts;
    struct errctx err;
    double wall = bench_wall_s();
    bench_check(reproject_skins(views, STANDS * FACES, &params, NULL, &counts, &err), &err);
    wall = bench_wall_s() - wall;
    for (int i = 0; i < STANDS * FACES; i++) {
        tally_photo(scene, &photos[i], heuristic[i], at[i / FACES], &tally);
        photo_destroy(&photos[i]);
        free(heuristic[i]);
    }
    static const char *const methods[3] = {"planarity", "reprojection", "both"};
    (void)fprintf(stderr, "%s: %lld true skins, 18 photographs of %d px, reprojection in %.2f s\n",
                  name, (long long)tally.skins, (int)size, wall);
    for (int k = 0; k < 3; k++) {
        double precision = (double)tally.found[k] / (double)tally.marked[k];
        double recall = (double)tally.found[k] / (double)tally.skins;
        char key[96];
        (void)fprintf(stderr,
                      "  %-13s precision %6.2f %%  recall %6.2f %%  correct cells marked %lld\n",
                      methods[k], 100 * precision, 100 * recall, (long long)tally.wrong[k]);
        (void)snprintf(key, sizeof key, "skins_%s_%s_precision", name, methods[k]);
        bench_figure(key, precision, "1");
        (void)snprintf(key, sizeof key, "skins_%s_%s_recall", name, methods[k]);
        bench_figure(key, recall, "1");
        (void)snprintf(key, sizeof key, "skins_%s_%s_wrong_cells", name, methods[k]);
        bench_figure(key, (double)tally.wrong[k], "1");
    }
}

/* ---- 100 photographs ---- */

/* A photograph straight from truth, with noise: making it is not what is timed. */
static void true_photo(const struct analytic_scene *scene, struct vec3 from_m, int face,
                       int32_t size, struct photo *out) {
    struct camera camera = face_camera(size);
    struct errctx err;
    bench_check(photo_create(&camera, out, &err), &err);
    out->station_from_cam = face_station_from_cam(face);
    analytic_truth(scene, from_m, &camera, &out->station_from_cam, out->disparity_per_m);
#pragma omp parallel for schedule(static)
    for (int32_t y = 0; y < size; y++) {
        struct rng rng = rng_stream((uint64_t)face, (uint64_t)y);
        for (int32_t x = 0; x < size; x++) {
            size_t i = (size_t)y * (size_t)size + (size_t)x;
            double d = (double)out->disparity_per_m[i];
            double sigma = 0.002 * d * d / vec3_norm(camera_pinhole_ray(&camera, x, y));
            out->disparity_per_m[i] = (float)(d + sigma * rng_normal(&rng));
            out->confidence[i] = photo_confidence_from_sigma(sigma);
        }
    }
}

static void hundred(bool quick) {
    enum { MOST = 100 };
    int stands = quick ? 2 : 17, count = quick ? 12 : MOST;
    int32_t size = quick ? 256 : 1024;
    struct analytic_scene room = analytic_room();
    static struct photo photos[MOST];
    static struct reproject_view views[MOST];
    struct rng rng = rng_make(5);
    struct vec3 at[17];
    for (int s = 0; s < stands;) {
        struct vec3 p = {rng_range(&rng, -3.5, 3.5), rng_range(&rng, -2.5, 2.5),
                         rng_range(&rng, -0.1, 0.2)};
        if (analytic_distance(&room, p) > 0.4)
            at[s++] = p;
    }
    for (int i = 0; i < count; i++) {
        true_photo(&room, at[i / FACES], i % FACES, size, &photos[i]);
        views[i] = (struct reproject_view){
            .photo = &photos[i], .station = i / FACES, .pose_sigma_m = 1e-3};
        views[i].world_from_station = pose_identity();
        views[i].world_from_station.t_m = at[i / FACES];
    }
    struct reproject_params params = reproject_params_default();
    struct reproject_counts counts;
    struct errctx err;
    double wall = bench_wall_s(), cpu = bench_cpu_s();
    bench_check(reproject_skins(views, (size_t)count, &params, NULL, &counts, &err), &err);
    wall = bench_wall_s() - wall;
    cpu = bench_cpu_s() - cpu;
    (void)fprintf(
        stderr,
        "%d photographs of %d x %d: %.1f s wall, %.1f s cpu, %lld pairs, %lld warps, %lld of %lld "
        "cells disproved\n",
        count, (int)size, (int)size, wall, cpu, (long long)counts.pairs, (long long)counts.warps,
        (long long)counts.disproved, (long long)counts.candidates);
    bench_figure("skins_100_photographs_s", wall, "s");
    bench_figure("skins_100_photographs_cpu_s", cpu, "s");
    for (int i = 0; i < count; i++)
        photo_destroy(&photos[i]);
}

int bench_skins(bool quick) {
    static const struct vec3 in_room[STANDS] = {{0, 0, 0}, {1.0, 2.2, 0.1}, {-0.5, -2.4, 0.05}};
    static const struct vec3 in_yard[STANDS] = {{0, 0, 0}, {3, 5, 0}, {2, -6, 0}};
    struct analytic_scene room = analytic_room(), yard = analytic_yard();
    against_truth("room", &room, in_room, quick ? 160 : 512);
    against_truth("yard", &yard, in_yard, quick ? 160 : 512);
    hundred(quick);
    return 0;
}
