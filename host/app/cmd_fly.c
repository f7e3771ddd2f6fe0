#include "app/app.h"
#include "app/app_site.h"
#include "app/commands.h"
#include "app/viewer.h"
#include "base/clock.h"
#include "base/fileio.h"
#include "base/json.h"
#include "base/picture.h"

#include <limits.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

static const char about[] =
    "Flies through a site, past the views of its photographs in their order, and saves every "
    "picture: numbered PNG files in a folder, or an MP4 film if the name ends in .mp4 (through "
    "ffmpeg, which must be installed). With --live it draws as the window does while the eye "
    "moves, "
    "for so many seconds of real time, and says how long frames took; -o is then not needed.\n\n"
    "Examples:\n"
    "  scancart fly mysite -o flight/ --seconds 10\n"
    "  scancart fly mysite -o flight.mp4 --size 1920x1080 --fps 30\n"
    "  scancart fly mysite --live --seconds 20 --cache 64 --json";

struct arguments {
    char *out, *size;
    double seconds, fps;
    int cpu, gl, gl31, day, cache_mb, unknown, live;
    bool json;
};

struct flight {
    const struct arguments *args;
    struct image_u8 im;
    FILE *film; /* NULL: PNG files */
    int frames;
    int64_t start_ns; /* the command began */
};

static bool is_film(const char *path) {
    size_t n = strlen(path);
    return n > 4 && !strcmp(path + n - 4, ".mp4");
}

/* A word for the shell: the path in single quotes. */
static enum st quote(const char *path, char out[2 * FILEIO_PATH_MAX], struct errctx *err) {
    size_t n = 0, room = 2 * FILEIO_PATH_MAX - 8;
    out[n++] = '\'';
    for (; *path && n < room; path++) {
        if (*path == '\'') {
            memcpy(out + n, "'\\''", 4);
            n += 4;
        } else {
            out[n++] = *path;
        }
    }
    out[n++] = '\'';
    out[n] = '\0';
    return *path ? errctx_set(err, ST_INVALID, "the film's name is too long") : ST_OK;
}

static enum st open_film(struct flight *f, struct errctx *err) {
    char name[2 * FILEIO_PATH_MAX], command[3 * FILEIO_PATH_MAX];
    enum st st = quote(f->args->out, name, err);
    if (st)
        return st;
    if (system("command -v ffmpeg >/dev/null 2>&1") != 0)
        return errctx_set(err, ST_NOT_FOUND,
                          "a film needs ffmpeg, which is not installed; give a folder for PNGs");
    (void)snprintf(command, sizeof command,
                   "ffmpeg -loglevel error -y -f rawvideo -pix_fmt rgb24 -s %dx%d -r %g -i - "
                   "-pix_fmt yuv420p -vf 'pad=ceil(iw/2)*2:ceil(ih/2)*2' -movflags +faststart %s",
                   (int)f->im.width_px, (int)f->im.height_px, f->args->fps, name);
    (void)signal(SIGPIPE, SIG_IGN); /* an ffmpeg that ends early is a failed write */
    f->film = popen(command, "w");
    return f->film ? ST_OK : errctx_set(err, ST_IO, "ffmpeg cannot be started");
}

static enum st put(struct flight *f, int number, struct errctx *err) {
    char name[40], path[FILEIO_PATH_MAX];
    size_t bytes = (size_t)f->im.height_px * f->im.stride_bytes;
    if (f->film)
        return fwrite(f->im.px, 1, bytes, f->film) == bytes
                   ? ST_OK
                   : errctx_set(err, ST_IO, "ffmpeg took no more pictures");
    (void)snprintf(name, sizeof name, "%05d.png", number);
    enum st st = fileio_join(f->args->out, name, path, err);
    return st ? st : picture_write_png(path, &f->im, err);
}

/* The pilot at a time 0..1 of the flight: smooth at every photograph. */
static struct view_pilot pilot_at(const struct viewer *v, double t, int legs_max) {
    const struct tile_pack_index *index = view_source_tiles(v->source).index;
    struct view_pilot ends[2] = {v->pilot, v->pilot};
    int legs = index->photo_count > 1 ? index->photo_count - 1 : 1;
    legs = legs < legs_max ? legs : legs_max;
    double at = t * legs;
    int leg = (int)at < legs ? (int)at : legs - 1;
    double s = at - leg;
    for (int i = 0; i < 2; i++) {
        int k = leg + i < index->photo_count ? leg + i : index->photo_count - 1;
        const struct tile_pack_photo *p = &index->photos[k];
        struct pose pose = pose_compose(&p->world_from_station, &p->station_from_cam);
        ends[i].mode = VIEW_FLY;
        view_pilot_from_pose(&ends[i], &pose);
    }
    if (index->photo_count == 1) { /* one photograph: a look around it */
        ends[1] = ends[0];
        view_pilot_turn(&ends[1], 0.5, 0.0);
        view_pilot_turn(&ends[0], -0.5, 0.0);
    }
    return view_pilot_between(&ends[0], &ends[1], s * s * (3.0 - 2.0 * s));
}

