#include "app/view_window.h"

#include "app/view_play.h"
#include "base/clock.h"
#include "base/picture.h"

#include <SDL.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { FINGERS_MAX = 2, TAP_PX = 8 };
static const double turn_rad_per_px = 0.004;
static const double wheel_step = 1.2;
static const double walk_m_per_s = 1.6;

struct finger {
    SDL_FingerID id;
    double x_px, y_px;
    bool down;
};

struct window {
    SDL_Window *sdl;
    SDL_Renderer *renderer;
    SDL_Texture *texture;
    struct image_u8 im;
    struct viewer *viewer;
    struct view_play *play;
    /* Mouse. */
    int button;
    double last_x, last_y, moved_px;
    bool on_button;
    struct finger fingers[FINGERS_MAX];
    bool keys[SDL_NUM_SCANCODES];
    int64_t last_ns;
    bool exposed;
};

/* ---- mouse and touch ---- */

static void drag(struct window *w, double dx, double dy, bool pan) {
    struct view_pilot *p = &w->viewer->pilot;
    if (pan || p->mode == VIEW_PLAN)
        view_pilot_pan(p, dx, dy, w->im.width_px);
    else
        view_pilot_turn(p, dx * turn_rad_per_px, -dy * turn_rad_per_px);
    viewer_moved(w->viewer);
}

static void press(struct window *w, double x, double y) {
    enum viewer_action action = viewer_ui_hit(w->viewer, w->im.width_px, w->im.height_px, x, y);
    w->on_button = action != VIEWER_NONE;
    w->last_x = x;
    w->last_y = y;
    w->moved_px = 0.0;
    viewer_act(w->viewer, action);
}

static void moved(struct window *w, double x, double y, bool pan) {
    double dx = x - w->last_x, dy = y - w->last_y;
    w->moved_px += hypot(dx, dy);
    if (!w->on_button && w->moved_px > TAP_PX)
        drag(w, dx, dy, pan);
    w->last_x = x;
    w->last_y = y;
}

static void released(struct window *w, double x, double y) {
    if (!w->on_button && w->moved_px <= TAP_PX)
        viewer_tap(w->viewer, x, y);
    w->on_button = false;
    viewer_moved(w->viewer);
}

static void on_mouse(struct window *w, const SDL_Event *e) {
    if (e->type == SDL_MOUSEWHEEL) {
        view_pilot_zoom(&w->viewer->pilot, pow(wheel_step, e->wheel.y));
        viewer_moved(w->viewer);
    } else if (e->type == SDL_MOUSEBUTTONDOWN && e->button.which != SDL_TOUCH_MOUSEID) {
        w->button = e->button.button;
        press(w, e->button.x, e->button.y);
    } else if (e->type == SDL_MOUSEMOTION && w->button && e->motion.which != SDL_TOUCH_MOUSEID) {
        moved(w, e->motion.x, e->motion.y, w->button != SDL_BUTTON_LEFT);
    } else if (e->type == SDL_MOUSEBUTTONUP && w->button) {
        if (w->button == SDL_BUTTON_LEFT)
            released(w, e->button.x, e->button.y);
        w->button = 0;
    }
}

/* Two fingers: their middle pans, their distance zooms, their direction turns the plan. */
static void pinch(struct window *w, const struct finger before[FINGERS_MAX]) {
    const struct finger *a = w->fingers, *b = before;
    double was = hypot(b[0].x_px - b[1].x_px, b[0].y_px - b[1].y_px);
    double is = hypot(a[0].x_px - a[1].x_px, a[0].y_px - a[1].y_px);
    struct view_pilot *p = &w->viewer->pilot;
    view_pilot_pan(p, 0.5 * (a[0].x_px + a[1].x_px - b[0].x_px - b[1].x_px),
                   0.5 * (a[0].y_px + a[1].y_px - b[0].y_px - b[1].y_px), w->im.width_px);
    if (was > 1.0 && is > 1.0)
        view_pilot_zoom(p, is / was);
    if (p->mode == VIEW_PLAN) {
        double turn = atan2(a[1].y_px - a[0].y_px, a[1].x_px - a[0].x_px) -
                      atan2(b[1].y_px - b[0].y_px, b[1].x_px - b[0].x_px);
        p->azimuth_rad += remainder(turn, 6.283185307179586);
    }
    viewer_moved(w->viewer);
}

