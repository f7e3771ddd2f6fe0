#include "app/viewer.h"

#include "base/clock.h"
#include "base/fileio.h"
#include "render/render_blend.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double moving_error_px = 2.0, still_error_px = 1.0;
static const int64_t still_after_ns = 250 * 1000000;
static const double push_sigmas = 2.0; /* of the best-sampled blend */

void viewer_say(struct viewer *v, const char *fmt, ...) {
    va_list args;
    va_start(args, fmt);
    (void)vsnprintf(v->message, sizeof v->message, fmt, args);
    va_end(args);
    v->message_ns = clock_now_ns();
}

/* ---- which path ---- */

static enum st draw_scene(struct viewer *v, struct renderer *renderer,
                          const struct raster_target *target, const struct raster_view *view,
                          struct errctx *err);

static enum st grow(struct viewer *v, size_t pixels, size_t fine, struct errctx *err) {
    if (pixels > v->pixels_room) {
        free(v->rgba);
        v->rgba = malloc(4 * pixels);
        v->pixels_room = v->rgba ? pixels : 0;
    }
    if (fine > v->fine_room) {
        free(v->fine);
        v->fine = malloc(4 * fine);
        v->fine_room = v->fine ? fine : 0;
    }
    if (pixels > v->pixels_room || fine > v->fine_room)
        return errctx_set(err, ST_NOMEM, "no memory for a picture of %zu pixels", pixels);
    return ST_OK;
}

/* Seconds of the fastest frame at the window's usual size after a first one. */
static double time_renderer(struct viewer *v, struct renderer *renderer) {
    enum { W = 1280, H = 720 };
    struct errctx ignored;
    if (grow(v, (size_t)W * H, 0, &ignored))
        return (double)INFINITY;
    struct raster_target target = {.width_px = W, .height_px = H, .rgba = v->rgba};
    struct raster_view view = view_pilot_view(&v->pilot, W, H, v->radius_m);
    double seconds = (double)INFINITY;
    static const double enough_s = 0.5; /* a path this slow is not looked at again */
    for (int i = 0; i < 4 && (i < 2 || seconds < enough_s); i++) {
        int64_t start_ns = clock_now_ns();
        if (draw_scene(v, renderer, &target, &view, &ignored))
            return (double)INFINITY;
        double took_s = 1e-9 * (double)(clock_now_ns() - start_ns);
        seconds = i == 0 || took_s < seconds ? took_s : seconds;
    }
    return seconds;
}

/* Which of the paths is the fastest here: up to four frames with each. */
static void choose_renderer(struct viewer *v) {
    struct render_params params = {.gpu_bytes = v->options.gpu_bytes};
    struct errctx why = {0};
    v->choosing = false;
    v->choice_s[RENDER_CPU] = time_renderer(v, v->renderer);
    double best_s = v->choice_s[RENDER_CPU];
    static const double clearly = 0.7; /* a few frames on a busy machine say no more */
    for (int k = RENDER_GLES30; k < RENDER_KINDS; k++) {
        struct renderer *r = NULL;
        v->choice_s[k] = (double)NAN;
        if (render_create((enum render_kind)k, &params, &r, &why)) {
            if (k == RENDER_GLES30)
                viewer_say(v, "drawing without OpenGL: %s", why.text);
            continue;
        }
        v->choice_s[k] = time_renderer(v, r);
        if (v->choice_s[k] < clearly * best_s) {
            render_destroy(v->renderer);
            v->renderer = r;
            best_s = v->choice_s[k];
        } else {
            render_destroy(r);
        }
    }
}

/* ---- life ---- */

static void go_home(struct viewer *v) {
    const struct tile_pack_index *index = view_source_tiles(v->source).index;
    v->pilot = view_pilot_over(v->centre_m, v->radius_m);
    if (index->photo_count) { /* where the crew stood: inside, not above the roof */
        struct pose pose =
            pose_compose(&index->photos[0].world_from_station, &index->photos[0].station_from_cam);
        view_pilot_from_pose(&v->pilot, &pose);
    }
    viewer_moved(v);
}

