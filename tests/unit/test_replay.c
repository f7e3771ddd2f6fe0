/* A recorded station played back: what is captured from it is what was recorded, byte for byte. */
#include "base/fileio.h"
#include "capture/backends/board_open.h"
#include "capture/backends/replay.h"
#include "capture/session.h"
#include "site/frame_row.h"
#include "site/site_check.h"
#include "site/station.h"
#include "site/stream.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/fake_cart.h"
#include "tests/support/tempdir.h"

#include <stdlib.h>
#include <string.h>

enum { PATH_BYTES = TEMPDIR_MAX + 32, STREAM_MAX = 16 << 20 };

static char dir[TEMPDIR_MAX];

struct bytes {
    uint8_t *at; /* [STREAM_MAX] */
    size_t size;
};

static void path_of(const char *name, char out_path[PATH_BYTES]) {
    (void)snprintf(out_path, PATH_BYTES, "%.500s/%s", dir, name);
}

static struct site *new_site(const char *name, int64_t *out_station) {
    char path[PATH_BYTES];
    struct site *site = NULL;
    struct site_info info = {0};
    struct errctx err = {0};
    struct station_pose pose = {.world_from_station = pose_identity()};
    (void)snprintf(pose.source, sizeof pose.source, "nominal");
    path_of(name, path);
    if (site_create(path, &info, &site, &err) ||
        station_add(site, "a", NULL, &pose, out_station, &err))
        fail_msg("%s", err.text);
    return site;
}

static struct scan_plan small_plan(void) {
    struct scan_plan plan = scan_plan_default(SCAN_PLAN_PREVIEW);
    scan_plan_set_range(&plan, -3, 3);
    plan.pass[0].count = 2;
    return plan;
}

/* Captures a station from these devices into a new site. */
static void capture(const struct cart_devices *devices, const char *name) {
    struct errctx err = {0};
    struct session *session = NULL;
    struct session_result result;
    struct scan_plan plan = small_plan();
    int64_t station = 0;
    struct site *site = new_site(name, &station);
    struct session_config config = {
        .devices = devices, .plan = &plan, .site = site, .station_id = station, .device = "cart"};
    if (session_open(&config, &session, &err) || session_run(session, &result, &err))
        fail_msg("%s: %s", name, err.text);
    assert_true(result.complete);
    session_close(session);
    assert_int_equal(site_close(site, &err), ST_OK);
}

/* The whole payload of a stream, and whether its ledger is empty. */
static struct bytes payload(const char *name, const char *kind) {
    char path[PATH_BYTES];
    struct errctx err = {0};
    struct site *site = NULL;
    struct station station;
    struct stream stream;
    struct stream_reader *reader = NULL;
    struct stream_chunk chunk;
    struct bytes all = {malloc(STREAM_MAX), 0};
    path_of(name, path);
    assert_non_null(all.at);
    assert_int_equal(site_open(path, SITE_READ, &site, &err), ST_OK);
    assert_int_equal(station_find(site, "a", &station, &err), ST_OK);
    assert_int_equal(stream_find(site, station.id, kind, NULL, &stream, &err), ST_OK);
    assert_int_equal(stream_reader_open(site, stream.id, 0, &reader, &err), ST_OK);
    while (!stream_reader_next(reader, &chunk, &err)) {
        assert_true(chunk.size_bytes <= STREAM_MAX - all.size);
        memcpy(all.at + all.size, chunk.payload, chunk.size_bytes);
        all.size += chunk.size_bytes;
    }
    stream_reader_close(reader);
    assert_int_equal(site_close(site, &err), ST_OK);
    return all;
}

static size_t frame_hashes(const char *name, uint8_t out_hash[8][HASH_SHA256_BYTES]) {
    char path[PATH_BYTES];
    struct errctx err = {0};
    struct site *site = NULL;
    struct frame_row rows[8];
    size_t count = 0;
    path_of(name, path);
    assert_int_equal(site_open(path, SITE_READ, &site, &err), ST_OK);
    assert_int_equal(frame_row_list(site, 0, 0, rows, 8, &count, &err), ST_OK);
    for (size_t i = 0; i < count; i++)
        memcpy(out_hash[i], rows[i].sha256, HASH_SHA256_BYTES);
    assert_int_equal(site_close(site, &err), ST_OK);
    return count;
}

static void record(void) {
    struct fake_cart_spec spec = {.host_offset_ns = 5000000000};
    struct fake_cart *cart = fake_cart_open(&spec);
    assert_non_null(cart);
    struct cart_devices devices = fake_cart_devices(cart);
    capture(&devices, "recorded");
    fake_cart_close(cart);
}

