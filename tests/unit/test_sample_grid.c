/* Scans as grids: what is drawn between samples, what is not, and what no surface means. */
#include "base/panorama.h"
#include "base/photo.h"
#include "base/sample_grid.h"
#include "tests/support/cmocka_all.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;

enum { ROWS = 31, COLUMNS = 41, N = ROWS * COLUMNS, SIDE = 64 };

/* One row per elevation; one degree apart; column 0 is at the left. */
static struct polar_sample sample_at(int row, int column) {
    struct polar_sample s;
    memset(&s, 0, sizeof s);
    s.azimuth_rad = (20 - column) * pi / 180.0;
    s.elevation_rad = (15 - row) * pi / 180.0;
    s.row = (uint32_t)row;
    s.column = (uint32_t)column;
    return s;
}

static void fill(struct polar_sample *samples, double (*range)(struct vec3 dir)) {
    for (int i = 0; i < N; i++) {
        samples[i] = sample_at(i / COLUMNS, i % COLUMNS);
        samples[i].range_m = (float)range(sample_direction(samples + i));
        if (isnan(samples[i].range_m))
            samples[i].flags = SAMPLE_NO_RETURN;
    }
}

/* A pinhole along +x, level, a little wider than the samples. */
static struct sample_view pinhole(void) {
    struct sample_view view = {.kind = SAMPLE_VIEW_PINHOLE, .width_px = SIDE, .height_px = SIDE};
    view.camera = camera_pinhole(SIDE, SIDE, 45.0 * pi / 180.0);
    view.station_from_cam = (struct mat3){{0, 0, 1, -1, 0, 0, 0, -1, 0}};
    return view;
}

struct planes {
    float inverse[SIDE * SIDE];
    uint8_t flags[SIDE * SIDE];
    int32_t sample[SIDE * SIDE];
};

static void draw(const struct polar_sample *samples, const struct sample_view *view,
                 struct planes *out) {
    struct sample_grid grid;
    struct errctx err = {0};
    struct sample_picture picture = {out->inverse, out->flags, out->sample};
    const struct sample_draw_options options = {.range_sigma_m = 1e-4,
                                                .slope_limit_rad = 60.0 * pi / 180.0};
    assert_int_equal(sample_grid_create(samples, N, &grid, &err), ST_OK);
    if (sample_grid_draw(&grid, view, &options, &picture, &err))
        fail_msg("%s", err.text);
    sample_grid_destroy(&grid);
}

/* n . p = 3 with a slanted n */
static double slanted(struct vec3 d) {
    return 3.0 / (0.9 * d.x + 0.35 * d.y - 0.25 * d.z);
}
static double two_walls(struct vec3 d) {
    return (d.y > 0.05 ? 2.0 : 5.0) / d.x;
}
static double open_sky(struct vec3 d) {
    return d.z > 0.02 ? (double)NAN : 4.0 / d.x;
}

static void a_plane_stays_a_plane(void **state) {
    (void)state;
    static struct polar_sample samples[N];
    static struct planes out;
    const struct sample_view view = pinhole();
    fill(samples, slanted);
    draw(samples, &view, &out);
    int drawn = 0, own = 0, border = 0;
    for (int i = 0; i < SIDE * SIDE; i++) {
        if (isnan(out.inverse[i])) {
            assert_true(out.flags[i] == 0 && out.sample[i] == -1); /* nobody looked */
            continue;
        }
        const struct vec3 ray = camera_pinhole_ray(&view.camera, i % SIDE, i / SIDE);
        const struct vec3 p = mat3_mulv(&view.station_from_cam, ray);
        const double truth = (0.9 * p.x + 0.35 * p.y - 0.25 * p.z) / 3.0;
        /* at the border a pixel may hold a sample that no cell covers: off by its slope */
        const double error = fabs((double)out.inverse[i] - truth);
        border += error > 1e-6;
        assert_true(error < (out.flags[i] & PHOTO_FILLED ? 1e-6 : 0.01 * truth));
        assert_false(out.flags[i] & PHOTO_SILHOUETTE);
        drawn++;
        own += !(out.flags[i] & PHOTO_FILLED);
    }
    assert_in_range(border, 0, 2 * (ROWS + COLUMNS));
    assert_in_range(drawn, SIDE * SIDE / 2, SIDE * SIDE);
    assert_in_range(own, N * 9 / 10,
                    N); /* samples fall on pixels of their own, here and there two */
}

static void nothing_is_drawn_between_two_surfaces(void **state) {
    (void)state;
    static struct polar_sample samples[N];
    static struct planes out;
    const struct sample_view view = pinhole();
    fill(samples, two_walls);
    draw(samples, &view, &out);
    int edges = 0;
    for (int i = 0; i < SIDE * SIDE; i++) {
        if (isnan(out.inverse[i]))
            continue;
        const double z = 1.0 / (double)out.inverse[i];
        assert_true(fabs(z - 2.0) < 1e-3 || fabs(z - 5.0) < 1e-3);
        edges += (out.flags[i] & PHOTO_SILHOUETTE) != 0;
    }
    assert_in_range(edges, SIDE / 2, 4 * SIDE);
}