enum st viewer_open(struct site *site, const struct viewer_options *options, struct viewer *v,
                    struct errctx *err) {
    memset(v, 0, sizeof *v);
    v->options = *options;
    v->quality = view_quality_default();
    v->station = v->photo = -1;
    v->step = 1;
    v->overlay = true;
    v->unknown = VIEWER_UNKNOWN_HIDE; /* one tap away; it may fill the picture */
    (void)snprintf(v->title, sizeof v->title, "%s", fileio_basename(options->path));
    enum st st = view_source_open(site, options->from_photos, &v->source, err);
    if (!st)
        st = text_font_open(NULL, &v->font, err);
    struct tile_source tiles;
    if (!st) {
        tiles = view_source_tiles(v->source);
        st = view_scene_create(&tiles, options->cache_bytes, &v->scene, err);
    }
    if (!st) {
        view_scene_place(v->scene, &v->centre_m, &v->radius_m);
        go_home(v);
        /* The portable path is there at once; which one stays is measured after the first frame. */
        v->choosing = options->kind < 0;
        struct render_params params = {.gpu_bytes = options->gpu_bytes};
        st = render_create(v->choosing ? RENDER_CPU : (enum render_kind)options->kind, &params,
                           &v->renderer, err);
    }
    if (st) {
        viewer_close(v);
        return st;
    }
    struct errctx ignored = {0};
    v->kept_view = -1;
    if (view_notes_load(options->path, &v->notes, &ignored)) {
        v->notes_foreign = true;
        viewer_say(v, "%s", ignored.text);
    }
    const char *why;
    int left_out = view_source_left_out(v->source, &why);
    if (left_out)
        viewer_say(v, "%d could not be read and %s left out: %s", left_out,
                   left_out == 1 ? "is" : "are", why);
    return ST_OK;
}

void viewer_close(struct viewer *v) {
    render_destroy(v->renderer);
    view_scene_destroy(v->scene);
    view_source_close(v->source);
    text_font_close(v->font);
    free(v->rgba);
    free(v->fine);
    free(v->depth);
    memset(v, 0, sizeof *v);
}

/* ---- frames ---- */

static struct raster_options options_of(const struct viewer *v) {
    struct raster_options o = raster_options_default();
    static const uint8_t night[3] = {14, 16, 20}, day[3] = {236, 238, 240};
    static const uint8_t skin[3] = {226, 0, 198}; /* no scene has this colour */
    memcpy(o.background_rgb, v->options.day ? day : night, 3);
    memcpy(o.skin_rgb, skin, 3);
    o.push_sigma = v->blend == VIEWER_BLEND_BEST ? push_sigmas : 0.0;
    o.skins = v->unknown == VIEWER_UNKNOWN_SHOW   ? RASTER_SKINS_COLOUR
              : v->unknown == VIEWER_UNKNOWN_ONLY ? RASTER_SKINS_ONLY
                                                  : RASTER_SKINS_LEAVE_OUT;
    return o;
}

static enum st draw_scene(struct viewer *v, struct renderer *renderer,
                          const struct raster_target *target, const struct raster_view *view,
                          struct errctx *err) {
    struct raster_options options = options_of(v);
    v->quality.skins = options.skins != RASTER_SKINS_LEAVE_OUT;
    v->quality.planes_pay = render_kind_of(renderer) != RENDER_CPU;
    enum st st = view_scene_select(v->scene, view, &v->quality, &v->items, &v->item_count,
                                   &v->scene_stats, err);
    if (st)
        return st;
    struct render_frame frame = {v->items, v->item_count, view, &options};
    enum st (*draw)(struct renderer *, const struct render_frame *, const struct raster_target *,
                    struct render_stats *, struct errctx *) =
        v->blend == VIEWER_BLEND_WEIGHTED ? render_blend_draw : render_draw;
    st = draw(renderer, &frame, target, &v->render_stats, err);
    if (st == ST_DEVICE) /* the context was lost: the next call has a new one */
        st = draw(renderer, &frame, target, &v->render_stats, err);
    return st;
}

static const uint8_t *hatch(const uint8_t *rgba, int32_t x, int32_t y) {
    static const uint8_t dark[3] = {70, 0, 66};
    return rgba[3] == RASTER_ALPHA_UNKNOWN && ((x + y) & 8) ? dark : rgba;
}

