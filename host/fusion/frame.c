#include "fusion/frame.h"

#include <math.h>
#include <string.h>

struct camera frame_pinhole(const struct camera *camera, int32_t width_px, int32_t height_px) {
    if (width_px <= 0 || height_px <= 0) {
        width_px = camera->width_px;
        height_px = camera->height_px;
    }
    double sx = (double)width_px / camera->width_px, sy = (double)height_px / camera->height_px;
    struct camera pinhole = {.width_px = width_px,
                             .height_px = height_px,
                             .fx_px = camera->fx_px * sx,
                             .fy_px = camera->fy_px * sy,
                             /* the image covers -0.5 .. width - 0.5 before and after */
                             .cx_px = (camera->cx_px + 0.5) * sx - 0.5,
                             .cy_px = (camera->cy_px + 0.5) * sy - 0.5};
    return pinhole;
}

/* Bilinear look-up; false outside the frame. */
static bool sample(const struct image_u8 *frame, double x, double y, double out_rgb[3]) {
    if (!(x >= -0.5 && y >= -0.5 && x <= frame->width_px - 0.5 && y <= frame->height_px - 0.5))
        return false;
    x = fmin(fmax(x, 0.0), frame->width_px - 1.0);
    y = fmin(fmax(y, 0.0), frame->height_px - 1.0);
    int32_t x0 = (int32_t)x, y0 = (int32_t)y;
    int32_t x1 = x0 + 1 < frame->width_px ? x0 + 1 : x0;
    int32_t y1 = y0 + 1 < frame->height_px ? y0 + 1 : y0;
    double a = x - x0, b = y - y0;
    for (int c = 0; c < 3; c++) {
        int k = frame->channels == 3 ? c : 0;
        double top = (1 - a) * image_u8_at(frame, x0, y0)[k] + a * image_u8_at(frame, x1, y0)[k];
        double low = (1 - a) * image_u8_at(frame, x0, y1)[k] + a * image_u8_at(frame, x1, y1)[k];
        out_rgb[c] = (1 - b) * top + b * low;
    }
    return true;
}

/* One pixel of the photograph: the mean of steps x steps looks at the frame. */
static bool pixel(const struct image_u8 *frame, const struct camera *camera,
                  const struct camera *pinhole, int32_t x, int32_t y, int steps,
                  uint8_t out_rgb[3]) {
    double sum[3] = {0};
    int hits = 0;
    for (int j = 0; j < steps; j++)
        for (int i = 0; i < steps; i++) {
            struct vec3 ray = camera_pinhole_ray(pinhole, x - 0.5 + (i + 0.5) / steps,
                                                 y - 0.5 + (j + 0.5) / steps);
            struct vec2 q;
            double rgb[3];
            if (camera_project(camera, ray, &q, NULL) || !sample(frame, q.x, q.y, rgb))
                continue;
            for (int c = 0; c < 3; c++)
                sum[c] += rgb[c];
            hits++;
        }
    for (int c = 0; c < 3; c++)
        out_rgb[c] = (uint8_t)(hits ? lrint(sum[c] / hits) : 0);
    return hits > 0;
}

enum st frame_undistort(const struct image_u8 *frame, const struct camera *camera,
                        struct photo *photo, int64_t *out_unseen, struct errctx *err) {
    if (frame->width_px != camera->width_px || frame->height_px != camera->height_px ||
        (frame->channels != 3 && frame->channels != 1))
        return errctx_set(
            err, ST_INVALID,
            "a frame of %d x %d px with %d channels is not from a camera of %d x %d px",
            frame->width_px, frame->height_px, frame->channels, camera->width_px,
            camera->height_px);
    double coarser = fmax(camera->fx_px / photo->camera.fx_px, camera->fy_px / photo->camera.fy_px);
    int steps = coarser > 1.01 ? (int)fmin(8.0, ceil(coarser)) : 1;
    int64_t unseen = 0;
    int32_t width = photo->camera.width_px, height = photo->camera.height_px;
#pragma omp parallel for schedule(dynamic, 16) reduction(+ : unseen)
    for (int32_t y = 0; y < height; y++)
        for (int32_t x = 0; x < width; x++) {
            uint8_t *rgb = photo->rgb + 3 * ((size_t)y * (size_t)width + (size_t)x);
            if (!pixel(frame, camera, &photo->camera, x, y, steps, rgb))
                unseen++;
        }
    if (out_unseen)
        *out_unseen = unseen;
    return ST_OK;
}
