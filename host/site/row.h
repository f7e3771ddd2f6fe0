/* Values of database rows: to bind, to read back with their bounds checked, to hash. Only for
 * host/site.
 *
 * Row hash. The columns of a table before `row_sha256` are hashed in order:
 *   SHA-256("scancart/row/1" 0 table 0 { 'n' | 'i' i64 | 'f' f64 | 't' u64 bytes | 'b' u64 bytes }
 * ...) (little-endian, -0.0 as 0.0). A column behind row_sha256 is too big to hash twice and is
 * covered otherwise. */
#ifndef SC_SITE_ROW_H
#define SC_SITE_ROW_H

#include "base/hash.h"
#include "base/pose.h"
#include "base/st.h"
#include "site/site.h"

#include <sqlite3.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* One value of a row. */
struct row_value {
    int type; /* SQLITE_NULL, SQLITE_INTEGER, SQLITE_FLOAT, SQLITE_TEXT, SQLITE_BLOB */
    int64_t i;
    double f;
    const void *data;
    size_t size;
};
struct row_value row_null(void);
struct row_value row_int(int64_t i);
struct row_value row_id(int64_t id); /* 0 is NULL: "none" */
struct row_value row_real(double f); /* NaN is NULL */
struct row_value row_text(const char *s);
struct row_value row_blob(const void *data, size_t size);

/* ST_NOMEM or ST_OK. */
ST_MUST_CHECK enum st row_bind(sqlite3_stmt *stmt, int number, const struct row_value *value);

/* Hash of a row that is to be written, and of the first `columns` columns a statement stands on. */
ST_MUST_CHECK enum st row_hash(const char *table, const struct row_value *values, size_t count,
                               uint8_t out_sha256[HASH_SHA256_BYTES]);
ST_MUST_CHECK enum st row_hash_read(sqlite3_stmt *stmt, const char *table, int columns,
                                    uint8_t out_sha256[HASH_SHA256_BYTES]);
/* The column as a value; its data is valid until the statement moves. */
struct row_value row_read(sqlite3_stmt *stmt, int column);

/* Columns of the row a statement stands on; ST_DAMAGED if they do not fit what is asked for. */
ST_MUST_CHECK enum st row_get_text(sqlite3_stmt *stmt, int column, char *out_text, size_t capacity,
                                   struct errctx *err);
ST_MUST_CHECK enum st row_get_blob(sqlite3_stmt *stmt, int column, void *out_bytes, size_t size,
                                   struct errctx *err);
double row_get_real(sqlite3_stmt *stmt, int column); /* NULL is NaN */
ST_MUST_CHECK enum st row_get_int32(sqlite3_stmt *stmt, int column, int32_t *out_value,
                                    struct errctx *err);
/* Little-endian doubles. */
ST_MUST_CHECK enum st row_get_doubles(sqlite3_stmt *stmt, int column, double *out_values,
                                      size_t count, struct errctx *err);
void row_put_doubles(uint8_t *out_bytes, const double *values, size_t count);
void row_put_i64(uint8_t out_bytes[8], int64_t value);

/* A pose as 12 doubles: the rotation's rows, then the translation. */
enum { ROW_POSE_BYTES = 96 };
void row_put_pose(uint8_t out_bytes[ROW_POSE_BYTES], const struct pose *pose);
ST_MUST_CHECK enum st row_get_pose(sqlite3_stmt *stmt, int column, struct pose *out_pose,
                                   struct errctx *err);
/* ST_INVALID unless finite and a rotation within 1e-6. */
ST_MUST_CHECK enum st row_check_pose(const struct pose *pose, struct errctx *err);
/* ST_INVALID unless NULL, "" or JSON text that fits SITE_TEXT_MAX. */
ST_MUST_CHECK enum st row_check_json(const char *text, const char *what, struct errctx *err);

#endif
