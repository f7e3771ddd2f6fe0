#include "app/app_info.h"

#include "app/app_site.h"
#include "base/json.h"
#include "site/calib.h"
#include "site/custody.h"
#include "site/files.h"
#include "site/frame_row.h"
#include "site/job.h"
#include "site/photo_row.h"
#include "site/station.h"
#include "site/stream.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PAGE = 32 };

/* One output: JSON if json is not NULL, else text. */
struct out {
    struct site *site;
    struct json *json;
    struct errctx *err;
};

static const double degrees = 57.29577951308232; /* per rad */

static const char *status_name(enum calib_status status) {
    return status == CALIB_NOMINAL ? "nominal" : status == CALIB_TRUE ? "true" : "estimated";
}

static enum st put_head(struct out *out) {
    struct site_info info;
    enum st st = site_get_info(out->site, &info, out->err);
    if (st)
        return st;
    char made[APP_SITE_TEXT_MAX], uuid[33];
    for (size_t i = 0; i < sizeof info.uuid; i++)
        (void)snprintf(uuid + 2 * i, 3, "%02x", info.uuid[i]);
    (void)app_site_time(info.created_utc_ns, made);
    if (!out->json) {
        (void)printf("site          \"%s\" in %s, made %s\n", info.name, site_path(out->site),
                     made);
        if (info.georef.epsg)
            (void)printf("georeference  EPSG:%d, world origin at %.3f, %.3f, %.3f m\n",
                         (int)info.georef.epsg, info.georef.offset_m.x, info.georef.offset_m.y,
                         info.georef.offset_m.z);
        return ST_OK;
    }
    json_text(out->json, NULL, "site", site_path(out->site));
    json_text(out->json, NULL, "name", info.name);
    json_text(out->json, NULL, "uuid", uuid);
    json_integer(out->json, NULL, "created_utc_ns", info.created_utc_ns);
    json_integer(out->json, NULL, "schema_version", info.schema_version);
    struct cJSON *georef = json_object(out->json, NULL, "georef");
    struct cJSON *offset;
    json_integer(out->json, georef, "epsg", info.georef.epsg);
    offset = json_array(out->json, georef, "offset_m");
    json_number(out->json, offset, NULL, info.georef.offset_m.x);
    json_number(out->json, offset, NULL, info.georef.offset_m.y);
    json_number(out->json, offset, NULL, info.georef.offset_m.z);
    return ST_OK;
}

static enum st put_stream(struct out *out, const struct stream *stream, struct cJSON *parent) {
    struct stream_state state;
    enum st st = stream_get_state(out->site, stream->id, &state, out->err);
    if (st)
        return st;
    char bytes[APP_SITE_TEXT_MAX], chain[HASH_HEX_CHARS];
    hash_to_hex(state.chain, chain);
    if (!out->json) {
        (void)printf("    stream    %-8s %s: %" PRId64 " items in %" PRId64 " chunks, %s",
                     stream->kind, stream->name, state.item_count, state.chunk_count,
                     app_site_bytes(state.payload_bytes, bytes));
        if (state.missing_count)
            (void)printf(", %" PRId64 " missing (%" PRId64 " ledger entries)", state.missing_count,
                         state.ledger_count);
        (void)printf("\n");
        return ST_OK;
    }
    struct cJSON *one = json_object(out->json, parent, NULL);
    json_text(out->json, one, "kind", stream->kind);
    json_text(out->json, one, "name", stream->name);
    json_text(out->json, one, "format", stream->format);
    json_integer(out->json, one, "chunks", state.chunk_count);
    json_integer(out->json, one, "items", state.item_count);
    json_integer(out->json, one, "missing", state.missing_count);
    json_integer(out->json, one, "ledger_entries", state.ledger_count);
    json_integer(out->json, one, "payload_bytes", state.payload_bytes);
    json_integer(out->json, one, "stored_bytes", state.stored_bytes);
    json_text(out->json, one, "chain", chain);
    return ST_OK;
}

/* Streams of a station on their way out. */
struct listing {
    struct out *out;
    struct cJSON *list;
};

static enum st visit_stream(void *ctx, const struct stream *stream, struct errctx *err) {
    const struct listing *listing = ctx;
    (void)err; /* the same as out->err */
    return put_stream(listing->out, stream, listing->list);
}

static enum st put_streams(struct out *out, int64_t station_id, struct cJSON *station) {
    struct listing listing = {out, out->json ? json_array(out->json, station, "streams") : NULL};
    return stream_each(out->site, station_id, visit_stream, &listing, out->err);
}

