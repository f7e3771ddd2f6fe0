#include "app/app.h"
#include "app/app_site.h"
#include "app/cmd_import.h"
#include "base/json.h"
#include "base/progress.h"
#include "import/frame_up.h"
#include "import/import_list.h"
#include "import/photo_job.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double deg = 3.14159265358979323846 / 180.0;

static const char about[] =
    "Makes a 3D photograph of a colour image and a map of the same size: --depth (along the "
    "optical "
    "axis), --range "
    "(along each pixel's ray) or --disparity (of a rectified stereo pair). The map's numbers are "
    "multiplied by "
    "--scale (depths: 0.001, so millimetres; disparities: 1) and --offset is added; 0 and "
    "--unknown mean no value.\n\n"
    "Disparity d stands at Z = f B / d. Without --baseline-m all lengths are in baselines, and the "
    "photograph says "
    "so. A map of whole pixels shows slanted surfaces as stairs: --disparity-step 1 restores what "
    "rounding took, "
    "within half a step of each stored value.\n\n"
    "With distortion coefficients image and map are resampled to a pinhole. The pose takes camera "
    "(x right, y "
    "down, z forward) to world; --up says which axis of that world is up. Without a pose the "
    "camera "
    "is level at "
    "its station and looks along y.\n\n"
    "The confidence comes from the map's step and from a noise model, one standard deviation: for "
    "depths "
    "--sigma-m 0.001 and --sigma-per-m 0.0015 (grows with the square, as with triangulating "
    "cameras), for ranges "
    "0.001 m, for disparities --sigma-px 0.25.\n\n"
    "Examples:\n"
    "  scancart import photo mysite --image left.jpg --disparity left.png --disparity-step 1 "
    "--hfov-deg 40\n"
    "  scancart import photo mysite --image 1.png --depth 1.pgm --fx 518 --fy 519 --cx 325.5 --cy "
    "253.5\n"
    "  scancart import photo mysite --list photos.yaml";

/* What popt fills. */
struct arguments {
    char *list, *image, *depth, *range, *disparity, *name, *station, *pose, *up;
    double fx, fy, cx, cy, k1, k2, p1, p2, k3, hfov_deg;
    double scale, offset, unknown, baseline_m, step, dequantise_step, sigma_m, sigma_per_m,
        sigma_px;
    int replace;
};

static int parse_pose(const char *text, double out_values[7]) {
    for (int i = 0; i < 7; i++) {
        char *end = NULL;
        out_values[i] = strtod(text, &end);
        if (end == text || (*end != (i < 6 ? ',' : '\0')))
            return -1;
        text = end + 1;
    }
    return 0;
}

/* NaN (not given): the default, 0; 0: none, NaN. */
static double sigma(double given) {
    return isnan(given) ? 0.0 : given > 0.0 ? given : (double)NAN;
}

static struct photo_import_map map_values(const struct arguments *a) {
    struct photo_import_map v = {.kind = a->depth   ? PHOTO_IMPORT_DEPTH
                                         : a->range ? PHOTO_IMPORT_RANGE
                                                    : PHOTO_IMPORT_DISPARITY,
                                 .scale = a->scale,
                                 .offset = a->offset,
                                 .unknown = a->unknown,
                                 .baseline_m = a->baseline_m,
                                 .step = a->dequantise_step > 0.0 ? a->dequantise_step : a->step,
                                 .dequantise = a->dequantise_step > 0.0,
                                 .sigma_m = sigma(a->sigma_m),
                                 .sigma_per_m = sigma(a->sigma_per_m),
                                 .sigma_px = sigma(a->sigma_px)};
    return v;
}

