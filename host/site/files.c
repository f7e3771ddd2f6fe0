#include "site/files.h"

#include "base/fileio.h"
#include "site/batch.h"
#include "site/files_dir.h"
#include "site/store.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* ST_NOT_FOUND without a message. */
static enum st find_entry(struct site *site, const uint8_t sha256[HASH_SHA256_BYTES],
                          struct files_entry *out_entry, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    enum st st = store_query(site, "SELECT * FROM file WHERE sha256 = ?1", NULL, 0, &stmt, err);
    struct row_value value = row_blob(sha256, HASH_SHA256_BYTES);
    if (!st)
        st = row_bind(stmt, 1, &value);
    if (!st)
        st = store_fetch(site, stmt, STORE_FILE, err);
    if (st)
        return st;
    st = files_dir_entry(stmt, out_entry, err);
    (void)sqlite3_reset(stmt);
    return st;
}

enum st files_find(struct site *site, const uint8_t sha256[HASH_SHA256_BYTES],
                   struct files_entry *out_entry, struct errctx *err) {
    enum st st = find_entry(site, sha256, out_entry, err);
    if (st != ST_NOT_FOUND)
        return st;
    char hex[HASH_HEX_CHARS];
    hash_to_hex(sha256, hex);
    return errctx_set(err, st, "%s has no file %s", site->path, hex);
}

static enum st entry_path(struct site *site, const struct files_entry *entry,
                          char out_path[FILEIO_PATH_MAX], struct errctx *err) {
    char name[FILES_DIR_NAME_MAX];
    files_dir_file(entry, name);
    return fileio_join(site->path, name, out_path, err);
}

enum st files_path(struct site *site, const uint8_t sha256[HASH_SHA256_BYTES],
                   char out_path[FILEIO_PATH_MAX], struct errctx *err) {
    struct files_entry entry;
    enum st st = files_find(site, sha256, &entry, err);
    return st ? st : entry_path(site, &entry, out_path, err);
}

static enum st check_new(enum files_kind kind, const char *extension, int64_t size_bytes,
                         struct errctx *err) {
    if (!files_dir_name((int)kind) || !files_dir_extension_is_valid(extension))
        return errctx_set(err, ST_INVALID, "'%.20s' cannot be the extension of a site's file",
                          extension);
    if (size_bytes < 1 || size_bytes > FILES_MAX_BYTES)
        return errctx_set(err, ST_INVALID, "a file of %lld bytes; 1 byte to 4 GiB can be stored",
                          (long long)size_bytes);
    return ST_OK;
}

static enum st make_dir(struct site *site, enum files_kind kind, char out_dir[FILEIO_PATH_MAX],
                        struct errctx *err) {
    enum st st = fileio_join(site->path, files_dir_name((int)kind), out_dir, err);
    return st ? st : fileio_mkdirs(out_dir, err);
}

/* True if the path holds exactly these bytes: left by a writer that crashed before the row was
 * written. */
static bool is_intact(const char *path, const uint8_t sha256[HASH_SHA256_BYTES]) {
    uint8_t is[HASH_SHA256_BYTES];
    uint64_t size = 0;
    return fileio_exists(path) && !hash_file(path, is, &size, NULL) &&
           !memcmp(is, sha256, sizeof is);
}

static enum st insert_entry(struct site *site, const struct files_entry *entry,
                            struct errctx *err) {
    struct row_value values[] = {row_int(0),
                                 row_int((int64_t)entry->kind),
                                 row_blob(entry->sha256, sizeof entry->sha256),
                                 row_text(entry->extension),
                                 row_int(entry->size_bytes),
                                 row_int(store_now_utc_ns(site))};
    enum st st = batch_begin(site, err);
    if (st)
        return st;
    st = store_insert(site, STORE_FILE, values, 6, NULL, NULL, err);
    return batch_end(site, st, err);
}

/* Where the bytes belong: *out_known if they have a row already. A known file that was lost is put
 * back. */
static enum st place(struct site *site, struct files_entry *entry, const char *extension,
                     char out_path[FILEIO_PATH_MAX], bool *out_known, struct errctx *err) {
    struct files_entry known;
    enum st st = find_entry(site, entry->sha256, &known, err);
    *out_known = !st;
    if (!st)
        *entry = known;
    else if (st == ST_NOT_FOUND) {
        memcpy(entry->extension, extension, strlen(extension) + 1);
        st = ST_OK;
    }
    char dir[FILEIO_PATH_MAX];
    if (!st)
        st = make_dir(site, entry->kind, dir, err);
    return st ? st : entry_path(site, entry, out_path, err);
}

static enum st writable(struct site *site, struct errctx *err) {
    return site->mode == SITE_WRITE
               ? ST_OK
               : errctx_set(err, ST_PERMISSION, "%s is open for reading only", site->path);
}

