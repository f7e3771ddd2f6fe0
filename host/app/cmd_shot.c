#include "app/app.h"
#include "app/app_photos.h"
#include "app/app_site.h"
#include "app/commands.h"
#include "app/shot_view.h"
#include "base/json.h"
#include "base/picture.h"
#include "raster/depth_picture.h"
#include "raster/metrics.h"
#include "render/render.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char about[] =
    "Draws the 3D photographs of a site as seen from somewhere else. The view is a photograph's "
    "own "
    "(--photo; the first one if nothing is said), an offset from it in its camera frame (--offset "
    "right,down,"
    "forward in metres, --rotate yaw,pitch,roll in degrees), or --eye and --target in the "
    "world.\n\n"
    "Primitives: points; splat (a disc per sample, its radius --radius half diagonals of the "
    "projected sample); "
    "mesh (cells of four samples). Where neighbours belong to different surfaces the mesh has a "
    "skin; --skins "
    "says what happens to it: 'unknown' hides what would only be seen through a place that nobody "
    "measured, "
    "'colour' shows all unknown volumes, 'leave-out' shows none, 'draw' treats skins as surfaces, "
    "'only' draws "
    "nothing else.\n\n"
    "--compare IMAGE prints PSNR and SSIM over the covered pixels and the covered share of the "
    "picture.\n\n"
    "Examples:\n"
    "  scancart shot mysite --offset 0.2,0,0 -o right.png\n"
    "  scancart shot mysite --photos 4 --photo 5 --primitive mesh --compare 5.png -o 4as5.png\n"
    "  scancart shot mysite --eye 2,-4,1.6 --target 0,0,1 --fov 60 --size 1920x1080 -o view.png";

/* What popt fills. */
struct arguments {
    struct shot_view_words view;
    char *out, *depth_out, *depth16_out, *compare, *difference_out, *photos, *except;
    char *primitive, *skins, *filter, *radius_form, *background, *unknown, *rim;
    double radius, falloff, push, depth_unit_m;
    int supersample, threads, front_only, keep_mixed;
    int cpu, gl, gl31;
};

struct shot {
    const struct arguments *args;
    struct raster_options options;
    struct raster_view view;
    struct app_photos photos;
    struct raster_target target; /* of the view */
    struct raster_stats stats;
    struct metrics metrics; /* against --compare, or only the coverage */
    double unknown_share;
    bool json;
};

/* ---- words to options ---- */

struct word {
    const char *text;
    int value;
};

static const struct word primitives[] = {
    {"points", RASTER_POINTS}, {"splat", RASTER_SPLATS}, {"mesh", RASTER_MESH}, {NULL, 0}};
static const struct word skins[] = {
    {"leave-out", RASTER_SKINS_LEAVE_OUT}, {"unknown", RASTER_SKINS_UNKNOWN},
    {"colour", RASTER_SKINS_COLOUR},       {"draw", RASTER_SKINS_DRAW},
    {"only", RASTER_SKINS_ONLY},           {NULL, 0}};
static const struct word filters[] = {{"nearest", RASTER_FILTER_NEAREST},
                                      {"linear", RASTER_FILTER_LINEAR},
                                      {"cubic", RASTER_FILTER_CUBIC},
                                      {NULL, 0}};
static const struct word radius_forms[] = {
    {"area", RASTER_RADIUS_AREA}, {"cuberoot", RASTER_RADIUS_CUBEROOT}, {NULL, 0}};

/* The value of a word; `value` stays if the option was not given. */
static enum st pick(const struct word *words, const char *option, const char *given, int *value,
                    struct errctx *err) {
    if (!given)
        return ST_OK;
    char all[128] = "";
    for (const struct word *w = words; w->text; w++) {
        if (!strcmp(w->text, given)) {
            *value = w->value;
            return ST_OK;
        }
        size_t n = strlen(all);
        (void)snprintf(all + n, sizeof all - n, "%s%s", n ? ", " : "", w->text);
    }
    return errctx_set(err, ST_INVALID, "--%s '%s' is not one of: %s", option, given, all);
}