/* Row y of the window from a picture that is `step` times smaller: between pixels in sixteenths. */
static void enlarge_row(const uint8_t *rgba, int32_t w, int32_t h, int32_t step, int32_t y,
                        const struct image_u8 *out) {
    int32_t fy = (16 * y + 8) / step - 8, y0 = fy > 0 ? fy >> 4 : 0;
    y0 = y0 < h - 1 ? y0 : h - 1;
    int32_t y1 = y0 + 1 < h ? y0 + 1 : y0, b = fy > 0 ? fy & 15 : 0;
    uint8_t *to = out->px + (size_t)y * out->stride_bytes;
    for (int32_t x = 0; x < out->width_px; x++) {
        int32_t fx = (16 * x + 8) / step - 8, x0 = fx > 0 ? fx >> 4 : 0;
        x0 = x0 < w - 1 ? x0 : w - 1;
        int32_t x1 = x0 + 1 < w ? x0 + 1 : x0, a = fx > 0 ? fx & 15 : 0;
        const uint8_t *p = hatch(rgba + 4 * ((ptrdiff_t)y0 * w + x0), x, y);
        const uint8_t *q = hatch(rgba + 4 * ((ptrdiff_t)y0 * w + x1), x, y);
        const uint8_t *r = hatch(rgba + 4 * ((ptrdiff_t)y1 * w + x0), x, y);
        const uint8_t *s = hatch(rgba + 4 * ((ptrdiff_t)y1 * w + x1), x, y);
        for (int k = 0; k < 3; k++)
            to[3 * x + k] = (uint8_t)(((16 - b) * ((16 - a) * p[k] + a * q[k]) +
                                       b * ((16 - a) * r[k] + a * s[k]) + 128) >>
                                      8);
    }
}

/* The picture into the window, the unknown hatched, so that it is told from surfaces without
 * colour, too. */
static void resolve(const uint8_t *rgba, int32_t w, int32_t h, int32_t step,
                    const struct image_u8 *out) {
#pragma omp parallel for schedule(static)
    for (int32_t y = 0; y < out->height_px; y++) {
        if (step > 1) {
            enlarge_row(rgba, w, h, step, y, out);
            continue;
        }
        uint8_t *to = out->px + (size_t)y * out->stride_bytes;
        const uint8_t *from = rgba + 4 * (size_t)y * (size_t)out->width_px;
        for (int32_t x = 0; x < out->width_px; x++)
            memcpy(to + 3 * x, hatch(from + 4 * x, x, y), 3);
    }
}

/* A picture with `step` times fewer pixels each way, enlarged: a frame that must not take long. */
static enum st draw_coarse(struct viewer *v, int32_t step, const struct image_u8 *out,
                           struct errctx *err) {
    int32_t w = (out->width_px + step - 1) / step, h = (out->height_px + step - 1) / step;
    enum st st = grow(v, (size_t)w * (size_t)h, 0, err);
    if (st)
        return st;
    v->view = view_pilot_view(&v->pilot, out->width_px, out->height_px, v->radius_m);
    struct raster_view small = view_pilot_view(&v->pilot, w, h, v->radius_m);
    struct raster_target target = {.width_px = w, .height_px = h, .rgba = v->rgba};
    st = draw_scene(v, v->renderer, &target, &small, err);
    if (!st)
        resolve(v->rgba, w, h, step, out);
    return st;
}

/* Frames that take too long are drawn with fewer pixels next time, while the eye moves. */
static void adapt_step(struct viewer *v) {
    static const double slow_s = 0.060, quick_s = 0.015;
    enum { STEP_MAX = 4 };
    if (v->frame_s > slow_s && v->step < STEP_MAX)
        v->step++;
    else if (v->frame_s < quick_s && v->step > 1)
        v->step--;
}

static enum st draw_fine(struct viewer *v, int32_t n, const struct image_u8 *out,
                         struct errctx *err) {
    int32_t w = out->width_px, h = out->height_px;
    size_t pixels = (size_t)w * (size_t)h;
    enum st st = grow(v, pixels, n > 1 ? pixels * (size_t)(n * n) : 0, err);
    if (st)
        return st;
    struct raster_target target = {.width_px = w, .height_px = h, .rgba = v->rgba};
    v->view = view_pilot_view(&v->pilot, w, h, v->radius_m);
    if (n <= 1)
        return draw_scene(v, v->renderer, &target, &v->view, err);
    struct raster_view view = raster_view_supersampled(&v->view, n);
    struct raster_target fine = {.width_px = n * w, .height_px = n * h, .rgba = v->fine};
    v->quality.error_px *= n; /* of a pixel, not of a sub-pixel */
    st = draw_scene(v, v->renderer, &fine, &view, err);
    v->quality.error_px /= n;
    struct raster_options options = options_of(v);
    return st ? st : raster_downsample(&fine, n, options.background_rgb, &target);
}

