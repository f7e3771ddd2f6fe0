/* Contact sheets: pictures in a grid with captions under a title, as one picture for people. */
#ifndef SC_BASE_SHEET_H
#define SC_BASE_SHEET_H

#include "base/image.h"
#include "base/st.h"

#ifdef __cplusplus
extern "C" {
#endif

struct sheet_cell {
    struct image_u8 image; /* view: RGB, RGBA (alpha ignored) or grey; shrunk or enlarged to fit */
    const char *caption;   /* first line under the picture, UTF-8 */
    const char *detail;    /* second line, dimmer; may be NULL */
};

struct sheet {
    const char *title, *subtitle; /* subtitle may be NULL */
    const struct sheet_cell *cells;
    int cell_count;    /* 1..64 */
    int columns;       /* 1..8 */
    int cell_width_px; /* 64..2048; the height follows from each row's tallest picture */
};

/* Draws the sheet into a new RGB image. Shrinking averages areas, enlarging repeats pixels, so
 * nothing is invented. ST_INVALID for counts out of bounds, ST_NOT_FOUND without a font. */
ST_MUST_CHECK enum st sheet_render(const struct sheet *sheet, struct image_u8 *out_image,
                                   struct errctx *err);

/* Area-averaging resize of RGB/RGBA/grey into an existing image of the same channels or RGB. */
void sheet_resize(const struct image_u8 *source, struct image_u8 *target);

#ifdef __cplusplus
}
#endif
#endif
