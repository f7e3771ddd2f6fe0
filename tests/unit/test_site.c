#include "site/site.h"

#include "base/fileio.h"
#include "site/custody.h"
#include "site/site_check.h"
#include "site/station.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/site_sample.h"
#include "tests/support/tempdir.h"

#include <errno.h>
#include <math.h>
#include <sqlite3.h>
#include <sys/wait.h>

static char dir[TEMPDIR_MAX], path[TEMPDIR_MAX + 64];
enum { TEXT_MAX = 1024 };

static int setup(void **state) {
    (void)state;
    (void)snprintf(path, sizeof path, "?");
    if (!tempdir_make(dir))
        return -1;
    (void)snprintf(path, sizeof path, "%s/site", dir);
    return 0;
}

static int teardown(void **state) {
    (void)state;
    tempdir_remove(dir);
    return 0;
}

static struct site *make(const char *name, struct errctx *err) {
    struct site_info info = {0};
    struct site *site = NULL;
    (void)snprintf(info.name, sizeof info.name, "%s", name);
    if (site_create(path, &info, &site, err))
        (void)printf("%s\n", err->text);
    return site;
}

/* Runs SQL on the site's database as a stranger would. */
static void meddle(const char *sql) {
    char db_path[TEXT_MAX];
    sqlite3 *db = NULL;
    (void)snprintf(db_path, sizeof db_path, "%s/site.db", path);
    assert_int_equal(sqlite3_open(db_path, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, sql, NULL, NULL, NULL), SQLITE_OK);
    assert_int_equal(sqlite3_close(db), SQLITE_OK);
}

static int64_t errors_of_check(struct site_check_result *result) {
    struct errctx err = {0};
    assert_int_equal(site_check(path, NULL, result, &err), ST_OK);
    return result->errors;
}

static void new_site_opens_again_with_its_name_and_place(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site_info info = {.name = "Unfall A7", .georef = {25832, {565000.25, 5930000.5, 12}}};
    struct site *site = NULL;
    assert_int_equal(site_create(path, &info, &site, &err), ST_OK);
    assert_int_equal(site_close(site, &err), ST_OK);
    assert_int_equal(site_open(path, SITE_READ, &site, &err), ST_OK);
    struct site_info found;
    assert_int_equal(site_get_info(site, &found, &err), ST_OK);
    assert_string_equal(found.name, "Unfall A7");
    assert_int_equal(found.georef.epsg, 25832);
    assert_true(found.georef.offset_m.x == 565000.25 && found.georef.offset_m.y == 5930000.5);
    assert_true(found.created_utc_ns > SITE_SAMPLE_UTC_NS);
    assert_int_equal(site_close(site, &err), ST_OK);
    struct site_check_result result;
    assert_int_equal(errors_of_check(&result), 0);
    assert_int_equal(result.warnings, 0);
}

static void name_defaults_to_the_folder(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site *site = make("", &err);
    struct site_info info;
    assert_int_equal(site_get_info(site, &info, &err), ST_OK);
    assert_string_equal(info.name, "site");
    assert_int_equal(site_close(site, &err), ST_OK);
}

static void refuses_to_make_a_site_over_something(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site *site = make("a", &err), *second = NULL;
    struct site_info info = {0};
    assert_int_equal(site_close(site, &err), ST_OK);
    assert_int_equal(site_create(path, &info, &second, &err), ST_EXISTS);
    assert_non_null(strstr(err.text, "is a site already"));
    char other[TEXT_MAX], file[TEXT_MAX];
    (void)snprintf(other, sizeof other, "%s2", path);
    (void)snprintf(file, sizeof file, "%.900s/notes.txt", other);
    assert_int_equal(fileio_mkdir(other, &err), ST_OK);
    assert_int_equal(fileio_write(file, "x", 1, &err), ST_OK);
    assert_int_equal(site_create(other, &info, &second, &err), ST_EXISTS);
    assert_int_equal(site_create(file, &info, &second, &err), ST_EXISTS);
    assert_true(fileio_exists(file));
    (void)snprintf(file, sizeof file, "%.900s/writer.lock", other);
    assert_false(fileio_exists(file));
}

static void takes_an_empty_folder(void **state) {
    (void)state;
    struct errctx err = {0};
    assert_int_equal(fileio_mkdir(path, &err), ST_OK);
    struct site *site = make("a", &err);
    assert_non_null(site);
    assert_int_equal(site_close(site, &err), ST_OK);
}