/* The one job of the command line. 0, or an exit status after a printed usage error. */
static int fill_job(const struct arguments *a, struct photo_job *job) {
    const char *map = a->depth ? a->depth : a->range ? a->range : a->disparity;
    const int maps = (a->depth != NULL) + (a->range != NULL) + (a->disparity != NULL);
    struct errctx err = {0};
    enum frame_up up = FRAME_UP_Z;
    double pose[7];
    if (!a->image || maps != 1)
        return app_usage_error("import photo",
                               "give --image and one of --depth, --range, --disparity");
    if (!(a->fx > 0.0) && !(a->hfov_deg > 0.0))
        return app_usage_error("import photo", "give the camera: --fx in pixels, or --hfov-deg");
    if (a->up && frame_up_parse(a->up, &up, &err))
        return app_usage_error("import photo", "--up: %s", err.text);
    *job = photo_job_default();
    if (a->pose &&
        (parse_pose(a->pose, pose) || frame_up_pose(pose, up, &job->world_from_cam, &err)))
        return app_usage_error("import photo", "--pose is not x,y,z,qx,qy,qz,qw");
    job->has_pose = a->pose != NULL;
    job->camera = (struct camera){.fx_px = a->fx,
                                  .fy_px = a->fy,
                                  .cx_px = a->cx,
                                  .cy_px = a->cy,
                                  .k1 = a->k1,
                                  .k2 = a->k2,
                                  .p1 = a->p1,
                                  .p2 = a->p2,
                                  .k3 = a->k3};
    job->hfov_rad = a->hfov_deg * deg;
    job->values = map_values(a);
    job->replace = a->replace != 0;
    int status = app_take_text("import photo", a->name, job->name, sizeof job->name);
    if (!status)
        status = app_take_text("import photo", a->station, job->station, sizeof job->station);
    if (!status)
        status = app_take_text("import photo", a->image, job->image_path, sizeof job->image_path);
    if (!status)
        status = app_take_text("import photo", map, job->map_path, sizeof job->map_path);
    return status;
}

static void print_text(const struct photo_job *job) {
    const struct photo_import_result *r = &job->result;
    const double pixels = (double)job->made_camera.width_px * job->made_camera.height_px;
    const char *unit = r->relative ? "baselines" : "m";
    (void)printf("%s at station %s: %d x %d pixels, %.1f %% with a surface, %.3g to %.3g %s away\n",
                 job->name, job->station, job->made_camera.width_px, job->made_camera.height_px,
                 100.0 * (double)r->known_pixels / pixels, r->nearest_m, r->farthest_m, unit);
    if (r->relative)
        (void)printf("  the baseline is not known: lengths are in baselines\n");
    if (r->undistorted)
        (void)printf("  undistorted; %lld pixels lie outside the image\n",
                     (long long)r->unseen_pixels);
    if (job->values.dequantise)
        (void)printf("  restored from steps of %g, now good to %.3g rms\n", job->values.step,
                     r->rounding_sigma);
}

static enum st print_json(const struct photo_job *jobs, const int64_t *ids, size_t count,
                          struct errctx *err) {
    struct json json;
    json_init_object(&json);
    struct cJSON *photos = json_array(&json, NULL, "photos");
    for (size_t i = 0; i < count; i++) {
        const struct photo_import_result *r = &jobs[i].result;
        struct cJSON *photo = json_object(&json, photos, NULL);
        json_integer(&json, photo, "id", ids[i]);
        json_text(&json, photo, "name", jobs[i].name);
        json_text(&json, photo, "station", jobs[i].station);
        json_integer(&json, photo, "width_px", jobs[i].made_camera.width_px);
        json_integer(&json, photo, "height_px", jobs[i].made_camera.height_px);
        json_number(&json, photo, "fx_px", jobs[i].made_camera.fx_px);
        json_text(&json, photo, "length_unit", r->relative ? "baseline" : "m");
        json_boolean(&json, photo, "undistorted", r->undistorted);
        json_boolean(&json, photo, "dequantised", jobs[i].values.dequantise);
        json_integer(&json, photo, "known_pixels", r->known_pixels);
        json_integer(&json, photo, "unknown_pixels", r->unknown_pixels);
        json_integer(&json, photo, "unseen_pixels", r->unseen_pixels);
        json_number(&json, photo, "nearest", r->nearest_m);
        json_number(&json, photo, "farthest", r->farthest_m);
        json_integer(&json, photo, "file_bytes", (int64_t)jobs[i].tiff_size);
        json_number(&json, photo, "seconds", jobs[i].seconds);
    }
    enum st st = json_write(&json, stdout, err);
    json_fini(&json);
    return st;
}

