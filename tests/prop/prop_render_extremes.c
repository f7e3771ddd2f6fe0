/* Where viewers break: the eye on a surface, inside a wall, far away, far from the origin, tiny and
 * huge fields of view, one pixel and 8K, one tile and none, a context lost. Every path draws, and
 * all draw the same. */
#include "tests/support/cmocka_all.h"
#include "tests/support/render_scenes.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 240, HEIGHT = 180, PIXELS = WIDTH * HEIGHT };
/* Twice the ordinary tolerance: seen from 10 km through a telescope, a float's last bits are tenths
 * of a pixel; at 179 degrees the largest points that a GL draws cut the largest splats. */
static const double share_max = 0.01;

static struct renderer *cpu, *gl;
static struct render_scene near_scene, far_scene; /* the latter 1e7 m from the origin */

static struct raster_view look(struct vec3 eye, struct vec3 at, double hfov_rad, int32_t w,
                               int32_t h) {
    struct pose pose;
    struct camera camera = camera_pinhole(w, h, hfov_rad);
    if (pose_look_at(eye, at, vec3_make(0, 0, 1), &pose))
        abort();
    struct raster_view view = raster_view_pinhole(&camera, &pose);
    view.near_m = 0.001;
    return view;
}

static size_t items_of(const struct render_scene *scene, enum render_primitive primitive,
                       struct render_item **out) {
    *out = malloc((scene->tile_count + 1) * sizeof **out);
    assert_non_null(*out);
    size_t n = render_items_of_inputs(scene->inputs, (size_t)scene->photo_count, primitive, *out);
    for (size_t i = 0; i < n; i++)
        (*out)[i].key |= (uint64_t)(scene == &far_scene) << 60;
    return n;
}

static void draw(struct renderer *r, const struct render_item *items, size_t count,
                 const struct raster_view *view, uint8_t *rgba) {
    struct errctx err = {0};
    struct raster_options options = raster_options_default();
    options.push_sigma = 2.0;
    struct render_frame frame = {items, count, view, &options};
    struct raster_target target = {
        .width_px = view->width_px, .height_px = view->height_px, .rgba = rgba};
    enum st st = render_draw(r, &frame, &target, NULL, &err);
    if (st)
        fail_msg("%s", err.text);
}

/* Draws with the path under test and without GL; returns the share that is covered. */
static double agree(const char *what, const struct render_scene *scene,
                    const struct raster_view *view) {
    static uint8_t a[4 * PIXELS], b[4 * PIXELS];
    double covered = 0;
    for (int p = RENDER_POINTS; p <= RENDER_MESH; p++) {
        struct render_item *items;
        size_t n = items_of(scene, (enum render_primitive)p, &items);
        draw(cpu, items, n, view, a);
        draw(gl, items, n, view, b);
        free(items);
        double share = render_scene_difference(a, b, PIXELS);
        size_t there = 0;
        for (size_t i = 0; i < PIXELS; i++)
            there += a[4 * i + 3] == RASTER_ALPHA_SURFACE;
        covered = (double)there / PIXELS;
        if (!(share < share_max))
            fail_msg("%s, primitive %d: %.3f %% differ", what, p, 100 * share);
    }
    (void)printf("%s %-24s %5.1f %% covered by the mesh\n", render_kind_name(render_kind_of(gl)),
                 what, 100 * covered);
    return covered;
}

static void eye_on_a_surface_and_inside_a_wall(void **state) {
    (void)state;
    struct raster_view view =
        look(vec3_make(0.5, 0.3, 0.0), vec3_make(2.0, 0.5, 0.4), 1.2, WIDTH, HEIGHT);
    assert_true(agree("on the floor", &near_scene, &view) > 0.1);
    view = look(vec3_make(4.0, 0.0, 1.5), vec3_make(0.0, 0.0, 1.4), 1.2, WIDTH, HEIGHT);
    (void)agree("on a wall", &near_scene, &view);
    view = look(vec3_make(4.3, 0.1, 1.5), vec3_make(0.0, 0.0, 1.4), 1.2, WIDTH, HEIGHT);
    (void)agree("behind a wall", &near_scene, &view);
    view =
        look(near_scene.inputs[0].tiles[0].origin_m, vec3_make(1.0, 0.2, 1.5), 1.2, WIDTH, HEIGHT);
    assert_true(agree("where the camera stood", &near_scene, &view) > 0.5);
}

static void eye_ten_kilometres_away(void **state) {
    (void)state;
    struct raster_view view =
        look(vec3_make(1e4, 0, 100), vec3_make(0, 0, 1.5), 1.2, WIDTH, HEIGHT);
    (void)agree("10 km away", &near_scene, &view);
    view = look(vec3_make(1e4, 0, 100), vec3_make(0, 0, 1.5), 0.0007, WIDTH, HEIGHT);
    assert_true(agree("10 km away, telescope", &near_scene, &view) > 0.3);
}

