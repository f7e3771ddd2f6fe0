#include "site/row.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <string.h>

/* A rotation read from or given to a site may miss orthonormality by this much: six decimals of
 * text. */
static const double rotation_tolerance = 1e-6;

struct row_value row_null(void) {
    return (struct row_value){.type = SQLITE_NULL};
}

struct row_value row_int(int64_t i) {
    return (struct row_value){.type = SQLITE_INTEGER, .i = i};
}

struct row_value row_id(int64_t id) {
    return id ? row_int(id) : row_null();
}

struct row_value row_real(double f) {
    /* + 0.0: SQLite stores -0.0 as 0.0 */
    return isnan(f) ? row_null() : (struct row_value){.type = SQLITE_FLOAT, .f = f + 0.0};
}

struct row_value row_text(const char *s) {
    return (struct row_value){.type = SQLITE_TEXT, .data = s, .size = strlen(s)};
}

struct row_value row_blob(const void *data, size_t size) {
    return (struct row_value){.type = SQLITE_BLOB, .data = data, .size = size};
}

enum st row_bind(sqlite3_stmt *stmt, int number, const struct row_value *value) {
    int rc;
    switch (value->type) {
    case SQLITE_INTEGER:
        rc = sqlite3_bind_int64(stmt, number, value->i);
        break;
    case SQLITE_FLOAT:
        rc = sqlite3_bind_double(stmt, number, value->f);
        break;
    case SQLITE_TEXT:
        rc =
            sqlite3_bind_text64(stmt, number, value->data, value->size, SQLITE_STATIC, SQLITE_UTF8);
        break;
    case SQLITE_BLOB:
        rc = sqlite3_bind_blob64(stmt, number, value->data, value->size, SQLITE_STATIC);
        break;
    default:
        rc = sqlite3_bind_null(stmt, number);
        break;
    }
    return rc == SQLITE_OK ? ST_OK : ST_NOMEM;
}

struct row_value row_read(sqlite3_stmt *stmt, int column) {
    struct row_value value = {.type = sqlite3_column_type(stmt, column)};
    if (value.type == SQLITE_INTEGER)
        value.i = sqlite3_column_int64(stmt, column);
    else if (value.type == SQLITE_FLOAT)
        value.f = sqlite3_column_double(stmt, column);
    else if (value.type == SQLITE_TEXT)
        value.data = sqlite3_column_text(stmt, column);
    else if (value.type == SQLITE_BLOB)
        value.data = sqlite3_column_blob(stmt, column);
    if (value.data) /* NULL for an empty blob, or without memory: both hash as empty */
        value.size = (size_t)sqlite3_column_bytes(stmt, column);
    return value;
}

void row_put_i64(uint8_t out_bytes[8], int64_t value) {
    uint64_t bits = (uint64_t)value;
    for (int i = 0; i < 8; i++)
        out_bytes[i] = (uint8_t)(bits >> (8 * i));
}

static enum st hash_value(struct hash_sha256 *hash, const struct row_value *value) {
    uint8_t head[9] = {'n'};
    size_t head_size = 1;
    if (value->type != SQLITE_NULL) {
        int64_t number = value->i;
        head[0] = 'i';
        if (value->type == SQLITE_FLOAT) {
            head[0] = 'f';
            memcpy(&number, &value->f, sizeof number);
        } else if (value->type == SQLITE_TEXT || value->type == SQLITE_BLOB) {
            head[0] = value->type == SQLITE_TEXT ? 't' : 'b';
            number = (int64_t)value->size;
        }
        row_put_i64(head + 1, number);
        head_size = sizeof head;
    }
    enum st st = hash_sha256_update(hash, head, head_size);
    if (!st && value->size)
        st = hash_sha256_update(hash, value->data, value->size);
    return st;
}

static enum st hash_begin(struct hash_sha256 *hash, const char *table) {
    static const char label[] = "scancart/row/1";
    enum st st = hash_sha256_init(hash);
    if (!st)
        st = hash_sha256_update(hash, label, sizeof label);
    if (!st)
        st = hash_sha256_update(hash, table, strlen(table) + 1);
    return st;
}

enum st row_hash(const char *table, const struct row_value *values, size_t count,
                 uint8_t out_sha256[HASH_SHA256_BYTES]) {
    struct hash_sha256 hash = {0};
    enum st st = hash_begin(&hash, table);
    for (size_t i = 0; i < count && !st; i++)
        st = hash_value(&hash, &values[i]);
    if (!st)
        st = hash_sha256_final(&hash, out_sha256);
    hash_sha256_fini(&hash);
    return st;
}

enum st row_hash_read(sqlite3_stmt *stmt, const char *table, int columns,
                      uint8_t out_sha256[HASH_SHA256_BYTES]) {
    struct hash_sha256 hash = {0};
    enum st st = hash_begin(&hash, table);
    for (int c = 0; c < columns && !st; c++) {
        struct row_value value = row_read(stmt, c);
        st = hash_value(&hash, &value);
    }
    if (!st)
        st = hash_sha256_final(&hash, out_sha256);
    hash_sha256_fini(&hash);
    return st;
}