static enum st store_all(struct site *site, struct photo_job *jobs, int64_t *ids, size_t count,
                         struct errctx *err) {
    enum st st = site_begin(site, err);
    if (st)
        return st;
    for (size_t i = 0; !st && i < count; i++)
        st = photo_job_store(site, &jobs[i], &ids[i], err);
    if (st)
        site_rollback(site);
    else
        st = site_commit(site, err);
    return st;
}

/* Everything is read and made before the site is touched. */
static enum st import_all(const char *path, struct photo_job *jobs, int64_t *ids, size_t count,
                          struct errctx *err) {
    struct site *site = NULL;
    struct progress progress;
    enum st st = app_site_open(path, SITE_WRITE, "import", &site, err);
    if (!st)
        st = photo_job_resolve(site, jobs, count, err);
    progress_init(&progress, stderr, "import", (int64_t)count, "photographs");
    for (size_t i = 0; !st && i < count; i++) {
        st = photo_job_prepare(&jobs[i], err);
        progress_add(&progress, 1);
    }
    progress_fini(&progress, false);
    if (!st)
        st = store_all(site, jobs, ids, count, err);
    const enum st closed = site_close(site, st ? NULL : err);
    return st ? st : closed;
}

static int run(const char *path, struct photo_job *jobs, size_t count, bool json) {
    struct errctx err = {0};
    int64_t *ids = calloc(count, sizeof *ids);
    enum st st = ids ? import_all(path, jobs, ids, count, &err)
                     : errctx_set(&err, ST_NOMEM, "no memory for %zu photographs", count);
    if (!st && json)
        st = print_json(jobs, ids, count, &err);
    for (size_t i = 0; !st && !json && i < count; i++)
        print_text(&jobs[i]);
    for (size_t i = 0; i < count; i++)
        photo_job_fini(&jobs[i]);
    free(ids);
    return st ? app_fail("import photo", &err) : APP_DONE;
}

static int run_list(const char *path, const struct arguments *a, bool json) {
    struct errctx err = {0};
    struct photo_job *jobs = NULL;
    size_t count = 0;
    if (import_list_photos(a->list, &jobs, &count, &err))
        return app_fail("import photo", &err);
    for (size_t i = 0; i < count; i++)
        jobs[i].replace = a->replace != 0;
    const int status = run(path, jobs, count, json);
    free(jobs);
    return status;
}

static int run_arguments(const char *path, const struct arguments *a, bool json) {
    if (a->list)
        return a->image || a->depth || a->range || a->disparity
                   ? app_usage_error("import photo", "--list stands for --image and the rest")
                   : run_list(path, a, json);
    struct photo_job *job = calloc(1, sizeof *job);
    if (!job)
        return app_usage_error("import photo", "out of memory");
    const int status = fill_job(a, job);
    const int done = status ? status : run(path, job, 1, json);
    free(job);
    return done;
}