static enum st read_rgb(const char *option, const char *text, uint8_t out_rgb[3],
                        struct errctx *err) {
    double rgb[3];
    enum st st = shot_view_numbers(text, 3, option, rgb, err);
    for (int k = 0; k < 3 && !st; k++) {
        if (!(rgb[k] >= 0.0 && rgb[k] <= 255.0))
            return errctx_set(err, ST_INVALID, "%s is three numbers from 0 to 255", option);
        out_rgb[k] = (uint8_t)rgb[k];
    }
    return st;
}

static enum st make_options(const struct arguments *a, struct raster_options *out,
                            struct errctx *err) {
    struct raster_options o = raster_options_default();
    int primitive = RASTER_SPLATS, skin = RASTER_SKINS_UNKNOWN, filter = RASTER_FILTER_LINEAR;
    int form = RASTER_RADIUS_AREA;
    enum st st = pick(primitives, "primitive", a->primitive, &primitive, err);
    if (!st)
        st = pick(skins, "skins", a->skins, &skin, err);
    if (!st)
        st = pick(filters, "filter", a->filter, &filter, err);
    if (!st)
        st = pick(radius_forms, "radius-form", a->radius_form, &form, err);
    if (!st && a->background)
        st = read_rgb("--background", a->background, o.background_rgb, err);
    if (skin == RASTER_SKINS_UNKNOWN) /* it hides, which needs no colour of its own */
        memcpy(o.skin_rgb, o.background_rgb, sizeof o.skin_rgb);
    if (!st && a->unknown)
        st = read_rgb("--unknown", a->unknown, o.skin_rgb, err);
    if (!st && (a->supersample < 1 || a->supersample > 8))
        st = errctx_set(err, ST_INVALID, "--supersample goes from 1 to 8");
    o.primitive = (enum raster_primitive)primitive;
    o.skins = (enum raster_skins)skin;
    o.filter = (enum raster_filter)filter;
    o.radius = (enum raster_radius)form;
    o.faces = a->front_only ? RASTER_FACES_FRONT : RASTER_FACES_BOTH;
    o.leave_out_flags = a->keep_mixed ? 0 : PHOTO_MIXED;
    o.radius_k = a->radius;
    o.radius_max_px = fmin(o.radius_max_px * a->supersample, 4096.0);
    o.falloff = a->falloff;
    o.push_sigma = a->push;
    o.threads = a->threads;
    *out = o;
    return st;
}

/* ---- drawing ---- */

static enum st target_create(int32_t width_px, int32_t height_px, struct raster_target *out,
                             struct errctx *err) {
    size_t n = (size_t)width_px * (size_t)height_px;
    struct raster_target target = {.width_px = width_px, .height_px = height_px};
    target.rgba = malloc(4 * n);
    target.depth = malloc(n * sizeof *target.depth);
    if (!target.rgba || !target.depth) {
        free(target.rgba);
        free(target.depth);
        return errctx_set(err, ST_NOMEM, "no memory for a picture of %dx%d pixels", width_px,
                          height_px);
    }
    *out = target;
    return ST_OK;
}

static void target_destroy(struct raster_target *target) {
    free(target->rgba);
    free(target->depth);
    memset(target, 0, sizeof *target);
}

/* The same picture by OpenGL ES. */
static enum st draw_gl(struct shot *shot, const struct raster_view *view,
                       const struct raster_target *target, struct errctx *err) {
    static const enum render_primitive primitive[] = {[RASTER_POINTS] = RENDER_POINTS,
                                                      [RASTER_SPLATS] = RENDER_SPLATS,
                                                      [RASTER_MESH] = RENDER_MESH};
    size_t tiles = 0;
    for (size_t i = 0; i < shot->photos.count; i++)
        tiles += shot->photos.inputs[i].tile_count;
    struct render_item *items = malloc((tiles + 1) * sizeof *items);
    struct renderer *renderer = NULL;
    if (!items)
        return errctx_set(err, ST_NOMEM, "no memory for %zu tiles", tiles);
    size_t n = render_items_of_inputs(shot->photos.inputs, shot->photos.count,
                                      primitive[shot->options.primitive], items);
    struct render_frame frame = {items, n, view, &shot->options};
    struct render_stats stats = {0};
    enum st st =
        render_create(shot->args->gl31 ? RENDER_GLES31 : RENDER_GLES30, NULL, &renderer, err);
    if (!st)
        st = render_draw(renderer, &frame, target, &stats, err);
    shot->stats = (struct raster_stats){.tiles_total = (int64_t)tiles,
                                        .tiles_rejected = (int64_t)tiles - stats.tiles_drawn,
                                        .samples_drawn = stats.samples_drawn,
                                        .total_s = stats.total_s};
    render_destroy(renderer);
    free(items);
    return st;
}