static void no_return_is_not_dropped_is_not_unseen(void **state) {
    (void)state;
    static struct polar_sample samples[N];
    static struct planes out;
    const struct sample_view view = pinhole();
    fill(samples, open_sky);
    for (int row = 25; row < ROWS; row++)
        for (int column = 0; column < 20; column++) {
            samples[row * COLUMNS + column].flags = SAMPLE_DROPPED;
            samples[row * COLUMNS + column].range_m = NAN;
        }
    draw(samples, &view, &out);
    int counts[4] = {0, 0, 0, 0};
    for (int i = 0; i < SIDE * SIDE; i++) {
        const bool surface = !isnan(out.inverse[i]);
        const int kind = surface                           ? 0
                         : out.flags[i] == PHOTO_NO_RETURN ? 1
                         : out.flags[i] == PHOTO_DROPPED   ? 2
                                                           : 3;
        const struct vec3 ray =
            mat3_mulv(&view.station_from_cam, camera_pinhole_ray(&view.camera, i % SIDE, i / SIDE));
        const double elevation = atan2(ray.z, hypot(ray.x, ray.y)) * 180.0 / pi;
        counts[kind]++;
        if (kind == 0)
            assert_true(elevation < 2.0);
        if (kind == 1)
            assert_true(elevation > 0.5);
        if (kind == 2)
            assert_true(elevation < -9.0 && ray.y > -0.02 * ray.x);
        if (kind == 3)
            assert_true(out.flags[i] == 0 &&
                        (fabs(elevation) > 14.4 || fabs(ray.y / ray.x) > 0.35));
    }
    for (int k = 0; k < 4; k++)
        assert_true(counts[k] > 50);
}

static void of_two_surfaces_the_nearer_is_kept(void **state) {
    (void)state;
    static struct polar_sample samples[N];
    static struct planes out;
    const struct sample_view view = pinhole();
    fill(samples, slanted);
    /* a second look at the same directions: rows folded back, nearer */
    for (int row = 16; row < ROWS; row++)
        for (int column = 0; column < COLUMNS; column++) {
            struct polar_sample *s = samples + row * COLUMNS + column;
            s->elevation_rad = samples[(30 - row) * COLUMNS + column].elevation_rad;
            s->range_m = (float)(0.5 * slanted(sample_direction(s)));
        }
    draw(samples, &view, &out);
    for (int v = 14; v < 28; v++) {
        const int i = v * SIDE + 32;
        const struct vec3 p =
            mat3_mulv(&view.station_from_cam, camera_pinhole_ray(&view.camera, 32, v));
        const double truth = 2.0 * (0.9 * p.x + 0.35 * p.y - 0.25 * p.z) / 3.0;
        assert_true(fabs((double)out.inverse[i] - truth) < 1e-5);
    }
}

static void a_panorama_closes_around_its_seam(void **state) {
    (void)state;
    enum { TURN = 180, LINES = 10 };
    static struct polar_sample samples[(TURN + 1) * LINES];
    for (int i = 0; i < (TURN + 1) * LINES; i++) {
        samples[i] = sample_at(i / (TURN + 1), i % (TURN + 1));
        double azimuth = pi - 2.0 * pi * (samples[i].column + 0.4) / TURN;
        samples[i].azimuth_rad = azimuth < -pi ? azimuth + 2.0 * pi : azimuth;
        samples[i].elevation_rad = (5 - (int)samples[i].row) * pi / 90.0;
        samples[i].range_m = 3.0f;
    }
    struct image_u8 image;
    struct panorama_info info;
    const struct panorama_options options = {.style = SAMPLE_SHADE_RANGE, .width_px = 360};
    assert_int_equal(panorama_render(samples, (TURN + 1) * LINES, &options, &image, &info, NULL),
                     ST_OK);
    assert_true(fabs(info.left_rad - info.right_rad - 2.0 * pi) < 1e-9);
    for (int32_t v = 2; v < image.height_px - 2; v++)
        for (int32_t u = 0; u < image.width_px; u++)
            assert_memory_not_equal(image_u8_at(&image, u, v), sample_shade_unseen_rgb, 3);
    image_u8_destroy(&image);
}

static void a_legend_is_below_the_scene(void **state) {
    (void)state;
    static struct polar_sample samples[N];
    fill(samples, slanted);
    struct image_u8 plain, with;
    struct panorama_options options = {.style = SAMPLE_SHADE_RANGE, .width_px = 400};
    assert_int_equal(panorama_render(samples, N, &options, &plain, NULL, NULL), ST_OK);
    options.legend = true;
    assert_int_equal(panorama_render(samples, N, &options, &with, NULL, NULL), ST_OK);
    assert_true(with.height_px > plain.height_px && with.width_px == plain.width_px);
    assert_memory_equal(with.px, plain.px, (size_t)plain.height_px * plain.stride_bytes);
    image_u8_destroy(&plain);
    image_u8_destroy(&with);
}

static void refuses_grids_that_are_no_grids(void **state) {
    (void)state;
    struct polar_sample two[2] = {sample_at(0, 0), sample_at(0, 0)};
    struct sample_grid grid = {0};
    struct errctx err = {0};
    two[1].row = 2000000000u;
    two[1].column = 2000000000u;
    assert_int_equal(sample_grid_create(two, 2, &grid, &err), ST_NOMEM);
    two[1] = sample_at(0, 1);
    two[1].azimuth_rad = NAN;
    assert_int_equal(sample_grid_create(two, 2, &grid, &err), ST_INVALID);
    struct image_u8 image;
    const struct panorama_options options = {.legend = true};
    assert_int_equal(panorama_render(two, 0, &options, &image, NULL, &err), ST_INVALID);
    assert_int_equal(panorama_render(two, 1, &options, &image, NULL, &err), ST_OK); /* one sample */
    image_u8_destroy(&image);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_plane_stays_a_plane),
        cmocka_unit_test(nothing_is_drawn_between_two_surfaces),
        cmocka_unit_test(no_return_is_not_dropped_is_not_unseen),
        cmocka_unit_test(of_two_surfaces_the_nearer_is_kept),
        cmocka_unit_test(a_panorama_closes_around_its_seam),
        cmocka_unit_test(a_legend_is_below_the_scene),
        cmocka_unit_test(refuses_grids_that_are_no_grids),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
