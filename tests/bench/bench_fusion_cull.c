/* Culling: how much goes, and what 20 random views lose by it. */
#include "../support/analytic.h"
#include "base/rng.h"
#include "bench_fusion.h"
#include "fusion/cull.h"
#include "fusion/face.h"
#include "fusion/pack.h"
#include "fusion/reproject.h"
#include "raster/raster.h"
#include "raster/skin.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { STANDS = 4, FACES = 6, PHOTOS = STANDS * FACES, VIEWS = 20, VIEW_W = 640, VIEW_H = 480 };

/* A pattern with detail at 2 to 50 cm, so that a coarser photograph shows. */
static void texture(struct vec3 p, double albedo, uint8_t out_rgb[3]) {
    double a = sin(9.0 * p.x + 2.0 * sin(3.1 * p.y)) + sin(7.0 * p.y + 1.7 * sin(4.3 * p.z)) +
               sin(11.0 * p.z + 2.1 * sin(2.7 * p.x));
    double b = sin(97.0 * p.x) * sin(89.0 * p.y) + sin(83.0 * p.y) * sin(101.0 * p.z);
    double base = 255.0 * albedo * (0.7 + 0.12 * a + 0.07 * b);
    const double tint[3] = {1.0 + 0.15 * sin(2.0 * p.x), 1.0 + 0.1 * sin(2.3 * p.y),
                            1.0 - 0.1 * a / 3};
    for (int c = 0; c < 3; c++)
        out_rgb[c] = (uint8_t)lrint(fmin(fmax(base * tint[c], 0.0), 255.0));
}

/* What a camera sees, four looks a pixel. */
static void true_picture(const struct analytic_scene *scene, const struct camera *camera,
                         const struct pose *world_from_cam, uint8_t *out_rgb) {
#pragma omp parallel for schedule(dynamic, 8)
    for (int32_t y = 0; y < camera->height_px; y++)
        for (int32_t x = 0; x < camera->width_px; x++) {
            double sum[3] = {0};
            for (int k = 0; k < 4; k++) {
                struct vec3 ray =
                    camera_pinhole_ray(camera, x - 0.25 + 0.5 * (k & 1), y - 0.25 + 0.5 * (k >> 1));
                struct vec3 dir = vec3_unit(mat3_mulv(&world_from_cam->r, ray));
                double albedo = 0, r = analytic_cast(scene, world_from_cam->t_m, dir, &albedo);
                uint8_t rgb[3];
                texture(vec3_madd(world_from_cam->t_m, dir, r), albedo, rgb);
                for (int c = 0; c < 3; c++)
                    sum[c] += rgb[c] / 4.0;
            }
            for (int c = 0; c < 3; c++)
                out_rgb[3 * ((size_t)y * (size_t)camera->width_px + (size_t)x) + (size_t)c] =
                    (uint8_t)lrint(sum[c]);
        }
}

struct set {
    struct analytic_scene scene;
    struct photo photos[PHOTOS];
    struct vec3 at[STANDS];
    uint8_t *culled[PHOTOS];
    struct tile *tiles[PHOTOS];
    size_t tile_count;
};

static void make_photos(struct set *s, int32_t size) {
    static const struct vec3 stands[STANDS] = {
        {0, 0, 0}, {1.0, 2.2, 0.1}, {-0.5, -2.4, 0.05}, {-2.8, 0.3, 0}};
    s->scene = analytic_room();
    memcpy(s->at, stands, sizeof stands);
    struct reproject_view views[PHOTOS];
    struct errctx err;
    for (int i = 0; i < PHOTOS; i++) {
        struct camera camera = face_camera(size);
        struct photo *p = &s->photos[i];
        bench_check(photo_create(&camera, p, &err), &err);
        p->station_from_cam = face_station_from_cam(i % FACES);
        analytic_truth(&s->scene, s->at[i / FACES], &camera, &p->station_from_cam,
                       p->disparity_per_m);
        struct pose world_from_cam = p->station_from_cam;
        world_from_cam.t_m = s->at[i / FACES];
        true_picture(&s->scene, &camera, &world_from_cam, p->rgb);
        for (int32_t k = 0; k < size * size; k++) {
            struct rng rng = rng_stream((uint64_t)i, (uint64_t)k);
            double d = (double)p->disparity_per_m[k];
            double sigma = 0.002 * d * d /
                           vec3_norm(camera_pinhole_ray(&camera, k % size, (double)(k / size)));
            p->disparity_per_m[k] = (float)(d + sigma * rng_normal(&rng));
            p->confidence[k] = photo_confidence_from_sigma(sigma);
        }
        struct skin_params skins = skin_params_default();
        (void)skin_mark(p, &skins);
        views[i] = (struct reproject_view){.photo = p, .station = i / FACES, .pose_sigma_m = 1e-3};
        views[i].world_from_station = pose_identity();
        views[i].world_from_station.t_m = s->at[i / FACES];
        s->tile_count = photo_tile_count(size, size);
        s->culled[i] = calloc(s->tile_count, 1);
        s->tiles[i] = calloc(s->tile_count, sizeof *s->tiles[i]);
    }
    struct reproject_params params = reproject_params_default();
    bench_check(reproject_skins(views, PHOTOS, &params, NULL, NULL, &err), &err);
}

