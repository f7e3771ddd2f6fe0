/* Pictures of a made-up room against kept ones in tests/golden/raster/. scripts/golden makes them
 * anew.
 *
 * Tolerance: at most GOLDEN_SHARE of the pixels may differ by more than GOLDEN_LEVELS. The same
 * source gives the same bytes on one machine; another libm, in the room's shading and in turning
 * the camera, moves last bits, which can move a sample over a pixel's edge. */
#include "base/picture.h"
#include "raster/depth_picture.h"
#include "raster/raster.h"
#include "raster/skin.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/draw.h"
#include "tests/support/room.h"

#include <math.h>
#include <stdio.h>

static const int golden_levels = 2;
static const double golden_share = 1e-3;

enum { WIDTH = 240, HEIGHT = 160, PHOTOS = 2 };
static const struct vec3 no_offset = {0, 0, 0};

static void make_photos(struct draw_photo out[PHOTOS]) {
    for (uint32_t i = 0; i < PHOTOS; i++) {
        struct camera cam = camera_pinhole(260, 180, 1.2);
        struct pose pose = room_pose(i ? -1.4 : -2.5, i ? -2.2 : -1.5, i ? 0.9 : 0.4, no_offset);
        struct photo photo = room_photo(&cam, &pose, no_offset, 0.0, 1);
        struct skin_params params = skin_params_default();
        (void)skin_mark(&photo, &params);
        out[i] = draw_photo_make(photo, i);
    }
}

/* Compares with the kept picture, or keeps it if SCANCART_GOLDEN=make. */
static void check(const char *name, const uint8_t *rgb) {
    char path[512];
    union {
        const uint8_t *in;
        uint8_t *out;
    } px = {.in = rgb};
    struct image_u8 made = {px.out, WIDTH, HEIGHT, 3, 3 * WIDTH};
    (void)snprintf(path, sizeof path, "%s/tests/golden/raster/%s.png", SCANCART_SOURCE_DIR, name);
    struct errctx err = {0};
    const char *mode = getenv("SCANCART_GOLDEN");
    if (mode && !strcmp(mode, "make")) {
        assert_int_equal(picture_write_png(path, &made, &err), ST_OK);
        return;
    }
    struct image_u8 kept;
    if (picture_read_rgb(path, &kept, &err))
        fail_msg("%s", err.text);
    assert_int_equal(kept.width_px, WIDTH);
    assert_int_equal(kept.height_px, HEIGHT);
    size_t differ = 0;
    for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++) {
        int worst = 0;
        for (size_t k = 0; k < 3; k++)
            worst = (int)fmax(worst, abs(rgb[3 * i + k] - kept.px[3 * i + k]));
        differ += worst > golden_levels;
    }
    image_u8_destroy(&kept);
    if ((double)differ > golden_share * WIDTH * HEIGHT)
        fail_msg("%s: %zu pixels differ by more than %d levels", name, differ, golden_levels);
}

static void draw_and_check(const char *name, const struct raster_view *view,
                           const struct raster_options *options, bool depths) {
    struct draw_photo photos[PHOTOS];
    make_photos(photos);
    const struct raster_input inputs[PHOTOS] = {photos[0].input, photos[1].input};
    struct draw_target t = draw_target_make(WIDTH, HEIGHT, false);
    assert_int_equal(draw(&t, inputs, PHOTOS, view, options), ST_OK);
    uint8_t *rgb = malloc(t.pixels * 3);
    assert_non_null(rgb);
    for (size_t i = 0; i < t.pixels; i++)
        memcpy(rgb + 3 * i, t.planes.rgba + 4 * i, 3);
    check(name, rgb);
    if (depths) {
        char depth_name[64];
        struct depth_range range = {0.0f, 0.8f};
        (void)snprintf(depth_name, sizeof depth_name, "%s_depth", name);
        depth_picture_colour(t.planes.depth, t.pixels, range, rgb);
        check(depth_name, rgb);
    }
    free(rgb);
    draw_target_fini(&t);
    for (int i = 0; i < PHOTOS; i++)
        draw_photo_fini(&photos[i]);
}

static struct raster_view beside(void) {
    struct camera cam = camera_pinhole(WIDTH, HEIGHT, 1.2);
    struct pose pose = room_pose(-2.0, -2.0, 0.6, no_offset);
    return raster_view_pinhole(&cam, &pose);
}

static void points_are_as_kept(void **state) {
    (void)state;
    struct raster_view view = beside();
    struct raster_options options = raster_options_default();
    options.primitive = RASTER_POINTS;
    draw_and_check("points", &view, &options, false);
}

static void splats_are_as_kept(void **state) {
    (void)state;
    struct raster_view view = beside();
    struct raster_options options = raster_options_default();
    draw_and_check("splats", &view, &options, true);
}

static void mesh_is_as_kept(void **state) {
    (void)state;
    struct raster_view view = beside();
    struct raster_options options = raster_options_default();
    options.primitive = RASTER_MESH;
    draw_and_check("mesh", &view, &options, true);
}

static void cubic_mesh_with_coloured_skins_is_as_kept(void **state) {
    (void)state;
    struct raster_view view = beside();
    struct raster_options options = raster_options_default();
    options.primitive = RASTER_MESH;
    options.filter = RASTER_FILTER_CUBIC;
    options.skins = RASTER_SKINS_COLOUR;
    draw_and_check("mesh_cubic_skins", &view, &options, false);
}

static void plan_is_as_kept(void **state) {
    (void)state;
    struct pose above;
    assert_int_equal(
        pose_look_at(vec3_make(0, 0, 2.9), vec3_make(0, 0, 0), vec3_make(0, 1, 0), &above), ST_OK);
    struct raster_view view = raster_view_orthographic(WIDTH, HEIGHT, 25.0, 0.2, 3.5, &above);
    struct raster_options options = raster_options_default();
    options.primitive = RASTER_MESH;
    draw_and_check("plan", &view, &options, false);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_are_as_kept),
        cmocka_unit_test(splats_are_as_kept),
        cmocka_unit_test(mesh_is_as_kept),
        cmocka_unit_test(cubic_mesh_with_coloured_skins_is_as_kept),
        cmocka_unit_test(plan_is_as_kept),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
