/* What the viewer streams from: the newest tile pack of a site, or its photographs as a pyramid in
 * memory where no tiles were made yet. */
#ifndef SC_APP_VIEW_SOURCE_H
#define SC_APP_VIEW_SOURCE_H

#include "base/st.h"
#include "render/tile_cache.h"
#include "site/site.h"

struct view_source;

/* from_photos: do not look for a pack. ST_NOT_FOUND if there is nothing to show. A photograph that
 * cannot be read is left out and counted. */
ST_MUST_CHECK enum st view_source_open(struct site *site, bool from_photos,
                                       struct view_source **out_source, struct errctx *err);
void view_source_close(struct view_source *source); /* takes NULL */

struct tile_source view_source_tiles(const struct view_source *source);

/* "tiles" or "photographs"; how many photographs could not be read; the first reason or "". */
const char *view_source_kind(const struct view_source *source);
int view_source_left_out(const struct view_source *source, const char **out_why);
/* False where a photograph's scale is not known: its unit is some baseline. */
bool view_source_is_metric(const struct view_source *source);

#endif
