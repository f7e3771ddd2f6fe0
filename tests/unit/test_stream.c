#include "site/stream.h"

#include "base/hash.h"
#include "site/site_check.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/site_sample.h"
#include "tests/support/tempdir.h"

#include <sqlite3.h>

enum { TEXT_MAX = 1024, SIZE = 100000 };

static char dir[TEMPDIR_MAX], path[TEXT_MAX];
static struct site *site;
static int64_t stream_id;
static uint8_t payload[SIZE];

static int setup_level(int32_t zstd_level) {
    struct errctx err = {0};
    struct site_info info = {0};
    if (!tempdir_make(dir))
        return -1;
    (void)snprintf(path, sizeof path, "%s/site", dir);
    site_sample_bytes(7, payload, sizeof payload);
    return site_create(path, &info, &site, &err) ||
                   site_sample_stream(site, zstd_level, &stream_id, &err)
               ? -1
               : 0;
}

static int setup(void **state) {
    (void)state;
    return setup_level(0);
}

static int setup_zstd(void **state) {
    (void)state;
    return setup_level(3);
}

static int teardown(void **state) {
    (void)state;
    (void)site_close(site, NULL);
    site = NULL;
    tempdir_remove(dir);
    return 0;
}

static void append(int64_t first, int64_t count, size_t size) {
    struct errctx err = {0};
    struct stream_chunk chunk = site_sample_chunk(first, count, payload, size);
    assert_int_equal(stream_append(site, stream_id, &chunk, 1, &err), ST_OK);
}

static void put_i64(uint8_t *out, int64_t value) {
    for (int i = 0; i < 8; i++)
        out[i] = (uint8_t)((uint64_t)value >> (8 * i));
}

/* Runs SQL on the database; the site must be closed. */
static void meddle(const char *sql) {
    char db_path[2 * TEXT_MAX];
    sqlite3 *db = NULL;
    assert_int_equal(site_close(site, NULL), ST_OK);
    (void)snprintf(db_path, sizeof db_path, "%s/site.db", path);
    assert_int_equal(sqlite3_open(db_path, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, sql, NULL, NULL, NULL), SQLITE_OK);
    assert_int_equal(sqlite3_close(db), SQLITE_OK);
    assert_int_equal(site_open(path, SITE_READ, &site, NULL), ST_OK);
}

static void stream_comes_back_as_added(void **state) {
    (void)state;
    struct errctx err = {0};
    struct stream found;
    assert_int_equal(stream_get(site, stream_id, &found, &err), ST_OK);
    assert_string_equal(found.kind, "head");
    assert_string_equal(found.meta, "{\"rate_hz\":25000}");
    assert_true(found.origin_m.x == 0.1 && found.origin_m.z == 0.3);
    assert_int_equal(stream_find(site, found.station_id, "head", NULL, &found, &err), ST_OK);
    assert_int_equal(found.id, stream_id);
    assert_int_equal(stream_find(site, found.station_id, "head", "sn-2", &found, &err),
                     ST_NOT_FOUND);
    assert_int_equal(stream_add(site, &found, &stream_id, &err), ST_EXISTS);
    found.station_id = 99;
    assert_int_equal(stream_add(site, &found, &stream_id, &err), ST_NOT_FOUND);
    found.station_id = 1;
    (void)snprintf(found.meta, sizeof found.meta, "{not json");
    assert_int_equal(stream_add(site, &found, &stream_id, &err), ST_INVALID);
    struct stream list[4];
    size_t count = 0;
    assert_int_equal(stream_list(site, 0, 0, list, 4, &count, &err), ST_OK);
    assert_int_equal(count, 1);
}

static void chunks_come_back_byte_for_byte(void **state) {
    (void)state;
    struct errctx err = {0};
    for (int i = 0; i < 5; i++)
        append(10 * i, 10, (size_t)SIZE / (size_t)(i + 1));
    struct stream_reader *reader = NULL;
    struct stream_chunk chunk;
    assert_int_equal(stream_reader_open(site, stream_id, 1, &reader, &err), ST_OK);
    for (int i = 1; i < 5; i++) {
        assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_OK);
        assert_int_equal(chunk.sequence, i);
        assert_int_equal(chunk.first_item, 10 * i);
        assert_int_equal(chunk.t_last_ns, 1000 * (10 * i + 10));
        assert_int_equal(chunk.size_bytes, SIZE / (i + 1));
        assert_memory_equal(chunk.payload, payload, chunk.size_bytes);
    }
    assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_NOT_FOUND);
    append(50, 1, 1);
    assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_OK);
    assert_int_equal(chunk.size_bytes, 1);
    stream_reader_close(reader);
}

