#include "app/app.h"
#include "app/app_site.h"
#include "app/commands.h"
#include "app/fuse_report.h"
#include "app/fuse_settings.h"
#include "base/clock.h"

#include <stdlib.h>
#include <string.h>

static const char about[] =
    "Packs the tiles of a fused site again, leaving out more or less of what several photographs "
    "show. A tile goes if each of its samples lies on a surface that another photograph shows, "
    "with "
    "pixels that cover at most THRESHOLD times the area. 0 keeps everything, 1 leaves out only "
    "what "
    "is shown better elsewhere, 2 is aggressive.\n\n"
    "Examples:\n"
    "  scancart cull mysite --threshold 2\n"
    "  scancart cull mysite --threshold 0 --error-mm 5 --json";

static int run(const char *path, const struct fuse_settings *settings, bool json) {
    struct errctx err = {0};
    struct site *site = NULL;
    struct fuse_tiles_result tiles;
    struct fuse_report report = {.settings = settings, .tiles = &tiles};
    struct progress bar;
    memset(&tiles, 0, sizeof tiles);
    int64_t start_ns = clock_now_ns();
    enum st st = app_site_open(path, SITE_WRITE, "cull", &site, &err);
    progress_init(&bar, stderr, "tiles", 0, "photographs");
    if (!st)
        st = fuse_tiles(site, NULL, settings, &tiles, &bar, &err);
    progress_fini(&bar, false);
    if (site) {
        enum st closed = site_close(site, st ? NULL : &err);
        st = st ? st : closed;
    }
    report.seconds = 1e-9 * (double)(clock_now_ns() - start_ns);
    report.peak_bytes_tiles = fuse_report_peak_bytes();
    if (!st && json)
        st = fuse_report_json(&report, &err);
    else if (!st)
        fuse_report_text(&report);
    return st ? app_fail("cull", &err) : APP_DONE;
}

int cmd_cull(int argc, const char **argv) {
    double threshold = 1, error_mm = 1, pose_sigma_mm = 0;
    int drop_frontier = 0;
    bool json = false;
    const struct poptOption options[] = {
        {"threshold", 't', POPT_ARG_DOUBLE, &threshold, 0, "how aggressive: 0 to 100 (1)", "X"},
        {"error-mm", 0, POPT_ARG_DOUBLE, &error_mm, 0, "error of the tiles up to 6 m (1)", "MM"},
        {"pose-sigma-mm", 0, POPT_ARG_DOUBLE, &pose_sigma_mm, 0,
         "how well the stations' places are known (as they say themselves)", "MM"},
        {"drop-frontier", 0, POPT_ARG_NONE, &drop_frontier, 0,
         "also tiles whose skins say what is unknown", NULL},
        POPT_TABLEEND};
    struct app_usage usage = {.name = "cull",
                              .synopsis = "SITE [options]",
                              .about = about,
                              .options = options,
                              .out_json = &json};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st)
        return app_parse_exit(st);
    struct fuse_settings settings = fuse_settings_make(FUSE_FIELD);
    const char *path = poptGetArg(context);
    int status = APP_DONE;
    if (!path || poptPeekArg(context))
        status = app_usage_error("cull", "give one site");
    else if (!(threshold >= 0 && threshold <= 100))
        status = app_usage_error("cull", "--threshold %g: 0 to 100", threshold);
    else if (!(error_mm > 0 && error_mm <= 1000))
        status = app_usage_error("cull", "--error-mm %g: more than 0, at most 1000", error_mm);
    else if (!(pose_sigma_mm >= 0 && pose_sigma_mm <= 1e4))
        status = app_usage_error("cull", "--pose-sigma-mm %g: 0 to 10000", pose_sigma_mm);
    settings.pose_sigma_m = pose_sigma_mm / 1000;
    settings.cull.threshold = threshold;
    settings.cull.keep_frontier = !drop_frontier;
    settings.pack.error_m = error_mm / 1000;
    if (!status)
        status = run(path, &settings, json);
    (void)poptFreeContext(context);
    return status;
}
