#include "tests/support/render_scenes.h"

#include "base/rng.h"
#include "raster/skin.h"
#include "tests/support/room.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void add(struct render_scene *s, int32_t width_px, double x_m, double y_m,
                double azimuth_rad, double noise_m, bool bound_unknown) {
    int i = s->photo_count++;
    struct camera camera = camera_pinhole(width_px, width_px * 3 / 4, 1.6);
    struct pose pose = room_pose(x_m, y_m, azimuth_rad, s->offset_m);
    struct skin_params skins = skin_params_default();
    s->photos[i] = room_photo(&camera, &pose, s->offset_m, noise_m, (uint64_t)i + 1);
    (void)skin_mark(&s->photos[i], &skins);
    if (bound_unknown && skin_bound_unknown(&s->photos[i], NULL))
        abort();
    size_t n = photo_tile_count(camera.width_px, camera.height_px);
    struct tile *tiles = malloc(n * sizeof *tiles);
    if (!tiles)
        abort();
    photo_tiles(&s->photos[i], NULL, tiles);
    s->inputs[i] = (struct raster_input){.tiles = tiles, .tile_count = n, .id = (uint32_t)i};
    s->tile_count += n;
}

void render_scene_make(int which, struct render_scene *s) {
    memset(s, 0, sizeof *s);
    if (which == 0) {
        s->name = "one stand";
        for (int i = 0; i < 4; i++)
            add(s, 320, 0.0, 0.0, 1.5707963 * i, 0.0, false);
    } else if (which == 1) {
        s->name = "two stands, noise";
        for (int i = 0; i < 4; i++)
            add(s, 256, i < 2 ? -2.0 : 2.0, i < 2 ? 1.0 : -1.0, 0.4 + 1.2 * i, 0.004, true);
    } else {
        s->name = "far from the origin";
        s->offset_m = vec3_make(1e7, -4e6, 300.0);
        add(s, 384, -1.5, 0.0, 0.3, 0.002, false);
        add(s, 192, 1.0, 0.5, 0.1, 0.002, false);
        add(s, 192, 1.0, 0.5, 2.0, 0.002, false);
    }
}

void render_scene_fini(struct render_scene *s) {
    for (int i = 0; i < s->photo_count; i++) {
        union {
            const struct tile *in;
            struct tile *out;
        } tiles = {.in = s->inputs[i].tiles};
        free(tiles.out);
        photo_destroy(&s->photos[i]);
    }
    memset(s, 0, sizeof *s);
}

struct raster_view render_scene_view(const struct render_scene *scene, int k, int32_t width_px,
                                     int32_t height_px, double hfov_rad) {
    struct rng rng = rng_make(77u + (uint64_t)k);
    struct vec3 eye = vec3_make(5.0 * rng_uniform(&rng) - 2.5, 3.6 * rng_uniform(&rng) - 1.8,
                                1.0 + rng_uniform(&rng));
    double azimuth = 6.2831853 * rng_uniform(&rng), down = 0.5 * rng_uniform(&rng) - 0.15;
    struct vec3 ahead = vec3_make(cos(azimuth), sin(azimuth), -down);
    eye = vec3_add(eye, scene->offset_m);
    struct pose pose;
    if (pose_look_at(eye, vec3_add(eye, ahead), vec3_make(0, 0, 1), &pose))
        abort();
    struct camera camera = camera_pinhole(width_px, height_px, hfov_rad);
    return raster_view_pinhole(&camera, &pose);
}

double render_scene_difference(const uint8_t *a, const uint8_t *b, size_t pixels) {
    size_t bad = 0;
    for (size_t i = 0; i < pixels; i++) {
        int worst = 0;
        for (int k = 0; k < 3; k++) {
            int d = abs((int)a[4 * i + (size_t)k] - (int)b[4 * i + (size_t)k]);
            worst = d > worst ? d : worst;
        }
        bad += worst > 2 || a[4 * i + 3] != b[4 * i + 3];
    }
    return (double)bad / (double)pixels;
}