static struct board_open *open_recording(bool real_time) {
    char path[PATH_BYTES];
    struct errctx err = {0};
    struct board_open *board = NULL;
    path_of("recorded", path);
    struct board_replay replay = {.site = path, .real_time = real_time};
    const struct board_config config = {.replay = &replay};
    if (board_open(&config, NULL, &board, &err))
        fail_msg("%s", err.text);
    return board;
}

static void same(const char *kind) {
    struct bytes a = payload("recorded", kind), b = payload("again", kind);
    if (a.size != b.size || memcmp(a.at, b.at, a.size)) {
        size_t at = 0;
        while (at < a.size && at < b.size && a.at[at] == b.at[at])
            at++;
        fail_msg("%s: %zu and %zu bytes, the first difference at %zu", kind, a.size, b.size, at);
    }
    assert_true(a.size > 0);
    free(a.at);
    free(b.at);
}

static void capturing_a_recording_gives_the_same_bytes(void **state) {
    (void)state;
    struct board_open *board = open_recording(false);
    struct cart_devices devices = board_open_cart(board);
    assert_true(devices.hosttime->is_virtual);
    capture(&devices, "again");
    board_open_close(board);
    same("head");
    same("gpio");
    same("index");
    uint8_t a[8][HASH_SHA256_BYTES], b[8][HASH_SHA256_BYTES];
    size_t frames = frame_hashes("recorded", a);
    assert_true(frames > 0);
    assert_int_equal(frame_hashes("again", b), frames);
    assert_memory_equal(a, b, frames * HASH_SHA256_BYTES);
}

static void counts(void *ctx, const uint8_t *bytes, size_t size, int64_t t_host_ns) {
    size_t *sum = ctx;
    (void)bytes;
    (void)t_host_ns;
    *sum += size;
}

static void a_recording_keeps_its_own_timing(void **state) {
    (void)state;
    struct errctx err = {0};
    size_t early = 0, all = 0;
    struct board_open *board = open_recording(true);
    struct cart_devices devices = board_open_cart(board);
    struct head_sink first = {&early, counts}, rest = {&all, counts};
    assert_false(devices.hosttime->is_virtual);
    assert_int_equal(devices.head->ops->start(devices.head, &err), ST_OK);
    int64_t start_ns = hosttime_now_ns(devices.hosttime);
    assert_int_equal(devices.head->ops->pump(devices.head, 20, &first, &err), ST_OK);
    int64_t took_ns = hosttime_now_ns(devices.hosttime) - start_ns;
    assert_int_equal(devices.head->ops->stop(devices.head, &rest, &err), ST_OK);
    struct bytes recorded = payload("recorded", "head");
    assert_int_equal(early + all, recorded.size);
    /* 20 ms of some seconds, however long the machine slept in between */
    if (took_ns < 1000000000)
        assert_true(early < recorded.size / 2);
    free(recorded.at);
    board_open_close(board);
}

static void the_head_ends_with_the_recording(void **state) {
    (void)state;
    struct errctx err = {0};
    size_t all = 0;
    struct board_open *board = open_recording(false);
    struct cart_devices devices = board_open_cart(board);
    struct head_sink sink = {&all, counts};
    enum st st = devices.head->ops->start(devices.head, &err);
    for (int i = 0; i < 10000 && !st; i++)
        st = devices.head->ops->pump(devices.head, 100, &sink, &err);
    assert_int_equal(st, ST_CANCELLED);
    struct bytes recorded = payload("recorded", "head");
    assert_int_equal(all, recorded.size);
    free(recorded.at);
    board_open_close(board);
}

static void refuses_what_is_no_recording(void **state) {
    (void)state;
    char path[PATH_BYTES];
    struct errctx err = {0};
    struct replay *replay = NULL;
    int64_t station = 0;
    path_of("nowhere", path);
    assert_int_equal(replay_open(path, NULL, false, &replay, &err), ST_NOT_FOUND);
    path_of("empty", path);
    assert_int_equal(site_close(new_site("empty", &station), &err), ST_OK);
    assert_int_equal(replay_open(path, NULL, false, &replay, &err), ST_NOT_FOUND);
    path_of("recorded", path);
    assert_int_equal(replay_open(path, "b", false, &replay, &err), ST_NOT_FOUND);
    assert_null(replay);
}

static int set_up(void **state) {
    (void)state;
    if (!tempdir_make(dir))
        return -1;
    record();
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    tempdir_remove(dir);
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(capturing_a_recording_gives_the_same_bytes),
        cmocka_unit_test(a_recording_keeps_its_own_timing),
        cmocka_unit_test(the_head_ends_with_the_recording),
        cmocka_unit_test(refuses_what_is_no_recording),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
