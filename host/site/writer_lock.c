#include "site/writer_lock.h"

#include "base/fileio.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

static enum st fail(struct errctx *err, int error, const char *path) {
    char reason[128];
    if (strerror_r(error, reason, sizeof reason))
        (void)snprintf(reason, sizeof reason, "error %d", error);
    return errctx_set(err, fileio_status(error), "cannot lock %s for writing: %s", path, reason);
}

/* What the holder wrote, made harmless for a terminal. */
static void read_holder(int fd, char *out_text, size_t capacity) {
    ssize_t n = pread(fd, out_text, capacity - 1, 0);
    out_text[n > 0 ? n : 0] = '\0';
    for (char *c = out_text; *c; c++)
        if (*c < ' ' || *c > '~')
            *c = '\0';
    if (!*out_text)
        (void)snprintf(out_text, capacity, "another process");
}

enum st writer_lock_take(const char *site_path, int *out_fd, struct errctx *err) {
    char path[FILEIO_PATH_MAX];
    enum st st = fileio_join(site_path, "writer.lock", path, err);
    if (st)
        return st;
    int fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
    if (fd < 0)
        return fail(err, errno, path);
    struct stat info;
    if (fstat(fd, &info) || !S_ISREG(info.st_mode)) {
        (void)close(fd);
        return errctx_set(err, ST_FORMAT, "%s is not a file", path);
    }
    if (flock(fd, LOCK_EX | LOCK_NB)) {
        int error = errno;
        char holder[128];
        read_holder(fd, holder, sizeof holder);
        (void)close(fd);
        if (error != EWOULDBLOCK)
            return fail(err, error, path);
        return errctx_set(err, ST_BUSY,
                          "%s is being written by %s; wait until it has ended, or end it",
                          site_path, holder);
    }
    char host[64] = "?", text[128];
    (void)gethostname(host, sizeof host - 1);
    int n = snprintf(text, sizeof text, "process %ld on %s\n", (long)getpid(), host);
    /* The text is for people: without it the lock holds as well. */
    if (ftruncate(fd, 0) || pwrite(fd, text, (size_t)n, 0) != n)
        (void)n;
    *out_fd = fd;
    return ST_OK;
}

void writer_lock_release(int fd) {
    if (fd < 0)
        return;
    if (ftruncate(fd, 0))
        (void)fd;
    (void)close(fd);
}
