/* Two photographs of one room from one place, one of them twice as dense each way: the denser wins
 * where both look, whichever is drawn first, on every path. */
#include "base/rng.h"
#include "raster/skin.h"
#include "render/render_blend.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/prop.h"
#include "tests/support/room.h"

#include <math.h>

enum { W = 320, H = 240, PIXELS = W * H, PHOTOS = 2, TILES_MAX = 512 };
static const double noise_m = 0.004;

static struct renderer *renderer;
static struct photo photos[PHOTOS]; /* 0: dense, red; 1: coarse, green */
static struct tile tiles[PHOTOS][TILES_MAX];
static size_t tile_count[PHOTOS];
static struct raster_view view;

static void paint(struct photo *photo, const uint8_t rgb[3]) {
    size_t n = (size_t)photo->camera.width_px * (size_t)photo->camera.height_px;
    for (size_t i = 0; i < n; i++)
        memcpy(photo->rgb + 3 * i, rgb, 3);
}

static void make(uint64_t seed) {
    static const uint8_t colours[PHOTOS][3] = {{255, 0, 0}, {0, 255, 0}};
    static const int32_t widths[PHOTOS] = {400, 200};
    struct vec3 origin = {0, 0, 0};
    struct skin_params skins = skin_params_default();
    for (int i = 0; i < PHOTOS; i++) {
        struct camera camera = camera_pinhole(widths[i], widths[i] * 3 / 4, 1.5);
        struct pose pose = room_pose(-2.0 + 0.05 * i, 0.5, 0.3, origin);
        photos[i] = room_photo(&camera, &pose, origin, noise_m, seed + (uint64_t)i);
        (void)skin_mark(&photos[i], &skins);
        paint(&photos[i], colours[i]);
        tile_count[i] = photo_tile_count(camera.width_px, camera.height_px);
        assert_true(tile_count[i] <= TILES_MAX);
        photo_tiles(&photos[i], NULL, tiles[i]);
    }
    struct camera eye = camera_pinhole(W, H, 1.0);
    struct pose pose = room_pose(-1.9, 0.4, 0.25, origin);
    view = raster_view_pinhole(&eye, &pose);
}

static size_t items_of(int first, int count, enum render_primitive primitive,
                       struct render_item *out) {
    struct raster_input inputs[PHOTOS];
    for (int k = 0; k < count; k++) {
        int i = (first + k) % PHOTOS;
        inputs[k] = (struct raster_input){.tiles = tiles[i], .tile_count = tile_count[i]};
    }
    size_t n = render_items_of_inputs(inputs, (size_t)count, primitive, out);
    for (size_t i = 0; i < n; i++) { /* what the GPU knows is by photograph, not by order */
        bool dense = out[i].tile >= tiles[0] && out[i].tile < tiles[0] + TILES_MAX;
        out[i].key = (uint64_t)(out[i].tile - tiles[dense ? 0 : 1]) | (dense ? 0u : 1u << 20);
    }
    return n;
}

static void draw(int first, int count, enum render_primitive primitive, double push, bool weighted,
                 uint8_t *rgba) {
    static struct render_item items[PHOTOS * TILES_MAX];
    struct errctx err = {0};
    struct raster_options options = raster_options_default();
    options.push_sigma = push;
    struct render_frame frame = {items, items_of(first, count, primitive, items), &view, &options};
    struct raster_target target = {.width_px = W, .height_px = H, .rgba = rgba};
    enum st st = weighted ? render_blend_draw(renderer, &frame, &target, NULL, &err)
                          : render_draw(renderer, &frame, &target, NULL, &err);
    if (st)
        fail_msg("%s", err.text);
}

/* Share of the pixels both cover that the dense photograph wins. */
static double dense_share(enum render_primitive primitive, double push, int first) {
    static uint8_t alone[PHOTOS][4 * PIXELS], both[4 * PIXELS];
    int64_t overlap = 0, won = 0;
    for (int i = 0; i < PHOTOS; i++)
        draw(i, 1, primitive, push, false, alone[i]);
    draw(first, PHOTOS, primitive, push, false, both);
    for (size_t i = 0; i < PIXELS; i++)
        if (alone[0][4 * i + 3] == RASTER_ALPHA_SURFACE &&
            alone[1][4 * i + 3] == RASTER_ALPHA_SURFACE) {
            overlap++;
            won += both[4 * i] > 127;
        }
    assert_true(overlap > PIXELS / 2);
    return (double)won / (double)overlap;
}