static struct pose station_pose(const struct set *s, int i) {
    struct pose pose = pose_identity();
    pose.t_m = s->at[i / FACES];
    return pose;
}

/* Blocks of 2 x 2 pixels that one picture has and the other has not: a seam wider than a pixel. */
static int64_t seams(const uint8_t *full, const uint8_t *culled) {
    int64_t wide = 0;
    for (int y = 0; y + 1 < VIEW_H; y++)
        for (int x = 0; x + 1 < VIEW_W; x++) {
            int lost = 0;
            for (int k = 0; k < 4; k++) {
                size_t i = (size_t)(y + (k >> 1)) * VIEW_W + (size_t)(x + (k & 1));
                lost += full[4 * i + 3] == 255 && culled[4 * i + 3] != 255;
            }
            wide += lost == 4;
        }
    return wide;
}

/* Mean PSNR of the views, over the pixels drawn in both the full and the culled picture; and the
 * number of places in all views where culling opens a seam wider than a pixel. */
static double mean_psnr(const struct set *s, const struct camera *camera, const struct pose *eyes,
                        uint8_t *const *truths, uint8_t **rgba, uint8_t *const *reference,
                        double *out_lost) {
    struct raster_input inputs[PHOTOS];
    struct raster_scratch scratch = {0};
    struct errctx err;
    double sum = 0;
    *out_lost = 0;
    for (int i = 0; i < PHOTOS; i++) {
        struct pose pose = station_pose(s, i);
        struct tile *all = malloc(s->tile_count * sizeof *all);
        size_t n = 0;
        photo_tiles(&s->photos[i], &pose, all);
        for (size_t t = 0; t < s->tile_count; t++)
            if (!s->culled[i][t])
                s->tiles[i][n++] = all[t];
        free(all);
        inputs[i] = (struct raster_input){.tiles = s->tiles[i],
                                          .tile_count = n,
                                          .photo_width_px = s->photos[i].camera.width_px,
                                          .photo_height_px = s->photos[i].camera.height_px,
                                          .id = (uint32_t)i};
    }
    for (int v = 0; v < VIEWS; v++) {
        struct raster_view view = raster_view_pinhole(camera, &eyes[v]);
        struct raster_options options = raster_options_default();
        struct raster_target target = {.width_px = VIEW_W, .height_px = VIEW_H, .rgba = rgba[v]};
        options.primitive = RASTER_MESH; /* closed surfaces: what is missing was culled */
        options.push_sigma = 2.0;
        options.sigma_unknown_per_m = 1e-4;
        bench_check(raster_draw(inputs, PHOTOS, &view, &options, &target, &scratch, NULL, &err),
                    &err);
        double error2 = 0, count = 0;
        for (size_t i = 0; i < (size_t)VIEW_W * VIEW_H; i++) {
            const uint8_t *ref = reference ? reference[v] : rgba[v];
            if (rgba[v][4 * i + 3] != 255 || ref[4 * i + 3] != 255)
                continue;
            count++;
            for (int c = 0; c < 3; c++)
                error2 += pow(
                    (double)rgba[v][4 * i + (size_t)c] - (double)truths[v][3 * i + (size_t)c], 2);
        }
        sum += 10 * log10(255.0 * 255.0 * 3.0 * count / error2) / VIEWS;
        *out_lost += reference ? (double)seams(reference[v], rgba[v]) : 0.0;
    }
    raster_scratch_fini(&scratch);
    return sum;
}

static int64_t packed_bytes(const struct set *s) {
    struct tile_pack_photo entries[PHOTOS];
    struct tile_pack_writer *writer = NULL;
    struct pack_params params = pack_params_default();
    struct errctx err;
    uint64_t bytes = 0;
    char path[] = "/tmp/bench-fusion-XXXXXX";
    int fd = mkstemp(path);
    if (fd < 0)
        exit(1);
    memset(entries, 0, sizeof entries);
    for (int i = 0; i < PHOTOS; i++) {
        entries[i].camera = s->photos[i].camera;
        entries[i].station_from_cam = s->photos[i].station_from_cam;
        entries[i].world_from_station = station_pose(s, i);
    }
    bench_check(tile_pack_create(path, entries, PHOTOS, 0.001, 6.0, &writer, &err), &err);
    for (int i = 0; i < PHOTOS; i++)
        bench_check(
            pack_photo(writer, &entries[i], &s->photos[i], s->culled[i], &params, NULL, &err),
            &err);
    bench_check(tile_pack_commit(writer, &bytes, &err), &err);
    (void)remove(path);
    return (int64_t)bytes;
}

