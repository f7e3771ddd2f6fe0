/* Text in images: sharp, anti-aliased, UTF-8, from a TrueType font (DejaVu Sans of Debian's
 * fonts-dejavu-core unless $SCANCART_FONT names another). For contact sheets, legends and the
 * viewer's overlay. Rasterising is stb_truetype's. Not thread-safe on one font. */
#ifndef SC_BASE_TEXT_H
#define SC_BASE_TEXT_H

#include "base/image.h"
#include "base/st.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct text_font;

/* Loads a font; `path` NULL takes the default. ST_NOT_FOUND or ST_FORMAT with one line. */
ST_MUST_CHECK enum st text_font_open(const char *path, struct text_font **out_font,
                                     struct errctx *err);
void text_font_close(struct text_font *font); /* takes NULL */

/* Width of one line in pixels at the given size (height of the em square, px). */
double text_width_px(struct text_font *font, double size_px, const char *utf8);

/* Blends one line into an RGB or grey image; (x, y) is the left end of the baseline. Clipped to the
 * image. rgb holds the colour (its first value for grey images). Returns the advance in px. */
double text_draw(struct text_font *font, struct image_u8 *im, double x_px, double y_px,
                 double size_px, const uint8_t rgb[3], const char *utf8);

#ifdef __cplusplus
}
#endif
#endif
