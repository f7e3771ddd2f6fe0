#include "site/calib.h"

#include "site/batch.h"
#include "site/store.h"

#include <stdio.h>
#include <string.h>

/* Columns: id kind name status format sha256 body utc_ns. */
static enum st read_record(sqlite3_stmt *stmt, struct calib *out_record, struct errctx *err) {
    struct calib record = {.id = sqlite3_column_int64(stmt, 0),
                           .utc_ns = sqlite3_column_int64(stmt, 7)};
    int32_t status = 0, format = 0;
    enum st st = row_get_text(stmt, 1, record.kind, sizeof record.kind, err);
    if (!st)
        st = row_get_text(stmt, 2, record.name, sizeof record.name, err);
    if (!st)
        st = row_get_int32(stmt, 3, &status, err);
    if (!st)
        st = row_get_int32(stmt, 4, &format, err);
    if (!st)
        st = row_get_blob(stmt, 5, record.sha256, sizeof record.sha256, err);
    record.size_bytes = row_read(stmt, 6).size;
    if (!st && (status < CALIB_NOMINAL || status > CALIB_TRUE || format < CALIB_YAML ||
                format > CALIB_JSON || record.size_bytes > CALIB_MAX_BYTES))
        st = errctx_set(err, ST_DAMAGED, "site.db: calibration record %lld makes no sense",
                        (long long)record.id);
    if (st)
        return st;
    record.status = (enum calib_status)status;
    record.format = (enum calib_format)format;
    *out_record = record;
    return ST_OK;
}

/* The newest record of a kind that passes: name NULL, status 0, sha256 NULL pass all. */
static enum st find_newest(struct site *site, const char *kind, const char *name,
                           enum calib_status status, const uint8_t *sha256,
                           struct calib *out_record, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    struct row_value value = row_text(kind);
    enum st st = store_query(site, "SELECT * FROM calib WHERE kind = ?1 ORDER BY id DESC", NULL, 0,
                             &stmt, err);
    if (!st)
        st = row_bind(stmt, 1, &value);
    struct calib record = {0};
    for (bool found = false; !st && !found;) {
        st = store_fetch(site, stmt, STORE_CALIB, err);
        if (!st)
            st = read_record(stmt, &record, err);
        found = !st && (!name || !strcmp(name, record.name)) &&
                (!status || status == record.status) &&
                (!sha256 || !memcmp(sha256, record.sha256, sizeof record.sha256));
    }
    (void)sqlite3_reset(stmt);
    if (!st)
        *out_record = record;
    return st;
}

enum st calib_find(struct site *site, const char *kind, const char *name, enum calib_status status,
                   struct calib *out_record, struct errctx *err) {
    enum st st = find_newest(site, kind, name, status, NULL, out_record, err);
    return st == ST_NOT_FOUND
               ? errctx_set(err, st, "%s has no calibration record of kind %.40s%s%.80s",
                            site->path, kind, name ? " for " : "", name ? name : "")
               : st;
}

static enum st check_record(const struct calib *record, const void *text, size_t size_bytes,
                            struct errctx *err) {
    if (!site_kind_is_valid(record->kind) || !site_name_is_valid(record->name))
        return errctx_set(err, ST_INVALID, "calibration record '%.40s' of '%.80s': bad name",
                          record->kind, record->name);
    if (record->status < CALIB_NOMINAL || record->status > CALIB_TRUE ||
        record->format < CALIB_YAML || record->format > CALIB_JSON)
        return errctx_set(err, ST_INVALID, "calibration record '%s': bad status or format",
                          record->kind);
    if (size_bytes < 1 || size_bytes > CALIB_MAX_BYTES || memchr(text, 0, size_bytes))
        return errctx_set(err, ST_INVALID,
                          "calibration record '%s': %zu bytes; it must be text of 1 to %d bytes",
                          record->kind, size_bytes, CALIB_MAX_BYTES);
    return ST_OK;
}

enum st calib_add(struct site *site, const struct calib *record, const void *text,
                  size_t size_bytes, int64_t *out_id, struct errctx *err) {
    uint8_t sha256[HASH_SHA256_BYTES];
    enum st st = check_record(record, text, size_bytes, err);
    if (!st && hash_sha256(text, size_bytes, sha256))
        st = errctx_set(err, ST_NOMEM, "cannot hash a calibration record");
    if (!st)
        st = batch_begin(site, err);
    if (st)
        return st;
    struct calib same;
    int64_t id = 0;
    st = find_newest(site, record->kind, record->name, record->status, sha256, &same, err);
    if (!st)
        id = same.id;
    else if (st == ST_NOT_FOUND) {
        struct row_value body = {.type = SQLITE_TEXT, .data = text, .size = size_bytes};
        struct row_value values[] = {row_int(0),
                                     row_text(record->kind),
                                     row_text(record->name),
                                     row_int((int64_t)record->status),
                                     row_int((int64_t)record->format),
                                     row_blob(sha256, sizeof sha256),
                                     body,
                                     row_int(store_now_utc_ns(site))};
        st = store_insert(site, STORE_CALIB, values, 8, NULL, &id, err);
    }
    st = batch_end(site, st, err);
    if (!st)
        *out_id = id;
    return st;
}

enum st calib_add_yaml(struct site *site, const char *kind, const char *name,
                       enum calib_status status, const char *text, int64_t *out_id,
                       struct errctx *err) {
    struct calib record;
    memset(&record, 0, sizeof record);
    record.status = status;
    record.format = CALIB_YAML;
    (void)snprintf(record.kind, sizeof record.kind, "%s", kind);
    (void)snprintf(record.name, sizeof record.name, "%s", name);
    return calib_add(site, &record, text, strlen(text), out_id, err);
}

enum st calib_read(struct site *site, int64_t id, struct calib *out_record, char *out_text,
                   size_t capacity, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    struct calib record;
    uint8_t is[HASH_SHA256_BYTES];
    enum st st = store_fetch_id(site, STORE_CALIB, id, &stmt, err);
    if (st)
        return st;
    st = read_record(stmt, &record, err);
    struct row_value body = row_read(stmt, 6);
    if (!st && hash_sha256(body.data ? body.data : "", body.size, is))
        st = errctx_set(err, ST_NOMEM, "cannot hash a calibration record");
    if (!st && memcmp(is, record.sha256, sizeof is) != 0)
        st = errctx_set(err, ST_DAMAGED, "%s/site.db: calibration record %lld: not as written",
                        site->path, (long long)id);
    if (!st && body.size >= capacity)
        st = errctx_set(err, ST_NOMEM, "calibration record %lld has %zu bytes", (long long)id,
                        body.size);
    if (!st) {
        if (body.size)
            memcpy(out_text, body.data, body.size);
        out_text[body.size] = '\0';
        if (out_record)
            *out_record = record;
    }
    (void)sqlite3_reset(stmt);
    return st;
}

static enum st list_read_record(struct site *site, sqlite3_stmt *stmt, void *out_row,
                                struct errctx *err) {
    (void)site;
    return read_record(stmt, out_row, err);
}

enum st calib_list(struct site *site, int64_t after_id, struct calib *out_records, size_t capacity,
                   size_t *out_count, struct errctx *err) {
    return store_list(site, "SELECT * FROM calib WHERE id > ?1 ORDER BY id", &after_id, 1,
                      STORE_CALIB, list_read_record, out_records, sizeof *out_records, capacity,
                      out_count, err);
}
