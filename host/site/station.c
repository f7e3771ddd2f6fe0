#include "site/station.h"

#include "site/batch.h"
#include "site/custody_log.h"
#include "site/store.h"

#include <math.h>
#include <string.h>

static enum st check_pose(const struct station_pose *pose, struct errctx *err) {
    enum st st = row_check_pose(&pose->world_from_station, err);
    if (!st && !site_name_is_valid(pose->source))
        st = errctx_set(err, ST_INVALID, "the pose's source '%.60s' is no name", pose->source);
    if (st || !pose->has_covariance)
        return st;
    const double *c = pose->covariance;
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            double a = c[6 * i + j], b = c[6 * j + i];
            double tolerance = 1e-9 * (fabs(a) + fabs(b)); /* rounding of a product J C J^T */
            if (!isfinite(a) || fabs(a - b) > tolerance || (i == j && a < 0))
                return errctx_set(err, ST_INVALID,
                                  "the pose's covariance is not a covariance at (%d, %d)", i, j);
        }
    return ST_OK;
}

static enum st insert_pose(struct site *site, int64_t id, const struct station_pose *pose,
                           struct errctx *err) {
    uint8_t pose_bytes[ROW_POSE_BYTES], covariance[36 * 8];
    row_put_pose(pose_bytes, &pose->world_from_station);
    row_put_doubles(covariance, pose->covariance, 36);
    struct row_value values[] = {row_int(0),
                                 row_int(id),
                                 row_blob(pose_bytes, sizeof pose_bytes),
                                 pose->has_covariance ? row_blob(covariance, sizeof covariance)
                                                      : row_null(),
                                 row_text(pose->source),
                                 row_int(store_now_utc_ns(site))};
    return store_insert(site, STORE_STATION_POSE, values, 6, NULL, NULL, err);
}

static enum st read_pose(sqlite3_stmt *stmt, struct station_pose *out_pose, struct errctx *err) {
    struct station_pose pose = {.utc_ns = sqlite3_column_int64(stmt, 5)};
    enum st st = row_get_pose(stmt, 2, &pose.world_from_station, err);
    pose.has_covariance = sqlite3_column_type(stmt, 3) != SQLITE_NULL;
    if (!st && pose.has_covariance)
        st = row_get_doubles(stmt, 3, pose.covariance, 36, err);
    if (!st)
        st = row_get_text(stmt, 4, pose.source, sizeof pose.source, err);
    if (!st)
        *out_pose = pose;
    return st;
}

/* 1 in *out_taken if a station has that name. */
static enum st name_taken(struct site *site, const char *name, bool *out_taken,
                          struct errctx *err) {
    struct station station;
    enum st st = station_find(site, name, &station, err);
    *out_taken = st == ST_OK;
    return st == ST_NOT_FOUND ? ST_OK : st;
}

enum st station_add(struct site *site, const char *name, const char *remark_json,
                    const struct station_pose *pose, int64_t *out_id, struct errctx *err) {
    if (!site_name_is_valid(name))
        return errctx_set(err, ST_INVALID, "'%.80s' cannot be the name of a station", name);
    enum st st = row_check_json(remark_json, "remark of a station", err);
    if (!st)
        st = check_pose(pose, err);
    if (!st)
        st = batch_begin(site, err);
    if (st)
        return st;
    bool taken = false;
    int64_t id = 0;
    st = name_taken(site, name, &taken, err);
    if (!st && taken)
        st = errctx_set(err, ST_EXISTS, "%s has a station '%s' already", site->path, name);
    struct row_value values[] = {row_int(0), row_text(name),
                                 row_text(remark_json ? remark_json : ""),
                                 row_int(store_now_utc_ns(site))};
    if (!st)
        st = store_insert(site, STORE_STATION, values, 4, NULL, &id, err);
    if (!st)
        st = insert_pose(site, id, pose, err);
    st = batch_end(site, st, err);
    if (!st)
        *out_id = id;
    return st;
}

enum st station_add_pose(struct site *site, int64_t id, const struct station_pose *pose,
                         struct errctx *err) {
    enum st st = check_pose(pose, err);
    if (!st)
        st = batch_begin(site, err);
    if (st)
        return st;
    st = store_require(site, STORE_STATION, id, err);
    if (!st)
        st = insert_pose(site, id, pose, err);
    if (!st)
        st = custody_logf(site, err, "pose", "{\"station\":%lld}", (long long)id);
    return batch_end(site, st, err);
}

