#include "base/fileio.h"

#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

enum st fileio_status(int error) {
    switch (error) {
    case 0:
        return ST_OK;
    case ENOENT:
    case ENOTDIR:
        return ST_NOT_FOUND;
    case EACCES:
    case EPERM:
    case EROFS:
        return ST_PERMISSION;
    case EEXIST:
    case ENOTEMPTY:
        return ST_EXISTS;
    case ENOSPC:
    case EDQUOT:
        return ST_FULL;
    case ENOMEM:
        return ST_NOMEM;
    case EBUSY:
    case ETXTBSY:
        return ST_BUSY;
    case ENAMETOOLONG:
        return ST_INVALID;
    default:
        return ST_IO;
    }
}

/* "cannot VERB PATH: reason" */
static enum st fail(struct errctx *err, int error, const char *verb, const char *path) {
    char reason[128];
    if (strerror_r(error, reason, sizeof reason))
        (void)snprintf(reason, sizeof reason, "error %d", error);
    return errctx_set(err, fileio_status(error), "cannot %s %s: %s", verb, path, reason);
}

static enum st too_large(struct errctx *err, const char *path, size_t max_bytes) {
    return errctx_set(err, ST_FORMAT, "%s is larger than the %zu bytes such a file may have", path,
                      max_bytes);
}

/* Reads until the end, growing: the size that stat() told is a guess only. */
static enum st read_all(int fd, const char *path, size_t max_bytes, size_t guess_bytes,
                        uint8_t **out_data, size_t *out_size, struct errctx *err) {
    size_t room = guess_bytes + 1, used = 0; /* 1 for the 0 byte at the end */
    uint8_t *data = malloc(room + 1);
    if (!data)
        return fail(err, ENOMEM, "read", path);
    for (;;) {
        ssize_t n = read(fd, data + used, room - used);
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0) {
            int error = errno;
            free(data);
            return fail(err, error, "read", path);
        }
        if (n == 0)
            break;
        used += (size_t)n;
        if (used > max_bytes) {
            free(data);
            return too_large(err, path, max_bytes);
        }
        if (used == room) {
            room = room < max_bytes / 2 ? 2 * room : max_bytes + 1;
            uint8_t *grown = realloc(data, room + 1);
            if (!grown) {
                free(data);
                return fail(err, ENOMEM, "read", path);
            }
            data = grown;
        }
    }
    data[used] = 0;
    *out_data = data;
    *out_size = used;
    return ST_OK;
}

enum st fileio_read(const char *path, size_t max_bytes, uint8_t **out_data, size_t *out_size,
                    struct errctx *err) {
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return fail(err, errno, "read", path);
    struct stat info;
    enum st st;
    if (fstat(fd, &info))
        st = fail(err, errno, "read", path);
    else if (S_ISDIR(info.st_mode))
        st = fail(err, EISDIR, "read", path);
    else if (S_ISREG(info.st_mode) && (uint64_t)info.st_size > max_bytes)
        st = too_large(err, path, max_bytes);
    else
        st = read_all(fd, path, max_bytes, S_ISREG(info.st_mode) ? (size_t)info.st_size : 4096,
                      out_data, out_size, err);
    (void)close(fd);
    return st;
}

static enum st write_all(int fd, const char *path, const uint8_t *data, size_t size,
                         struct errctx *err) {
    while (size > 0) {
        ssize_t n = write(fd, data, size);
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            return fail(err, errno, "write", path);
        data += n;
        size -= (size_t)n;
    }
    return ST_OK;
}

/* Opens a new temporary file beside `path`, with the permissions any new file gets (which mkstemp()
 * does not). The name is free: O_EXCL says so. */
