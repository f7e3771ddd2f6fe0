/* Skins, culling, levels of detail and packs on four stands in a room that is known exactly. */
#include "../support/analytic.h"
#include "../support/prop.h"
#include "../support/tempdir.h"
#include "base/fileio.h"
#include "base/hash.h"
#include "fusion/cull.h"
#include "fusion/face.h"
#include "fusion/pack.h"
#include "fusion/reproject.h"
#include "fusion/resolve.h"
#include "raster/skin.h"

#include <math.h>
#include <omp.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

enum { SIZE = 128, STANDS = 4, VIEWS = STANDS * 4 };
static const double sigma_m = 0.004;

struct site_of_stands {
    struct photo photos[VIEWS];
    struct reproject_view views[VIEWS];
    struct analytic_scene room;
};
static struct site_of_stands shared_site;

/* The four faces along the horizon of four stands. */
static void make_site(struct site_of_stands *s, struct vec3 world_offset_m) {
    static const double at[STANDS][3] = {
        {0, 0, 0}, {1.0, 2.2, 0.1}, {-0.5, -2.4, 0.05}, {0.2, 0.1, 0.02}};
    s->room = analytic_room();
    struct errctx err;
    for (int k = 0; k < STANDS; k++) {
        struct analytic_scan scan = analytic_scan_default();
        scan.from_m = vec3_make(at[k][0], at[k][1], at[k][2]);
        scan.elevation_step_rad = scan.azimuth_step_rad = 1.6 / SIZE;
        scan.seed = 10 + (uint64_t)k;
        size_t count = analytic_scan_count(&scan);
        struct scatter_sample *samples = malloc(count * sizeof *samples);
        analytic_scan_run(&s->room, &scan, samples);
        for (int face = 0; face < 4; face++) {
            struct camera camera = face_camera(SIZE);
            struct pose pose = face_station_from_cam(face);
            struct layer_params lp = layer_params_default();
            struct resolve_params rp = resolve_params_default();
            struct layer_image image;
            struct photo *photo = &s->photos[4 * k + face];
            lp.splat_px = 1.5;
            assert_int_equal(layer_create(&camera, &pose, &lp, &image, &err), ST_OK);
            assert_int_equal(layer_add(&image, samples, count), ST_OK);
            assert_int_equal(photo_create(&camera, photo, &err), ST_OK);
            assert_int_equal(resolve_photo(&image, &rp, 1, photo, NULL, &err), ST_OK);
            layer_destroy(&image);
            struct reproject_view *v = &s->views[4 * k + face];
            *v = (struct reproject_view){.photo = photo, .station = k, .pose_sigma_m = 1e-3};
            v->world_from_station = pose_identity();
            v->world_from_station.t_m = vec3_add(scan.from_m, world_offset_m);
        }
        free(samples);
    }
}

static void free_site(struct site_of_stands *s) {
    for (int i = 0; i < VIEWS; i++)
        photo_destroy(&s->photos[i]);
}

/* Largest distance of the cell's surface from any true one; NaN if it is no cell. */
static double off_surface(const struct site_of_stands *s, int view, size_t i, struct vec3 stand) {
    const struct photo *p = &s->photos[view];
    size_t corner[4] = {i, i + 1, i + SIZE, i + SIZE + 1};
    struct vec3 q[4];
    for (int k = 0; k < 4; k++) {
        double d = (double)p->disparity_per_m[corner[k]];
        if (!(d > 0))
            return (double)NAN;
        struct vec3 ray =
            camera_pinhole_ray(&p->camera, (double)(corner[k] % SIZE), (double)(corner[k] / SIZE));
        q[k] = vec3_add(pose_apply(&p->station_from_cam, vec3_scale(ray, 1.0 / d)), stand);
    }
    double worst = 0;
    for (int a = 0; a < 4; a++)
        for (int b = a + 1; b < 4; b++) {
            struct vec3 mid = vec3_scale(vec3_add(q[a], q[b]), 0.5);
            worst = fmax(worst, analytic_distance(&s->room, mid));
        }
    return worst;
}

struct score {
    int64_t skins, found, disproved, wrong, marked;
};

static struct score score_site(const struct site_of_stands *s, struct vec3 world_offset_m) {
    struct score score = {0};
    for (int v = 0; v < VIEWS; v++)
        for (size_t y = 0; y + 1 < SIZE; y++)
            for (size_t x = 0; x + 1 < SIZE; x++) {
                size_t i = y * SIZE + x;
                struct vec3 stand = vec3_sub(s->views[v].world_from_station.t_m, world_offset_m);
                double off = off_surface(s, v, i, stand);
                uint8_t f = s->photos[v].flags[i];
                bool skin = off > 0.06,
                     disproved = (f & PHOTO_SKIN_DISPROVED) == PHOTO_SKIN_DISPROVED;
                if (isnan(off))
                    continue;
                score.skins += skin;
                score.marked += (f & PHOTO_SKIN) != 0;
                score.found += skin && (f & PHOTO_SKIN);
                score.disproved += skin && disproved;
                score.wrong += off < 3 * sigma_m && disproved;
            }
    return score;
}