static void chain_is_what_the_header_file_says(void **state) {
    (void)state;
    struct errctx err = {0};
    append(5, 10, 1000);
    append(20, 0, 77);
    uint8_t row[HASH_SHA256_BYTES], link[HASH_SHA256_BYTES];
    char db_path[2 * TEXT_MAX];
    sqlite3 *db = NULL;
    sqlite3_stmt *stmt = NULL;
    (void)snprintf(db_path, sizeof db_path, "%s/site.db", path);
    assert_int_equal(sqlite3_open(db_path, &db), SQLITE_OK);
    assert_int_equal(sqlite3_prepare_v2(db, "SELECT row_sha256 FROM stream", -1, &stmt, NULL),
                     SQLITE_OK);
    assert_int_equal(sqlite3_step(stmt), SQLITE_ROW);
    memcpy(row, sqlite3_column_blob(stmt, 0), sizeof row);
    (void)sqlite3_finalize(stmt);
    (void)sqlite3_close(db);

    static uint8_t bytes[2000];
    memcpy(bytes, "scancart/stream/1", 18);
    memcpy(bytes + 18, row, 32);
    assert_int_equal(hash_sha256(bytes, 50, link), ST_OK);
    const int64_t chunks[2][7] = {{0, 5000, 15000, 5, 15, 10, 1000},
                                  {1, 20000, 20000, 20, 20, 0, 77}};
    for (int c = 0; c < 2; c++) {
        size_t size = (size_t)chunks[c][6];
        memcpy(bytes, link, 32);
        for (int i = 0; i < 7; i++)
            put_i64(bytes + 32 + 8 * i, chunks[c][i]);
        memcpy(bytes + 88, payload, size);
        assert_int_equal(hash_sha256(bytes, 88 + size, link), ST_OK);
    }
    struct stream_state status;
    assert_int_equal(stream_get_state(site, stream_id, &status, &err), ST_OK);
    assert_memory_equal(status.chain, link, sizeof link);
    assert_int_equal(status.chunk_count, 2);
    assert_int_equal(status.item_count, 10);
    assert_int_equal(status.end_item, 20);
    assert_int_equal(status.payload_bytes, 1077);
}

static void compression_keeps_the_chain_and_saves_bytes(void **state) {
    (void)state;
    struct errctx err = {0};
    append(0, 10, SIZE);
    append(10, 10, 1); /* does not shrink: stored as sent */
    struct stream_state packed;
    assert_int_equal(stream_get_state(site, stream_id, &packed, &err), ST_OK);
    assert_int_equal(packed.payload_bytes, SIZE + 1);
    assert_true(packed.stored_bytes < SIZE * 3 / 4);
    struct stream_reader *reader = NULL;
    struct stream_chunk chunk;
    assert_int_equal(stream_reader_open(site, stream_id, 0, &reader, &err), ST_OK);
    assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_OK);
    assert_memory_equal(chunk.payload, payload, SIZE);
    assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_OK);
    assert_int_equal(chunk.size_bytes, 1);
    stream_reader_close(reader);
}

static void refuses_chunks_that_do_not_follow(void **state) {
    (void)state;
    struct errctx err = {0};
    append(0, 10, 100);
    struct stream_chunk good = site_sample_chunk(10, 5, payload, 100), bad[8];
    for (int i = 0; i < 8; i++)
        bad[i] = good;
    bad[0].first_item = 9;
    bad[1].end_item = 9;
    bad[2].item_count = 6;
    bad[3].size_bytes = 0;
    bad[4].size_bytes = (size_t)STREAM_CHUNK_MAX_BYTES + 1;
    bad[5].t_last_ns = bad[5].t_first_ns - 1;
    bad[6].item_count = -1;
    bad[7].payload = NULL;
    for (int i = 0; i < 8; i++) {
        struct stream_chunk two[2] = {good, bad[i]};
        if (i == 0)
            two[1].first_item = 14;
        assert_int_equal(stream_append(site, stream_id, two, 2, &err), ST_INVALID);
        struct stream_state status;
        assert_int_equal(stream_get_state(site, stream_id, &status, &err), ST_OK);
        assert_int_equal(status.chunk_count, 1); /* all or none */
    }
    assert_int_equal(stream_append(site, 77, &good, 1, &err), ST_NOT_FOUND);
    append(10, 5, 100);
}

static int64_t check_errors(struct site_check_result *result) {
    struct errctx err = {0};
    assert_int_equal(site_check(path, NULL, result, &err), ST_OK);
    return result->errors;
}

