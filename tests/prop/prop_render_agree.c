/* All renderers draw the same picture: 20 views of three scenes, each primitive. */
#include "tests/support/cmocka_all.h"
#include "tests/support/render_scenes.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 320, HEIGHT = 240, PIXELS = WIDTH * HEIGHT, VIEWS = 20 };

/* Tolerance of the project: more than 2/255 apart in fewer than 0.5 % of the pixels. */
static const double share_max = 0.005;

static struct renderer *cpu, *gl;
static struct render_scene scenes[RENDER_SCENES];
static uint8_t a[4 * PIXELS], b[4 * PIXELS];
static float depth_a[PIXELS], depth_b[PIXELS];

static void draw(struct renderer *r, const struct render_frame *frame, uint8_t *rgba,
                 float *depth) {
    struct errctx err = {0};
    struct raster_target target = {
        .width_px = WIDTH, .height_px = HEIGHT, .rgba = rgba, .depth = depth};
    if (render_draw(r, frame, &target, NULL, &err))
        fail_msg("%s", err.text);
}

struct how {
    enum render_primitive primitive;
    enum raster_skins skins;
    double push_sigma;
    bool parallel, nearest, front;
    int views; /* 0: all */
};

static struct raster_view view_of(const struct render_scene *scene, int k, const struct how *how) {
    struct raster_view view = render_scene_view(scene, k, WIDTH, HEIGHT, k % 2 ? 1.0 : 1.6);
    if (how->parallel) {
        struct pose pose = {mat3_transpose(&view.cam_from_world_r), view.eye_m};
        view = raster_view_orthographic(WIDTH, HEIGHT, 60.0, 0.1, 20.0, &pose);
    }
    return view;
}

static void compare(const struct how *how, const char *what) {
    int views = how->views ? how->views : VIEWS;
    double worst = 0, sum = 0, depth_worst = 0;
    for (int s = 0; s < RENDER_SCENES; s++) {
        const struct render_scene *scene = &scenes[s];
        struct render_item *items = malloc(scene->tile_count * sizeof *items);
        assert_non_null(items);
        size_t n = render_items_of_inputs(scene->inputs, (size_t)scene->photo_count, how->primitive,
                                          items);
        for (size_t i = 0; i < n; i++)
            items[i].key |= (uint64_t)s << 60;
        struct raster_options options = raster_options_default();
        options.skins = how->skins;
        options.push_sigma = how->push_sigma;
        options.filter = how->nearest ? RASTER_FILTER_NEAREST : RASTER_FILTER_LINEAR;
        options.faces = how->front ? RASTER_FACES_FRONT : RASTER_FACES_BOTH;
        for (int k = s; k < views; k += RENDER_SCENES) {
            struct raster_view view = view_of(scene, k, how);
            struct render_frame frame = {items, n, &view, &options};
            draw(cpu, &frame, a, depth_a);
            draw(gl, &frame, b, depth_b);
            double share = render_scene_difference(a, b, PIXELS);
            size_t far_apart = 0;
            for (size_t i = 0; i < PIXELS; i++)
                far_apart += fabsf(depth_a[i] - depth_b[i]) > 1e-3f * depth_a[i];
            depth_worst = fmax(depth_worst, (double)far_apart / PIXELS);
            worst = share > worst ? share : worst;
            sum += share / views;
        }
        free(items);
    }
    (void)printf("%s %-28s mean %.4f %%, worst %.4f %%, depths %.4f %%\n",
                 render_kind_name(render_kind_of(gl)), what, 100 * sum, 100 * worst,
                 100 * depth_worst);
    assert_true(worst < share_max);
    assert_true(depth_worst < share_max);
}

static void points_agree(void **state) {
    (void)state;
    compare(&(struct how){.primitive = RENDER_POINTS}, "points");
}
static void splats_agree(void **state) {
    (void)state;
    compare(&(struct how){.primitive = RENDER_SPLATS}, "splats");
    compare(&(struct how){.primitive = RENDER_SPLATS, .parallel = true, .views = 3},
            "splats, parallel");
    compare(&(struct how){.primitive = RENDER_SPLATS, .push_sigma = 2.0, .views = 3},
            "splats, pushed");
}
static void meshes_agree(void **state) {
    (void)state;
    compare(&(struct how){.primitive = RENDER_MESH}, "mesh");
    compare(&(struct how){.primitive = RENDER_MESH, .parallel = true, .views = 3},
            "mesh, parallel");
    compare(&(struct how){.primitive = RENDER_MESH, .push_sigma = 2.0, .views = 3}, "mesh, pushed");
    compare(&(struct how){.primitive = RENDER_MESH, .nearest = true, .views = 3}, "mesh, nearest");
    compare(&(struct how){.primitive = RENDER_MESH, .front = true, .views = 3},
            "mesh, front faces");
}
static void skins_agree(void **state) {
    (void)state;
    compare(&(struct how){.primitive = RENDER_MESH, .skins = RASTER_SKINS_COLOUR, .views = 3},
            "mesh, skins in colour");
    compare(&(struct how){.primitive = RENDER_MESH, .skins = RASTER_SKINS_UNKNOWN, .views = 3},
            "mesh, skins that hide");
    compare(&(struct how){.primitive = RENDER_MESH, .skins = RASTER_SKINS_DRAW, .views = 3},
            "mesh, skins as surfaces");
    compare(&(struct how){.primitive = RENDER_MESH, .skins = RASTER_SKINS_ONLY, .views = 3},
            "skins only");
    compare(&(struct how){.primitive = RENDER_SPLATS, .skins = RASTER_SKINS_UNKNOWN, .views = 3},
            "splats, skins that hide");
}

int main(void) {
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_agree), cmocka_unit_test(splats_agree),
        cmocka_unit_test(meshes_agree), cmocka_unit_test(skins_agree)};
    struct errctx err = {0};
    int failed = 0, tried = 0;
    if (render_create(RENDER_CPU, NULL, &cpu, &err))
        return 1;
    for (int s = 0; s < RENDER_SCENES; s++)
        render_scene_make(s, &scenes[s]);
    for (int kind = RENDER_GLES30; kind <= RENDER_GLES31; kind++) {
        if (render_create((enum render_kind)kind, NULL, &gl, &err)) {
            (void)printf("SKIP: %s: %s\n", render_kind_name((enum render_kind)kind), err.text);
            continue;
        }
        (void)printf("%s\n", render_describe(gl));
        failed += cmocka_run_group_tests_name(render_kind_name((enum render_kind)kind), tests, NULL,
                                              NULL);
        tried++;
        render_destroy(gl);
    }
    for (int s = 0; s < RENDER_SCENES; s++)
        render_scene_fini(&scenes[s]);
    render_destroy(cpu);
    return tried ? failed : 77;
}
