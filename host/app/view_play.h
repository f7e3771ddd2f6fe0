/* Input from a file instead of hands: for tests, tutorials and reports. One command a line:
 *   key NAME          press and release a key (SDL's name of it: "w", "Tab")
 *   hold NAME / free NAME
 *   down X Y [BUTTON] / move X Y / up X Y [BUTTON]     mouse, window pixels; button 1 left, 3 right
 *   wheel N           type TEXT
 *   finger-down ID X Y / finger-move ID X Y / finger-up ID X Y     0..1 of the window
 *   frames N          let N frames pass        still        until nothing is missing any more
 *   shot FILE         save what is on screen   size W H     resize the window
 *   quit
 * Empty lines and those that begin with # are not looked at. */
#ifndef SC_APP_VIEW_PLAY_H
#define SC_APP_VIEW_PLAY_H

#include "base/st.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct view_play; /* a file being played */

ST_MUST_CHECK enum st view_play_open(const char *path, struct view_play **out_play,
                                     struct errctx *err);
void view_play_close(struct view_play *play); /* takes NULL */

/* What the window has to do itself. */
struct view_play_order {
    bool ended, quit;
    char shot[1024];             /* file to save; "" */
    int32_t width_px, height_px; /* new size; 0: as it is */
};

/* Plays what comes before the next pause, pushing events to SDL. `still`: the last frame was
 * complete and refined. ST_FORMAT names the line that is not understood. */
ST_MUST_CHECK enum st view_play_step(struct view_play *play, bool still, uint32_t window_id,
                                     struct view_play_order *out_order, struct errctx *err);

#endif
