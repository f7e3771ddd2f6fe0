/* Tests under umockdev: the program starts itself again with its library preloaded. */
#ifndef SC_TESTS_UMOCK_H
#define SC_TESTS_UMOCK_H

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

enum { UMOCK_SKIP = 77 };

/* First in main(): returns in the second run only, or with UMOCK_SKIP if there is no umockdev. The
 * address sanitizer is told to bear a library before its own. */
static inline int umock_enter(char **argv) {
    if (getenv("SCANCART_UMOCK"))
        return 0;
    const char *before = getenv("ASAN_OPTIONS");
    char asan[512];
    (void)snprintf(asan, sizeof asan, "%s:verify_asan_link_order=0", before ? before : "");
    if (access("/usr/bin/umockdev-wrapper", X_OK) || setenv("SCANCART_UMOCK", "1", 1) ||
        setenv("ASAN_OPTIONS", asan, 1) || setenv("LD_PRELOAD", "libumockdev-preload.so.0", 1)) {
        (void)printf("SKIP: no umockdev; install scripts/packages-test.txt\n");
        return UMOCK_SKIP;
    }
    (void)execv("/proc/self/exe", argv);
    perror("execv");
    return 1;
}

#endif