static void on_finger(struct window *w, const SDL_TouchFingerEvent *e) {
    double x = (double)e->x * w->im.width_px, y = (double)e->y * w->im.height_px;
    struct finger before[FINGERS_MAX], *f = NULL;
    memcpy(before, w->fingers, sizeof before);
    for (int i = 0; i < FINGERS_MAX; i++)
        if (w->fingers[i].down && w->fingers[i].id == e->fingerId)
            f = &w->fingers[i];
    for (int i = 0; !f && i < FINGERS_MAX && e->type == SDL_FINGERDOWN; i++)
        if (!w->fingers[i].down)
            f = &w->fingers[i];
    if (!f)
        return;
    *f = (struct finger){e->fingerId, x, y, e->type != SDL_FINGERUP};
    bool other = w->fingers[f == &w->fingers[0] ? 1 : 0].down;
    if (e->type == SDL_FINGERDOWN && !other)
        press(w, x, y);
    else if (e->type == SDL_FINGERDOWN)
        w->moved_px = 1e9; /* two fingers are no tap */
    else if (e->type == SDL_FINGERMOTION && other)
        pinch(w, before);
    else if (e->type == SDL_FINGERMOTION)
        moved(w, x, y, false);
    else if (!other)
        released(w, x, y);
    else {
        w->last_x = w->fingers[f == &w->fingers[0] ? 1 : 0].x_px;
        w->last_y = w->fingers[f == &w->fingers[0] ? 1 : 0].y_px;
    }
}

/* ---- keys ---- */

static enum viewer_action action_of(SDL_Keycode key) {
    static const struct {
        SDL_Keycode key;
        enum viewer_action action;
    } keys[] = {{SDLK_1, VIEWER_ORBIT}, {SDLK_2, VIEWER_WALK},      {SDLK_3, VIEWER_FLY},
                {SDLK_4, VIEWER_PLAN},  {SDLK_TAB, VIEWER_STATION}, {SDLK_v, VIEWER_PHOTO},
                {SDLK_l, VIEWER_LAYER}, {SDLK_u, VIEWER_UNKNOWN},   {SDLK_m, VIEWER_MEASURE},
                {SDLK_n, VIEWER_NOTE},  {SDLK_c, VIEWER_CLEAR},     {SDLK_o, VIEWER_PARALLEL},
                {SDLK_k, VIEWER_KEEP},  {SDLK_r, VIEWER_BACK},      {SDLK_F12, VIEWER_SAVE},
                {SDLK_t, VIEWER_THEME}, {SDLK_h, VIEWER_HOME},      {SDLK_p, VIEWER_PRIMITIVE},
                {SDLK_b, VIEWER_BLEND}, {SDLK_i, VIEWER_OVERLAY},   {SDLK_ESCAPE, VIEWER_QUIT}};
    for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++)
        if (keys[i].key == key)
            return keys[i].action;
    return VIEWER_NONE;
}

static double held(const struct window *w, SDL_Scancode plus, SDL_Scancode minus) {
    return (w->keys[plus] ? 1.0 : 0.0) - (w->keys[minus] ? 1.0 : 0.0);
}

/* Keys that are held move the eye by the time that passed. */
static void walk(struct window *w) {
    int64_t now_ns = clock_now_ns();
    double dt_s = fmin(1e-9 * (double)(now_ns - w->last_ns), 0.1);
    w->last_ns = now_ns;
    double right = held(w, SDL_SCANCODE_D, SDL_SCANCODE_A);
    double forward = held(w, SDL_SCANCODE_W, SDL_SCANCODE_S);
    double up = held(w, SDL_SCANCODE_E, SDL_SCANCODE_Q);
    double turn = held(w, SDL_SCANCODE_RIGHT, SDL_SCANCODE_LEFT);
    double tilt = held(w, SDL_SCANCODE_UP, SDL_SCANCODE_DOWN);
    double speed = walk_m_per_s * (w->keys[SDL_SCANCODE_LSHIFT] ? 5.0 : 1.0) * dt_s;
    if (right == 0.0 && forward == 0.0 && up == 0.0 && turn == 0.0 && tilt == 0.0)
        return;
    view_pilot_step(&w->viewer->pilot, right * speed, forward * speed, up * speed);
    view_pilot_turn(&w->viewer->pilot, turn * dt_s, tilt * dt_s);
    viewer_moved(w->viewer);
}

