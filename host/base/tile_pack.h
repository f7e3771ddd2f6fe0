/* Packed tiles: one file with all photographs of a site as a pyramid of coded tiles (tile_code.h)
 * behind a compact index. docs/tile-format.md is the specification.
 *
 * The index stands first and is complete by itself: which photographs, their cameras and poses,
 * which tiles at which level, how large and how near. Tiles follow, coarsest level of all
 * photographs first, so that a reader has a whole picture after the first few percent of the file.
 *
 * Level 0 is the photograph. Level n + 1 has half as many pixels each way; pixel (x, y) of it
 * covers pixels (2x, 2y) .. (2x + 1, 2y + 1) of level n, and tile (i, j) covers tiles (2i, 2j) ..
 * (2i + 1, 2j + 1). */
#ifndef SC_BASE_TILE_PACK_H
#define SC_BASE_TILE_PACK_H

#include "base/camera.h"
#include "base/photo.h"
#include "base/pose.h"
#include "base/st.h"
#include "base/tile_code.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    TILE_PACK_VERSION = 1,
    TILE_PACK_MAX_LEVELS = 16,
    TILE_PACK_MAX_PHOTOS = 1 << 16,
    TILE_PACK_NAME_BYTES = 64
};
/* Tiles of one file at the most: 2^36 samples. */
#define TILE_PACK_MAX_NODES ((int64_t)1 << 26)

enum tile_pack_kind {                     /* how a tile is best drawn */
                      TILE_PACK_NONE = 0, /* holds nothing, or is redundant: nothing is stored */
                      TILE_PACK_SAMPLED = 1,
                      TILE_PACK_PLANE = 2
};

enum tile_pack_flag {
    TILE_PACK_CULLED = 1u << 0, /* held something; other photographs show it better */
    TILE_PACK_SKINS = 1u << 1,  /* has cells flagged PHOTO_SKIN */
    TILE_PACK_SKY = 1u << 2,
    TILE_PACK_LOW = 1u << 3 /* half of its samples or more are of low confidence */
};

/* One tile in the index. */
struct tile_pack_node {
    uint64_t offset;                                /* of its bytes in the file; 0: none */
    uint32_t size_bytes;                            /* 0: none */
    uint32_t crc32c;                                /* of those bytes */
    float disparity_min_per_m, disparity_max_per_m; /* of its samples but sky; min > max: none */
    float error_per_m; /* rms by which this level differs from the next finer one; 0 at level 0 */
    uint16_t valid_count;
    uint8_t kind;  /* enum tile_pack_kind */
    uint8_t flags; /* enum tile_pack_flag */
};

/* One photograph. Its tiles are nodes first_node[level] + j * tiles_x[level] + i. */
struct tile_pack_photo {
    char name[TILE_PACK_NAME_BYTES];
    int64_t photo_id, station_id; /* rows of the site; 0: none */
    struct camera camera;         /* of level 0, a pinhole */
    struct pose station_from_cam, world_from_station;
    int32_t level_count;
    int64_t first_node[TILE_PACK_MAX_LEVELS];
};

/* What an index says. Coordinates of all photographs are relative to nothing but their own poses
 * (double). */
struct tile_pack_index {
    struct tile_pack_photo *photos;
    int32_t photo_count;
    struct tile_pack_node *nodes;
    int64_t node_count;
    uint64_t file_bytes;
    double error_m, error_range_m; /* what was asked for: error_m at error_range_m */
};

/* Size in px, tiles each way and camera of a level. level < photo->level_count. */
struct camera tile_pack_camera(const struct camera *level0, int32_t level);
void tile_pack_tiles(const struct camera *level0, int32_t level, int32_t *out_tiles_x,
                     int32_t *out_tiles_y);
/* Levels until one tile is left. */
int32_t tile_pack_level_count(const struct camera *level0);
/* Node of a tile. */
int64_t tile_pack_node_at(const struct tile_pack_photo *photo, int32_t level, int32_t i, int32_t j);

/* A tile as host/raster and the renderers take it: views into `samples`, which must outlive it.
 * Cells on the tile's border are its own where the apron is there. */
struct tile tile_pack_tile(const struct tile_pack_photo *photo, int32_t level, int32_t i, int32_t j,
                           const struct tile_samples *samples);

/* ---- reading ---- */

struct tile_pack; /* an open file */

/* Opens and reads the index, nothing else: about 40 bytes a tile. ST_FORMAT or ST_DAMAGED with the
 * reason for anything that is not a sane pack; sizes are checked against the file before memory is
 * taken. */
ST_MUST_CHECK enum st tile_pack_open(const char *path, struct tile_pack **out_pack,
                                     struct errctx *err);
void tile_pack_close(struct tile_pack *pack); /* takes NULL */
const struct tile_pack_index *tile_pack_get_index(const struct tile_pack *pack);

/* The same from memory (fetched from a server, or fuzzed); `bytes` must outlive it. */
ST_MUST_CHECK enum st tile_pack_open_memory(const void *bytes, size_t size,
                                            struct tile_pack **out_pack, struct errctx *err);

/* Reads, checks and decodes one tile. ST_NOT_FOUND for a node without bytes; ST_DAMAGED, ST_FORMAT
 * name the tile. Any number of threads may read at once. */
ST_MUST_CHECK enum st tile_pack_read(const struct tile_pack *pack, int64_t node,
                                     struct tile_samples *out_samples, struct errctx *err);

/* ---- writing ---- */

struct tile_pack_writer;

/* Starts a pack of `photos` (name, ids, camera, poses filled; level_count and first_node are filled
 * in) into a new file beside `path`. Tiles are kept on disk, in the order they come. */
ST_MUST_CHECK enum st tile_pack_create(const char *path, struct tile_pack_photo *photos,
                                       int32_t photo_count, double error_m, double error_range_m,
                                       struct tile_pack_writer **out_writer, struct errctx *err);
/* Describes one tile: node->offset and crc32c are filled in, bytes may be NULL with size_bytes 0.
 * Once a node; nodes never put are TILE_PACK_NONE. */
ST_MUST_CHECK enum st tile_pack_put(struct tile_pack_writer *writer, int64_t node,
                                    const struct tile_pack_node *description, const void *bytes,
                                    struct errctx *err);
/* Sorts tiles by level, coarsest first, writes the index and puts the file in place. The writer is
 * gone afterwards, whatever the outcome. */
ST_MUST_CHECK enum st tile_pack_commit(struct tile_pack_writer *writer, uint64_t *out_file_bytes,
                                       struct errctx *err);
void tile_pack_abandon(struct tile_pack_writer *writer); /* takes NULL */

#ifdef __cplusplus
}
#endif
#endif
