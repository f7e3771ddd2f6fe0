/* How fast the rasteriser is. One 3D photograph of 1024 x 612 samples (627 thousand) of a made-up
 * room, drawn at 1280 x 720 from 20 cm beside its place, and a panorama of sixteen for the
 * rejection of tiles. Prints JSON: a list of {"name", "value", "unit"}. Usage: bench_raster [RUNS]
 */
#include "base/clock.h"
#include "base/json.h"
#include "raster/raster.h"
#include "raster/skin.h"
#include "tests/support/draw.h"
#include "tests/support/room.h"

#include <omp.h>
#include <stdio.h>

enum { WIDTH = 1280, HEIGHT = 720, STANDS = 2, PER_STAND = 8 };
static const struct vec3 no_offset = {0, 0, 0};

static void put(struct json *json, const char *name, double value, const char *unit) {
    struct cJSON *entry = json_object(json, NULL, NULL);
    json_text(json, entry, "name", name);
    json_number(json, entry, "value", value);
    json_text(json, entry, "unit", unit);
}

static struct draw_photo photograph(int32_t width_px, int32_t height_px, double hfov_rad,
                                    double x_m, double y_m, double azimuth_rad, uint32_t id) {
    struct camera cam = camera_pinhole(width_px, height_px, hfov_rad);
    struct pose pose = room_pose(x_m, y_m, azimuth_rad, no_offset);
    struct photo photo = room_photo(&cam, &pose, no_offset, 0.003, id + 1);
    struct skin_params params = skin_params_default();
    (void)skin_mark(&photo, &params);
    return draw_photo_make(photo, id);
}

static struct raster_view view_at(double x_m, double y_m, double azimuth_rad) {
    struct camera cam = camera_pinhole(WIDTH, HEIGHT, 1.25);
    struct pose pose = room_pose(x_m, y_m, azimuth_rad, no_offset);
    return raster_view_pinhole(&cam, &pose);
}

/* Seconds that each figure tries for its fastest frame. */
static double seconds = 1.5;

/* The fastest of at least `runs` frames; the others had to share the machine. */
static struct raster_stats best_of(int runs, const struct raster_input *inputs, size_t count,
                                   const struct raster_view *view,
                                   const struct raster_options *options, struct draw_target *t) {
    struct raster_stats best = {.total_s = 1e9};
    int64_t start_ns = clock_now_ns();
    for (int i = 0; i < runs || 1e-9 * (double)(clock_now_ns() - start_ns) < seconds; i++) {
        if (draw(t, inputs, count, view, options)) {
            (void)fprintf(stderr, "bench_raster: drawing failed\n");
            exit(1);
        }
        if (t->stats.total_s < best.total_s)
            best = t->stats;
    }
    return best;
}

static double msamples_per_s(const struct raster_stats *s) {
    return 1e-6 * (double)s->samples_drawn / s->total_s;
}

/* Bytes per second of the machine's own memcpy over a picture's worth of keys, all threads
 * together. */
static double memcpy_bytes_per_s(int runs) {
    size_t n = (size_t)8 * WIDTH * HEIGHT;
    int threads = omp_get_max_threads();
    uint8_t *from = malloc(n * (size_t)threads), *to = malloc(n * (size_t)threads);
    double best_s = 1e9;
    if (!from || !to)
        exit(1);
    memset(from, 1, n * (size_t)threads);
    for (int i = 0; i < runs; i++) {
        int64_t start_ns = clock_now_ns();
#pragma omp parallel for num_threads(threads)
        for (int k = 0; k < threads; k++)
            memcpy(to + n * (size_t)k, from + n * (size_t)k, n);
        double s = 1e-9 * (double)(clock_now_ns() - start_ns);
        best_s = s < best_s ? s : best_s;
    }
    free(from);
    free(to);
    return 2.0 * (double)n * threads / best_s;
}