static void failed_creation_leaves_nothing(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site *site = NULL;
    struct site_info info = {.georef = {0, {1, 2, 3}}};
    assert_int_equal(site_create(path, &info, &site, &err), ST_INVALID);
    info = (struct site_info){.georef = {4326, {NAN, 2, 3}}};
    assert_int_equal(site_create(path, &info, &site, &err), ST_INVALID);
    info = (struct site_info){.name = "a/b"};
    assert_int_equal(site_create(path, &info, &site, &err), ST_INVALID);
    assert_false(fileio_exists(path));
    char deep[TEXT_MAX];
    info = (struct site_info){0};
    (void)snprintf(deep, sizeof deep, "%s/a/b", path);
    assert_int_equal(site_create(deep, &info, &site, &err), ST_NOT_FOUND);
    assert_false(fileio_exists(path));
}

static void failed_open_leaves_nothing(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site *site = NULL;
    char file[TEXT_MAX];
    assert_int_equal(site_open(path, SITE_WRITE, &site, &err), ST_NOT_FOUND);
    assert_false(fileio_exists(path));
    assert_int_equal(fileio_mkdir(path, &err), ST_OK);
    assert_int_equal(site_open(path, SITE_WRITE, &site, &err), ST_NOT_FOUND);
    (void)snprintf(file, sizeof file, "%s/site.db", path);
    assert_int_equal(fileio_write(file, "hello", 5, &err), ST_OK);
    assert_int_equal(site_open(path, SITE_WRITE, &site, &err), ST_FORMAT);
    assert_int_equal(site_open(path, SITE_READ, &site, &err), ST_FORMAT);
    (void)snprintf(file, sizeof file, "%s/writer.lock", path);
    assert_false(fileio_exists(file));
    assert_null(site);
}

static void refuses_a_second_writer_and_names_the_first(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site *first = make("a", &err), *second = NULL;
    char pid[32];
    assert_int_equal(site_open(path, SITE_WRITE, &second, &err), ST_BUSY);
    (void)snprintf(pid, sizeof pid, "process %ld", (long)getpid());
    assert_non_null(strstr(err.text, pid));
    assert_int_equal(site_open(path, SITE_READ, &second, &err), ST_OK);
    assert_int_equal(site_close(second, &err), ST_OK);
    assert_int_equal(site_close(first, &err), ST_OK);
    assert_int_equal(site_open(path, SITE_WRITE, &second, &err), ST_OK);
    assert_int_equal(site_close(second, &err), ST_OK);
}

static void reader_sees_committed_changes_while_a_writer_works(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site *writer = make("a", &err), *reader = NULL;
    struct station_pose pose = site_sample_pose(1);
    struct station found;
    int64_t id = 0;
    assert_int_equal(site_open(path, SITE_READ, &reader, &err), ST_OK);
    assert_int_equal(site_begin(writer, &err), ST_OK);
    assert_int_equal(station_add(writer, "one", NULL, &pose, &id, &err), ST_OK);
    assert_int_equal(station_find(reader, "one", &found, &err), ST_NOT_FOUND);
    assert_int_equal(site_commit(writer, &err), ST_OK);
    assert_int_equal(station_find(reader, "one", &found, &err), ST_OK);
    assert_int_equal(station_add(reader, "two", NULL, &pose, &id, &err), ST_PERMISSION);
    assert_int_equal(site_close(writer, &err), ST_OK);
    assert_int_equal(site_close(reader, &err), ST_OK);
    struct site_check_result result;
    assert_int_equal(errors_of_check(&result), 0);
    assert_int_equal(result.warnings, 0);
}

static void failed_batch_changes_nothing(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site *site = make("a", &err);
    struct station_pose pose = site_sample_pose(1);
    struct station found;
    int64_t id = 0;
    assert_int_equal(site_begin(site, &err), ST_OK);
    assert_int_equal(site_begin(site, &err), ST_INVALID);
    assert_int_equal(station_add(site, "one", NULL, &pose, &id, &err), ST_OK);
    assert_int_equal(station_add(site, "one", NULL, &pose, &id, &err), ST_EXISTS);
    assert_int_equal(station_add(site, "two", NULL, &pose, &id, &err), ST_EXISTS);
    err = (struct errctx){0};
    assert_int_equal(site_commit(site, &err), ST_EXISTS);
    assert_non_null(strstr(err.text, "one"));
    assert_int_equal(station_find(site, "one", &found, &err), ST_NOT_FOUND);
    assert_int_equal(site_begin(site, &err), ST_OK);
    assert_int_equal(station_add(site, "three", NULL, &pose, &id, &err), ST_OK);
    site_rollback(site);
    assert_int_equal(site_commit(site, &err), ST_INVALID);
    assert_int_equal(station_add(site, "four", NULL, &pose, &id, &err), ST_OK);
    assert_int_equal(site_close(site, &err), ST_OK);
    struct site_check_result result;
    assert_int_equal(errors_of_check(&result), 0);
}

