/* Bits a sample against the error asked for, beside simpler ways to store the same disparities. */
#include "bench_fusion.h"
#include "fusion/pack.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zstd.h>

static struct pack_stats pack_at(const struct photo *photo, double error_m, int planes,
                                 double noise_share) {
    struct tile_pack_photo entry;
    struct tile_pack_writer *writer = NULL;
    struct pack_params params = pack_params_default();
    struct pack_stats stats;
    struct errctx err;
    char path[] = "/tmp/bench-fusion-XXXXXX";
    if (mkstemp(path) < 0)
        exit(1);
    memset(&entry, 0, sizeof entry);
    entry.camera = photo->camera;
    entry.station_from_cam = photo->station_from_cam;
    entry.world_from_station = pose_identity();
    params.error_m = error_m;
    params.planes = planes;
    params.noise_share = noise_share;
    bench_check(tile_pack_create(path, &entry, 1, error_m, 6.0, &writer, &err), &err);
    bench_check(pack_photo(writer, &entry, photo, NULL, &params, &stats, &err), &err);
    bench_check(tile_pack_commit(writer, NULL, &err), &err);
    (void)remove(path);
    return stats;
}

static double zstd_bits(const void *bytes, size_t size, double samples) {
    size_t room = ZSTD_compressBound(size);
    void *out = malloc(room);
    size_t packed = out ? ZSTD_compress(out, room, bytes, size, 3) : 0;
    free(out);
    return ZSTD_isError(packed) ? (double)NAN : 8.0 * (double)packed / samples;
}

static size_t put_varint(uint8_t *p, int64_t value) {
    uint64_t z = ((uint64_t)value << 1) ^ (uint64_t)(value < 0 ? -1 : 0);
    size_t n = 0;
    do {
        p[n++] = (uint8_t)((z & 127u) | (z > 127 ? 128u : 0u));
        z >>= 7;
    } while (z);
    return n;
}

/* As point formats do it: x, y, z in steps of the error, differences from the sample before, then
 * zstd. */
static double point_bits(const struct photo *photo, double error_m, double *out_samples) {
    size_t pixels = (size_t)photo->camera.width_px * (size_t)photo->camera.height_px, at = 0;
    uint8_t *bytes = malloc(pixels * 30);
    int64_t last[3] = {0};
    double samples = 0;
    if (!bytes)
        exit(1);
    for (size_t i = 0; i < pixels; i++) {
        double d = (double)photo->disparity_per_m[i];
        if (!(d > 0))
            continue;
        struct vec3 p = vec3_scale(camera_pinhole_ray(&photo->camera,
                                                      (double)(i % (size_t)photo->camera.width_px),
                                                      (double)(i / (size_t)photo->camera.width_px)),
                                   1.0 / d);
        double step = 2.0 * error_m / sqrt(3.0); /* half of it, three ways, is the error */
        int64_t q[3] = {llrint(p.x / step), llrint(p.y / step), llrint(p.z / step)};
        for (int k = 0; k < 3; k++) {
            at += put_varint(bytes + at, q[k] - last[k]);
            last[k] = q[k];
        }
        samples++;
    }
    double bits = zstd_bits(bytes, at, samples);
    free(bytes);
    *out_samples = samples;
    return bits;
}

static void one_scene(const char *scene, bool quick) {
    static const double errors_mm[] = {0.25, 0.5, 1.0, 2.0, 4.0};
    struct photo photo = bench_scene_photo(scene, quick);
    size_t pixels = (size_t)photo.camera.width_px * (size_t)photo.camera.height_px;
    double samples = 0, float_bits;
    char name[96];
    (void)point_bits(&photo, 0.001, &samples);
    float_bits = zstd_bits(photo.disparity_per_m, pixels * sizeof(float), samples);
    (void)fprintf(stderr,
                  "%s: %.2f M samples; float32 32 bit, float32 + zstd %.1f, 16 bit a tile 16 (errs "
                  "%.2f mm at 6 m for a span of 0.5 1/m)\n",
                  scene, samples * 1e-6, float_bits, 0.5 / 65535 / 2 * 36 * 1e3);
    (void)fprintf(stderr,
                  "  error mm   planes  disparity  without planes  points+zstd   flags+conf.\n");
    for (size_t k = 0; k < sizeof errors_mm / sizeof errors_mm[0]; k++) {
        double e = errors_mm[k] * 1e-3;
        struct pack_stats with = pack_at(&photo, e, 1, 0.0), without = pack_at(&photo, e, 0, 0.0);
        double bits = 8.0 * (double)with.bytes_disparity / (double)with.samples;
        double plain = 8.0 * (double)without.bytes_disparity / (double)without.samples;
        double rest = 8.0 * (double)with.bytes_rest / (double)with.samples;
        double planes = (double)with.planes / (double)(with.planes + with.sampled);
        double points = point_bits(&photo, e, &samples);
        (void)fprintf(stderr, "  %6.2f    %5.1f %%   %6.2f       %6.2f        %6.2f        %6.2f\n",
                      errors_mm[k], 100 * planes, bits, plain, points, rest);
        (void)snprintf(name, sizeof name, "code_%s_%gmm_disparity_bits", scene, errors_mm[k]);
        bench_figure(name, bits, "bit");
        (void)snprintf(name, sizeof name, "code_%s_%gmm_disparity_bits_no_planes", scene,
                       errors_mm[k]);
        bench_figure(name, plain, "bit");
        (void)snprintf(name, sizeof name, "code_%s_%gmm_points_zstd_bits", scene, errors_mm[k]);
        bench_figure(name, points, "bit");
        (void)snprintf(name, sizeof name, "code_%s_%gmm_plane_share", scene, errors_mm[k]);
        bench_figure(name, planes, "1");
    }
    photo_destroy(&photo);
}

int bench_code(bool quick) {
    one_scene("room", quick);
    if (!quick) {
        one_scene("accident", quick);
        one_scene("heritage", quick);
    }
    return 0;
}
