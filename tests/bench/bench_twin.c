/* JSON on stdout, text for people on stderr. How fast the simulated head is: rays/s and samples/s
 * of a 180 x 90 degree panorama at 20 samples a degree with 4 rays a sample, and packets decoded
 * per second. Usage: bench_twin [SCENE] [FRACTION] */
#include "base/clock.h"
#include "base/head_packet.h"
#include "twin/optics.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double deg = 3.14159265358979323846 / 180;

static double seconds_since(int64_t t_ns) {
    return (double)(clock_now_ns() - t_ns) * 1e-9;
}

/* Shoots the panorama; returns the number of echoes so that nothing is optimised away. */
static long panorama(const struct scene *scene, const struct optics *optics, int columns,
                     int rows) {
    long echoes = 0;
    struct vec3 origin = {scene->stand[0].position_m.x, scene->stand[0].position_m.y, 1.6};
#pragma omp parallel for schedule(dynamic, 8) reduction(+ : echoes)
    for (int column = 0; column < columns; column++) {
        for (int row = 0; row < rows; row++) {
            double az = 180 * deg * column / columns, el = (90.0 * row / rows - 45) * deg;
            struct optics_beam beam = {.origin_m = origin,
                                       .dir = {cos(el) * cos(az), cos(el) * sin(az), sin(el)}};
            beam.sweep =
                vec3_scale(vec3_make(-sin(el) * cos(az), -sin(el) * sin(az), cos(el)), 1e-3);
            struct rng rng = rng_stream(1, (uint64_t)column * 100000 + (uint64_t)row);
            struct optics_echo echo;
            struct optics_reading reading;
            optics_shoot(scene, optics, &beam, &rng, &echo);
            optics_detect(optics, &echo, 0, &rng, &reading);
            echoes += echo.echoes + (reading.flags == 0);
        }
    }
    return echoes;
}

static double decode(void) {
    enum { PACKETS = 4000 };
    struct head_packet p = {.interval_ns = 40000, .sample_count = HEAD_PACKET_MAX_SAMPLES};
    uint8_t *bytes = malloc((size_t)PACKETS * HEAD_PACKET_MAX_BYTES);
    if (!bytes)
        return 0;
    size_t size = 0, used = 0;
    for (uint32_t i = 0; i < PACKETS; i++, size += used) {
        p.packet_seq = i;
        if (head_packet_encode(&p, bytes + size, &used))
            return 0;
    }
    int64_t start_ns = clock_now_ns();
    long samples = 0;
    for (int round = 0; round < 20; round++) {
        struct head_stream_stats stats = {0};
        size_t offset = 0;
        while (head_stream_next(bytes, size, &offset, &p, &stats) == ST_OK)
            samples += p.sample_count;
    }
    double rate = (double)samples / seconds_since(start_ns);
    (void)fprintf(stderr, "head packets decoded   %7.1f M samples/s (one thread)\n", rate * 1e-6);
    free(bytes);
    return rate;
}

int main(int argc, char **argv) {
    const char *name = argc > 1 ? argv[1] : "room";
    double fraction = argc > 2 ? atof(argv[2]) : 1;
    struct errctx err = {0};
    struct scene *scene = NULL;
    int64_t start_ns = clock_now_ns();
    if (scene_create(name, 1, 1, &scene, &err)) {
        (void)fprintf(stderr, "%s\n", err.text);
        return 1;
    }
    (void)fprintf(stderr, "scene %-16s %7.2f M triangles, built in %.2f s\n", name,
                  (double)scene->mesh.triangle_count * 1e-6, seconds_since(start_ns));
    struct optics optics = optics_default();
    optics.max_range_m = 15;
    int columns = (int)(180 * 20 * fraction), rows = 90 * 20;
    start_ns = clock_now_ns();
    long echoes = panorama(scene, &optics, columns, rows);
    double took_s = seconds_since(start_ns), samples = (double)columns * rows;
    (void)printf(
        "180 x 90 deg at 20/deg  %6.2f s%s, %.2f M samples/s, %.2f M rays/s (%ld echoes)\n",
        took_s / fraction, fraction < 1 ? " (extrapolated)" : "", samples / took_s * 1e-6,
        samples * optics.rays / took_s * 1e-6, echoes);
    double decoded = decode();
    (void)printf("[{\"name\": \"twin_%s_panorama\", \"value\": %.2f, \"unit\": \"s\"},\n"
                 " {\"name\": \"twin_%s_rays\", \"value\": %.0f, \"unit\": \"rays/s\"},\n"
                 " {\"name\": \"head_packet_decode\", \"value\": %.0f, \"unit\": \"samples/s\"}]\n",
                 name, took_s / fraction, name, samples * optics.rays / took_s, decoded);
    scene_destroy(scene);
    return 0;
}