static enum st draw(struct shot *shot, struct errctx *err) {
    int32_t n = shot->args->supersample;
    struct raster_view fine_view = raster_view_supersampled(&shot->view, n);
    struct raster_target fine = {0};
    struct raster_scratch scratch = {0};
    enum st st = target_create(shot->view.width_px, shot->view.height_px, &shot->target, err);
    if (!st && n > 1)
        st = target_create(fine_view.width_px, fine_view.height_px, &fine, err);
    if (!st)
        st = shot->args->gl || shot->args->gl31
                 ? draw_gl(shot, &fine_view, n > 1 ? &fine : &shot->target, err)
                 : raster_draw(shot->photos.inputs, shot->photos.count, &fine_view, &shot->options,
                               n > 1 ? &fine : &shot->target, &scratch, &shot->stats, err);
    if (!st && n > 1)
        st = raster_downsample(&fine, n, shot->options.background_rgb, &shot->target);
    raster_scratch_fini(&scratch);
    target_destroy(&fine);
    size_t count = (size_t)shot->view.width_px * (size_t)shot->view.height_px;
    bool mask = shot->options.skins != RASTER_SKINS_ONLY;
    for (size_t i = 0; !st && mask && i < count; i++) /* a skin is no surface and has no depth */
        if (shot->target.rgba[4 * i + 3] != RASTER_ALPHA_SURFACE)
            shot->target.depth[i] = NAN;
    return st;
}

/* ---- what it came to ---- */

/* |picture - truth| four times over; what is not covered is dark blue. */
static enum st write_difference(const struct shot *shot, const struct image_u8 *truth,
                                struct errctx *err) {
    const struct raster_target *t = &shot->target;
    static const uint8_t uncovered_rgb[3] = {24, 28, 48};
    struct image_u8 im;
    enum st st = image_u8_create(&im, t->width_px, t->height_px, 3);
    if (st)
        return errctx_set(err, st, "no memory for the difference picture");
    size_t n = (size_t)t->width_px * (size_t)t->height_px;
    for (size_t i = 0; i < 3 * n; i++) {
        int d = 4 * abs((int)t->rgba[i / 3 * 4 + i % 3] - (int)truth->px[i]);
        int covered = t->rgba[i / 3 * 4 + 3] == RASTER_ALPHA_SURFACE;
        im.px[i] = covered ? (uint8_t)(d > 255 ? 255 : d) : uncovered_rgb[i % 3];
    }
    st = picture_write_png(shot->args->difference_out, &im, err);
    image_u8_destroy(&im);
    return st;
}

static enum st compare(struct shot *shot, struct errctx *err) {
    const struct raster_target *t = &shot->target;
    const char *path = shot->args->compare;
    struct image_u8 truth;
    uint8_t *counts = NULL, rim[3];
    enum st st = picture_read_rgb(path, &truth, err);
    if (st)
        return st;
    if (truth.width_px != t->width_px || truth.height_px != t->height_px)
        st = errctx_set(err, ST_INVALID, "%s has %dx%d pixels, the picture %dx%d", path,
                        truth.width_px, truth.height_px, t->width_px, t->height_px);
    if (!st && shot->args->rim)
        st = read_rgb("--rim", shot->args->rim, rim, err);
    if (!st && shot->args->rim) {
        counts = malloc((size_t)t->width_px * (size_t)t->height_px);
        if (!counts || metrics_rim_mask(truth.px, t->width_px, t->height_px, rim, counts) < 0)
            st = errctx_set(err, ST_NOMEM, "no memory to compare pictures");
    }
    if (!st &&
        metrics_compare(t->rgba, truth.px, counts, t->width_px, t->height_px, &shot->metrics))
        st = errctx_set(err, ST_NOMEM, "no memory to compare pictures");
    if (!st && shot->args->difference_out)
        st = write_difference(shot, &truth, err);
    free(counts);
    image_u8_destroy(&truth);
    return st;
}

