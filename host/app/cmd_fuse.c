#include "app/app.h"
#include "app/app_site.h"
#include "app/commands.h"
#include "app/fuse_report.h"
#include "app/fuse_settings.h"
#include "base/clock.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_STATIONS = 4096 };

static const char about[] =
    "Makes 3D photographs of all samples of a site, finds out which surfaces are only "
    "seeming (skins), leaves out what is shown twice, and packs the tiles that the viewer streams. "
    "What is up to date is not made again.\n\n"
    "--quality preview: half the resolution, no comparison of stands: while the crew waits. field: "
    "one "
    "pixel a sample, tiles to 1 mm at 6 m. survey: finer pixels, tiles to 0.5 mm.\n\n"
    "Examples:\n"
    "  scancart fuse mysite\n"
    "  scancart fuse mysite --quality preview --json\n"
    "  scancart fuse mysite --calibration nominal --error-mm 2";

struct arguments {
    char *quality, *calibration;
    double error_mm, threshold, pose_sigma_mm;
    int faces;
};

static int settings_of(const struct arguments *a, struct fuse_settings *out) {
    enum fuse_quality quality = FUSE_FIELD;
    if (a->quality && !fuse_settings_parse(a->quality, &quality))
        return app_usage_error("fuse", "--quality %s: preview, field or survey", a->quality);
    *out = fuse_settings_make(quality);
    if (a->calibration) {
        static const enum calib_status all[] = {CALIB_NOMINAL, CALIB_ESTIMATED, CALIB_TRUE};
        for (size_t i = 0; i < sizeof all / sizeof all[0]; i++)
            if (!strcmp(a->calibration, fuse_source_status_name(all[i])))
                out->calibration = all[i];
        if (!out->calibration)
            return app_usage_error("fuse", "--calibration %s: nominal, estimated or true",
                                   a->calibration);
    }
    if (a->error_mm != 0) {
        if (!(a->error_mm > 0 && a->error_mm <= 1000))
            return app_usage_error("fuse", "--error-mm %g: more than 0, at most 1000", a->error_mm);
        out->pack.error_m = a->error_mm / 1000;
    }
    if (a->threshold != -1) {
        if (!(a->threshold >= 0 && a->threshold <= 100))
            return app_usage_error("fuse", "--threshold %g: 0 to 100", a->threshold);
        out->cull.threshold = a->threshold;
    }
    if (!(a->pose_sigma_mm >= 0 && a->pose_sigma_mm <= 1e4))
        return app_usage_error("fuse", "--pose-sigma-mm %g: 0 to 10000", a->pose_sigma_mm);
    out->pose_sigma_m = a->pose_sigma_mm / 1000;
    out->faces_always = a->faces != 0;
    return 0;
}

struct run {
    struct site *site;
    struct fuse_station *stations;
    struct station *rows;
    size_t station_count;
    struct fuse_photos photos;
    struct fuse_skins_result skins;
    struct fuse_tiles_result tiles;
};

static enum st list_stations(struct run *r, struct errctx *err) {
    r->rows = calloc(MAX_STATIONS, sizeof *r->rows);
    r->stations = calloc(MAX_STATIONS, sizeof *r->stations);
    if (!r->rows || !r->stations)
        return errctx_set(err, ST_NOMEM, "no memory for the stations");
    enum st st = station_list(r->site, 0, r->rows, MAX_STATIONS, &r->station_count, err);
    if (!st && !r->station_count)
        st = errctx_set(err, ST_NOT_FOUND, "%s has no stations: scan or import something first",
                        site_path(r->site));
    return st;
}

static enum st work(struct run *r, const struct fuse_settings *settings, struct fuse_report *report,
                    struct errctx *err) {
    struct progress bar;
    enum st st = list_stations(r, err);
    progress_init(&bar, stderr, "photographs", 0, "photographs");
    for (size_t i = 0; !st && i < r->station_count; i++)
        st = fuse_photo_station(r->site, &r->rows[i], settings, &r->photos, &r->stations[i], &bar,
                                err);
    progress_fini(&bar, false);
    report->peak_bytes_photos = fuse_report_peak_bytes();
    progress_init(&bar, stderr, "skins", (int64_t)r->photos.count, "photographs");
    if (!st)
        st = fuse_skins(r->site, &r->photos, settings, &r->skins, &bar, err);
    progress_fini(&bar, false);
    report->peak_bytes_skins = fuse_report_peak_bytes();
    progress_init(&bar, stderr, "tiles", 0, "photographs");
    if (!st)
        st = fuse_tiles(r->site, &r->photos, settings, &r->tiles, &bar, err);
    progress_fini(&bar, false);
    report->peak_bytes_tiles = fuse_report_peak_bytes();
    return st;
}

static int run(const char *path, const struct fuse_settings *settings, bool json) {
    struct errctx err = {0};
    struct run r;
    memset(&r, 0, sizeof r);
    struct fuse_report report = {.settings = settings};
    int64_t start_ns = clock_now_ns();
    enum st st = app_site_open(path, SITE_WRITE, "fuse", &r.site, &err);
    if (!st)
        st = work(&r, settings, &report, &err);
    if (r.site) {
        enum st closed = site_close(r.site, st ? NULL : &err);
        st = st ? st : closed;
    }
    report.stations = r.stations;
    report.station_count = r.station_count;
    report.photos = &r.photos;
    report.skins = &r.skins;
    report.tiles = &r.tiles;
    report.seconds = 1e-9 * (double)(clock_now_ns() - start_ns);
    if (!st && json)
        st = fuse_report_json(&report, &err);
    else if (!st)
        fuse_report_text(&report);
    fuse_photos_fini(&r.photos);
    free(r.stations);
    free(r.rows);
    return st ? app_fail("fuse", &err) : APP_DONE;
}

int cmd_fuse(int argc, const char **argv) {
    struct arguments a = {.threshold = -1};
    bool json = false;
    const struct poptOption options[] = {
        {"quality", 'q', POPT_ARG_STRING, &a.quality, 0, "preview, field or survey (field)",
         "NAME"},
        {"calibration", 0, POPT_ARG_STRING, &a.calibration, 0,
         "nominal, estimated or true (the best there is)", "NAME"},
        {"error-mm", 0, POPT_ARG_DOUBLE, &a.error_mm, 0, "error of the tiles up to 6 m (1)", "MM"},
        {"threshold", 0, POPT_ARG_DOUBLE, &a.threshold, 0,
         "how much worse may replace what is shown twice; 0 keeps all (1)", "X"},
        {"pose-sigma-mm", 0, POPT_ARG_DOUBLE, &a.pose_sigma_mm, 0,
         "how well the stations' places are known (as they say themselves)", "MM"},
        {"faces", 0, POPT_ARG_NONE, &a.faces, 0, "cube faces too where there are camera frames",
         NULL},
        POPT_TABLEEND};
    struct app_usage usage = {.name = "fuse",
                              .synopsis = "SITE [options]",
                              .about = about,
                              .options = options,
                              .out_json = &json};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st) {
        free(a.quality);
        free(a.calibration);
        return app_parse_exit(st);
    }
    struct fuse_settings settings;
    const char *path = poptGetArg(context);
    int status = settings_of(&a, &settings);
    if (!status && (!path || poptPeekArg(context)))
        status = app_usage_error("fuse", "give one site");
    if (!status)
        status = run(path, &settings, json);
    (void)poptFreeContext(context);
    free(a.quality);
    free(a.calibration);
    return status;
}
