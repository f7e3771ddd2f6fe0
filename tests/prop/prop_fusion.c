/* Photographs of a room that is known exactly: accuracy, honesty of the sigmas, silhouettes,
 * threads. */
#include "../support/analytic.h"
#include "../support/prop.h"
#include "base/hash.h"
#include "fusion/face.h"
#include "fusion/resolve.h"

#include <math.h>
#include <omp.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

enum { WIDTH = 320, HEIGHT = 240 };
static const double sigma_m = 0.004;

struct shot {
    struct scatter_sample *samples;
    size_t count;
    struct photo photo;
    struct layer_image image;
    struct resolve_counts counts;
    float *truth;
};

static struct analytic_scan scan_of(double spacing_rad, double spot_rad, uint64_t seed) {
    struct analytic_scan scan = analytic_scan_default();
    scan.elevation_step_rad = scan.azimuth_step_rad = spacing_rad;
    scan.azimuth_min_rad = -0.75, scan.azimuth_max_rad = 0.75;
    scan.elevation_min_rad = -0.65, scan.elevation_max_rad = 0.65;
    scan.spot_rad = spot_rad;
    scan.smear_rad = spot_rad > 0 ? spacing_rad : 0.0;
    scan.sigma_m = sigma_m;
    scan.seed = seed;
    return scan;
}

/* The samples of a scan; the last one is kept, since tests look at one scan in several ways. */
static struct scatter_sample *scanned(const struct analytic_scene *room,
                                      const struct analytic_scan *scan, size_t count) {
    static struct analytic_scan last;
    static struct scatter_sample *kept;
    if (!kept || memcmp(&last, scan, sizeof last) != 0) {
        free(kept);
        kept = malloc(count * sizeof *kept);
        analytic_scan_run(room, scan, kept);
        last = *scan;
    }
    struct scatter_sample *copy = malloc(count * sizeof *copy);
    memcpy(copy, kept, count * sizeof *copy);
    return copy;
}

static struct shot shoot(const struct analytic_scan *scan, double splat_px, int plain, int refuse) {
    struct analytic_scene room = analytic_room();
    struct camera camera = camera_pinhole(WIDTH, HEIGHT, 1.2);
    struct pose pose = face_station_from_cam(0);
    struct layer_params lp = layer_params_default();
    struct resolve_params rp = resolve_params_default();
    struct errctx err;
    struct shot s;
    memset(&s, 0, sizeof s);
    s.count = analytic_scan_count(scan);
    s.samples = scanned(&room, scan, s.count);
    s.truth = malloc(WIDTH * HEIGHT * sizeof *s.truth);
    analytic_truth(&room, scan->from_m, &camera, &pose, s.truth);
    lp.splat_px = splat_px;
    rp.beam_rad = scan->spot_rad + scan->smear_rad;
    rp.plain_mean = plain;
    rp.refuse_mixed = refuse;
    assert_int_equal(layer_create(&camera, &pose, &lp, &s.image, &err), ST_OK);
    assert_int_equal(layer_add(&s.image, s.samples, s.count), ST_OK);
    assert_int_equal(photo_create(&camera, &s.photo, &err), ST_OK);
    assert_int_equal(resolve_photo(&s.image, &rp, 1, &s.photo, &s.counts, &err), ST_OK);
    return s;
}

static void shot_free(struct shot *s) {
    layer_destroy(&s->image);
    photo_destroy(&s->photo);
    free(s->samples);
    free(s->truth);
}

/* True inside surfaces: the truth does not bend within three pixels. */
static bool inside(const float *truth, int x, int y) {
    if (x < 3 || y < 3 || x >= WIDTH - 3 || y >= HEIGHT - 3)
        return false;
    const float *t = truth + y * WIDTH + x;
    for (int k = 0; k < 4; k++) {
        int step = k == 0 ? 3 : k == 1 ? 3 * WIDTH : k == 2 ? 3 * WIDTH + 3 : 3 * WIDTH - 3;
        if (!(fabsf(t[step] + t[-step] - 2.0f * t[0]) < 2e-4f * t[0]))
            return false;
    }
    return true;
}