enum st files_put(struct site *site, enum files_kind kind, const char *extension, const void *bytes,
                  size_t size_bytes, uint8_t out_sha256[HASH_SHA256_BYTES], struct errctx *err) {
    struct files_entry entry = {.kind = kind, .size_bytes = (int64_t)size_bytes};
    char path[FILEIO_PATH_MAX];
    bool known = false;
    enum st st = writable(site, err);
    if (!st)
        st = check_new(kind, extension, (int64_t)size_bytes, err);
    if (!st && hash_sha256(bytes, size_bytes, entry.sha256))
        st = errctx_set(err, ST_NOMEM, "cannot hash a file");
    if (!st)
        st = place(site, &entry, extension, path, &known, err);
    if (!st && !(known ? fileio_exists(path) : is_intact(path, entry.sha256)))
        st = fileio_write(path, bytes, size_bytes, err);
    if (!st && !known)
        st = insert_entry(site, &entry, err);
    if (!st)
        memcpy(out_sha256, entry.sha256, sizeof entry.sha256);
    return st;
}

enum st files_temp_path(struct site *site, enum files_kind kind, const char *extension,
                        char out_path[FILEIO_PATH_MAX], struct errctx *err) {
    char dir[FILEIO_PATH_MAX], name[16] = "new.", path[FILEIO_PATH_MAX];
    enum st st = writable(site, err);
    if (!st)
        st = check_new(kind, extension, 1, err);
    if (!st)
        st = make_dir(site, kind, dir, err);
    if (st)
        return st;
    memcpy(name + 4, extension, strlen(extension) + 1);
    st = fileio_join(dir, name, path, err);
    return st ? st : fileio_temp(path, out_path, err);
}

enum st files_adopt(struct site *site, enum files_kind kind, const char *extension,
                    const char *temp_path, uint8_t out_sha256[HASH_SHA256_BYTES],
                    struct errctx *err) {
    struct files_entry entry = {.kind = kind};
    char path[FILEIO_PATH_MAX];
    uint64_t size = 0;
    bool known = false;
    enum st st = writable(site, err);
    if (!st)
        st = hash_file(temp_path, entry.sha256, &size, err);
    entry.size_bytes = size > (uint64_t)FILES_MAX_BYTES ? INT64_MAX : (int64_t)size;
    if (!st)
        st = check_new(kind, extension, entry.size_bytes, err);
    if (!st)
        st = place(site, &entry, extension, path, &known, err);
    if (!st && known && fileio_exists(path))
        fileio_abandon(temp_path);
    else if (!st)
        st = fileio_commit(temp_path, path, err);
    if (!st && !known)
        st = insert_entry(site, &entry, err);
    if (st)
        fileio_abandon(temp_path);
    else
        memcpy(out_sha256, entry.sha256, sizeof entry.sha256);
    return st;
}

enum st files_read(struct site *site, const uint8_t sha256[HASH_SHA256_BYTES], uint8_t **out_bytes,
                   size_t *out_size_bytes, struct errctx *err) {
    char path[FILEIO_PATH_MAX];
    struct files_entry entry;
    uint8_t *bytes = NULL, is[HASH_SHA256_BYTES];
    size_t size = 0;
    enum st st = files_find(site, sha256, &entry, err);
    if (!st)
        st = entry_path(site, &entry, path, err);
    if (!st)
        st = fileio_read(path, (size_t)entry.size_bytes, &bytes, &size, err);
    if (st)
        return st == ST_FORMAT ? errctx_set(err, ST_DAMAGED, "%s is longer than it was", path) : st;
    if (hash_sha256(bytes, size, is))
        st = errctx_set(err, ST_NOMEM, "cannot hash %s", path);
    else if (memcmp(is, sha256, sizeof is) != 0)
        st =
            errctx_set(err, ST_DAMAGED, "%s is damaged: its content does not match its name", path);
    if (st) {
        free(bytes);
        return st;
    }
    *out_bytes = bytes;
    *out_size_bytes = size;
    return ST_OK;
}

static enum st list_files_dir_entry(struct site *site, sqlite3_stmt *stmt, void *out_row,
                                    struct errctx *err) {
    (void)site;
    return files_dir_entry(stmt, out_row, err);
}

enum st files_list(struct site *site, enum files_kind kind, int64_t after_id,
                   struct files_entry *out_entries, size_t capacity, size_t *out_count,
                   struct errctx *err) {
    const int64_t numbers[2] = {after_id, (int64_t)kind};
    return store_list(site,
                      "SELECT * FROM file WHERE id > ?1 AND (?2 = 0 OR kind = ?2) ORDER BY id",
                      numbers, 2, STORE_FILE, list_files_dir_entry, out_entries,
                      sizeof *out_entries, capacity, out_count, err);
}
