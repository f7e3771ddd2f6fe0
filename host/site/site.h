/* The site folder: open, create, close, batches of changes, and where the site lies on the earth.
 *
 *   mysite/
 *     site.db      SQLite with a write-ahead log: every row listed in the headers of this folder
 *     writer.lock  held by the one process that writes; readers never touch it
 *     frames/      camera frames as received   } named by their SHA-256: see files.h
 *     photos/      3D photographs (TIFF)       }
 *     tiles/       packed tiles                }
 *
 * One process writes, any number read meanwhile. A `struct site` belongs to one thread at a time.
 * No function of this module is for the real-time path.
 *
 * Durability. A batch is on the disk when the call that ends it returns (write-ahead log,
 * synchronous=FULL: one flush a batch). So who ends a batch at least every 250 ms loses less than a
 * second to a power cut, and what is found afterwards is always a whole number of batches, in
 * order.
 *
 * Evidence. Every row carries the SHA-256 of its content; every table has a row count and the sum
 * of its row hashes in table `digest`; raw chunks and custody events form hash chains; files are
 * named by their hash. site_check() verifies all of it. Rows of raw data are never changed or
 * removed. */
#ifndef SC_SITE_SITE_H
#define SC_SITE_SITE_H

#include "base/st.h"
#include "base/vec.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    SITE_NAME_MAX = 64,      /* bytes of a name with its final 0 */
    SITE_KIND_MAX = 32,      /* bytes of a kind with its final 0 */
    SITE_TEXT_MAX = 1024,    /* bytes of a JSON remark or a custody detail with its final 0 */
    SITE_BLOB_MAX = 16 << 20 /* bytes of any one value in the database */
};

struct site; /* an open site */

enum site_mode {
    SITE_READ, /* changes no content; works on read-only media if the site was closed properly */
    SITE_WRITE /* the only writer; older schemas are brought up to date */
};

/* Where the world frame lies: p_crs = offset_m + p_world, axes parallel, in the coordinate system
 * `epsg`. The offset is the only place where large coordinates live. */
struct site_georef {
    int32_t epsg; /* 0: no georeference, the offset is then 0 */
    struct vec3 offset_m;
};

struct site_info {
    char name[SITE_NAME_MAX];
    struct site_georef georef;
    uint8_t uuid[16];       /* made by site_create() */
    int64_t created_utc_ns; /* made by site_create(); nanoseconds since 1970 */
    int32_t schema_version;
};

/* Makes the folder (its parent must exist) with an empty site in it and opens it for writing. From
 * `info` only name and georef are used; an empty name becomes the folder's. ST_EXISTS if `path` is
 * there and is not an empty folder, ST_INVALID for a bad name or georeference. A failed call leaves
 * nothing behind. */
ST_MUST_CHECK enum st site_create(const char *path, const struct site_info *info,
                                  struct site **out_site, struct errctx *err);

/* Opens a site. ST_NOT_FOUND: no site there. ST_BUSY: another process writes (the message names it)
 * and mode is SITE_WRITE. ST_UNSUPPORTED: made by a newer program, or older and not upgradable
 * here. ST_DAMAGED, ST_FORMAT: site.db is not what this program wrote. A failed call leaves nothing
 * behind. */
ST_MUST_CHECK enum st site_open(const char *path, enum site_mode mode, struct site **out_site,
                                struct errctx *err);

/* Ends the use of a site; takes NULL. A writer that changed something adds a "sealed" custody event
 * and folds the write-ahead log into site.db; an open batch is rolled back. The site is closed and
 * freed even if this returns an error, and nothing committed is ever lost by ignoring it. */
enum st site_close(struct site *site, struct errctx *err);

/* Who and what program stand in custody events; both are copied (cut at SITE_NAME_MAX - 1 bytes).
 * NULL keeps what is: before the first call the login name and "scancart VERSION". */
void site_set_actor(struct site *site, const char *who, const char *program);

/* Replaces the wall clock of this handle by a fixed time, nanoseconds since 1970, so that two runs
 * write the same rows. */
void site_set_clock(struct site *site, int64_t utc_ns);

ST_MUST_CHECK enum st site_get_info(struct site *site, struct site_info *out_info,
                                    struct errctx *err);

/* Sets the georeference; a custody event keeps the old one. */
ST_MUST_CHECK enum st site_set_georef(struct site *site, const struct site_georef *georef,
                                      struct errctx *err);

/* The folder as it was opened. Valid until site_close(). */
const char *site_path(const struct site *site);
enum site_mode site_mode_of(const struct site *site);

/* A batch: all changes between begin and commit are stored together or not at all, with one flush.
 * Every changing function outside a batch is a batch of its own. If one fails within a batch,
 * commit rolls back and returns that failure. Batches do not nest (ST_INVALID). */
ST_MUST_CHECK enum st site_begin(struct site *site, struct errctx *err);
ST_MUST_CHECK enum st site_commit(struct site *site, struct errctx *err);
void site_rollback(struct site *site);
/* A batch of the caller's is open. */
bool site_in_batch(const struct site *site);

/* True for a name: 1..SITE_NAME_MAX-1 bytes of UTF-8 without control characters, '/' or '\'. */
bool site_name_is_valid(const char *name);
/* True for a kind: 1..SITE_KIND_MAX-1 bytes of a-z, 0-9, '-', '_', '.'. */
bool site_kind_is_valid(const char *kind);

#ifdef __cplusplus
}
#endif
#endif