static enum st fly(struct viewer *v, struct flight *f, struct errctx *err) {
    enum st st = is_film(f->args->out) ? open_film(f, err) : fileio_mkdirs(f->args->out, err);
    for (int i = 0; i < f->frames && !st; i++) {
        v->pilot = pilot_at(v, f->frames > 1 ? (double)i / (f->frames - 1) : 0.0, INT_MAX);
        st = viewer_picture(v, &f->im, err);
        if (!st)
            st = put(f, i, err);
    }
    if (f->film && pclose(f->film) != 0 && !st)
        st = errctx_set(err, ST_IO, "ffmpeg failed to write %s", f->args->out);
    return st;
}

/* ---- live ---- */

enum { LIVE_FRAMES_MAX = 1 << 16 };
static const double leg_s = 2.0; /* from one photograph to the next, as one flies by hand */

struct live {
    double first_s; /* from the command's start to the first picture */
    double *frame_ms;
    int count;
    int64_t missing; /* tiles wanted and not there, over all frames */
};

static enum st live_fly(struct viewer *v, const struct flight *f, struct live *live,
                        struct errctx *err) {
    enum st st = viewer_frame(v, &f->im, err);
    int64_t first_ns = clock_now_ns();
    live->first_s = 1e-9 * (double)(first_ns - f->start_ns);
    if (!st)
        st = viewer_frame(v, &f->im, err); /* chooses the path */
    int64_t begin_ns = clock_now_ns();
    for (double t = 0.0; !st && t < 1.0 && live->count < LIVE_FRAMES_MAX;
         t = 1e-9 * (double)(clock_now_ns() - begin_ns) / f->args->seconds) {
        v->pilot = pilot_at(v, t, (int)ceil(f->args->seconds / leg_s));
        viewer_moved(v);
        st = viewer_frame(v, &f->im, err);
        live->frame_ms[live->count++] = 1e3 * v->frame_s;
        live->missing += v->scene_stats.missing;
    }
    return st;
}

static int by_value(const void *a, const void *b) {
    double x, y;
    memcpy(&x, a, sizeof x);
    memcpy(&y, b, sizeof y);
    return (x > y) - (x < y);
}

static enum st live_json(const struct viewer *v, const struct live *live, double peak_mb,
                         struct errctx *err) {
    struct json json;
    json_init_object(&json);
    json_text(&json, NULL, "path", render_describe(v->renderer));
    json_number(&json, NULL, "first_picture_s", live->first_s);
    json_integer(&json, NULL, "frames", live->count);
    json_number(&json, NULL, "median_ms", live->frame_ms[live->count / 2]);
    json_number(&json, NULL, "worst_percent_ms",
                live->frame_ms[live->count - 1 - live->count / 100]);
    json_integer(&json, NULL, "cache_bytes", v->scene_stats.cache.bytes);
    json_integer(&json, NULL, "loaded_tiles", v->scene_stats.cache.loaded);
    json_integer(&json, NULL, "evicted_tiles", v->scene_stats.cache.evicted);
    json_integer(&json, NULL, "damaged_tiles", v->scene_stats.cache.damaged);
    json_integer(&json, NULL, "missing_tiles", live->missing);
    json_number(&json, NULL, "peak_memory_mb", peak_mb);
    struct cJSON *all = json_array(&json, NULL, "frame_ms");
    for (int i = 0; i < live->count; i++)
        json_number(&json, all, NULL, live->frame_ms[i]);
    enum st st = json_write(&json, stdout, err);
    json_fini(&json);
    return st;
}

static enum st live_run(struct viewer *v, const struct flight *f, struct errctx *err) {
    struct live live = {.frame_ms = calloc(LIVE_FRAMES_MAX + 1, sizeof(double))};
    if (!live.frame_ms)
        return errctx_set(err, ST_NOMEM, "no memory for frame times");
    enum st st = live_fly(v, f, &live, err);
    struct rusage usage;
    double peak_mb = getrusage(RUSAGE_SELF, &usage) ? (double)NAN : 1e-3 * (double)usage.ru_maxrss;
    qsort(live.frame_ms, (size_t)live.count, sizeof *live.frame_ms, by_value);
    if (!st && f->args->json)
        st = live_json(v, &live, peak_mb, err);
    else if (!st)
        (void)printf("first picture after %.2f s; %d frames: median %.1f ms, worst 1 %% from %.1f "
                     "ms; cache %.0f MB, %.0f MB of memory at the most; %s\n",
                     live.first_s, live.count, live.frame_ms[live.count / 2],
                     live.frame_ms[live.count - 1 - live.count / 100],
                     1e-6 * (double)v->scene_stats.cache.bytes, peak_mb,
                     render_describe(v->renderer));
    free(live.frame_ms);
    return st;
}

