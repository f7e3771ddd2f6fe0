/* Imports of real scans against what is known of them: a turned line scanner's two stands, three
 * range images of one object with poses, a nodding laser's log, a spinning laser with a camera. */
#include "base/photo.h"
#include "base/picture.h"
#include "base/sample_grid.h"
#include "import/scan_fan.h"
#include "import/scan_job.h"
#include "import/turned_grid.h"
#include "site/photo_tiff.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/real_data.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- the stands ---- */

/* Row, column and range to xyz and back, against the numbers in the file. */
static double reproduction_error_m(const struct scan *scan, const struct turned_grid *grid,
                                   const char *text) {
    double largest = 0, p[3];
    const char *at = text;
    for (size_t i = 0; i < scan->count; i++) {
        char *end = NULL;
        for (int k = 0; k < 3; k++) {
            p[k] = 0.01 * strtod(at, &end);
            at = end;
        }
        const struct polar_sample *s = scan->samples + i;
        const struct vec3 truth = {p[0], p[2], p[1]};
        const double range_m = s->flags & SAMPLE_NO_RETURN ? vec3_norm(truth) : (double)s->range_m;
        const struct vec3 place =
            vec3_scale(turned_grid_direction(grid, s->row, s->column), range_m);
        const struct vec3 polar = vec3_scale(sample_direction(s), range_m);
        largest = fmax(largest, vec3_norm(vec3_sub(place, truth)));
        largest = fmax(largest, vec3_norm(vec3_sub(polar, truth)));
    }
    return largest;
}

static void a_stand_is_226_rows_of_360_to_a_tenth_of_a_millimetre(void **state) {
    (void)state;
    static const char *const names[] = {"scans-3dtk/scan000.3d", "scans-3dtk/scan001.3d"};
    for (int k = 0; k < 2; k++) {
        char path[FILEIO_PATH_MAX];
        uint8_t *text = NULL;
        size_t size = 0, no_returns = 0;
        struct scan scan;
        struct turned_grid grid;
        struct errctx err = {0};
        const struct scan_3dtk_options options = {0};
        if (!real_data_path(names[k], path))
            skip();
        assert_int_equal(fileio_read(path, 1u << 28, &text, &size, &err), ST_OK);
        if (scan_3dtk_parse(text, size, &options, &scan, &grid, &err))
            fail_msg("%s", err.text);
        assert_int_equal(scan.count, 81360);
        assert_int_equal(grid.rows, 226);
        assert_int_equal(grid.columns, 360);
        const double error_m = reproduction_error_m(&scan, &grid, (const char *)text);
        for (size_t i = 0; i < scan.count; i++)
            no_returns += (scan.samples[i].flags & SAMPLE_NO_RETURN) != 0;
        const double share = (double)no_returns / (double)scan.count;
        print_message("%s: reproduced to %.3f mm, %.2f %% no return, %s rows\n", names[k],
                      1e3 * error_m, 100.0 * share, grid.even_rows ? "even" : "tabled");
        assert_true(error_m < 1e-4);
        if (k == 0)
            assert_true(fabs(share - 0.018) < 0.0005);
        turned_grid_fini(&grid);
        scan_destroy(&scan);
        free(text);
    }
}

/* ---- the range images ---- */

enum { SCANS = 3 };

struct view {
    struct scan_job job;
    struct photo photo;
    struct tile *tiles;
    size_t tile_count;
};

static void load_view(struct view *v, const char *path, const char *conf) {
    struct errctx err = {0};
    v->job = scan_job_default();
    v->job.options_ply.up = FRAME_UP_Y;
    (void)snprintf(v->job.path, sizeof v->job.path, "%s", path);
    (void)snprintf(v->job.pose_path, sizeof v->job.pose_path, "%s", conf);
    if (scan_job_prepare(&v->job, &err))
        fail_msg("%s", err.text);
    assert_int_equal(v->job.face_count, 1);
    assert_int_equal(
        photo_tiff_decode(v->job.faces[0].tiff, v->job.faces[0].tiff_size, &v->photo, NULL, &err),
        ST_OK);
    v->tile_count = photo_tile_count(v->photo.camera.width_px, v->photo.camera.height_px);
    v->tiles = calloc(v->tile_count, sizeof *v->tiles);
    assert_non_null(v->tiles);
    photo_tiles(&v->photo, &v->job.scan.world_from_station, v->tiles);
}

static void free_view(struct view *v) {
    scan_job_fini(&v->job);
    photo_destroy(&v->photo);
    free(v->tiles);
}

/* World point of a tile's sample, by the tile's own matrix. */
static struct vec3 tile_point(const struct tile *t, int32_t u, int32_t v) {
    const double delta = (double)t->disparity_per_m[v * t->stride_px + u];
    const struct vec4 x = mat4_mulv(&t->m, (struct vec4){u, v, 1.0, delta});
    return vec3_madd(t->origin_m, vec3_make(x.x, x.y, x.z), 1.0 / x.w);
}

/* The nearest world point of `other` within a few pixels of where p falls in its picture; NaN where
 * other does not see p or sees something more than `same_m` nearer or farther: no overlap there. */