/* ---- the window ---- */

static enum st fit(struct window *w, struct errctx *err) {
    int width = 0, height = 0;
    if (SDL_GetRendererOutputSize(w->renderer, &width, &height) || width < 1 || height < 1)
        width = height = 1;
    if (w->texture && w->im.width_px == width && w->im.height_px == height)
        return ST_OK;
    if (w->texture)
        SDL_DestroyTexture(w->texture);
    image_u8_destroy(&w->im);
    enum st st = image_u8_create(&w->im, width, height, 3);
    w->texture = st ? NULL
                    : SDL_CreateTexture(w->renderer, SDL_PIXELFORMAT_RGB24,
                                        SDL_TEXTUREACCESS_STREAMING, width, height);
    if (!w->texture)
        return errctx_set(err, ST_NOMEM, "no picture of %dx%d pixels for the window: %s", width,
                          height, SDL_GetError());
    w->exposed = true;
    return ST_OK;
}

static enum st open_window(struct window *w, const struct view_window_options *o,
                           struct errctx *err) {
    (void)SDL_SetHint(SDL_HINT_TOUCH_MOUSE_EVENTS, "0");
    if (SDL_Init(SDL_INIT_VIDEO))
        return errctx_set(err, ST_UNSUPPORTED,
                          "there is no display here (%s); 'scancart shot' and "
                          "'scancart fly' make pictures without one",
                          SDL_GetError());
    /* SDL must not make a GL context of its own beside ours, which is off-screen: on X11 a thread
     * can have only one of the two. */
    const char *driver = SDL_GetCurrentVideoDriver();
    if (driver && (!strcmp(driver, "x11") || !strcmp(driver, "wayland")))
        (void)SDL_SetHint(SDL_HINT_FRAMEBUFFER_ACCELERATION, "0");
    char title[VIEWER_TITLE_MAX + 16];
    (void)snprintf(title, sizeof title, "scancart: %s", w->viewer->title);
    Uint32 flags = SDL_WINDOW_RESIZABLE | (o->fullscreen ? SDL_WINDOW_FULLSCREEN_DESKTOP : 0u);
    w->sdl = SDL_CreateWindow(title, SDL_WINDOWPOS_CENTERED, SDL_WINDOWPOS_CENTERED, o->width_px,
                              o->height_px, flags);
    w->renderer = w->sdl ? SDL_CreateRenderer(w->sdl, -1, SDL_RENDERER_SOFTWARE) : NULL;
    if (!w->renderer)
        return errctx_set(err, ST_UNSUPPORTED, "no window can be opened: %s", SDL_GetError());
    SDL_StopTextInput(); /* keys are commands until a note is written */
    return fit(w, err);
}

static void close_window(struct window *w) {
    if (w->texture)
        SDL_DestroyTexture(w->texture);
    if (w->renderer)
        SDL_DestroyRenderer(w->renderer);
    if (w->sdl)
        SDL_DestroyWindow(w->sdl);
    SDL_Quit();
    image_u8_destroy(&w->im);
    view_play_close(w->play);
}

static void on_typed_key(struct window *w, SDL_Keycode key) {
    if (key == SDLK_BACKSPACE)
        viewer_type(w->viewer, "\b");
    else if (key == SDLK_RETURN || key == SDLK_KP_ENTER || key == SDLK_ESCAPE)
        viewer_type(w->viewer, "\n");
}