static int run(const char *path, const struct viewer_options *options, struct flight *f) {
    struct site *site = NULL;
    struct viewer viewer = {0};
    struct errctx err = {0};
    enum st st = app_site_open(path, SITE_READ, "fly", &site, &err);
    if (!st)
        st = viewer_open(site, options, &viewer, &err);
    if (!st) {
        viewer.unknown = f->args->unknown ? VIEWER_UNKNOWN_SHOW : VIEWER_UNKNOWN_HIDE;
        st = f->args->live ? live_run(&viewer, f, &err) : fly(&viewer, f, &err);
    }
    if (!st && !f->args->live)
        (void)printf("%s: %d pictures of %d x %d pixels, %s\n", f->args->out, f->frames,
                     (int)f->im.width_px, (int)f->im.height_px, render_describe(viewer.renderer));
    viewer_close(&viewer);
    (void)site_close(site, NULL);
    return st ? app_fail("fly", &err) : APP_DONE;
}

static int parsed(poptContext context, const struct arguments *a) {
    const char *path = poptGetArg(context);
    int w = 1280, h = 720;
    char rest = 0;
    if (!path || poptPeekArg(context))
        return app_usage_error("fly", "give one site");
    if (!a->out && !a->live)
        return app_usage_error("fly", "say where the pictures go: -o folder or -o film.mp4");
    if (a->size &&
        (sscanf(a->size, "%dx%d%c", &w, &h, &rest) != 2 || w < 1 || h < 1 || w > 8192 || h > 8192))
        return app_usage_error("fly", "--size '%s' is not WIDTHxHEIGHT up to 8192", a->size);
    if (!(a->seconds > 0.0) || !(a->fps > 0.0) || !(a->seconds * a->fps < 1e6))
        return app_usage_error("fly", "--seconds and --fps are above 0");
    if (a->cpu + a->gl + a->gl31 > 1 || a->cache_mb < 1)
        return app_usage_error("fly", "one of --cpu, --gl, --gl31; --cache from 1 MB");
    struct viewer_options options = {.path = path,
                                     .kind = a->cpu    ? RENDER_CPU
                                             : a->gl   ? RENDER_GLES30
                                             : a->gl31 ? RENDER_GLES31
                                                       : -1,
                                     .cache_bytes = (size_t)a->cache_mb << 20,
                                     .day = a->day};
    struct flight f = {.args = a,
                       .start_ns = clock_now_ns(),
                       .frames = (int)fmax(1.0, round(a->seconds * a->fps))};
    struct errctx err = {0};
    if (image_u8_create(&f.im, w, h, 3)) {
        (void)errctx_set(&err, ST_NOMEM, "no memory for pictures of %dx%d", w, h);
        return app_fail("fly", &err);
    }
    int status = run(path, &options, &f);
    image_u8_destroy(&f.im);
    return status;
}

int cmd_fly(int argc, const char **argv) {
    struct arguments a = {.cache_mb = 256, .seconds = 8.0, .fps = 25.0};
    const struct poptOption options[] = {
        {"output", 'o', POPT_ARG_STRING, &a.out, 0, "folder, or film (.mp4)", "PATH"},
        {"size", 's', POPT_ARG_STRING, &a.size, 0, "of the pictures (1280x720)", "WxH"},
        {"seconds", 0, POPT_ARG_DOUBLE | POPT_ARGFLAG_SHOW_DEFAULT, &a.seconds, 0, "of flight",
         "S"},
        {"fps", 0, POPT_ARG_DOUBLE | POPT_ARGFLAG_SHOW_DEFAULT, &a.fps, 0, "pictures a second",
         "N"},
        {"unknown", 0, POPT_ARG_NONE, &a.unknown, 0, "show what nobody has seen", NULL},
        {"day", 0, POPT_ARG_NONE, &a.day, 0, "light background", NULL},
        {"cpu", 0, POPT_ARG_NONE, &a.cpu, 0, "draw without OpenGL", NULL},
        {"gl", 0, POPT_ARG_NONE, &a.gl, 0, "draw with OpenGL ES 3.0", NULL},
        {"gl31", 0, POPT_ARG_NONE, &a.gl31, 0, "draw with compute shaders", NULL},
        {"cache", 0, POPT_ARG_INT | POPT_ARGFLAG_SHOW_DEFAULT, &a.cache_mb, 0, "memory for tiles",
         "MB"},
        {"live", 0, POPT_ARG_NONE, &a.live, 0, "as the window draws, and say how fast", NULL},
        POPT_TABLEEND};
    struct app_usage usage = {.name = "fly",
                              .synopsis = "SITE -o FOLDER|FILM.mp4 [options]",
                              .about = about,
                              .options = options,
                              .out_json = &a.json};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st)
        return app_parse_exit(st);
    int status = parsed(context, &a);
    (void)poptFreeContext(context);
    free(a.out);
    free(a.size);
    return status;
}
