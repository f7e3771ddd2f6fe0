/* Real data that no importer reads, to photographs to look at: a turned laser's raw log, and a
 * spinning laser's points with a camera's picture. */
#include "base/fileio.h"
#include "base/picture.h"
#include "bench_fusion.h"
#include "fusion/face.h"
#include "fusion/frame.h"
#include "fusion/shade.h"
#include "raster/skin.h"
#include "site/photo_tiff.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void save(const struct photo *photo, const char *out, const char *what) {
    char path[FILEIO_PATH_MAX];
    struct errctx err;
    int32_t w = photo->camera.width_px, h = photo->camera.height_px, first = w, last = -1;
    struct image_u8 picture;
    for (int32_t i = 0; i < w * h; i++) /* columns that hold anything */
        if (photo->disparity_per_m[i] > 0) {
            first = i % w < first ? i % w : first;
            last = i % w > last ? i % w : last;
        }
    int32_t wide = last >= first ? last - first + 1 : 1;
    bool beside = wide < h; /* depths below the colours, or beside a narrow strip */
    bench_check(image_u8_create(&picture, beside ? 2 * wide : wide, beside ? h : 2 * h, 3), NULL);
    for (int32_t y = 0; y < h; y++)
        for (int32_t x = 0; x < wide && last >= first; x++) {
            size_t i = (size_t)y * (size_t)w + (size_t)(x + first);
            memcpy(image_u8_at(&picture, x, y), photo->rgb + 3 * i, 3);
            double d = (double)photo->disparity_per_m[i];
            uint8_t *below = image_u8_at(&picture, beside ? x + wide : x, beside ? y : y + h);
            if (!(d > 0))
                continue;
            double t = fmin(fmax(log2(4.0 / d) / 8.0, 0.0), 1.0); /* 0.25 to 64 m */
            below[0] = (uint8_t)(255 * (1 - t));
            below[1] = (uint8_t)(255 * (0.5 + 0.5 * sin(40 * t)));
            below[2] = (uint8_t)(255 * t);
        }
    (void)snprintf(path, sizeof path, "%s%s.png", out, what);
    bench_check(picture_write_png(path, &picture, &err), &err);
    image_u8_destroy(&picture);
    (void)snprintf(path, sizeof path, "%s%s.tif", out, what);
    struct photo_tiff_info info = {.length_unit = "m"};
    (void)snprintf(info.name, sizeof info.name, "%s", what);
    bench_check(photo_tiff_write(path, photo, &info, &err), &err);
}

static struct photo resolve(struct layer_image *image, int colour) {
    struct resolve_params rp = resolve_params_default();
    struct resolve_counts counts;
    struct photo photo;
    struct errctx err;
    bench_check(photo_create(&image->camera, &photo, &err), &err);
    bench_check(resolve_photo(image, &rp, colour, &photo, &counts, &err), &err);
    struct skin_params skins = skin_params_default();
    (void)skin_mark(&photo, &skins);
    (void)fprintf(
        stderr, "  %d x %d px: %lld surface, %lld no return, %lld dropped, %lld never looked at\n",
        photo.camera.width_px, photo.camera.height_px, (long long)counts.valid,
        (long long)counts.no_return, (long long)counts.dropped, (long long)counts.unseen);
    return photo;
}

/* ---- a line laser turned by a motor: row 1 bearings from column 4 on; then line, ms, degrees,
 * ranges ---- */

enum { LONGARM_BEARINGS = 4096 };

static size_t numbers(char *line, double *out, size_t room) {
    size_t n = 0;
    for (char *at = strtok(line, ", \t\r\n"); at && n < room; at = strtok(NULL, ", \t\r\n"))
        out[n++] = atof(at);
    return n;
}

static int longarm(const char *path, const char *out) {
    static const double rad = 0.017453292519943295;
    uint8_t *text = NULL;
    size_t size = 0, count = 0;
    struct errctx err;
    bench_check(fileio_read(path, 64u << 20, &text, &size, &err), &err);
    struct scatter_sample *samples = malloc((size / 2 + 1) * sizeof *samples);
    double *bearing = malloc(LONGARM_BEARINGS * sizeof *bearing),
           *row = malloc(LONGARM_BEARINGS * sizeof *row);
    size_t bearings = 0;
    if (!samples || !bearing || !row)
        return 1;
    for (char *line = (char *)text, *end; line && *line; line = end) {
        end = strchr(line, '\n');
        if (end)
            *end++ = 0;
        if (!bearings) {
            bearings = numbers(line, bearing, LONGARM_BEARINGS);
            continue;
        }
        size_t n = numbers(line, row, LONGARM_BEARINGS);
        double turn = n > 2 ? row[2] * rad : 0;
        for (size_t i = 3; i < n && i < bearings; i++) {
            /* The laser's plane turns about its own zero bearing; z of the station is that axis. */
            double b = bearing[i] * rad, r = row[i];
            struct vec3 d = {sin(b) * cos(turn), sin(b) * sin(turn), cos(b)};
            struct scatter_sample *s = &samples[count++];
            memset(s, 0, sizeof *s);
            s->flags = (uint8_t)(r > 0 ? 0 : SAMPLE_NO_RETURN);
            d = vec3_scale(d, r > 0 ? r : 1.0);
            s->p_m[0] = (float)d.x, s->p_m[1] = (float)d.y, s->p_m[2] = (float)d.z;
            s->sigma_m = 0.0034f;
        }
    }
    struct scatter_array array;
    struct scatter_source source = scatter_source_array(&array, samples, count);
    struct face_survey survey;
    bench_check(face_survey_source(&source, &survey, &err), &err);
    (void)fprintf(stderr, "longarm: %zu samples, %.1f mrad apart\n", count,
                  1e3 * survey.spacing_rad);
    for (int face = 0; face < FACE_COUNT; face++) {
        if (!survey.seen[face])
            continue;
        struct camera camera = face_camera(face_size_px(0.5 * survey.spacing_rad, 1024));
        struct pose pose = face_station_from_cam(face);
        struct layer_params lp = layer_params_default();
        struct layer_image image;
        lp.splat_px = fmin(6.0 * survey.spacing_rad * camera.fx_px, 16.0); /* lines are far apart */
        bench_check(layer_create(&camera, &pose, &lp, &image, &err), &err);
        bench_check(layer_add_source(&image, &source, &err), &err);
        struct photo photo = resolve(&image, 0);
        struct mat3 identity = mat3_identity();
        shade_photo(&photo, &identity);
        save(&photo, out, face_name(face));
        photo_destroy(&photo);
        layer_destroy(&image);
    }
    free(text);
    free(samples);
    free(bearing);
    free(row);
    return 0;
}