static enum st visit_frame(void *ctx, const struct frame_row *row, struct errctx *err) {
    (void)row;
    (void)err;
    ++*(int64_t *)ctx;
    return ST_OK;
}

static enum st count_frames(struct out *out, int64_t station_id, int64_t *out_count) {
    *out_count = 0;
    return frame_row_each(out->site, station_id, visit_frame, out_count, out->err);
}

static void put_photo(struct out *out, const struct photo_row *photo, struct cJSON *parent) {
    if (!out->json) {
        (void)printf("    photo     \"%s\" %d x %d px\n", photo->name, (int)photo->width_px,
                     (int)photo->height_px);
        return;
    }
    char hex[HASH_HEX_CHARS];
    hash_to_hex(photo->sha256, hex);
    struct cJSON *one = json_object(out->json, parent, NULL);
    json_text(out->json, one, "name", photo->name);
    json_integer(out->json, one, "width_px", photo->width_px);
    json_integer(out->json, one, "height_px", photo->height_px);
    json_text(out->json, one, "sha256", hex);
}

static enum st put_photos(struct out *out, int64_t station_id, struct cJSON *station) {
    struct photo_row *page = calloc(PAGE, sizeof *page);
    struct cJSON *list = out->json ? json_array(out->json, station, "photos") : NULL;
    enum st st = page ? ST_OK : errctx_set(out->err, ST_NOMEM, "no memory to list photographs");
    int64_t after = 0;
    for (size_t count = PAGE; !st && count == PAGE;) {
        st = photo_row_list(out->site, station_id, after, page, PAGE, &count, out->err);
        for (size_t i = 0; i < count && !st; i++) {
            after = page[i].id;
            put_photo(out, &page[i], list);
        }
    }
    free(page);
    return st;
}

/* Standard deviations of the rotation (rad) and the translation (m), the root of the mean variance.
 */
static void pose_sigmas(const struct station_pose *pose, double *out_rad, double *out_m) {
    const double *c = pose->covariance;
    *out_rad = sqrt((c[0] + c[7] + c[14]) / 3);
    *out_m = sqrt((c[21] + c[28] + c[35]) / 3);
}

static struct cJSON *put_station_head(struct out *out, const struct station *station,
                                      struct cJSON *parent) {
    const struct station_pose *pose = &station->pose;
    const struct vec3 t = pose->world_from_station.t_m;
    double sigma_rad = NAN, sigma_m = NAN;
    if (pose->has_covariance)
        pose_sigmas(pose, &sigma_rad, &sigma_m);
    if (!out->json) {
        (void)printf("  station %-3" PRId64 " \"%s\" at %.3f, %.3f, %.3f m", station->id,
                     station->name, t.x, t.y, t.z);
        if (pose->has_covariance)
            (void)printf(" (sigma %.1f mm, %.3f deg)", 1000 * sigma_m, degrees * sigma_rad);
        (void)printf(", pose from %s\n", pose->source);
        return NULL;
    }
    struct cJSON *one = json_object(out->json, parent, NULL), *list;
    json_integer(out->json, one, "id", station->id);
    json_text(out->json, one, "name", station->name);
    json_text(out->json, one, "pose_source", pose->source);
    json_integer(out->json, one, "poses", station->pose_count);
    list = json_array(out->json, one, "t_m");
    json_number(out->json, list, NULL, t.x);
    json_number(out->json, list, NULL, t.y);
    json_number(out->json, list, NULL, t.z);
    list = json_array(out->json, one, "r");
    for (int i = 0; i < 9; i++)
        json_number(out->json, list, NULL, pose->world_from_station.r.m[i]);
    json_number(out->json, one, "sigma_rad", sigma_rad);
    json_number(out->json, one, "sigma_m", sigma_m);
    return one;
}

static enum st put_station(struct out *out, const struct station *station, struct cJSON *parent) {
    int64_t frames = 0;
    struct cJSON *one = put_station_head(out, station, parent);
    enum st st = put_streams(out, station->id, one);
    if (!st)
        st = count_frames(out, station->id, &frames);
    if (!st && out->json)
        json_integer(out->json, one, "frames", frames);
    else if (!st && frames)
        (void)printf("    frames    %" PRId64 "\n", frames);
    return st ? st : put_photos(out, station->id, one);
}

static enum st put_stations(struct out *out) {
    struct station *page = calloc(PAGE, sizeof *page);
    struct cJSON *list = out->json ? json_array(out->json, NULL, "stations") : NULL;
    enum st st = page ? ST_OK : errctx_set(out->err, ST_NOMEM, "no memory to list stations");
    int64_t after = 0;
    for (size_t count = PAGE; !st && count == PAGE;) {
        st = station_list(out->site, after, page, PAGE, &count, out->err);
        for (size_t i = 0; i < count && !st; i++) {
            after = page[i].id;
            st = put_station(out, &page[i], list);
        }
        if (!st && after == 0 && !out->json)
            (void)printf("  no stations yet\n");
    }
    free(page);
    return st;
}

