#include "app/app.h"
#include "app/app_site.h"
#include "app/cmd_import.h"
#include "base/json.h"
#include "base/panorama.h"
#include "base/picture.h"
#include "base/progress.h"
#include "import/frame_up.h"
#include "import/import_list.h"
#include "import/scan_job.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char about[] =
    "Makes each scan a station: the file as it came, its samples with direction, range, row and "
    "column, and 3D "
    "photographs drawn from the stand so that 'scancart shot' shows it at once.\n\n"
    "3DTK .3d (left-handed, y up, cm): rows and columns of the turned line scanner are found from "
    "the points alone; "
    "ranges at the instrument's no-return code become no returns. The .pose beside the file is "
    "taken unless "
    "--pose names another.\n"
    "PLY with a range_grid (ASCII or binary): --pose names a Stanford .conf, --up y turns its y "
    "up; "
    "the rays are "
    "taken to come from far along +z of the file.\n"
    "Logs of a nodding line laser: first line three numbers and the bearings in degrees; others "
    "number, time, angle in degrees, a range in metres for each bearing (0: no return).\n\n"
    "Points of a spinning laser as KITTI stores them (.bin, or a folder with velodyne.bin): x y z "
    "reflectance. "
    "Rings are found from the points alone. With image.png and calib.txt (P2, R0_rect, "
    "Tr_velo_to_cam) beside them "
    "the station also gets a camera frame, and 'scancart fuse' makes a 3D photograph of it.\n\n"
    "Ranges are believed to --range-sigma-m (1 cm for .3d and logs, 2 cm for .bin; a twentieth of "
    "the samples' "
    "spacing for PLY).\n\n"
    "Examples:\n"
    "  scancart import scan mysite scan000.3d scan001.3d --panorama out.png\n"
    "  scancart import scan mysite bun000.ply bun045.ply bun315.ply --pose bun.conf --up y\n"
    "  scancart import scan mysite kitti/000000 && scancart fuse mysite\n"
    "  scancart import scan mysite --list scans.yaml";

struct arguments {
    char *list, *name, *pose, *up, *panorama;
    double unit_m, range_sigma_m, no_return_m, standoff_m;
    int no_photos;
};

static int fill_job(const struct arguments *a, const char *file, struct scan_job *job) {
    struct errctx err = {0};
    *job = scan_job_default();
    if (a->up && frame_up_parse(a->up, &job->options_ply.up, &err))
        return app_usage_error("import scan", "--up: %s", err.text);
    job->options_ply.unit_m = a->unit_m;
    job->options_ply.standoff_m = a->standoff_m;
    job->options_3dtk.no_return_m = a->no_return_m;
    job->range_sigma_m = a->range_sigma_m;
    job->no_photos = a->no_photos != 0;
    int status = app_take_text("import scan", a->name, job->name, sizeof job->name);
    if (!status)
        status = app_take_text("import scan", file, job->path, sizeof job->path);
    if (!status)
        status = app_take_text("import scan", a->pose, job->pose_path, sizeof job->pose_path);
    return status;
}

static void print_text(const struct scan_job *job) {
    char grid[64] = "in the file's order", frame[160] = "";
    if (job->scan.rows > 1)
        (void)snprintf(grid, sizeof grid, "in %d rows of %d", job->scan.rows, job->scan.columns);
    if (job->frame.image.bytes)
        (void)snprintf(frame, sizeof frame, ", a camera frame of %d x %d px",
                       job->frame.camera.width_px, job->frame.camera.height_px);
    else if (job->frame.lacks)
        (void)snprintf(frame, sizeof frame, ", no camera frame (%s)", job->frame.lacks);
    (void)printf("%s: %zu samples %s, %.1f %% no return, %d photograph%s%s; %s\n", job->name,
                 job->scan.count, grid, 100.0 * (double)job->no_returns / (double)job->scan.count,
                 job->face_count, job->face_count == 1 ? "" : "s", frame,
                 job->posed ? "pose as given" : "no pose: it stands at the origin");
}

