/* A writer that dies at any instant: killed, or out of disk. What it was told is stored is there,
 * nothing is half there, and the next writer goes on. */
#include "base/clock.h"
#include "base/fileio.h"
#include "site/files.h"
#include "site/site_check.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/prop.h"
#include "tests/support/site_sample.h"
#include "tests/support/tempdir.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>

enum { TEXT_MAX = 1024, CHUNK_BYTES = 70000, CHUNKS_A_BATCH = 3 };

static char dir[TEMPDIR_MAX], path[TEXT_MAX];
static uint8_t payload[CHUNKS_A_BATCH][CHUNK_BYTES];

static int setup(void **state) {
    (void)state;
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

static size_t size_of(int64_t sequence) {
    return (size_t)(1 + (sequence * 7919) % CHUNK_BYTES);
}

/* Chunk n of the stream is the same in every run. */
static enum st append_batch(struct site *site, int64_t stream_id, int64_t from,
                            struct errctx *err) {
    struct stream_chunk chunks[CHUNKS_A_BATCH];
    for (int i = 0; i < CHUNKS_A_BATCH; i++) {
        int64_t n = from + i;
        site_sample_bytes((uint64_t)n, payload[i], size_of(n));
        chunks[i] = site_sample_chunk(10 * n, 10, payload[i], size_of(n));
    }
    return stream_append(site, stream_id, chunks, CHUNKS_A_BATCH, err);
}

/* Makes the site if need be, then appends and stores files until it dies. Tells each finished batch
 * on `fd`. */
static void write_until_killed(int fd) {
    struct site *site = NULL;
    struct errctx err = {0};
    struct site_info info = {0};
    struct stream stream = {0};
    int64_t id = 0;
    enum st st = site_open(path, SITE_WRITE, &site, &err);
    if (st == ST_NOT_FOUND)
        st = site_create(path, &info, &site, &err);
    if (!st && stream_find(site, 1, "head", NULL, &stream, &err))
        st = site_begin(site, &err) ? ST_INTERNAL : site_sample_stream(site, 0, &id, &err);
    if (!st && id)
        st = site_commit(site, &err);
    id = id ? id : stream.id;
    struct stream_state at;
    if (!st)
        st = stream_get_state(site, id, &at, &err);
    for (int64_t n = at.chunk_count; !st; n += CHUNKS_A_BATCH) {
        uint8_t sha256[HASH_SHA256_BYTES];
        st = append_batch(site, id, n, &err);
        int64_t told = n + CHUNKS_A_BATCH;
        if (!st && write(fd, &told, sizeof told) != sizeof told)
            st = ST_IO;
        if (!st && n % 2)
            st = files_put(site, FILES_FRAME, "jpg", payload[0], size_of(n), sha256, &err);
    }
    (void)printf("writer: %s\n", err.text);
    _exit(1);
}

/* The stream holds chunks 0 .. n-1 as they were made; returns n. */
static int64_t verify(void) {
    struct site_check_result result = {0};
    struct errctx err = {0};
    enum st st = site_check(path, NULL, &result, &err);
    if (st == ST_NOT_FOUND)
        return 0; /* killed before there was a site */
    if (st || result.errors)
        fail_msg("%s %s: %s", err.text, result.first.where, result.first.what);
    struct site *site = NULL;
    struct stream stream;
    assert_int_equal(site_open(path, SITE_READ, &site, &err), ST_OK);
    int64_t count = 0;
    if (!stream_find(site, 1, "head", NULL, &stream, &err)) {
        struct stream_reader *reader = NULL;
        struct stream_chunk chunk;
        assert_int_equal(stream_reader_open(site, stream.id, 0, &reader, &err), ST_OK);
        while (!stream_reader_next(reader, &chunk, &err)) {
            assert_int_equal(chunk.sequence, count);
            assert_int_equal(chunk.size_bytes, size_of(count));
            site_sample_bytes((uint64_t)count, payload[0], chunk.size_bytes);
            assert_memory_equal(chunk.payload, payload[0], chunk.size_bytes);
            count++;
        }
        stream_reader_close(reader);
    }
    assert_int_equal(site_close(site, &err), ST_OK);
    assert_int_equal(count % CHUNKS_A_BATCH, 0);
    return count;
}

static void sleep_us(uint32_t us) {
    struct timespec t = {.tv_nsec = (long)us * 1000};
    (void)nanosleep(&t, NULL);
}

/* Waits until the writer has told something, 5 s at most: on a slow machine no instant chosen by
 * chance may come that late. */
static void wait_for_a_batch(int fd) {
    struct pollfd wait = {.fd = fd, .events = POLLIN};
    (void)poll(&wait, 1, 5000);
}

static void killed_writer_leaves_a_valid_prefix(void **state) {
    (void)state;
    struct rng rng = rng_make(prop_seed());
    enum { KILLS = 40, LATEST_US = 60000 };
    int64_t count = 0, told = 0;
    for (int i = 0; i < KILLS; i++) {
        int pipe_fds[2];
        assert_int_equal(pipe(pipe_fds), 0);
        (void)fflush(NULL);
        pid_t child = fork();
        assert_true(child >= 0);
        if (child == 0) {
            (void)close(pipe_fds[0]);
            write_until_killed(pipe_fds[1]);
        }
        (void)close(pipe_fds[1]);
        if (i % 4 == 3)
            wait_for_a_batch(pipe_fds[0]);
        sleep_us(rng_below(&rng, LATEST_US));
        assert_int_equal(kill(child, SIGKILL), 0);
        int status = 0;
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_true(WIFSIGNALED(status)); /* and did not end by itself with a failure */
        for (int64_t n; read(pipe_fds[0], &n, sizeof n) == sizeof n;)
            told = n;
        (void)close(pipe_fds[0]);
        int64_t now = verify();
        assert_true(now >= count); /* what was there stays */
        assert_true(now >= told);  /* what was told is there */
        count = now;
    }
    (void)printf("%d kills, %lld chunks\n", KILLS, (long long)count);
    assert_true(count > 0);
}

/* The process may not grow any file beyond a limit, as on a disk that is full. */
static void full_disk_stops_with_a_clear_line_and_keeps_all(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site_info info = {0};
    struct site *site = NULL;
    int64_t id = 0;
    assert_int_equal(site_create(path, &info, &site, &err), ST_OK);
    assert_int_equal(site_sample_stream(site, 0, &id, &err), ST_OK);
    struct rlimit before, tight;
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &before), 0);
    tight = before;
    tight.rlim_cur = 2 << 20;
    (void)signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &tight), 0);
    int64_t good = 0;
    enum st st = ST_OK;
    for (; !st && good < 1000; good += st ? 0 : CHUNKS_A_BATCH)
        st = append_batch(site, id, good, &err);
    assert_true(st == ST_FULL || st == ST_IO);
    assert_non_null(strstr(err.text, "cannot"));
    uint8_t sha256[HASH_SHA256_BYTES];
    static uint8_t big[3 << 20];
    assert_true(files_put(site, FILES_PHOTO, "tif", big, sizeof big, sha256, &err) != ST_OK);
    assert_true(append_batch(site, id, good, &err) != ST_OK); /* still full, still in order */
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &before), 0);
    assert_int_equal(append_batch(site, id, good, &err), ST_OK); /* room again: it goes on */
    assert_int_equal(site_close(site, &err), ST_OK);
    assert_int_equal(verify(), good + CHUNKS_A_BATCH);
}

static void full_disk_leaves_no_half_made_site(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site_info info = {0};
    struct site *site = NULL;
    struct rlimit before, tight;
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &before), 0);
    (void)signal(SIGXFSZ, SIG_IGN);
    for (rlim_t limit = 0; limit <= 1 << 20; limit += 1 << 17) {
        tight = before;
        tight.rlim_cur = limit;
        assert_int_equal(setrlimit(RLIMIT_FSIZE, &tight), 0);
        enum st st = site_create(path, &info, &site, &err);
        if (!st)
            (void)site_close(site, &err);
        assert_int_equal(setrlimit(RLIMIT_FSIZE, &before), 0);
        assert_true(st ? !fileio_exists(path) : fileio_exists(path));
        if (!st)
            return;
    }
    assert_int_equal(site_create(path, &info, &site, &err), ST_OK);
    assert_int_equal(site_close(site, &err), ST_OK);
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)
        T(killed_writer_leaves_a_valid_prefix),
        T(full_disk_stops_with_a_clear_line_and_keeps_all),
        T(full_disk_leaves_no_half_made_site),
#undef T
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
