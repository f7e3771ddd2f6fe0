/* What the viewer's choices cost and what they buy: pictures of a scanned scene from places where
 * one can walk, against ray-traced truth.
 *
 * Usage: bench_viewer PACK SCENE VIEWS TABLE [LARGE_PACK]
 * PACK is a site's tile pack of the twin's SCENE, LARGE_PACK one too large to be drawn whole.
 * Prints a JSON list; writes TABLE (columns: primitive, error, PSNR, milliseconds, samples) for the
 * plot; explains itself on
 * stderr. Milliseconds are processor time of all threads together. */
#include "base/json.h"
#include "base/picture.h"
#include "base/rng.h"
#include "render/view_scene.h"
#include "twin/camera_sim.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { W = 640, H = 360, WIDE_W = 1280, WIDE_H = 720, VIEWS_MAX = 32 };
enum { ERRORS = 3, PRIMITIVES = 5, REPEATS = 4, GL_VIEWS = 4 };
static const double errors_px[ERRORS] = {4.0, 2.0, 1.0};
static const char *const primitive_names[PRIMITIVES] = {"auto", "points", "splats", "mesh",
                                                        "planes"};
/* Where less of the picture is known there is nothing to compare. */
static const double known_min = 0.4;
static const double hfov_rad = 1.2, eye_height_m = 1.6, clearance_m = 0.35;

struct bench {
    struct scene *truth;
    struct tile_pack *pack;
    struct view_scene *scene;
    struct renderer *renderers[RENDER_KINDS];
    int views;
    struct pose poses[VIEWS_MAX];
    uint8_t *truth_rgb[VIEWS_MAX], *known[VIEWS_MAX];
    struct json json;
    FILE *table;
};

static uint8_t rgba[4 * WIDE_W * WIDE_H];

static void must(enum st st, const struct errctx *err) {
    if (!st)
        return;
    (void)fprintf(stderr, "bench_viewer: %s\n", err->text);
    exit(1);
}

static void put(struct bench *b, const char *name, double value, const char *unit) {
    struct cJSON *entry = json_object(&b->json, NULL, NULL);
    json_text(&b->json, entry, "name", name);
    json_number(&b->json, entry, "value", value);
    json_text(&b->json, entry, "unit", unit);
}

static struct raster_view view_of(const struct pose *pose, int32_t w, int32_t h) {
    struct camera camera = camera_pinhole(w, h, hfov_rad);
    struct raster_view view = raster_view_pinhole(&camera, pose);
    view.near_m = 0.001;
    return view;
}

static struct raster_options options_as_viewer(void) {
    struct raster_options o = raster_options_default();
    o.push_sigma = 2.0;
    return o;
}

/* One picture: what it took. */
struct cost {
    double ms;
    int64_t samples;
};

/* Processor time of all threads: on a machine that others use, too, it says more than a clock. */
static double processor_ms(void) {
    struct timespec t;
    if (clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t))
        exit(1);
    return 1e3 * (double)t.tv_sec + 1e-6 * (double)t.tv_nsec;
}

/* The fastest of `repeats`, selection and drawing together; everything is in memory before. */
static struct cost draw(struct bench *b, struct renderer *renderer, const struct raster_view *view,
                        enum view_primitive primitive, double error_px, int repeats) {
    struct errctx err = {0};
    struct view_quality quality = view_quality_default();
    struct raster_options options = options_as_viewer();
    struct raster_target target = {
        .width_px = view->width_px, .height_px = view->height_px, .rgba = rgba};
    const struct render_item *items;
    size_t count;
    struct view_scene_stats chosen;
    struct render_stats drawn;
    struct cost cost = {(double)INFINITY, 0};
    quality.error_px = error_px;
    quality.primitive = primitive;
    quality.tiles_max = 1 << 20;
    quality.load_s = 1.0;
    quality.planes_pay = render_kind_of(renderer) != RENDER_CPU;
    do
        must(view_scene_select(b->scene, view, &quality, &items, &count, &chosen, &err), &err);
    while (!chosen.complete);
    for (int i = 0; i < repeats; i++) {
        double start_ms = processor_ms();
        must(view_scene_select(b->scene, view, &quality, &items, &count, &chosen, &err), &err);
        struct render_frame frame = {items, count, view, &options};
        must(render_draw(renderer, &frame, &target, &drawn, &err), &err);
        cost.ms = fmin(cost.ms, processor_ms() - start_ms);
    }
    cost.samples = chosen.samples;
    return cost;
}

