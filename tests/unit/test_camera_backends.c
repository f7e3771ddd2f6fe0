/* The camera backends without a camera: what is refused, and how. Frames come in the virtual
 * machine's test. */
#include "capture/backends/camera_libcamera.h"
#include "capture/backends/camera_v4l2.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/tempdir.h"

#include <stdbool.h>
#include <string.h>
#include <unistd.h>

static void refuses_a_camera_that_is_not_there(void **state) {
    (void)state;
    struct camera_device *camera = NULL;
    struct errctx err = {0};
    assert_int_equal(camera_v4l2_open("/dev/no-such-camera", &camera, &err), ST_NOT_FOUND);
    assert_non_null(strstr(err.text, "/dev/no-such-camera"));
    assert_null(camera);
}

static void refuses_what_is_no_camera(void **state) {
    (void)state;
    struct camera_device *camera = NULL;
    struct errctx err = {0};
    assert_int_equal(camera_v4l2_open("/dev/null", &camera, &err), ST_UNSUPPORTED);
    assert_non_null(strstr(err.text, "no camera"));
    assert_null(camera);
}

static void a_forbidden_camera_names_the_udev_rule(void **state) {
    (void)state;
    char dir[TEMPDIR_MAX], path[TEMPDIR_MAX + 8];
    struct camera_device *camera = NULL;
    struct errctx err = {0};
    assert_true(tempdir_make(dir));
    (void)snprintf(path, sizeof path, "%s/video", dir);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    assert_int_equal(fclose(file), 0);
    assert_int_equal(chmod(path, 0), 0);
    bool root = !geteuid();
    if (root)
        assert_int_equal(seteuid(65534), 0);
    enum st st = camera_v4l2_open(path, &camera, &err);
    if (root)
        assert_int_equal(seteuid(0), 0);
    tempdir_remove(dir);
    assert_int_equal(st, ST_PERMISSION);
    assert_non_null(strstr(err.text, "70-scancart.rules"));
}

static void libcamera_says_that_there_is_none_or_that_it_is_not_built_in(void **state) {
    (void)state;
    struct camera_device *camera = NULL;
    struct errctx err = {0};
    enum st st = camera_libcamera_open("no such camera", &camera, &err);
    assert_true(st == ST_NOT_FOUND || st == ST_UNSUPPORTED);
    assert_non_null(strstr(err.text, "libcamera"));
    assert_null(camera);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(refuses_a_camera_that_is_not_there),
        cmocka_unit_test(refuses_what_is_no_camera),
        cmocka_unit_test(a_forbidden_camera_names_the_udev_rule),
        cmocka_unit_test(libcamera_says_that_there_is_none_or_that_it_is_not_built_in),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
