/* Measures 100 random distances on the tiles of a scan by the twin and compares with what the same
 * rays meet in the scene: how often does the 95 % interval hold the truth?
 * Usage: view_measure_twin PACK SCENE SEED; exit status 0 if 90 to 99 of 100 do. */
#include "base/rng.h"
#include "render/view_measure.h"
#include "render/view_pilot.h"
#include "render/view_scene.h"
#include "twin/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { W = 960, H = 540, PAIRS = 100, RIM = 8 };

static struct scene *scene;
static struct view_scene *tiles;
static const struct tile_pack_index *photos;

static void must(enum st st, const struct errctx *err) {
    if (!st)
        return;
    (void)fprintf(stderr, "view_measure_twin: %s\n", err->text);
    exit(1);
}

static enum st read_pack(const void *self, int64_t node, struct tile_samples *out,
                         struct errctx *err) {
    return tile_pack_read(self, node, out, err);
}

/* A view from beside a photograph's place, turned a little. */
static struct raster_view random_view(struct rng *rng) {
    const struct tile_pack_photo *p =
        &photos->photos[rng_below(rng, (uint32_t)photos->photo_count)];
    struct pose pose = pose_compose(&p->world_from_station, &p->station_from_cam);
    struct view_pilot pilot;
    memset(&pilot, 0, sizeof pilot);
    pilot.mode = VIEW_FLY;
    view_pilot_from_pose(&pilot, &pose);
    pilot.hfov_rad = 1.0;
    view_pilot_step(&pilot, 0.4 * rng_uniform(rng) - 0.2, 0.4 * rng_uniform(rng) - 0.2,
                    0.2 * rng_uniform(rng) - 0.1);
    view_pilot_turn(&pilot, 0.3 * rng_uniform(rng) - 0.15, 0.2 * rng_uniform(rng) - 0.1);
    return view_pilot_view(&pilot, W, H, 10.0);
}

/* What the pixel's ray really meets; false for nothing. */
static bool truth_at(const struct raster_view *view, double x, double y, struct vec3 *out_m) {
    struct vec3 d = vec3_make((x - view->cx_px) / view->fx, (y - view->cy_px) / view->fy, 1.0);
    struct trace_ray ray = {view->eye_m, vec3_unit(mat3_tmulv(&view->cam_from_world_r, d)), 0, 1e6};
    struct scene_truth truth;
    scene_truth_of(scene, &ray, &truth);
    *out_m = vec3_madd(ray.origin_m, ray.dir, truth.first.t_m);
    return truth.hit;
}

/* A random pixel that can be measured; false if the view shows next to nothing. */
static bool pick(const struct render_item *items, size_t count, const struct raster_view *view,
                 struct rng *rng, struct view_point *out_point, struct vec3 *out_truth_m) {
    struct errctx ignored;
    for (int i = 0; i < 50; i++) {
        double x = RIM + (W - 2 * RIM) * rng_uniform(rng);
        double y = RIM + (H - 2 * RIM) * rng_uniform(rng);
        if (!view_measure_pick(items, count, view, x, y, out_point, &ignored) &&
            !isnan(out_point->sigma_m) && truth_at(view, x, y, out_truth_m))
            return true;
    }
    return false;
}

static int measure(struct rng *rng) {
    struct errctx err = {0};
    struct view_quality quality = view_quality_default();
    int held = 0;
    double half = 0, z2 = 0;
    quality.load_s = 1.0;
    for (int i = 0, tried = 0; i < PAIRS && tried < 100 * PAIRS; tried++) {
        struct raster_view view = random_view(rng);
        const struct render_item *items;
        size_t count;
        struct view_scene_stats stats;
        do
            must(view_scene_select(tiles, &view, &quality, &items, &count, &stats, &err), &err);
        while (!stats.complete);
        struct vec3 ta, tb;
        struct view_point a, b;
        if (!pick(items, count, &view, rng, &a, &ta) || !pick(items, count, &view, rng, &b, &tb))
            continue;
        i++;
        struct view_value d = view_measure_distance_m(&a, &b);
        double error = d.value - vec3_norm(vec3_sub(ta, tb));
        held += fabs(error) <= view_measure_half95(d);
        half += view_measure_half95(d) / PAIRS;
        z2 += fmin(error * error / (d.sigma * d.sigma), 16.0) / PAIRS;
        if (getenv("VIEW_MEASURE_ALL"))
            (void)printf("%8.2f mm off, sigma %6.2f | a %6.2f mm off, sigma %6.2f, %d samples, "
                         "range %.2f | b %6.2f off, sigma %6.2f, %d samples\n",
                         1e3 * error, 1e3 * d.sigma, 1e3 * vec3_norm(vec3_sub(ta, a.p_m)),
                         1e3 * a.sigma_m, a.samples, a.range_m,
                         1e3 * vec3_norm(vec3_sub(tb, b.p_m)), 1e3 * b.sigma_m, b.samples);
    }
    (void)printf(
        "%d of %d intervals of 95 %% hold the truth; half their width %.2f mm in the mean; "
        "rms error %.2f sigma\n",
        held, PAIRS, 1e3 * half, sqrt(z2));
    return held;
}

int main(int argc, char **argv) {
    struct errctx err = {0};
    struct tile_pack *pack = NULL;
    if (argc != 4) {
        (void)fprintf(stderr, "usage: view_measure_twin PACK SCENE SEED\n");
        return 2;
    }
    must(scene_create(argv[2], 1, 1.0, &scene, &err), &err);
    must(tile_pack_open(argv[1], &pack, &err), &err);
    photos = tile_pack_get_index(pack);
    struct tile_source source = {.index = photos, .read = read_pack, .self = pack};
    must(view_scene_create(&source, (size_t)256 << 20, &tiles, &err), &err);
    struct rng rng = rng_make(strtoull(argv[3], NULL, 0));
    int held = measure(&rng);
    view_scene_destroy(tiles);
    tile_pack_close(pack);
    scene_destroy(scene);
    return held >= 90 && held <= 99 ? 0 : 1;
}
