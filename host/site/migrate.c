#include "site/migrate.h"

#include <string.h>

/* Rules for a migration: never edit one that was released; a new column or table goes into a new
 * one; one that changes the columns of a table must hash its rows and its digest anew. Columns
 * behind row_sha256 are not in the row's hash. */
static const char first[] =
    /* who we are; exactly one row */
    "CREATE TABLE site(id INTEGER PRIMARY KEY CHECK(id = 1), uuid BLOB NOT NULL, name TEXT NOT "
    "NULL,"
    " created_utc_ns INTEGER NOT NULL, row_sha256 BLOB NOT NULL) STRICT;"
    /* the newest row counts; offset: 3 doubles */
    "CREATE TABLE georef(id INTEGER PRIMARY KEY, epsg INTEGER NOT NULL, offset BLOB NOT NULL,"
    " utc_ns INTEGER NOT NULL, row_sha256 BLOB NOT NULL) STRICT;"
    "CREATE TABLE station(id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, remark TEXT NOT NULL,"
    " created_utc_ns INTEGER NOT NULL, row_sha256 BLOB NOT NULL) STRICT;"
    /* pose: 12 doubles; covariance: 36 doubles */
    "CREATE TABLE station_pose(id INTEGER PRIMARY KEY, station_id INTEGER NOT NULL REFERENCES "
    "station,"
    " pose BLOB NOT NULL, covariance BLOB, source TEXT NOT NULL, utc_ns INTEGER NOT NULL,"
    " row_sha256 BLOB NOT NULL) STRICT;"
    "CREATE INDEX station_pose_of ON station_pose(station_id);"
    "CREATE TABLE calib(id INTEGER PRIMARY KEY, kind TEXT NOT NULL, name TEXT NOT NULL,"
    " status INTEGER NOT NULL, format INTEGER NOT NULL, sha256 BLOB NOT NULL, body TEXT NOT NULL,"
    " utc_ns INTEGER NOT NULL, row_sha256 BLOB NOT NULL) STRICT;"
    "CREATE INDEX calib_kind ON calib(kind);"
    "CREATE INDEX calib_sha256 ON calib(sha256);"
    /* origin: 3 doubles */
    "CREATE TABLE stream(id INTEGER PRIMARY KEY, station_id INTEGER NOT NULL REFERENCES station,"
    " kind TEXT NOT NULL, name TEXT NOT NULL, format TEXT NOT NULL, meta TEXT NOT NULL,"
    " origin BLOB NOT NULL, zstd_level INTEGER NOT NULL, created_utc_ns INTEGER NOT NULL,"
    " row_sha256 BLOB NOT NULL, UNIQUE(station_id, kind, name)) STRICT;"
    /* codec 0: as sent, 1: zstd; crc32c of the stored bytes, chain over the bytes as sent */
    "CREATE TABLE chunk(id INTEGER PRIMARY KEY, stream_id INTEGER NOT NULL REFERENCES stream,"
    " sequence INTEGER NOT NULL, t_first_ns INTEGER NOT NULL, t_last_ns INTEGER NOT NULL,"
    " first_item INTEGER NOT NULL, end_item INTEGER NOT NULL, item_count INTEGER NOT NULL,"
    " size_bytes INTEGER NOT NULL, stored_bytes INTEGER NOT NULL, codec INTEGER NOT NULL,"
    " crc32c INTEGER NOT NULL, chain BLOB NOT NULL, row_sha256 BLOB NOT NULL, payload BLOB NOT "
    "NULL,"
    " UNIQUE(stream_id, sequence)) STRICT;"
    "CREATE TABLE ledger(id INTEGER PRIMARY KEY, stream_id INTEGER NOT NULL REFERENCES stream,"
    " first_item INTEGER NOT NULL, end_item INTEGER NOT NULL, t_ns INTEGER NOT NULL,"
    " reason TEXT NOT NULL, row_sha256 BLOB NOT NULL) STRICT;"
    "CREATE INDEX ledger_of ON ledger(stream_id, first_item);"
    /* kind: enum files_kind */
    "CREATE TABLE file(id INTEGER PRIMARY KEY, kind INTEGER NOT NULL, sha256 BLOB NOT NULL UNIQUE,"
    " extension TEXT NOT NULL, size_bytes INTEGER NOT NULL, utc_ns INTEGER NOT NULL,"
    " row_sha256 BLOB NOT NULL) STRICT;"
    "CREATE TABLE frame(id INTEGER PRIMARY KEY, station_id INTEGER NOT NULL REFERENCES station,"
    " t_ns INTEGER NOT NULL, sha256 BLOB NOT NULL REFERENCES file(sha256),"
    " width_px INTEGER NOT NULL, height_px INTEGER NOT NULL, exposure_s REAL, gain REAL,"
    " pan_rad REAL, tilt_rad REAL, camera_calib_id INTEGER REFERENCES calib, meta TEXT NOT NULL,"
    " row_sha256 BLOB NOT NULL) STRICT;"
    "CREATE TABLE job(id INTEGER PRIMARY KEY, kind TEXT NOT NULL, parameters TEXT NOT NULL,"
    " program TEXT NOT NULL, key BLOB NOT NULL, seconds REAL NOT NULL, utc_ns INTEGER NOT NULL,"
    " row_sha256 BLOB NOT NULL) STRICT;"
    "CREATE INDEX job_key ON job(key);"
    /* direction 1: input, 2: output */
    "CREATE TABLE job_hash(id INTEGER PRIMARY KEY, job_id INTEGER NOT NULL REFERENCES job,"
    " direction INTEGER NOT NULL, role TEXT NOT NULL, sha256 BLOB NOT NULL,"
    " outside INTEGER NOT NULL, row_sha256 BLOB NOT NULL) STRICT;"
    "CREATE INDEX job_hash_of ON job_hash(job_id);"
    "CREATE TABLE photo(id INTEGER PRIMARY KEY, station_id INTEGER NOT NULL REFERENCES station,"
    " name TEXT NOT NULL, sha256 BLOB NOT NULL REFERENCES file(sha256), width_px INTEGER NOT NULL,"
    " height_px INTEGER NOT NULL, pose BLOB NOT NULL, frame_id INTEGER REFERENCES frame,"
    " job_id INTEGER REFERENCES job, utc_ns INTEGER NOT NULL, row_sha256 BLOB NOT NULL,"
    " UNIQUE(station_id, name)) STRICT;"
    /* id is the sequence number */
    "CREATE TABLE custody(id INTEGER PRIMARY KEY, utc_ns INTEGER NOT NULL, who TEXT NOT NULL,"
    " program TEXT NOT NULL, what TEXT NOT NULL, detail TEXT NOT NULL, link BLOB NOT NULL,"
    " row_sha256 BLOB NOT NULL) STRICT;"
    "CREATE TABLE digest(name TEXT PRIMARY KEY, rows INTEGER NOT NULL, sum BLOB NOT NULL,"
    " row_sha256 BLOB NOT NULL) STRICT, WITHOUT ROWID;";

