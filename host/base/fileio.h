/* Files: bounded reads, writes that are either whole or not there, paths, directories. Every
 * message names the path and the operating system's reason. */
#ifndef SC_BASE_FILEIO_H
#define SC_BASE_FILEIO_H

#include "base/st.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Longest path, with its terminating 0. */
enum { FILEIO_PATH_MAX = 4096 };

/* The status that stands for an errno value. */
enum st fileio_status(int error);

/* Reads a whole regular file (or pipe) of at most max_bytes. *out_data is malloc'ed, *out_size
 * bytes and one 0 byte after them, so that text can be used as a string. ST_NOT_FOUND,
 * ST_PERMISSION, ST_IO, ST_NOMEM; ST_FORMAT if the file is larger. */
ST_MUST_CHECK enum st fileio_read(const char *path, size_t max_bytes, uint8_t **out_data,
                                  size_t *out_size, struct errctx *err);

/* Writes a file so that after a power loss at any instant the old content or the new is there:
 * temporary file beside it, fsync, rename, fsync of the directory. A pipe or a device is simply
 * written to. ST_FULL if the disk is full. */
ST_MUST_CHECK enum st fileio_write(const char *path, const void *data, size_t size,
                                   struct errctx *err);

/* The same for libraries that write by themselves: fileio_temp() makes an empty file beside `path`
 * and gives its name; fill it, close it, then fileio_commit() puts it in place of `path` (removing
 * it on failure) or fileio_abandon() removes it. */
ST_MUST_CHECK enum st fileio_temp(const char *path, char out_temp[FILEIO_PATH_MAX],
                                  struct errctx *err);
ST_MUST_CHECK enum st fileio_commit(const char *temp, const char *path, struct errctx *err);
void fileio_abandon(const char *temp);

/* dir/name; an empty dir or an absolute name gives name. ST_INVALID if it does not fit. */
ST_MUST_CHECK enum st fileio_join(const char *dir, const char *name, char out_path[FILEIO_PATH_MAX],
                                  struct errctx *err);

/* The directory part of a path ("." if none, "/" for the root); what follows the last slash. */
ST_MUST_CHECK enum st fileio_dirname(const char *path, char out_dir[FILEIO_PATH_MAX],
                                     struct errctx *err);
const char *fileio_basename(const char *path);

bool fileio_exists(const char *path);
bool fileio_is_dir(const char *path);

/* Size of a regular file. */
ST_MUST_CHECK enum st fileio_size(const char *path, uint64_t *out_bytes, struct errctx *err);

/* Makes a directory; ST_EXISTS if anything of that name is there. fileio_mkdirs() makes the parents
 * too and is content with a directory that exists. Neither syncs: fileio_sync_dir() does. */
ST_MUST_CHECK enum st fileio_mkdir(const char *path, struct errctx *err);
ST_MUST_CHECK enum st fileio_mkdirs(const char *path, struct errctx *err);
ST_MUST_CHECK enum st fileio_sync_dir(const char *path, struct errctx *err);

/* Removes a file; one that is not there is no error. */
ST_MUST_CHECK enum st fileio_remove(const char *path, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
