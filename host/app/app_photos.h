/* The 3D photographs of a site in memory, with their tiles, ready to be drawn. */
#ifndef SC_APP_APP_PHOTOS_H
#define SC_APP_APP_PHOTOS_H

#include "base/photo.h"
#include "base/st.h"
#include "raster/raster.h"
#include "site/site.h"

#include <stdbool.h>
#include <stddef.h>

struct app_photo {
    char name[SITE_NAME_MAX], station[SITE_NAME_MAX];
    char length_unit[16]; /* "m" unless the photograph's scale is not known */
    struct photo photo;
    struct pose world_from_station, world_from_cam;
    struct tile *tiles;
    size_t tile_count;
};

struct app_photos {
    struct app_photo *photos;
    struct raster_input *inputs; /* one a photograph, id = index */
    size_t count;
};

struct app_photos_options {
    /* Names, or station/name, separated by commas; NULL: all. Two photographs of one name in
     * different stations are both meant by the name alone. */
    const char *wanted, *unwanted;
    bool bound_unknown; /* skin_bound_unknown() on each */
};

/* Reads the photographs. Those that carry no skin flags get them from skin_mark(). ST_NOT_FOUND if
 * the site has none or a name matches none. Free with app_photos_fini(). */
ST_MUST_CHECK enum st app_photos_load(struct site *site, const struct app_photos_options *options,
                                      struct app_photos *out_photos, struct errctx *err);
void app_photos_fini(struct app_photos *photos); /* takes a zeroed one or NULL */

/* One photograph's camera and pose by name or station/name; NULL: the first of the site. */
struct app_photo_view {
    struct camera camera;
    struct pose world_from_cam;
};
ST_MUST_CHECK enum st app_photos_view(struct site *site, const char *name,
                                      struct app_photo_view *out_view, struct errctx *err);

#endif
