#include "base/sheet.h"

#include "base/text.h"

#include <math.h>
#include <string.h>

static const uint8_t paper[3] = {24, 26, 30}, ink[3] = {240, 240, 236}, dim[3] = {160, 166, 172};
enum {
    MARGIN_PX = 24,
    GAP_PX = 18,
    TITLE_PX = 30,
    SUBTITLE_PX = 17,
    CAPTION_PX = 17,
    DETAIL_PX = 14
};
enum { CAPTION_BLOCK_PX = 54, MAX_CELLS = 64, MAX_COLUMNS = 8 };

/* Mean of channel c over the source area [x0, x1) x [y0, y1), fractional borders weighted. */
static double area_mean(const struct image_u8 *im, double x0, double x1, double y0, double y1,
                        int c) {
    double sum = 0, weight = 0;
    for (int y = (int)y0; y < im->height_px && y < y1; y++) {
        double wy = fmin(y + 1, y1) - fmax(y, y0);
        for (int x = (int)x0; x < im->width_px && x < x1; x++) {
            double w = wy * (fmin(x + 1, x1) - fmax(x, x0));
            sum += w * image_u8_at(im, x, y)[c];
            weight += w;
        }
    }
    return weight > 0 ? sum / weight : 0;
}

void sheet_resize(const struct image_u8 *source, struct image_u8 *target) {
    double sx = (double)source->width_px / target->width_px;
    double sy = (double)source->height_px / target->height_px;
    for (int y = 0; y < target->height_px; y++) {
        for (int x = 0; x < target->width_px; x++) {
            uint8_t *px = image_u8_at(target, x, y);
            for (int c = 0; c < target->channels; c++) {
                int from = source->channels < 3 ? 0 : c;
                px[c] = sx <= 1 && sy <= 1 ? image_u8_at(source, (int)((x + 0.5) * sx),
                                                         (int)((y + 0.5) * sy))[from]
                                           : (uint8_t)(area_mean(source, x * sx, (x + 1) * sx,
                                                                 y * sy, (y + 1) * sy, from) +
                                                       0.5);
            }
        }
    }
}

static int cell_height_px(const struct sheet *sheet, int i) {
    const struct image_u8 *im = &sheet->cells[i].image;
    double h = (double)sheet->cell_width_px * im->height_px / im->width_px;
    return h < 1 ? 1 : (int)(h + 0.5);
}

static int row_height_px(const struct sheet *sheet, int row) {
    int tallest = 1;
    for (int i = row * sheet->columns; i < (row + 1) * sheet->columns && i < sheet->cell_count; i++)
        if (cell_height_px(sheet, i) > tallest)
            tallest = cell_height_px(sheet, i);
    return tallest;
}

static void draw_cell(const struct sheet *sheet, int i, int x_px, int y_px, int row_px,
                      struct text_font *font, struct image_u8 *page) {
    const struct sheet_cell *cell = &sheet->cells[i];
    struct image_u8 place = {.px = image_u8_at(page, x_px, y_px),
                             .width_px = sheet->cell_width_px,
                             .height_px = cell_height_px(sheet, i),
                             .channels = 3,
                             .stride_bytes = page->stride_bytes};
    sheet_resize(&cell->image, &place);
    double text_y = y_px + row_px + CAPTION_PX + 6;
    (void)text_draw(font, page, x_px, text_y, CAPTION_PX, ink, cell->caption);
    if (cell->detail)
        (void)text_draw(font, page, x_px, text_y + DETAIL_PX + 6, DETAIL_PX, dim, cell->detail);
}

static enum st check(const struct sheet *sheet, struct errctx *err) {
    if (sheet->cell_count < 1 || sheet->cell_count > MAX_CELLS || sheet->columns < 1 ||
        sheet->columns > MAX_COLUMNS || sheet->cell_width_px < 64 || sheet->cell_width_px > 2048)
        return errctx_set(err, ST_INVALID, "contact sheet: %d cells in %d columns of %d px",
                          sheet->cell_count, sheet->columns, sheet->cell_width_px);
    for (int i = 0; i < sheet->cell_count; i++)
        if (sheet->cells[i].image.width_px < 1 || sheet->cells[i].image.height_px < 1)
            return errctx_set(err, ST_INVALID, "contact sheet: picture %d is empty", i);
    return ST_OK;
}

enum st sheet_render(const struct sheet *sheet, struct image_u8 *out_image, struct errctx *err) {
    struct text_font *font = NULL;
    enum st st = check(sheet, err);
    if (!st)
        st = text_font_open(NULL, &font, err);
    if (st)
        return st;
    int rows = (sheet->cell_count + sheet->columns - 1) / sheet->columns;
    int head_px = MARGIN_PX + TITLE_PX + (sheet->subtitle ? SUBTITLE_PX + 10 : 0) + GAP_PX;
    int height_px = head_px + MARGIN_PX;
    for (int row = 0; row < rows; row++)
        height_px += row_height_px(sheet, row) + CAPTION_BLOCK_PX;
    int width_px = 2 * MARGIN_PX + sheet->columns * (sheet->cell_width_px + GAP_PX) - GAP_PX;
    struct image_u8 page = {0};
    st = image_u8_create(&page, width_px, height_px, 3);
    if (st) {
        (void)errctx_set(err, st, "contact sheet of %d x %d px: %s", width_px, height_px,
                         st_name(st));
        goto out;
    }
    for (int y = 0; y < height_px; y++)
        for (int x = 0; x < width_px; x++)
            memcpy(image_u8_at(&page, x, y), paper, 3);
    (void)text_draw(font, &page, MARGIN_PX, MARGIN_PX + TITLE_PX - 4, TITLE_PX, ink, sheet->title);
    if (sheet->subtitle)
        (void)text_draw(font, &page, MARGIN_PX, MARGIN_PX + TITLE_PX + SUBTITLE_PX + 4, SUBTITLE_PX,
                        dim, sheet->subtitle);
    int y_px = head_px;
    for (int row = 0; row < rows; row++) {
        int row_px = row_height_px(sheet, row);
        for (int k = 0; k < sheet->columns && row * sheet->columns + k < sheet->cell_count; k++)
            draw_cell(sheet, row * sheet->columns + k,
                      MARGIN_PX + k * (sheet->cell_width_px + GAP_PX), y_px, row_px, font, &page);
        y_px += row_px + CAPTION_BLOCK_PX;
    }
    *out_image = page;
out:
    text_font_close(font);
    return st;
}
