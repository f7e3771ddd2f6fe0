#include "tests/support/site_sample.h"

#include "site/calib.h"
#include "site/custody.h"
#include "site/files.h"
#include "site/frame_row.h"
#include "site/job.h"
#include "site/photo_row.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct station_pose site_sample_pose(double angle_rad) {
    struct station_pose pose = {.world_from_station = {.t_m = {1.5, -2.25, 0.125}},
                                .has_covariance = true,
                                .source = "test"};
    pose.world_from_station.r = so3_exp(vec3_make(0.1, -0.2, angle_rad));
    for (int i = 0; i < 6; i++)
        pose.covariance[7 * i] = 1e-6 * (i + 1);
    return pose;
}

void site_sample_bytes(uint64_t seed, uint8_t *out_bytes, size_t size) {
    for (size_t i = 0; i < size; i++) {
        uint64_t x = (seed + i / 1024) * UINT64_C(0x9e3779b97f4a7c15);
        out_bytes[i] = (uint8_t)((i / 512 % 2 ? x ^ (x * i) >> 20 : i) >> 3);
    }
}

struct stream_chunk site_sample_chunk(int64_t first, int64_t count, const void *payload,
                                      size_t size) {
    return (struct stream_chunk){.t_first_ns = 1000 * first,
                                 .t_last_ns = 1000 * (first + count),
                                 .first_item = first,
                                 .end_item = first + count,
                                 .item_count = count,
                                 .payload = payload,
                                 .size_bytes = size};
}

enum st site_sample_stream(struct site *site, int32_t zstd_level, int64_t *out_id,
                           struct errctx *err) {
    struct station_pose pose = site_sample_pose(0.5);
    struct stream stream = {.kind = "head",
                            .name = "sn-1",
                            .format = "bytes.1",
                            .meta = "{\"rate_hz\":25000}",
                            .origin_m = {0.1, 0.2, 0.3},
                            .zstd_level = zstd_level};
    enum st st = station_add(site, "stand", NULL, &pose, &stream.station_id, err);
    return st ? st : stream_add(site, &stream, out_id, err);
}

static enum st fill_stream(struct site *site, int64_t station_id, const char *kind, int32_t level,
                           uint8_t out_chain[HASH_SHA256_BYTES], struct errctx *err) {
    static uint8_t payload[6000];
    struct stream stream = {.station_id = station_id, .format = "bytes.1", .zstd_level = level};
    (void)snprintf(stream.kind, sizeof stream.kind, "%s", kind);
    (void)snprintf(stream.name, sizeof stream.name, "device of %s", kind);
    int64_t id = 0;
    enum st st = stream_add(site, &stream, &id, err);
    for (int i = 0; i < 6 && !st; i++) {
        size_t size = sizeof payload / (size_t)(1 + i);
        site_sample_bytes((uint64_t)(7 * station_id + i), payload, size);
        struct stream_chunk chunk = site_sample_chunk(100 * i, i == 3 ? 90 : 100, payload, size);
        st = stream_append(site, id, &chunk, 1, err);
    }
    struct stream_ledger lost = {
        .stream_id = id, .first_item = 390, .end_item = 400, .t_ns = 5, .reason = "usb_lost"};
    if (!st)
        st = stream_ledger_add(site, &lost, err);
    struct stream_state state;
    if (!st)
        st = stream_get_state(site, id, &state, err);
    if (!st)
        memcpy(out_chain, state.chain, HASH_SHA256_BYTES);
    return st;
}

static enum st fill_station(struct site *site, int number, int64_t calib_id, struct errctx *err) {
    static uint8_t bytes[5000];
    char name[SITE_NAME_MAX];
    int64_t station = 0, frame = 0, job_id = 0, photo = 0;
    struct station_pose pose = site_sample_pose(0.3 * number);
    struct job_hash input = {.role = "stream"}, output = {.role = "photo"};
    (void)snprintf(name, sizeof name, "stand %d", number);
    enum st st = station_add(site, name, "{\"note\":\"wet road\"}", &pose, &station, err);
    if (!st)
        st = fill_stream(site, station, "head", 0, input.sha256, err);
    if (!st)
        st = fill_stream(site, station, "index", 3, input.sha256, err);
    struct frame_row row = {.station_id = station,
                            .t_ns = 77,
                            .width_px = 640,
                            .height_px = 480,
                            .exposure_s = 0.01,
                            .gain = NAN,
                            .pan_rad = -0.0,
                            .tilt_rad = 2.0,
                            .camera_calib_id = calib_id};
    site_sample_bytes((uint64_t)(1000 + number), bytes, sizeof bytes);
    if (!st)
        st = files_put(site, FILES_FRAME, "jpg", bytes, sizeof bytes, row.sha256, err);
    if (!st)
        st = frame_row_add(site, &row, &frame, err);
    site_sample_bytes((uint64_t)(2000 + number), bytes, sizeof bytes - 100);
    if (!st)
        st = files_put(site, FILES_PHOTO, "tif", bytes, sizeof bytes - 100, output.sha256, err);
    struct job job = {.kind = "fuse.photo",
                      .parameters = "{\"quality\":\"field\"}",
                      .program = "scancart test",
                      .inputs = &input,
                      .input_count = 1,
                      .outputs = &output,
                      .output_count = 1,
                      .seconds = 1.5};
    if (!st)
        st = job_add(site, &job, &job_id, err);
    struct photo_row photo_row = {.station_id = station,
                                  .name = "front",
                                  .width_px = 320,
                                  .height_px = 240,
                                  .station_from_cam = pose.world_from_station,
                                  .frame_id = frame,
                                  .job_id = job_id};
    memcpy(photo_row.sha256, output.sha256, sizeof output.sha256);
    if (!st)
        st = photo_row_put(site, &photo_row, &photo, err);
    return st ? st : station_add_pose(site, station, &pose, err);
}

