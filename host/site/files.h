/* Files of a site, stored once under the hash of their bytes: frames/<sha256>.jpg,
 * photos/<sha256>.tif, tiles/<sha256>.<ext>. The file is complete and flushed before its row
 * exists; a crash in between leaves a file without a row, which site_check() reports as a warning
 * and which the next files_put() of the same bytes takes. */
#ifndef SC_SITE_FILES_H
#define SC_SITE_FILES_H

#include "base/fileio.h"
#include "base/hash.h"
#include "base/st.h"
#include "site/site.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum files_kind {
    FILES_FRAME = 1, /* frames/ */
    FILES_PHOTO = 2, /* photos/ */
    FILES_TILES = 3  /* tiles/ */
};

/* Bytes in one file at the most. */
#define FILES_MAX_BYTES ((int64_t)4 << 30)

struct files_entry {
    int64_t id;
    enum files_kind kind;
    uint8_t sha256[HASH_SHA256_BYTES];
    char extension[8]; /* without the dot, lower case: "jpg", "png", "tif" */
    int64_t size_bytes;
    int64_t utc_ns;
};

/* Stores bytes. Bytes that the site has already, of whatever kind, cost a look-up. ST_INVALID for
 * an empty file or an extension that is not 1..7 of a-z 0-9; ST_FULL, ST_IO: nothing is stored. */
ST_MUST_CHECK enum st files_put(struct site *site, enum files_kind kind, const char *extension,
                                const void *bytes, size_t size_bytes,
                                uint8_t out_sha256[HASH_SHA256_BYTES], struct errctx *err);

/* The same for a file that is there already, for writers that need a path: write to
 * files_temp_path(), then adopt it. The file is flushed, hashed and renamed into the site; on
 * failure it is left where it is. */
ST_MUST_CHECK enum st files_temp_path(struct site *site, enum files_kind kind,
                                      const char *extension, char out_path[FILEIO_PATH_MAX],
                                      struct errctx *err);
ST_MUST_CHECK enum st files_adopt(struct site *site, enum files_kind kind, const char *extension,
                                  const char *temp_path, uint8_t out_sha256[HASH_SHA256_BYTES],
                                  struct errctx *err);

/* The row of a file; ST_NOT_FOUND. */
ST_MUST_CHECK enum st files_find(struct site *site, const uint8_t sha256[HASH_SHA256_BYTES],
                                 struct files_entry *out_entry, struct errctx *err);

/* Its path: the site's path with frames/<sha256>.<ext> and so on behind it. ST_NOT_FOUND without a
 * row. */
ST_MUST_CHECK enum st files_path(struct site *site, const uint8_t sha256[HASH_SHA256_BYTES],
                                 char out_path[FILEIO_PATH_MAX], struct errctx *err);

/* Reads a file whole and verifies its hash: ST_DAMAGED with the path, ST_NOT_FOUND if row or file
 * is missing. *out_bytes is malloc'ed, the caller frees it. */
ST_MUST_CHECK enum st files_read(struct site *site, const uint8_t sha256[HASH_SHA256_BYTES],
                                 uint8_t **out_bytes, size_t *out_size_bytes, struct errctx *err);

/* Pages through the files of a kind (0: all) in the order of id, see station_list(). */
ST_MUST_CHECK enum st files_list(struct site *site, enum files_kind kind, int64_t after_id,
                                 struct files_entry *out_entries, size_t capacity,
                                 size_t *out_count, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