static void reproject(struct site_of_stands *s, struct reproject_counts *out) {
    struct reproject_params params = reproject_params_default();
    struct skin_params skins = skin_params_default();
    struct errctx err;
    for (int i = 0; i < VIEWS; i++)
        (void)skin_mark(&s->photos[i], &skins);
    assert_int_equal(reproject_skins(s->views, VIEWS, &params, NULL, out, &err), ST_OK);
}

static void reprojection_disproves_skins_and_no_surface(void **state) {
    (void)state;
    struct reproject_counts counts;
    reproject(&shared_site, &counts);
    struct score score = score_site(&shared_site, vec3_make(0, 0, 0));
    print_message("skins %lld: disproved %.1f %%, either %.1f %%, wrong %lld\n",
                  (long long)score.skins, 100.0 * (double)score.disproved / (double)score.skins,
                  100.0 * (double)score.found / (double)score.skins, (long long)score.wrong);
    assert_true(score.skins > 500);
    assert_int_equal(score.wrong, 0);
    assert_true(score.disproved * 10 > score.skins * 6);
    assert_true(score.found * 100 > score.skins * 95);
}

static void far_from_the_origin_nothing_changes(void **state) {
    (void)state;
    static struct site_of_stands far;
    struct vec3 offset = {1e7, -5e6, 300};
    struct reproject_counts here, there;
    make_site(&far, offset);
    reproject(&shared_site, &here);
    reproject(&far, &there);
    struct score score = score_site(&far, offset);
    assert_int_equal(score.wrong, 0);
    /* 1e7 m in a double is good to 2 nm: hardly a pixel decides otherwise */
    assert_true(llabs((long long)(here.disproved - there.disproved)) <= here.disproved / 200 + 1);
    free_site(&far);
}

static void duplicated_stations_disprove_nothing_more(void **state) {
    (void)state;
    struct reproject_view twice[VIEWS + 4];
    struct reproject_params params = reproject_params_default();
    struct reproject_counts counts, again;
    struct errctx err;
    struct photo copies[4];
    reproject(&shared_site, &counts);
    memcpy(twice, shared_site.views, sizeof shared_site.views);
    for (int i = 0; i < 4; i++) { /* stand 0 once more, as another station at the same place */
        assert_int_equal(photo_create(&shared_site.photos[i].camera, &copies[i], &err), ST_OK);
        copies[i].station_from_cam = shared_site.photos[i].station_from_cam;
        memcpy(copies[i].disparity_per_m, shared_site.photos[i].disparity_per_m,
               SIZE * SIZE * sizeof(float));
        memcpy(copies[i].confidence, shared_site.photos[i].confidence, SIZE * SIZE);
        twice[VIEWS + i] = shared_site.views[i];
        twice[VIEWS + i].photo = &copies[i];
        twice[VIEWS + i].station = 99;
    }
    assert_int_equal(reproject_skins(twice, VIEWS + 4, &params, NULL, &again, &err), ST_OK);
    struct score score = score_site(&shared_site, vec3_make(0, 0, 0));
    assert_int_equal(score.wrong, 0);
    for (int i = 0; i < 4; i++)
        photo_destroy(&copies[i]);
}

static void poses_that_are_only_guessed_prove_nothing(void **state) {
    (void)state;
    struct reproject_view views[VIEWS];
    struct reproject_params params = reproject_params_default();
    struct reproject_counts counts;
    struct errctx err;
    memcpy(views, shared_site.views, sizeof views);
    for (int i = 0; i < VIEWS; i++)
        views[i].pose_sigma_m = 0.2;
    assert_int_equal(reproject_skins(views, VIEWS, &params, NULL, &counts, &err), ST_OK);
    assert_int_equal(counts.disproved, 0);
    assert_true(counts.unsure > 0);
}

/* ---- culling ---- */