static void on_event(struct window *w, const SDL_Event *e) {
    if (e->type == SDL_QUIT)
        w->viewer->quit = true;
    else if (e->type == SDL_WINDOWEVENT)
        w->exposed = true;
    else if (e->type == SDL_RENDER_TARGETS_RESET || e->type == SDL_RENDER_DEVICE_RESET)
        w->exposed = true;
    else if (e->type == SDL_TEXTINPUT)
        viewer_type(w->viewer, e->text.text);
    else if (w->viewer->typing && e->type == SDL_KEYDOWN)
        on_typed_key(w, e->key.keysym.sym);
    else if (e->type == SDL_KEYDOWN || e->type == SDL_KEYUP) {
        bool down = e->type == SDL_KEYDOWN;
        if (e->key.keysym.scancode < SDL_NUM_SCANCODES)
            w->keys[e->key.keysym.scancode] = down;
        if (down && !e->key.repeat)
            viewer_act(w->viewer, action_of(e->key.keysym.sym));
    } else if (e->type == SDL_FINGERDOWN || e->type == SDL_FINGERUP || e->type == SDL_FINGERMOTION)
        on_finger(w, &e->tfinger);
    else
        on_mouse(w, e);
}

static enum st show(struct window *w, struct errctx *err) {
    enum st st = viewer_frame(w->viewer, &w->im, err);
    if (st)
        return st;
    (void)SDL_UpdateTexture(w->texture, NULL, w->im.px, (int)w->im.stride_bytes);
    (void)SDL_RenderCopy(w->renderer, w->texture, NULL, NULL);
    SDL_RenderPresent(w->renderer);
    w->exposed = false;
    return ST_OK;
}

static enum st save(struct window *w, struct errctx *err) {
    char path[64];
    (void)snprintf(path, sizeof path, "scancart-%lld.png", (long long)(clock_utc_ns() / 1000000));
    w->viewer->save_wanted = false;
    enum st st = picture_write_png(path, &w->im, err);
    viewer_say(w->viewer, st ? "%s" : "saved as %s", st ? err->text : path);
    return ST_OK; /* a full disk ends no session */
}

static enum st play(struct window *w, struct errctx *err) {
    struct view_play_order order;
    bool still = w->viewer->refined && w->viewer->scene_stats.complete;
    enum st st = view_play_step(w->play, still, SDL_GetWindowID(w->sdl), &order, err);
    if (!st && order.shot[0])
        st = picture_write_png(order.shot, &w->im, err);
    if (!st && order.width_px > 0)
        SDL_SetWindowSize(w->sdl, order.width_px, order.height_px);
    w->viewer->quit = w->viewer->quit || order.quit || order.ended;
    return st;
}

static enum st loop(struct window *w, struct errctx *err) {
    enum { IDLE_MS = 50 };
    enum st st = ST_OK;
    while (!st && !w->viewer->quit) {
        SDL_Event e;
        bool busy = w->play || w->exposed || viewer_wants_frame(w->viewer);
        bool got = busy ? SDL_PollEvent(&e) : SDL_WaitEventTimeout(&e, IDLE_MS);
        for (; got; got = SDL_PollEvent(&e))
            on_event(w, &e);
        if (w->viewer->typing != (SDL_IsTextInputActive() == SDL_TRUE))
            (w->viewer->typing ? SDL_StartTextInput : SDL_StopTextInput)();
        walk(w);
        st = fit(w, err);
        if (!st && (w->play || w->exposed || viewer_wants_frame(w->viewer)))
            st = show(w, err);
        if (!st && w->viewer->save_wanted)
            st = save(w, err);
        if (!st && w->play)
            st = play(w, err);
    }
    return st;
}

enum st view_window_run(struct viewer *viewer, const struct view_window_options *options,
                        struct errctx *err) {
    struct window w;
    memset(&w, 0, sizeof w);
    w.viewer = viewer;
    w.last_ns = clock_now_ns();
    enum st st = options->play ? view_play_open(options->play, &w.play, err) : ST_OK;
    if (!st)
        st = open_window(&w, options, err);
    if (!st)
        st = loop(&w, err);
    close_window(&w);
    return st;
}