static void what_is_missing_must_stand_in_the_ledger(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site_check_result result;
    struct stream_chunk holes = site_sample_chunk(20, 10, payload, 100);
    holes.item_count = 7;
    append(0, 10, 100);
    assert_int_equal(check_errors(&result), 0);
    assert_int_equal(stream_append(site, stream_id, &holes, 1, &err), ST_OK);
    assert_int_equal(check_errors(&result), 1);
    assert_non_null(strstr(result.first.what, "13 items are missing"));
    struct stream_ledger entry = {
        .stream_id = stream_id, .first_item = 10, .end_item = 22, .t_ns = 1, .reason = "usb_lost"};
    assert_int_equal(stream_ledger_add(site, &entry, &err), ST_OK);
    assert_int_equal(check_errors(&result), 1);
    entry = (struct stream_ledger){
        .stream_id = stream_id, .first_item = 25, .end_item = 26, .t_ns = 1, .reason = "crc"};
    assert_int_equal(stream_ledger_add(site, &entry, &err), ST_OK);
    assert_int_equal(check_errors(&result), 0);
    struct stream_state status;
    assert_int_equal(stream_get_state(site, stream_id, &status, &err), ST_OK);
    assert_int_equal(status.item_count + status.missing_count, status.end_item);
    entry.first_item = 21;
    entry.end_item = 22;
    assert_int_equal(stream_ledger_add(site, &entry, &err), ST_OK);
    assert_true(check_errors(&result) > 0); /* counted twice */
    struct stream_ledger list[4];
    size_t count = 0;
    assert_int_equal(stream_ledger_list(site, stream_id, 1, list, 4, &count, &err), ST_OK);
    assert_int_equal(count, 2);
    assert_string_equal(list[0].reason, "crc");
    entry.end_item = entry.first_item;
    assert_int_equal(stream_ledger_add(site, &entry, &err), ST_INVALID);
}

static void reader_names_a_damaged_chunk_and_goes_on(void **state) {
    (void)state;
    struct errctx err = {0};
    for (int i = 0; i < 4; i++)
        append(i, 1, 5000);
    meddle("UPDATE chunk SET payload = zeroblob(5000) WHERE sequence = 1;"
           "UPDATE chunk SET item_count = 9 WHERE sequence = 2");
    struct stream_reader *reader = NULL;
    struct stream_chunk chunk;
    assert_int_equal(stream_reader_open(site, stream_id, 0, &reader, &err), ST_OK);
    assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_OK);
    assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_DAMAGED);
    assert_non_null(strstr(err.text, "chunk 1"));
    assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_DAMAGED);
    assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_OK);
    assert_int_equal(chunk.sequence, 3);
    assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_NOT_FOUND);
    stream_reader_close(reader);
}

static void reader_ends_whatever_the_sequence_numbers_are(void **state) {
    (void)state;
    struct errctx err = {0};
    for (int i = 0; i < 3; i++)
        append(i, 1, 500);
    meddle("UPDATE chunk SET sequence = 9223372036854775807 WHERE sequence = 2;"
           "UPDATE chunk SET sequence = 1000000000000000 WHERE sequence = 1");
    struct stream_reader *reader = NULL;
    struct stream_chunk chunk;
    int calls = 0;
    assert_int_equal(stream_reader_open(site, stream_id, 0, &reader, &err), ST_OK);
    assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_OK);
    while (stream_reader_next(reader, &chunk, &err) == ST_DAMAGED)
        assert_true(++calls < 10);
    assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_NOT_FOUND);
    assert_true(calls >= 2);
    stream_reader_close(reader);
}

static void absurd_sizes_in_the_database_are_refused(void **state) {
    (void)state;
    struct errctx err = {0};
    append(0, 1, 5000);
    meddle("UPDATE chunk SET size_bytes = 9223372036854775807, stored_bytes = -1, codec = 7");
    struct stream_reader *reader = NULL;
    struct stream_chunk chunk;
    assert_int_equal(stream_reader_open(site, stream_id, 0, &reader, &err), ST_OK);
    assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_DAMAGED);
    assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_NOT_FOUND);
    stream_reader_close(reader);
    struct site_check_result result;
    assert_true(check_errors(&result) > 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)
        T(stream_comes_back_as_added),
        T(chunks_come_back_byte_for_byte),
        T(chain_is_what_the_header_file_says),
        cmocka_unit_test_setup_teardown(chunks_come_back_byte_for_byte, setup_zstd, teardown),
        cmocka_unit_test_setup_teardown(chain_is_what_the_header_file_says, setup_zstd, teardown),
        cmocka_unit_test_setup_teardown(compression_keeps_the_chain_and_saves_bytes, setup_zstd,
                                        teardown),
        T(refuses_chunks_that_do_not_follow),
        T(what_is_missing_must_stand_in_the_ledger),
        T(reader_names_a_damaged_chunk_and_goes_on),
        T(reader_ends_whatever_the_sequence_numbers_are),
        T(absurd_sizes_in_the_database_are_refused),
#undef T
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
