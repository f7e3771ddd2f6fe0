#include "app/cmd_twin.h"

#include "app/app.h"
#include "app/app_site.h"
#include "base/clock.h"
#include "base/json.h"
#include "twin/twin_scan.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char about[] = "Scans a scene with the simulated cart into a site: the site then "
                            "holds what a real cart's would, and a folder "
                            "beside it, if wanted, the truth. SCENE is a name of `scancart twin "
                            "list`, or a mesh file (.obj, .ply; metres, z up). "
                            "SITE is made if it is not there.\n\n"
                            "Quality: preview is quick (12 pan steps a mirror revolution, 1 ray a "
                            "sample), field has the density of the UNC cart "
                            "(4 steps, 4 rays), survey is denser (3 steps, 8 rays).\n\n"
                            "Example: scancart twin scan accident my-site --quality preview "
                            "--truth my-truth --pictures my-pictures\n"
                            "Example: scancart twin scan room s --at 0,0,0 --set mirror.speed_hz=5 "
                            "--fault mirror_stall@30+1";

struct options {
    char *quality, *config, *truth, *pictures, *stands;
    const char **at, **set, **fault;
    long seed, scene_seed;
    double detail;
    int no_frames, truth_samples;
    bool json;
};

/* "x,y[,yaw in degrees]" */
static enum st parse_at(const char *text, size_t number, struct scene_stand *out_stand,
                        struct errctx *err) {
    double v[3] = {0, 0, 0};
    int count = 0;
    const char *at = text;
    for (; count < 3; count++) {
        char *end = NULL;
        v[count] = strtod(at, &end);
        if (end == at || (*end != ',' && *end))
            return errctx_set(err, ST_INVALID, "--at '%s' is not X,Y[,YAW] (metres, degrees)",
                              text);
        at = *end ? end + 1 : end;
        if (!*end) {
            count++;
            break;
        }
    }
    if (count < 2 || *at || !(fabs(v[0]) < 1e4 && fabs(v[1]) < 1e4 && fabs(v[2]) <= 360))
        return errctx_set(err, ST_INVALID, "--at '%s' is not X,Y[,YAW] (metres, degrees)", text);
    memset(out_stand, 0, sizeof *out_stand);
    (void)snprintf(out_stand->name, sizeof out_stand->name, "at-%zu", number + 1);
    out_stand->position_m = vec3_make(v[0], v[1], 0);
    out_stand->yaw_rad = v[2] * 3.14159265358979323846 / 180;
    return ST_OK;
}

/* Which stands: --at, else the names or the number in --stands, else all of the scene. */
static enum st choose_stands(const struct options *o, const struct scene *scene,
                             struct scene_stand out_stands[SCENE_MAX_STANDS], size_t *out_count,
                             struct errctx *err) {
    size_t count = 0;
    for (size_t i = 0; o->at && o->at[i]; i++) {
        enum st st = count < SCENE_MAX_STANDS
                         ? parse_at(o->at[i], i, &out_stands[count++], err)
                         : errctx_set(err, ST_INVALID, "more than %d stands", SCENE_MAX_STANDS);
        if (st)
            return st;
    }
    char *end = NULL;
    long number = o->stands ? strtol(o->stands, &end, 10) : (long)scene->stand_count;
    bool by_number = !o->stands || (end != o->stands && !*end);
    for (size_t i = 0; !o->at && i < scene->stand_count; i++) {
        const char *name = scene->stand[i].name,
                   *found = o->stands ? strstr(o->stands, name) : NULL;
        size_t length = strlen(name);
        bool named = found && (found == o->stands || found[-1] == ',') &&
                     (found[length] == ',' || !found[length]);
        if (by_number ? (long)i < number : named)
            out_stands[count++] = scene->stand[i];
    }
    *out_count = count;
    return count ? ST_OK
                 : errctx_set(err, ST_NOT_FOUND, "--stands '%s': %s has %zu stands, from '%s' on",
                              o->stands ? o->stands : "", scene->name, scene->stand_count,
                              scene->stand_count ? scene->stand[0].name : "");
}

static enum st configure(const struct options *o, struct twin_config *config, struct faults *faults,
                         struct errctx *err) {
    static const char *const names[] = {"preview", "field", "survey"};
    enum st st = o->config ? twin_config_load(o->config, config, err) : ST_OK;
    if (st)
        return st;
    int quality = -1;
    for (int i = 0; i < 3; i++)
        quality = o->quality && !strcmp(o->quality, names[i]) ? i : quality;
    if (o->quality && quality < 0)
        return errctx_set(err, ST_INVALID, "--quality '%s' is none of preview, field, survey",
                          o->quality);
    if (quality >= 0)
        twin_config_set_quality(config, (enum twin_config_quality)quality);
    for (size_t i = 0; o->set && o->set[i] && !st; i++)
        st = twin_config_set(config, o->set[i], err);
    for (size_t i = 0; o->fault && o->fault[i] && !st; i++)
        st = faults_parse(faults, o->fault[i], err);
    return st;
}

