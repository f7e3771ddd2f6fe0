/* `scancart capture`: one scan of one station, by the cart or its twin, into a site. */
#include "app/app.h"
#include "app/app_site.h"
#include "app/cmd_capture_cart.h"
#include "app/cmd_capture_text.h"
#include "app/commands.h"
#include "base/fileio.h"
#include "capture/notify.h"
#include "capture/resume.h"
#include "capture/session.h"
#include "capture/status.h"
#include "site/station.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const char about[] =
    "Scans one station with the cart into a site (made if it is not there): homes pan and tilt, "
    "spins the mirror up, sweeps, takes the photographs, and reports what came of it. Before it "
    "starts it says how long it will take and what will be stored; Ctrl-C stops the cart in order, "
    "with all that was measured in the site.\n\n"
    "The board names the devices; boards/twin is the simulated cart. --resume goes on with a scan "
    "that was cut short, from the first pan position that is missing.\n\n"
    "Quality: preview 12 pan steps a mirror turn, field 4 (default), survey 3; or --resolution in "
    "degrees of pan from turn to turn.\n\n"
    "Example: scancart capture my-site --board boards/twin --quality preview\n"
    "Example: scancart capture my-site --board boards/rpi5 --station b --at 12.5,3,90\n"
    "Example: scancart capture my-site --board boards/rpi5 --station b --resume";

static struct session *running; /* for the signal handler */

static void on_signal(int number) {
    (void)number;
    if (running)
        session_stop(running);
}

static void catch_signals(void) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_signal;
    (void)sigaction(SIGINT, &action, NULL);
    (void)sigaction(SIGTERM, &action, NULL);
}

struct run {
    const struct cmd_capture_options *o;
    const char *path;
    struct cmd_capture_cart cart;
    struct site *site;
    bool made; /* the site is new */
    bool kept; /* station and streams are in it */
    struct station station;
    struct resume resume;
    struct scan_plan plan;
    char device[SITE_NAME_MAX];
    int64_t camera_id;
    struct session *session;
    struct session_result result;
    bool line_open; /* a status line stands on the terminal */
};

/* ---- plan ---- */

static enum st plan_passes(const struct cmd_capture_options *o, struct scan_plan *plan,
                           struct errctx *err) {
    double tilt_deg[SCAN_PLAN_MAX_PASSES] = {0};
    size_t passes = 0;
    for (; o->tilt && o->tilt[passes]; passes++) {
        char *end = NULL;
        if (passes == SCAN_PLAN_MAX_PASSES)
            return errctx_set(err, ST_INVALID, "more than %d rounds of photographs",
                              SCAN_PLAN_MAX_PASSES);
        tilt_deg[passes] = strtod(o->tilt[passes], &end);
        if (end == o->tilt[passes] || *end)
            return errctx_set(err, ST_INVALID, "--tilt '%s' is no angle in degrees",
                              o->tilt[passes]);
    }
    if (o->no_photos) {
        plan->pass_count = 0;
        return ST_OK;
    }
    if (!passes && isnan(o->photo_step_deg))
        return ST_OK;
    double step_deg = isnan(o->photo_step_deg) ? 40 : o->photo_step_deg;
    return scan_plan_set_passes(plan, tilt_deg, passes ? passes : 1, step_deg, err);
}

static enum st make_plan(struct run *r, struct errctx *err) {
    const struct cmd_capture_options *o = r->o;
    const char *q = o->quality ? o->quality : "field";
    int quality = !strcmp(q, "preview")  ? SCAN_PLAN_PREVIEW
                  : !strcmp(q, "field")  ? SCAN_PLAN_FIELD
                  : !strcmp(q, "survey") ? SCAN_PLAN_SURVEY
                                         : -1;
    if (quality < 0)
        return errctx_set(err, ST_INVALID, "--quality '%s' is none of preview, field, survey", q);
    r->plan = scan_plan_default((enum scan_plan_quality)quality);
    cmd_capture_cart_plan(&r->cart, o, &r->plan);
    if (!isnan(o->mirror_hz))
        r->plan.mirror_hz = o->mirror_hz;
    if (!isnan(o->resolution_deg))
        r->plan.steps_per_revolution = o->resolution_deg / 360 * r->plan.pan_steps_per_turn;
    double deg = 360 / r->plan.pan_steps_per_turn;
    if (!isnan(o->from_deg) || !isnan(o->to_deg))
        scan_plan_set_range(&r->plan,
                            isnan(o->from_deg) ? r->plan.pan_from_steps * deg : o->from_deg,
                            isnan(o->to_deg) ? r->plan.pan_to_steps * deg : o->to_deg);
    enum st st = plan_passes(o, &r->plan, err);
    return st ? st : scan_plan_check(&r->plan, err);
}

