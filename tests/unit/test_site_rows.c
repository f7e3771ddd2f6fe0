/* Stations, calibrations, files, frames, photographs, jobs. */
#include "base/fileio.h"
#include "site/calib.h"
#include "site/custody.h"
#include "site/files.h"
#include "site/frame_row.h"
#include "site/job.h"
#include "site/photo_row.h"
#include "site/site_check.h"
#include "site/station.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/site_sample.h"
#include "tests/support/tempdir.h"

#include <math.h>

enum { TEXT_MAX = 1024 };

static char dir[TEMPDIR_MAX], path[TEXT_MAX];
static struct site *site;
static int64_t station_id;

static int setup(void **state) {
    (void)state;
    struct errctx err = {0};
    struct site_info info = {0};
    struct station_pose pose = site_sample_pose(0.5);
    if (!tempdir_make(dir))
        return -1;
    (void)snprintf(path, sizeof path, "%s/site", dir);
    return site_create(path, &info, &site, &err) ||
                   station_add(site, "stand", "{\"a\":1}", &pose, &station_id, &err)
               ? -1
               : 0;
}

static int teardown(void **state) {
    (void)state;
    struct site_check_result result = {0};
    enum st closed = site_close(site, NULL);
    enum st checked = site_check(path, NULL, &result, NULL);
    if (result.errors)
        (void)printf("%s: %s\n", result.first.where, result.first.what);
    site = NULL;
    tempdir_remove(dir);
    return closed || checked || result.errors ? -1 : 0;
}

static void newest_pose_counts_and_none_is_lost(void **state) {
    (void)state;
    struct errctx err = {0};
    struct station_pose better = site_sample_pose(0.75), poses[4];
    (void)snprintf(better.source, sizeof better.source, "register");
    better.has_covariance = false;
    assert_int_equal(station_add_pose(site, station_id, &better, &err), ST_OK);
    struct station station;
    assert_int_equal(station_find(site, "stand", &station, &err), ST_OK);
    assert_int_equal(station.pose_count, 2);
    assert_string_equal(station.pose.source, "register");
    assert_false(station.pose.has_covariance);
    assert_memory_equal(&station.pose.world_from_station, &better.world_from_station,
                        sizeof better.world_from_station);
    assert_string_equal(station.remark, "{\"a\":1}");
    size_t count = 0;
    assert_int_equal(station_poses(site, station_id, 0, poses, 4, &count, &err), ST_OK);
    assert_int_equal(count, 2);
    assert_string_equal(poses[0].source, "test");
    assert_true(poses[0].has_covariance && poses[0].covariance[35] == 6e-6);
    assert_int_equal(station_add_pose(site, 9, &better, &err), ST_NOT_FOUND);
}

static void bad_poses_are_refused(void **state) {
    (void)state;
    struct errctx err = {0};
    struct station_pose pose[6];
    for (int i = 0; i < 6; i++)
        pose[i] = site_sample_pose(1);
    pose[0].world_from_station.r.m[4] += 1e-4;
    pose[1].world_from_station.t_m.z = NAN;
    pose[2].covariance[1] = 1e-3;
    pose[3].covariance[0] = -1;
    pose[4].covariance[7] = INFINITY;
    pose[5].source[0] = '\0';
    for (int i = 0; i < 6; i++)
        assert_int_equal(station_add_pose(site, station_id, &pose[i], &err), ST_INVALID);
    struct station station;
    assert_int_equal(station_get(site, station_id, &station, &err), ST_OK);
    assert_int_equal(station.pose_count, 1);
}

static void lists_page_through_everything(void **state) {
    (void)state;
    struct errctx err = {0};
    struct station_pose pose = site_sample_pose(1);
    assert_int_equal(site_begin(site, &err), ST_OK);
    for (int i = 0; i < 9; i++) {
        char name[16];
        int64_t id = 0;
        (void)snprintf(name, sizeof name, "s%d", i);
        assert_int_equal(station_add(site, name, NULL, &pose, &id, &err), ST_OK);
    }
    assert_int_equal(site_commit(site, &err), ST_OK);
    struct station page[4];
    size_t count = 4, total = 0;
    for (int64_t after = 0; count == 4; after = page[count - 1].id) {
        assert_int_equal(station_list(site, after, page, 4, &count, &err), ST_OK);
        total += count;
        if (!count)
            break;
    }
    assert_int_equal(total, 10);
}

