/* How fast raw chunks go into a site and out again, beside what the same bytes cost as a plain file
 * flushed as often and as a hash alone. Prints a JSON list. Usage: bench_site FOLDER [MEGABYTES] */
#include "base/clock.h"
#include "base/fileio.h"
#include "base/hash.h"
#include "site/site_check.h"
#include "tests/support/site_sample.h"

#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

/* A recorder's batch: 16 chunks of 256 KiB, one flush. */
enum { CHUNK_BYTES = 256 << 10, BATCH = 16, TEXT_MAX = 1024 };

static uint8_t payload[CHUNK_BYTES];
static int results;

static void result(const char *name, double value, const char *unit) {
    (void)printf("%s\n {\"name\": \"%s\", \"value\": %.4g, \"unit\": \"%s\"}",
                 results++ ? "," : "[", name, value, unit);
}

static double seconds_since(int64_t t_ns) {
    return (double)(clock_now_ns() - t_ns) * 1e-9;
}

/* All or nothing: a benchmark that fails says so and ends. */
static void must(enum st st, const struct errctx *err) {
    if (!st)
        return;
    (void)fprintf(stderr, "bench_site: %s\n", err->text);
    exit(1);
}

static double append_mb_per_s(const char *path, int64_t batches, double *out_worst_ms) {
    struct errctx err = {0};
    struct site *site = NULL;
    struct site_info info = {0};
    struct stream_chunk chunks[BATCH];
    int64_t id = 0, n = 0;
    must(site_create(path, &info, &site, &err), &err);
    must(site_sample_stream(site, 0, &id, &err), &err);
    int64_t start_ns = clock_now_ns();
    for (int64_t b = 0; b < batches; b++) {
        for (int i = 0; i < BATCH; i++, n++)
            chunks[i] = site_sample_chunk(10 * n, 10, payload, CHUNK_BYTES);
        int64_t batch_ns = clock_now_ns();
        must(stream_append(site, id, chunks, BATCH, &err), &err);
        double ms = seconds_since(batch_ns) * 1e3;
        *out_worst_ms = ms > *out_worst_ms ? ms : *out_worst_ms;
    }
    double seconds = seconds_since(start_ns);
    must(site_close(site, &err), &err);
    return (double)batches * BATCH * CHUNK_BYTES * 1e-6 / seconds;
}

static double file_mb_per_s(const char *path, int64_t batches) {
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0666);
    int64_t start_ns = clock_now_ns();
    for (int64_t b = 0; b < batches; b++) {
        for (int i = 0; i < BATCH; i++)
            if (write(fd, payload, CHUNK_BYTES) != CHUNK_BYTES)
                exit(1);
        if (fdatasync(fd))
            exit(1);
    }
    double seconds = seconds_since(start_ns);
    (void)close(fd);
    return (double)batches * BATCH * CHUNK_BYTES * 1e-6 / seconds;
}

static double hash_mb_per_s(int64_t batches) {
    uint8_t sha256[HASH_SHA256_BYTES];
    int64_t start_ns = clock_now_ns();
    for (int64_t i = 0; i < batches * BATCH; i++)
        if (hash_sha256(payload, CHUNK_BYTES, sha256))
            exit(1);
    return (double)batches * BATCH * CHUNK_BYTES * 1e-6 / seconds_since(start_ns);
}

static double read_mb_per_s(const char *path) {
    struct errctx err = {0};
    struct site *site = NULL;
    struct stream_reader *reader = NULL;
    struct stream_chunk chunk;
    int64_t bytes = 0, start_ns = clock_now_ns();
    must(site_open(path, SITE_READ, &site, &err), &err);
    must(stream_reader_open(site, 1, 0, &reader, &err), &err);
    while (!stream_reader_next(reader, &chunk, &err))
        bytes += (int64_t)chunk.size_bytes;
    stream_reader_close(reader);
    must(site_close(site, &err), &err);
    return (double)bytes * 1e-6 / seconds_since(start_ns);
}

int main(int argc, char **argv) {
    if (argc < 2) {
        (void)fprintf(stderr, "usage: bench_site FOLDER [MEGABYTES]\n");
        return 2;
    }
    char site_folder[TEXT_MAX], file[TEXT_MAX];
    struct errctx err = {0};
    int64_t batches = (argc > 2 ? atol(argv[2]) : 512) * 1000000 / (BATCH * CHUNK_BYTES) + 1;
    (void)snprintf(site_folder, sizeof site_folder, "%s/site", argv[1]);
    (void)snprintf(file, sizeof file, "%s/plain", argv[1]);
    must(fileio_mkdirs(argv[1], &err), &err);
    site_sample_bytes(1, payload, sizeof payload);

    double worst_ms = 0, append = append_mb_per_s(site_folder, batches, &worst_ms);
    double plain = file_mb_per_s(file, batches), hash = hash_mb_per_s(batches);
    struct site_check_result checked;
    int64_t start_ns = clock_now_ns();
    must(site_check(site_folder, NULL, &checked, &err), &err);
    double check = (double)batches * BATCH * CHUNK_BYTES * 1e-6 / seconds_since(start_ns);
    if (checked.errors)
        return 1;
    result("append_mb_per_s", append, "MB/s");
    result("append_to_plain_file", append / plain, "ratio");
    result("append_to_sha256", append / hash, "ratio");
    result("append_worst_batch", worst_ms, "ms");
    result("read_mb_per_s", read_mb_per_s(site_folder), "MB/s");
    result("check_mb_per_s", check, "MB/s");
    (void)printf("\n]\n");
    return 0;
}
