/* A directory for the files of one test. */
#ifndef SC_TESTS_TEMPDIR_H
#define SC_TESTS_TEMPDIR_H

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum { TEMPDIR_MAX = 512 };

/* Makes an empty directory; false if it cannot. */
static inline int tempdir_make(char out_dir[TEMPDIR_MAX]) {
    const char *base = getenv("TMPDIR");
    (void)snprintf(out_dir, TEMPDIR_MAX, "%s/scancart-test-XXXXXX", base && *base ? base : "/tmp");
    return mkdtemp(out_dir) != NULL;
}

/* Removes the directory and all in it; refuses what tempdir_make() did not make. */
static inline void tempdir_remove(const char *dir) {
    DIR *entries = strstr(dir, "/scancart-test-") ? opendir(dir) : NULL;
    if (!entries)
        return;
    for (struct dirent *e = readdir(entries); e; e = readdir(entries)) {
        char path[4096];
        struct stat info;
        int n = snprintf(path, sizeof path, "%s/%s", dir, e->d_name);
        if (n < 0 || n >= (int)sizeof path || !strcmp(e->d_name, ".") || !strcmp(e->d_name, "..") ||
            lstat(path, &info))
            continue;
        if (S_ISDIR(info.st_mode))
            tempdir_remove(path);
        else
            (void)unlink(path);
    }
    (void)closedir(entries);
    (void)rmdir(dir);
}

#endif