static enum st measure(struct shot *shot, struct errctx *err) {
    const struct raster_target *t = &shot->target;
    size_t n = (size_t)t->width_px * (size_t)t->height_px, covered = 0, unknown = 0;
    for (size_t i = 0; i < n; i++) {
        covered += t->rgba[4 * i + 3] == RASTER_ALPHA_SURFACE;
        unknown += t->rgba[4 * i + 3] == RASTER_ALPHA_UNKNOWN;
    }
    shot->metrics =
        (struct metrics){.coverage = (double)covered / (double)n, .covered_px = (int64_t)covered};
    shot->unknown_share = (double)unknown / (double)n;
    if (!shot->args->compare)
        return ST_OK;
    return compare(shot, err);
}

static enum st write_depth(const struct shot *shot, struct errctx *err) {
    const struct raster_target *t = &shot->target;
    size_t n = (size_t)t->width_px * (size_t)t->height_px;
    enum st st = ST_OK;
    if (shot->args->depth_out) {
        struct image_u8 im = {0};
        struct depth_range range;
        st = image_u8_create(&im, t->width_px, t->height_px, 3);
        if (!st)
            st = depth_picture_range(t->depth, n, &range);
        if (st)
            return errctx_set(err, st, "no memory for the depth picture");
        depth_picture_colour(t->depth, n, range, im.px);
        st = picture_write_png(shot->args->depth_out, &im, err);
        image_u8_destroy(&im);
    }
    if (!st && shot->args->depth16_out) {
        struct image_u16 im = {0};
        st = image_u16_create(&im, t->width_px, t->height_px, 1);
        if (st)
            return errctx_set(err, st, "no memory for the depth picture");
        depth_picture_u16(t->depth, n, shot->args->depth_unit_m, im.px);
        st = picture_write_png16(shot->args->depth16_out, &im, err);
        image_u16_destroy(&im);
    }
    return st;
}

static enum st write_pictures(const struct shot *shot, struct errctx *err) {
    const struct raster_target *t = &shot->target;
    struct image_u8 im;
    enum st st = image_u8_create(&im, t->width_px, t->height_px, 3);
    if (st)
        return errctx_set(err, st, "no memory for the picture");
    size_t n = (size_t)t->width_px * (size_t)t->height_px;
    for (size_t i = 0; i < n; i++)
        memcpy(im.px + 3 * i, t->rgba + 4 * i, 3);
    st = picture_write_png(shot->args->out, &im, err);
    image_u8_destroy(&im);
    return st ? st : write_depth(shot, err);
}

static enum st print_json(const struct shot *shot, struct errctx *err) {
    struct json json;
    json_init_object(&json);
    json_text(&json, NULL, "picture", shot->args->out);
    json_integer(&json, NULL, "width_px", shot->view.width_px);
    json_integer(&json, NULL, "height_px", shot->view.height_px);
    json_integer(&json, NULL, "photographs", (int64_t)shot->photos.count);
    json_integer(&json, NULL, "tiles_total", shot->stats.tiles_total);
    json_integer(&json, NULL, "tiles_rejected", shot->stats.tiles_rejected);
    json_integer(&json, NULL, "samples_drawn", shot->stats.samples_drawn);
    json_number(&json, NULL, "draw_s", shot->stats.total_s);
    json_number(&json, NULL, "coverage", shot->metrics.coverage);
    json_number(&json, NULL, "unknown", shot->unknown_share);
    if (shot->args->compare) {
        json_text(&json, NULL, "compared_with", shot->args->compare);
        json_number(&json, NULL, "psnr_db", shot->metrics.psnr_db);
        json_number(&json, NULL, "ssim", shot->metrics.ssim);
    }
    enum st st = json_write(&json, stdout, err);
    json_fini(&json);
    return st;
}

static enum st print_text(const struct shot *shot) {
    (void)printf("%s: %d x %d pixels, %.2f %% covered", shot->args->out, shot->view.width_px,
                 shot->view.height_px, 100.0 * shot->metrics.coverage);
    if (shot->unknown_share > 0.0)
        (void)printf(", %.2f %% unknown", 100.0 * shot->unknown_share);
    (void)printf("; %lld samples of %zu photograph%s in %.0f ms\n",
                 (long long)shot->stats.samples_drawn, shot->photos.count,
                 shot->photos.count == 1 ? "" : "s", 1e3 * shot->stats.total_s);
    if (shot->args->compare)
        (void)printf("compared with %s: PSNR %.2f dB, SSIM %.4f over the covered pixels\n",
                     shot->args->compare, shot->metrics.psnr_db, shot->metrics.ssim);
    return ST_OK;
}