bool viewer_wants_frame(const struct viewer *v) {
    bool speaking = v->message[0] && clock_now_ns() - v->message_ns < (int64_t)7000000000;
    return !v->refined || !v->scene_stats.complete || speaking;
}

enum st viewer_frame(struct viewer *v, const struct image_u8 *out, struct errctx *err) {
    if (v->choosing && v->frames > 0)
        choose_renderer(v);
    int64_t start_ns = clock_now_ns();
    bool still = start_ns - v->moved_ns > still_after_ns;
    double pixels = (double)out->width_px * out->height_px;
    int32_t n = still && v->scene_stats.complete && pixels < 9e6 ? 2 : 1;
    v->quality.error_px = still || v->step > 1 ? still_error_px : moving_error_px;
    v->quality.load_s = still ? 0.05 : 0.008;
    enum st st;
    if (!still && v->step > 1) {
        st = draw_coarse(v, v->step, out, err);
    } else {
        st = draw_fine(v, n, out, err);
        if (!st)
            resolve(v->rgba, out->width_px, out->height_px, 1, out);
    }
    if (st)
        return st;
    v->refined = still && (n == 2 || pixels >= 9e6);
    v->frames++;
    v->frame_s = 1e-9 * (double)(clock_now_ns() - start_ns);
    if (!still)
        adapt_step(v);
    struct image_u8 im = *out;
    viewer_ui_draw(v, &im);
    return ST_OK;
}

enum st viewer_picture(struct viewer *v, const struct image_u8 *out, struct errctx *err) {
    enum { TRIES = 64 };
    if (v->choosing)
        choose_renderer(v);
    v->quality.error_px = still_error_px;
    v->quality.load_s = 1.0;
    enum st st = draw_fine(v, 1, out, err);
    for (int i = 0; !st && i < TRIES && !v->scene_stats.complete; i++)
        st = draw_fine(v, 1, out, err);
    if (!st)
        st = draw_fine(v, 2, out, err);
    if (!st)
        resolve(v->rgba, out->width_px, out->height_px, 1, out);
    return st;
}

/* ---- actions ---- */

void viewer_moved(struct viewer *v) {
    v->moved_ns = clock_now_ns();
    v->refined = false;
}

static struct pose pose_of_photo(const struct viewer *v, int32_t i) {
    const struct tile_pack_photo *p = &view_source_tiles(v->source).index->photos[i];
    return pose_compose(&p->world_from_station, &p->station_from_cam);
}

static void next_photo(struct viewer *v) {
    const struct tile_pack_index *index = view_source_tiles(v->source).index;
    v->photo = (v->photo + 1) % index->photo_count;
    const struct tile_pack_photo *p = &index->photos[v->photo];
    struct pose pose = pose_of_photo(v, v->photo);
    if (v->pilot.mode == VIEW_PLAN)
        view_pilot_set_mode(&v->pilot, VIEW_WALK);
    v->pilot.parallel = false;
    view_pilot_from_pose(&v->pilot, &pose);
    v->pilot.hfov_rad = 2.0 * atan(0.5 * p->camera.width_px / p->camera.fx_px);
    viewer_say(v, "photograph %s, %d of %d", p->name, v->photo + 1, (int)index->photo_count);
}

/* The first photograph of the next stand, with a usual field of view. */
static void next_station(struct viewer *v) {
    const struct tile_pack_index *index = view_source_tiles(v->source).index;
    int64_t here = v->station >= 0 ? index->photos[v->station].station_id : -1;
    int32_t at = v->station >= 0 ? v->station : 0;
    for (int32_t k = 0; k < index->photo_count; k++) {
        int32_t i = (at + k) % index->photo_count;
        if (index->photos[i].station_id != here) {
            at = i;
            break;
        }
    }
    struct pose pose = pose_of_photo(v, at);
    v->station = at;
    if (v->pilot.mode == VIEW_PLAN || v->pilot.mode == VIEW_ORBIT)
        view_pilot_set_mode(&v->pilot, VIEW_WALK);
    v->pilot.parallel = false;
    view_pilot_from_pose(&v->pilot, &pose);
    v->pilot.hfov_rad = 1.2;
    viewer_say(v, "stand of photograph %s", index->photos[at].name);
}

