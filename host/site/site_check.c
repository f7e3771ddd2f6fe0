#include "site/site_check.h"

#include "site/check_files.h"
#include "site/check_rows.h"
#include "site/check_walk.h"
#include "site/files_dir.h"
#include "site/migrate.h"
#include "site/site_db.h"
#include "site/store.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* What SQLite itself says about its structure, indexes and references. */
static enum st check_structure(struct check_walk *walk) {
    static const char *const sql[] = {"PRAGMA integrity_check(100)", "PRAGMA foreign_key_check"};
    for (int i = 0; i < 2; i++) {
        sqlite3_stmt *stmt = NULL;
        int rc = sqlite3_prepare_v2(walk->site->db, sql[i], -1, &stmt, NULL);
        for (rc = rc ? rc : sqlite3_step(stmt); rc == SQLITE_ROW; rc = sqlite3_step(stmt)) {
            const char *text = (const char *)sqlite3_column_text(stmt, 0);
            if (i == 0 && text && strcmp(text, "ok") != 0)
                check_walk_error(walk, "site.db", "structure: %.200s", text);
            if (i == 1)
                check_walk_error(walk, "site.db", "table %.60s, row %lld refers to nothing",
                                 text ? text : "?", (long long)sqlite3_column_int64(stmt, 1));
        }
        if (rc != SQLITE_DONE)
            check_walk_error(walk, "site.db", "structure: %.200s", sqlite3_errmsg(walk->site->db));
        (void)sqlite3_finalize(stmt);
    }
    return check_walk_progress(walk, walk->database_bytes);
}

/* Opens the database without trust; a failure that means damage is a finding. */
static enum st open_for_check(struct check_walk *walk, bool *out_open, struct errctx *err) {
    struct site *site = walk->site;
    enum st st = site_db_identify(site->path, err);
    if (!st)
        st = store_open(site, "site.db", false, err);
    if (!st)
        st = site_db_version(site, err);
    *out_open = !st;
    if (st == ST_FORMAT || st == ST_DAMAGED) {
        check_walk_error(walk, "site.db", "%.250s", err ? err->text : "cannot be opened");
        return ST_OK;
    }
    return st;
}

static enum st walk_all(struct check_walk *walk, struct errctx *err) {
    struct errctx schema = {0};
    bool is_open = false;
    enum st st = open_for_check(walk, &is_open, err);
    if (st || !is_open)
        return st;
    /* One read transaction: a writer may go on meanwhile, we see one state. */
    if (store_exec(walk->site, "BEGIN", &schema))
        check_walk_error(walk, "site.db", "%.250s", schema.text);
    if (migrate_verify(walk->site, walk->site->schema_version, &schema))
        check_walk_error(walk, "site.db", "%.250s", schema.text);
    st = check_structure(walk);
    if (!st)
        st = check_rows(walk);
    if (!st)
        st = check_files(walk);
    (void)sqlite3_exec(walk->site->db, "ROLLBACK", NULL, NULL, NULL);
    return st;
}

static int64_t file_bytes(const char *site_path, const char *name) {
    char path[FILEIO_PATH_MAX + 16];
    struct stat info;
    (void)snprintf(path, sizeof path, "%s/%s", site_path, name);
    return stat(path, &info) == 0 && S_ISREG(info.st_mode) ? (int64_t)info.st_size : 0;
}

enum st site_check(const char *path, const struct site_check_options *options,
                   struct site_check_result *out_result, struct errctx *err) {
    enum { FINDINGS_MAX = 1000 };
    struct errctx own = {0};
    if (!err)
        err = &own;
    if (strlen(path) < 1 || strlen(path) > FILEIO_PATH_MAX - FILES_DIR_NAME_MAX - 32)
        return errctx_set(err, ST_INVALID, "'%.80s' is no usable path", path);
    struct site *site = calloc(1, sizeof *site);
    if (!site)
        return errctx_set(err, ST_NOMEM, "no memory to check %s", path);
    (void)snprintf(site->path, sizeof site->path, "%s", path);
    site->mode = SITE_READ;
    site->lock_fd = -1;
    struct check_walk walk = {.site = site, .options = options, .max_errors = FINDINGS_MAX};
    if (options && options->max_findings > 0)
        walk.max_errors = options->max_findings;
    walk.database_bytes = file_bytes(path, "site.db") + file_bytes(path, "site.db-wal");
    walk.total_bytes =
        2 * walk.database_bytes; /* structure, then rows; files are added when known */
    if (file_bytes(path, "site.db-wal") > 0 && check_files_no_writer(path))
        check_walk_warning(
            &walk, "site.db-wal",
            "a log left by a crash or a power cut; the next command that writes folds "
            "it in");
    enum st st = walk_all(&walk, err);
    store_close(site);
    free(site);
    if (st == ST_FULL) { /* our own sign for max_errors */
        walk.result.stopped_early = true;
        st = ST_OK;
    }
    if (st == ST_CANCELLED)
        return errctx_set(err, st, "stopped");
    if (!st)
        *out_result = walk.result;
    return st;
}