static void choose_views(const struct set *s, struct pose *out_eyes) {
    struct rng rng = rng_make(11);
    for (int v = 0; v < VIEWS;) {
        struct vec3 eye = {rng_range(&rng, -3.4, 3.4), rng_range(&rng, -2.4, 2.4),
                           rng_range(&rng, -0.1, 0.5)};
        double yaw = rng_range(&rng, 0, 6.28), pitch = rng_range(&rng, -0.25, 0.2);
        struct vec3 to = vec3_add(eye, vec3_make(cos(yaw), sin(yaw), sin(pitch)));
        if (analytic_distance(&s->scene, eye) < 0.5 ||
            pose_look_at(eye, to, vec3_make(0, 0, 1), &out_eyes[v]))
            continue;
        v++;
    }
}

static void cull_at(struct set *s, double threshold, struct cull_counts *out) {
    struct cull_view views[PHOTOS];
    struct cull_params params = cull_params_default();
    struct errctx err;
    params.threshold = threshold;
    for (int i = 0; i < PHOTOS; i++)
        views[i] = (struct cull_view){.photo = &s->photos[i],
                                      .world_from_station = station_pose(s, i),
                                      .station = i / FACES,
                                      .pose_sigma_m = 1e-3,
                                      .culled = s->culled[i]};
    bench_check(cull_tiles(views, PHOTOS, &params, NULL, out, &err), &err);
}

int bench_cull(bool quick) {
    static struct set s;
    struct camera camera = camera_pinhole(VIEW_W, VIEW_H, 1.2);
    struct pose eyes[VIEWS];
    uint8_t *truths[VIEWS], *full[VIEWS], *culled[VIEWS];
    make_photos(&s, quick ? 192 : 768);
    choose_views(&s, eyes);
    for (int v = 0; v < VIEWS; v++) {
        truths[v] = malloc((size_t)3 * VIEW_W * VIEW_H);
        full[v] = malloc((size_t)4 * VIEW_W * VIEW_H);
        culled[v] = malloc((size_t)4 * VIEW_W * VIEW_H);
        if (!truths[v] || !full[v] || !culled[v])
            return 1;
        true_picture(&s.scene, &camera, &eyes[v], truths[v]);
    }
    double lost = 0, before = mean_psnr(&s, &camera, eyes, truths, full, NULL, &lost);
    int64_t bytes = packed_bytes(&s);
    (void)fprintf(stderr, "24 photographs of four stands, 20 random views: %.2f dB, %.2f MB\n",
                  before, (double)bytes * 1e-6);
    (void)fprintf(stderr, "  threshold  tiles culled   bytes    PSNR     loss   seams      s\n");
    static const double thresholds[] = {0.5, 1.0, 1.5, 2.0, 4.0};
    for (size_t k = 0; k < sizeof thresholds / sizeof thresholds[0]; k++) {
        struct cull_counts counts;
        double start = bench_wall_s();
        cull_at(&s, thresholds[k], &counts);
        double seconds = bench_wall_s() - start;
        double after = mean_psnr(&s, &camera, eyes, truths, culled, full, &lost);
        double share = (double)counts.culled / (double)(counts.tiles - counts.empty);
        double kept = (double)packed_bytes(&s) / (double)bytes;
        char name[64];
        (void)fprintf(stderr, "  %7.1f     %6.1f %%    %5.1f %%  %6.2f   %6.3f dB   %5.0f  %6.2f\n",
                      thresholds[k], 100 * share, 100 * kept, after, before - after, lost, seconds);
        (void)snprintf(name, sizeof name, "cull_%g_tiles_share", thresholds[k]);
        bench_figure(name, share, "1");
        (void)snprintf(name, sizeof name, "cull_%g_bytes_kept", thresholds[k]);
        bench_figure(name, kept, "1");
        (void)snprintf(name, sizeof name, "cull_%g_psnr_loss_db", thresholds[k]);
        bench_figure(name, before - after, "dB");
        (void)snprintf(name, sizeof name, "cull_%g_seams_2px", thresholds[k]);
        bench_figure(name, lost, "1");
    }
    return 0;
}
