#include "import/source_file.h"

#include "base/fileio.h"
#include "site/files.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void source_file_destroy(struct source_file *file) {
    if (!file)
        return;
    free(file->bytes);
    memset(file, 0, sizeof *file);
}

static bool is_plain(char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9');
}

static void split_name(const char *path, struct source_file *file) {
    const char *name = fileio_basename(path);
    const char *dot = strrchr(name, '.');
    const size_t stem = dot && dot > name ? (size_t)(dot - name) : strlen(name);
    (void)snprintf(file->stem, sizeof file->stem, "%.*s", (int)(stem < 60 ? stem : 60), name);
    if (!site_name_is_valid(file->stem))
        (void)snprintf(file->stem, sizeof file->stem, "import");
    (void)snprintf(file->extension, sizeof file->extension, "bin");
    if (!dot || dot == name || !dot[1] || strlen(dot + 1) >= sizeof file->extension)
        return;
    char lower[sizeof file->extension] = {0};
    for (size_t i = 0; dot[1 + i]; i++) {
        const char c = dot[1 + i];
        lower[i] = (char)(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
        if (!is_plain(lower[i]))
            return;
    }
    memcpy(file->extension, lower, sizeof lower);
}

enum st source_file_read(const char *path, size_t max_bytes, struct source_file *out_file,
                         struct errctx *err) {
    struct source_file file;
    memset(&file, 0, sizeof file);
    enum st st = fileio_read(path, max_bytes, &file.bytes, &file.size, err);
    if (st)
        return st;
    if (file.size == 0) {
        source_file_destroy(&file);
        return errctx_set(err, ST_FORMAT, "%s: the file is empty", path);
    }
    split_name(path, &file);
    *out_file = file;
    return ST_OK;
}

enum st source_file_put(struct site *site, const struct source_file *file, const char *role,
                        struct job_hash *out_input, struct errctx *err) {
    struct job_hash input;
    memset(&input, 0, sizeof input);
    (void)snprintf(input.role, sizeof input.role, "%s", role);
    enum st st =
        files_put(site, FILES_FRAME, file->extension, file->bytes, file->size, input.sha256, err);
    if (st)
        return st;
    *out_input = input;
    return ST_OK;
}