static void primitives(struct json *json, int runs) {
    static const char *const names[] = {"points", "splat", "mesh"};
    struct draw_photo d = photograph(1024, 612, 1.2, -2.5, -1.5, 0.5, 0);
    struct raster_view view = view_at(-2.4, -1.33, 0.48);
    struct draw_target t = draw_target_make(WIDTH, HEIGHT, false);
    double rate[3], copy = memcpy_bytes_per_s(runs);
    char name[64];
    for (int p = 0; p < 3; p++) {
        struct raster_options options = raster_options_default();
        options.primitive = (enum raster_primitive)p;
        struct raster_stats all = best_of(runs, &d.input, 1, &view, &options, &t);
        options.threads = 1;
        struct raster_stats one = best_of(runs, &d.input, 1, &view, &options, &t);
        rate[p] = msamples_per_s(&all);
        (void)snprintf(name, sizeof name, "%s_msamples_per_s", names[p]);
        put(json, name, rate[p], "Msamples/s");
        (void)snprintf(name, sizeof name, "%s_frame_ms", names[p]);
        put(json, name, 1e3 * all.total_s, "ms");
        (void)snprintf(name, sizeof name, "%s_thread_speedup", names[p]);
        put(json, name, one.total_s / all.total_s, "x");
        (void)snprintf(name, sizeof name, "%s_bytes_per_sample", names[p]);
        put(json, name, (double)all.bytes_touched / (double)all.samples_drawn, "B/sample");
        (void)snprintf(name, sizeof name, "%s_memcpy_share", names[p]);
        put(json, name, (double)all.bytes_touched / all.total_s / copy, "1");
        (void)snprintf(name, sizeof name, "%s_coverage", names[p]);
        put(json, name, (double)draw_count(&t, RASTER_ALPHA_SURFACE) / (double)t.pixels, "1");
    }
    put(json, "splat_to_mesh", rate[1] / rate[2], "x");
    put(json, "splat_to_points", rate[1] / rate[0], "x");
    put(json, "threads", omp_get_max_threads(), "1");
    draw_target_fini(&t);
    draw_photo_fini(&d);
}

/* The panorama of two stands from views all over the room. */
static void rejection(struct json *json, int runs) {
    struct draw_photo photos[STANDS * PER_STAND];
    struct raster_input inputs[STANDS * PER_STAND];
    static const double at[STANDS][2] = {{-2.0, -1.5}, {1.8, -1.6}};
    for (uint32_t i = 0; i < STANDS * PER_STAND; i++) {
        const double *stand = at[i / PER_STAND];
        photos[i] = photograph(512, 448, 0.85, stand[0], stand[1],
                               6.283185307179586 / PER_STAND * (i % PER_STAND), i);
        inputs[i] = photos[i].input;
    }
    struct draw_target t = draw_target_make(WIDTH, HEIGHT, false);
    struct raster_options options = raster_options_default();
    double reject_s = 0, total_s = 0;
    int64_t tiles = 0, rejected = 0;
    for (int k = 0; k < 12; k++) {
        seconds = 0.0;
        struct raster_view view = view_at(-2.2 + 0.4 * k, -1.8 + 0.2 * (k % 4), 0.5 * k);
        struct raster_stats s =
            best_of(runs / 4 + 1, inputs, STANDS * PER_STAND, &view, &options, &t);
        reject_s += s.reject_s;
        total_s += s.total_s;
        tiles += s.tiles_total;
        rejected += s.tiles_rejected;
    }
    put(json, "tiles_rejected_share", (double)rejected / (double)tiles, "1");
    put(json, "rejection_time_share", reject_s / total_s, "1");
    put(json, "rejection_ns_per_tile", 1e9 * reject_s / (double)tiles, "ns");
    draw_target_fini(&t);
    for (int i = 0; i < STANDS * PER_STAND; i++)
        draw_photo_fini(&photos[i]);
}

int main(int argc, char **argv) {
    int runs = argc > 1 ? atoi(argv[1]) : 40;
    if (runs < 10) /* only to see that it works */
        seconds = 0.0;
    struct json json;
    json_init_array(&json);
    primitives(&json, runs);
    rejection(&json, runs);
    struct errctx err = {0};
    if (json_write(&json, stdout, &err)) {
        (void)fprintf(stderr, "bench_raster: %s\n", err.text);
        return 1;
    }
    json_fini(&json);
    return 0;
}