static enum st bad_column(sqlite3_stmt *stmt, int column, struct errctx *err) {
    return errctx_set(err, ST_DAMAGED, "site.db: column %s holds no usable value",
                      sqlite3_column_name(stmt, column));
}

enum st row_get_text(sqlite3_stmt *stmt, int column, char *out_text, size_t capacity,
                     struct errctx *err) {
    struct row_value value = row_read(stmt, column);
    if (value.type != SQLITE_TEXT || value.size >= capacity ||
        (value.size && memchr(value.data, 0, value.size)))
        return bad_column(stmt, column, err);
    if (value.size)
        memcpy(out_text, value.data, value.size);
    out_text[value.size] = '\0';
    return ST_OK;
}

enum st row_get_blob(sqlite3_stmt *stmt, int column, void *out_bytes, size_t size,
                     struct errctx *err) {
    struct row_value value = row_read(stmt, column);
    if (value.type != SQLITE_BLOB || value.size != size)
        return bad_column(stmt, column, err);
    memcpy(out_bytes, value.data, size);
    return ST_OK;
}

double row_get_real(sqlite3_stmt *stmt, int column) {
    return sqlite3_column_type(stmt, column) == SQLITE_FLOAT ? sqlite3_column_double(stmt, column)
                                                             : (double)NAN;
}

enum st row_get_int32(sqlite3_stmt *stmt, int column, int32_t *out_value, struct errctx *err) {
    int64_t value = sqlite3_column_int64(stmt, column);
    if (sqlite3_column_type(stmt, column) != SQLITE_INTEGER || value < INT32_MIN ||
        value > INT32_MAX)
        return bad_column(stmt, column, err);
    *out_value = (int32_t)value;
    return ST_OK;
}

void row_put_doubles(uint8_t *out_bytes, const double *values, size_t count) {
    for (size_t i = 0; i < count; i++) {
        int64_t bits;
        memcpy(&bits, &values[i], sizeof bits);
        row_put_i64(out_bytes + 8 * i, bits);
    }
}

enum st row_get_doubles(sqlite3_stmt *stmt, int column, double *out_values, size_t count,
                        struct errctx *err) {
    struct row_value value = row_read(stmt, column);
    if (value.type != SQLITE_BLOB || value.size != 8 * count)
        return bad_column(stmt, column, err);
    const uint8_t *bytes = value.data;
    for (size_t i = 0; i < count; i++) {
        uint64_t bits = 0;
        for (int b = 0; b < 8; b++)
            bits |= (uint64_t)bytes[8 * i + (size_t)b] << (8 * b);
        memcpy(&out_values[i], &bits, sizeof bits);
        if (!isfinite(out_values[i]))
            return bad_column(stmt, column, err);
    }
    return ST_OK;
}

void row_put_pose(uint8_t out_bytes[ROW_POSE_BYTES], const struct pose *pose) {
    const double t_m[3] = {pose->t_m.x, pose->t_m.y, pose->t_m.z};
    row_put_doubles(out_bytes, pose->r.m, 9);
    row_put_doubles(out_bytes + 72, t_m, 3);
}

enum st row_check_pose(const struct pose *pose, struct errctx *err) {
    bool finite = vec3_is_finite(pose->t_m);
    for (int i = 0; i < 9; i++)
        finite = finite && isfinite(pose->r.m[i]);
    if (!finite)
        return errctx_set(err, ST_INVALID, "the pose holds a number that is not finite");
    double off = pose_orthonormality_error(&pose->r);
    if (!(off <= rotation_tolerance))
        return errctx_set(err, ST_INVALID, "the pose's matrix is not a rotation (off by %g)", off);
    return ST_OK;
}

enum st row_get_pose(sqlite3_stmt *stmt, int column, struct pose *out_pose, struct errctx *err) {
    double v[12];
    enum st st = row_get_doubles(stmt, column, v, 12, err);
    if (st)
        return st;
    struct pose pose = {.t_m = {v[9], v[10], v[11]}};
    memcpy(pose.r.m, v, sizeof pose.r.m);
    if (row_check_pose(&pose, NULL))
        return bad_column(stmt, column, err);
    *out_pose = pose;
    return ST_OK;
}

enum st row_check_json(const char *text, const char *what, struct errctx *err) {
    if (!text || !*text)
        return ST_OK;
    size_t size = strlen(text);
    if (size >= SITE_TEXT_MAX)
        return errctx_set(err, ST_INVALID, "%s: %zu bytes of JSON, at most %d fit", what, size,
                          SITE_TEXT_MAX - 1);
    cJSON *json = cJSON_ParseWithOpts(text, NULL, 1);
    if (!json)
        return errctx_set(err, ST_INVALID, "%s: not valid JSON", what);
    cJSON_Delete(json);
    return ST_OK;
}
