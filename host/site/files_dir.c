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