/* ---- views ---- */

/* Between two stands or beside one, where a person could stand, looking anywhere. */
static struct pose random_pose(const struct scene *scene, struct rng *rng) {
    struct errctx ignored;
    struct pose pose;
    for (;;) {
        const struct scene_stand *a = &scene->stand[rng_below(rng, (uint32_t)scene->stand_count)];
        const struct scene_stand *c = &scene->stand[rng_below(rng, (uint32_t)scene->stand_count)];
        struct vec3 eye =
            vec3_madd(a->position_m, vec3_sub(c->position_m, a->position_m), rng_uniform(rng));
        eye.x += 2.0 * rng_uniform(rng) - 1.0;
        eye.y += 2.0 * rng_uniform(rng) - 1.0;
        eye.z += eye_height_m;
        double azimuth = 6.283185307179586 * rng_uniform(rng), up = 0.3 * rng_uniform(rng) - 0.25;
        struct vec3 ahead = vec3_make(cos(azimuth), sin(azimuth), up);
        if (!scene_check_place(scene, eye, clearance_m, &ignored) &&
            !pose_look_at(eye, vec3_add(eye, ahead), vec3_make(0, 0, 1), &pose))
            return pose;
    }
}

static void ray_trace(struct bench *b, int k) {
    struct camera camera = camera_pinhole(W, H, hfov_rad);
    struct camera_sim sim = camera_sim_at(&camera, &b->poses[k]);
    struct image_u8 im;
    struct errctx err = {0};
    must(camera_sim_render(b->truth, &sim, &im, &err), &err);
    b->truth_rgb[k] = malloc((size_t)3 * W * H);
    for (int32_t y = 0; b->truth_rgb[k] && y < H; y++)
        memcpy(b->truth_rgb[k] + (size_t)3 * W * (size_t)y, im.px + im.stride_bytes * (size_t)y,
               (size_t)3 * W);
    image_u8_destroy(&im);
}

/* With BENCH_PICTURES set to a folder, pictures and truth side by side, to be looked at. */
static void keep(const struct bench *b, int k) {
    const char *folder = getenv("BENCH_PICTURES");
    struct image_u8 im;
    struct errctx err = {0};
    char path[1024];
    if (!folder)
        return;
    must(image_u8_create(&im, 2 * W, H, 3), &err);
    for (int32_t y = 0; y < H; y++)
        for (int32_t x = 0; x < W; x++) {
            size_t at = (size_t)y * W + (size_t)x;
            memcpy(image_u8_at(&im, x, y), rgba + 4 * at, 3);
            memcpy(image_u8_at(&im, W + x, y), b->truth_rgb[k] + 3 * at, 3);
        }
    (void)snprintf(path, sizeof path, "%s/view-%02d.png", folder, k);
    must(picture_write_png(path, &im, &err), &err);
    image_u8_destroy(&im);
}