static void calibration_is_found_by_kind_name_and_status(void **state) {
    (void)state;
    struct errctx err = {0};
    struct calib record = {
        .kind = "rig", .name = "cart 1", .status = CALIB_NOMINAL, .format = CALIB_YAML};
    int64_t first = 0, again = 0, second = 0;
    assert_int_equal(calib_add(site, &record, "a: 1\n", 5, &first, &err), ST_OK);
    assert_int_equal(calib_add(site, &record, "a: 1\n", 5, &again, &err), ST_OK);
    assert_int_equal(first, again);
    record.status = CALIB_ESTIMATED;
    assert_int_equal(calib_add(site, &record, "a: 1.01\n", 8, &second, &err), ST_OK);
    struct calib found;
    assert_int_equal(calib_find(site, "rig", NULL, 0, &found, &err), ST_OK);
    assert_int_equal(found.id, second);
    assert_int_equal(calib_find(site, "rig", "cart 1", CALIB_NOMINAL, &found, &err), ST_OK);
    assert_int_equal(found.id, first);
    assert_int_equal(calib_find(site, "rig", "cart 2", 0, &found, &err), ST_NOT_FOUND);
    assert_int_equal(calib_find(site, "camera", NULL, 0, &found, &err), ST_NOT_FOUND);
    char text[16];
    assert_int_equal(calib_read(site, second, &found, text, sizeof text, &err), ST_OK);
    assert_string_equal(text, "a: 1.01\n");
    assert_int_equal(found.size_bytes, 8);
    assert_int_equal(calib_read(site, second, &found, text, 8, &err), ST_NOMEM);
    assert_int_equal(calib_add(site, &record, "a\0b", 3, &first, &err), ST_INVALID);
    assert_int_equal(calib_add(site, &record, "", 0, &first, &err), ST_INVALID);
    record.status = 0;
    assert_int_equal(calib_add(site, &record, "a", 1, &first, &err), ST_INVALID);
}