/* ---- site and station ---- */

static enum st open_site(struct run *r, struct errctx *err) {
    const int64_t simulated_utc_ns = 1767258000000000000; /* 2026-01-01 09:00 UTC */
    struct site_info info;
    memset(&info, 0, sizeof info);
    enum st st = site_open(r->path, SITE_WRITE, &r->site, err);
    if (st == ST_NOT_FOUND && (!r->o->resume || r->o->keep_going)) {
        st = site_create(r->path, &info, &r->site, err);
        r->made = !st;
    }
    if (st)
        return st;
    app_site_set_actor(r->site, "capture");
    if (r->cart.simulated && !r->cart.board->twin->real_time)
        site_set_clock(r->site, simulated_utc_ns);
    return ST_OK;
}

/* "x,y[,yaw in degrees]" */
static enum st parse_at(const char *text, struct pose *in_out_pose, struct errctx *err) {
    double x = 0, y = 0, yaw_deg = 0;
    int used = 0, n = sscanf(text, "%lf,%lf%n,%lf%n", &x, &y, &used, &yaw_deg, &used);
    if (n < 2 || text[used] || !(fabs(x) < 1e5 && fabs(y) < 1e5 && fabs(yaw_deg) <= 360))
        return errctx_set(err, ST_INVALID, "--at '%s' is not X,Y[,YAW] (metres, degrees)", text);
    in_out_pose->t_m.x = x;
    in_out_pose->t_m.y = y;
    in_out_pose->r = so3_exp(vec3_make(0, 0, yaw_deg * 3.14159265358979323846 / 180));
    return ST_OK;
}

/* The station's name if none was given: to resume, the last that was scanned; else the twin's next
 * stand that is not in the site, or a, b, c, ... */
static enum st choose_name(struct run *r, char out_name[SITE_NAME_MAX], struct errctx *err) {
    struct station station;
    if (r->o->resume) {
        size_t count = 1;
        int64_t after = 0;
        enum st st = ST_OK;
        out_name[0] = 0;
        while (!st && count) {
            st = station_list(r->site, after, &station, 1, &count, err);
            if (!st && count) {
                after = station.id;
                (void)snprintf(out_name, SITE_NAME_MAX, "%s", station.name);
            }
        }
        return st || out_name[0]
                   ? st
                   : errctx_set(err, ST_NOT_FOUND, "%s: no station to go on with", r->path);
    }
    for (size_t i = 0; i < 26; i++) {
        const char *stand = cmd_capture_cart_stand(&r->cart, i);
        if (r->cart.twin && !stand)
            return errctx_set(err, ST_EXISTS, "all stands of the simulated scene are in %s already",
                              r->path);
        (void)snprintf(out_name, SITE_NAME_MAX, "%s", stand ? stand : "");
        if (!stand)
            (void)snprintf(out_name, SITE_NAME_MAX, "%c", (char)('a' + i));
        enum st st = station_find(r->site, out_name, &station, err);
        if (st == ST_NOT_FOUND)
            return ST_OK;
        if (st)
            return st;
    }
    return errctx_set(err, ST_FULL, "name the station: --station NAME");
}

static enum st add_station(struct run *r, const char *name, struct errctx *err) {
    struct station_pose pose;
    memset(&pose, 0, sizeof pose);
    pose.world_from_station = cmd_capture_cart_pose(&r->cart, name);
    (void)snprintf(pose.source, sizeof pose.source, "nominal");
    enum st st = r->o->at ? parse_at(r->o->at, &pose.world_from_station, err) : ST_OK;
    int64_t id = 0;
    if (!st)
        st = station_add(r->site, name, NULL, &pose, &id, err);
    return st ? st : station_get(r->site, id, &r->station, err);
}

/* The station, new or to go on with. ST_EXISTS where something has been scanned and --resume was
 * not given. */
