/* Calibration of a camera beside a spinning laser: against the file's own projection, and refusals.
 */
#include "import/kitti_calib.h"
#include "tests/support/cmocka_all.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { WIDTH = 1000, HEIGHT = 400, TEXT = 2048 };

static const double p2[12] = {700, 0, 510, 45, 0, 690, 190, -0.4, 0, 0, 1, 0.005};
/* turned by 0.1 rad about the optical axis; seven digits, as such files have */
static const double r0[9] = {0.9950042, -0.0998334, 0, 0.0998334, 0.9950042, 0, 0, 0, 1};
static const double tr[12] = {0, -1, 0, 0.02, 0, 0, -1, -0.07, 1, 0, 0, -0.3};

static void put_line(char *text, const char *key, const double *v, int count) {
    size_t n = strlen(text);
    n += (size_t)snprintf(text + n, TEXT - n, "%s", key);
    for (int i = 0; i < count; i++)
        n += (size_t)snprintf(text + n, TEXT - n, " %.12e", v[i]);
    (void)snprintf(text + n, TEXT - n, "\n");
}

static void write_calib(char text[TEXT]) {
    text[0] = 0;
    put_line(text, "P0:", p2, 12);
    put_line(text, "P2:", p2, 12);
    put_line(text, "R0_rect:", r0, 9);
    put_line(text, "Tr_velo_to_cam:", tr, 12);
    put_line(text, "Tr_imu_to_velo:", tr, 12);
}

/* P2 R0 Tr x, as the file defines it */
static struct vec2 project(struct vec3 x) {
    double a[4], b[4], c[3];
    const double in[4] = {x.x, x.y, x.z, 1};
    for (int i = 0; i < 3; i++) {
        a[i] = b[i] = c[i] = 0;
        for (int k = 0; k < 4; k++)
            a[i] += tr[4 * i + k] * in[k];
    }
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            b[i] += r0[3 * i + k] * a[k];
    b[3] = 1;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 4; k++)
            c[i] += p2[4 * i + k] * b[k];
    return (struct vec2){c[0] / c[2], c[1] / c[2]};
}

static void points_fall_where_the_files_matrices_say(void **state) {
    (void)state;
    char text[TEXT];
    struct camera camera;
    struct pose velo_from_cam;
    struct errctx err = {0};
    write_calib(text);
    if (kitti_calib_parse(text, strlen(text), WIDTH, HEIGHT, &camera, &velo_from_cam, &err))
        fail_msg("%s", err.text);
    assert_int_equal(camera.width_px, WIDTH);
    assert_true(camera_is_pinhole(&camera));
    assert_true(pose_orthonormality_error(&velo_from_cam.r) < 1e-12);
    const struct pose cam_from_velo = pose_inverse(&velo_from_cam);
    for (int i = 0; i < 100; i++) {
        const struct vec3 x = {3.0 + 0.5 * i, 2 * sin(i), cos(2 * i)};
        const struct vec2 truth = project(x);
        struct vec2 px;
        assert_int_equal(camera_project(&camera, pose_apply(&cam_from_velo, x), &px, NULL), ST_OK);
        assert_true(hypot(px.x - truth.x, px.y - truth.y) < 1e-3); /* the rotation's digits */
    }
}

static void expect(const char *text, int32_t width_px, int32_t height_px, const char *says) {
    struct camera camera = {.width_px = -1};
    struct pose pose;
    struct errctx err = {0};
    const enum st st =
        kitti_calib_parse(text, strlen(text), width_px, height_px, &camera, &pose, &err);
    assert_true(st == ST_FORMAT || st == ST_INVALID);
    assert_int_equal(camera.width_px, -1);
    if (!strstr(err.text, says))
        fail_msg("'%s' does not say '%s'", err.text, says);
}

static void a_missing_line_is_named(void **state) {
    (void)state;
    static const char *const keys[] = {"P2:", "R0_rect:", "Tr_velo_to_cam:"};
    for (int k = 0; k < 3; k++) {
        char text[TEXT], says[64];
        write_calib(text);
        *strstr(text, keys[k]) = 'X';
        (void)snprintf(says, sizeof says, "no line %s", keys[k]);
        expect(text, WIDTH, HEIGHT, says);
    }
    expect("", WIDTH, HEIGHT, "no line P2:");
}

static void damaged_lines_are_refused(void **state) {
    (void)state;
    char text[TEXT];
    double bad[12];
    write_calib(text);
    put_line(text, "P2:", p2, 12);
    expect(text, WIDTH, HEIGHT, "line 6: P2: was there before");
    static const struct {
        const char *key;
        int count, given, at;
        double value;
        const char *says;
    } cases[] = {{"P2:", 12, 11, 0, 700, "number 12 is none"},
                 {"R0_rect:", 9, 10, 0, 0.9950042, "more than 9"},
                 {"R0_rect:", 9, 9, 0, 0.9, "R0_rect: is no rotation"},
                 {"R0_rect:", 9, 9, 8, -1, "R0_rect: is no rotation"},
                 {"Tr_velo_to_cam:", 12, 12, 1, 1, "Tr_velo_to_cam: is no rotation"},
                 {"Tr_velo_to_cam:", 12, 12, 3, (double)NAN, "number 4 is none"},
                 {"P2:", 12, 12, 1, 3, "no pinhole"},
                 {"P2:", 12, 12, 0, -700, "no pinhole"},
                 {"P2:", 12, 12, 10, 2, "no pinhole"}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        text[0] = 0;
        for (int k = 0; k < 3; k++) {
            static const char *const keys[] = {"P2:", "R0_rect:", "Tr_velo_to_cam:"};
            const double *from = k == 0 ? p2 : k == 1 ? r0 : tr;
            const bool here = !strcmp(keys[k], cases[i].key);
            memset(bad, 0, sizeof bad);
            memcpy(bad, from, (k == 1 ? 9 : 12) * sizeof *bad);
            if (here)
                bad[cases[i].at] = cases[i].value;
            put_line(text, keys[k], bad, here ? cases[i].given : k == 1 ? 9 : 12);
        }
        expect(text, WIDTH, HEIGHT, cases[i].says);
    }
}

static void an_image_of_another_size_is_refused(void **state) {
    (void)state;
    char text[TEXT];
    write_calib(text);
    expect(text, WIDTH / 2, HEIGHT / 2, "not the one that was calibrated");
    expect(text, 3 * WIDTH, HEIGHT, "not the one that was calibrated");
    expect(text, WIDTH, 2 * HEIGHT, "not the one that was calibrated");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_fall_where_the_files_matrices_say),
        cmocka_unit_test(a_missing_line_is_named),
        cmocka_unit_test(damaged_lines_are_refused),
        cmocka_unit_test(an_image_of_another_size_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
