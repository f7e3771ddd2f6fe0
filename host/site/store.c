#include "site/store.h"

#include "base/clock.h"
#include "site/migrate.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static const struct {
    const char *name;
    int hashed; /* columns before row_sha256 */
    const char *insert, *by_id;
} tables[STORE_TABLES] = {
#define TABLE(name, columns, marks)                                                                \
    {                                                                                              \
        name, columns, "INSERT INTO " name " VALUES(" marks ")",                                   \
            "SELECT * FROM " name " WHERE id = ?1"                                                 \
    }
    [STORE_SITE] = TABLE("site", 4, "?,?,?,?,?"),
    [STORE_GEOREF] = TABLE("georef", 4, "?,?,?,?,?"),
    [STORE_STATION] = TABLE("station", 4, "?,?,?,?,?"),
    [STORE_STATION_POSE] = TABLE("station_pose", 6, "?,?,?,?,?,?,?"),
    [STORE_CALIB] = TABLE("calib", 8, "?,?,?,?,?,?,?,?,?"),
    [STORE_STREAM] = TABLE("stream", 9, "?,?,?,?,?,?,?,?,?,?"),
    [STORE_CHUNK] = TABLE("chunk", 13, "?,?,?,?,?,?,?,?,?,?,?,?,?,?,?"),
    [STORE_LEDGER] = TABLE("ledger", 6, "?,?,?,?,?,?,?"),
    [STORE_FILE] = TABLE("file", 6, "?,?,?,?,?,?,?"),
    [STORE_FRAME] = TABLE("frame", 12, "?,?,?,?,?,?,?,?,?,?,?,?,?"),
    [STORE_JOB] = TABLE("job", 7, "?,?,?,?,?,?,?,?"),
    [STORE_JOB_HASH] = TABLE("job_hash", 6, "?,?,?,?,?,?,?"),
    [STORE_PHOTO] = TABLE("photo", 10, "?,?,?,?,?,?,?,?,?,?,?"),
    [STORE_CUSTODY] = TABLE("custody", 7, "?,?,?,?,?,?,?,?"),
#undef TABLE
};

const char *store_table_name(enum store_table table) {
    return tables[table].name;
}

int store_hashed_columns(enum store_table table) {
    return tables[table].hashed;
}

int64_t store_now_utc_ns(const struct site *site) {
    return site->fixed_utc_ns ? site->fixed_utc_ns : clock_utc_ns();
}

static enum st status_of(int extended, int os_error) {
    switch (extended & 0xff) {
    case SQLITE_FULL:
        return ST_FULL;
    case SQLITE_NOMEM:
    case SQLITE_TOOBIG:
        return ST_NOMEM;
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
        return ST_BUSY;
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
    case SQLITE_FORMAT:
    case SQLITE_ERROR: /* what our own fixed SQL cannot cause on an intact schema */
        return ST_DAMAGED;
    case SQLITE_READONLY:
    case SQLITE_PERM:
    case SQLITE_AUTH:
        return ST_PERMISSION;
    case SQLITE_CONSTRAINT:
        return extended == SQLITE_CONSTRAINT_FOREIGNKEY ? ST_NOT_FOUND : ST_EXISTS;
    case SQLITE_CANTOPEN:
    case SQLITE_IOERR:
        return os_error ? fileio_status(os_error) : ST_IO;
    default:
        return ST_IO;
    }
}

enum st store_error(struct site *site, struct errctx *err, const char *doing) {
    if (!site->db)
        return errctx_set(err, ST_NOMEM, "no memory to %s %s/site.db", doing, site->path);
    int extended = sqlite3_extended_errcode(site->db);
    int os_error = sqlite3_system_errno(site->db);
    enum st st = status_of(extended, os_error);
    bool os_tells = (extended & 0xff) == SQLITE_IOERR || (extended & 0xff) == SQLITE_CANTOPEN;
    char reason[128] = "";
    if (os_tells && os_error && strerror_r(os_error, reason, sizeof reason))
        reason[0] = '\0';
    return errctx_set(err, st, "cannot %s %s/site.db: %s", doing, site->path,
                      reason[0] ? reason : sqlite3_errmsg(site->db));
}

enum st store_exec(struct site *site, const char *sql, struct errctx *err) {
    return sqlite3_exec(site->db, sql, NULL, NULL, NULL) == SQLITE_OK
               ? ST_OK
               : store_error(site, err, "change");
}

