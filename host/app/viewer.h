/* The viewer without its window: a scene, an eye, what is shown, and the controls drawn over it.
 * The window (view_window.h) feeds it input; `scancart fly` and tests do so without one. */
#ifndef SC_APP_VIEWER_H
#define SC_APP_VIEWER_H

#include "app/view_notes.h"
#include "app/view_source.h"
#include "base/image.h"
#include "base/text.h"
#include "render/render.h"
#include "render/view_measure.h"
#include "render/view_pilot.h"
#include "render/view_scene.h"

enum { VIEWER_POINTS_MAX = 64, VIEWER_TITLE_MAX = 96, VIEWER_ROWS = 4 };

enum viewer_unknown { VIEWER_UNKNOWN_SHOW, VIEWER_UNKNOWN_HIDE, VIEWER_UNKNOWN_ONLY };
enum viewer_blend { VIEWER_BLEND_BEST, VIEWER_BLEND_NEAREST, VIEWER_BLEND_WEIGHTED };

/* What a button or a key does. */
enum viewer_action {
    VIEWER_NONE,
    VIEWER_ORBIT,
    VIEWER_WALK,
    VIEWER_FLY,
    VIEWER_PLAN,
    VIEWER_LAYER,    /* the next one */
    VIEWER_UNKNOWN,  /* show, hide, only */
    VIEWER_PARALLEL, /* or perspective */
    VIEWER_MEASURE,
    VIEWER_NOTE, /* at the last point: what is typed next */
    VIEWER_KEEP, /* this view */
    VIEWER_BACK, /* to the next of the kept views */
    VIEWER_CLEAR,
    VIEWER_STATION, /* the next stand */
    VIEWER_PHOTO,   /* the next photograph's own view */
    VIEWER_HOME,
    VIEWER_PRIMITIVE,
    VIEWER_BLEND,
    VIEWER_THEME,
    VIEWER_OVERLAY,
    VIEWER_SAVE,
    VIEWER_QUIT
};

struct viewer_options {
    const char *path; /* of the site, for titles and saved pictures */
    int kind;         /* enum render_kind, or -1: measure and choose */
    size_t cache_bytes, gpu_bytes;
    bool from_photos, day;
};

/* A measured point. */
struct viewer_mark {
    struct view_point point;
};

struct viewer {
    struct viewer_options options;
    struct view_source *source;
    struct view_scene *scene;
    struct renderer *renderer;
    struct text_font *font;
    struct view_pilot pilot;
    struct vec3 centre_m;
    double radius_m;
    struct view_quality quality;
    enum viewer_unknown unknown;
    enum viewer_blend blend;
    bool measuring, overlay, quit, save_wanted;
    struct view_notes notes;
    bool typing;        /* the last note is being written */
    bool notes_foreign; /* the notes' file is not ours: nothing is written over it */
    int kept_view;      /* last gone back to */
    struct view_point last_point;
    bool has_last_point;
    struct viewer_mark marks[VIEWER_POINTS_MAX];
    int mark_count;
    int station, photo; /* last gone to; -1 */
    char title[VIEWER_TITLE_MAX], message[200];
    int64_t message_ns, moved_ns;
    bool choosing;                 /* which path stays is measured after the first frame */
    double choice_s[RENDER_KINDS]; /* what was measured; 0: not; NaN: not to be had */
    int64_t frames;                /* drawn so far */
    int32_t step;                  /* moving frames have so many times fewer pixels each way */
    /* Of the last frame. */
    struct raster_view view;
    const struct render_item *items;
    size_t item_count;
    struct view_scene_stats scene_stats;
    struct render_stats render_stats;
    double frame_s;
    uint8_t *rgba, *fine;
    float *depth;
    size_t pixels_room, fine_room;
    bool refined;
};

/* ST_NOT_FOUND: nothing to show. A GL that is not to be had falls back to the portable path and
 * says so on screen, unless `kind` asked for it: then ST_UNSUPPORTED. */
ST_MUST_CHECK enum st viewer_open(struct site *site, const struct viewer_options *options,
                                  struct viewer *out_viewer, struct errctx *err);
void viewer_close(struct viewer *viewer);

/* Draws one frame with everything over it into `out` (3 channels, any size from 1x1). Moving views
 * are coarser; still ones are refined within a second. */
ST_MUST_CHECK enum st viewer_frame(struct viewer *viewer, const struct image_u8 *out,
                                   struct errctx *err);

/* The same without controls, at full quality: loads until nothing is missing. */
ST_MUST_CHECK enum st viewer_picture(struct viewer *viewer, const struct image_u8 *out,
                                     struct errctx *err);

/* Must something be drawn although nothing was touched? */
bool viewer_wants_frame(const struct viewer *viewer);

void viewer_act(struct viewer *viewer, enum viewer_action action);
/* The eye moved: the next frames may be coarse. */
void viewer_moved(struct viewer *viewer);
void viewer_say(struct viewer *viewer, const char *fmt, ...) ST_PRINTF(2, 3);
/* Text for the note that is being written; "\b" takes a character away, "\n" ends it. */
void viewer_type(struct viewer *viewer, const char *utf8);
/* A tap or click that hit no button: measures, or makes the place the pivot. */
void viewer_tap(struct viewer *viewer, double x_px, double y_px);

/* viewer_ui.c: buttons and what is written over the picture. */
enum viewer_action viewer_ui_hit(const struct viewer *viewer, int32_t width_px, int32_t height_px,
                                 double x_px, double y_px);
void viewer_ui_draw(struct viewer *viewer, struct image_u8 *im);

#endif