/* ---- the command ---- */

static enum st run(const char *path, struct shot *shot, struct errctx *err) {
    struct site *site = NULL;
    const struct arguments *a = shot->args;
    enum st st = app_site_open(path, SITE_READ, "shot", &site, err);
    if (!st)
        st = shot_view_make(site, &a->view, &shot->view, err);
    if (!st && (int64_t)shot->view.width_px * a->supersample > RASTER_MAX_SIDE_PX)
        st = errctx_set(err, ST_INVALID, "%d pixels supersampled %d times are too many",
                        shot->view.width_px, a->supersample);
    struct app_photos_options load = {
        .wanted = a->photos,
        .unwanted = a->except,
        .bound_unknown = shot->options.skins != RASTER_SKINS_LEAVE_OUT &&
                         shot->options.skins != RASTER_SKINS_DRAW,
    };
    if (!st)
        st = app_photos_load(site, &load, &shot->photos, err);
    (void)site_close(site, NULL);
    if (!st)
        st = draw(shot, err);
    if (!st)
        st = measure(shot, err);
    if (!st)
        st = write_pictures(shot, err);
    if (!st)
        st = shot->json ? print_json(shot, err) : print_text(shot);
    app_photos_fini(&shot->photos);
    target_destroy(&shot->target);
    return st;
}

static int parsed(poptContext context, struct shot *shot) {
    const char *path = poptGetArg(context);
    struct errctx err = {0};
    if (!path || poptPeekArg(context))
        return app_usage_error("shot", "give one site");
    if (shot->args->cpu + shot->args->gl + shot->args->gl31 > 1)
        return app_usage_error("shot", "--cpu, --gl and --gl31 exclude each other");
    if (!shot->args->out)
        return app_usage_error("shot", "say where the picture goes: -o out.png");
    if (make_options(shot->args, &shot->options, &err))
        return app_usage_error("shot", "%s", err.text);
    return run(path, shot, &err) ? app_fail("shot", &err) : APP_DONE;
}

static void free_arguments(struct arguments *a) {
    const char *words[] = {a->view.photo,  a->view.offset, a->view.rotate, a->view.eye,
                           a->view.target, a->view.up,     a->view.size};
    char *texts[] = {a->out,        a->depth_out, a->depth16_out,    a->compare, a->photos,
                     a->except,     a->primitive, a->skins,          a->filter,  a->radius_form,
                     a->background, a->unknown,   a->difference_out, a->rim};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++)
        free(texts[i]);
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        union {
            const char *in;
            char *out;
        } word = {.in = words[i]};
        free(word.out);
    }
}