/* Pixels that the finest mesh covers are known: all are judged there, holes count against them. */
static void make_views(struct bench *b, int views) {
    struct rng rng = rng_make(2026);
    int tried = 0;
    while (b->views < views) {
        int k = b->views;
        size_t n = (size_t)W * H, known = 0;
        b->poses[k] = random_pose(b->truth, &rng);
        struct raster_view view = view_of(&b->poses[k], W, H);
        (void)draw(b, b->renderers[RENDER_CPU], &view, VIEW_MESH, 0.5, 1);
        tried++;
        if (!b->known[k] && !(b->known[k] = malloc(n)))
            exit(1);
        for (size_t i = 0; i < n; i++)
            known += b->known[k][i] = rgba[4 * i + 3] == RASTER_ALPHA_SURFACE;
        if ((double)known < known_min * (double)n)
            continue;
        ray_trace(b, k);
        if (!b->truth_rgb[k])
            exit(1);
        keep(b, k);
        b->views++;
    }
    (void)fprintf(stderr,
                  "%d views of %d places tried see something known in %.0f %% of their "
                  "pixels\n",
                  b->views, tried, 100.0 * known_min);
}

/* ---- the table ---- */

static double squared_error(const struct bench *b, int k, int64_t *count) {
    double sum = 0.0;
    for (size_t i = 0; i < (size_t)W * H; i++) {
        if (!b->known[k][i])
            continue;
        for (size_t c = 0; c < 3; c++) {
            double d = (double)rgba[4 * i + c] - (double)b->truth_rgb[k][3 * i + c];
            sum += d * d;
        }
        *count += 3;
    }
    return sum;
}

struct row {
    double psnr_db, ms[RENDER_KINDS], samples;
};

/* All primitives of one view in turn, several times over, so that what disturbs the machine
 * disturbs all of them; the fastest of each counts. The portable picture is judged. */
static void measure_view(struct bench *b, int k, double error_px, struct row rows[PRIMITIVES],
                         double sums[PRIMITIVES], int64_t counts[PRIMITIVES]) {
    struct raster_view view = view_of(&b->poses[k], W, H);
    for (int r = 0; r < RENDER_KINDS; r++) {
        struct cost best[PRIMITIVES];
        int views = r && b->views > GL_VIEWS ? GL_VIEWS : b->views;
        if (!b->renderers[r] || k >= views)
            continue;
        for (int i = 0; i < (r ? 2 : REPEATS); i++)
            for (int p = 0; p < PRIMITIVES; p++) {
                struct cost cost =
                    draw(b, b->renderers[r], &view, (enum view_primitive)p, error_px, r ? 1 : 2);
                if (i == 0 || cost.ms < best[p].ms)
                    best[p] = cost;
                if (i == 0 && r == 0)
                    sums[p] += squared_error(b, k, &counts[p]);
            }
        for (int p = 0; p < PRIMITIVES; p++) {
            rows[p].ms[r] += best[p].ms / views;
            rows[p].samples += r ? 0.0 : (double)best[p].samples / b->views;
        }
    }
}

static void measure(struct bench *b, double error_px, struct row rows[PRIMITIVES]) {
    double sums[PRIMITIVES] = {0};
    int64_t counts[PRIMITIVES] = {0};
    memset(rows, 0, PRIMITIVES * sizeof *rows);
    for (int k = 0; k < b->views; k++)
        measure_view(b, k, error_px, rows, sums, counts);
    for (int p = 0; p < PRIMITIVES; p++)
        rows[p].psnr_db = 10.0 * log10(255.0 * 255.0 * (double)counts[p] / sums[p]);
}

/* Is no single primitive both faster and closer to the truth? Timings are known to 5 %, PSNR to
 * 0.05 dB. */
static bool on_front(const struct row *rows, int n, int which) {
    for (int i = 0; i < n; i++)
        if (i % PRIMITIVES != VIEW_AUTO && rows[i].ms[0] < 0.95 * rows[which].ms[0] &&
            rows[i].psnr_db > rows[which].psnr_db + 0.05)
            return false;
    return true;
}

