/* Skins of all photographs of a site by reprojection, and the rows that make them the site's
 * photographs. */
#ifndef SC_APP_FUSE_SKINS_H
#define SC_APP_FUSE_SKINS_H

#include "app/fuse_photo.h"

struct fuse_skins_result {
    struct reproject_counts counts;
    bool ran, kept; /* neither: one station, or a quality without */
    double seconds;
};

/* Makes the final photographs (final_sha256) of those made, or finds them, and puts their rows;
 * rows of quick pictures that an import made of the same samples, and of photographs that no longer
 * are, go. */
ST_MUST_CHECK enum st fuse_skins(struct site *site, struct fuse_photos *photos,
                                 const struct fuse_settings *settings,
                                 struct fuse_skins_result *out_result, struct progress *progress,
                                 struct errctx *err);

#endif
