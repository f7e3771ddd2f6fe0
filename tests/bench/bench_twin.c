/* JSON on stdout, text for people on stderr.
 *   bench_twin [SCENE] [FRACTION]   how fast the simulated head is: rays/s and samples/s of a 180 x
 * 90 degree panorama at 20 samples a degree with 4 rays a sample, and packets decoded per second
 *   bench_twin --rig                what two of the UNC cart's errors amount to at 3 m
 *   bench_twin --mesh DIR [MILLION] time to load a mesh file of so many triangles (10) as a scene
 */
#include "base/clock.h"
#include "base/head_packet.h"
#include "twin/optics.h"
#include "twin/scene.h"
#include "twin/twin_config.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static const double deg = 3.14159265358979323846 / 180;

static double seconds_since(int64_t t_ns) {
    return (double)(clock_now_ns() - t_ns) * 1e-9;
}

/* Processor time of all threads: what other users of the machine do not lengthen much. */
static double cpu_s(void) {
    struct timespec t = {0, 0};
    (void)clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
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

/* The point that the nominal rig makes of a wall at 3 m, and how far off it is with one error. */
static double displaced_mm(const struct rig *wrong, const struct rig *right, double counts,
                           double pan_steps) {
    struct vec3 p[2];
    const struct rig *rig[2] = {wrong, right};
    for (int i = 0; i < 2; i++)
        p[i] = rig_point(rig[i], rig_mirror_angle(rig[i], counts), 0,
                         rig_pan_angle(rig[i], pan_steps, 0), rig_range(rig[i], 3));
    return 1000 * vec3_norm(vec3_sub(p[0], p[1]));
}

static void rig_errors(void) {
    struct twin_config config = twin_config_ideal();
    struct rig right = twin_config_rig(&config, true), mirror = right, pan = right;
    mirror.mirror_angle_rad -= 0.2 * deg;
    pan.pan_steps_per_turn = 2 * 14000;
    right.pan_steps_per_turn = 2 * 14039;
    double pan_mm = displaced_mm(&pan, &right, 1024, 14000);
    right.pan_steps_per_turn = pan.pan_steps_per_turn;
    mirror.pan_steps_per_turn = pan.pan_steps_per_turn;
    double mirror_mm = displaced_mm(&mirror, &right, 1024, 0);
    (void)fprintf(stderr,
                  "0.2 deg of mirror angle at 3 m       %5.1f mm\n"
                  "14 039 for 14 000 steps over 180 deg  %5.1f mm\n",
                  mirror_mm, pan_mm);
    (void)printf("[{\"name\": \"twin_mirror_0.2deg_3m\", \"value\": %.2f, \"unit\": \"mm\"},\n"
                 " {\"name\": \"twin_14039_steps_3m\", \"value\": %.2f, \"unit\": \"mm\"}]\n",
                 mirror_mm, pan_mm);
}

/* A wavy ground of 2 * side^2 triangles as a binary PLY file. */
static bool write_ground(const char *path, uint32_t side) {
    FILE *file = fopen(path, "wb");
    if (!file)
        return false;
    (void)fprintf(file,
                  "ply\nformat binary_little_endian 1.0\nelement vertex %u\nproperty float x\n"
                  "property float y\nproperty float z\nelement face %u\n"
                  "property list uchar int vertex_indices\nend_header\n",
                  (side + 1) * (side + 1), 2 * side * side);
    for (uint32_t y = 0; y <= side; y++)
        for (uint32_t x = 0; x <= side; x++) {
            float at[3] = {20.0f * (float)x / (float)side, 20.0f * (float)y / (float)side,
                           0.05f * (float)((x * 7 + y * 13) % 31) / 31.0f};
            (void)fwrite(at, sizeof at, 1, file);
        }
    for (uint32_t y = 0; y < side; y++)
        for (uint32_t x = 0; x < side; x++) {
            uint32_t a = y * (side + 1) + x, b = a + side + 1;
            const uint32_t corner[2][3] = {{a, a + 1, b}, {a + 1, b + 1, b}};
            for (int k = 0; k < 2; k++) {
                (void)fputc(3, file);
                (void)fwrite(corner[k], sizeof corner[k], 1, file);
            }
        }
    return !fclose(file);
}

static int load_mesh(const char *dir, double million) {
    char path[512];
    struct errctx err = {0};
    struct scene *scene = NULL;
    (void)snprintf(path, sizeof path, "%s/ground.ply", dir);
    if (!write_ground(path, (uint32_t)sqrt(million * 5e5))) {
        (void)fprintf(stderr, "cannot write %s\n", path);
        return 1;
    }
    int64_t start_ns = clock_now_ns();
    enum st st = scene_load(path, &scene, &err);
    double took_s = seconds_since(start_ns);
    (void)remove(path);
    if (st) {
        (void)fprintf(stderr, "%s\n", err.text);
        return 1;
    }
    (void)fprintf(stderr, "mesh file of %.1f M triangles  loaded, with its hierarchy, in %.1f s\n",
                  (double)scene->mesh.triangle_count * 1e-6, took_s);
    (void)printf("[{\"name\": \"twin_mesh_load\", \"value\": %.0f, \"unit\": \"triangles/s\"}]\n",
                 (double)scene->mesh.triangle_count / took_s);
    scene_destroy(scene);
    return 0;
}

int main(int argc, char **argv) {
    if (argc > 1 && !strcmp(argv[1], "--rig")) {
        rig_errors();
        return 0;
    }
    if (argc > 2 && !strcmp(argv[1], "--mesh"))
        return load_mesh(argv[2], argc > 3 ? atof(argv[3]) : 10);
    const char *name = argc > 1 ? argv[1] : "room";
    double fraction = argc > 2 ? atof(argv[2]) : 1;
    struct errctx err = {0};
    struct scene *scene = NULL;
    int64_t start_ns = clock_now_ns();
    double start_s = cpu_s();
    if (scene_create(name, 1, 1, &scene, &err)) {
        (void)fprintf(stderr, "%s\n", err.text);
        return 1;
    }
    (void)fprintf(stderr, "scene %-10s %5.2f M triangles, built in %.1f s (%.1f s of processor)\n",
                  name, (double)scene->mesh.triangle_count * 1e-6, seconds_since(start_ns),
                  cpu_s() - start_s);
    struct optics optics = optics_default();
    optics.max_range_m = 15;
    int columns = (int)(180 * 20 * fraction), rows = 90 * 20;
    start_ns = clock_now_ns();
    start_s = cpu_s();
    long echoes = panorama(scene, &optics, columns, rows);
    double took_s = seconds_since(start_ns), used_s = cpu_s() - start_s;
    double rays = (double)columns * rows * optics.rays;
    (void)fprintf(stderr,
                  "  180 x 90 deg, 20/deg, 4 rays%s: %.1f s here, %.1f s on two free cores\n",
                  fraction < 1 ? " (from a part)" : "", took_s / fraction, used_s / fraction / 2);
    (void)fprintf(stderr, "  %.2f M rays/s and core (%ld echoes)\n", rays / used_s * 1e-6, echoes);
    double decoded = decode();
    (void)printf("[{\"name\": \"twin_%s_panorama\", \"value\": %.2f, \"unit\": \"s\"},\n"
                 " {\"name\": \"twin_%s_panorama_cpu\", \"value\": %.2f, \"unit\": \"s\"},\n"
                 " {\"name\": \"twin_%s_rays\", \"value\": %.0f, \"unit\": \"rays/s\"},\n"
                 " {\"name\": \"head_packet_decode\", \"value\": %.0f, \"unit\": \"samples/s\"}]\n",
                 name, took_s / fraction, name, used_s / fraction, name, rays / used_s, decoded);
    scene_destroy(scene);
    return 0;
}
