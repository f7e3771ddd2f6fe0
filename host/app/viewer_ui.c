/* What lies over the picture: large buttons, marks, a line of message, figures. */
#include "app/viewer.h"

#include "base/clock.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

struct button {
    enum viewer_action action;
    const char *text;
};

/* Along the left side, for a thumb; the order of a day's work. */
static const struct button buttons[] = {
    {VIEWER_ORBIT, "Orbit"}, {VIEWER_WALK, "Walk"},       {VIEWER_FLY, "Fly"},
    {VIEWER_PLAN, "Plan"},   {VIEWER_STATION, "Stand"},   {VIEWER_PHOTO, "Photo"},
    {VIEWER_LAYER, "Layer"}, {VIEWER_UNKNOWN, "Unknown"}, {VIEWER_MEASURE, "Measure"},
    {VIEWER_NOTE, "Note"},   {VIEWER_CLEAR, "Clear"},     {VIEWER_KEEP, "Keep"},
    {VIEWER_BACK, "Back"},   {VIEWER_SAVE, "Picture"},    {VIEWER_THEME, "Day/night"},
    {VIEWER_HOME, "Home"},
};
enum { BUTTONS = sizeof buttons / sizeof buttons[0], COLUMNS_MAX = 2 };

struct layout {
    double unit_px; /* height of a button: never below a finger's width where there is room */
    int32_t x_px, width_px, rows, columns;
};

static struct layout layout_of(int32_t width_px, int32_t height_px) {
    struct layout l = {.columns = 1};
    l.unit_px = fmax(44.0, fmin(72.0, height_px / 16.2));
    l.rows = (int32_t)(height_px / l.unit_px);
    l.rows = l.rows < 1 ? 1 : l.rows > BUTTONS ? BUTTONS : l.rows;
    l.columns = (BUTTONS + l.rows - 1) / l.rows;
    l.columns = l.columns > COLUMNS_MAX ? COLUMNS_MAX : l.columns;
    l.width_px = (int32_t)(2.2 * l.unit_px);
    if (l.width_px * l.columns > width_px / 2)
        l.rows = 0; /* a window too small for controls shows the picture */
    return l;
}

static void button_box(const struct layout *l, int i, int32_t box[4]) {
    box[0] = i / l->rows * l->width_px + 4;
    box[1] = (int32_t)(i % l->rows * l->unit_px) + 3;
    box[2] = l->width_px - 8;
    box[3] = (int32_t)l->unit_px - 6;
}

enum viewer_action viewer_ui_hit(const struct viewer *v, int32_t width_px, int32_t height_px,
                                 double x_px, double y_px) {
    struct layout l = layout_of(width_px, height_px);
    (void)v;
    for (int i = 0; i < BUTTONS && i < l.rows * l.columns; i++) {
        int32_t b[4];
        button_box(&l, i, b);
        if (x_px >= b[0] - 4 && x_px < b[0] + b[2] + 4 && y_px >= b[1] - 3 &&
            y_px < b[1] + b[3] + 3)
            return buttons[i].action;
    }
    return VIEWER_NONE;
}

/* ---- painting ---- */

struct theme {
    uint8_t panel[3], text[3], accent[3], on_accent[3];
};
static const struct theme night = {{22, 26, 32}, {236, 238, 240}, {255, 190, 60}, {20, 16, 4}};
static const struct theme day = {{250, 250, 248}, {12, 14, 18}, {0, 84, 200}, {255, 255, 255}};

static const struct theme *theme_of(const struct viewer *v) {
    return v->options.day ? &day : &night;
}

static void fill(struct image_u8 *im, int32_t x, int32_t y, int32_t w, int32_t h,
                 const uint8_t rgb[3], double opacity) {
    int32_t x1 = x + w < im->width_px ? x + w : im->width_px;
    int32_t y1 = y + h < im->height_px ? y + h : im->height_px;
    int32_t a = (int32_t)(opacity * 256.0);
    for (int32_t j = y > 0 ? y : 0; j < y1; j++)
        for (int32_t i = x > 0 ? x : 0; i < x1; i++) {
            uint8_t *px = image_u8_at(im, i, j);
            for (int k = 0; k < 3; k++)
                px[k] = (uint8_t)(px[k] + ((rgb[k] - px[k]) * a) / 256);
        }
}

static bool is_on(const struct viewer *v, enum viewer_action action) {
    if (action >= VIEWER_ORBIT && action <= VIEWER_PLAN)
        return (int)v->pilot.mode == (int)action - (int)VIEWER_ORBIT;
    return (action == VIEWER_MEASURE && v->measuring) ||
           (action == VIEWER_PARALLEL && v->pilot.parallel) ||
           (action == VIEWER_NOTE && v->typing) ||
           (action == VIEWER_LAYER && v->quality.layer != VIEW_LAYER_COLOUR) ||
           (action == VIEWER_UNKNOWN && v->unknown == VIEWER_UNKNOWN_ONLY);
}

