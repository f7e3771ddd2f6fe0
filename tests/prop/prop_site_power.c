/* The power goes, or a write fails, at any operation on the database: what was told is there,
 * nothing is half there. */
#include "base/fileio.h"
#include "site/site_check.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/power_vfs.h"
#include "tests/support/prop.h"
#include "tests/support/site_sample.h"
#include "tests/support/tempdir.h"

enum { TEXT_MAX = 1024, CHUNKS_A_BATCH = 2, CHUNK_BYTES = 30000, CUTS_MAX = 120 };

static char dir[TEMPDIR_MAX], path[TEXT_MAX];
static uint8_t payload[CHUNK_BYTES];
static int64_t stream_id;

/* What was told as stored when the power went. */
static struct cut {
    char folder[TEXT_MAX];
    int64_t told, tried;
} cuts[CUTS_MAX];
static int cut_count;
static int64_t told, tried; /* chunks */
static struct rng rng;
static uint32_t one_in;

static int setup(void **state) {
    (void)state;
    if (!tempdir_make(dir))
        return -1;
    (void)snprintf(path, sizeof path, "%s/site", dir);
    struct site_info info = {0};
    struct site *site = NULL;
    struct errctx err = {0};
    if (site_create(path, &info, &site, &err) || site_sample_stream(site, 0, &stream_id, &err))
        return -1;
    told = tried = 0;
    cut_count = 0;
    return site_close(site, &err) ? -1 : 0;
}

static int teardown(void **state) {
    (void)state;
    power_vfs_remove();
    tempdir_remove(dir);
    return 0;
}

static size_t size_of(int64_t sequence) {
    return (size_t)(1 + (sequence * 7919) % CHUNK_BYTES);
}

/* A session: opens, stores some batches, closes. Goes on after failures, as a recorder would. */
static void session(int batches) {
    struct site *site = NULL;
    struct errctx err = {0};
    if (site_open(path, SITE_WRITE, &site, &err))
        return;
    for (int b = 0; b < batches; b++) {
        struct stream_state at;
        if (stream_get_state(site, stream_id, &at, &err) || site_begin(site, &err))
            continue;
        enum st st = ST_OK;
        for (int64_t n = at.chunk_count; n < at.chunk_count + CHUNKS_A_BATCH && !st; n++) {
            site_sample_bytes((uint64_t)n, payload, size_of(n));
            struct stream_chunk chunk = site_sample_chunk(10 * n, 10, payload, size_of(n));
            st = stream_append(site, stream_id, &chunk, 1, &err);
        }
        if (st) {
            site_rollback(site);
            continue;
        }
        if (at.chunk_count + CHUNKS_A_BATCH > tried)
            tried = at.chunk_count + CHUNKS_A_BATCH;
        if (!site_commit(site, &err))
            told = at.chunk_count + CHUNKS_A_BATCH;
    }
    (void)site_close(site, &err);
}

/* The site in `folder` is good and holds chunks 0 .. n-1 as they were made, told <= n <= tried. */
static void verify(const char *folder, int64_t at_least, int64_t at_most) {
    struct site_check_result result = {0};
    struct errctx err = {0};
    enum st st = site_check(folder, NULL, &result, &err);
    if (st || result.errors)
        fail_msg("%s %s: %s", err.text, result.first.where, result.first.what);
    struct site *site = NULL;
    struct stream_reader *reader = NULL;
    struct stream_chunk chunk;
    int64_t count = 0;
    assert_int_equal(site_open(folder, SITE_READ, &site, &err), ST_OK);
    assert_int_equal(stream_reader_open(site, stream_id, 0, &reader, &err), ST_OK);
    for (; !stream_reader_next(reader, &chunk, &err); count++) {
        assert_int_equal(chunk.size_bytes, size_of(count));
        site_sample_bytes((uint64_t)count, payload, chunk.size_bytes);
        assert_memory_equal(chunk.payload, payload, chunk.size_bytes);
    }
    stream_reader_close(reader);
    assert_int_equal(site_close(site, &err), ST_OK);
    if (count < at_least || count > at_most || count % CHUNKS_A_BATCH)
        fail_msg("%lld chunks, not %lld to %lld", (long long)count, (long long)at_least,
                 (long long)at_most);
}