static void ten_million_metres_from_the_origin(void **state) {
    (void)state;
    struct vec3 o = far_scene.offset_m;
    struct raster_view view = look(vec3_add(o, vec3_make(-1.5, 0.1, 1.5)),
                                   vec3_add(o, vec3_make(2.0, 0.5, 1.3)), 1.2, WIDTH, HEIGHT);
    assert_true(fabs(o.x) >= 1e7);
    assert_true(agree("1e7 m offset", &far_scene, &view) > 0.5);
}

static void narrowest_and_widest_field_of_view(void **state) {
    (void)state;
    struct vec3 eye = {0.1, 0.1, 1.5}, at = {3.0, 0.4, 1.4};
    struct raster_view view = look(eye, at, 0.01745, WIDTH, HEIGHT);
    assert_true(agree("1 degree", &near_scene, &view) > 0.5);
    view = look(eye, at, 3.124, WIDTH, HEIGHT);
    (void)agree("179 degrees", &near_scene, &view);
}

static void one_tile_and_none(void **state) {
    (void)state;
    static uint8_t a[4 * PIXELS], b[4 * PIXELS];
    struct render_item *items;
    size_t n = items_of(&near_scene, RENDER_MESH, &items);
    struct raster_view view =
        look(near_scene.inputs[0].tiles[0].origin_m, vec3_make(1.0, 0.2, 1.5), 1.2, WIDTH, HEIGHT);
    assert_true(n > 40);
    for (size_t count = 0; count < 2; count++) {
        draw(cpu, items + 40, count, &view, a);
        draw(gl, items + 40, count, &view, b);
        assert_true(render_scene_difference(a, b, PIXELS) < share_max);
        if (!count)
            for (size_t i = 0; i < PIXELS; i++)
                assert_int_equal(a[4 * i + 3], RASTER_ALPHA_NOTHING);
    }
    free(items);
}

static void one_pixel_and_8k_and_back(void **state) {
    (void)state;
    static const int32_t sizes[][2] = {{1, 1}, {7680, 4320}, {3, 2000}, {1, 1}, {WIDTH, HEIGHT}};
    struct render_item *items;
    size_t n = items_of(&near_scene, RENDER_SPLATS, &items);
    uint8_t *rgba = malloc((size_t)4 * 7680 * 4320);
    assert_non_null(rgba);
    for (size_t k = 0; k < sizeof sizes / sizeof sizes[0]; k++) {
        int32_t w = sizes[k][0], h = sizes[k][1];
        struct raster_view view = look(vec3_make(0.1, 0.1, 1.5), vec3_make(3, 0.4, 1.4), 1.2, w, h);
        draw(cpu, items, n, &view, rgba);
        size_t middle = 4 * ((size_t)w * (size_t)(h / 2) + (size_t)(w / 2));
        int there = rgba[middle + 3];
        draw(gl, items, n, &view, rgba);
        assert_int_equal(rgba[middle + 3], there);
        assert_int_equal(there, RASTER_ALPHA_SURFACE);
    }
    free(rgba);
    free(items);
}

static void context_lost_between_frames(void **state) {
    (void)state;
    static uint8_t before[4 * PIXELS], after[4 * PIXELS];
    struct render_item *items;
    size_t n = items_of(&near_scene, RENDER_SPLATS, &items);
    struct raster_view view =
        look(vec3_make(0.1, 0.1, 1.5), vec3_make(3, 0.4, 1.4), 1.2, WIDTH, HEIGHT);
    draw(gl, items, n, &view, before);
    for (int i = 0; i < 2; i++) {
        render_lose_context(gl);
        draw(gl, items, n, &view, after);
        assert_memory_equal(before, after, sizeof before);
    }
    free(items);
}

int main(void) {
    static const struct CMUnitTest tests[] = {cmocka_unit_test(eye_on_a_surface_and_inside_a_wall),
                                              cmocka_unit_test(eye_ten_kilometres_away),
                                              cmocka_unit_test(ten_million_metres_from_the_origin),
                                              cmocka_unit_test(narrowest_and_widest_field_of_view),
                                              cmocka_unit_test(one_tile_and_none),
                                              cmocka_unit_test(one_pixel_and_8k_and_back),
                                              cmocka_unit_test(context_lost_between_frames)};
    struct errctx err = {0};
    int failed = 0;
    if (render_create(RENDER_CPU, NULL, &cpu, &err))
        return 1;
    render_scene_make(0, &near_scene);
    render_scene_make(2, &far_scene);
    for (int kind = RENDER_CPU; kind < RENDER_KINDS; kind++) {
        if (render_create((enum render_kind)kind, NULL, &gl, &err)) {
            (void)printf("SKIP: %s: %s\n", render_kind_name((enum render_kind)kind), err.text);
            continue;
        }
        failed += cmocka_run_group_tests_name(render_kind_name((enum render_kind)kind), tests, NULL,
                                              NULL);
        render_destroy(gl);
    }
    render_scene_fini(&near_scene);
    render_scene_fini(&far_scene);
    render_destroy(cpu);
    return failed;
}