/* The database is input like any other: what is in it may not run, refer to functions, or be huge.
 */
static void harden(sqlite3 *db) {
    static const struct {
        int what, value;
    } switches[] = {{SQLITE_DBCONFIG_DEFENSIVE, 1},      {SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0},
                    {SQLITE_DBCONFIG_ENABLE_TRIGGER, 0}, {SQLITE_DBCONFIG_ENABLE_VIEW, 0},
                    {SQLITE_DBCONFIG_DQS_DML, 0},        {SQLITE_DBCONFIG_DQS_DDL, 0},
                    {SQLITE_DBCONFIG_ENABLE_FKEY, 1}},
      limits[] = {{SQLITE_LIMIT_LENGTH, SITE_BLOB_MAX},
                  {SQLITE_LIMIT_SQL_LENGTH, 65536},
                  {SQLITE_LIMIT_COLUMN, 64},
                  {SQLITE_LIMIT_EXPR_DEPTH, 32},
                  {SQLITE_LIMIT_COMPOUND_SELECT, 8},
                  {SQLITE_LIMIT_ATTACHED, 0},
                  {SQLITE_LIMIT_VARIABLE_NUMBER, 64},
                  {SQLITE_LIMIT_TRIGGER_DEPTH, 1}};
    for (size_t i = 0; i < sizeof switches / sizeof switches[0]; i++)
        (void)sqlite3_db_config(db, switches[i].what, switches[i].value, NULL);
    for (size_t i = 0; i < sizeof limits / sizeof limits[0]; i++)
        (void)sqlite3_limit(db, limits[i].what, limits[i].value);
}

/* Opens and reads one page, so that a database that cannot be used fails here and not later. */
static enum st open_once(struct site *site, const char *file, bool create, bool immutable,
                         struct errctx *err) {
    enum { WAIT_MS = 5000 /* for a checkpoint of the writer, at the most */ };
    char uri[3 * FILEIO_PATH_MAX + 32] = "file:";
    static const char hex[] = "0123456789ABCDEF";
    size_t n = strlen(uri);
    for (const char *part = site->path; part; part = part == site->path ? file : NULL) {
        for (const char *c = part; *c; c++) {
            bool plain = strchr("/._-~", *c) || (*c >= '0' && *c <= '9') ||
                         (*c >= 'a' && *c <= 'z') || (*c >= 'A' && *c <= 'Z');
            uri[n++] = plain ? *c : '%';
            if (!plain) {
                uri[n++] = hex[(uint8_t)*c >> 4];
                uri[n++] = hex[(uint8_t)*c & 15];
            }
        }
        uri[n++] = part == site->path ? '/' : '\0';
    }
    if (immutable)
        (void)strcat(uri, "?immutable=1");
    int flags = SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_URI | SQLITE_OPEN_READWRITE |
                (create ? SQLITE_OPEN_CREATE : 0);
    sqlite3 *db = NULL;
    int rc = sqlite3_open_v2(uri, &db, flags, NULL);
    site->db = db;
    if (rc != SQLITE_OK)
        return store_error(site, err, "open");
    (void)sqlite3_extended_result_codes(db, 1);
    (void)sqlite3_busy_timeout(db, WAIT_MS);
    harden(db);
    enum st st = store_exec(site, "PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0", err);
    if (!st)
        st = store_exec(site, "SELECT count(*) FROM sqlite_schema", err);
    return st;
}

enum st store_open(struct site *site, const char *file, bool create, struct errctx *err) {
    enum st st = open_once(site, file, create, false, err);
    if (st && st != ST_DAMAGED && site->mode == SITE_READ) {
        char log[FILEIO_PATH_MAX + 16];
        (void)snprintf(log, sizeof log, "%s/%s-wal", site->path, file);
        struct stat info;
        bool has_log = stat(log, &info) == 0 && info.st_size > 0;
        if (has_log)
            return errctx_prefix(err, st,
                                 "the site was not closed and cannot be recovered on read-only "
                                 "media; copy it to a disk and open the copy");
        store_close(site); /* read-only media: nobody can change it while we look */
        st = open_once(site, file, false, true, err);
    }
    if (!st && site->mode == SITE_READ)
        st = store_exec(site, "PRAGMA query_only = ON", err);
    return st;
}

