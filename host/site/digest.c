#include "site/digest.h"

#include "site/store.h"

#include <string.h>

void digest_add(struct digest *digest, const uint8_t row_sha256[HASH_SHA256_BYTES]) {
    unsigned carry = 0;
    for (int i = 0; i < HASH_SHA256_BYTES; i++) {
        carry += (unsigned)digest->sum[i] + row_sha256[i];
        digest->sum[i] = (uint8_t)carry;
        carry >>= 8;
    }
    digest->rows++;
    digest->dirty = true;
}

void digest_remove(struct digest *digest, const uint8_t row_sha256[HASH_SHA256_BYTES]) {
    unsigned borrow = 0;
    for (int i = 0; i < HASH_SHA256_BYTES; i++) {
        unsigned take = (unsigned)row_sha256[i] + borrow;
        borrow = digest->sum[i] < take;
        digest->sum[i] = (uint8_t)(digest->sum[i] - take);
    }
    digest->rows--;
    digest->dirty = true;
}

bool digest_equal(const struct digest *a, const struct digest *b) {
    return a->rows == b->rows && !memcmp(a->sum, b->sum, sizeof a->sum);
}

enum st digest_read(struct site *site, enum store_table table, struct digest *out_digest,
                    struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    enum st st = store_query(site, "SELECT * FROM digest WHERE name = ?1", NULL, 0, &stmt, err);
    struct row_value name = row_text(store_table_name(table));
    if (!st)
        st = row_bind(stmt, 1, &name);
    if (st)
        return st;
    struct digest digest = {0};
    uint8_t is[HASH_SHA256_BYTES], should[HASH_SHA256_BYTES];
    int rc = sqlite3_step(stmt);
    if (rc != SQLITE_ROW && rc != SQLITE_DONE)
        st = store_error(site, err, "read");
    else if (rc == SQLITE_DONE || row_get_blob(stmt, 2, digest.sum, sizeof digest.sum, NULL) ||
             row_get_blob(stmt, 3, should, sizeof should, NULL) ||
             row_hash_read(stmt, "digest", 3, is) || memcmp(is, should, sizeof is) != 0)
        st = errctx_set(err, ST_DAMAGED, "%s/site.db: table digest, row %s: not as written",
                        site->path, store_table_name(table));
    else {
        digest.rows = sqlite3_column_int64(stmt, 1);
        *out_digest = digest;
    }
    (void)sqlite3_reset(stmt);
    return st;
}

enum st digest_load(struct site *site, struct digest out_digests[STORE_TABLES],
                    struct errctx *err) {
    enum st st = ST_OK;
    for (int t = 0; t < STORE_TABLES && !st; t++)
        st = digest_read(site, (enum store_table)t, &out_digests[t], err);
    return st;
}

static enum st save_one(struct site *site, enum store_table table, struct errctx *err) {
    struct digest *digest = &site->digests[table];
    struct row_value values[4] = {row_text(store_table_name(table)), row_int(digest->rows),
                                  row_blob(digest->sum, sizeof digest->sum)};
    uint8_t sha256[HASH_SHA256_BYTES];
    if (row_hash("digest", values, 3, sha256))
        return errctx_set(err, ST_NOMEM, "cannot hash a row");
    values[3] = row_blob(sha256, sizeof sha256);
    sqlite3_stmt *stmt = NULL;
    enum st st =
        store_query(site, "INSERT OR REPLACE INTO digest VALUES(?,?,?,?)", NULL, 0, &stmt, err);
    for (int i = 0; i < 4 && !st; i++)
        st = row_bind(stmt, i + 1, &values[i]);
    if (!st && sqlite3_step(stmt) != SQLITE_DONE)
        st = store_error(site, err, "write");
    (void)sqlite3_reset(stmt);
    (void)sqlite3_clear_bindings(stmt);
    if (!st)
        digest->dirty = false;
    return st;
}

enum st digest_save(struct site *site, struct errctx *err) {
    enum st st = ST_OK;
    for (int t = 0; t < STORE_TABLES && !st; t++)
        if (site->digests[t].dirty)
            st = save_one(site, (enum store_table)t, err);
    return st;
}

enum st digest_seal(const struct digest digests[STORE_TABLES],
                    uint8_t out_sha256[HASH_SHA256_BYTES]) {
    struct hash_sha256 hash = {0};
    enum st st = hash_sha256_init(&hash);
    for (int t = 0; t < STORE_TABLES && !st; t++) {
        if (t == STORE_CUSTODY)
            continue;
        const char *name = store_table_name((enum store_table)t);
        uint8_t rows[8];
        row_put_i64(rows, digests[t].rows);
        st = hash_sha256_update(&hash, name, strlen(name) + 1);
        if (!st)
            st = hash_sha256_update(&hash, rows, sizeof rows);
        if (!st)
            st = hash_sha256_update(&hash, digests[t].sum, sizeof digests[t].sum);
    }
    if (!st)
        st = hash_sha256_final(&hash, out_sha256);
    hash_sha256_fini(&hash);
    return st;
}
