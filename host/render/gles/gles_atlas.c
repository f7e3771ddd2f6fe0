#include "render/gles/gles_atlas.h"

#include <stdlib.h>
#include <string.h>

enum {
    LAYER_PX = GLES_ATLAS_PLACE_PX * GLES_ATLAS_SIDE,
    LAYER_PLACES = GLES_ATLAS_SIDE * GLES_ATLAS_SIDE,
    SAMPLE_BYTES = 4 + 4 + 2,
    PLACE_SAMPLES = GLES_ATLAS_PLACE_PX * GLES_ATLAS_PLACE_PX
};

static GLuint array_create(const struct gl_api *gl, GLenum format, GLsizei layers) {
    GLuint texture = 0;
    gl->GenTextures(1, &texture);
    gl->BindTexture(GL_TEXTURE_2D_ARRAY, texture);
    gl->TexStorage3D(GL_TEXTURE_2D_ARRAY, 1, format, LAYER_PX, LAYER_PX, layers);
    gl->TexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl->TexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    return texture;
}

enum st gles_atlas_init(struct gles_atlas *atlas, const struct gl_api *gl, size_t bytes,
                        struct errctx *err) {
    memset(atlas, 0, sizeof *atlas);
    GLint layers_max = 256;
    gl->GetIntegerv(GL_MAX_ARRAY_TEXTURE_LAYERS, &layers_max);
    size_t layers = bytes / ((size_t)LAYER_PX * LAYER_PX * SAMPLE_BYTES);
    layers = layers < 1 ? 1 : layers > (size_t)layers_max ? (size_t)layers_max : layers;
    atlas->gl = gl;
    atlas->place_count = layers * LAYER_PLACES;
    atlas->places = calloc(atlas->place_count, sizeof *atlas->places);
    if (!atlas->places)
        return errctx_set(err, ST_NOMEM, "no memory for %zu tiles", atlas->place_count);
    (void)gl->GetError();
    atlas->disparity = array_create(gl, GL_R32F, (GLsizei)layers);
    atlas->colour = array_create(gl, GL_RGBA8, (GLsizei)layers);
    atlas->meta = array_create(gl, GL_RG8UI, (GLsizei)layers);
    if (gl->GetError() != GL_NO_ERROR) {
        gles_atlas_fini(atlas);
        return errctx_set(err, ST_NOMEM, "the GPU has no room for %zu MB of tiles", bytes >> 20);
    }
    return ST_OK;
}

void gles_atlas_forget(struct gles_atlas *atlas) {
    free(atlas->places);
    memset(atlas, 0, sizeof *atlas);
}

void gles_atlas_fini(struct gles_atlas *atlas) {
    if (atlas->gl) {
        const GLuint textures[3] = {atlas->disparity, atlas->colour, atlas->meta};
        atlas->gl->DeleteTextures(3, textures);
    }
    gles_atlas_forget(atlas);
}

void gles_atlas_bind(const struct gles_atlas *atlas) {
    const GLuint textures[3] = {atlas->disparity, atlas->colour, atlas->meta};
    for (GLenum i = 0; i < 3; i++) {
        atlas->gl->ActiveTexture(GL_TEXTURE0 + i);
        atlas->gl->BindTexture(GL_TEXTURE_2D_ARRAY, textures[i]);
    }
}

/* What is sent of one tile. */
struct staging {
    float disparity[PLACE_SAMPLES];
    uint8_t colour[4 * PLACE_SAMPLES], meta[2 * PLACE_SAMPLES];
    uint8_t bits[PLACE_SAMPLES]; /* 1 there, 2 shown, 4 guess */
};

static void stage_samples(const struct tile *tile, uint8_t leave_out, int32_t w, int32_t h,
                          struct staging *s) {
    for (int32_t v = 0; v < h; v++)
        for (int32_t u = 0; u < w; u++) {
            ptrdiff_t from = (ptrdiff_t)v * tile->stride_px + u;
            size_t to = (size_t)(v * w + u);
            float d = tile->disparity_per_m[from];
            uint8_t flags = tile->flags[from];
            bool there = d >= 0.0f && d <= 3.402823466e38f;
            bool shown = there && !(flags & (leave_out | PHOTO_DROPPED));
            s->disparity[to] = there ? d : -1.0f;
            memcpy(s->colour + 4 * to, tile->rgb + 3 * from, 3);
            s->colour[4 * to + 3] = tile->confidence[from];
            s->bits[to] = (uint8_t)((there ? 1 : 0) | (shown ? 2 : 0) |
                                    (there && flags & PHOTO_DROPPED ? 4 : 0));
        }
}