static void table(struct bench *b) {
    struct row rows[PRIMITIVES * ERRORS];
    char name[64];
    bool front = true;
    (void)fprintf(stderr, "%-8s %6s %8s %10s %10s %10s %10s\n", "drawn as", "error", "PSNR",
                  "samples", "cpu", "gles30", "gles31");
    for (int e = 0; e < ERRORS; e++) {
        measure(b, errors_px[e], rows + (ptrdiff_t)e * PRIMITIVES);
        for (int p = 0; p < PRIMITIVES; p++) {
            struct row *row = &rows[e * PRIMITIVES + p];
            (void)fprintf(stderr, "%-8s %3.0f px %5.2f dB %8.0f k %7.2f ms %7.2f ms %7.2f ms\n",
                          primitive_names[p], errors_px[e], row->psnr_db, 1e-3 * row->samples,
                          row->ms[0], row->ms[1], row->ms[2]);
            (void)fprintf(b->table, "%s\t%g\t%.3f\t%.3f\t%.0f\n", primitive_names[p], errors_px[e],
                          row->psnr_db, row->ms[0], row->samples);
            (void)snprintf(name, sizeof name, "%s_%gpx_psnr", primitive_names[p], errors_px[e]);
            put(b, name, row->psnr_db, "dB");
            (void)snprintf(name, sizeof name, "%s_%gpx_cpu", primitive_names[p], errors_px[e]);
            put(b, name, row->ms[0], "ms");
            (void)snprintf(name, sizeof name, "%s_%gpx_samples", primitive_names[p], errors_px[e]);
            put(b, name, row->samples, "samples");
        }
    }
    for (int e = 0; e < ERRORS; e++)
        front = on_front(rows, PRIMITIVES * ERRORS, e * PRIMITIVES) && front;
    (void)fprintf(stderr, "automatic is %s the Pareto front\n", front ? "on" : "NOT on");
    put(b, "auto_on_pareto_front", front ? 1.0 : 0.0, "1");
}

/* ---- ratios at 1280 x 720 ---- */

static double sum_ms(struct bench *b, enum render_kind kind, enum view_primitive primitive,
                     double error_px) {
    double ms = 0.0;
    for (int k = 0; k < b->views && k < 6; k++) {
        struct raster_view view = view_of(&b->poses[k], WIDE_W, WIDE_H);
        ms += draw(b, b->renderers[kind], &view, primitive, error_px, kind ? 3 : 8).ms;
    }
    return ms;
}

static void ratios(struct bench *b) {
    static const double every_sample_px = 1e-9;
    char name[64];
    double automatic[RENDER_KINDS] = {0};
    for (int r = 0; r < RENDER_KINDS; r++) {
        const char *kind = render_kind_name((enum render_kind)r);
        if (!b->renderers[r])
            continue;
        double splats = sum_ms(b, (enum render_kind)r, VIEW_SPLATS, every_sample_px);
        double mesh = sum_ms(b, (enum render_kind)r, VIEW_MESH, every_sample_px);
        automatic[r] = sum_ms(b, (enum render_kind)r, VIEW_AUTO, 1.0);
        (void)fprintf(stderr,
                      "%s at %d x %d: splats take %.2f of two triangles a sample; automatic %.2f "
                      "of every sample as mesh\n",
                      kind, WIDE_W, WIDE_H, splats / mesh, automatic[r] / mesh);
        (void)snprintf(name, sizeof name, "%s_splats_to_mesh", kind);
        put(b, name, splats / mesh, "x");
        (void)snprintf(name, sizeof name, "%s_auto_to_every_sample", kind);
        put(b, name, automatic[r] / mesh, "x");
        (void)snprintf(name, sizeof name, "%s_to_portable", kind);
        put(b, name, automatic[r] / automatic[0], "x");
    }
    for (int r = 1; r < RENDER_KINDS; r++)
        if (b->renderers[r])
            (void)fprintf(stderr, "%s takes %.1f times as long as the portable path\n",
                          render_describe(b->renderers[r]), automatic[r] / automatic[0]);
}

/* ---- a large site ---- */

static enum st read_pack(const void *self, int64_t node, struct tile_samples *out,
                         struct errctx *err) {
    return tile_pack_read(self, node, out, err);
}