/* ---- KITTI: velodyne.bin, image.png, calib.txt ---- */

/* A line "NAME: a b c ..." of a calibration file. */
static bool calib_row(const char *text, const char *name, double *out, size_t count) {
    const char *at = strstr(text, name);
    if (!at)
        return false;
    at += strlen(name);
    for (size_t i = 0; i < count; i++) {
        char *end;
        out[i] = strtod(at, &end);
        if (end == at)
            return false;
        at = end;
    }
    return true;
}

static enum st find_file(const char *dir, const char *const *names, char out[FILEIO_PATH_MAX]) {
    struct errctx err;
    for (; *names; names++)
        if (!fileio_join(dir, *names, out, &err) && fileio_exists(out))
            return ST_OK;
    return ST_NOT_FOUND;
}

static int kitti(const char *dir, const char *out) {
    static const char *const points[] = {"velodyne.bin", "000000.bin", "points.bin", NULL};
    static const char *const pictures[] = {"image_2.png", "000000.png", "image.png", NULL};
    static const char *const calibs[] = {"calib.txt", "000000.txt", NULL};
    char path[FILEIO_PATH_MAX];
    uint8_t *calib = NULL, *bin = NULL;
    size_t size = 0;
    struct image_u8 frame;
    struct errctx err;
    double p2[12], tr[12], r0[9];
    if (find_file(dir, calibs, path))
        return 77;
    bench_check(fileio_read(path, 1u << 20, &calib, &size, &err), &err);
    if (!calib_row((char *)calib, "P2:", p2, 12) || !calib_row((char *)calib, "R0_rect:", r0, 9) ||
        !calib_row((char *)calib, "Tr_velo_to_cam:", tr, 12))
        return 1;
    if (find_file(dir, pictures, path))
        return 77;
    bench_check(picture_read_rgb(path, &frame, &err), &err);
    if (find_file(dir, points, path))
        return 77;
    bench_check(fileio_read(path, 64u << 20, &bin, &size, &err), &err);
    struct camera camera = {.width_px = frame.width_px,
                            .height_px = frame.height_px,
                            .fx_px = p2[0],
                            .fy_px = p2[5],
                            .cx_px = p2[2],
                            .cy_px = p2[6]};
    /* cam = R0 (Tr velo) + (K^-1 of P2's last column) */
    struct pose rect = {{{r0[0], r0[1], r0[2], r0[3], r0[4], r0[5], r0[6], r0[7], r0[8]}},
                        {p2[3] / p2[0], (p2[7] - p2[11] * p2[6]) / p2[5], p2[11]}};
    struct pose velo = {{{tr[0], tr[1], tr[2], tr[4], tr[5], tr[6], tr[8], tr[9], tr[10]}},
                        {tr[3], tr[7], tr[11]}};
    struct pose cam_from_velo = pose_compose(&rect, &velo),
                velo_from_cam = pose_inverse(&cam_from_velo);
    size_t count = size / 16;
    struct scatter_sample *samples = calloc(count, sizeof *samples);
    if (!samples)
        return 1;
    for (size_t i = 0; i < count; i++) {
        float v[4];
        memcpy(v, bin + 16 * i, sizeof v);
        memcpy(samples[i].p_m, v, 3 * sizeof *v);
        samples[i].sigma_m = 0.02f;
    }
    struct layer_params lp = layer_params_default();
    struct layer_image image;
    lp.splat_px = 6.0; /* lines are 0.4 degrees apart: 5 px */
    lp.grazing_rad = 1.48;
    bench_check(layer_create(&camera, &velo_from_cam, &lp, &image, &err), &err);
    bench_check(layer_add(&image, samples, count), NULL);
    (void)fprintf(stderr, "kitti: %zu points\n", count);
    struct photo photo = resolve(&image, 0);
    bench_check(frame_undistort(&frame, &camera, &photo, NULL, &err), &err);
    save(&photo, out, "kitti");
    photo_destroy(&photo);
    layer_destroy(&image);
    image_u8_destroy(&frame);
    free(samples);
    free(calib);
    free(bin);
    return 0;
}

int bench_real(const char *kind, const char *path, const char *out) {
    return !strcmp(kind, "longarm") ? longarm(path, out)
           : !strcmp(kind, "kitti") ? kitti(path, out)
                                    : 2;
}
