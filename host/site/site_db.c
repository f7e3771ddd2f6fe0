#include "site/site_db.h"

#include "base/fileio.h"
#include "site/files_dir.h"
#include "site/migrate.h"
#include "site/writer_lock.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static enum st fail(struct errctx *err, int error, const char *path) {
    char reason[128];
    if (strerror_r(error, reason, sizeof reason))
        (void)snprintf(reason, sizeof reason, "error %d", error);
    return errctx_set(err, fileio_status(error), "cannot open %s: %s", path, reason);
}

enum st site_db_identify(const char *site_path, struct errctx *err) {
    char path[FILEIO_PATH_MAX];
    enum st st = fileio_join(site_path, "site.db", path, err);
    if (st)
        return st;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0 && (errno == ENOENT || errno == ENOTDIR))
        return errctx_set(err, ST_NOT_FOUND,
                          "%s is not a site (it has no site.db); 'scancart new' makes one",
                          site_path);
    if (fd < 0)
        return fail(err, errno, path);
    char magic[16] = "";
    struct stat info;
    if (fstat(fd, &info))
        st = fail(err, errno, path);
    else if (!S_ISREG(info.st_mode))
        st = errctx_set(err, ST_FORMAT, "%s is not a file", path);
    else if (read(fd, magic, sizeof magic) != sizeof magic ||
             memcmp(magic, "SQLite format 3", sizeof magic) != 0)
        st = errctx_set(err, ST_FORMAT, "%s is damaged or not a site: it is no SQLite database",
                        path);
    (void)close(fd);
    return st;
}

/* The single integer a pragma answers. */
static enum st pragma_int(struct site *site, const char *sql, int64_t *out_value,
                          struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    enum st st = store_query(site, sql, NULL, 0, &stmt, err);
    if (st)
        return st;
    if (sqlite3_step(stmt) == SQLITE_ROW)
        *out_value = sqlite3_column_int64(stmt, 0);
    else
        st = store_error(site, err, "read");
    (void)sqlite3_reset(stmt);
    return st;
}

enum st site_db_version(struct site *site, struct errctx *err) {
    int64_t application = 0, version = 0;
    enum st st = pragma_int(site, "PRAGMA application_id", &application, err);
    if (!st)
        st = pragma_int(site, "PRAGMA user_version", &version, err);
    if (st)
        return st;
    if (application != MIGRATE_APPLICATION_ID || version < 1)
        return errctx_set(err, ST_FORMAT, "%s/site.db is damaged or not made by scancart",
                          site->path);
    if (version > MIGRATE_NEWEST)
        return errctx_set(err, ST_UNSUPPORTED,
                          "%s/site.db has schema version %lld, this scancart knows up to %d; use a "
                          "newer scancart",
                          site->path, (long long)version, MIGRATE_NEWEST);
    site->schema_version = (int32_t)version;
    return ST_OK;
}

/* The log is folded into site.db when it has grown to 64 MiB: large enough that the pages of an
 * index are written once for many batches, small enough to fit where the site fits. */
enum { LOG_PAGES = (64 << 20) / STORE_PAGE_BYTES };

enum st site_db_prepare_writer(struct site *site, struct errctx *err) {
    char sql[256];
    (void)snprintf(sql, sizeof sql,
                   "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;"
                   "PRAGMA wal_autocheckpoint = %d; PRAGMA journal_size_limit = %d;"
                   "PRAGMA foreign_keys = ON",
                   LOG_PAGES, 2 * LOG_PAGES * STORE_PAGE_BYTES);
    return store_exec(site, sql, err);
}

enum st site_db_prepare_new(struct site *site, struct errctx *err) {
    char sql[64];
    (void)snprintf(sql, sizeof sql, "PRAGMA page_size = %d", STORE_PAGE_BYTES);
    enum st st = store_exec(site, sql, err);
    return st ? st : site_db_prepare_writer(site, err);
}

/* Names that an interrupted site_create() may leave. */
static bool is_ours(const char *name) {
    static const char *const names[] = {".",      "..",     "writer.lock", SITE_DB_NEW,
                                        "frames", "photos", "tiles"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (!strcmp(name, names[i]))
            return true;
    return !strcmp(name, SITE_DB_NEW "-wal") || !strcmp(name, SITE_DB_NEW "-shm") ||
           !strcmp(name, SITE_DB_NEW "-journal");
}

static enum st must_be_empty(const char *path, struct errctx *err) {
    DIR *dir = opendir(path);
    if (!dir)
        return errno == ENOTDIR ? errctx_set(err, ST_EXISTS, "%s exists and is not a folder", path)
                                : fail(err, errno, path);
    enum st st = ST_OK;
    for (struct dirent *entry = readdir(dir); entry && !st; entry = readdir(dir)) {
        if (!strcmp(entry->d_name, "site.db"))
            st = errctx_set(err, ST_EXISTS, "%s is a site already", path);
        else if (!is_ours(entry->d_name))
            st = errctx_set(err, ST_EXISTS, "%s exists and is not empty (it holds %s)", path,
                            entry->d_name);
    }
    (void)closedir(dir);
    return st;
}

static void remove_new_files(struct site *site) {
    static const char *const ends[] = {"", "-wal", "-shm", "-journal"};
    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
        char path[FILEIO_PATH_MAX + 32];
        (void)snprintf(path, sizeof path, "%s/%s%s", site->path, SITE_DB_NEW, ends[i]);
        (void)unlink(path);
    }
}

enum st site_db_make_folder(struct site *site, struct site_db_new *out_made, struct errctx *err) {
    enum st st = fileio_mkdir(site->path, err);
    if (!st)
        out_made->folder = true;
    else if (st == ST_EXISTS)
        st = must_be_empty(site->path, err);
    if (!st)
        st = writer_lock_take(site->path, &site->lock_fd, err);
    if (st)
        return st;
    out_made->locked = true;
    st = must_be_empty(site->path, err); /* again: now nobody else makes one here */
    if (!st)
        remove_new_files(site);
    for (int kind = 1; kind <= FILES_DIR_KINDS && !st; kind++) {
        char path[FILEIO_PATH_MAX];
        st = fileio_join(site->path, files_dir_name(kind), path, err);
        if (!st)
            st = fileio_mkdirs(path, err);
    }
    return st;
}

enum st site_db_publish(struct site *site, struct errctx *err) {
    char from[FILEIO_PATH_MAX], to[FILEIO_PATH_MAX], parent[FILEIO_PATH_MAX];
    enum st st = fileio_join(site->path, SITE_DB_NEW "-wal", from, err);
    if (!st && fileio_exists(from)) /* closing folds the log in, and does not say if it could not */
        st = errctx_set(err, ST_IO, "%s: the disk refused to take the new site", site->path);
    if (!st)
        st = fileio_join(site->path, SITE_DB_NEW, from, err);
    if (!st)
        st = fileio_join(site->path, "site.db", to, err);
    if (!st)
        st = fileio_commit(from, to, err);
    if (!st)
        st = fileio_dirname(site->path, parent, err);
    return st ? st : fileio_sync_dir(parent, err);
}

void site_db_unmake(struct site *site, const struct site_db_new *made) {
    char path[FILEIO_PATH_MAX];
    if (!made->locked && !made->folder)
        return;
    remove_new_files(site);
    for (int kind = 1; kind <= FILES_DIR_KINDS; kind++)
        if (!fileio_join(site->path, files_dir_name(kind), path, NULL))
            (void)rmdir(path);
    if (!fileio_join(site->path, "writer.lock", path, NULL))
        (void)unlink(path);
    if (made->folder)
        (void)rmdir(site->path);
}