static void ranges_inside_surfaces_are_as_good_as_their_samples(void **state) {
    (void)state;
    uint64_t seed = prop_seed();
    struct analytic_scan scan = scan_of(1.0 / 380, 0.0, seed);
    struct shot s = shoot(&scan, 1.0, 0, 1);
    double error2 = 0, expected2 = 0;
    int64_t count = 0, within = 0;
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            size_t i = (size_t)(y * WIDTH + x);
            double d = (double)s.photo.disparity_per_m[i], t = (double)s.truth[i];
            if (isnan(d) || !inside(s.truth, x, y))
                continue;
            double ray = vec3_norm(camera_pinhole_ray(&s.photo.camera, x, y));
            const struct cluster_layer *layer = s.image.px[i].layers;
            double one = sigma_m * t * t / ray; /* of one sample, 1/m */
            double n = one * one / ((double)layer->var_sum / pow((double)layer->weight, 2));
            error2 += pow((d - t) / one, 2);
            expected2 += 1.0 / n;
            within += fabs(d - t) < photo_sigma_from_confidence(s.photo.confidence[i]);
            count++;
        }
    assert_true(count > WIDTH * HEIGHT / 2);
    double ratio = sqrt(error2 / expected2), share = (double)within / (double)count;
    print_message("rms %.2f of sigma / sqrt(n), sigma covers %.1f %%\n", ratio, 100 * share);
    assert_true(ratio < 1.2);
    assert_true(share > 0.60 && share < 0.76); /* 68 % if the sigmas are right */
    shot_free(&s);
}

static int64_t floating(const struct shot *s, const struct analytic_scan *scan) {
    struct analytic_scene room = analytic_room();
    int64_t n = 0;
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            double d = (double)s->photo.disparity_per_m[y * WIDTH + x];
            if (!(d > 0))
                continue;
            struct vec3 p = vec3_scale(camera_pinhole_ray(&s->photo.camera, x, y), 1.0 / d);
            p = vec3_add(pose_apply(&s->photo.station_from_cam, p), scan->from_m);
            n += analytic_distance(&room, p) > 5.0 * sigma_m;
        }
    return n;
}

static void silhouettes_do_not_float(void **state) {
    (void)state;
    uint64_t seed = prop_seed();
    struct analytic_scan scan = scan_of(1.0 / 380, 0.002, seed);
    struct shot plain = shoot(&scan, 1.0, 1, 0), clustered = shoot(&scan, 1.0, 0, 0);
    struct shot full = shoot(&scan, 1.0, 0, 1);
    int64_t a = floating(&plain, &scan), b = floating(&clustered, &scan),
            c = floating(&full, &scan);
    print_message("floating pixels of %lld: averaging %lld, clustering %lld, refusing %lld\n",
                  (long long)full.counts.valid, (long long)a, (long long)b, (long long)c);
    assert_true(b < a && c < b);
    /* Silhouettes are a larger part of a small picture: a thousandth here is 1 in 10 000 at 2 Mpx.
     */
    assert_true(c * 1000 < full.counts.valid);
    shot_free(&plain);
    shot_free(&clustered);
    shot_free(&full);
}

static uint32_t crc_of(const struct photo *p) {
    size_t n = WIDTH * HEIGHT;
    uint32_t crc = hash_crc32c(0, p->rgb, 3 * n);
    crc = hash_crc32c(crc, p->disparity_per_m, n * sizeof(float));
    return hash_crc32c(hash_crc32c(crc, p->flags, n), p->confidence, n);
}

static void same_bytes_for_any_number_of_threads(void **state) {
    (void)state;
    uint64_t seed = prop_seed();
    struct analytic_scan scan = scan_of(1.0 / 380, 0.002, seed);
    int before = omp_get_max_threads();
    uint32_t crc[3];
    for (int k = 0; k < 3; k++) {
        omp_set_num_threads(k == 2 ? 7 : k + 1);
        struct shot s = shoot(&scan, 1.5, 0, 1);
        crc[k] = crc_of(&s.photo);
        shot_free(&s);
    }
    omp_set_num_threads(before);
    assert_int_equal(crc[0], crc[1]);
    assert_int_equal(crc[0], crc[2]);
}

static void same_bytes_however_the_stream_is_cut(void **state) {
    (void)state;
    uint64_t seed = prop_seed();
    struct rng rng = rng_make(seed);
    struct analytic_scan scan = scan_of(1.0 / 200, 0.0, seed);
    struct shot whole = shoot(&scan, 1.0, 0, 1);
    struct camera camera = whole.photo.camera;
    struct pose pose = whole.photo.station_from_cam;
    struct layer_params lp = layer_params_default();
    struct resolve_params rp = resolve_params_default();
    struct layer_image image;
    struct photo photo;
    struct errctx err;
    assert_int_equal(layer_create(&camera, &pose, &lp, &image, &err), ST_OK);
    for (size_t at = 0; at < whole.count;) {
        size_t n = 1 + rng_below(&rng, 5000);
        n = n < whole.count - at ? n : whole.count - at;
        assert_int_equal(layer_add(&image, whole.samples + at, n), ST_OK);
        at += n;
    }
    assert_int_equal(photo_create(&camera, &photo, &err), ST_OK);
    assert_int_equal(resolve_photo(&image, &rp, 1, &photo, NULL, &err), ST_OK);
    assert_int_equal(crc_of(&photo), crc_of(&whole.photo));
    layer_destroy(&image);
    photo_destroy(&photo);
    shot_free(&whole);
}