static enum st open_temp(const char *path, char out_temp[FILEIO_PATH_MAX], int *out_fd,
                         struct errctx *err) {
    static atomic_uint serial;
    enum { MAX_TRIES = 1000 }; /* leftovers of a crashed process that had our id */
    for (int i = 0; i < MAX_TRIES; i++) {
        int n = snprintf(out_temp, FILEIO_PATH_MAX, "%s.tmp-%ld-%u", path, (long)getpid(),
                         atomic_fetch_add(&serial, 1u));
        if (n < 0 || n >= FILEIO_PATH_MAX)
            return fail(err, ENAMETOOLONG, "write", path);
        int fd = open(out_temp, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (fd >= 0) {
            *out_fd = fd;
            return ST_OK;
        }
        if (errno != EEXIST)
            return fail(err, errno, "write", path);
    }
    return fail(err, EEXIST, "write", path);
}

enum st fileio_temp(const char *path, char out_temp[FILEIO_PATH_MAX], struct errctx *err) {
    int fd = -1;
    enum st st = open_temp(path, out_temp, &fd, err);
    if (!st)
        (void)close(fd);
    return st;
}

void fileio_abandon(const char *temp) {
    (void)unlink(temp);
}

/* True for what exists and is neither a regular file nor a directory: renaming over it would
 * destroy it. */
static bool is_special(const char *path) {
    struct stat info;
    return stat(path, &info) == 0 && !S_ISREG(info.st_mode) && !S_ISDIR(info.st_mode);
}

/* rename() and what makes it last. Removes the temporary file if it fails. */
static enum st put_in_place(const char *temp, const char *path, struct errctx *err) {
    if (rename(temp, path)) {
        enum st st = fail(err, errno, "write", path);
        fileio_abandon(temp);
        return st;
    }
    char dir[FILEIO_PATH_MAX];
    enum st st = fileio_dirname(path, dir, err);
    return st ? st : fileio_sync_dir(dir, err);
}

enum st fileio_commit(const char *temp, const char *path, struct errctx *err) {
    if (is_special(path)) {
        fileio_abandon(temp);
        return errctx_set(err, ST_INVALID, "cannot write %s: not a regular file", path);
    }
    int fd = open(temp, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return fail(err, errno, "write", path);
    int rc = fsync(fd);
    int error = errno;
    (void)close(fd);
    if (rc) {
        fileio_abandon(temp);
        return fail(err, error, "write", path);
    }
    return put_in_place(temp, path, err);
}

/* A pipe or a device is written to, not replaced. */
static enum st write_special(const char *path, const void *data, size_t size, struct errctx *err) {
    int fd = open(path, O_WRONLY | O_CLOEXEC);
    if (fd < 0)
        return fail(err, errno, "write", path);
    enum st st = write_all(fd, path, data, size, err);
    if (close(fd) && !st)
        st = fail(err, errno, "write", path);
    return st;
}

enum st fileio_write(const char *path, const void *data, size_t size, struct errctx *err) {
    if (is_special(path))
        return write_special(path, data, size, err);
    char temp[FILEIO_PATH_MAX];
    int fd = -1;
    enum st st = open_temp(path, temp, &fd, err);
    if (st)
        return st;
    st = write_all(fd, path, data, size, err);
    if (!st && fsync(fd))
        st = fail(err, errno, "write", path);
    if (close(fd) && !st)
        st = fail(err, errno, "write", path);
    if (st) {
        fileio_abandon(temp);
        return st;
    }
    return put_in_place(temp, path, err);
}

enum st fileio_join(const char *dir, const char *name, char out_path[FILEIO_PATH_MAX],
                    struct errctx *err) {
    size_t length = strlen(dir);
    bool alone = length == 0 || name[0] == '/';
    const char *slash = alone || dir[length - 1] == '/' ? "" : "/";
    int n = snprintf(out_path, FILEIO_PATH_MAX, "%s%s%s", alone ? "" : dir, slash, name);
    if (n < 0 || n >= FILEIO_PATH_MAX)
        return errctx_set(err, ST_INVALID, "path is too long: %.80s.../%.80s", dir, name);
    return ST_OK;
}

enum st fileio_dirname(const char *path, char out_dir[FILEIO_PATH_MAX], struct errctx *err) {
    size_t n = strlen(path);
    while (n > 1 && path[n - 1] == '/')
        n--;
    while (n > 0 && path[n - 1] != '/')
        n--;
    while (n > 1 && path[n - 1] == '/')
        n--;
    const char *from = n ? path : ".";
    n = n ? n : 1;
    if (n >= FILEIO_PATH_MAX)
        return errctx_set(err, ST_INVALID, "path is too long: %.80s...", path);
    memcpy(out_dir, from, n);
    out_dir[n] = '\0';
    return ST_OK;
}

const char *fileio_basename(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

bool fileio_exists(const char *path) {
    struct stat info;
    return stat(path, &info) == 0;
}

bool fileio_is_dir(const char *path) {
    struct stat info;
    return stat(path, &info) == 0 && S_ISDIR(info.st_mode);
}

enum st fileio_size(const char *path, uint64_t *out_bytes, struct errctx *err) {
    struct stat info;
    if (stat(path, &info))
        return fail(err, errno, "read", path);
    if (!S_ISREG(info.st_mode))
        return errctx_set(err, ST_INVALID, "%s is not a file", path);
    *out_bytes = (uint64_t)info.st_size;
    return ST_OK;
}

enum st fileio_mkdir(const char *path, struct errctx *err) {
    if (mkdir(path, 0777))
        return fail(err, errno, "make directory", path);
    return ST_OK;
}

enum st fileio_mkdirs(const char *path, struct errctx *err) {
    char part[FILEIO_PATH_MAX];
    size_t n = strlen(path);
    if (n >= sizeof part)
        return fail(err, ENAMETOOLONG, "make directory", path);
    for (size_t i = 1; i <= n; i++) {
        if (path[i] != '/' && path[i] != '\0')
            continue;
        memcpy(part, path, i);
        part[i] = '\0';
        if (mkdir(part, 0777)) {
            int error = errno;
            if (!fileio_is_dir(part))
                return fail(err, error, "make directory", part);
        }
    }
    return ST_OK;
}

enum st fileio_sync_dir(const char *path, struct errctx *err) {
    int fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0)
        return fail(err, errno, "sync", path);
    int rc = fsync(fd);
    int error = errno;
    (void)close(fd);
    /* Some file systems cannot sync a directory and say EINVAL; there is no more to be done there.
     */
    if (rc && error != EINVAL)
        return fail(err, error, "sync", path);
    return ST_OK;
}

enum st fileio_remove(const char *path, struct errctx *err) {
    if (unlink(path) && errno != ENOENT)
        return fail(err, errno, "remove", path);
    return ST_OK;
}