int cmd_import_photo(int argc, const char **argv) {
    struct arguments a = {
        .cx = NAN, .cy = NAN, .sigma_m = NAN, .sigma_per_m = NAN, .sigma_px = NAN};
    bool json = false;
    const struct poptOption options[] = {
        {"list", 0, POPT_ARG_STRING, &a.list, 0, "many photographs, described in YAML", "FILE"},
        {"image", 0, POPT_ARG_STRING, &a.image, 0, "colour image: PNG, JPEG, PPM", "FILE"},
        {"depth", 0, POPT_ARG_STRING, &a.depth, 0, "depth map: PNG, PGM, PFM", "FILE"},
        {"range", 0, POPT_ARG_STRING, &a.range, 0, "map of ranges along the rays", "FILE"},
        {"disparity", 0, POPT_ARG_STRING, &a.disparity, 0, "disparity map", "FILE"},
        {"disparity-step", 0, POPT_ARG_DOUBLE, &a.dequantise_step, 0,
         "the disparities are multiples of this (stored units): restore what rounding took", "S"},
        {"scale", 0, POPT_ARG_DOUBLE, &a.scale, 0, "m or px a stored unit (0.001; 1)", "X"},
        {"offset", 0, POPT_ARG_DOUBLE, &a.offset, 0, "m or px to add", "X"},
        {"unknown", 0, POPT_ARG_DOUBLE, &a.unknown, 0, "stored value without meaning (0)", "X"},
        {"step", 0, POPT_ARG_DOUBLE, &a.step, 0, "step of the stored values (1 for integers)", "X"},
        {"baseline-m", 0, POPT_ARG_DOUBLE, &a.baseline_m, 0, "of the stereo pair", "M"},
        {"fx", 0, POPT_ARG_DOUBLE, &a.fx, 0, "focal length, px", "PX"},
        {"fy", 0, POPT_ARG_DOUBLE, &a.fy, 0, "focal length along y (fx)", "PX"},
        {"cx", 0, POPT_ARG_DOUBLE, &a.cx, 0, "principal point (the middle)", "PX"},
        {"cy", 0, POPT_ARG_DOUBLE, &a.cy, 0, "principal point (the middle)", "PX"},
        {"hfov-deg", 0, POPT_ARG_DOUBLE, &a.hfov_deg, 0, "field of view in place of --fx", "DEG"},
        {"k1", 0, POPT_ARG_DOUBLE, &a.k1, 0, "radial distortion (Brown)", "X"},
        {"k2", 0, POPT_ARG_DOUBLE, &a.k2, 0, "radial distortion", "X"},
        {"p1", 0, POPT_ARG_DOUBLE, &a.p1, 0, "tangential distortion", "X"},
        {"p2", 0, POPT_ARG_DOUBLE, &a.p2, 0, "tangential distortion", "X"},
        {"k3", 0, POPT_ARG_DOUBLE, &a.k3, 0, "radial distortion", "X"},
        {"sigma-m", 0, POPT_ARG_DOUBLE, &a.sigma_m, 0, "noise of depths and ranges; 0: none", "M"},
        {"sigma-per-m", 0, POPT_ARG_DOUBLE, &a.sigma_per_m, 0, "noise that grows as Z^2", "X"},
        {"sigma-px", 0, POPT_ARG_DOUBLE, &a.sigma_px, 0, "noise of disparities; 0: none", "PX"},
        {"name", 'n', POPT_ARG_STRING, &a.name, 0, "of the photograph (the image's)", "TEXT"},
        {"station", 0, POPT_ARG_STRING, &a.station, 0, "made if new (the photograph's)", "TEXT"},
        {"pose", 0, POPT_ARG_STRING, &a.pose, 0, "camera to world", "X,Y,Z,QX,QY,QZ,QW"},
        {"up", 0, POPT_ARG_STRING, &a.up, 0, "axis of the pose's world: z, y or -y (z)", "AXIS"},
        {"replace", 0, POPT_ARG_NONE, &a.replace, 0, "replace a photograph of that name", NULL},
        POPT_TABLEEND};
    struct app_usage usage = {.name = "import photo",
                              .synopsis = "SITE --image FILE (--depth|--range|--disparity) FILE "
                                          "(--fx PX|--hfov-deg DEG) [options]\n"
                                          "   or: scancart import photo SITE --list FILE",
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
    const int status = !path || poptPeekArg(context)
                           ? app_usage_error("import photo", "give one site")
                           : run_arguments(path, &a, json);
    (void)poptFreeContext(context);
    app_free_options(options);
    return status;
}
