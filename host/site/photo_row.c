#include "site/photo_row.h"

#include "base/image.h"
#include "site/batch.h"
#include "site/custody_log.h"
#include "site/files.h"
#include "site/store.h"

/* Columns: id station_id name sha256 width height pose frame_id job_id utc_ns. */
static enum st read_row(sqlite3_stmt *stmt, struct photo_row *out_row, struct errctx *err) {
    struct photo_row row = {.id = sqlite3_column_int64(stmt, 0),
                            .station_id = sqlite3_column_int64(stmt, 1),
                            .frame_id = sqlite3_column_int64(stmt, 7),
                            .job_id = sqlite3_column_int64(stmt, 8),
                            .utc_ns = sqlite3_column_int64(stmt, 9)};
    enum st st = row_get_text(stmt, 2, row.name, sizeof row.name, err);
    if (!st)
        st = row_get_blob(stmt, 3, row.sha256, sizeof row.sha256, err);
    if (!st)
        st = row_get_int32(stmt, 4, &row.width_px, err);
    if (!st)
        st = row_get_int32(stmt, 5, &row.height_px, err);
    if (!st)
        st = row_get_pose(stmt, 6, &row.station_from_cam, err);
    if (!st)
        *out_row = row;
    return st;
}

static enum st check_row(const struct photo_row *row, struct errctx *err) {
    if (!site_name_is_valid(row->name))
        return errctx_set(err, ST_INVALID, "'%.80s' cannot be the name of a photograph", row->name);
    if (row->width_px < 1 || row->width_px > IMAGE_MAX_SIDE_PX || row->height_px < 1 ||
        row->height_px > IMAGE_MAX_SIDE_PX)
        return errctx_set(err, ST_INVALID, "a photograph of %d x %d px", (int)row->width_px,
                          (int)row->height_px);
    return row_check_pose(&row->station_from_cam, err);
}

static enum st check_refers(struct site *site, const struct photo_row *row, struct errctx *err) {
    struct files_entry file;
    enum st st = store_require(site, STORE_STATION, row->station_id, err);
    if (!st)
        st = files_find(site, row->sha256, &file, err);
    if (!st && row->frame_id)
        st = store_require(site, STORE_FRAME, row->frame_id, err);
    if (!st && row->job_id)
        st = store_require(site, STORE_JOB, row->job_id, err);
    return st;
}

/* Removes a row within a batch, with its event. */
static enum st take_out(struct site *site, const struct photo_row *row, struct errctx *err) {
    char hex[HASH_HEX_CHARS];
    hash_to_hex(row->sha256, hex);
    enum st st = store_remove(site, STORE_PHOTO, row->id, err);
    return st ? st
              : custody_logf(site, err, "photo.removed",
                             "{\"station\":%lld,\"photo\":%lld,\"sha256\":\"%s\"}",
                             (long long)row->station_id, (long long)row->id, hex);
}

/* ST_NOT_FOUND without a message. */
static enum st find_row(struct site *site, int64_t station_id, const char *name,
                        struct photo_row *out_row, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    struct row_value value = row_text(name);
    enum st st = station_id
                     ? store_query(site, "SELECT * FROM photo WHERE station_id = ?1 AND name = ?2",
                                   &station_id, 1, &stmt, err)
                     : store_query(site, "SELECT * FROM photo WHERE name = ?2 ORDER BY id LIMIT 1",
                                   NULL, 0, &stmt, err);
    if (!st)
        st = row_bind(stmt, 2, &value);
    if (!st)
        st = store_fetch(site, stmt, STORE_PHOTO, err);
    if (st)
        return st;
    st = read_row(stmt, out_row, err);
    (void)sqlite3_reset(stmt);
    return st;
}

enum st photo_row_put(struct site *site, const struct photo_row *row, int64_t *out_id,
                      struct errctx *err) {
    int64_t id = 0;
    uint8_t pose[ROW_POSE_BYTES];
    row_put_pose(pose, &row->station_from_cam);
    enum st st = check_row(row, err);
    if (!st)
        st = batch_begin(site, err);
    if (st)
        return st;
    st = check_refers(site, row, err);
    struct photo_row old;
    if (!st) {
        st = find_row(site, row->station_id, row->name, &old, err);
        st = st == ST_NOT_FOUND ? ST_OK : st ? st : take_out(site, &old, err);
    }
    struct row_value values[] = {row_int(0),
                                 row_int(row->station_id),
                                 row_text(row->name),
                                 row_blob(row->sha256, sizeof row->sha256),
                                 row_int(row->width_px),
                                 row_int(row->height_px),
                                 row_blob(pose, sizeof pose),
                                 row_id(row->frame_id),
                                 row_id(row->job_id),
                                 row_int(store_now_utc_ns(site))};
    if (!st)
        st = store_insert(site, STORE_PHOTO, values, 10, NULL, &id, err);
    st = batch_end(site, st, err);
    if (!st)
        *out_id = id;
    return st;
}

enum st photo_row_get(struct site *site, int64_t id, struct photo_row *out_row,
                      struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    enum st st = store_fetch_id(site, STORE_PHOTO, id, &stmt, err);
    if (st)
        return st;
    st = read_row(stmt, out_row, err);
    (void)sqlite3_reset(stmt);
    return st;
}

enum st photo_row_find(struct site *site, int64_t station_id, const char *name,
                       struct photo_row *out_row, struct errctx *err) {
    enum st st = find_row(site, station_id, name, out_row, err);
    return st == ST_NOT_FOUND
               ? errctx_set(err, st, "%s has no photograph '%.80s'", site->path, name)
               : st;
}

enum st photo_row_remove(struct site *site, int64_t id, struct errctx *err) {
    struct photo_row row;
    enum st st = batch_begin(site, err);
    if (st)
        return st;
    st = photo_row_get(site, id, &row, err);
    if (!st)
        st = take_out(site, &row, err);
    return batch_end(site, st, err);
}

static enum st list_read_row(struct site *site, sqlite3_stmt *stmt, void *out_row,
                             struct errctx *err) {
    (void)site;
    return read_row(stmt, out_row, err);
}

enum st photo_row_list(struct site *site, int64_t station_id, int64_t after_id,
                       struct photo_row *out_rows, size_t capacity, size_t *out_count,
                       struct errctx *err) {
    const int64_t numbers[2] = {after_id, station_id};
    return store_list(
        site, "SELECT * FROM photo WHERE id > ?1 AND (?2 = 0 OR station_id = ?2) ORDER BY id",
        numbers, 2, STORE_PHOTO, list_read_row, out_rows, sizeof *out_rows, capacity, out_count,
        err);
}