void store_close(struct site *site) {
    for (size_t i = 0; i < site->statement_count; i++)
        (void)sqlite3_finalize(site->statements[i].stmt);
    site->statement_count = 0;
    (void)sqlite3_close_v2(site->db);
    site->db = NULL;
}

enum st store_query(struct site *site, const char *sql, const int64_t *numbers, int count,
                    sqlite3_stmt **out_stmt, struct errctx *err) {
    struct store_statement *found = NULL;
    for (size_t i = 0; i < site->statement_count && !found; i++)
        if (site->statements[i].sql == sql)
            found = &site->statements[i];
    if (!found) {
        if (site->statement_count == STORE_STATEMENTS_MAX)
            return errctx_set(err, ST_INTERNAL, "more than %d statements", STORE_STATEMENTS_MAX);
        found = &site->statements[site->statement_count];
        if (sqlite3_prepare_v3(site->db, sql, -1, SQLITE_PREPARE_PERSISTENT, &found->stmt, NULL))
            return store_error(site, err, "use");
        found->sql = sql;
        site->statement_count++;
    }
    (void)sqlite3_reset(found->stmt);
    (void)sqlite3_clear_bindings(found->stmt);
    for (int i = 0; i < count; i++)
        if (sqlite3_bind_int64(found->stmt, i + 1, numbers[i]) != SQLITE_OK)
            return store_error(site, err, "use");
    *out_stmt = found->stmt;
    return ST_OK;
}

enum st store_fetch(struct site *site, sqlite3_stmt *stmt, enum store_table table,
                    struct errctx *err) {
    int rc = sqlite3_step(stmt);
    enum st st;
    if (rc == SQLITE_DONE)
        st = ST_NOT_FOUND;
    else if (rc != SQLITE_ROW)
        st = store_error(site, err, "read");
    else {
        uint8_t is[HASH_SHA256_BYTES], should[HASH_SHA256_BYTES];
        int columns = tables[table].hashed;
        st = row_get_blob(stmt, columns, should, sizeof should, err);
        if (!st)
            st = row_hash_read(stmt, tables[table].name, columns, is);
        if (st == ST_DAMAGED || (!st && memcmp(is, should, sizeof is) != 0))
            st = errctx_set(err, ST_DAMAGED, "%s/site.db: table %s, row %lld: not as written",
                            site->path, tables[table].name,
                            (long long)sqlite3_column_int64(stmt, 0));
    }
    if (st)
        (void)sqlite3_reset(stmt);
    return st;
}

enum st store_fetch_id(struct site *site, enum store_table table, int64_t id,
                       sqlite3_stmt **out_stmt, struct errctx *err) {
    enum st st = store_query(site, tables[table].by_id, &id, 1, out_stmt, err);
    if (!st)
        st = store_fetch(site, *out_stmt, table, err);
    if (st == ST_NOT_FOUND)
        st = errctx_set(err, st, "%s: there is no %s %lld", site->path, tables[table].name,
                        (long long)id);
    return st;
}

enum st store_require(struct site *site, enum store_table table, int64_t id, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    enum st st = store_fetch_id(site, table, id, &stmt, err);
    if (!st)
        (void)sqlite3_reset(stmt);
    return st;
}

/* The next free id. Rows at the end of a table may have been removed; ids are not reused while a
 * later one is there, and a row's hash holds its id, so a reused one is not mistaken. */
static enum st next_id(struct site *site, enum store_table table, int64_t *out_id,
                       struct errctx *err) {
    static const char *const sql[STORE_TABLES] = {
#define NEXT(name) "SELECT coalesce(max(id), 0) + 1 FROM " name
        [STORE_SITE] = NEXT("site"),       [STORE_GEOREF] = NEXT("georef"),
        [STORE_STATION] = NEXT("station"), [STORE_STATION_POSE] = NEXT("station_pose"),
        [STORE_CALIB] = NEXT("calib"),     [STORE_STREAM] = NEXT("stream"),
        [STORE_CHUNK] = NEXT("chunk"),     [STORE_LEDGER] = NEXT("ledger"),
        [STORE_FILE] = NEXT("file"),       [STORE_FRAME] = NEXT("frame"),
        [STORE_JOB] = NEXT("job"),         [STORE_JOB_HASH] = NEXT("job_hash"),
        [STORE_PHOTO] = NEXT("photo"),     [STORE_CUSTODY] = NEXT("custody"),
#undef NEXT
    };
    sqlite3_stmt *stmt = NULL;
    enum st st = store_query(site, sql[table], NULL, 0, &stmt, err);
    if (st)
        return st;
    if (sqlite3_step(stmt) == SQLITE_ROW)
        *out_id = sqlite3_column_int64(stmt, 0);
    else
        st = store_error(site, err, "read");
    (void)sqlite3_reset(stmt);
    if (!st && *out_id < 1)
        st = errctx_set(err, ST_DAMAGED, "%s/site.db: table %s has no free id", site->path,
                        tables[table].name);
    return st;
}