static double distance_to(const struct view *other, struct vec3 p, double same_m) {
    const struct pose world_from_cam =
        pose_compose(&other->job.scan.world_from_station, &other->photo.station_from_cam);
    const struct pose cam_from_world = pose_inverse(&world_from_cam);
    const struct vec3 q = pose_apply(&cam_from_world, p);
    struct vec2 px;
    if (camera_project(&other->photo.camera, q, &px, NULL))
        return NAN;
    const int32_t u0 = (int32_t)lround(px.x), v0 = (int32_t)lround(px.y);
    const int32_t w = other->photo.camera.width_px, h = other->photo.camera.height_px;
    double nearest = NAN;
    for (int32_t v = v0 - 2 < 0 ? 0 : v0 - 2; v <= v0 + 2 && v < h; v++)
        for (int32_t u = u0 - 2 < 0 ? 0 : u0 - 2; u <= u0 + 2 && u < w; u++) {
            const double delta =
                (double)other->photo.disparity_per_m[(size_t)v * (size_t)w + (size_t)u];
            if (isnan(delta) || (u == u0 && v == v0 && fabs(1.0 / delta - q.z) > same_m))
                continue;
            const struct vec3 s =
                vec3_scale(camera_pinhole_ray(&other->photo.camera, u, v), 1.0 / delta);
            nearest = fmin(isnan(nearest) ? (double)INFINITY : nearest, vec3_norm(vec3_sub(s, q)));
        }
    return nearest <= same_m ? nearest : (double)NAN;
}

