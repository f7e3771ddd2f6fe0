/* A directory for the files of one test. */
#ifndef SC_TESTS_TEMPDIR_H
#define SC_TESTS_TEMPDIR_H

#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TEMPDIR_MAX = 512 };

/* Makes an empty directory; false if it cannot. */
static inline int tempdir_make(char out_dir[TEMPDIR_MAX]) {
    const char *base = getenv("TMPDIR");
    (void)snprintf(out_dir, TEMPDIR_MAX, "%s/scancart-test-XXXXXX", base && *base ? base : "/tmp");
    return mkdtemp(out_dir) != NULL;
}

static inline int tempdir_unlink(const char *path, const struct stat *info, int kind,
                                 struct FTW *at) {
    (void)info;
    (void)kind;
    (void)at;
    return remove(path);
}

/* Removes the directory and all in it; refuses what tempdir_make() did not make. */
static inline void tempdir_remove(const char *dir) {
    if (strstr(dir, "/scancart-test-"))
        (void)nftw(dir, tempdir_unlink, 16, FTW_DEPTH | FTW_PHYS);
}

#endif
