#include "site/job_row.h"

#include "site/chunk_row.h"
#include "site/files.h"

#include <stdlib.h>
#include <string.h>

/* True if a statement with the hash bound as ?1 has a row. */
static enum st has_row(struct site *site, const char *sql, const uint8_t sha256[HASH_SHA256_BYTES],
                       bool *out_has, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    struct row_value value = row_blob(sha256, HASH_SHA256_BYTES);
    enum st st = store_query(site, sql, NULL, 0, &stmt, err);
    if (!st)
        st = row_bind(stmt, 1, &value);
    if (st)
        return st;
    int rc = sqlite3_step(stmt);
    if (rc == SQLITE_ROW || rc == SQLITE_DONE)
        *out_has = rc == SQLITE_ROW;
    else
        st = store_error(site, err, "read");
    (void)sqlite3_reset(stmt);
    return st;
}

/* True if it is link 0 of a stream. */
static enum st is_first_link(struct site *site, const uint8_t sha256[HASH_SHA256_BYTES],
                             bool *out_is, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    uint8_t row[HASH_SHA256_BYTES], link[HASH_SHA256_BYTES];
    bool is = false;
    enum st st = store_query(site, "SELECT * FROM stream", NULL, 0, &stmt, err);
    while (!st && !is) {
        st = store_fetch(site, stmt, STORE_STREAM, err);
        if (!st)
            st = row_get_blob(stmt, store_hashed_columns(STORE_STREAM), row, sizeof row, err);
        if (!st)
            st = chunk_row_first(row, link);
        is = !st && !memcmp(link, sha256, sizeof link);
    }
    (void)sqlite3_reset(stmt);
    if (st && st != ST_NOT_FOUND)
        return st;
    *out_is = is;
    return ST_OK;
}

enum st job_row_knows(struct site *site, const uint8_t sha256[HASH_SHA256_BYTES], bool *out_known,
                      struct errctx *err) {
    static const char *const sql[] = {
        "SELECT 1 FROM file WHERE sha256 = ?1", "SELECT 1 FROM calib WHERE sha256 = ?1",
        "SELECT 1 FROM chunk WHERE chain = ?1", "SELECT 1 FROM job WHERE key = ?1"};
    bool known = false;
    enum st st = ST_OK;
    for (size_t i = 0; i < sizeof sql / sizeof sql[0] && !st && !known; i++)
        st = has_row(site, sql[i], sha256, &known, err);
    if (!st && !known)
        st = is_first_link(site, sha256, &known, err);
    if (!st)
        *out_known = known;
    return st;
}

/* Columns: id job_id direction role sha256 outside. */
static enum st read_hash(sqlite3_stmt *stmt, struct job_hash *out_hash,
                         enum job_row_direction *out_direction, struct errctx *err) {
    struct job_hash hash = {.outside = sqlite3_column_int(stmt, 5) != 0};
    int32_t direction = 0;
    enum st st = row_get_int32(stmt, 2, &direction, err);
    if (!st)
        st = row_get_text(stmt, 3, hash.role, sizeof hash.role, err);
    if (!st)
        st = row_get_blob(stmt, 4, hash.sha256, sizeof hash.sha256, err);
    if (!st && direction != JOB_ROW_INPUT && direction != JOB_ROW_OUTPUT)
        st = errctx_set(err, ST_DAMAGED, "site.db: table job_hash, row %lld makes no sense",
                        (long long)sqlite3_column_int64(stmt, 0));
    if (st)
        return st;
    *out_hash = hash;
    *out_direction = (enum job_row_direction)direction;
    return ST_OK;
}

static const char hashes_sql[] = "SELECT * FROM job_hash WHERE job_id = ?1 ORDER BY id";

enum st job_row_has_outputs(struct site *site, int64_t job_id, bool *out_all, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    bool all = true;
    enum st st = store_query(site, hashes_sql, &job_id, 1, &stmt, err);
    while (!st && all) {
        struct job_hash hash;
        enum job_row_direction direction = JOB_ROW_INPUT;
        st = store_fetch(site, stmt, STORE_JOB_HASH, err);
        if (!st)
            st = read_hash(stmt, &hash, &direction, err);
        if (st || direction != JOB_ROW_OUTPUT || hash.outside)
            continue;
        char path[FILEIO_PATH_MAX];
        st = files_path(site, hash.sha256, path, err);
        if (!st)
            all = fileio_exists(path);
        else if (st == ST_NOT_FOUND) /* not a file, or a file without a row */
            st = job_row_knows(site, hash.sha256, &all, err);
    }
    (void)sqlite3_reset(stmt);
    if (st && st != ST_NOT_FOUND)
        return st;
    *out_all = all;
    return ST_OK;
}