static void print_text(const struct twin_scan *scan, const struct twin_scan_stand *stands,
                       const char *path, double took_s) {
    uint64_t samples = 0, bytes = 0;
    (void)printf("%s: %s, %zu stand%s, %.1f s\n", path, scan->scene->name, scan->stand_count,
                 scan->stand_count == 1 ? "" : "s", took_s);
    for (size_t i = 0; i < scan->stand_count; i++) {
        const struct twin_scan_stand *s = &stands[i];
        char size[APP_SITE_TEXT_MAX];
        (void)printf(
            "  %-10s %.1f M samples in %.0f s of cart time, %s; %.1f x %.1f samples/deg; %llu "
            "photographs\n",
            s->name, (double)s->samples * 1e-6, s->sweep_s, app_site_bytes((int64_t)s->bytes, size),
            s->samples_a_deg_mirror, s->samples_a_deg_pan, (unsigned long long)s->frames);
        (void)printf(
            "  %-10s %.1f %% returned, %.1f %% no return, %.2f %% dropped, %.2f %% mixed; range "
            "error %+.2f +- %.2f mm\n",
            "", 100 * (double)s->returns / ((double)s->samples + 1e-9),
            100 * (double)s->no_returns / ((double)s->samples + 1e-9),
            100 * (double)s->dropped / ((double)s->samples + 1e-9),
            100 * (double)s->mixed / ((double)s->samples + 1e-9), s->error_mean_m * 1000,
            s->error_sigma_m * 1000);
        samples += s->samples;
        bytes += s->bytes;
    }
    (void)bytes;
    (void)printf("  %.2f M samples/s\n", (double)samples / took_s * 1e-6);
}

static enum st print_json(const struct twin_scan *scan, const struct twin_scan_stand *stands,
                          const char *path, double took_s, struct errctx *err) {
    struct json json;
    json_init_object(&json);
    json_text(&json, NULL, "site", path);
    json_text(&json, NULL, "scene", scan->scene->name);
    json_integer(&json, NULL, "seed", (int64_t)scan->seed);
    json_number(&json, NULL, "took_s", took_s);
    struct cJSON *list = json_array(&json, NULL, "stands");
    for (size_t i = 0; i < scan->stand_count; i++) {
        const struct twin_scan_stand *s = &stands[i];
        struct cJSON *o = json_object(&json, list, NULL);
        json_text(&json, o, "name", s->name);
        json_integer(&json, o, "samples", (int64_t)s->samples);
        json_integer(&json, o, "returns", (int64_t)s->returns);
        json_integer(&json, o, "no_returns", (int64_t)s->no_returns);
        json_integer(&json, o, "dropped", (int64_t)s->dropped);
        json_integer(&json, o, "mixed", (int64_t)s->mixed);
        json_integer(&json, o, "packets", (int64_t)s->packets);
        json_integer(&json, o, "bytes", (int64_t)s->bytes);
        json_integer(&json, o, "frames", (int64_t)s->frames);
        json_number(&json, o, "sweep_s", s->sweep_s);
        json_number(&json, o, "mirror_hz", s->mirror_hz);
        json_number(&json, o, "samples_a_deg_mirror", s->samples_a_deg_mirror);
        json_number(&json, o, "samples_a_deg_pan", s->samples_a_deg_pan);
        json_number(&json, o, "range_error_mean_m", s->error_mean_m);
        json_number(&json, o, "range_error_sigma_m", s->error_sigma_m);
    }
    enum st st = json_write(&json, stdout, err);
    json_fini(&json);
    return st;
}

/* Opens the site, or makes it. The simulated day is fixed, so that the same scan gives the same
 * bytes. */
static enum st open_site(const char *path, struct site **out_site, struct errctx *err) {
    const int64_t simulated_utc_ns = 1767258000000000000; /* 2026-01-01 09:00 UTC */
    struct site_info info;
    memset(&info, 0, sizeof info);
    enum st st = site_open(path, SITE_WRITE, out_site, err);
    if (st == ST_NOT_FOUND)
        st = site_create(path, &info, out_site, err);
    if (st)
        return st;
    app_site_set_actor(*out_site, "twin scan");
    site_set_clock(*out_site, simulated_utc_ns);
    return ST_OK;
}

