/* A site from somebody else: any bytes in site.db, and any values in rows whose hashes are right.
 * Whatever it holds, reading and checking it ends, and a check of it never says that nothing could
 * be checked for a reason of our own.
 *
 * The input is a list of records of 8 bytes; the first byte chooses: even, a patch (3 bytes offset,
 * 1 byte value); odd, a value for a column of a table (table, column, kind, 4 bytes), after which
 * the row is hashed anew. */
#include "base/fileio.h"
#include "site/row.h"
#include "site/site_check.h"
#include "tests/support/site_sample.h"
#include "tests/support/tempdir.h"

#include <stdlib.h>

enum { TEXT_MAX = 1024, RECORD = 8, RECORDS_MAX = 32 };

static char dir[TEMPDIR_MAX], folder[TEXT_MAX], db_path[TEXT_MAX + 16];
static uint8_t *intact;
static size_t intact_size;

static void clean_up(void) {
    tempdir_remove(dir);
    free(intact);
}

static void prepare(void) {
    if (intact)
        return;
    if (!tempdir_make(dir))
        abort();
    (void)snprintf(folder, sizeof folder, "%s/site", dir);
    (void)snprintf(db_path, sizeof db_path, "%s/site.db", folder);
    if (site_sample_make(folder, NULL) ||
        fileio_read(db_path, (size_t)1 << 30, &intact, &intact_size, NULL))
        abort();
    (void)atexit(clean_up);
}

static void write_db(void) {
    FILE *out = fopen(db_path, "wb");
    if (!out || fwrite(intact, 1, intact_size, out) != intact_size || fclose(out))
        abort();
}

static void patch(const uint8_t *record) {
    uint64_t offset = (uint64_t)record[1] | (uint64_t)record[2] << 8 | (uint64_t)record[3] << 16;
    FILE *out = fopen(db_path, "r+b");
    if (!out || fseek(out, (long)(offset % intact_size), SEEK_SET) ||
        fputc(record[4], out) == EOF || fclose(out))
        abort();
}

static struct row_value hostile(const uint8_t *record) {
    static const uint8_t bytes[4096] = {0xff, 0xf8, 0x7f, '"', '\\', '{', 0x1b};
    static const char *const texts[] = {"",         "{",   "\x1b[31m", "../../etc/passwd",
                                        "\xff\xfe", "null"};
    int64_t number = (int64_t)((uint64_t)record[4] | (uint64_t)record[5] << 8 |
                               (uint64_t)record[6] << 16 | (uint64_t)record[7] << 24);
    switch (record[3] % 8) {
    case 0:
        return row_int(number);
    case 1:
        return row_int(-number);
    case 2:
        return row_int(INT64_MAX - number);
    case 3:
        return row_int(INT64_MIN + number);
    case 4:
        return row_text(texts[(size_t)number % (sizeof texts / sizeof texts[0])]);
    case 5:
        return row_blob(bytes, (size_t)number % sizeof bytes);
    case 6:
        return row_real((double)number * 1e300);
    default:
        return row_null();
    }
}

/* Hashes all rows of a table anew, as somebody would who wants to be believed. */
static void hash_again(sqlite3 *db, const char *table) {
    char sql[128];
    sqlite3_stmt *select = NULL, *update = NULL;
    (void)snprintf(sql, sizeof sql, "SELECT * FROM %s", table);
    (void)sqlite3_prepare_v2(db, sql, -1, &select, NULL);
    (void)snprintf(sql, sizeof sql, "UPDATE %s SET row_sha256 = ?2 WHERE id = ?1", table);
    (void)sqlite3_prepare_v2(db, sql, -1, &update, NULL);
    while (select && update && sqlite3_step(select) == SQLITE_ROW) {
        uint8_t sha256[HASH_SHA256_BYTES];
        int columns = 0;
        while (columns < sqlite3_column_count(select) &&
               strcmp(sqlite3_column_name(select, columns), "row_sha256") != 0)
            columns++;
        if (row_hash_read(select, table, columns, sha256))
            abort();
        (void)sqlite3_bind_int64(update, 1, sqlite3_column_int64(select, 0));
        (void)sqlite3_bind_blob(update, 2, sha256, sizeof sha256, SQLITE_TRANSIENT);
        (void)sqlite3_step(update);
        (void)sqlite3_reset(update);
    }
    (void)sqlite3_finalize(select);
    (void)sqlite3_finalize(update);
}

static void set_value(const uint8_t *record) {
    static const char *const tables[] = {"site",   "georef",   "station", "station_pose", "calib",
                                         "stream", "chunk",    "ledger",  "file",         "frame",
                                         "job",    "job_hash", "photo",   "custody"};
    const char *table = tables[record[1] % (sizeof tables / sizeof tables[0])];
    char sql[256];
    sqlite3 *db = NULL;
    sqlite3_stmt *stmt = NULL;
    struct row_value value = hostile(record);
    if (sqlite3_open(db_path, &db) == SQLITE_OK) {
        (void)snprintf(sql, sizeof sql, "SELECT * FROM %s", table);
        (void)sqlite3_prepare_v2(db, sql, -1, &stmt, NULL);
        int columns = stmt ? sqlite3_column_count(stmt) : 0;
        const char *column = columns ? sqlite3_column_name(stmt, record[2] % columns) : "id";
        (void)snprintf(sql, sizeof sql,
                       "UPDATE OR IGNORE %s SET %s = ?1 WHERE id = (SELECT max(id) FROM %s)", table,
                       column, table);
        (void)sqlite3_finalize(stmt);
        if (sqlite3_prepare_v2(db, sql, -1, &stmt, NULL) == SQLITE_OK && !row_bind(stmt, 1, &value))
            (void)sqlite3_step(stmt);
        (void)sqlite3_finalize(stmt);
        hash_again(db, table);
    }
    (void)sqlite3_close(db);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    prepare();
    write_db();
    for (size_t i = 0; i + RECORD <= size && i < RECORD * RECORDS_MAX; i += RECORD)
        if (data[i] % 2)
            set_value(data + i);
        else
            patch(data + i);
    struct site_check_result result;
    struct errctx err = {0};
    enum st st = site_check(folder, NULL, &result, &err);
    if (st && st != ST_UNSUPPORTED) {
        (void)fprintf(stderr, "%s\n", err.text);
        abort();
    }
    if (!site_sample_read_all(folder))
        abort();
    return 0;
}