/* Red: skin, guess, shown; green: corners shown and there, clockwise from the cell's own sample. */
static void stage_meta(const struct tile *tile, int32_t w, int32_t h, struct staging *s) {
    for (int32_t v = 0; v < h; v++)
        for (int32_t u = 0; u < w; u++) {
            size_t at = (size_t)(v * w + u);
            uint8_t bits[4] = {s->bits[at], 0, 0, 0};
            if (u + 1 < w && v + 1 < h) {
                bits[1] = s->bits[at + 1];
                bits[2] = s->bits[at + (size_t)w + 1];
                bits[3] = s->bits[at + (size_t)w];
            }
            unsigned red = 0, green = 0;
            for (unsigned i = 0; i < 4; i++) {
                green |= (bits[i] & 2u ? 1u : 0u) << i | (bits[i] & 1u) << (i + 4);
                red |= bits[i] & 4u ? 2u : 0u;
            }
            uint8_t flags = tile->flags[(ptrdiff_t)v * tile->stride_px + u];
            red |= flags & PHOTO_SKIN ? 1u : 0u;
            red |= (flags & PHOTO_SKIN_DISPROVED) == PHOTO_SKIN_DISPROVED ? 8u : 0u;
            red |= bits[0] & 2u ? 4u : 0u;
            s->meta[2 * at] = (uint8_t)red;
            s->meta[2 * at + 1] = (uint8_t)green;
        }
}

static void send(struct gles_atlas *atlas, const struct tile *tile, uint8_t leave_out,
                 const int32_t place[3]) {
    struct staging s;
    int32_t w = tile->cells_x + 1 > tile->width_px ? tile->cells_x + 1 : tile->width_px;
    int32_t h = tile->cells_y + 1 > tile->height_px ? tile->cells_y + 1 : tile->height_px;
    stage_samples(tile, leave_out, w, h, &s);
    stage_meta(tile, w, h, &s);
    const struct gl_api *gl = atlas->gl;
    gl->PixelStorei(GL_UNPACK_ALIGNMENT, 1);
    gl->ActiveTexture(GL_TEXTURE0);
    gl->BindTexture(GL_TEXTURE_2D_ARRAY, atlas->disparity);
    gl->TexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, place[0], place[1], place[2], w, h, 1, GL_RED,
                      GL_FLOAT, s.disparity);
    gl->BindTexture(GL_TEXTURE_2D_ARRAY, atlas->colour);
    gl->TexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, place[0], place[1], place[2], w, h, 1, GL_RGBA,
                      GL_UNSIGNED_BYTE, s.colour);
    gl->BindTexture(GL_TEXTURE_2D_ARRAY, atlas->meta);
    gl->TexSubImage3D(GL_TEXTURE_2D_ARRAY, 0, place[0], place[1], place[2], w, h, 1, GL_RG_INTEGER,
                      GL_UNSIGNED_BYTE, s.meta);
    gl->BindTexture(GL_TEXTURE_2D_ARRAY, atlas->disparity);
    atlas->bytes_sent += (int64_t)w * h * SAMPLE_BYTES;
}

static uint64_t mix(uint64_t x) {
    x = (x ^ x >> 31) * 0x9e3779b97f4a7c15u;
    return x ^ x >> 29;
}

bool gles_atlas_place(struct gles_atlas *atlas, const struct render_item *item, uint8_t leave_out,
                      uint64_t batch, int32_t out_place[3]) {
    size_t set = mix(item->key) % (atlas->place_count / GLES_ATLAS_WAYS) * GLES_ATLAS_WAYS;
    size_t best = set;
    bool hit = false;
    for (size_t i = set; i < set + GLES_ATLAS_WAYS && !hit; i++) {
        const struct gles_atlas_place *p = &atlas->places[i];
        hit =
            p->taken && p->key == item->key && p->version == item->version && p->hides == leave_out;
        if (hit || p->used < atlas->places[best].used)
            best = i;
    }
    struct gles_atlas_place *p = &atlas->places[best];
    if (!hit && p->taken && p->used == batch)
        return false;
    size_t within = best % LAYER_PLACES;
    out_place[0] = (int32_t)(within % GLES_ATLAS_SIDE) * GLES_ATLAS_PLACE_PX;
    out_place[1] = (int32_t)(within / GLES_ATLAS_SIDE) * GLES_ATLAS_PLACE_PX;
    out_place[2] = (int32_t)(best / LAYER_PLACES);
    if (!hit)
        send(atlas, item->tile, leave_out, out_place);
    *p = (struct gles_atlas_place){item->key, batch, item->version, leave_out, true};
    return true;
}
