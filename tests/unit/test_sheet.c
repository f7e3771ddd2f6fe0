/* Contact sheets and the text in them. */
#include "base/sheet.h"
#include "base/text.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <string.h>

static int ink_in(const struct image_u8 *im) {
    int n = 0;
    for (int y = 0; y < im->height_px; y++)
        for (int x = 0; x < im->width_px; x++)
            n += image_u8_at(im, x, y)[0] > 128;
    return n;
}

static void draws_text_and_returns_its_width(void **state) {
    (void)state;
    struct text_font *font = NULL;
    struct image_u8 im = {0};
    assert_int_equal(text_font_open(NULL, &font, NULL), ST_OK);
    assert_int_equal(image_u8_create(&im, 200, 40, 1), ST_OK);
    const uint8_t white[3] = {255, 255, 255};
    double w_px = text_draw(font, &im, 4, 30, 20, white, "29.3 dB µm");
    assert_true(ink_in(&im) > 100);
    assert_true(w_px > 60 && w_px < 180);
    assert_true(text_width_px(font, 20, "29.3 dB µm") == w_px);
    image_u8_destroy(&im);
    text_font_close(font);
}

static void clips_text_and_survives_malformed_utf8(void **state) {
    (void)state;
    struct text_font *font = NULL;
    struct image_u8 im = {0};
    assert_int_equal(text_font_open(NULL, &font, NULL), ST_OK);
    assert_int_equal(image_u8_create(&im, 8, 8, 3), ST_OK);
    const uint8_t white[3] = {255, 255, 255};
    (void)text_draw(font, &im, -50, 4, 40, white, "clipped \xff\xe2\x82 \xf0");
    image_u8_destroy(&im);
    text_font_close(font);
}

static void refuses_a_missing_font(void **state) {
    (void)state;
    struct text_font *font = NULL;
    struct errctx err = {0};
    assert_int_not_equal(text_font_open("no/such/font.ttf", &font, &err), ST_OK);
    assert_non_null(strstr(err.text, "no/such/font.ttf"));
    assert_null(font);
}

static void shrinking_averages_areas(void **state) {
    (void)state;
    struct image_u8 fine = {0}, coarse = {0};
    assert_int_equal(image_u8_create(&fine, 4, 2, 1), ST_OK);
    assert_int_equal(image_u8_create(&coarse, 2, 1, 1), ST_OK);
    const uint8_t px[8] = {0, 100, 10, 20, 100, 200, 30, 40};
    for (int i = 0; i < 8; i++)
        *image_u8_at(&fine, i % 4, i / 4) = px[i];
    sheet_resize(&fine, &coarse);
    assert_int_equal(*image_u8_at(&coarse, 0, 0), 100);
    assert_int_equal(*image_u8_at(&coarse, 1, 0), 25);
    image_u8_destroy(&fine);
    image_u8_destroy(&coarse);
}

static void lays_out_rows_and_refuses_empty_pictures(void **state) {
    (void)state;
    struct image_u8 grey = {0}, page = {0};
    assert_int_equal(image_u8_create(&grey, 10, 5, 1), ST_OK);
    memset(grey.px, 255, 50);
    struct sheet_cell cells[3] = {
        {grey, "one", "first"}, {grey, "two", NULL}, {grey, "three", NULL}};
    struct sheet sheet = {
        .title = "a sheet", .cells = cells, .cell_count = 3, .columns = 2, .cell_width_px = 100};
    assert_int_equal(sheet_render(&sheet, &page, NULL), ST_OK);
    assert_true(ink_in(&page) >= 3 * 100 * 50);
    image_u8_destroy(&page);
    cells[1].image.width_px = 0;
    assert_int_equal(sheet_render(&sheet, &page, NULL), ST_INVALID);
    image_u8_destroy(&grey);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(draws_text_and_returns_its_width),
        cmocka_unit_test(clips_text_and_survives_malformed_utf8),
        cmocka_unit_test(refuses_a_missing_font),
        cmocka_unit_test(shrinking_averages_areas),
        cmocka_unit_test(lays_out_rows_and_refuses_empty_pictures),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