static int by_value(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Median distance from the samples of a to b where both see the surface; *out_share: how many do.
 */
static double overlay_m(const struct view *a, const struct view *b, double *out_share) {
    const size_t room = (size_t)a->photo.camera.width_px * (size_t)a->photo.camera.height_px;
    double *d = malloc(room * sizeof *d);
    size_t n = 0, seen = 0;
    assert_non_null(d);
    for (size_t k = 0; k < a->tile_count; k++)
        for (int32_t v = 0; v < a->tiles[k].height_px; v++)
            for (int32_t u = 0; u < a->tiles[k].width_px; u++) {
                if (isnan(a->tiles[k].disparity_per_m[v * a->tiles[k].stride_px + u]))
                    continue;
                seen++;
                /* 5 mm: far beyond the noise, so that it does not make the median small */
                const double distance = distance_to(b, tile_point(&a->tiles[k], u, v), 0.005);
                if (!isnan(distance))
                    d[n++] = distance;
            }
    qsort(d, n, sizeof *d, by_value);
    const double median = n ? d[n / 2] : (double)INFINITY;
    *out_share = (double)n / (double)seen;
    free(d);
    return median;
}

static void three_range_images_overlay_within_a_millimetre(void **state) {
    (void)state;
    static const char *const names[SCANS] = {"bunny/bun000.ply", "bunny/bun045.ply",
                                             "bunny/bun315.ply"};
    static struct view views[SCANS];
    char conf[FILEIO_PATH_MAX], path[FILEIO_PATH_MAX];
    if (!real_data_path("bunny/bun.conf", conf))
        skip();
    for (int i = 0; i < SCANS; i++) {
        if (!real_data_path(names[i], path))
            skip();
        load_view(&views[i], path, conf);
    }
    for (int i = 0; i < SCANS; i++)
        for (int k = 0; k < SCANS; k++) {
            double share = 0;
            if (i == k)
                continue;
            const double median_m = overlay_m(&views[i], &views[k], &share);
            print_message("%s to %s: median %.3f mm over %.0f %% of the samples\n", names[i],
                          names[k], 1e3 * median_m, 100.0 * share);
            assert_true(median_m < 1e-3);
            assert_true(share > (i + k == 3 ? 0.1 : 0.4)); /* 045 and 315 are 90 deg apart */
        }
    for (int i = 0; i < SCANS; i++)
        free_view(&views[i]);
}

/* ---- a nodding line laser ---- */

/* Its wall in front, as a line y -> x (the strip is 3 degrees high): distance and scatter. */
static void a_nodding_laser_sees_a_flat_wall(void **state) {
    (void)state;
    char path[FILEIO_PATH_MAX];
    uint8_t *text = NULL;
    size_t size = 0;
    struct scan scan;
    struct errctx err = {0};
    if (!real_data_path("scan-longarm/batchScanned20191114103039.txt", path))
        skip();
    assert_int_equal(fileio_read(path, 1u << 24, &text, &size, &err), ST_OK);
    assert_true(scan_fan_is(text, size));
    if (scan_fan_parse(text, size, &scan, &err))
        fail_msg("%s", err.text);
    assert_int_equal(scan.rows, 41);
    assert_int_equal(scan.columns, 682);
    double a = 2.28, b = 0, rms_m = 0;
    for (int round = 0; round < 10; round++) { /* x = a + b y, outliers beyond 2 cm left out */
        double n = 0, sy = 0, syy = 0, sx = 0, sxy = 0, sum2 = 0;
        for (size_t i = 0; i < scan.count; i++) {
            const struct polar_sample *s = &scan.samples[i];
            const struct vec3 p = vec3_scale(sample_direction(s), (double)s->range_m);
            const double off = p.x - a - b * p.y, limit = round < 3 ? 0.3 : 0.02;
            if (s->flags || fabs(p.y / p.x) > 0.8 || fabs(off) > limit)
                continue;
            n++, sy += p.y, syy += p.y * p.y, sx += p.x, sxy += p.x * p.y, sum2 += off * off;
        }
        assert_true(n > 8000);
        b = (n * sxy - sx * sy) / (n * syy - sy * sy);
        a = (sx - b * sy) / n;
        rms_m = sqrt(sum2 / n);
    }
    const double distance_m = a / sqrt(1 + b * b);
    print_message("wall at %.4f m, rms %.2f mm\n", distance_m, 1e3 * rms_m);
    assert_true(fabs(distance_m - 2.28) < 0.01 && rms_m < 0.009);
    scan_destroy(&scan);
    free(text);
}

/* ---- a spinning laser with a camera ---- */

/* Mean change of grey across the nearer point of each pair of neighbours in a ring that are more
 * than a metre apart in range, with the camera turned by an angle about an axis of its own. */
static double grey_at_edges(const struct scan_job *job, const struct image_u8 *grey, double rad,
                            int axis) {
    const struct vec3 turn = {axis == 0 ? rad : 0, axis == 1 ? rad : 0, axis == 2 ? rad : 0};
    const struct pose cam_from_velo = pose_inverse(&job->frame.station_from_cam);
    const struct mat3 r = so3_exp(turn);
    double sum = 0;
    size_t n = 0;
    for (size_t i = 1; i < job->scan.count; i++) {
        const struct polar_sample *a = &job->scan.samples[i - 1], *b = a + 1;
        struct vec2 px;
        if (a->row != b->row || b->column > a->column + 2 || fabsf(a->range_m - b->range_m) < 1.0f)
            continue;
        const struct vec3 p = sample_point(a->range_m < b->range_m ? a : b);
        if (camera_project(&job->frame.camera, mat3_mulv(&r, pose_apply(&cam_from_velo, p)), &px,
                           NULL))
            continue;
        const int32_t u = (int32_t)lround(px.x), v = (int32_t)lround(px.y);
        if (u < 2 || v < 0 || u >= grey->width_px - 2 || v >= grey->height_px)
            continue;
        sum += abs(*image_u8_at(grey, u + 2, v) - *image_u8_at(grey, u - 2, v));
        n++;
    }
    assert_true(n > 1000);
    return sum / (double)n;
}

static void a_spinning_laser_has_64_rings_and_its_edges_lie_on_the_cameras(void **state) {
    (void)state;
    struct scan_job job = scan_job_default();
    struct image_u8 grey;
    struct errctx err = {0};
    char path[FILEIO_PATH_MAX];
    double sum_rad[64] = {0}, count[64] = {0};
    if (!real_data_path("kitti-000000", job.path))
        skip();
    if (scan_job_prepare(&job, &err))
        fail_msg("%s", err.text);
    assert_string_equal(job.name, "kitti-000000");
    assert_int_equal(job.scan.count, 115384);
    assert_int_equal(job.scan.rows, 64);
    for (size_t i = 0; i < job.scan.count; i++) {
        sum_rad[job.scan.samples[i].row] += job.scan.samples[i].elevation_rad;
        count[job.scan.samples[i].row]++;
    }
    for (int row = 1; row < 64; row++) /* from the highest laser to the lowest */
        assert_true(sum_rad[row] / count[row] < sum_rad[row - 1] / count[row - 1]);
    assert_non_null(job.frame.image.bytes);
    assert_true(real_data_path("kitti-000000/image.png", path));
    assert_int_equal(picture_read_grey(path, &grey, &err), ST_OK);
    const double given = grey_at_edges(&job, &grey, 0, 0);
    for (int axis = 0; axis < 3; axis++) {
        const double less = grey_at_edges(&job, &grey, -0.02, axis);
        const double more = grey_at_edges(&job, &grey, 0.02, axis);
        print_message("grey across edges in range: %.2f as calibrated, %.2f and %.2f turned by "
                      "0.02 rad about %c\n",
                      given, less, more, "xyz"[axis]);
        assert_true(given > less && given > more);
    }
    image_u8_destroy(&grey);
    scan_job_fini(&job);
}

int main(void) {
    char path[FILEIO_PATH_MAX];
    if (!real_data_path("scans-3dtk/scan000.3d", path) && !real_data_path("bunny/bun.conf", path) &&
        !real_data_path("kitti-000000", path))
        return REAL_DATA_SKIP;
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_stand_is_226_rows_of_360_to_a_tenth_of_a_millimetre),
        cmocka_unit_test(three_range_images_overlay_within_a_millimetre),
        cmocka_unit_test(a_nodding_laser_sees_a_flat_wall),
        cmocka_unit_test(a_spinning_laser_has_64_rings_and_its_edges_lie_on_the_cameras),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