static void put_calib(struct out *out, const struct calib *record, struct cJSON *parent) {
    if (!out->json) {
        (void)printf("calibration   %s of %s, %s\n", record->kind, record->name,
                     status_name(record->status));
        return;
    }
    char hex[HASH_HEX_CHARS];
    hash_to_hex(record->sha256, hex);
    struct cJSON *one = json_object(out->json, parent, NULL);
    json_text(out->json, one, "kind", record->kind);
    json_text(out->json, one, "name", record->name);
    json_text(out->json, one, "status", status_name(record->status));
    json_text(out->json, one, "sha256", hex);
}

static enum st put_calibs(struct out *out) {
    struct calib page[PAGE];
    struct cJSON *list = out->json ? json_array(out->json, NULL, "calibrations") : NULL;
    int64_t after = 0;
    enum st st = ST_OK;
    for (size_t count = PAGE; !st && count == PAGE;) {
        st = calib_list(out->site, after, page, PAGE, &count, out->err);
        for (size_t i = 0; i < count && !st; i++) {
            after = page[i].id;
            put_calib(out, &page[i], list);
        }
    }
    return st;
}

static enum st put_files(struct out *out) {
    struct files_entry page[PAGE];
    int64_t after = 0, files = 0, bytes = 0;
    enum st st = ST_OK;
    for (size_t count = PAGE; !st && count == PAGE;) {
        st = files_list(out->site, 0, after, page, PAGE, &count, out->err);
        for (size_t i = 0; i < count && !st; i++) {
            after = page[i].id;
            files++;
            bytes += page[i].size_bytes;
        }
    }
    if (st)
        return st;
    char text[APP_SITE_TEXT_MAX];
    if (!out->json) {
        (void)printf("files         %" PRId64 ", %s\n", files, app_site_bytes(bytes, text));
        return ST_OK;
    }
    json_integer(out->json, NULL, "files", files);
    json_integer(out->json, NULL, "file_bytes", bytes);
    return ST_OK;
}

static enum st put_jobs(struct out *out) {
    int64_t ids[PAGE], after = 0, jobs = 0;
    enum st st = ST_OK;
    for (size_t count = PAGE; !st && count == PAGE;) {
        st = job_list(out->site, NULL, after, ids, PAGE, &count, out->err);
        if (!st && count)
            after = ids[count - 1];
        jobs += st ? 0 : (int64_t)count;
    }
    if (!st && out->json)
        json_integer(out->json, NULL, "jobs", jobs);
    else if (!st)
        (void)printf("jobs          %" PRId64 "\n", jobs);
    return st;
}

static enum st put_custody(struct out *out) {
    struct custody_event last;
    enum st st = custody_last(out->site, &last, out->err);
    if (st)
        return st;
    char hex[HASH_HEX_CHARS], when[APP_SITE_TEXT_MAX];
    hash_to_hex(last.link, hex);
    if (!out->json) {
        (void)printf("custody       %" PRId64 " events, last: %s %s by %s with %s\n"
                     "              chain %s\n",
                     last.sequence, last.what, app_site_time(last.utc_ns, when), last.who,
                     last.program, hex);
        return ST_OK;
    }
    struct cJSON *one = json_object(out->json, NULL, "custody");
    json_integer(out->json, one, "events", last.sequence);
    json_text(out->json, one, "last", last.what);
    json_integer(out->json, one, "utc_ns", last.utc_ns);
    json_text(out->json, one, "who", last.who);
    json_text(out->json, one, "program", last.program);
    json_text(out->json, one, "chain", hex);
    return ST_OK;
}

static enum st put_all(struct out *out) {
    enum st (*const parts[])(struct out *) = {put_head,  put_stations, put_calibs,
                                              put_files, put_jobs,     put_custody};
    enum st st = ST_OK;
    for (size_t i = 0; i < sizeof parts / sizeof parts[0] && !st; i++)
        st = parts[i](out);
    return st;
}

enum st app_info_text(struct site *site, struct errctx *err) {
    struct out out = {.site = site, .err = err};
    return put_all(&out);
}

enum st app_info_json(struct site *site, struct errctx *err) {
    struct json json;
    json_init_object(&json);
    struct out out = {.site = site, .json = &json, .err = err};
    enum st st = put_all(&out);
    if (!st)
        st = json_write(&json, stdout, err);
    json_fini(&json);
    return st;
}