static enum st find_station(struct run *r, struct errctx *err) {
    char name[SITE_NAME_MAX];
    enum st st = ST_OK;
    if (r->o->station)
        (void)snprintf(name, sizeof name, "%s", r->o->station);
    else
        st = choose_name(r, name, err);
    if (!st)
        st = station_find(r->site, name, &r->station, err);
    if (st == ST_NOT_FOUND && (!r->o->resume || r->o->keep_going))
        st = add_station(r, name, err);
    if (st)
        return st;
    (void)snprintf(r->device, sizeof r->device, "%s", r->cart.name);
    st = resume_find(r->site, r->station.id, &r->resume, err);
    if (st == ST_NOT_FOUND && !r->resume.sessions)
        return ST_OK; /* nothing is there: also the first scan can be resumed */
    if (st)
        return errctx_prefix(err, st, "station %s", r->station.name);
    if (!r->o->resume)
        return errctx_set(
            err, ST_EXISTS,
            "station %s has been scanned (%.0f %% of the sweep): go on with --resume, "
            "or give another --station",
            r->station.name, r->resume.covered * 100);
    struct camera_settings camera = r->plan.camera;
    r->plan = r->resume.rest;
    r->plan.camera = camera;
    resume_next_device(&r->resume, r->device);
    return ST_OK;
}

/* ---- running ---- */

static void on_status(void *ctx, const struct session_status *status) {
    struct run *r = ctx;
    char line[STATUS_LINE_MAX], note[STATUS_LINE_MAX + 32];
    bool terminal = isatty(STDERR_FILENO) != 0;
    (void)status_line(status, line);
    (void)snprintf(note, sizeof note, "WATCHDOG=1\nSTATUS=%s", line);
    notify_send(note);
    if (r->cart.devices.hosttime->is_virtual && !terminal)
        return; /* nobody watches a second that takes none */
    (void)fprintf(stderr, terminal ? "\r\033[K%.150s" : "%s\n", line);
    (void)fflush(stderr);
    r->line_open = terminal;
}

/* Opens the session, within a batch of the site. */
static enum st open_session(struct run *r, struct errctx *err) {
    struct session_config config = {.devices = &r->cart.devices,
                                    .plan = &r->plan,
                                    .whole_plan = r->resume.sessions ? &r->resume.plan : NULL,
                                    .site = r->site,
                                    .station_id = r->station.id,
                                    .device = r->device,
                                    .camera_calib_id = r->camera_id,
                                    .sample_hz = r->cart.sample_hz,
                                    .before_stream_id = r->resume.last_stream_id,
                                    .report = on_status,
                                    .report_ctx = r};
    enum st st = session_open(&config, &r->session, err);
    if (!st)
        cmd_capture_text_plan(r->path, r->station.name, &r->plan, session_forecast(r->session),
                              r->resume.sessions ? r->resume.covered : (double)NAN);
    return st;
}

static enum st run_session(struct run *r, struct errctx *err) {
    running = r->session;
    catch_signals();
    notify_send("READY=1");
    enum st st = session_run(r->session, &r->result, err);
    notify_send("STOPPING=1");
    running = NULL;
    if (r->line_open)
        (void)fputc('\n', stderr);
    cmd_capture_text_warnings(&r->result);
    return st;
}

/* Everything up to the moment in which something moves. */
static enum st prepare(struct run *r, struct errctx *err) {
    enum st st = find_station(r, err);
    if (!st)
        st = cmd_capture_cart_calibrate(&r->cart, r->o, r->site, &r->camera_id, &r->plan, err);
    r->result.complete = !st && r->resume.sessions && r->resume.complete;
    if (st || r->result.complete)
        return st;
    st = cmd_capture_cart_open(&r->cart, r->o, r->station.name, err);
    return st ? st : open_session(r, err);
}

/* A cart that cannot scan, or a plan alone, leaves the site as it was. */
static enum st scan(struct run *r, struct errctx *err) {
    enum st st = make_plan(r, err);
    if (!st)
        st = open_site(r, err);
    if (!st)
        st = site_begin(r->site, err);
    if (st)
        return st;
    st = prepare(r, err);
    if (st || r->o->plan_only) {
        site_rollback(r->site);
        return st;
    }
    st = site_commit(r->site, err);
    r->kept = !st;
    return st || r->result.complete ? st : run_session(r, err);
}

/* Takes a site away again that was made for a scan that did not begin: only what a new site has. */
static void remove_site(const char *path) {
    static const char *const files[] = {"site.db", "site.db-wal", "site.db-shm", "writer.lock"};
    static const char *const folders[] = {"frames", "photos", "tiles"};
    char name[FILEIO_PATH_MAX];
    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++)
        if (!fileio_join(path, files[i], name, NULL))
            (void)unlink(name);
    for (size_t i = 0; i < sizeof folders / sizeof folders[0]; i++)
        if (!fileio_join(path, folders[i], name, NULL))
            (void)rmdir(name);
    (void)rmdir(path);
}