static void say_measure(struct viewer *v) {
    const struct view_point *p[3];
    int n = 0;
    const char *unit = view_source_is_metric(v->source) ? "m" : "baselines";
    for (int i = v->mark_count - 1; i >= 0 && n < 3; i--)
        p[n++] = &v->marks[i].point;
    if (n == 1) {
        double half = 1.959963985 * p[0]->sigma_m;
        viewer_say(v, "%.3f %.3f %.3f %s, \xc2\xb1 %.1f mm along the view; %d samples", p[0]->p_m.x,
                   p[0]->p_m.y, p[0]->p_m.z, unit, 1e3 * half, p[0]->samples);
    } else if (n >= 2) {
        struct view_value d = view_measure_distance_m(p[1], p[0]);
        struct view_value h = view_measure_height_m(p[1], p[0]);
        char angle[60] = "";
        if (n == 3) {
            struct view_value a = view_measure_angle_rad(p[2], p[1], p[0]);
            (void)snprintf(angle, sizeof angle, "; angle %.2f \xc2\xb1 %.2f deg",
                           a.value * 57.29577951, view_measure_half95(a) * 57.29577951);
        }
        viewer_say(v, "distance %.4f \xc2\xb1 %.4f %s, height %.4f \xc2\xb1 %.4f %s (95 %%)%s",
                   d.value, view_measure_half95(d), unit, h.value, view_measure_half95(h), unit,
                   angle);
    }
}

void viewer_tap(struct viewer *v, double x_px, double y_px) {
    struct view_point point;
    struct errctx err = {0};
    if (view_measure_pick(v->items, v->item_count, &v->view, x_px, y_px, &point, &err)) {
        viewer_say(v, "%s", err.text);
        return;
    }
    v->last_point = point;
    v->has_last_point = true;
    if (!v->measuring) {
        v->pilot.pivot_m = point.p_m;
        viewer_say(v, "turning around this point, %.2f m away",
                   vec3_norm(vec3_sub(point.p_m, v->pilot.eye_m)));
        return;
    }
    if (v->mark_count == VIEWER_POINTS_MAX) {
        memmove(v->marks, v->marks + 1, sizeof v->marks[0] * (VIEWER_POINTS_MAX - 1));
        v->mark_count--;
    }
    v->marks[v->mark_count++] = (struct viewer_mark){point};
    say_measure(v);
}

/* ---- notes and kept views ---- */

static void save_notes(struct viewer *v, const char *what) {
    struct errctx err = {0};
    if (v->notes_foreign)
        viewer_say(v, "not kept: the notes' file beside the site is not the viewer's");
    else if (view_notes_save(v->options.path, &v->notes, &err))
        viewer_say(v, "%s", err.text);
    else
        viewer_say(v, "%s", what);
}

static void begin_note(struct viewer *v) {
    if (!v->has_last_point || v->notes.note_count == VIEW_NOTES_MAX) {
        viewer_say(v, v->has_last_point ? "there is no room for more notes"
                                        : "tap the place of the note first");
        return;
    }
    struct view_note *note = &v->notes.notes[v->notes.note_count++];
    note->p_m = v->last_point.p_m;
    note->text[0] = '\0';
    v->typing = true;
    viewer_say(v, "type the note, Enter ends it");
}

static void end_note(struct viewer *v) {
    v->typing = false;
    if (!v->notes.notes[v->notes.note_count - 1].text[0])
        v->notes.note_count--;
    else
        save_notes(v, "note kept");
}

void viewer_type(struct viewer *v, const char *utf8) {
    if (!v->typing)
        return;
    char *text = v->notes.notes[v->notes.note_count - 1].text;
    size_t n = strlen(text);
    v->moved_ns = clock_now_ns();
    v->refined = false;
    if (!strcmp(utf8, "\n")) {
        end_note(v);
    } else if (!strcmp(utf8, "\b")) {
        while (n > 0 && ((unsigned char)text[n - 1] & 0xc0) == 0x80)
            n--; /* the whole of a UTF-8 character */
        text[n > 0 ? n - 1 : 0] = '\0';
    } else if (n + strlen(utf8) < VIEW_NOTES_TEXT) {
        memcpy(text + n, utf8, strlen(utf8) + 1);
    }
}