/* Look-ups that a site of many stands makes all the time: the frames of a station, the link of a
 * chain, and what used a given file (which also keeps the foreign keys cheap). */
static const char second[] = "CREATE INDEX frame_of ON frame(station_id);"
                             "CREATE INDEX frame_sha256 ON frame(sha256);"
                             "CREATE INDEX photo_sha256 ON photo(sha256);"
                             "CREATE INDEX chunk_chain ON chunk(chain);"
                             "CREATE INDEX job_hash_sha256 ON job_hash(sha256);";

static const char *const migrations[MIGRATE_NEWEST] = {first, second};

enum st migrate_to(struct site *site, int32_t version, struct errctx *err) {
    enum st st = ST_OK;
    for (int32_t v = site->schema_version; v < version && !st; v++)
        st = store_exec(site, migrations[v], err);
    if (!st && site->schema_version == 0) {
        for (int t = 0; t < STORE_TABLES; t++)
            site->digests[t].dirty = true;
        st = store_exec(site, "PRAGMA application_id = 1396916562", err);
    }
    char sql[64];
    (void)sqlite3_snprintf(sizeof sql, sql, "PRAGMA user_version = %d", (int)version);
    if (!st)
        st = store_exec(site, sql, err);
    if (!st)
        site->schema_version = version;
    return st;
}

static const char schema_sql[] =
    "SELECT type, name, tbl_name, coalesce(sql, '') FROM sqlite_schema ORDER BY type, name";

/* ST_OK if both statements stand on equal rows. */
static enum st same_row(sqlite3_stmt *a, sqlite3_stmt *b, struct errctx *err) {
    for (int c = 0; c < 4; c++) {
        const char *x = (const char *)sqlite3_column_text(a, c);
        const char *y = (const char *)sqlite3_column_text(b, c);
        if (sqlite3_column_type(a, c) != SQLITE_TEXT || !x || !y || strcmp(x, y) != 0)
            return errctx_set(err, ST_DAMAGED, "the schema is not as written at %s",
                              (const char *)sqlite3_column_text(b, 1));
    }
    return ST_OK;
}

static enum st same_schema(struct site *site, sqlite3_stmt *found, sqlite3_stmt *expected,
                           struct errctx *err) {
    for (;;) {
        int rc_found = sqlite3_step(found), rc_expected = sqlite3_step(expected);
        if (rc_found != SQLITE_ROW && rc_found != SQLITE_DONE)
            return store_error(site, err, "read the schema");
        if (rc_expected != SQLITE_ROW && rc_expected != SQLITE_DONE)
            return errctx_set(err, ST_NOMEM, "no memory to compare the schema");
        if (rc_found != rc_expected)
            return errctx_set(err, ST_DAMAGED, "the schema has too %s tables or indexes",
                              rc_found == SQLITE_ROW ? "many" : "few");
        if (rc_found == SQLITE_DONE)
            return ST_OK;
        enum st st = same_row(found, expected, err);
        if (st)
            return st;
    }
}

enum st migrate_verify(struct site *site, int32_t version, struct errctx *err) {
    if (version < 1 || version > MIGRATE_NEWEST)
        return errctx_set(err, ST_UNSUPPORTED, "schema version %d", (int)version);
    sqlite3 *model = NULL;
    sqlite3_stmt *found = NULL, *expected = NULL;
    enum st st = ST_OK;
    int rc = sqlite3_open_v2(":memory:", &model, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX, NULL);
    for (int32_t v = 0; v < version && rc == SQLITE_OK; v++)
        rc = sqlite3_exec(model, migrations[v], NULL, NULL, NULL);
    if (rc == SQLITE_OK)
        rc = sqlite3_prepare_v2(model, schema_sql, -1, &expected, NULL);
    if (rc != SQLITE_OK)
        st = errctx_set(err, rc == SQLITE_NOMEM ? ST_NOMEM : ST_INTERNAL,
                        "cannot build the schema: %s", sqlite3_errmsg(model));
    else if (sqlite3_prepare_v2(site->db, schema_sql, -1, &found, NULL) != SQLITE_OK)
        st = store_error(site, err, "read the schema");
    else
        st = same_schema(site, found, expected, err);
    (void)sqlite3_finalize(found);
    (void)sqlite3_finalize(expected);
    (void)sqlite3_close_v2(model);
    return st;
}