static void sessions_are_logged_and_sealed(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site *site = make("a", &err);
    struct station_pose pose = site_sample_pose(1);
    int64_t id = 0;
    assert_int_equal(site_close(site, &err), ST_OK);
    assert_int_equal(site_open(path, SITE_WRITE, &site, &err), ST_OK);
    assert_int_equal(site_close(site, &err), ST_OK); /* changed nothing: no event */
    assert_int_equal(site_open(path, SITE_WRITE, &site, &err), ST_OK);
    site_set_actor(site, "anna", "scancart test");
    site_set_clock(site, SITE_SAMPLE_UTC_NS);
    assert_int_equal(station_add(site, "one", NULL, &pose, &id, &err), ST_OK);
    assert_int_equal(site_close(site, &err), ST_OK);
    assert_int_equal(site_open(path, SITE_READ, &site, &err), ST_OK);
    struct custody_event events[8];
    size_t count = 0;
    assert_int_equal(custody_list(site, 0, events, 8, &count, &err), ST_OK);
    assert_int_equal(count, 4);
    assert_string_equal(events[0].what, "created");
    assert_string_equal(events[1].what, "sealed");
    assert_string_equal(events[2].what, "opened");
    assert_string_equal(events[2].detail, "{\"after\":\"seal\"}");
    assert_string_equal(events[3].what, "sealed");
    assert_string_equal(events[3].who, "anna");
    assert_true(events[3].utc_ns == SITE_SAMPLE_UTC_NS);
    assert_int_equal(site_close(site, &err), ST_OK);
}

static void newer_site_is_refused_with_a_clear_line(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site *site = make("a", &err);
    assert_int_equal(site_close(site, &err), ST_OK);
    meddle("PRAGMA user_version = 99");
    assert_int_equal(site_open(path, SITE_READ, &site, &err), ST_UNSUPPORTED);
    assert_non_null(strstr(err.text, "newer scancart"));
    struct site_check_result result;
    assert_int_equal(site_check(path, NULL, &result, &err), ST_UNSUPPORTED);
    meddle("PRAGMA user_version = 2; PRAGMA application_id = 7");
    assert_int_equal(site_open(path, SITE_READ, &site, &err), ST_FORMAT);
}

static void foreign_schema_is_refused(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site *site = make("a", &err);
    assert_int_equal(site_close(site, &err), ST_OK);
    meddle("CREATE TRIGGER evil AFTER INSERT ON station BEGIN DELETE FROM custody; END");
    assert_int_equal(site_open(path, SITE_WRITE, &site, &err), ST_DAMAGED);
    assert_int_equal(site_open(path, SITE_READ, &site, &err), ST_DAMAGED);
    struct site_check_result result;
    assert_true(errors_of_check(&result) > 0);
}

static void changed_deleted_and_added_rows_are_found(void **state) {
    (void)state;
    static const char *const sql[] = {
        "UPDATE station SET name = 'other' WHERE id = 1",
        "DELETE FROM ledger WHERE id = 2",
        "UPDATE chunk SET payload = x'00' WHERE id = 3",
        "INSERT INTO georef SELECT 9, epsg, offset, utc_ns, row_sha256 FROM georef",
        "UPDATE custody SET who = 'nobody' WHERE id = 2",
        "DELETE FROM custody WHERE id = (SELECT max(id) FROM custody)",
        "UPDATE digest SET rows = rows + 1 WHERE name = 'site'",
        "DELETE FROM digest WHERE name = 'job'",
        "UPDATE job_hash SET sha256 = zeroblob(32) WHERE id = 1",
        "DELETE FROM chunk WHERE id = (SELECT max(id) FROM chunk)",
    };
    static const char *const where[] = {"station", "ledger", "chunk", "georef",   "custody",
                                        "custody", "site",   "job",   "job_hash", "chunk"};
    for (size_t i = 0; i < sizeof sql / sizeof sql[0]; i++) {
        struct errctx err = {0};
        struct site_check_result result;
        assert_int_equal(site_sample_make(path, &err), ST_OK);
        assert_int_equal(errors_of_check(&result), 0);
        meddle(sql[i]);
        assert_true(errors_of_check(&result) > 0);
        if (!strstr(result.first.where, where[i]))
            fail_msg("%s: %s: %s", sql[i], result.first.where, result.first.what);
        char remove[TEXT_MAX];
        (void)snprintf(remove, sizeof remove, "%s/site", dir);
        tempdir_remove(remove);
    }
}