static int run(const struct cmd_capture_options *o, const char *path) {
    struct errctx err = {0}, own = {0};
    struct run *r = calloc(1, sizeof *r);
    if (!r) {
        (void)errctx_set(&err, ST_NOMEM, "no memory");
        return app_fail("capture", &err);
    }
    r->o = o;
    r->path = path;
    enum st st = cmd_capture_cart_load(o, &r->cart, &err);
    if (!st)
        st = scan(r, &err);
    bool scanned = r->session && !o->plan_only;
    if ((scanned || r->result.complete) && r->site) {
        enum st told =
            cmd_capture_text_report(r->site, path, &r->station, &r->result, st, o->json, &own);
        if (told && !st) {
            st = told;
            err = own;
        }
    }
    session_close(r->session);
    enum st closed = site_close(r->site, st ? NULL : &err);
    st = st ? st : closed;
    if (r->made && !r->kept)
        remove_site(path);
    cmd_capture_cart_close(&r->cart);
    free(r);
    return st ? app_fail("capture", &err) : APP_DONE;
}

int cmd_capture(int argc, const char **argv) {
    struct cmd_capture_options o = {.from_deg = (double)NAN,
                                    .to_deg = (double)NAN,
                                    .resolution_deg = (double)NAN,
                                    .mirror_hz = (double)NAN,
                                    .photo_step_deg = (double)NAN,
                                    .seed = -1};
    const struct poptOption options[] = {
        {"board", 'b', POPT_ARG_STRING, &o.board, 0, "the devices: a folder with a board.yaml",
         "BOARD"},
        {"station", 's', POPT_ARG_STRING, &o.station, 0, "name of the stand", "NAME"},
        {"at", 0, POPT_ARG_STRING, &o.at, 0, "where it is, about (metres, degrees)", "X,Y,YAW"},
        {"resume", 'r', POPT_ARG_NONE, &o.resume, 0, "go on with a scan that was cut short", NULL},
        {"keep-going", 0, POPT_ARG_NONE, &o.keep_going, 0,
         "start, or go on where it was cut short (for a service)", NULL},
        {"quality", 'q', POPT_ARG_STRING, &o.quality, 0, "preview, field (default) or survey",
         "NAME"},
        {"from", 0, POPT_ARG_DOUBLE, &o.from_deg, 0, "first pan angle (-90)", "DEG"},
        {"to", 0, POPT_ARG_DOUBLE, &o.to_deg, 0, "last pan angle (90: all around)", "DEG"},
        {"resolution", 0, POPT_ARG_DOUBLE, &o.resolution_deg, 0,
         "pan from one mirror turn to the next", "DEG"},
        {"mirror", 0, POPT_ARG_DOUBLE, &o.mirror_hz, 0, "mirror speed (4)", "HZ"},
        {"tilt", 0, POPT_ARG_ARGV, &o.tilt, 0,
         "a round of photographs at this tilt (repeat for more; 0)", "DEG"},
        {"photo-step", 0, POPT_ARG_DOUBLE, &o.photo_step_deg, 0,
         "pan from one photograph to the next (40)", "DEG"},
        {"no-photos", 0, POPT_ARG_NONE, &o.no_photos, 0, "take no photographs", NULL},
        {"rig", 0, POPT_ARG_STRING, &o.rig, 0, "calibration of the rig, for a site without one",
         "FILE"},
        {"camera", 0, POPT_ARG_STRING, &o.camera, 0, "calibration of the camera, likewise", "FILE"},
        {"plan", 0, POPT_ARG_NONE, &o.plan_only, 0, "say what it will take, and end", NULL},
        {"fault", 0, POPT_ARG_ARGV, &o.fault, 0, "twin: let a fault loose (repeat for more)",
         "NAME@T[+D][=V]"},
        {"set", 0, POPT_ARG_ARGV, &o.set, 0, "twin: one parameter (repeat for more)", "KEY=VALUE"},
        {"seed", 0, POPT_ARG_LONG, &o.seed, 0, "twin: of noise and chance", "N"},
        POPT_TABLEEND};
    struct app_usage usage = {.name = "capture",
                              .synopsis = "SITE --board BOARD [options] [--json]",
                              .about = about,
                              .options = options,
                              .out_json = &o.json};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st)
        return app_parse_exit(st);
    const char *path = poptGetArg(context);
    int status;
    o.resume = o.resume || o.keep_going;
    if (!path || poptPeekArg(context))
        status = app_usage_error("capture", "give one site folder");
    else if (o.keep_going && !o.station)
        status = app_usage_error("capture", "--keep-going needs --station NAME");
    else if (!o.board)
        status =
            app_usage_error("capture", "needs --board BOARD (boards/twin: the simulated cart)");
    else
        status = run(&o, path);
    (void)poptFreeContext(context);
    app_free_options(options);
    return status;
}