/* A job and what it points to, in one allocation. */
struct whole {
    struct job job;
    struct job_hash hashes[];
};

static enum st count_hashes(struct site *site, int64_t id, size_t *out_count, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    enum st st =
        store_query(site, "SELECT count(*) FROM job_hash WHERE job_id = ?1", &id, 1, &stmt, err);
    if (st)
        return st;
    if (sqlite3_step(stmt) != SQLITE_ROW)
        st = store_error(site, err, "read");
    int64_t count = sqlite3_column_int64(stmt, 0);
    (void)sqlite3_reset(stmt);
    if (!st && (count < 0 || count > 2 * JOB_MAX_HASHES))
        st = errctx_set(err, ST_DAMAGED, "%s/site.db: job %lld has %lld inputs and outputs",
                        site->path, (long long)id, (long long)count);
    if (!st)
        *out_count = (size_t)count;
    return st;
}

/* Inputs come first, as they were written. */
static enum st fill_hashes(struct site *site, struct whole *whole, size_t count,
                           struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    size_t n = 0;
    enum st st = store_query(site, hashes_sql, &whole->job.id, 1, &stmt, err);
    for (; !st && n < count; n++) {
        enum job_row_direction direction = JOB_ROW_INPUT;
        st = store_fetch(site, stmt, STORE_JOB_HASH, err);
        if (!st)
            st = read_hash(stmt, &whole->hashes[n], &direction, err);
        if (!st && direction == JOB_ROW_INPUT && whole->job.output_count > 0)
            st = errctx_set(err, ST_DAMAGED, "%s/site.db: job %lld: inputs behind outputs",
                            site->path, (long long)whole->job.id);
        if (!st && direction == JOB_ROW_INPUT)
            whole->job.input_count++;
        else if (!st)
            whole->job.output_count++;
    }
    (void)sqlite3_reset(stmt);
    if (st == ST_NOT_FOUND)
        st = errctx_set(err, ST_DAMAGED, "%s/site.db: job %lld lost an input or output", site->path,
                        (long long)whole->job.id);
    whole->job.inputs = whole->hashes;
    whole->job.outputs = whole->hashes + whole->job.input_count;
    return st;
}

/* Columns: id kind parameters program key seconds utc_ns. */
static enum st fill_job(sqlite3_stmt *stmt, struct job *job, char *parameters, size_t capacity,
                        struct errctx *err) {
    job->id = sqlite3_column_int64(stmt, 0);
    job->seconds = row_get_real(stmt, 5);
    job->utc_ns = sqlite3_column_int64(stmt, 6);
    job->parameters = parameters;
    enum st st = row_get_text(stmt, 1, job->kind, sizeof job->kind, err);
    if (!st)
        st = row_get_text(stmt, 2, parameters, capacity, err);
    if (!st)
        st = row_get_text(stmt, 3, job->program, sizeof job->program, err);
    return st;
}

enum st job_read(struct site *site, int64_t id, struct job **out_job, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    struct whole *whole = NULL;
    size_t count = 0;
    enum st st = store_fetch_id(site, STORE_JOB, id, &stmt, err);
    if (st)
        return st;
    size_t text_size = row_read(stmt, 2).size + 1;
    st = count_hashes(site, id, &count, err);
    if (!st) {
        size_t fixed = sizeof *whole + count * sizeof whole->hashes[0];
        whole = calloc(1, fixed + text_size);
        st = whole ? fill_job(stmt, &whole->job, (char *)whole + fixed, text_size, err)
                   : errctx_set(err, ST_NOMEM, "no memory for job %lld", (long long)id);
    }
    (void)sqlite3_reset(stmt);
    if (!st)
        st = fill_hashes(site, whole, count, err);
    if (st) {
        free(whole);
        return st;
    }
    *out_job = &whole->job;
    return ST_OK;
}
