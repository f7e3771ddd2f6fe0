/* Sites of older schema versions open in this one, with all they hold. */
#include "base/fileio.h"
#include "site/custody.h"
#include "site/job.h"
#include "site/photo_row.h"
#include "site/site_check.h"
#include "site/station.h"
#include "site/stream.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/tempdir.h"

#include <sqlite3.h>

enum { TEXT_MAX = 1024 };

static char dir[TEMPDIR_MAX], path[TEXT_MAX];

static void put(const char *name, const char *text) {
    char file[2 * TEXT_MAX];
    struct errctx err = {0};
    (void)snprintf(file, sizeof file, "%s/%s", path, name);
    assert_int_equal(fileio_write(file, text, strlen(text), &err), ST_OK);
}

/* A site as version 1 wrote it, from its text. */
static int setup(void **state) {
    (void)state;
    uint8_t *sql = NULL;
    size_t size = 0;
    sqlite3 *db = NULL;
    char file[2 * TEXT_MAX];
    struct errctx err = {0};
    if (!tempdir_make(dir))
        return -1;
    (void)snprintf(path, sizeof path, "%s/site", dir);
    (void)snprintf(file, sizeof file, "%s/frames", path);
    assert_int_equal(fileio_mkdirs(file, &err), ST_OK);
    (void)snprintf(file, sizeof file, "%s/photos", path);
    assert_int_equal(fileio_mkdirs(file, &err), ST_OK);
    assert_int_equal(
        fileio_read(SCANCART_SOURCE_DIR "/tests/golden/site_v1.sql", 1 << 20, &sql, &size, &err),
        ST_OK);
    (void)snprintf(file, sizeof file, "%s/site.db", path);
    assert_int_equal(sqlite3_open(file, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, (const char *)sql, NULL, NULL, NULL), SQLITE_OK);
    assert_int_equal(sqlite3_close(db), SQLITE_OK);
    free(sql);
    put("frames/a895a5dda6c7b6141dd908c976503d26ba3e6ad2300bcba6b5370edea2b03c77.jpg", "a frame");
    put("photos/d4e24d749a4fe2f161af2de913c0402b04e3ae287dafd0f9dbfa4a5c56c69285.tif", "a photo");
    return 0;
}

static int teardown(void **state) {
    (void)state;
    tempdir_remove(dir);
    return 0;
}

static void read_what_version_1_wrote(struct site *site) {
    struct errctx err = {0};
    struct site_info info;
    struct station station;
    struct stream stream;
    struct photo_row photo;
    struct stream_reader *reader = NULL;
    struct stream_chunk chunk;
    struct job *job = NULL;
    assert_int_equal(site_get_info(site, &info, &err), ST_OK);
    assert_string_equal(info.name, "first");
    assert_int_equal(info.schema_version, 2);
    assert_true(info.georef.offset_m.y == 5e6);
    assert_int_equal(station_find(site, "stand", &station, &err), ST_OK);
    assert_true(station.pose.world_from_station.t_m.y == -2.25);
    assert_int_equal(stream_find(site, station.id, "head", "sn-1", &stream, &err), ST_OK);
    assert_int_equal(stream_reader_open(site, stream.id, 0, &reader, &err), ST_OK);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(stream_reader_next(reader, &chunk, &err), ST_OK);
        assert_int_equal(chunk.size_bytes, 21);
        assert_memory_equal(chunk.payload, "raw bytes of a device", 21);
    }
    stream_reader_close(reader);
    assert_int_equal(photo_row_find(site, station.id, "front", &photo, &err), ST_OK);
    assert_int_equal(job_read(site, photo.job_id, &job, &err), ST_OK);
    assert_string_equal(job->inputs[0].role, "frame");
    job_free(job);
}

static void version_1_is_checked_as_it_is(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site_check_result result;
    assert_int_equal(site_check(path, NULL, &result, &err), ST_OK);
    if (result.errors)
        fail_msg("%s: %s", result.first.where, result.first.what);
    assert_int_equal(result.rows, 20);
    assert_int_equal(result.files, 2);
}

static void version_1_opens_for_writing(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site *site = NULL;
    assert_int_equal(site_open(path, SITE_WRITE, &site, &err), ST_OK);
    read_what_version_1_wrote(site);
    struct custody_event last;
    assert_int_equal(custody_last(site, &last, &err), ST_OK);
    assert_string_equal(last.what, "upgraded");
    assert_string_equal(last.detail, "{\"from\":1,\"to\":2}");
    assert_int_equal(site_close(site, &err), ST_OK);
    struct site_check_result result;
    assert_int_equal(site_check(path, NULL, &result, &err), ST_OK);
    assert_int_equal(result.errors + result.warnings, 0);
}

static void version_1_opens_for_reading(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site *site = NULL;
    assert_int_equal(site_open(path, SITE_READ, &site, &err), ST_OK);
    assert_int_equal(site_mode_of(site), SITE_READ);
    read_what_version_1_wrote(site);
    assert_int_equal(site_close(site, &err), ST_OK);
}

static void damaged_version_1_is_not_upgraded(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site *site = NULL;
    sqlite3 *db = NULL;
    char file[2 * TEXT_MAX];
    (void)snprintf(file, sizeof file, "%s/site.db", path);
    assert_int_equal(sqlite3_open(file, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, "DROP INDEX job_key", NULL, NULL, NULL), SQLITE_OK);
    assert_int_equal(sqlite3_close(db), SQLITE_OK);
    assert_int_equal(site_open(path, SITE_WRITE, &site, &err), ST_DAMAGED);
    assert_int_equal(site_open(path, SITE_READ, &site, &err), ST_DAMAGED);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)
        T(version_1_is_checked_as_it_is),
        T(version_1_opens_for_writing),
        T(version_1_opens_for_reading),
        T(damaged_version_1_is_not_upgraded),
#undef T
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