static void put_frame(struct json *json, struct cJSON *station, const struct scan_frame *frame) {
    if (!frame->image.bytes)
        return;
    struct cJSON *o = json_object(json, station, "frame");
    json_integer(json, o, "width_px", frame->camera.width_px);
    json_integer(json, o, "height_px", frame->camera.height_px);
    json_number(json, o, "fx_px", frame->camera.fx_px);
    json_number(json, o, "x_m", frame->station_from_cam.t_m.x);
    json_number(json, o, "y_m", frame->station_from_cam.t_m.y);
    json_number(json, o, "z_m", frame->station_from_cam.t_m.z);
}

static enum st print_json(const struct scan_job *jobs, const int64_t *ids, size_t count,
                          struct errctx *err) {
    struct json json;
    json_init_object(&json);
    struct cJSON *stations = json_array(&json, NULL, "stations");
    for (size_t i = 0; i < count; i++) {
        const struct scan_job *job = &jobs[i];
        struct cJSON *station = json_object(&json, stations, NULL);
        json_integer(&json, station, "id", ids[i]);
        json_text(&json, station, "name", job->name);
        json_integer(&json, station, "rows", job->scan.rows);
        json_integer(&json, station, "columns", job->scan.columns);
        json_integer(&json, station, "samples", (int64_t)job->scan.count);
        json_integer(&json, station, "surfaces", (int64_t)job->surfaces);
        json_integer(&json, station, "no_returns", (int64_t)job->no_returns);
        json_number(&json, station, "range_sigma_m", job->used_sigma_m);
        json_boolean(&json, station, "posed", job->posed);
        json_text(&json, station, "grid", job->scan.meta);
        put_frame(&json, station, &job->frame);
        struct cJSON *photos = json_array(&json, station, "photos");
        for (int k = 0; k < job->face_count; k++) {
            struct cJSON *photo = json_object(&json, photos, NULL);
            json_text(&json, photo, "face", job->faces[k].name);
            json_integer(&json, photo, "width_px", job->faces[k].camera.width_px);
            json_integer(&json, photo, "height_px", job->faces[k].camera.height_px);
        }
        json_number(&json, station, "seconds", job->seconds);
    }
    enum st st = json_write(&json, stdout, err);
    json_fini(&json);
    return st;
}

static enum st write_panorama(const struct scan_job *job, const char *path, struct errctx *err) {
    const struct panorama_options options = {.legend = true, .range_sigma_m = job->used_sigma_m};
    struct image_u8 image = {0};
    enum st st = panorama_render(job->scan.samples, job->scan.count, &options, &image, NULL, err);
    if (!st)
        st = picture_write_png(path, &image, err);
    image_u8_destroy(&image);
    return st;
}

static enum st store_all(struct site *site, const struct scan_job *jobs, int64_t *ids, size_t count,
                         struct errctx *err) {
    enum st st = site_begin(site, err);
    if (st)
        return st;
    for (size_t i = 0; !st && i < count; i++)
        st = scan_job_store(site, &jobs[i], &ids[i], err);
    if (st)
        site_rollback(site);
    else
        st = site_commit(site, err);
    return st;
}

/* Everything is read, found and drawn before the site is touched. */
static enum st import_all(const char *path, struct scan_job *jobs, int64_t *ids, size_t count,
                          const char *panorama, struct errctx *err) {
    struct site *site = NULL;
    struct progress progress;
    enum st st = app_site_open(path, SITE_WRITE, "import", &site, err);
    progress_init(&progress, stderr, "import", (int64_t)count, "scans");
    for (size_t i = 0; !st && i < count; i++) {
        st = scan_job_prepare(&jobs[i], err);
        progress_add(&progress, 1);
    }
    progress_fini(&progress, false);
    if (!st)
        st = scan_job_check_names(site, jobs, count, err);
    if (!st && panorama)
        st = write_panorama(&jobs[0], panorama, err);
    if (!st)
        st = store_all(site, jobs, ids, count, err);
    const enum st closed = site_close(site, st ? NULL : err);
    return st ? st : closed;
}

