#include "site/check_files.h"

#include "base/fileio.h"
#include "site/files_dir.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

bool check_files_no_writer(const char *site_path) {
    char path[FILEIO_PATH_MAX];
    if (fileio_join(site_path, "writer.lock", path, NULL))
        return true;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (fd < 0)
        return true;
    bool is_free = flock(fd, LOCK_SH | LOCK_NB) == 0;
    (void)close(fd);
    return is_free;
}

/* One file against its row. */
static void check_file(struct check_walk *walk, const struct files_entry *entry) {
    char name[FILES_DIR_NAME_MAX], path[FILEIO_PATH_MAX];
    uint8_t sha256[HASH_SHA256_BYTES];
    uint64_t size = 0;
    struct stat info;
    struct errctx why = {0};
    files_dir_file(entry, name);
    walk->result.files++;
    if (fileio_join(walk->site->path, name, path, &why))
        check_walk_error(walk, name, "%.200s", why.text);
    else if (lstat(path, &info))
        check_walk_error(walk, name, "%s", errno == ENOENT ? "is missing" : "cannot be read");
    else if (!S_ISREG(info.st_mode))
        check_walk_error(walk, name, "is not a file");
    else if (info.st_size != entry->size_bytes)
        check_walk_error(walk, name, "has %lld bytes, %lld were written", (long long)info.st_size,
                         (long long)entry->size_bytes);
    else if (hash_file(path, sha256, &size, &why))
        check_walk_error(walk, name, "%.200s", why.text);
    else if (memcmp(sha256, entry->sha256, sizeof sha256) != 0)
        check_walk_error(walk, name, "is not as written (its content does not match its name)");
    walk->result.bytes += (int64_t)size;
}

/* Rows that make no sense are reported by the walk over the tables. */
static enum st check_known(struct check_walk *walk) {
    sqlite3_stmt *stmt = NULL;
    enum st st = ST_OK;
    if (sqlite3_prepare_v2(walk->site->db, "SELECT * FROM file ORDER BY id", -1, &stmt, NULL))
        return ST_OK;
    while (!st && sqlite3_step(stmt) == SQLITE_ROW) {
        struct files_entry entry;
        if (files_dir_entry(stmt, &entry, NULL))
            continue;
        check_file(walk, &entry);
        st = check_walk_progress(walk, entry.size_bytes);
    }
    (void)sqlite3_finalize(stmt);
    return st;
}

/* A name in one of the folders: known, a leftover, or foreign. */
static void check_name(struct check_walk *walk, int kind, const char *name) {
    char hex[HASH_HEX_CHARS] = "", where[160], known[FILES_DIR_NAME_MAX];
    struct files_entry entry;
    uint8_t sha256[HASH_SHA256_BYTES];
    (void)snprintf(where, sizeof where, "%s/%.120s", files_dir_name(kind), name);
    if (files_dir_is_leftover(name)) {
        if (check_files_no_writer(walk->site->path))
            check_walk_warning(walk, where, "left by a write that was interrupted");
        return;
    }
    (void)snprintf(hex, sizeof hex, "%.64s", name);
    bool is_known = !hash_from_hex(hex, sha256) && !files_find(walk->site, sha256, &entry, NULL);
    if (is_known)
        files_dir_file(&entry, known);
    if (!is_known || strcmp(known, where) != 0)
        check_walk_warning(walk, where, "the site does not know this file");
}

static enum st check_folder(struct check_walk *walk, int kind) {
    char path[FILEIO_PATH_MAX];
    struct dirent **names = NULL;
    if (fileio_join(walk->site->path, files_dir_name(kind), path, NULL))
        return ST_OK;
    int count = scandir(path, &names, NULL, alphasort);
    enum st st = ST_OK;
    for (int i = 0; i < count; i++) {
        bool dots = !strcmp(names[i]->d_name, ".") || !strcmp(names[i]->d_name, "..");
        if (!st && !dots) {
            check_name(walk, kind, names[i]->d_name);
            st = check_walk_progress(walk, 0);
        }
        free(names[i]);
    }
    free(names);
    return st;
}

enum st check_files(struct check_walk *walk) {
    sqlite3_stmt *stmt = NULL;
    if (!store_query(walk->site, "SELECT total(size_bytes) FROM file", NULL, 0, &stmt, NULL) &&
        sqlite3_step(stmt) == SQLITE_ROW) {
        double total = sqlite3_column_double(stmt, 0);
        walk->total_bytes += total > 0 && total < 1e18 ? (int64_t)total : 0;
    }
    (void)sqlite3_reset(stmt);
    enum st st = check_known(walk);
    for (int kind = 1; kind <= FILES_DIR_KINDS && !st; kind++)
        st = check_folder(walk, kind);
    return st;
}
