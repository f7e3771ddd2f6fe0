#include "site/check_rows.h"

#include "site/check_streams.h"
#include "site/custody_log.h"
#include "site/job_row.h"

#include <stdio.h>
#include <string.h>

/* What the walk over the tables carries along. */
struct rows {
    struct check_walk *walk;
    struct digest digests[STORE_TABLES]; /* of what is found */
    struct check_streams streams;
    uint8_t custody_link[HASH_SHA256_BYTES];
    bool has_custody_link;
    struct custody_event last_event; /* sequence 0: none */
};

static void check_custody(struct rows *rows, sqlite3_stmt *stmt, int64_t id) {
    struct custody_event event;
    uint8_t link[HASH_SHA256_BYTES];
    if (custody_log_read(stmt, &event, NULL)) {
        check_walk_row(rows->walk, STORE_CUSTODY, id, "makes no sense");
        rows->has_custody_link = false;
        return;
    }
    if (event.sequence != rows->last_event.sequence + 1)
        check_walk_row(rows->walk, STORE_CUSTODY, id, "follows event %lld: events are missing",
                       (long long)rows->last_event.sequence);
    else if (rows->has_custody_link && (custody_log_link(rows->custody_link, &event, link) ||
                                        memcmp(link, event.link, sizeof link) != 0))
        check_walk_row(rows->walk, STORE_CUSTODY, id, "does not fit the chain of events");
    memcpy(rows->custody_link, event.link, sizeof event.link);
    rows->has_custody_link = true;
    rows->last_event = event;
}

static void check_job_hash(struct rows *rows, sqlite3_stmt *stmt, int64_t id) {
    uint8_t sha256[HASH_SHA256_BYTES];
    char role[SITE_KIND_MAX], hex[HASH_HEX_CHARS];
    bool known = sqlite3_column_int64(stmt, 5) != 0; /* outside */
    if (row_get_text(stmt, 3, role, sizeof role, NULL) ||
        row_get_blob(stmt, 4, sha256, sizeof sha256, NULL)) {
        check_walk_row(rows->walk, STORE_JOB_HASH, id, "makes no sense");
        return;
    }
    if (!known && job_row_knows(rows->walk->site, sha256, &known, NULL))
        known = false;
    hash_to_hex(sha256, hex);
    if (!known)
        check_walk_row(rows->walk, STORE_JOB_HASH, id, "the %s %s of job %lld is not in the site",
                       role, hex, (long long)sqlite3_column_int64(stmt, 1));
}

/* One row that matches its hash or not. */
static enum st check_row(struct rows *rows, enum store_table table, sqlite3_stmt *stmt) {
    uint8_t is[HASH_SHA256_BYTES], should[HASH_SHA256_BYTES];
    struct check_walk *walk = rows->walk;
    int columns = store_hashed_columns(table);
    int64_t id = sqlite3_column_int64(stmt, 0), bytes = 0;
    if (row_hash_read(stmt, store_table_name(table), columns, is))
        return ST_NOMEM;
    digest_add(&rows->digests[table], is);
    walk->result.rows++;
    if (row_get_blob(stmt, columns, should, sizeof should, NULL) ||
        memcmp(is, should, sizeof is) != 0)
        check_walk_row(walk, table, id, "is not as written (it does not match its hash)");
    else if (table == STORE_STREAM && check_streams_add(&rows->streams, stmt))
        return ST_NOMEM;
    if (table == STORE_CHUNK) {
        enum st st = check_streams_chunk(&rows->streams, walk, stmt);
        if (st)
            return st;
    } else if (table == STORE_CUSTODY)
        check_custody(rows, stmt, id);
    else if (table == STORE_JOB_HASH)
        check_job_hash(rows, stmt, id);
    for (int c = 0; c < sqlite3_column_count(stmt); c++)
        bytes += sqlite3_column_bytes(stmt, c);
    return check_walk_progress(walk, bytes);
}

