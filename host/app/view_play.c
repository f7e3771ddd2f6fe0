#include "app/view_play.h"

#include "base/fileio.h"

#include <SDL.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct view_play {
    char *text, *at;
    int line, frames;
    bool until_still;
    char path[FILEIO_PATH_MAX];
};

enum st view_play_open(const char *path, struct view_play **out_play, struct errctx *err) {
    enum { MAX_BYTES = 1 << 20 };
    uint8_t *data = NULL;
    size_t size = 0;
    struct view_play *play = calloc(1, sizeof *play);
    if (!play)
        return errctx_set(err, ST_NOMEM, "no memory to read %s", path);
    enum st st = fileio_read(path, MAX_BYTES, &data, &size, err);
    if (st) {
        free(play);
        return st;
    }
    play->text = play->at = (char *)data;
    (void)snprintf(play->path, sizeof play->path, "%s", path);
    *out_play = play;
    return ST_OK;
}

void view_play_close(struct view_play *play) {
    if (!play)
        return;
    free(play->text);
    free(play);
}

static void push_key(const char *name, uint32_t window_id, bool press, bool release) {
    SDL_Event e;
    memset(&e, 0, sizeof e);
    e.key.keysym.sym = SDL_GetKeyFromName(name);
    e.key.keysym.scancode = SDL_GetScancodeFromKey(e.key.keysym.sym);
    e.key.windowID = window_id;
    e.type = SDL_KEYDOWN;
    e.key.state = SDL_PRESSED;
    if (press)
        (void)SDL_PushEvent(&e);
    e.type = SDL_KEYUP;
    e.key.state = SDL_RELEASED;
    if (release)
        (void)SDL_PushEvent(&e);
}

static void push_mouse(uint32_t type, int x, int y, int button, uint32_t window_id) {
    SDL_Event e;
    memset(&e, 0, sizeof e);
    e.type = type;
    if (type == SDL_MOUSEMOTION) {
        e.motion.windowID = window_id;
        e.motion.x = x;
        e.motion.y = y;
    } else {
        e.button.windowID = window_id;
        e.button.x = x;
        e.button.y = y;
        e.button.button = (Uint8)button;
        e.button.clicks = 1;
    }
    (void)SDL_PushEvent(&e);
}

static void push_finger(uint32_t type, long id, double x, double y, uint32_t window_id) {
    SDL_Event e;
    memset(&e, 0, sizeof e);
    e.type = type;
    e.tfinger.touchId = 1;
    e.tfinger.fingerId = id;
    e.tfinger.x = (float)x;
    e.tfinger.y = (float)y;
    e.tfinger.pressure = 1.0f;
    e.tfinger.windowID = window_id;
    (void)SDL_PushEvent(&e);
}

static bool play_mouse(const char *word, const char *rest, uint32_t window_id) {
    int x = 0, y = 0, button = 1, n = 0;
    if (!strcmp(word, "wheel")) {
        SDL_Event e;
        memset(&e, 0, sizeof e);
        e.type = SDL_MOUSEWHEEL;
        e.wheel.windowID = window_id;
        n = sscanf(rest, "%d", &e.wheel.y);
        return n == 1 && SDL_PushEvent(&e) >= 0;
    }
    n = sscanf(rest, "%d %d %d", &x, &y, &button);
    uint32_t type = !strcmp(word, "down")   ? SDL_MOUSEBUTTONDOWN
                    : !strcmp(word, "move") ? SDL_MOUSEMOTION
                    : !strcmp(word, "up")   ? SDL_MOUSEBUTTONUP
                                            : 0;
    if (!type || n < 2)
        return false;
    push_mouse(type, x, y, button, window_id);
    return true;
}

static bool play_finger(const char *word, const char *rest, uint32_t window_id) {
    long id;
    double x, y;
    uint32_t type = !strcmp(word, "finger-down")   ? SDL_FINGERDOWN
                    : !strcmp(word, "finger-move") ? SDL_FINGERMOTION
                    : !strcmp(word, "finger-up")   ? SDL_FINGERUP
                                                   : 0;
    if (!type || sscanf(rest, "%ld %lf %lf", &id, &x, &y) != 3)
        return false;
    push_finger(type, id, x, y, window_id);
    return true;
}

static bool play_key(const char *word, const char *rest, uint32_t window_id) {
    bool key = !strcmp(word, "key"), hold = !strcmp(word, "hold"), let = !strcmp(word, "free");
    if (!(key || hold || let) || SDL_GetKeyFromName(rest) == SDLK_UNKNOWN)
        return false;
    push_key(rest, window_id, key || hold, key || let);
    return true;
}

static bool play_type(const char *word, const char *rest) {
    if (strcmp(word, "type") != 0)
        return false;
    for (size_t at = 0; rest[at];) { /* an event holds a few characters */
        SDL_Event e;
        memset(&e, 0, sizeof e);
        e.type = SDL_TEXTINPUT;
        size_t n = strlen(rest + at), room = sizeof e.text.text - 1;
        n = n < room ? n : room;
        memcpy(e.text.text, rest + at, n);
        (void)SDL_PushEvent(&e);
        at += n;
    }
    return true;
}

/* One line; out_pause: nothing more in this frame. */
static bool play_line(struct view_play *play, const char *word, const char *rest,
                      uint32_t window_id, struct view_play_order *order, bool *out_pause) {
    *out_pause = true;
    if (!strcmp(word, "frames"))
        return sscanf(rest, "%d", &play->frames) == 1;
    if (!strcmp(word, "still"))
        return play->until_still = true;
    if (!strcmp(word, "quit"))
        return order->quit = true;
    if (!strcmp(word, "size"))
        return sscanf(rest, "%d %d", &order->width_px, &order->height_px) == 2;
    if (!strcmp(word, "shot")) {
        (void)snprintf(order->shot, sizeof order->shot, "%s", rest);
        return rest[0] != '\0';
    }
    *out_pause = false;
    return play_key(word, rest, window_id) || play_finger(word, rest, window_id) ||
           play_mouse(word, rest, window_id) || play_type(word, rest);
}

enum st view_play_step(struct view_play *play, bool still, uint32_t window_id,
                       struct view_play_order *out_order, struct errctx *err) {
    struct view_play_order order;
    memset(&order, 0, sizeof order);
    bool pause = false;
    play->until_still = play->until_still && !still;
    if (play->frames > 0)
        play->frames--;
    while (!pause && !play->frames && !play->until_still) {
        if (!*play->at) {
            order.ended = true;
            break;
        }
        char word[32] = "", rest[1024] = "";
        size_t n = strcspn(play->at, "\n");
        play->line++;
        bool last = play->at[n] == '\0';
        play->at[n] = '\0';
        int got = sscanf(play->at, "%31s %1023[^\n]", word, rest);
        bool ok =
            got < 1 || word[0] == '#' || play_line(play, word, rest, window_id, &order, &pause);
        if (!ok)
            return errctx_set(err, ST_FORMAT, "%s:%d: '%s' is no command", play->path, play->line,
                              play->at);
        play->at += last ? n : n + 1;
    }
    *out_order = order;
    return ST_OK;
}
