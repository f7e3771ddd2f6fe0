/* Tiles on the GPU: places in three texture arrays (disparity, colour with confidence, and what the
 * cells are), four ways associative, the longest unused place is taken over. */
#ifndef SC_RENDER_GLES_GLES_ATLAS_H
#define SC_RENDER_GLES_GLES_ATLAS_H

#include "render/gles/gl_api.h"
#include "render/render.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    GLES_ATLAS_PLACE_PX = 33, /* a tile with the row and column of its neighbours */
    GLES_ATLAS_SIDE = 16,     /* places along a layer */
    GLES_ATLAS_WAYS = 4
};

struct gles_atlas_place {
    uint64_t key, used; /* used: the batch that needed it last */
    uint32_t version;
    uint8_t hides; /* the flags that were left out when it was sent */
    bool taken;
};

struct gles_atlas {
    const struct gl_api *gl;
    GLuint disparity, colour, meta; /* texture arrays */
    struct gles_atlas_place *places;
    size_t place_count;
    int64_t bytes_sent;
};

ST_MUST_CHECK enum st gles_atlas_init(struct gles_atlas *atlas, const struct gl_api *gl,
                                      size_t bytes, struct errctx *err);
void gles_atlas_fini(struct gles_atlas *atlas);   /* takes a zeroed one; needs its context */
void gles_atlas_forget(struct gles_atlas *atlas); /* the same when the context is gone */

/* Where a tile is, sending it if it is not there. `batch` counts up; false: the place that it must
 * take is needed by that very batch, which has to be drawn first. */
bool gles_atlas_place(struct gles_atlas *atlas, const struct render_item *item, uint8_t leave_out,
                      uint64_t batch, int32_t out_place[3]);

void gles_atlas_bind(const struct gles_atlas *atlas); /* to texture units 0, 1, 2 */

#ifdef __cplusplus
}
#endif
#endif
