#include "import/kitti_calib.h"

#include "import/number_text.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

enum { P2, R0, TR, LINES, MOST_NUMBERS = 12 };

static const struct {
    const char *key;
    int count;
} lines[LINES] = {{"P2:", 12}, {"R0_rect:", 9}, {"Tr_velo_to_cam:", 12}};

static const double rotation_tolerance = 1e-3; /* of files that give three digits */
static const double pinhole_tolerance = 1e-6;  /* of P2's zeroes and its one */

struct table {
    double number[LINES][MOST_NUMBERS];
    bool found[LINES];
};

static enum st read_line(struct number_text *text, int which, struct table *table,
                         struct errctx *err) {
    if (table->found[which])
        return errctx_set(err, ST_FORMAT, "line %zu: %s was there before", text->line,
                          lines[which].key);
    for (int i = 0; i < lines[which].count; i++)
        if (number_text_at_line_end(text) || !number_text_double(text, &table->number[which][i]))
            return errctx_set(err, ST_FORMAT, "line %zu: %s needs %d numbers, number %d is none",
                              text->line, lines[which].key, lines[which].count, i + 1);
    if (!number_text_at_line_end(text))
        return errctx_set(err, ST_FORMAT, "line %zu: %s has more than %d numbers", text->line,
                          lines[which].key, lines[which].count);
    table->found[which] = true;
    return ST_OK;
}

static enum st read_table(const void *data, size_t size, struct table *table, struct errctx *err) {
    struct number_text text = number_text_start(data, size);
    char word[32];
    memset(table, 0, sizeof *table);
    while (!number_text_at_end(&text)) {
        enum st st = ST_OK;
        if (number_text_word(&text, word, sizeof word))
            for (int k = 0; k < LINES && !st; k++)
                if (!strcmp(word, lines[k].key))
                    st = read_line(&text, k, table, err);
        if (st)
            return st;
        number_text_next_line(&text);
    }
    for (int k = 0; k < LINES; k++)
        if (!table->found[k])
            return errctx_set(err, ST_FORMAT, "there is no line %s", lines[k].key);
    return ST_OK;
}

/* Row-major, `stride` numbers a row; made exact. */
static enum st rotation(const double *m, int stride, const char *key, struct mat3 *out_r,
                        struct errctx *err) {
    struct mat3 r;
    for (int i = 0; i < 9; i++)
        r.m[i] = m[i / 3 * stride + i % 3];
    if (!(pose_orthonormality_error(&r) < rotation_tolerance) || pose_orthonormalise(&r, out_r))
        return errctx_set(err, ST_FORMAT, "%s is no rotation", key);
    return ST_OK;
}

static enum st pinhole(const double *p, int32_t width_px, int32_t height_px,
                       struct camera *out_camera, struct errctx *err) {
    const double none = fabs(p[1]) + fabs(p[4]) + fabs(p[8]) + fabs(p[9]) + fabs(p[10] - 1);
    if (!(none < pinhole_tolerance) || !(p[0] > 0) || !(p[5] > 0))
        return errctx_set(err, ST_FORMAT, "P2: is no pinhole with square axes");
    const struct camera camera = {.width_px = width_px,
                                  .height_px = height_px,
                                  .fx_px = p[0],
                                  .fy_px = p[5],
                                  .cx_px = p[2],
                                  .cy_px = p[6]};
    if (fabs(p[2] / width_px - 0.5) > 0.25 || fabs(p[6] / height_px - 0.5) > 0.25)
        return errctx_set(err, ST_INVALID,
                          "the image is not the one that was calibrated: the principal point of "
                          "P2, (%.1f, %.1f), is not in the middle half of %d x %d px",
                          p[2], p[6], width_px, height_px);
    const enum st st = camera_check(&camera, err);
    if (!st)
        *out_camera = camera;
    return st;
}

enum st kitti_calib_parse(const void *data, size_t size, int32_t width_px, int32_t height_px,
                          struct camera *out_camera, struct pose *out_velo_from_cam,
                          struct errctx *err) {
    struct table table;
    struct camera c;
    struct pose cam_from_ref, ref_from_velo;
    enum st st = read_table(data, size, &table, err);
    const double *p = table.number[P2], *tr = table.number[TR];
    if (st || (st = rotation(table.number[R0], 3, lines[R0].key, &cam_from_ref.r, err)) ||
        (st = rotation(tr, 4, lines[TR].key, &ref_from_velo.r, err)) ||
        (st = pinhole(p, width_px, height_px, &c, err)))
        return st;
    /* K t is P2's last column */
    cam_from_ref.t_m =
        vec3_make((p[3] - c.cx_px * p[11]) / c.fx_px, (p[7] - c.cy_px * p[11]) / c.fy_px, p[11]);
    ref_from_velo.t_m = vec3_make(tr[3], tr[7], tr[11]);
    const struct pose cam_from_velo = pose_compose(&cam_from_ref, &ref_from_velo);
    *out_camera = c;
    *out_velo_from_cam = pose_inverse(&cam_from_velo);
    return ST_OK;
}
