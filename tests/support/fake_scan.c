#include "tests/support/fake_scan.h"

#include "site/station.h"
#include "site/stream.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct scan_plan fake_scan_plan(double degrees) {
    struct scan_plan plan = scan_plan_default(SCAN_PLAN_PREVIEW);
    struct errctx err;
    const double level = 0;
    scan_plan_set_range(&plan, -degrees / 2, degrees / 2);
    if (scan_plan_set_passes(&plan, &level, 1, 180, &err))
        abort();
    return plan;
}

static enum st open_station(const char *path, struct site **out_site, int64_t *out_station,
                            struct errctx *err) {
    struct site_info info;
    struct station station;
    struct station_pose pose;
    memset(&info, 0, sizeof info);
    memset(&pose, 0, sizeof pose);
    pose.world_from_station = pose_identity();
    (void)snprintf(pose.source, sizeof pose.source, "nominal");
    enum st st = site_open(path, SITE_WRITE, out_site, err);
    if (st == ST_NOT_FOUND)
        st = site_create(path, &info, out_site, err);
    if (st)
        return st;
    st = station_find(*out_site, "a", &station, err);
    *out_station = station.id;
    if (st == ST_NOT_FOUND)
        st = station_add(*out_site, "a", NULL, &pose, out_station, err);
    return st;
}

static enum st scan(struct site *site, int64_t station, const struct scan_plan *plan,
                    const struct fake_cart_spec *spec, struct resume *resume,
                    struct session_result *out_result, struct errctx *err) {
    char device[SITE_NAME_MAX] = "fake";
    enum st st = resume_find(site, station, resume, err);
    if (st == ST_NOT_FOUND && !resume->sessions)
        st = ST_OK;
    if (st || (resume->sessions && resume->complete))
        return st;
    resume_next_device(resume, device);
    struct fake_cart *cart = fake_cart_open(spec);
    if (!cart)
        return errctx_set(err, ST_NOMEM, "no cart");
    struct cart_devices devices = fake_cart_devices(cart);
    struct session *session = NULL;
    struct session_config config = {.devices = &devices,
                                    .plan = resume->sessions ? &resume->rest : plan,
                                    .whole_plan = resume->sessions ? &resume->plan : NULL,
                                    .site = site,
                                    .station_id = station,
                                    .device = device,
                                    .before_stream_id = resume->last_stream_id};
    st = session_open(&config, &session, err);
    if (!st)
        st = session_run(session, out_result, err);
    session_close(session);
    fake_cart_close(cart);
    return st;
}

enum st fake_scan_run(const char *path, const struct scan_plan *plan,
                      const struct fake_cart_spec *spec, struct session_result *out_result,
                      struct errctx *err) {
    struct site *site = NULL;
    int64_t station = 0;
    struct resume *resume = calloc(1, sizeof *resume);
    memset(out_result, 0, sizeof *out_result);
    enum st st = resume ? open_station(path, &site, &station, err) : ST_NOMEM;
    if (!st)
        st = scan(site, station, plan, spec, resume, out_result, err);
    struct errctx own;
    enum st closed = site_close(site, st ? &own : err);
    free(resume);
    return st ? st : closed;
}

bool fake_scan_state(const char *path, struct resume *out_resume) {
    struct site *site = NULL;
    struct station station;
    struct errctx err;
    bool good = !site_open(path, SITE_READ, &site, &err) &&
                !station_find(site, "a", &station, &err) &&
                !resume_find(site, station.id, out_resume, &err);
    (void)site_close(site, &err);
    return good;
}

int64_t fake_scan_packets(const char *path) {
    struct site *site = NULL;
    struct stream streams[32];
    struct stream_state state = {0};
    struct errctx err;
    size_t count = 32;
    int64_t after = 0, head = 0;
    enum st st = site_open(path, SITE_READ, &site, &err);
    while (!st && count == 32) {
        st = stream_list(site, 0, after, streams, 32, &count, &err);
        for (size_t i = 0; i < count && !st; i++) {
            after = streams[i].id;
            head = strcmp(streams[i].kind, "head") ? head : after;
        }
    }
    if (!st && head && stream_get_state(site, head, &state, &err))
        state.item_count = 0;
    (void)site_close(site, &err);
    return state.item_count;
}