static void draw_buttons(struct viewer *v, struct image_u8 *im) {
    struct layout l = layout_of(im->width_px, im->height_px);
    const struct theme *t = theme_of(v);
    double size = 0.36 * l.unit_px;
    for (int i = 0; i < BUTTONS && i < l.rows * l.columns; i++) {
        int32_t b[4];
        button_box(&l, i, b);
        bool on = is_on(v, buttons[i].action);
        fill(im, b[0], b[1], b[2], b[3], on ? t->accent : t->panel, on ? 0.95 : 0.82);
        double w = text_width_px(v->font, size, buttons[i].text);
        (void)text_draw(v->font, im, b[0] + 0.5 * (b[2] - w), b[1] + 0.5 * b[3] + 0.36 * size, size,
                        on ? t->on_accent : t->text, buttons[i].text);
    }
}

static void label(struct viewer *v, struct image_u8 *im, double x, double y, double size,
                  const char *text) {
    const struct theme *t = theme_of(v);
    double w = text_width_px(v->font, size, text);
    fill(im, (int32_t)(x - 0.4 * size), (int32_t)(y - size), (int32_t)(w + 0.8 * size),
         (int32_t)(1.4 * size), t->panel, 0.86);
    (void)text_draw(v->font, im, x, y, size, t->text, text);
}

/* Pixel of a world point; false behind the eye. */
static bool project(const struct raster_view *view, struct vec3 p_m, double *out_x, double *out_y) {
    struct vec3 p = mat3_mulv(&view->cam_from_world_r, vec3_sub(p_m, view->eye_m));
    double w = view->projection == RASTER_PINHOLE ? p.z : 1.0;
    *out_x = view->fx * p.x / w + view->cx_px;
    *out_y = view->fy * p.y / w + view->cy_px;
    return w > 0.0 && fabs(*out_x) < 1e5 && fabs(*out_y) < 1e5;
}

static void line(struct image_u8 *im, double x0, double y0, double x1, double y1, double half_px,
                 const uint8_t rgb[3]) {
    double length = hypot(x1 - x0, y1 - y0);
    int steps = (int)fmin(length, 8192.0) + 1;
    for (int i = 0; i <= steps; i++) {
        double t = (double)i / steps;
        int32_t side = (int32_t)(2.0 * half_px);
        fill(im, (int32_t)(x0 + t * (x1 - x0) - half_px), (int32_t)(y0 + t * (y1 - y0) - half_px),
             side, side, rgb, 1.0);
    }
}

static void draw_marks(struct viewer *v, struct image_u8 *im) {
    const struct theme *t = theme_of(v);
    static const uint8_t black[3] = {0, 0, 0};
    double before_x = 0, before_y = 0;
    bool before = false;
    for (int i = 0; i < v->mark_count; i++) {
        double x, y;
        const struct viewer_mark *m = &v->marks[i];
        bool seen = project(&v->view, m->point.p_m, &x, &y);
        if (seen && before) {
            line(im, before_x, before_y, x, y, 2.5, black);
            line(im, before_x, before_y, x, y, 1.5, t->accent);
            struct view_value d =
                view_measure_distance_m(&v->marks[i - 1].point, &v->marks[i].point);
            char text[64];
            (void)snprintf(text, sizeof text, "%.3f \xc2\xb1 %.3f %s", d.value,
                           view_measure_half95(d), view_source_is_metric(v->source) ? "m" : "b");
            label(v, im, 0.5 * (x + before_x) - 0.5 * text_width_px(v->font, 22.0, text),
                  0.5 * (y + before_y) - 22.0, 22.0, text);
        }
        if (seen) {
            fill(im, (int32_t)x - 7, (int32_t)y - 7, 14, 14, black, 1.0);
            fill(im, (int32_t)x - 5, (int32_t)y - 5, 10, 10, t->accent, 1.0);
        }
        before = seen;
        before_x = x;
        before_y = y;
    }
}

/* A pin at each note's place, its text beside it. */
static void draw_notes(struct viewer *v, struct image_u8 *im) {
    static const uint8_t black[3] = {0, 0, 0};
    for (int i = 0; i < v->notes.note_count; i++) {
        double x, y;
        const struct view_note *note = &v->notes.notes[i];
        bool writing = v->typing && i + 1 == v->notes.note_count;
        if (!project(&v->view, note->p_m, &x, &y))
            continue;
        line(im, x, y, x + 16, y - 30, 1.5, black);
        fill(im, (int32_t)x - 4, (int32_t)y - 4, 8, 8, theme_of(v)->accent, 1.0);
        char text[VIEW_NOTES_TEXT + 4];
        (void)snprintf(text, sizeof text, "%s%s", note->text, writing ? "_" : "");
        label(v, im, x + 22, y - 30, 20.0, text);
    }
}

