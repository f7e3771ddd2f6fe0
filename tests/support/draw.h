/* Drawing in tests: a target with all planes, and a photograph with its tiles. */
#ifndef SC_TESTS_SUPPORT_DRAW_H
#define SC_TESTS_SUPPORT_DRAW_H

#include "raster/raster.h"

#include <stdlib.h>
#include <string.h>

struct draw_photo {
    struct photo photo;
    struct tile *tiles;
    struct raster_input input;
};

/* Takes the photograph over; free with draw_photo_fini(). */
static inline struct draw_photo draw_photo_make(struct photo photo, uint32_t id) {
    struct draw_photo d = {.photo = photo};
    int32_t w = photo.camera.width_px, h = photo.camera.height_px;
    size_t n = photo_tile_count(w, h);
    d.tiles = calloc(n, sizeof *d.tiles);
    if (!d.tiles)
        abort();
    photo_tiles(&d.photo, NULL, d.tiles);
    d.input = (struct raster_input){d.tiles, n, w, h, id};
    return d;
}

static inline void draw_photo_fini(struct draw_photo *d) {
    photo_destroy(&d->photo);
    free(d->tiles);
}

/* A photograph without disparities; every pixel has a colour of its own. */
static inline struct photo draw_blank(const struct camera *camera) {
    struct photo photo;
    if (photo_create(camera, &photo, NULL))
        abort();
    for (int32_t v = 0; v < camera->height_px; v++)
        for (int32_t u = 0; u < camera->width_px; u++) {
            uint8_t *rgb = photo.rgb + 3 * ((size_t)v * (size_t)camera->width_px + (size_t)u);
            rgb[0] = (uint8_t)(u * 5 + 40);
            rgb[1] = (uint8_t)(v * 5 + 30);
            rgb[2] = (uint8_t)((u ^ v) + 20);
        }
    return photo;
}

/* The same disparity everywhere. */
static inline struct photo draw_wall(const struct camera *camera, float disparity_per_m) {
    struct photo photo = draw_blank(camera);
    size_t n = (size_t)camera->width_px * (size_t)camera->height_px;
    for (size_t i = 0; i < n; i++)
        photo.disparity_per_m[i] = disparity_per_m;
    return photo;
}

struct draw_target {
    struct raster_target planes;
    struct raster_scratch scratch;
    struct raster_stats stats;
    size_t pixels;
};

/* rich: with item and count. */
static inline struct draw_target draw_target_make(int32_t width_px, int32_t height_px, bool rich) {
    struct draw_target t = {.planes = {.width_px = width_px, .height_px = height_px}};
    size_t n = t.pixels = (size_t)width_px * (size_t)height_px;
    t.planes.rgba = calloc(n, 4);
    t.planes.depth = calloc(n, sizeof(float));
    if (rich) {
        t.planes.item = calloc(n, sizeof(uint64_t));
        t.planes.count = calloc(n, sizeof(uint16_t));
    }
    if (!t.planes.rgba || !t.planes.depth || (rich && (!t.planes.item || !t.planes.count)))
        abort();
    return t;
}

static inline void draw_target_fini(struct draw_target *t) {
    free(t->planes.rgba);
    free(t->planes.depth);
    free(t->planes.item);
    free(t->planes.count);
    raster_scratch_fini(&t->scratch);
}

static inline enum st draw(struct draw_target *t, const struct raster_input *inputs, size_t count,
                           const struct raster_view *view, const struct raster_options *options) {
    return raster_draw(inputs, count, view, options, &t->planes, &t->scratch, &t->stats, NULL);
}

/* Pixels with that alpha. */
static inline size_t draw_count(const struct draw_target *t, uint8_t alpha) {
    size_t n = 0;
    for (size_t i = 0; i < t->pixels; i++)
        n += t->planes.rgba[4 * i + 3] == alpha;
    return n;
}

/* Pixels whose colours or alpha differ. */
static inline size_t draw_differ(const struct draw_target *a, const struct draw_target *b) {
    size_t n = 0;
    for (size_t i = 0; i < a->pixels; i++)
        n += memcmp(a->planes.rgba + 4 * i, b->planes.rgba + 4 * i, 4) != 0;
    return n;
}

#endif
