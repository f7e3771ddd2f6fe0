#include "site/frame_row.h"

#include <stdlib.h>

#include "site/batch.h"
#include "site/files.h"
#include "site/store.h"

#include <math.h>

/* A side of a frame or photograph, px. */
enum { SIDE_MAX_PX = 65536 };

/* Columns: id station_id t_ns sha256 width height exposure gain pan tilt calib meta. */
static enum st read_row(sqlite3_stmt *stmt, struct frame_row *out_row, struct errctx *err) {
    struct frame_row row = {.id = sqlite3_column_int64(stmt, 0),
                            .station_id = sqlite3_column_int64(stmt, 1),
                            .t_ns = sqlite3_column_int64(stmt, 2),
                            .exposure_s = row_get_real(stmt, 6),
                            .gain = row_get_real(stmt, 7),
                            .pan_rad = row_get_real(stmt, 8),
                            .tilt_rad = row_get_real(stmt, 9),
                            .camera_calib_id = sqlite3_column_int64(stmt, 10)};
    enum st st = row_get_blob(stmt, 3, row.sha256, sizeof row.sha256, err);
    if (!st)
        st = row_get_int32(stmt, 4, &row.width_px, err);
    if (!st)
        st = row_get_int32(stmt, 5, &row.height_px, err);
    if (!st)
        st = row_get_text(stmt, 11, row.meta, sizeof row.meta, err);
    if (!st)
        *out_row = row;
    return st;
}

static enum st check_row(const struct frame_row *row, struct errctx *err) {
    if (row->width_px < 1 || row->width_px > SIDE_MAX_PX || row->height_px < 1 ||
        row->height_px > SIDE_MAX_PX)
        return errctx_set(err, ST_INVALID, "a frame of %d x %d px", (int)row->width_px,
                          (int)row->height_px);
    if (isinf(row->exposure_s) || isinf(row->gain) || isinf(row->pan_rad) || isinf(row->tilt_rad))
        return errctx_set(err, ST_INVALID, "a frame with an infinite exposure, gain or angle");
    return row_check_json(row->meta, "remark of a frame", err);
}

static enum st check_refers(struct site *site, const struct frame_row *row, struct errctx *err) {
    struct files_entry file;
    enum st st = store_require(site, STORE_STATION, row->station_id, err);
    if (!st)
        st = files_find(site, row->sha256, &file, err);
    if (!st && row->camera_calib_id)
        st = store_require(site, STORE_CALIB, row->camera_calib_id, err);
    return st;
}

enum st frame_row_add(struct site *site, const struct frame_row *row, int64_t *out_id,
                      struct errctx *err) {
    int64_t id = 0;
    enum st st = check_row(row, err);
    if (!st)
        st = batch_begin(site, err);
    if (st)
        return st;
    st = check_refers(site, row, err);
    struct row_value values[] = {row_int(0),
                                 row_int(row->station_id),
                                 row_int(row->t_ns),
                                 row_blob(row->sha256, sizeof row->sha256),
                                 row_int(row->width_px),
                                 row_int(row->height_px),
                                 row_real(row->exposure_s),
                                 row_real(row->gain),
                                 row_real(row->pan_rad),
                                 row_real(row->tilt_rad),
                                 row_id(row->camera_calib_id),
                                 row_text(row->meta)};
    if (!st)
        st = store_insert(site, STORE_FRAME, values, 12, NULL, &id, err);
    st = batch_end(site, st, err);
    if (!st)
        *out_id = id;
    return st;
}

enum st frame_row_get(struct site *site, int64_t id, struct frame_row *out_row,
                      struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    enum st st = store_fetch_id(site, STORE_FRAME, id, &stmt, err);
    if (st)
        return st;
    st = read_row(stmt, out_row, err);
    (void)sqlite3_reset(stmt);
    return st;
}

static enum st list_read_row(struct site *site, sqlite3_stmt *stmt, void *out_row,
                             struct errctx *err) {
    (void)site;
    return read_row(stmt, out_row, err);
}

enum st frame_row_list(struct site *site, int64_t station_id, int64_t after_id,
                       struct frame_row *out_rows, size_t capacity, size_t *out_count,
                       struct errctx *err) {
    const int64_t numbers[2] = {after_id, station_id};
    const char *sql = station_id
                          ? "SELECT * FROM frame WHERE station_id = ?2 AND id > ?1 ORDER BY id"
                          : "SELECT * FROM frame WHERE id > ?1 ORDER BY id";
    return store_list(site, sql, numbers, station_id ? 2 : 1, STORE_FRAME, list_read_row, out_rows,
                      sizeof *out_rows, capacity, out_count, err);
}

enum st frame_row_each(struct site *site, int64_t station_id,
                       enum st (*visit)(void *ctx, const struct frame_row *row, struct errctx *err),
                       void *ctx, struct errctx *err) {
    enum { PAGE = 16 };
    struct frame_row *page = calloc(PAGE, sizeof *page); /* too large for the stack */
    if (!page)
        return errctx_set(err, ST_NOMEM, "no memory for the list of photographs");
    size_t count = PAGE;
    int64_t after = 0;
    enum st st = ST_OK;
    while (!st && count == PAGE) {
        st = frame_row_list(site, station_id, after, page, PAGE, &count, err);
        for (size_t i = 0; i < count && !st; i++) {
            after = page[i].id;
            st = visit(ctx, &page[i], err);
        }
    }
    free(page);
    return st;
}
