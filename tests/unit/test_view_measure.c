/* Measuring on screen against a room whose truth is known, and renderers that lose their context.
 */
#include "base/rng.h"
#include "raster/skin.h"
#include "render/view_measure.h"
#include "render/view_pilot.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/prop.h"
#include "tests/support/render_scenes.h"
#include "tests/support/room.h"

#include <math.h>

enum { W = 320, H = 240, PAIRS = 100 };

struct stand {
    struct photo noisy, exact;
    struct tile tiles[128];
    struct render_item items[128];
    size_t count;
    struct raster_view view;
};

/* The view is the photograph's own: the exact photograph gives the truth at every pixel. */
static void stand_make(struct stand *s, uint64_t seed) {
    struct camera camera = camera_pinhole(W, H, 1.4);
    struct vec3 origin = {0, 0, 0};
    struct pose pose = room_pose(-2.0, 0.5, 0.2, origin);
    struct skin_params skins = skin_params_default();
    s->noisy = room_photo(&camera, &pose, origin, 0.003, seed);
    s->exact = room_photo(&camera, &pose, origin, 0.0, seed);
    (void)skin_mark(&s->noisy, &skins);
    photo_tiles(&s->noisy, NULL, s->tiles);
    struct raster_input input = {.tiles = s->tiles, .tile_count = photo_tile_count(W, H)};
    s->count = render_items_of_inputs(&input, 1, RENDER_MESH, s->items);
    s->view = raster_view_pinhole(&camera, &pose);
}

static void stand_fini(struct stand *s) {
    photo_destroy(&s->noisy);
    photo_destroy(&s->exact);
}

/* A random pixel that can be measured, and its true point. */
static struct view_point pick(const struct stand *s, struct rng *rng, struct vec3 *out_truth_m) {
    struct view_point point;
    struct errctx err = {0};
    for (int i = 0; i < 1000; i++) {
        int32_t x = 4 + (int32_t)rng_below(rng, W - 8), y = 4 + (int32_t)rng_below(rng, H - 8);
        double truth = (double)s->exact.disparity_per_m[y * W + x];
        if (view_measure_pick(s->items, s->count, &s->view, x, y, &point, &err) ||
            isnan(point.sigma_m) || !(truth > 0.0))
            continue;
        *out_truth_m = view_pilot_point(&s->view, x, y, truth);
        return point;
    }
    fail_msg("no pixel can be measured");
    return point;
}

static void interval_of_95_percent_holds_the_truth_in_90_or_more_of_100(void **state) {
    (void)state;
    static struct stand s;
    struct rng rng = rng_make(prop_seed());
    stand_make(&s, rng_u64(&rng));
    int held = 0;
    double half_sum = 0;
    for (int i = 0; i < PAIRS; i++) {
        struct vec3 ta, tb;
        struct view_point a = pick(&s, &rng, &ta), b = pick(&s, &rng, &tb);
        struct view_value d = view_measure_distance_m(&a, &b);
        held += fabs(d.value - vec3_norm(vec3_sub(ta, tb))) <= view_measure_half95(d);
        half_sum += view_measure_half95(d);
    }
    (void)printf("%d of %d intervals hold the truth; mean half width %.2f mm\n", held, PAIRS,
                 1e3 * half_sum / PAIRS);
    stand_fini(&s);
    assert_in_range(held, 90, 100);
}

static void sky_and_nothing_are_refused(void **state) {
    (void)state;
    static struct stand s;
    struct view_point point;
    struct errctx err = {0};
    stand_make(&s, 1);
    assert_int_equal(view_measure_pick(s.items, 0, &s.view, 10, 10, &point, &err), ST_NOT_FOUND);
    assert_true(err.text[0] != '\0');
    stand_fini(&s);
}

static void right_angle_is_measured(void **state) {
    (void)state;
    struct view_point p[3] = {{.p_m = {1, 0, 0}, .along = {0, 1, 0}, .sigma_m = 0.01},
                              {.p_m = {0, 0, 0}, .along = {0, 0, 1}, .sigma_m = 0.01},
                              {.p_m = {0, 2, 0}, .along = {0, 1, 0}, .sigma_m = 0.01}};
    struct view_value angle = view_measure_angle_rad(&p[0], &p[1], &p[2]);
    assert_float_equal(angle.value, 1.5707963, 1e-6);
    assert_float_equal(angle.sigma, 0.01, 1e-5);
}

static void lost_context_is_restored(void **state) {
    (void)state;
    static struct stand s;
    static uint8_t before[4 * W * H], after[4 * W * H];
    struct errctx err = {0};
    struct renderer *r = NULL;
    if (render_create(RENDER_GLES30, NULL, &r, &err)) {
        (void)printf("SKIP: %s\n", err.text);
        skip();
    }
    stand_make(&s, 2);
    struct raster_options options = raster_options_default();
    struct render_frame frame = {s.items, s.count, &s.view, &options};
    struct raster_target target = {.width_px = W, .height_px = H, .rgba = before};
    assert_int_equal(render_draw(r, &frame, &target, NULL, &err), ST_OK);
    render_lose_context(r);
    target.rgba = after;
    assert_int_equal(render_draw(r, &frame, &target, NULL, &err), ST_OK);
    assert_memory_equal(before, after, sizeof before);
    render_destroy(r);
    stand_fini(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(interval_of_95_percent_holds_the_truth_in_90_or_more_of_100),
        cmocka_unit_test(sky_and_nothing_are_refused),
        cmocka_unit_test(right_angle_is_measured),
        cmocka_unit_test(lost_context_is_restored),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