static void cull(const struct site_of_stands *s, double threshold, uint8_t masks[VIEWS][64],
                 struct cull_counts *out) {
    struct cull_view views[VIEWS];
    struct cull_params params = cull_params_default();
    struct errctx err;
    params.threshold = threshold;
    params.keep_frontier = 0;
    for (int i = 0; i < VIEWS; i++)
        views[i] = (struct cull_view){.photo = &s->photos[i],
                                      .world_from_station = s->views[i].world_from_station,
                                      .station = s->views[i].station,
                                      .pose_sigma_m = 1e-3,
                                      .culled = masks[i]};
    assert_true(photo_tile_count(SIZE, SIZE) <= 64);
    assert_int_equal(cull_tiles(views, VIEWS, &params, NULL, out, &err), ST_OK);
}

/* Every sample of a culled tile lies on a tile that stays: what was seen is still seen. */
static void every_culled_sample_is_kept_elsewhere(void **state) {
    (void)state;
    static uint8_t masks[VIEWS][64];
    struct cull_counts none, some;
    struct reproject_counts skins;
    reproject(&shared_site, &skins);
    cull(&shared_site, 0.0, masks, &none);
    assert_int_equal(none.culled, 0);
    cull(&shared_site, 2.0, masks, &some);
    print_message("culled %lld of %lld tiles\n", (long long)some.culled,
                  (long long)(some.tiles - some.empty));
    assert_true(some.culled * 20 > some.tiles - some.empty);
    int64_t lost = 0, checked = 0;
    int tiles_x = (SIZE + PHOTO_TILE_PX - 1) / PHOTO_TILE_PX;
    for (int a = 0; a < VIEWS; a++)
        for (int i = 0; i < SIZE * SIZE; i += 3) {
            int x = i % SIZE, y = i / SIZE;
            double d = (double)shared_site.photos[a].disparity_per_m[i];
            if (!masks[a][y / PHOTO_TILE_PX * tiles_x + x / PHOTO_TILE_PX] || !(d > 0))
                continue;
            const struct photo *p = &shared_site.photos[a];
            struct vec3 w = vec3_scale(camera_pinhole_ray(&p->camera, x, y), 1.0 / d);
            w = pose_apply(&p->station_from_cam, w);
            w = vec3_add(w, shared_site.views[a].world_from_station.t_m);
            bool seen = false;
            for (int b = 0; b < VIEWS && !seen; b++) {
                const struct photo *q = &shared_site.photos[b];
                struct pose inverse = pose_inverse(&q->station_from_cam);
                struct vec3 c = vec3_sub(w, shared_site.views[b].world_from_station.t_m);
                struct vec2 px;
                c = pose_apply(&inverse, c);
                if (camera_project(&q->camera, c, &px, NULL))
                    continue;
                int u = (int)floor(px.x + 0.5), v = (int)floor(px.y + 0.5);
                if (u < 0 || v < 0 || u >= SIZE || v >= SIZE ||
                    masks[b][v / PHOTO_TILE_PX * tiles_x + u / PHOTO_TILE_PX])
                    continue;
                double e = (double)q->disparity_per_m[v * SIZE + u];
                seen = e > 0 && fabs(1.0 / e - c.z) < 0.02 * c.z; /* a pixel of a 60 degree slope */
            }
            checked++;
            lost += !seen;
        }
    assert_true(checked > 1000);
    assert_true(lost * 200 < checked);
}

static void culling_does_not_depend_on_threads(void **state) {
    (void)state;
    static uint8_t one[VIEWS][64], many[VIEWS][64];
    struct cull_counts counts;
    int before = omp_get_max_threads();
    omp_set_num_threads(1);
    cull(&shared_site, 2.0, one, &counts);
    omp_set_num_threads(5);
    cull(&shared_site, 2.0, many, &counts);
    omp_set_num_threads(before);
    assert_memory_equal(one, many, sizeof one);
}

/* ---- levels of detail, packs ---- */

static void coarse_levels_keep_to_surfaces(void **state) {
    (void)state;
    struct lod_params params = lod_params_default();
    struct errctx err;
    int64_t floating = 0, all = 0;
    for (int v = 0; v < 4; v++) {
        struct photo coarse, coarser;
        assert_int_equal(lod_half(&shared_site.photos[v], &params, &coarse, &err), ST_OK);
        assert_int_equal(lod_half(&coarse, &params, &coarser, &err), ST_OK);
        for (int k = 0; k < 2; k++) {
            const struct photo *p = k ? &coarser : &coarse;
            for (int i = 0; i < p->camera.width_px * p->camera.height_px; i++) {
                double d = (double)p->disparity_per_m[i];
                if (!(d > 0))
                    continue;
                struct vec3 ray = camera_pinhole_ray(&p->camera, i % p->camera.width_px,
                                                     (double)(i / p->camera.width_px));
                struct vec3 q = pose_apply(&p->station_from_cam, vec3_scale(ray, 1.0 / d));
                all++;
                floating += analytic_distance(&shared_site.room, q) > 0.05;
            }
        }
        photo_destroy(&coarse);
        photo_destroy(&coarser);
    }
    print_message("coarse pixels 5 cm off: %lld of %lld\n", (long long)floating, (long long)all);
    assert_true(floating * 200 < all);
}