static int run(const char *path, struct scan_job *jobs, size_t count, const char *panorama,
               bool json) {
    struct errctx err = {0};
    int64_t *ids = calloc(count, sizeof *ids);
    enum st st = ids ? import_all(path, jobs, ids, count, panorama, &err)
                     : errctx_set(&err, ST_NOMEM, "no memory for %zu scans", count);
    if (!st && json)
        st = print_json(jobs, ids, count, &err);
    for (size_t i = 0; !st && !json && i < count; i++)
        print_text(&jobs[i]);
    for (size_t i = 0; i < count; i++)
        scan_job_fini(&jobs[i]);
    free(ids);
    return st ? app_fail("import scan", &err) : APP_DONE;
}

/* The files named on the command line. */
static int run_files(const char *path, const struct arguments *a, poptContext context, bool json) {
    size_t count = 0;
    struct scan_job *jobs = NULL;
    int status = APP_DONE;
    for (const char *file = poptGetArg(context); file && !status; file = poptGetArg(context)) {
        struct scan_job *more =
            count < IMPORT_LIST_MAX ? realloc(jobs, (count + 1) * sizeof *jobs) : NULL;
        if (!more) {
            status = app_usage_error("import scan", "more scans than fit into one call");
            break;
        }
        jobs = more;
        status = fill_job(a, file, &jobs[count]);
        count += status == APP_DONE;
    }
    if (!status && count == 0)
        status = app_usage_error("import scan", "give the scans to import");
    else if (!status && a->name && count > 1)
        status = app_usage_error("import scan", "--name is for one scan");
    else if (!status)
        status = run(path, jobs, count, a->panorama, json);
    free(jobs);
    return status;
}

static int run_list(const char *path, const struct arguments *a, bool json) {
    struct errctx err = {0};
    struct scan_job *jobs = NULL;
    size_t count = 0;
    if (import_list_scans(a->list, &jobs, &count, &err))
        return app_fail("import scan", &err);
    for (size_t i = 0; i < count; i++)
        jobs[i].no_photos = a->no_photos != 0;
    const int status = run(path, jobs, count, a->panorama, json);
    free(jobs);
    return status;
}

int cmd_import_scan(int argc, const char **argv) {
    struct arguments a = {0};
    bool json = false;
    const struct poptOption options[] = {
        {"list", 0, POPT_ARG_STRING, &a.list, 0, "many scans, described in YAML", "FILE"},
        {"name", 'n', POPT_ARG_STRING, &a.name, 0, "of the station (the file's)", "TEXT"},
        {"pose", 0, POPT_ARG_STRING, &a.pose, 0, ".pose or .conf with the pose", "FILE"},
        {"conf", 0, POPT_ARG_STRING, &a.pose, 0, "the same", "FILE"},
        {"up", 0, POPT_ARG_STRING, &a.up, 0, "PLY: the axis that is up: z, y or -y (z)", "AXIS"},
        {"unit-m", 0, POPT_ARG_DOUBLE, &a.unit_m, 0, "PLY: length of its unit (1)", "M"},
        {"standoff-m", 0, POPT_ARG_DOUBLE, &a.standoff_m, 0,
         "PLY: eye to the middle of the samples (ten times their extent)", "M"},
        {"no-return-m", 0, POPT_ARG_DOUBLE, &a.no_return_m, 0, ".3d: what means none (32.767)",
         "M"},
        {"range-sigma-m", 0, POPT_ARG_DOUBLE, &a.range_sigma_m, 0, "noise of one range", "M"},
        {"no-photos", 0, POPT_ARG_NONE, &a.no_photos, 0, "store the samples alone", NULL},
        {"panorama", 0, POPT_ARG_STRING, &a.panorama, 0, "also a picture of the first scan", "PNG"},
        POPT_TABLEEND};
    struct app_usage usage = {.name = "import scan",
                              .synopsis = "SITE FILE-OR-FOLDER... [options]\n"
                                          "   or: scancart import scan SITE --list FILE",
                              .about = about,
                              .options = options,
                              .out_json = &json};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st) {
        app_free_options(options);
        return app_parse_exit(st);
    }
    const char *path = poptGetArg(context);
    int status = APP_DONE;
    if (!path)
        status = app_usage_error("import scan", "give a site");
    else if (a.list)
        status = poptPeekArg(context) ? app_usage_error("import scan", "--list or files, not both")
                                      : run_list(path, &a, json);
    else
        status = run_files(path, &a, context, json);
    (void)poptFreeContext(context);
    app_free_options(options);
    return status;
}