static enum st run_scan(const struct options *o, struct twin_scan *scan, const char *path,
                        struct errctx *err) {
    struct site *site = NULL;
    struct twin_scan_stand stands[SCENE_MAX_STANDS];
    memset(stands, 0, sizeof stands);
    enum st st = open_site(path, &site, err);
    if (st)
        return st;
    struct progress progress;
    progress_init(&progress, stderr, "scanning", twin_scan_duration_ms(scan), "ms");
    scan->progress = &progress;
    int64_t start_ns = clock_now_ns();
    st = twin_scan_run(scan, site, stands, err);
    double took_s = (double)(clock_now_ns() - start_ns) * 1e-9;
    progress_fini(&progress, false);
    enum st closed = site_close(site, st ? NULL : err);
    st = st ? st : closed;
    if (st)
        return st;
    if (o->json)
        return print_json(scan, stands, path, took_s, err);
    print_text(scan, stands, path, took_s);
    return ST_OK;
}

static enum st run(const struct options *o, const char *scene_name, const char *path,
                   struct errctx *err) {
    static struct faults faults;
    struct twin_config config = twin_config_default();
    struct scene *scene = NULL;
    struct scene_stand stands[SCENE_MAX_STANDS];
    size_t stand_count = 0;
    enum st st = configure(o, &config, &faults, err);
    if (!st)
        st = cmd_twin_scene(scene_name, o->scene_seed, o->detail, &scene, err);
    if (!st)
        st = choose_stands(o, scene, stands, &stand_count, err);
    if (!st) {
        struct twin_scan scan = {.scene = scene,
                                 .config = &config,
                                 .faults = &faults,
                                 .stands = stands,
                                 .stand_count = stand_count,
                                 .seed = (uint64_t)o->seed,
                                 .frames = !o->no_frames,
                                 .truth_dir = o->truth,
                                 .truth_samples = o->truth_samples,
                                 .pictures_dir = o->pictures};
        st = run_scan(o, &scan, path, err);
    }
    scene_destroy(scene);
    return st;
}

int cmd_twin_scan(int argc, const char **argv) {
    struct options o = {.seed = 1, .scene_seed = 1, .detail = 1};
    const struct poptOption options[] = {
        {"quality", 'q', POPT_ARG_STRING, &o.quality, 0, "preview, field (default) or survey",
         "NAME"},
        {"stands", 0, POPT_ARG_STRING, &o.stands, 0,
         "the first N stands of the scene, or names: a,c", "N"},
        {"at", 0, POPT_ARG_ARGV, &o.at, 0,
         "a stand of your own (repeat for more), metres and degrees", "X,Y,YAW"},
        {"seed", 0, POPT_ARG_LONG, &o.seed, 0, "of noise and chance (1)", "N"},
        {"scene-seed", 0, POPT_ARG_LONG, &o.scene_seed, 0, "of the scene (1)", "N"},
        {"detail", 0, POPT_ARG_DOUBLE, &o.detail, 0, "of the scene, 0.1 to 1 (1)", "PART"},
        {"config", 'c', POPT_ARG_STRING, &o.config, 0, "parameters, see `scancart twin config`",
         "FILE"},
        {"set", 0, POPT_ARG_ARGV, &o.set, 0, "one parameter (repeat for more)", "KEY=VALUE"},
        {"fault", 0, POPT_ARG_ARGV, &o.fault, 0, "let a fault loose (repeat for more)",
         "NAME@T[+D][=V]"},
        {"truth", 0, POPT_ARG_STRING, &o.truth, 0,
         "keep the truth in this folder, outside the site", "DIR"},
        {"truth-samples", 0, POPT_ARG_NONE, &o.truth_samples, 0,
         "keep it for every sample (40 bytes each)", NULL},
        {"pictures", 0, POPT_ARG_STRING, &o.pictures, 0, "draw panoramas and photographs", "DIR"},
        {"no-frames", 0, POPT_ARG_NONE, &o.no_frames, 0, "take no photographs", NULL},
        POPT_TABLEEND};
    struct app_usage usage = {.name = "twin scan",
                              .synopsis = "SCENE SITE [options] [--json]",
                              .about = about,
                              .options = options,
                              .out_json = &o.json};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st)
        return app_parse_exit(st);
    const char *scene = poptGetArg(context), *path = scene ? poptGetArg(context) : NULL;
    struct errctx err = {0};
    int status;
    if (!path || poptPeekArg(context))
        status = app_usage_error("twin scan", "give a scene and a site folder");
    else if (o.truth_samples && !o.truth)
        status = app_usage_error("twin scan", "--truth-samples needs --truth");
    else
        status = run(&o, scene, path, &err) ? app_fail("twin scan", &err) : APP_DONE;
    (void)poptFreeContext(context);
    app_free_options(options);
    return status;
}