enum st site_sample_make(const char *path, struct errctx *err) {
    static const char yaml[] = "rig:\n  mirror_deg: 44.8\n";
    struct site_info info = {.name = "sample",
                             .georef = {.epsg = 25832, .offset_m = {5e5, 5.5e6, 40}}};
    struct calib record = {
        .kind = "rig", .name = "cart 1", .status = CALIB_NOMINAL, .format = CALIB_YAML};
    struct site *site = NULL;
    int64_t calib_id = 0;
    enum st st = site_create(path, &info, &site, err);
    if (st)
        return st;
    site_set_actor(site, "tester", "test 1");
    site_set_clock(site, SITE_SAMPLE_UTC_NS);
    st = site_begin(site, err); /* one flush */
    if (!st)
        st = calib_add(site, &record, yaml, sizeof yaml - 1, &calib_id, err);
    for (int i = 1; i <= 2 && !st; i++)
        st = fill_station(site, i, calib_id, err);
    if (!st)
        st = custody_add(site, "capture.end", "{\"samples\":1}", err);
    if (!st)
        st = site_commit(site, err);
    if (!st)
        return site_close(site, err);
    (void)site_close(site, NULL);
    return st;
}

/* What a damaged site gives back does not matter here: only that it gives something back. */
static void ignore(enum st st) {
    (void)st;
}

static void read_photos(struct site *site) {
    struct photo_row photos[4];
    size_t count = 0;
    ignore(photo_row_list(site, 0, 0, photos, 4, &count, NULL));
    for (size_t i = 0; i < count; i++) {
        uint8_t *bytes = NULL;
        size_t size = 0;
        if (!files_read(site, photos[i].sha256, &bytes, &size, NULL))
            free(bytes);
    }
}

static void read_jobs(struct site *site) {
    int64_t ids[4];
    size_t count = 0;
    ignore(job_list(site, NULL, 0, ids, 4, &count, NULL));
    for (size_t i = 0; i < count; i++) {
        struct job *job = NULL;
        int64_t id = 0;
        if (job_read(site, ids[i], &job, NULL))
            continue;
        ignore(job_find(site, job, &id, NULL));
        job_free(job);
    }
}

static void read_rows(struct site *site) {
    struct station stations[4];
    struct station_pose poses[4];
    struct frame_row frames[4];
    struct calib calibs[4];
    struct files_entry files[8];
    struct custody_event events[8];
    struct site_info info;
    size_t count = 0;
    char text[64];
    ignore(site_get_info(site, &info, NULL));
    ignore(frame_row_list(site, 0, 0, frames, 4, &count, NULL));
    ignore(files_list(site, 0, 0, files, 8, &count, NULL));
    ignore(custody_list(site, 0, events, 8, &count, NULL));
    ignore(calib_list(site, 0, calibs, 4, &count, NULL));
    ignore(calib_read(site, 1, NULL, text, sizeof text, NULL));
    ignore(calib_find(site, "rig", "cart 1", 0, calibs, NULL));
    ignore(station_poses(site, 1, 0, poses, 4, &count, NULL));
    ignore(station_list(site, 0, stations, 4, &count, NULL));
}

static bool read_stream(struct site *site, int64_t id) {
    enum { CALLS_MAX = 200 };
    struct stream_reader *reader = NULL;
    struct stream_chunk chunk;
    struct stream_state state;
    struct stream_ledger entries[4];
    size_t count = 0;
    ignore(stream_get_state(site, id, &state, NULL));
    ignore(stream_ledger_list(site, id, 0, entries, 4, &count, NULL));
    if (stream_reader_open(site, id, 0, &reader, NULL))
        return true;
    enum st st = ST_OK;
    for (int i = 0; i < CALLS_MAX && st != ST_NOT_FOUND; i++)
        st = stream_reader_next(reader, &chunk, NULL);
    stream_reader_close(reader);
    return st == ST_NOT_FOUND;
}

bool site_sample_read_all(const char *path) {
    struct site *site = NULL;
    struct stream streams[8];
    size_t count = 0;
    bool good = true;
    if (site_open(path, SITE_READ, &site, NULL))
        return true;
    read_rows(site);
    read_photos(site);
    read_jobs(site);
    ignore(stream_list(site, 0, 0, streams, 8, &count, NULL));
    for (size_t i = 0; i < count; i++)
        good = read_stream(site, streams[i].id) && good;
    (void)site_close(site, NULL);
    return good;
}