static void maybe_cut(int64_t operation) {
    (void)operation;
    if (cut_count == CUTS_MAX || rng_below(&rng, one_in))
        return;
    struct cut *cut = &cuts[cut_count];
    (void)snprintf(cut->folder, sizeof cut->folder, "%s/cut%d", dir, cut_count);
    cut->told = told;
    cut->tried = tried;
    assert_int_equal(fileio_mkdir(cut->folder, NULL), ST_OK);
    assert_true(power_vfs_cut(&rng, path, cut->folder));
    cut_count++;
}

static void power_cut_loses_nothing_that_was_told(void **state) {
    (void)state;
    rng = rng_make(prop_seed());
    one_in = 4;
    power_vfs_install();
    power_vfs_on_operation(maybe_cut);
    for (int i = 0; i < 20 && cut_count < CUTS_MAX; i++)
        session(3);
    int64_t operations = power_vfs_operations();
    power_vfs_remove();
    verify(path, told, told);
    for (int i = 0; i < cut_count; i++)
        /* the batch whose last flush was under way may be there */
        verify(cuts[i].folder, cuts[i].told, cuts[i].told + CHUNKS_A_BATCH);
    (void)printf("%d power cuts within %lld operations, %lld chunks\n", cut_count,
                 (long long)operations, (long long)told);
    assert_true(cut_count > 60 && told > 20);
}

static void copy_file(const char *name, const char *folder) {
    char from[2 * TEXT_MAX], to[2 * TEXT_MAX];
    uint8_t *bytes = NULL;
    size_t size = 0;
    (void)snprintf(from, sizeof from, "%s/%s", folder, name);
    (void)snprintf(to, sizeof to, "%s/%s", path, name);
    assert_int_equal(fileio_read(from, 1 << 30, &bytes, &size, NULL), ST_OK);
    FILE *out = fopen(to, "wb");
    assert_non_null(out);
    assert_int_equal(fwrite(bytes, 1, size, out), size);
    assert_int_equal(fclose(out), 0);
    free(bytes);
}

static void any_failing_operation_leaves_a_valid_prefix(void **state) {
    (void)state;
    char master[TEXT_MAX];
    rng = rng_make(prop_seed());
    /* an untouched copy to start each run from */
    (void)snprintf(master, sizeof master, "%s/site", dir);
    (void)snprintf(path, sizeof path, "%s/run", dir);
    assert_int_equal(fileio_mkdir(path, NULL), ST_OK);
    copy_file("site.db", master);
    power_vfs_install();
    told = 0;
    session(2);
    int64_t operations = power_vfs_operations();
    power_vfs_remove();
    assert_int_equal(told, 2 * CHUNKS_A_BATCH);
    for (int64_t k = 1; k <= operations; k++)
        for (int64_t lasting = 1; lasting <= 1000; lasting += 999) { /* once; from then on */
            char log[TEXT_MAX + 16];
            copy_file("site.db", master);
            (void)snprintf(log, sizeof log, "%.1000s/site.db-wal", path);
            assert_int_equal(fileio_remove(log, NULL), ST_OK);
            told = tried = 0;
            power_vfs_install();
            power_vfs_fail_at(k, lasting);
            session(2);
            power_vfs_remove();
            verify(path, told, tried);
        }
    (void)printf("each of %lld operations failed once and for good\n", (long long)operations);
    assert_true(operations > 20);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)
        T(power_cut_loses_nothing_that_was_told),
        T(any_failing_operation_leaves_a_valid_prefix),
#undef T
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
