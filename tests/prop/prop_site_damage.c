/* Single-byte flips over every file of a site. What "changes content" means is defined here without
 * the site module: a plain SQLite connection reads every value of every row of every table, and
 * every other file is read as bytes; if that text is another one than before, or cannot be read any
 * more, content has changed. */
#include "base/fileio.h"
#include "base/hash.h"
#include "site/site_check.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/prop.h"
#include "tests/support/site_sample.h"
#include "tests/support/tempdir.h"

#include <fcntl.h>
#include <sqlite3.h>

enum { TEXT_MAX = 1024, FILES_MAX = 16, FLIPS_DATABASE = 700, FLIPS_FILES = 300 };

static char dir[TEMPDIR_MAX], site_dir[TEXT_MAX];

struct target {
    char name[128]; /* relative to the site */
    int64_t size_bytes;
};
static struct target targets[FILES_MAX];
static size_t target_count;

static void add_targets(const char *folder) {
    char path[2 * TEXT_MAX];
    (void)snprintf(path, sizeof path, "%s/%s", site_dir, folder);
    struct dirent **names = NULL;
    int count = scandir(path, &names, NULL, alphasort);
    assert_true(count >= 0);
    for (int i = 0; i < count; i++) {
        struct target *target = &targets[target_count];
        struct stat info;
        (void)snprintf(target->name, sizeof target->name, "%.40s%s%.80s", folder,
                       *folder ? "/" : "", names[i]->d_name);
        (void)snprintf(path, sizeof path, "%s/%s", site_dir, target->name);
        if (stat(path, &info) == 0 && S_ISREG(info.st_mode) && info.st_size > 0) {
            target->size_bytes = info.st_size;
            target_count++;
            assert_true(target_count < FILES_MAX);
        }
        free(names[i]);
    }
    free(names);
}

static int make_site(void **state) {
    (void)state;
    struct errctx err = {0};
    if (!tempdir_make(dir))
        return -1;
    (void)snprintf(site_dir, sizeof site_dir, "%s/site", dir);
    if (site_sample_make(site_dir, &err)) {
        (void)printf("%s\n", err.text);
        return -1;
    }
    target_count = 0;
    add_targets("");
    add_targets("frames");
    add_targets("photos");
    return 0;
}

static int remove_site(void **state) {
    (void)state;
    tempdir_remove(dir);
    return 0;
}

static void update(struct hash_sha256 *hash, const void *data, size_t size) {
    assert_int_equal(hash_sha256_update(hash, data, size), ST_OK);
}

/* Every value with its type; false if the database does not give them all. */
static bool dump_query(sqlite3 *db, const char *sql, struct hash_sha256 *hash) {
    sqlite3_stmt *stmt = NULL;
    int rc = sqlite3_prepare_v2(db, sql, -1, &stmt, NULL);
    for (rc = rc ? rc : sqlite3_step(stmt); rc == SQLITE_ROW; rc = sqlite3_step(stmt))
        for (int c = 0; c < sqlite3_column_count(stmt); c++) {
            int type = sqlite3_column_type(stmt, c);
            const void *data = sqlite3_column_blob(stmt, c);
            int size = sqlite3_column_bytes(stmt, c);
            update(hash, &type, sizeof type);
            update(hash, &size, sizeof size);
            if (size > 0)
                update(hash, data, (size_t)size);
        }
    (void)sqlite3_finalize(stmt);
    return rc == SQLITE_DONE;
}

static bool dump_database(const char *path, uint8_t out_sha256[HASH_SHA256_BYTES]) {
    static const char *const tables[] = {"site",   "georef",   "station", "station_pose", "calib",
                                         "stream", "chunk",    "ledger",  "file",         "frame",
                                         "job",    "job_hash", "photo",   "custody",      "digest"};
    struct hash_sha256 hash = {0};
    sqlite3 *db = NULL;
    char uri[TEXT_MAX];
    (void)snprintf(uri, sizeof uri, "file:%s?immutable=1", path);
    assert_int_equal(hash_sha256_init(&hash), ST_OK);
    bool good =
        sqlite3_open_v2(uri, &db, SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, NULL) == SQLITE_OK;
    good = good && dump_query(db, "SELECT type, name, tbl_name, sql FROM sqlite_schema", &hash) &&
           dump_query(db, "PRAGMA user_version", &hash) &&
           dump_query(db, "PRAGMA application_id", &hash);
    for (size_t i = 0; i < sizeof tables / sizeof tables[0] && good; i++) {
        char sql[64];
        /* NOT INDEXED: what an index says is not content */
        (void)snprintf(sql, sizeof sql, "SELECT * FROM %s NOT INDEXED", tables[i]);
        good = dump_query(db, sql, &hash);
    }
    (void)sqlite3_close(db);
    assert_int_equal(hash_sha256_final(&hash, out_sha256), ST_OK);
    hash_sha256_fini(&hash);
    return good;
}

static void flip(const struct target *target, int64_t offset, uint8_t mask) {
    char path[TEXT_MAX];
    uint8_t byte;
    (void)snprintf(path, sizeof path, "%.800s/%s", site_dir, target->name);
    int fd = open(path, O_RDWR);
    assert_true(fd >= 0);
    assert_int_equal(pread(fd, &byte, 1, offset), 1);
    byte ^= mask;
    assert_int_equal(pwrite(fd, &byte, 1, offset), 1);
    assert_int_equal(close(fd), 0);
}

struct seen {
    const char *wanted;
    bool named;
};

static void on_finding(void *context, const struct site_check_finding *finding) {
    struct seen *seen = context;
    if (finding->severity == SITE_CHECK_ERROR &&
        !strncmp(finding->where, seen->wanted, strlen(seen->wanted)))
        seen->named = true;
}