static void denser_wins_95_percent_in_any_order(void **state) {
    (void)state;
    static const char *const names[] = {"points", "splats", "mesh"};
    for (int p = RENDER_SPLATS; p <= RENDER_MESH; p++) {
        double a = dense_share((enum render_primitive)p, 2.0, 0);
        double b = dense_share((enum render_primitive)p, 2.0, 1);
        double none = dense_share((enum render_primitive)p, 0.0, 0);
        (void)printf("%s, %s: the denser wins %.2f and %.2f %% at 2 sigma, %.1f %% without push\n",
                     render_kind_name(render_kind_of(renderer)), names[p], 100 * a, 100 * b,
                     100 * none);
        assert_true(a >= 0.95 && b >= 0.95);
        assert_float_equal(a, b, 1e-9);
        assert_true(none < 0.9); /* or the test would say nothing about the push */
    }
}

static void order_of_drawing_changes_no_pixel(void **state) {
    (void)state;
    static uint8_t a[4 * PIXELS], b[4 * PIXELS];
    for (int weighted = 0; weighted < 2; weighted++)
        for (int push = 0; push < 3; push += 2) {
            draw(0, PHOTOS, RENDER_SPLATS, push, weighted, a);
            draw(1, PHOTOS, RENDER_SPLATS, push, weighted, b);
            size_t differ = 0;
            for (size_t i = 0; i < PIXELS; i++)
                differ += memcmp(a + 4 * i, b + 4 * i, 4) != 0;
            /* GL keeps the last of equal depths. */
            assert_true(differ < PIXELS / 1000);
        }
}

static void weighted_mean_leans_to_the_denser(void **state) {
    (void)state;
    static uint8_t mixed[4 * PIXELS], alone[PHOTOS][4 * PIXELS];
    double red = 0, green = 0;
    int64_t both = 0, n = 0;
    draw(0, PHOTOS, RENDER_MESH, 0.0, true, mixed);
    for (int i = 0; i < PHOTOS; i++)
        draw(i, 1, RENDER_MESH, 0.0, false, alone[i]);
    for (size_t i = 0; i < PIXELS; i++)
        if (alone[0][4 * i + 3] == RASTER_ALPHA_SURFACE &&
            alone[1][4 * i + 3] == RASTER_ALPHA_SURFACE) {
            red += mixed[4 * i];
            green += mixed[4 * i + 1];
            both += mixed[4 * i] > 20 && mixed[4 * i + 1] > 20;
            n++;
        }
    (void)printf("%s: %.1f %% of the overlap is mixed, red to green %.2f\n",
                 render_kind_name(render_kind_of(renderer)), 100.0 * (double)both / (double)n,
                 red / green);
    assert_true((double)both > 0.8 * (double)n);
    assert_true(red > 1.2 * green);
}

int main(void) {
    static const struct CMUnitTest tests[] = {cmocka_unit_test(denser_wins_95_percent_in_any_order),
                                              cmocka_unit_test(order_of_drawing_changes_no_pixel),
                                              cmocka_unit_test(weighted_mean_leans_to_the_denser)};
    struct errctx err = {0};
    int failed = 0;
    make(prop_seed());
    for (int kind = RENDER_CPU; kind < RENDER_KINDS; kind++) {
        if (render_create((enum render_kind)kind, NULL, &renderer, &err)) {
            (void)printf("SKIP: %s: %s\n", render_kind_name((enum render_kind)kind), err.text);
            continue;
        }
        failed += cmocka_run_group_tests_name(render_kind_name((enum render_kind)kind), tests, NULL,
                                              NULL);
        render_destroy(renderer);
    }
    for (int i = 0; i < PHOTOS; i++)
        photo_destroy(&photos[i]);
    return failed;
}
