#include "base/text.h"

#include "base/fileio.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpedantic"
#include <stb_truetype.h>
#pragma GCC diagnostic pop

static const char default_font[] = "/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf";
enum { FONT_MAX_BYTES = 32 << 20, REPLACEMENT_CHARACTER = 0xFFFD };

struct text_font {
    stbtt_fontinfo info;
    uint8_t *bytes;
};

enum st text_font_open(const char *path, struct text_font **out_font, struct errctx *err) {
    if (!path)
        path = getenv("SCANCART_FONT");
    if (!path)
        path = default_font;
    struct text_font *font = calloc(1, sizeof *font);
    if (!font)
        return errctx_set(err, ST_NOMEM, "font %s: out of memory", path);
    size_t size = 0;
    enum st st = fileio_read(path, FONT_MAX_BYTES, &font->bytes, &size, err);
    if (st) {
        st = errctx_prefix(err, st, "font (install fonts-dejavu-core or set SCANCART_FONT)");
        goto out;
    }
    int offset = size >= 12 ? stbtt_GetFontOffsetForIndex(font->bytes, 0) : -1;
    if (offset < 0 || !stbtt_InitFont(&font->info, font->bytes, offset)) {
        st = errctx_set(err, ST_FORMAT, "font %s: not a TrueType font", path);
        goto out;
    }
    *out_font = font;
    font = NULL;
out:
    text_font_close(font);
    return st;
}

void text_font_close(struct text_font *font) {
    if (!font)
        return;
    free(font->bytes);
    free(font);
}

/* Decodes one code point and moves on; malformed bytes give the replacement character, one byte
 * each. */
static int next_codepoint(const char **s) {
    const unsigned char *p = (const unsigned char *)*s;
    int length = p[0] < 0x80       ? 1
                 : p[0] >> 5 == 6  ? 2
                 : p[0] >> 4 == 14 ? 3
                 : p[0] >> 3 == 30 ? 4
                                   : 0;
    int code = length == 1 ? p[0] : p[0] & (0xFF >> (length + 1));
    for (int i = 1; i < length; i++) {
        if (p[i] >> 6 != 2) {
            length = 0;
            break;
        }
        code = code << 6 | (p[i] & 0x3F);
    }
    if (length == 0) {
        *s += 1;
        return REPLACEMENT_CHARACTER;
    }
    *s += length;
    return code;
}

static double advance_px(struct text_font *font, double scale, int code, const char *rest) {
    int advance = 0, bearing = 0;
    stbtt_GetCodepointHMetrics(&font->info, code, &advance, &bearing);
    int kern = 0;
    if (*rest) {
        const char *ahead = rest;
        kern = stbtt_GetCodepointKernAdvance(&font->info, code, next_codepoint(&ahead));
    }
    return scale * (advance + kern);
}

double text_width_px(struct text_font *font, double size_px, const char *utf8) {
    double scale = (double)stbtt_ScaleForMappingEmToPixels(&font->info, (float)size_px), x_px = 0;
    while (*utf8) {
        int code = next_codepoint(&utf8);
        x_px += advance_px(font, scale, code, utf8);
    }
    return x_px;
}

static void blend(struct image_u8 *im, int x_px, int y_px, unsigned alpha, const uint8_t rgb[3]) {
    if (x_px < 0 || y_px < 0 || x_px >= im->width_px || y_px >= im->height_px)
        return;
    uint8_t *px = image_u8_at(im, x_px, y_px);
    int channels = im->channels < 3 ? 1 : 3;
    for (int c = 0; c < channels; c++)
        px[c] = (uint8_t)((px[c] * (255 - alpha) + rgb[c] * alpha + 127) / 255);
}

double text_draw(struct text_font *font, struct image_u8 *im, double x_px, double y_px,
                 double size_px, const uint8_t rgb[3], const char *utf8) {
    float scale = stbtt_ScaleForMappingEmToPixels(&font->info, (float)size_px);
    double start_px = x_px, baseline_px = floor(y_px + 0.5);
    while (*utf8) {
        int code = next_codepoint(&utf8);
        float shift_x = (float)(x_px - floor(x_px));
        int w = 0, h = 0, dx = 0, dy = 0;
        unsigned char *bitmap = stbtt_GetCodepointBitmapSubpixel(&font->info, scale, scale, shift_x,
                                                                 0, code, &w, &h, &dx, &dy);
        for (int j = 0; bitmap && j < h; j++)
            for (int i = 0; i < w; i++)
                blend(im, (int)floor(x_px) + dx + i, (int)baseline_px + dy + j, bitmap[j * w + i],
                      rgb);
        stbtt_FreeBitmap(bitmap, NULL);
        x_px += advance_px(font, (double)scale, code, utf8);
    }
    return x_px - start_px;
}