static void keep_view(struct viewer *v) {
    if (v->notes.view_count == VIEW_NOTES_VIEWS_MAX) {
        viewer_say(v, "there is no room for more views");
        return;
    }
    v->notes.views[v->notes.view_count++] = v->pilot;
    char text[60];
    (void)snprintf(text, sizeof text, "view %d kept: Back returns to it", v->notes.view_count);
    save_notes(v, text);
}

static void go_back(struct viewer *v) {
    if (!v->notes.view_count) {
        viewer_say(v, "no view has been kept yet");
        return;
    }
    v->kept_view = (v->kept_view + 1) % v->notes.view_count;
    v->pilot = v->notes.views[v->kept_view];
    viewer_say(v, "view %d of %d", v->kept_view + 1, v->notes.view_count);
}

static void set_mode(struct viewer *v, enum view_mode mode) {
    if (mode == VIEW_PLAN)
        v->pilot.width_m = fmax(2.2 * v->radius_m, 1.0);
    view_pilot_set_mode(&v->pilot, mode);
}

static void act_shown(struct viewer *v, enum viewer_action action) {
    static const char *const unknown[] = {"shown", "hidden", "alone"};
    static const char *const primitives[] = {"chosen by error", "points", "splats", "mesh",
                                             "planes and mesh"};
    static const char *const blends[] = {"the best sampled", "the nearest", "all, weighted"};
    if (action == VIEWER_LAYER) {
        v->quality.layer = (enum view_layer)(((int)v->quality.layer + 1) % VIEW_LAYERS);
        viewer_say(v, "layer: %s", view_layer_name(v->quality.layer));
    } else if (action == VIEWER_UNKNOWN) {
        v->unknown = (enum viewer_unknown)(((int)v->unknown + 1) % 3);
        viewer_say(v, "the unknown: %s", unknown[v->unknown]);
    } else if (action == VIEWER_PRIMITIVE) {
        v->quality.primitive = (enum view_primitive)(((int)v->quality.primitive + 1) % 5);
        viewer_say(v, "drawn as: %s", primitives[v->quality.primitive]);
    } else if (action == VIEWER_BLEND) {
        v->blend = (enum viewer_blend)(((int)v->blend + 1) % 3);
        viewer_say(v, "where photographs overlap: %s", blends[v->blend]);
    } else if (action == VIEWER_THEME) {
        v->options.day = !v->options.day;
    } else if (action == VIEWER_OVERLAY) {
        v->overlay = !v->overlay;
    } else if (action == VIEWER_PARALLEL) {
        v->pilot.parallel = !v->pilot.parallel;
        double distance = vec3_norm(vec3_sub(v->pilot.pivot_m, v->pilot.eye_m));
        v->pilot.width_m = fmax(2.0 * distance * tan(0.5 * fmin(v->pilot.hfov_rad, 2.5)), 0.1);
    }
}

void viewer_act(struct viewer *v, enum viewer_action action) {
    if (v->typing && action != VIEWER_NONE)
        end_note(v);
    switch (action) {
    case VIEWER_NONE:
        return;
    case VIEWER_ORBIT:
    case VIEWER_WALK:
    case VIEWER_FLY:
    case VIEWER_PLAN:
        set_mode(v, (enum view_mode)((int)action - (int)VIEWER_ORBIT));
        break;
    case VIEWER_MEASURE:
        v->measuring = !v->measuring;
        viewer_say(v, v->measuring ? "measuring: tap two points, a third gives the angle"
                                   : "tap to turn around a point");
        break;
    case VIEWER_NOTE:
        begin_note(v);
        break;
    case VIEWER_KEEP:
        keep_view(v);
        break;
    case VIEWER_BACK:
        go_back(v);
        break;
    case VIEWER_CLEAR:
        v->mark_count = 0;
        break;
    case VIEWER_STATION:
        next_station(v);
        break;
    case VIEWER_PHOTO:
        next_photo(v);
        break;
    case VIEWER_HOME:
        go_home(v);
        break;
    case VIEWER_SAVE:
        v->save_wanted = true;
        break;
    case VIEWER_QUIT:
        v->quit = true;
        break;
    case VIEWER_LAYER:
    case VIEWER_UNKNOWN:
    case VIEWER_PARALLEL:
    case VIEWER_PRIMITIVE:
    case VIEWER_BLEND:
    case VIEWER_THEME:
    case VIEWER_OVERLAY:
        act_shown(v, action);
        break;
    }
    viewer_moved(v);
}