/* A photograph taken from beside the head, as by a camera with a nodal offset or another station.
 */
static void a_camera_elsewhere_sees_the_same_room(void **state) {
    (void)state;
    uint64_t seed = prop_seed();
    struct analytic_scan scan = scan_of(1.0 / 380, 0.0, seed);
    struct shot s = shoot(&scan, 1.0, 0, 1);
    struct analytic_scene room = analytic_room();
    struct pose pose = face_station_from_cam(0);
    pose.t_m = vec3_make(-0.3, 0.2, 0.15);
    struct layer_params lp = layer_params_default();
    struct resolve_params rp = resolve_params_default();
    struct layer_image image;
    struct errctx err;
    assert_int_equal(layer_create(&s.photo.camera, &pose, &lp, &image, &err), ST_OK);
    assert_int_equal(layer_add(&image, s.samples, s.count), ST_OK);
    assert_int_equal(resolve_photo(&image, &rp, 1, &s.photo, NULL, &err), ST_OK);
    analytic_truth(&room, scan.from_m, &s.photo.camera, &pose, s.truth);
    int64_t good = 0, all = 0;
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            double d = (double)s.photo.disparity_per_m[y * WIDTH + x];
            double t = (double)s.truth[y * WIDTH + x];
            if (isnan(d) || !inside(s.truth, x, y))
                continue;
            all++;
            good += fabs(1.0 / d - 1.0 / t) < 5.0 * sigma_m;
        }
    assert_true(all > WIDTH * HEIGHT / 3);
    assert_true(good * 100 > all * 97); /* the rest: what the head saw and this camera cannot */
    layer_destroy(&image);
    shot_free(&s);
}

/* ---- 10 million samples in one tile ---- */

enum { CROWD = 10000000, CROWD_PX = 32 };
struct crowd {
    int64_t at;
    uint64_t seed;
};

static enum st crowd_rewind(void *context, struct errctx *err) {
    (void)err;
    ((struct crowd *)context)->at = 0;
    return ST_OK;
}

/* A wall at 3 m, never held in memory. */
static enum st crowd_next(void *context, struct scatter_sample *out_samples, size_t capacity,
                          size_t *out_count, struct errctx *err) {
    (void)err;
    struct crowd *crowd = context;
    size_t n = 0;
    struct rng rng = rng_stream(crowd->seed, (uint64_t)crowd->at);
    for (; n < capacity && crowd->at < CROWD; n++, crowd->at++) {
        double y = rng_range(&rng, -0.5, 0.5), z = rng_range(&rng, -0.5, 0.5);
        double noise = rng_range(&rng, -1.0, 1.0) * sqrt(3.0) * sigma_m; /* uniform, same sigma */
        double range = sqrt(9.0 + y * y + z * z), k = 1.0 + noise / range;
        out_samples[n] = (struct scatter_sample){
            .p_m = {(float)(3.0 * k), (float)(y * k), (float)(z * k)}, .sigma_m = (float)sigma_m};
    }
    *out_count = n;
    return ST_OK;
}

static void ten_million_samples_in_one_tile_average(void **state) {
    (void)state;
    struct crowd crowd = {.seed = prop_seed()};
    struct scatter_source source = {&crowd, crowd_rewind, crowd_next};
    struct camera camera = camera_pinhole(CROWD_PX, CROWD_PX, 0.3);
    struct pose pose = face_station_from_cam(0);
    struct layer_params lp = layer_params_default();
    struct resolve_params rp = resolve_params_default();
    struct layer_image image;
    struct photo photo;
    struct resolve_counts counts;
    struct errctx err;
    assert_int_equal(layer_create(&camera, &pose, &lp, &image, &err), ST_OK);
    assert_int_equal(layer_add_source(&image, &source, &err), ST_OK);
    assert_int_equal(photo_create(&camera, &photo, &err), ST_OK);
    assert_int_equal(resolve_photo(&image, &rp, 0, &photo, &counts, &err), ST_OK);
    assert_int_equal(counts.valid, CROWD_PX * CROWD_PX);
    for (int i = 0; i < CROWD_PX * CROWD_PX; i++) {
        /* 40 000 samples a pixel leave 0.02 mm of 4 mm; float sums of as many cost 0.2 mm at most
         */
        assert_true(fabsf(1.0f / photo.disparity_per_m[i] - 3.0f) < 3e-4f);
    }
    layer_destroy(&image);
    photo_destroy(&photo);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ranges_inside_surfaces_are_as_good_as_their_samples),
        cmocka_unit_test(silhouettes_do_not_float),
        cmocka_unit_test(same_bytes_for_any_number_of_threads),
        cmocka_unit_test(same_bytes_however_the_stream_is_cut),
        cmocka_unit_test(a_camera_elsewhere_sees_the_same_room),
        cmocka_unit_test(ten_million_samples_in_one_tile_average),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
