/* A pyramid of tiles made up on the fly, for tests of cache and scene selection: photographs of a
 * wall at 4 m, all from one place, and reads that can be counted or made to fail. */
#ifndef SC_TESTS_SUPPORT_VIEW_FAKE_H
#define SC_TESTS_SUPPORT_VIEW_FAKE_H

#include "render/tile_cache.h"

enum { VIEW_FAKE_PHOTOS_MAX = 64 };

struct view_fake {
    struct tile_pack_index index;
    struct tile_pack_photo photos[VIEW_FAKE_PHOTOS_MAX];
    int64_t damaged; /* this node cannot be read; -1: none */
    _Atomic int64_t reads;
};

/* Aborts without memory. Photographs look along x, `width_px` square, 90 degrees wide. */
void view_fake_make(struct view_fake *fake, int32_t photo_count, int32_t width_px);
void view_fake_fini(struct view_fake *fake);
struct tile_source view_fake_source(struct view_fake *fake);

/* Where a node stands. */
struct view_fake_place {
    int32_t photo, level, i, j;
};
struct view_fake_place view_fake_place_of(const struct view_fake *fake, int64_t node);

/* The view of photograph 0, `width_px` square. */
struct raster_view view_fake_view(const struct view_fake *fake, int32_t width_px);

#endif
