#include "app/app.h"
#include "app/app_site.h"
#include "app/commands.h"
#include "app/view_window.h"

#include <stdio.h>
#include <stdlib.h>

static const char about[] =
    "Opens a window on a site: its tiles if 'scancart fuse' has made some, else its photographs. "
    "Without OpenGL the portable path draws; with it, the faster of the paths is found by drawing "
    "two frames with each. What nobody has seen is hatched in magenta.\n\n"
    "Mouse: drag turns, right button pans, wheel zooms, a click sets the point to turn around or "
    "measures. Notes and kept views go into SITE.notes.json beside the site. Touch: one finger "
    "turns, two pan, zoom and (in the plan) rotate. Keys: 1 orbit, 2 "
    "walk, 3 fly, 4 plan; W A S D Q E and arrows move; Tab next stand, V next photograph, L layer, "
    "U the unknown, M measure, N note, C clear, K keep this view, R back to a kept one, O "
    "parallel, P primitive, B blend, T theme, I "
    "figures, H home, F12 save, Esc quit.\n\n"
    "Examples:\n"
    "  scancart view mysite\n"
    "  scancart view mysite --cpu --size 1920x1080\n"
    "  scancart view mysite --play tour.txt      input from a file, pictures saved on the way";

struct arguments {
    char *size, *play;
    int cpu, gl, gl31, fullscreen, day, photos, cache_mb;
};

static enum st read_size(const char *text, struct view_window_options *out, struct errctx *err) {
    int w = 0, h = 0;
    char rest = 0;
    if (sscanf(text, "%dx%d%c", &w, &h, &rest) != 2 || w < 1 || h < 1 || w > RASTER_MAX_SIDE_PX ||
        h > RASTER_MAX_SIDE_PX)
        return errctx_set(err, ST_INVALID, "--size '%s' is not WIDTHxHEIGHT", text);
    out->width_px = w;
    out->height_px = h;
    return ST_OK;
}

static int view(const char *path, const struct viewer_options *options,
                const struct view_window_options *window) {
    struct site *site = NULL;
    struct viewer viewer = {0};
    struct errctx err = {0};
    enum st st = app_site_open(path, SITE_READ, "view", &site, &err);
    if (!st)
        st = viewer_open(site, options, &viewer, &err);
    if (!st)
        st = view_window_run(&viewer, window, &err);
    viewer_close(&viewer);
    (void)site_close(site, NULL);
    return st ? app_fail("view", &err) : APP_DONE;
}

static int parsed(poptContext context, const struct arguments *a) {
    const char *path = poptGetArg(context);
    struct errctx err = {0};
    struct view_window_options window = {1280, 720, a->fullscreen, a->play};
    if (!path || poptPeekArg(context))
        return app_usage_error("view", "give one site");
    if (a->cpu + a->gl + a->gl31 > 1)
        return app_usage_error("view", "--cpu, --gl and --gl31 exclude each other");
    if (a->cache_mb < 1)
        return app_usage_error("view", "--cache is at least 1 MB");
    if (a->size && read_size(a->size, &window, &err))
        return app_usage_error("view", "%s", err.text);
    struct viewer_options options = {
        .path = path,
        .kind = a->cpu    ? RENDER_CPU
                : a->gl   ? RENDER_GLES30
                : a->gl31 ? RENDER_GLES31
                          : -1,
        .cache_bytes = (size_t)a->cache_mb << 20,
        .gpu_bytes = (size_t)a->cache_mb << 20,
        .from_photos = a->photos,
        .day = a->day,
    };
    return view(path, &options, &window);
}

int cmd_view(int argc, const char **argv) {
    struct arguments a = {.cache_mb = 256};
    const struct poptOption options[] = {
        {"size", 's', POPT_ARG_STRING, &a.size, 0, "of the window (1280x720)", "WxH"},
        {"fullscreen", 'f', POPT_ARG_NONE, &a.fullscreen, 0, "use the whole screen", NULL},
        {"day", 0, POPT_ARG_NONE, &a.day, 0, "begin with the light theme", NULL},
        {"cpu", 0, POPT_ARG_NONE, &a.cpu, 0, "draw without OpenGL", NULL},
        {"gl", 0, POPT_ARG_NONE, &a.gl, 0, "draw with OpenGL ES 3.0", NULL},
        {"gl31", 0, POPT_ARG_NONE, &a.gl31, 0, "draw with compute shaders", NULL},
        {"photos", 0, POPT_ARG_NONE, &a.photos, 0, "show the photographs, not the tiles", NULL},
        {"cache", 0, POPT_ARG_INT | POPT_ARGFLAG_SHOW_DEFAULT, &a.cache_mb, 0, "memory for tiles",
         "MB"},
        {"play", 0, POPT_ARG_STRING, &a.play, 0, "input from a file, then quit", "FILE"},
        POPT_TABLEEND};
    struct app_usage usage = {
        .name = "view", .synopsis = "SITE [options]", .about = about, .options = options};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st)
        return app_parse_exit(st);
    int status = parsed(context, &a);
    (void)poptFreeContext(context);
    free(a.size);
    free(a.play);
    return status;
}
