/* The site's photographs to one pack of tiles: redundant tiles culled, the rest coded by the error
 * asked for. */
#ifndef SC_APP_FUSE_TILES_H
#define SC_APP_FUSE_TILES_H

#include "app/fuse_photo.h"
#include "base/fileio.h"

struct fuse_tiles_result {
    struct cull_counts cull;
    struct pack_stats pack;
    size_t photo_count;
    int64_t file_bytes;
    uint8_t sha256[HASH_SHA256_BYTES];
    bool kept; /* was up to date: the counts are not known */
    double seconds_cull, seconds_pack;
};

/* Packs all metric photographs of the site; of a station that has fused ones only those. `photos`
 * may hold some in memory already (NULL: none). ST_NOT_FOUND if the site has no photographs. */
ST_MUST_CHECK enum st fuse_tiles(struct site *site, struct fuse_photos *photos,
                                 const struct fuse_settings *settings,
                                 struct fuse_tiles_result *out_result, struct progress *progress,
                                 struct errctx *err);

/* The newest pack of a site: its path. ST_NOT_FOUND: run fuse. */
ST_MUST_CHECK enum st fuse_tiles_path(struct site *site, char out_path[FILEIO_PATH_MAX],
                                      struct errctx *err);

#endif