enum st store_insert(struct site *site, enum store_table table, struct row_value *values,
                     size_t count, const struct row_value *tail, int64_t *out_id,
                     struct errctx *err) {
    if (count != (size_t)tables[table].hashed)
        return errctx_set(err, ST_INTERNAL, "table %s has %d columns, not %zu", tables[table].name,
                          tables[table].hashed, count);
    enum st st = values[0].i ? ST_OK : next_id(site, table, &values[0].i, err);
    uint8_t sha256[HASH_SHA256_BYTES];
    if (!st && row_hash(tables[table].name, values, count, sha256))
        st = errctx_set(err, ST_NOMEM, "cannot hash a row");
    sqlite3_stmt *stmt = NULL;
    if (!st)
        st = store_query(site, tables[table].insert, NULL, 0, &stmt, err);
    if (st)
        return st;
    struct row_value hash = row_blob(sha256, sizeof sha256);
    for (size_t i = 0; i < count && !st; i++)
        st = row_bind(stmt, (int)i + 1, &values[i]);
    if (!st)
        st = row_bind(stmt, (int)count + 1, &hash);
    if (!st && tail)
        st = row_bind(stmt, (int)count + 2, tail);
    if (!st && sqlite3_step(stmt) == SQLITE_DONE)
        digest_add(&site->digests[table], sha256);
    else
        st = store_error(site, err, "write");
    (void)sqlite3_reset(stmt);
    (void)sqlite3_clear_bindings(stmt);
    if (!st && out_id)
        *out_id = values[0].i;
    return st;
}

enum st store_remove(struct site *site, enum store_table table, int64_t id, struct errctx *err) {
    if (table != STORE_PHOTO)
        return errctx_set(err, ST_INTERNAL, "rows of %s are never removed", tables[table].name);
    sqlite3_stmt *stmt = NULL;
    uint8_t sha256[HASH_SHA256_BYTES];
    enum st st = store_fetch_id(site, table, id, &stmt, err);
    if (st)
        return st;
    st = row_get_blob(stmt, tables[table].hashed, sha256, sizeof sha256, err);
    (void)sqlite3_reset(stmt);
    if (!st)
        st = store_query(site, "DELETE FROM photo WHERE id = ?1", &id, 1, &stmt, err);
    if (st)
        return st;
    if (sqlite3_step(stmt) == SQLITE_DONE)
        digest_remove(&site->digests[table], sha256);
    else
        st = store_error(site, err, "write");
    (void)sqlite3_reset(stmt);
    return st;
}

enum st store_list_bound(struct site *site, sqlite3_stmt *stmt, enum store_table table,
                         store_read_fn *read, void *out_rows, size_t elem_bytes, size_t capacity,
                         size_t *out_count, struct errctx *err) {
    size_t count = 0;
    enum st st = ST_OK;
    while (!st && count < capacity) {
        st = store_fetch(site, stmt, table, err);
        if (!st)
            st = read(site, stmt, (unsigned char *)out_rows + count * elem_bytes, err);
        count += !st;
    }
    (void)sqlite3_reset(stmt);
    if (st && st != ST_NOT_FOUND)
        return st;
    *out_count = count;
    return ST_OK;
}

enum st store_list(struct site *site, const char *sql, const int64_t *numbers, int count,
                   enum store_table table, store_read_fn *read, void *out_rows, size_t elem_bytes,
                   size_t capacity, size_t *out_count, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    const enum st st = store_query(site, sql, numbers, count, &stmt, err);
    return st ? st
              : store_list_bound(site, stmt, table, read, out_rows, elem_bytes, capacity, out_count,
                                 err);
}