/* Where the stands are, on the plan. */
static void draw_stands(struct viewer *v, struct image_u8 *im) {
    const struct tile_pack_index *index = view_source_tiles(v->source).index;
    const struct theme *t = theme_of(v);
    int64_t last = -1;
    for (int32_t i = 0; i < index->photo_count; i++) {
        double x, y;
        const struct tile_pack_photo *p = &index->photos[i];
        struct pose pose = pose_compose(&p->world_from_station, &p->station_from_cam);
        if (p->station_id == last || !project(&v->view, pose.t_m, &x, &y))
            continue;
        last = p->station_id;
        fill(im, (int32_t)x - 9, (int32_t)y - 9, 18, 18, t->on_accent, 1.0);
        fill(im, (int32_t)x - 7, (int32_t)y - 7, 14, 14, t->accent, 1.0);
    }
}

/* A bar of a round length, right of the middle at the bottom. */
static void draw_scale(struct viewer *v, struct image_u8 *im) {
    double px_per_m = v->view.fx, metres = 1.0;
    if (v->view.projection != RASTER_ORTHOGRAPHIC)
        return;
    while (metres * px_per_m > 0.25 * im->width_px)
        metres *= 0.1;
    while (metres * px_per_m < 0.05 * im->width_px)
        metres *= metres * px_per_m < 0.02 * im->width_px ? 5.0 : 2.0;
    int32_t w = (int32_t)(metres * px_per_m), x = im->width_px - w - 24, y = im->height_px - 40;
    fill(im, x - 2, y - 2, w + 4, 10, theme_of(v)->panel, 1.0);
    fill(im, x, y, w, 6, theme_of(v)->text, 1.0);
    char text[32];
    (void)snprintf(text, sizeof text, "%g %s", metres,
                   view_source_is_metric(v->source) ? "m" : "baselines");
    label(v, im, x, y - 12, 20.0, text);
}

/* "cpu 6 ms, gles30 61, gles31 -": what the choice of the path came from. */
static void choice_text(const struct viewer *v, char *out, size_t room) {
    size_t n = 0;
    out[0] = '\0';
    if (v->choice_s[RENDER_CPU] <= 0.0)
        return;
    for (int k = 0; k < RENDER_KINDS && n < room; k++) {
        double ms = 1e3 * v->choice_s[k];
        const char *name = render_kind_name((enum render_kind)k);
        int more = isnan(ms) ? snprintf(out + n, room - n, "%s%s none", k ? ", " : "", name)
                             : snprintf(out + n, room - n, "%s%s %.0f ms", k ? ", " : "", name, ms);
        n += more > 0 ? (size_t)more : 0;
    }
}

static void draw_overlay(struct viewer *v, struct image_u8 *im) {
    char rows[VIEWER_ROWS][400];
    const struct view_scene_stats *s = &v->scene_stats;
    const int64_t *n = v->render_stats.tiles_by_primitive;
    (void)snprintf(rows[0], sizeof rows[0], "%s   %.1f ms   %s%s", v->title, 1e3 * v->frame_s,
                   render_describe(v->renderer), s->complete ? "" : "   loading");
    (void)snprintf(rows[1], sizeof rows[1],
                   "%lld tiles, %.2f M samples, %.2f px   %.0f of %.0f MB, %lld missing",
                   (long long)s->tiles, 1e-6 * (double)s->samples, s->error_px,
                   1e-6 * (double)s->cache.resident * (double)sizeof(struct tile_slot),
                   1e-6 * (double)s->cache.bytes, (long long)s->missing);
    (void)snprintf(
        rows[2], sizeof rows[2], "%lld points, %lld splats, %lld mesh, %lld planes   layer %s%s%s",
        (long long)n[RENDER_POINTS], (long long)n[RENDER_SPLATS], (long long)n[RENDER_MESH],
        (long long)n[RENDER_PLANE], view_layer_name(v->quality.layer),
        s->cache.damaged ? "   DAMAGED TILES: " : "", s->cache.damaged ? s->cache.damage : "");
    choice_text(v, rows[3], sizeof rows[3]);
    double size = fmax(13.0, fmin(18.0, im->height_px / 45.0));
    for (int i = 0; i < VIEWER_ROWS; i++) {
        if (!rows[i][0])
            continue;
        double w = text_width_px(v->font, size, rows[i]);
        label(v, im, im->width_px - w - 12, 6.0 + (i + 1) * 1.45 * size, size, rows[i]);
    }
}

void viewer_ui_draw(struct viewer *v, struct image_u8 *im) {
    if (im->width_px < 240 || im->height_px < 180)
        return;
    if (v->pilot.mode == VIEW_PLAN)
        draw_stands(v, im);
    draw_notes(v, im);
    draw_marks(v, im);
    draw_scale(v, im);
    draw_buttons(v, im);
    if (v->overlay)
        draw_overlay(v, im);
    if (v->message[0] && clock_now_ns() - v->message_ns < (int64_t)6000000000) {
        struct layout l = layout_of(im->width_px, im->height_px);
        double size = fmax(16.0, fmin(26.0, im->height_px / 30.0));
        label(v, im, l.width_px * l.columns + 16.0, im->height_px - 18.0, size, v->message);
    }
}