static enum st count_poses(struct site *site, int64_t id, int32_t *out_count, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    enum st st = store_query(site, "SELECT count(*) FROM station_pose WHERE station_id = ?1", &id,
                             1, &stmt, err);
    if (st)
        return st;
    if (sqlite3_step(stmt) == SQLITE_ROW)
        st = row_get_int32(stmt, 0, out_count, err);
    else
        st = store_error(site, err, "read");
    (void)sqlite3_reset(stmt);
    return st;
}

/* The station whose row the statement stands on; resets nothing. */
static enum st read_station(struct site *site, sqlite3_stmt *stmt, struct station *out_station,
                            struct errctx *err) {
    struct station station = {.id = sqlite3_column_int64(stmt, 0),
                              .created_utc_ns = sqlite3_column_int64(stmt, 3)};
    enum st st = row_get_text(stmt, 1, station.name, sizeof station.name, err);
    if (!st)
        st = row_get_text(stmt, 2, station.remark, sizeof station.remark, err);
    if (!st)
        st = count_poses(site, station.id, &station.pose_count, err);
    sqlite3_stmt *poses = NULL;
    if (!st)
        st = store_query(
            site, "SELECT * FROM station_pose WHERE station_id = ?1 ORDER BY id DESC LIMIT 1",
            &station.id, 1, &poses, err);
    if (!st)
        st = store_fetch(site, poses, STORE_STATION_POSE, err);
    if (st == ST_NOT_FOUND)
        st = errctx_set(err, ST_DAMAGED, "%s/site.db: station %lld has no pose", site->path,
                        (long long)station.id);
    if (st)
        return st;
    st = read_pose(poses, &station.pose, err);
    (void)sqlite3_reset(poses);
    if (!st)
        *out_station = station;
    return st;
}

enum st station_get(struct site *site, int64_t id, struct station *out_station,
                    struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    enum st st = store_fetch_id(site, STORE_STATION, id, &stmt, err);
    if (st)
        return st;
    st = read_station(site, stmt, out_station, err);
    (void)sqlite3_reset(stmt);
    return st;
}

enum st station_find(struct site *site, const char *name, struct station *out_station,
                     struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    enum st st = store_query(site, "SELECT * FROM station WHERE name = ?1", NULL, 0, &stmt, err);
    struct row_value value = row_text(name);
    if (!st)
        st = row_bind(stmt, 1, &value);
    if (!st)
        st = store_fetch(site, stmt, STORE_STATION, err);
    if (st)
        return st == ST_NOT_FOUND
                   ? errctx_set(err, st, "%s has no station '%.80s'", site->path, name)
                   : st;
    st = read_station(site, stmt, out_station, err);
    (void)sqlite3_reset(stmt);
    return st;
}

static enum st list_read_station(struct site *site, sqlite3_stmt *stmt, void *out_row,
                                 struct errctx *err) {
    return read_station(site, stmt, out_row, err);
}

enum st station_list(struct site *site, int64_t after_id, struct station *out_stations,
                     size_t capacity, size_t *out_count, struct errctx *err) {
    return store_list(site, "SELECT * FROM station WHERE id > ?1 ORDER BY id", &after_id, 1,
                      STORE_STATION, list_read_station, out_stations, sizeof *out_stations,
                      capacity, out_count, err);
}

static enum st list_read_pose(struct site *site, sqlite3_stmt *stmt, void *out_row,
                              struct errctx *err) {
    (void)site;
    return read_pose(stmt, out_row, err);
}

enum st station_poses(struct site *site, int64_t id, size_t first, struct station_pose *out_poses,
                      size_t capacity, size_t *out_count, struct errctx *err) {
    const int64_t numbers[2] = {id, (int64_t)first};
    return store_list(
        site, "SELECT * FROM station_pose WHERE station_id = ?1 ORDER BY id LIMIT -1 OFFSET ?2",
        numbers, 2, STORE_STATION_POSE, list_read_pose, out_poses, sizeof *out_poses, capacity,
        out_count, err);
}