/* From its first stands: the automatic choice at one pixel against every sample in view. */
static void large(struct bench *b, const char *path) {
    struct errctx err = {0};
    struct tile_pack *pack = NULL;
    double automatic = 0.0, every = 0.0, samples[2] = {0, 0};
    must(tile_pack_open(path, &pack, &err), &err);
    struct tile_source source = {
        .index = tile_pack_get_index(pack), .read = read_pack, .self = pack};
    view_scene_destroy(b->scene);
    must(view_scene_create(&source, (size_t)1 << 30, &b->scene, &err), &err);
    for (int32_t i = 0; i < 4 && 7 * i < source.index->photo_count; i++) {
        const struct tile_pack_photo *photo = &source.index->photos[7 * i];
        struct pose pose = pose_compose(&photo->world_from_station, &photo->station_from_cam);
        struct raster_view view = view_of(&pose, WIDE_W, WIDE_H);
        struct cost a = draw(b, b->renderers[RENDER_CPU], &view, VIEW_AUTO, 1.0, 4);
        struct cost e = draw(b, b->renderers[RENDER_CPU], &view, VIEW_MESH, 1e-9, 2);
        automatic += a.ms;
        every += e.ms;
        samples[0] += 1e-6 * (double)a.samples;
        samples[1] += 1e-6 * (double)e.samples;
    }
    (void)fprintf(stderr,
                  "large site: automatic %.2f M samples in %.0f ms, every sample in view %.2f M in "
                  "%.0f ms: %.3f of the time (4 views together)\n",
                  samples[0], automatic, samples[1], every, automatic / every);
    put(b, "large_auto_to_every_sample", automatic / every, "x");
    put(b, "large_samples_auto_to_every", samples[0] / samples[1], "x");
    view_scene_destroy(b->scene);
    b->scene = NULL;
    tile_pack_close(pack);
}

/* ---- all of it ---- */

static void open_all(struct bench *b, const char *pack, const char *scene) {
    struct errctx err = {0};
    must(scene_create(scene, 1, 1.0, &b->truth, &err), &err);
    must(tile_pack_open(pack, &b->pack, &err), &err);
    struct tile_source source = {
        .index = tile_pack_get_index(b->pack), .read = read_pack, .self = b->pack};
    must(view_scene_create(&source, (size_t)1 << 30, &b->scene, &err), &err);
    for (int k = 0; k < RENDER_KINDS; k++)
        if (render_create((enum render_kind)k, NULL, &b->renderers[k], &err))
            (void)fprintf(stderr, "%s\n", err.text);
}

static void close_all(struct bench *b) {
    for (int k = 0; k < RENDER_KINDS; k++)
        render_destroy(b->renderers[k]);
    view_scene_destroy(b->scene);
    tile_pack_close(b->pack);
    scene_destroy(b->truth);
    for (int k = 0; k < VIEWS_MAX; k++) {
        free(b->truth_rgb[k]);
        free(b->known[k]);
    }
}

int main(int argc, char **argv) {
    static struct bench b;
    struct errctx err = {0};
    int views = argc > 3 ? atoi(argv[3]) : 20;
    if (argc < 5 || argc > 6 || views < 1 || views > VIEWS_MAX) {
        (void)fprintf(stderr, "usage: bench_viewer PACK SCENE VIEWS TABLE [LARGE]\n");
        return 2;
    }
    json_init_array(&b.json);
    b.table = fopen(argv[4], "w");
    if (!b.table) {
        perror(argv[4]);
        return 1;
    }
    open_all(&b, argv[1], argv[2]);
    make_views(&b, views);
    table(&b);
    ratios(&b);
    if (argc > 5)
        large(&b, argv[5]);
    must(json_write(&b.json, stdout, &err), &err);
    json_fini(&b.json);
    close_all(&b);
    return fclose(b.table) ? 1 : 0;
}
