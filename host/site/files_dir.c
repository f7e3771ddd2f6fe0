#include "site/files_dir.h"

#include <dirent.h>
#include <stdio.h>
#include <string.h>

const char *files_dir_name(int kind) {
    switch (kind) {
    case FILES_FRAME:
        return "frames";
    case FILES_PHOTO:
        return "photos";
    case FILES_TILES:
        return "tiles";
    default:
        return NULL;
    }
}

bool files_dir_extension_is_valid(const char *extension) {
    size_t n = strspn(extension, "abcdefghijklmnopqrstuvwxyz0123456789");
    return n >= 1 && n <= 7 && extension[n] == '\0';
}

void files_dir_file(const struct files_entry *entry, char out_name[FILES_DIR_NAME_MAX]) {
    char hex[HASH_HEX_CHARS];
    hash_to_hex(entry->sha256, hex);
    (void)snprintf(out_name, FILES_DIR_NAME_MAX, "%s/%s.%s", files_dir_name((int)entry->kind), hex,
                   entry->extension);
}

bool files_dir_is_leftover(const char *name) {
    return strstr(name, ".tmp-") != NULL;
}

static void sweep_one(const char *dir_path) {
    DIR *dir = opendir(dir_path);
    if (!dir)
        return;
    for (struct dirent *entry = readdir(dir); entry; entry = readdir(dir)) {
        char path[FILEIO_PATH_MAX];
        if (files_dir_is_leftover(entry->d_name) &&
            !fileio_join(dir_path, entry->d_name, path, NULL))
            fileio_abandon(path);
    }
    (void)closedir(dir);
}

void files_dir_sweep(const char *site_path) {
    for (int kind = 1; kind <= FILES_DIR_KINDS; kind++) {
        char path[FILEIO_PATH_MAX];
        if (!fileio_join(site_path, files_dir_name(kind), path, NULL))
            sweep_one(path);
    }
}

/* Columns: id kind sha256 extension size_bytes utc_ns. */
enum st files_dir_entry(sqlite3_stmt *stmt, struct files_entry *out_entry, struct errctx *err) {
    struct files_entry entry = {.id = sqlite3_column_int64(stmt, 0),
                                .size_bytes = sqlite3_column_int64(stmt, 4),
                                .utc_ns = sqlite3_column_int64(stmt, 5)};
    int32_t kind = 0;
    enum st st = row_get_int32(stmt, 1, &kind, err);
    if (!st)
        st = row_get_blob(stmt, 2, entry.sha256, sizeof entry.sha256, err);
    if (!st)
        st = row_get_text(stmt, 3, entry.extension, sizeof entry.extension, err);
    if (!st && (!files_dir_name(kind) || !files_dir_extension_is_valid(entry.extension) ||
                entry.size_bytes < 1 || entry.size_bytes > FILES_MAX_BYTES))
        st = errctx_set(err, ST_DAMAGED, "site.db: table file, row %lld makes no sense",
                        (long long)entry.id);
    if (st)
        return st;
    entry.kind = (enum files_kind)kind;
    *out_entry = entry;
    return ST_OK;
}