static void crash_is_noted_by_the_next_writer(void **state) {
    (void)state;
    struct errctx err = {0};
    struct station_pose pose = site_sample_pose(1);
    struct site *site = make("a", &err);
    int64_t id = 0;
    assert_int_equal(site_close(site, &err), ST_OK);
    pid_t child = fork();
    if (child == 0) {
        bool good = !site_open(path, SITE_WRITE, &site, &err) &&
                    !station_add(site, "one", NULL, &pose, &id, &err);
        _exit(good ? 0 : 1); /* without closing: as in a crash */
    }
    int status = 0;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    struct site_check_result result;
    assert_int_equal(errors_of_check(&result), 0);
    assert_int_equal(result.warnings, 1); /* the log */
    assert_string_equal(result.first.where, "site.db-wal");
    assert_int_equal(site_open(path, SITE_WRITE, &site, &err), ST_OK);
    assert_int_equal(station_add(site, "two", NULL, &pose, &id, &err), ST_OK);
    assert_int_equal(id, 2);
    struct custody_event events[8];
    size_t count = 0;
    assert_int_equal(custody_list(site, 3, events, 8, &count, &err), ST_OK);
    assert_int_equal(count, 1);
    assert_string_equal(events[0].detail, "{\"after\":\"crash\"}");
    assert_int_equal(site_close(site, &err), ST_OK);
    assert_int_equal(errors_of_check(&result), 0);
    assert_int_equal(result.warnings, 0);
}

/* In a child without rights: root may write anywhere. */
static void read_only_folder_can_be_read_and_checked(void **state) {
    (void)state;
    struct errctx err = {0};
    assert_int_equal(site_sample_make(path, &err), ST_OK);
    char file[TEXT_MAX];
    (void)snprintf(file, sizeof file, "%s/site.db", path);
    assert_int_equal(chmod(dir, 0755), 0);
    assert_int_equal(chmod(path, 0555), 0);
    assert_int_equal(chmod(file, 0444), 0);
    pid_t child = fork();
    if (child == 0) {
        if (geteuid() == 0 && setuid(65534) != 0)
            _exit(77);
        struct site *site = NULL;
        struct station station;
        struct site_check_result result = {0};
        if (site_open(path, SITE_READ, &site, &err) ||
            station_find(site, "stand 2", &station, &err))
            _exit(1);
        (void)site_close(site, NULL);
        if (site_check(path, NULL, &result, &err) || result.errors)
            _exit(2);
        _exit(site_open(path, SITE_WRITE, &site, &err) == ST_PERMISSION ? 0 : 3);
    }
    int status = 0;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_int_equal(chmod(path, 0755), 0);
    assert_true(WIFEXITED(status));
    if (WEXITSTATUS(status) == 77)
        skip();
    assert_int_equal(WEXITSTATUS(status), 0);
}

static void names_and_kinds_are_judged(void **state) {
    (void)state;
    assert_true(site_name_is_valid("Große Straße 7"));
    assert_false(site_name_is_valid(""));
    assert_false(site_name_is_valid("a/b"));
    assert_false(site_name_is_valid("a\nb"));
    assert_false(site_name_is_valid("\xff\xfe"));
    assert_false(site_name_is_valid("\xc3"));
    assert_false(site_name_is_valid("\xe2\x82"));
    assert_false(
        site_name_is_valid("0123456789012345678901234567890123456789012345678901234567890123"));
    assert_true(site_kind_is_valid("head_packet.1"));
    assert_false(site_kind_is_valid("Head"));
    assert_false(site_kind_is_valid(""));
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)
        T(new_site_opens_again_with_its_name_and_place),
        T(name_defaults_to_the_folder),
        T(refuses_to_make_a_site_over_something),
        T(takes_an_empty_folder),
        T(failed_creation_leaves_nothing),
        T(failed_open_leaves_nothing),
        T(refuses_a_second_writer_and_names_the_first),
        T(reader_sees_committed_changes_while_a_writer_works),
        T(failed_batch_changes_nothing),
        T(sessions_are_logged_and_sealed),
        T(newer_site_is_refused_with_a_clear_line),
        T(foreign_schema_is_refused),
        T(changed_deleted_and_added_rows_are_found),
        T(crash_is_noted_by_the_next_writer),
        T(read_only_folder_can_be_read_and_checked),
        T(names_and_kinds_are_judged),
#undef T
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