static void same_bytes_are_stored_once(void **state) {
    (void)state;
    struct errctx err = {0};
    uint8_t a[HASH_SHA256_BYTES], b[HASH_SHA256_BYTES], *bytes = NULL;
    size_t size = 0, count = 0;
    char file[FILEIO_PATH_MAX], hex[HASH_HEX_CHARS];
    assert_int_equal(files_put(site, FILES_FRAME, "jpg", "abc", 3, a, &err), ST_OK);
    assert_int_equal(files_put(site, FILES_FRAME, "jpg", "abc", 3, b, &err), ST_OK);
    assert_memory_equal(a, b, sizeof a);
    hash_to_hex(a, hex);
    assert_string_equal(hex, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    assert_int_equal(files_path(site, a, file, &err), ST_OK);
    assert_non_null(strstr(file, "/frames/ba7816bf"));
    assert_int_equal(files_read(site, a, &bytes, &size, &err), ST_OK);
    assert_int_equal(size, 3);
    assert_memory_equal(bytes, "abc", 3);
    free(bytes);
    struct files_entry list[4];
    assert_int_equal(files_list(site, 0, 0, list, 4, &count, &err), ST_OK);
    assert_int_equal(count, 1);
    assert_string_equal(list[0].extension, "jpg");
    assert_int_equal(files_put(site, FILES_FRAME, "JPG", "abd", 3, a, &err), ST_INVALID);
    assert_int_equal(files_put(site, FILES_FRAME, "../x", "abd", 3, a, &err), ST_INVALID);
    assert_int_equal(files_put(site, FILES_FRAME, "jpg", "", 0, a, &err), ST_INVALID);
}

static void damaged_file_is_named_and_a_lost_one_put_back(void **state) {
    (void)state;
    struct errctx err = {0};
    uint8_t sha256[HASH_SHA256_BYTES], *bytes = NULL;
    size_t size = 0;
    char file[FILEIO_PATH_MAX];
    assert_int_equal(files_put(site, FILES_PHOTO, "tif", "abc", 3, sha256, &err), ST_OK);
    assert_int_equal(files_path(site, sha256, file, &err), ST_OK);
    assert_int_equal(fileio_write(file, "abd", 3, &err), ST_OK);
    assert_int_equal(files_read(site, sha256, &bytes, &size, &err), ST_DAMAGED);
    assert_non_null(strstr(err.text, "/photos/ba7816bf"));
    assert_int_equal(fileio_write(file, "abcd", 4, &err), ST_OK);
    assert_int_equal(files_read(site, sha256, &bytes, &size, &err), ST_DAMAGED);
    assert_int_equal(fileio_remove(file, &err), ST_OK);
    assert_int_equal(files_read(site, sha256, &bytes, &size, &err), ST_NOT_FOUND);
    assert_int_equal(files_put(site, FILES_PHOTO, "tif", "abc", 3, sha256, &err), ST_OK);
    assert_int_equal(files_read(site, sha256, &bytes, &size, &err), ST_OK);
    free(bytes);
}

static void adopted_file_moves_into_the_site(void **state) {
    (void)state;
    struct errctx err = {0};
    uint8_t first[HASH_SHA256_BYTES], second[HASH_SHA256_BYTES];
    char temp[FILEIO_PATH_MAX], file[FILEIO_PATH_MAX];
    for (int i = 0; i < 2; i++) {
        assert_int_equal(files_temp_path(site, FILES_PHOTO, "tif", temp, &err), ST_OK);
        assert_int_equal(fileio_write(temp, "tiff bytes", 10, &err), ST_OK);
        assert_int_equal(files_adopt(site, FILES_PHOTO, "tif", temp, i ? second : first, &err),
                         ST_OK);
        assert_false(fileio_exists(temp));
    }
    assert_memory_equal(first, second, sizeof first);
    assert_int_equal(files_path(site, first, file, &err), ST_OK);
    assert_true(fileio_exists(file));
    assert_int_equal(files_temp_path(site, FILES_PHOTO, "tif", temp, &err), ST_OK);
    assert_int_equal(files_adopt(site, FILES_PHOTO, "tif", temp, first, &err),
                     ST_INVALID); /* empty */
    assert_false(fileio_exists(temp));
}

static void leftovers_of_a_crash_are_swept(void **state) {
    (void)state;
    struct errctx err = {0};
    char temp[FILEIO_PATH_MAX];
    assert_int_equal(files_temp_path(site, FILES_TILES, "bin", temp, &err), ST_OK);
    assert_true(fileio_exists(temp));
    assert_int_equal(site_close(site, &err), ST_OK);
    assert_int_equal(site_open(path, SITE_READ, &site, &err), ST_OK);
    assert_true(fileio_exists(temp));
    assert_int_equal(site_close(site, &err), ST_OK);
    assert_int_equal(site_open(path, SITE_WRITE, &site, &err), ST_OK);
    assert_false(fileio_exists(temp));
}

static void frame_row_keeps_what_is_not_known(void **state) {
    (void)state;
    struct errctx err = {0};
    struct frame_row row = {.station_id = station_id,
                            .t_ns = INT64_C(123456789012345678),
                            .width_px = 640,
                            .height_px = 480,
                            .exposure_s = 0.02,
                            .gain = NAN,
                            .pan_rad = 1e-300,
                            .tilt_rad = NAN},
                     found;
    int64_t id = 0;
    assert_int_equal(frame_row_add(site, &row, &id, &err), ST_NOT_FOUND);
    assert_int_equal(files_put(site, FILES_FRAME, "jpg", "abc", 3, row.sha256, &err), ST_OK);
    assert_int_equal(frame_row_add(site, &row, &id, &err), ST_OK);
    assert_int_equal(frame_row_get(site, id, &found, &err), ST_OK);
    assert_true(isnan(found.gain) && isnan(found.tilt_rad) && found.pan_rad == 1e-300);
    assert_int_equal(found.t_ns, row.t_ns);
    assert_int_equal(found.camera_calib_id, 0);
    row.camera_calib_id = 5;
    assert_int_equal(frame_row_add(site, &row, &id, &err), ST_NOT_FOUND);
    row.camera_calib_id = 0;
    row.gain = INFINITY;
    assert_int_equal(frame_row_add(site, &row, &id, &err), ST_INVALID);
}

static void photograph_replaces_the_one_of_its_name(void **state) {
    (void)state;
    struct errctx err = {0};
    struct photo_row row = {.station_id = station_id,
                            .name = "front",
                            .width_px = 4,
                            .height_px = 3,
                            .station_from_cam = pose_identity()},
                     list[4];
    int64_t first = 0, second = 0;
    size_t count = 0;
    assert_int_equal(files_put(site, FILES_PHOTO, "tif", "abc", 3, row.sha256, &err), ST_OK);
    assert_int_equal(photo_row_put(site, &row, &first, &err), ST_OK);
    assert_int_equal(files_put(site, FILES_PHOTO, "tif", "abd", 3, row.sha256, &err), ST_OK);
    assert_int_equal(photo_row_put(site, &row, &second, &err), ST_OK);
    assert_int_equal(photo_row_list(site, 0, 0, list, 4, &count, &err), ST_OK);
    assert_int_equal(count, 1);
    assert_memory_equal(list[0].sha256, row.sha256, sizeof row.sha256);
    struct photo_row found;
    assert_int_equal(photo_row_find(site, 0, "front", &found, &err), ST_OK);
    assert_int_equal(found.id, second);
    assert_int_equal(photo_row_remove(site, second, &err), ST_OK);
    assert_int_equal(photo_row_find(site, station_id, "front", &found, &err), ST_NOT_FOUND);
    assert_int_equal(photo_row_remove(site, second, &err), ST_NOT_FOUND);
    struct custody_event last;
    assert_int_equal(custody_last(site, &last, &err), ST_OK);
    assert_string_equal(last.what, "photo.removed");
    row.station_from_cam.r.m[0] = 2;
    assert_int_equal(photo_row_put(site, &row, &second, &err), ST_INVALID);
}

static struct job make_job(const struct job_hash *in, const struct job_hash *out) {
    return (struct job){.kind = "fuse.photo",
                        .parameters =
                            "{\"b\": {\"y\": 2, \"x\": [1, {\"d\": 1, \"c\": 2}]}, \"a\": 0.1}",
                        .program = "scancart 1",
                        .inputs = in,
                        .input_count = 1,
                        .outputs = out,
                        .output_count = 1,
                        .seconds = 0.5};
}

static void job_is_up_to_date_until_something_changes(void **state) {
    (void)state;
    struct errctx err = {0};
    struct job_hash in = {.role = "frame"}, out = {.role = "photo"};
    int64_t id = 0, found = 0;
    char file[FILEIO_PATH_MAX];
    assert_int_equal(files_put(site, FILES_FRAME, "jpg", "in", 2, in.sha256, &err), ST_OK);
    assert_int_equal(files_put(site, FILES_PHOTO, "tif", "out", 3, out.sha256, &err), ST_OK);
    struct job job = make_job(&in, &out), same = job;
    assert_int_equal(job_find(site, &job, &found, &err), ST_NOT_FOUND);
    assert_int_equal(job_add(site, &job, &id, &err), ST_OK);
    same.parameters = "{\"a\":0.1,\"b\":{\"x\":[1,{\"c\":2,\"d\":1}],\"y\":2}}"; /* another order */
    same.output_count = 0;
    assert_int_equal(job_find(site, &same, &found, &err), ST_OK);
    assert_int_equal(found, id);
    struct job other = same;
    other.parameters = "{\"a\":0.2,\"b\":{\"x\":[1,{\"c\":2,\"d\":1}],\"y\":2}}";
    assert_int_equal(job_find(site, &other, &found, &err), ST_NOT_FOUND);
    other = same;
    (void)snprintf(other.program, sizeof other.program, "scancart 2");
    assert_int_equal(job_find(site, &other, &found, &err), ST_NOT_FOUND);
    other = same;
    other.inputs = &out;
    assert_int_equal(job_find(site, &other, &found, &err), ST_NOT_FOUND);
    assert_int_equal(files_path(site, out.sha256, file, &err), ST_OK);
    assert_int_equal(fileio_remove(file, &err), ST_OK); /* an output is gone */
    assert_int_equal(job_find(site, &same, &found, &err), ST_NOT_FOUND);
    assert_int_equal(files_put(site, FILES_PHOTO, "tif", "out", 3, out.sha256, &err), ST_OK);
    assert_int_equal(job_find(site, &same, &found, &err), ST_OK);
}

static void job_comes_back_whole(void **state) {
    (void)state;
    struct errctx err = {0};
    struct job_hash in[2] = {{.role = "source", .outside = true}, {.role = "rig"}};
    struct job_hash out[1] = {{.role = "photo"}};
    struct calib record = {.kind = "rig", .name = "c", .status = CALIB_TRUE, .format = CALIB_JSON};
    struct calib stored;
    int64_t id = 0, ids[4], calib_id = 0;
    size_t count = 0;
    memset(in[0].sha256, 7, sizeof in[0].sha256);
    assert_int_equal(calib_add(site, &record, "{}", 2, &calib_id, &err), ST_OK);
    assert_int_equal(calib_find(site, "rig", NULL, 0, &stored, &err), ST_OK);
    memcpy(in[1].sha256, stored.sha256, sizeof stored.sha256);
    assert_int_equal(files_put(site, FILES_PHOTO, "tif", "out", 3, out[0].sha256, &err), ST_OK);
    struct job job = make_job(in, out), *read = NULL;
    job.input_count = 2;
    assert_int_equal(job_add(site, &job, &id, &err), ST_OK);
    assert_int_equal(job_read(site, id, &read, &err), ST_OK);
    assert_string_equal(read->parameters,
                        "{\"a\":0.1,\"b\":{\"x\":[1,{\"c\":2,\"d\":1}],\"y\":2}}");
    assert_int_equal(read->input_count, 2);
    assert_int_equal(read->output_count, 1);
    assert_true(read->inputs[0].outside && !read->inputs[1].outside);
    assert_string_equal(read->inputs[1].role, "rig");
    assert_memory_equal(read->outputs[0].sha256, out[0].sha256, 32);
    assert_true(read->seconds == 0.5);
    job_free(read);
    assert_int_equal(job_list(site, "fuse.photo", 0, ids, 4, &count, &err), ST_OK);
    assert_int_equal(count, 1);
    assert_int_equal(job_list(site, "other", 0, ids, 4, &count, &err), ST_OK);
    assert_int_equal(count, 0);
}

static void job_that_refers_to_nothing_is_refused(void **state) {
    (void)state;
    struct errctx err = {0};
    struct job_hash in = {.role = "frame"};
    struct job job = make_job(&in, NULL);
    int64_t id = 0;
    job.output_count = 0;
    memset(in.sha256, 9, sizeof in.sha256);
    assert_int_equal(job_add(site, &job, &id, &err), ST_NOT_FOUND);
    in.outside = true;
    assert_int_equal(job_add(site, &job, &id, &err), ST_OK);
    static const char *const bad[] = {"", "[]", "{", "{\"a\":1} x", "{\"a\":1,\"a\":2}", NULL};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        job.parameters = bad[i];
        enum st st = job_add(site, &job, &id, &err);
        assert_true(st == ST_FORMAT || st == ST_INVALID);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)
        T(newest_pose_counts_and_none_is_lost),
        T(bad_poses_are_refused),
        T(lists_page_through_everything),
        T(calibration_is_found_by_kind_name_and_status),
        T(same_bytes_are_stored_once),
        T(damaged_file_is_named_and_a_lost_one_put_back),
        T(adopted_file_moves_into_the_site),
        T(leftovers_of_a_crash_are_swept),
        T(frame_row_keeps_what_is_not_known),
        T(photograph_replaces_the_one_of_its_name),
        T(job_is_up_to_date_until_something_changes),
        T(job_comes_back_whole),
        T(job_that_refers_to_nothing_is_refused),
#undef T
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