/* True if the check fails and names the file. A status instead of a finding must name it too. */
static bool is_reported(const struct target *target) {
    struct seen seen = {.wanted = target->name};
    struct site_check_options options = {.on_finding = on_finding, .context = &seen};
    struct site_check_result result = {0};
    struct errctx err = {0};
    enum st st = site_check(site_dir, &options, &result, &err);
    return st ? strstr(err.text, target->name) != NULL : result.errors > 0 && seen.named;
}

static void intact_site_is_good(void **state) {
    (void)state;
    struct site_check_result result;
    struct errctx err = {0};
    assert_int_equal(site_check(site_dir, NULL, &result, &err), ST_OK);
    assert_int_equal(result.errors + result.warnings, 0);
    assert_int_equal(result.files, 4);
    assert_int_equal(result.chunks, 24);
}

/* Pages of a database are mostly empty: if asked for, a byte that is not 0. */
static int64_t pick_offset(struct rng *rng, const struct target *target, bool prefer_content) {
    char path[TEXT_MAX];
    uint8_t byte = 0;
    int64_t offset = 0;
    (void)snprintf(path, sizeof path, "%.800s/%s", site_dir, target->name);
    int fd = open(path, O_RDONLY);
    assert_true(fd >= 0);
    for (int tries = 0; tries < 200 && byte == 0; tries++) {
        offset = (int64_t)rng_below(rng, (uint32_t)target->size_bytes);
        assert_int_equal(pread(fd, &byte, 1, offset), 1);
        if (!prefer_content)
            break;
    }
    assert_int_equal(close(fd), 0);
    return offset;
}

/* site.db, or any other file. */
static const struct target *pick_target(struct rng *rng, bool database) {
    const struct target *target;
    do
        target = &targets[rng_below(rng, (uint32_t)target_count)];
    while (database != !strcmp(target->name, "site.db"));
    return target;
}

static void every_flip_that_changes_content_is_reported(void **state) {
    (void)state;
    struct rng rng = rng_make(prop_seed());
    char database[TEXT_MAX];
    uint8_t before[HASH_SHA256_BYTES], after[HASH_SHA256_BYTES];
    (void)snprintf(database, sizeof database, "%.900s/site.db", site_dir);
    assert_true(dump_database(database, before));
    int changed = 0, reported = 0, missed = 0;
    for (int i = 0; i < FLIPS_DATABASE + FLIPS_FILES; i++) {
        bool in_database = i < FLIPS_DATABASE;
        const struct target *target = pick_target(&rng, in_database);
        int64_t offset = pick_offset(&rng, target, in_database && i % 2);
        uint8_t mask = (uint8_t)(1 + rng_below(&rng, 255));
        flip(target, offset, mask);
        bool is_change = !in_database || !dump_database(database, after) ||
                         memcmp(before, after, sizeof before) != 0;
        bool is_report = is_reported(target);
        assert_true(site_sample_read_all(site_dir));
        if (is_change && !is_report) {
            (void)printf("missed: %s at %lld ^ 0x%02x\n", target->name, (long long)offset, mask);
            missed++;
        }
        changed += is_change;
        reported += is_report;
        flip(target, offset, mask);
    }
    (void)printf("%d flips: %d changed content, %d were reported, %d were missed\n",
                 FLIPS_DATABASE + FLIPS_FILES, changed, reported, missed);
    assert_int_equal(missed, 0);
    assert_true(changed > FLIPS_FILES + FLIPS_DATABASE / 4); /* the test looks where something is */
    assert_true(dump_database(database, after) && !memcmp(before, after, sizeof before));
}

static void truncation_at_any_length_is_reported(void **state) {
    (void)state;
    struct rng rng = rng_make(prop_seed());
    for (int i = 0; i < 60; i++) {
        const struct target *target = &targets[(size_t)i % target_count];
        char path[TEXT_MAX];
        uint8_t *bytes = NULL;
        size_t size = 0;
        struct errctx err = {0};
        (void)snprintf(path, sizeof path, "%.800s/%s", site_dir, target->name);
        assert_int_equal(fileio_read(path, (size_t)1 << 30, &bytes, &size, &err), ST_OK);
        off_t keep = (off_t)rng_below(&rng, (uint32_t)size);
        assert_int_equal(truncate(path, keep), 0);
        if (!is_reported(target))
            fail_msg("%s cut to %lld bytes", target->name, (long long)keep);
        assert_true(site_sample_read_all(site_dir));
        assert_int_equal(fileio_write(path, bytes, size, &err), ST_OK);
        free(bytes);
    }
    intact_site_is_good(state);
}

static void missing_and_foreign_files_are_named(void **state) {
    (void)state;
    char path[TEXT_MAX], moved[TEXT_MAX];
    const struct target *photo = &targets[target_count - 1];
    struct site_check_result result;
    struct errctx err = {0};
    (void)snprintf(path, sizeof path, "%.800s/%s", site_dir, photo->name);
    (void)snprintf(moved, sizeof moved, "%.800s/photos/other.tif", site_dir);
    assert_int_equal(rename(path, moved), 0);
    assert_int_equal(site_check(site_dir, NULL, &result, &err), ST_OK);
    assert_int_equal(result.errors, 1);
    assert_int_equal(result.warnings, 1);
    assert_string_equal(result.first.where, photo->name);
    assert_string_equal(result.first.what, "is missing");
    assert_int_equal(rename(moved, path), 0);
    intact_site_is_good(state);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(intact_site_is_good),
        cmocka_unit_test(every_flip_that_changes_content_is_reported),
        cmocka_unit_test(truncation_at_any_length_is_reported),
        cmocka_unit_test(missing_and_foreign_files_are_named),
    };
    return cmocka_run_group_tests(tests, make_site, remove_site);
}