static enum st check_table(struct rows *rows, enum store_table table) {
    struct check_walk *walk = rows->walk;
    const char *name = store_table_name(table);
    char sql[96], where[64];
    (void)snprintf(sql, sizeof sql, "SELECT * FROM %s ORDER BY id", name);
    (void)snprintf(where, sizeof where, "site.db: table %s", name);
    sqlite3_stmt *stmt = NULL;
    enum st st = ST_OK;
    int rc = sqlite3_prepare_v2(walk->site->db, sql, -1, &stmt, NULL);
    if (rc == SQLITE_OK && sqlite3_column_count(stmt) <= store_hashed_columns(table))
        check_walk_error(walk, where, "has too few columns");
    else if (rc == SQLITE_OK)
        for (rc = sqlite3_step(stmt); rc == SQLITE_ROW && !st; rc = st ? rc : sqlite3_step(stmt))
            st = check_row(rows, table, stmt);
    if (!st && rc != SQLITE_DONE && rc != SQLITE_OK)
        check_walk_error(walk, where, "cannot be read: %.200s", sqlite3_errmsg(walk->site->db));
    (void)sqlite3_finalize(stmt);
    struct digest digest;
    struct errctx why = {0};
    if (st)
        return st;
    if (digest_read(walk->site, table, &digest, &why))
        check_walk_error(walk, where, "its digest is not as written");
    else if (digest.rows != rows->digests[table].rows)
        check_walk_error(walk, where, "has %lld rows, %lld were written",
                         (long long)rows->digests[table].rows, (long long)digest.rows);
    else if (!digest_equal(&digest, &rows->digests[table]))
        check_walk_error(walk, where, "does not match its digest");
    return ST_OK;
}

/* A clean end is a seal over all tables; after a crash the last event is another one. */
static void check_seal(struct rows *rows) {
    uint8_t seal[HASH_SHA256_BYTES];
    char hex[HASH_HEX_CHARS], expected[SITE_TEXT_MAX];
    if (rows->last_event.sequence == 0) {
        check_walk_error(rows->walk, "site.db: table custody", "holds no event");
        return;
    }
    if (strcmp(rows->last_event.what, "sealed") != 0)
        return;
    if (digest_seal(rows->digests, seal))
        return;
    hash_to_hex(seal, hex);
    (void)snprintf(expected, sizeof expected, "{\"digest\":\"%s\"}", hex);
    if (strcmp(expected, rows->last_event.detail) != 0)
        check_walk_error(rows->walk, "site.db", "the tables are not those that were sealed");
}

static void check_digest_table(struct check_walk *walk) {
    sqlite3_stmt *stmt = NULL;
    if (store_query(walk->site, "SELECT count(*) FROM digest", NULL, 0, &stmt, NULL) ||
        sqlite3_step(stmt) != SQLITE_ROW || sqlite3_column_int64(stmt, 0) != STORE_TABLES)
        check_walk_error(walk, "site.db: table digest", "does not have its %d rows", STORE_TABLES);
    (void)sqlite3_reset(stmt);
}

/* Where the chain of events starts. A damaged row of table site is reported by the walk over it. */
static void start_custody(struct rows *rows) {
    sqlite3_stmt *stmt = NULL;
    uint8_t uuid[16];
    if (store_fetch_id(rows->walk->site, STORE_SITE, 1, &stmt, NULL))
        return;
    rows->has_custody_link = !row_get_blob(stmt, 1, uuid, sizeof uuid, NULL) &&
                             !custody_log_first(uuid, rows->custody_link);
    (void)sqlite3_reset(stmt);
}

enum st check_rows(struct check_walk *walk) {
    struct rows rows = {.walk = walk};
    start_custody(&rows);
    enum st st = ST_OK;
    for (int t = 0; t < STORE_TABLES && !st; t++)
        st = check_table(&rows, (enum store_table)t);
    if (!st)
        st = check_streams_ledger(&rows.streams, walk);
    if (!st) {
        check_digest_table(walk);
        check_seal(&rows);
    }
    check_streams_fini(&rows.streams);
    return st;
}