static uint32_t pack_to(const char *path, struct pack_stats *stats) {
    struct tile_pack_photo entries[VIEWS];
    struct tile_pack_writer *writer = NULL;
    struct pack_params params = pack_params_default();
    struct errctx err;
    params.noise_share = 0.0; /* exactly as asked */
    memset(entries, 0, sizeof entries);
    memset(stats, 0, sizeof *stats);
    for (int i = 0; i < VIEWS; i++) {
        (void)snprintf(entries[i].name, sizeof entries[i].name, "view %d", i);
        entries[i].camera = shared_site.photos[i].camera;
        entries[i].station_from_cam = shared_site.photos[i].station_from_cam;
        entries[i].world_from_station = shared_site.views[i].world_from_station;
    }
    assert_int_equal(tile_pack_create(path, entries, VIEWS, 0.001, 6.0, &writer, &err), ST_OK);
    for (int i = 0; i < VIEWS; i++) {
        struct pack_stats one;
        assert_int_equal(
            pack_photo(writer, &entries[i], &shared_site.photos[i], NULL, &params, &one, &err),
            ST_OK);
        pack_stats_add(stats, &one);
    }
    assert_int_equal(tile_pack_commit(writer, NULL, &err), ST_OK);
    uint8_t *bytes = NULL;
    size_t size = 0;
    assert_int_equal(fileio_read(path, 1 << 26, &bytes, &size, &err), ST_OK);
    uint32_t crc = hash_crc32c(0, bytes, size);
    free(bytes);
    return crc;
}

static void packed_tiles_err_no_more_than_asked(void **state) {
    (void)state;
    char dir[TEMPDIR_MAX], path[TEMPDIR_MAX + 16];
    struct pack_stats stats;
    struct errctx err;
    assert_true(tempdir_make(dir));
    (void)snprintf(path, sizeof path, "%s/x.tiles", dir);
    int before = omp_get_max_threads();
    omp_set_num_threads(1);
    uint32_t one = pack_to(path, &stats);
    omp_set_num_threads(3);
    assert_int_equal(one, pack_to(path, &stats));
    omp_set_num_threads(before);
    assert_true(stats.planes > 0 && stats.sampled > 0);
    struct tile_pack *pack = NULL;
    assert_int_equal(tile_pack_open(path, &pack, &err), ST_OK);
    const struct tile_pack_index *x = tile_pack_get_index(pack);
    for (int v = 0; v < VIEWS; v++) {
        int32_t tx, ty;
        tile_pack_tiles(&x->photos[v].camera, 0, &tx, &ty);
        for (int32_t t = 0; t < tx * ty; t++) {
            static struct tile_samples s;
            const struct tile_pack_node *n = &x->nodes[x->photos[v].first_node[0] + t];
            if (n->kind != TILE_PACK_SAMPLED)
                continue;
            assert_int_equal(tile_pack_read(pack, x->photos[v].first_node[0] + t, &s, &err), ST_OK);
            for (int32_t i = 0; i < s.width * s.height; i++) {
                int32_t px = t % tx * 32 + i % s.width, py = t / tx * 32 + i / s.width;
                float want = shared_site.photos[v].disparity_per_m[py * SIZE + px];
                float got = s.disparity_per_m[i];
                assert_int_equal(isnan(want), isnan(got));
                if (isnan(want) || want == 0.0f)
                    continue;
                double off_m = fabs(1.0 / (double)got - 1.0 / (double)want);
                assert_true(off_m < 0.001 * fmax(1.0, 1.0 / (6.0 * (double)want)) * 1.01);
            }
        }
    }
    tile_pack_close(pack);
    tempdir_remove(dir);
}

static int set_up(void **state) {
    (void)state;
    make_site(&shared_site, vec3_make(0, 0, 0));
    return 0;
}
static int tear_down(void **state) {
    (void)state;
    free_site(&shared_site);
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(reprojection_disproves_skins_and_no_surface),
        cmocka_unit_test(far_from_the_origin_nothing_changes),
        cmocka_unit_test(duplicated_stations_disprove_nothing_more),
        cmocka_unit_test(poses_that_are_only_guessed_prove_nothing),
        cmocka_unit_test(every_culled_sample_is_kept_elsewhere),
        cmocka_unit_test(culling_does_not_depend_on_threads),
        cmocka_unit_test(coarse_levels_keep_to_surfaces),
        cmocka_unit_test(packed_tiles_err_no_more_than_asked),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
