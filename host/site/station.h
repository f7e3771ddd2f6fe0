/* Stations: the stands of the cart (or of any other instrument), each with a name and a history of
 * poses. A pose is never changed: a better one is added, the newest counts. */
#ifndef SC_SITE_STATION_H
#define SC_SITE_STATION_H

#include "base/pose.h"
#include "base/st.h"
#include "site/site.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A pose with its error. The covariance is of the twist [w_rad v_m] in world_from_station_true =
 * exp([w v]) * world_from_station, row-major 6x6, rad and m, symmetric, positive semi-definite. */
struct station_pose {
    struct pose world_from_station;
    bool has_covariance;
    double covariance[36];
    char source[SITE_NAME_MAX]; /* where it is from: "nominal", "import", "register", ... */
    int64_t utc_ns;             /* output only */
};

struct station {
    int64_t id;
    char name[SITE_NAME_MAX];
    char remark[SITE_TEXT_MAX]; /* JSON or "" */
    int64_t created_utc_ns;
    int32_t pose_count;       /* at least 1 */
    struct station_pose pose; /* the newest */
};

/* Adds a station. `remark_json` may be NULL. ST_EXISTS if the name is taken; ST_INVALID for a bad
 * name, a matrix that is not a rotation within 1e-6, a number that is not finite, or a covariance
 * that is not symmetric with a diagonal >= 0. */
ST_MUST_CHECK enum st station_add(struct site *site, const char *name, const char *remark_json,
                                  const struct station_pose *pose, int64_t *out_id,
                                  struct errctx *err);

/* Adds a newer pose to a station. Errors as above; ST_NOT_FOUND without such a station. */
ST_MUST_CHECK enum st station_add_pose(struct site *site, int64_t id,
                                       const struct station_pose *pose, struct errctx *err);

/* ST_NOT_FOUND without such a station. */
ST_MUST_CHECK enum st station_get(struct site *site, int64_t id, struct station *out_station,
                                  struct errctx *err);
ST_MUST_CHECK enum st station_find(struct site *site, const char *name, struct station *out_station,
                                   struct errctx *err);

/* Up to `capacity` stations with id > after_id, in the order of id. Start with 0, go on with the
 * last id; *out_count < capacity is the end. All ..._list() functions of this module work like
 * this. */
ST_MUST_CHECK enum st station_list(struct site *site, int64_t after_id,
                                   struct station *out_stations, size_t capacity, size_t *out_count,
                                   struct errctx *err);

/* Every pose a station ever had, oldest first: up to `capacity` from number `first` (0 is the
 * oldest). */
ST_MUST_CHECK enum st station_poses(struct site *site, int64_t id, size_t first,
                                    struct station_pose *out_poses, size_t capacity,
                                    size_t *out_count, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
