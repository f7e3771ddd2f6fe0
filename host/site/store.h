/* Below the public headers of this folder: the database handle, cached statements, rows. Only files
 * of host/site include this. */
#ifndef SC_SITE_STORE_H
#define SC_SITE_STORE_H

#include "base/fileio.h"
#include "base/hash.h"
#include "base/st.h"
#include "site/digest.h"
#include "site/row.h"
#include "site/site.h"

#include <sqlite3.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { STORE_STATEMENTS_MAX = 96, STORE_PAGE_BYTES = 16384 };

struct store_statement {
    const char *sql; /* static text: the key */
    sqlite3_stmt *stmt;
};

struct site {
    char path[FILEIO_PATH_MAX];
    enum site_mode mode;
    sqlite3 *db;
    int lock_fd; /* -1: not the writer */
    int32_t schema_version;
    char who[SITE_NAME_MAX], program[SITE_NAME_MAX];
    int64_t fixed_utc_ns; /* 0: the clock */
    struct store_statement statements[STORE_STATEMENTS_MAX];
    size_t statement_count;
    /* Writer only. */
    struct digest digests[STORE_TABLES], digests_before[STORE_TABLES]; /* the batch began */
    bool in_batch;        /* between site_begin() and site_commit() */
    enum st batch_failed; /* first failure within the batch */
    struct errctx batch_err;
    bool logged, logged_before; /* this session's "opened" or "created" event is written */
    bool clean;                 /* the last event found at open was a seal */
    bool changed;               /* something was committed since the last seal */
};

const char *store_table_name(enum store_table table);
int store_hashed_columns(enum store_table table); /* those before row_sha256 */

/* Translates the database's last error: "cannot DOING in PATH/site.db: reason". */
enum st store_error(struct site *site, struct errctx *err, const char *doing);

/* Opens PATH/`file` hardened against hostile content (no triggers, views, writable schema, bounded
 * sizes) and tests that it can be read. Readers of read-only media get it as immutable. Fills
 * site->db. */
ST_MUST_CHECK enum st store_open(struct site *site, const char *file, bool create,
                                 struct errctx *err);
void store_close(struct site *site); /* statements and database */

/* Runs SQL text without results. */
ST_MUST_CHECK enum st store_exec(struct site *site, const char *sql, struct errctx *err);

/* A cached statement, reset and with its `count` integers bound from number 1 on. `sql` must be
 * static. */
ST_MUST_CHECK enum st store_query(struct site *site, const char *sql, const int64_t *numbers,
                                  int count, sqlite3_stmt **out_stmt, struct errctx *err);

/* Next row of a `SELECT * FROM table ...`, verified against its row hash: ST_OK, ST_NOT_FOUND at
 * the end (no message), ST_DAMAGED with the place. Resets the statement unless it returns ST_OK. */
ST_MUST_CHECK enum st store_fetch(struct site *site, sqlite3_stmt *stmt, enum store_table table,
                                  struct errctx *err);

/* One verified row by its id; the caller resets *out_stmt. ST_NOT_FOUND: "there is no TABLE ID". */
ST_MUST_CHECK enum st store_fetch_id(struct site *site, enum store_table table, int64_t id,
                                     sqlite3_stmt **out_stmt, struct errctx *err);

/* A page of such a `SELECT`: reads up to `capacity` rows into out_rows, elements of elem_bytes,
 * with `read`. ST_DAMAGED as store_fetch(); *out_count is set on success only. */
typedef enum st store_read_fn(struct site *site, sqlite3_stmt *stmt, void *out_row,
                              struct errctx *err);
ST_MUST_CHECK enum st store_list(struct site *site, const char *sql, const int64_t *numbers,
                                 int count, enum store_table table, store_read_fn *read,
                                 void *out_rows, size_t elem_bytes, size_t capacity,
                                 size_t *out_count, struct errctx *err);
/* The same for a statement whose numbers are bound already. */
ST_MUST_CHECK enum st store_list_bound(struct site *site, sqlite3_stmt *stmt,
                                       enum store_table table, store_read_fn *read, void *out_rows,
                                       size_t elem_bytes, size_t capacity, size_t *out_count,
                                       struct errctx *err);

/* True if a row with that id is there. */
ST_MUST_CHECK enum st store_require(struct site *site, enum store_table table, int64_t id,
                                    struct errctx *err);

/* Adds a row within a batch. values[0] is the id: with i = 0 the next free one is taken, which
 * *out_id (or NULL) gets. `tail`, if not NULL, is the column behind row_sha256. */
ST_MUST_CHECK enum st store_insert(struct site *site, enum store_table table,
                                   struct row_value *values, size_t count,
                                   const struct row_value *tail, int64_t *out_id,
                                   struct errctx *err);

/* Removes a row within a batch. */
ST_MUST_CHECK enum st store_remove(struct site *site, enum store_table table, int64_t id,
                                   struct errctx *err);

int64_t store_now_utc_ns(const struct site *site);

#endif