int cmd_shot(int argc, const char **argv) {
    struct raster_options o = raster_options_default();
    struct arguments a = {
        .supersample = 3, .radius = o.radius_k, .falloff = o.falloff, .depth_unit_m = 0.001};
    struct shot shot = {.args = &a};
    const struct poptOption options[] = {
        {"output", 'o', POPT_ARG_STRING, &a.out, 0, "the picture (PNG)", "FILE"},
        {"photo", 0, POPT_ARG_STRING, &a.view.photo, 0, "start from this photograph's view",
         "NAME"},
        {"offset", 0, POPT_ARG_STRING, &a.view.offset, 0, "move the camera, metres", "X,Y,Z"},
        {"rotate", 0, POPT_ARG_STRING, &a.view.rotate, 0, "turn it, degrees", "YAW,PITCH,ROLL"},
        {"eye", 0, POPT_ARG_STRING, &a.view.eye, 0, "stand here, world metres", "X,Y,Z"},
        {"target", 0, POPT_ARG_STRING, &a.view.target, 0, "look there", "X,Y,Z"},
        {"up", 0, POPT_ARG_STRING, &a.view.up, 0, "what is up (0,0,1)", "X,Y,Z"},
        {"fov", 0, POPT_ARG_DOUBLE, &a.view.fov_deg, 0, "horizontal field of view", "DEGREES"},
        {"parallel", 0, POPT_ARG_DOUBLE, &a.view.width_m, 0, "parallel view, so wide", "METRES"},
        {"near", 0, POPT_ARG_DOUBLE, &a.view.near_m, 0, "leave out what is nearer", "METRES"},
        {"size", 's', POPT_ARG_STRING, &a.view.size, 0, "of the picture", "WxH"},
        {"photos", 0, POPT_ARG_STRING, &a.photos, 0, "draw these (all)", "A,B,.."},
        {"except", 0, POPT_ARG_STRING, &a.except, 0, "do not draw these", "A,B,.."},
        {"primitive", 'p', POPT_ARG_STRING, &a.primitive, 0, "points, splat (default), mesh",
         "WHAT"},
        {"radius", 0, POPT_ARG_DOUBLE | POPT_ARGFLAG_SHOW_DEFAULT, &a.radius, 0,
         "of splats, in half diagonals of a sample", "K"},
        {"radius-form", 0, POPT_ARG_STRING, &a.radius_form, 0, "area (default), cuberoot", "FORM"},
        {"falloff", 0, POPT_ARG_DOUBLE | POPT_ARGFLAG_SHOW_DEFAULT, &a.falloff, 0,
         "depth of a splat's rim, in radii", "F"},
        {"filter", 0, POPT_ARG_STRING, &a.filter, 0, "nearest, linear (default), cubic", "HOW"},
        {"skins", 0, POPT_ARG_STRING, &a.skins, 0,
         "unknown (default), leave-out, colour, draw, only", "WHAT"},
        {"push", 0, POPT_ARG_DOUBLE, &a.push, 0, "push coarser samples back (0)", "SIGMAS"},
        {"front-only", 0, POPT_ARG_NONE, &a.front_only, 0, "no mesh seen from behind", NULL},
        {"keep-mixed", 0, POPT_ARG_NONE, &a.keep_mixed, 0,
         "draw pixels that show two surfaces, too", NULL},
        {"supersample", 0, POPT_ARG_INT | POPT_ARGFLAG_SHOW_DEFAULT, &a.supersample, 0,
         "sub-pixels each way", "N"},
        {"background", 0, POPT_ARG_STRING, &a.background, 0, "colour of nothing (0,0,0)", "R,G,B"},
        {"unknown", 0, POPT_ARG_STRING, &a.unknown, 0,
         "colour of skins that are not surfaces (violet; background for --skins unknown)", "R,G,B"},
        {"compare", 'c', POPT_ARG_STRING, &a.compare, 0, "measure against this picture", "IMAGE"},
        {"rim", 0, POPT_ARG_STRING, &a.rim, 0,
         "pixels of this colour around the compared picture are none", "R,G,B"},
        {"difference", 0, POPT_ARG_STRING, &a.difference_out, 0,
         "with --compare: where they differ, 4 times (PNG)", "FILE"},
        {"depth", 0, POPT_ARG_STRING, &a.depth_out, 0, "depths in colour (PNG)", "FILE"},
        {"depth16", 0, POPT_ARG_STRING, &a.depth16_out, 0, "depths in 16 bits (PNG)", "FILE"},
        {"depth-unit", 0, POPT_ARG_DOUBLE | POPT_ARGFLAG_SHOW_DEFAULT, &a.depth_unit_m, 0,
         "step of --depth16", "METRES"},
        {"cpu", 0, POPT_ARG_NONE, &a.cpu, 0, "draw without OpenGL (default)", NULL},
        {"gl", 0, POPT_ARG_NONE, &a.gl, 0, "draw with OpenGL ES 3.0", NULL},
        {"gl31", 0, POPT_ARG_NONE, &a.gl31, 0, "draw with compute shaders", NULL},
        {"threads", 0, POPT_ARG_INT, &a.threads, 0, "(as many as there are)", "N"},
        POPT_TABLEEND};
    struct app_usage usage = {.name = "shot",
                              .synopsis = "SITE -o FILE [view] [how] [--compare IMAGE] [--json]",
                              .about = about,
                              .options = options,
                              .out_json = &shot.json};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st)
        return app_parse_exit(st);
    int status = parsed(context, &shot);
    (void)poptFreeContext(context);
    free_arguments(&a);
    return status;
}
