/* What a viewer's user leaves behind: notes at places and views to come back to. They are kept
 * beside the site, in SITE.notes.json, since the viewer only reads the site itself. */
#ifndef SC_APP_VIEW_NOTES_H
#define SC_APP_VIEW_NOTES_H

#include "base/st.h"
#include "base/vec.h"
#include "render/view_pilot.h"

enum { VIEW_NOTES_MAX = 256, VIEW_NOTES_VIEWS_MAX = 64, VIEW_NOTES_TEXT = 120 };

struct view_note {
    struct vec3 p_m; /* world */
    char text[VIEW_NOTES_TEXT];
};

struct view_notes {
    struct view_note notes[VIEW_NOTES_MAX];
    int note_count;
    struct view_pilot views[VIEW_NOTES_VIEWS_MAX];
    int view_count;
};

/* Reads what is there; no file is no notes. ST_FORMAT for a file that is not one of ours, which is
 * then left alone. */
ST_MUST_CHECK enum st view_notes_load(const char *site_path, struct view_notes *out_notes,
                                      struct errctx *err);
/* Writes the file whole or not at all. */
ST_MUST_CHECK enum st view_notes_save(const char *site_path, const struct view_notes *notes,
                                      struct errctx *err);

#endif
