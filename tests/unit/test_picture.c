#include "base/fileio.h"
#include "base/picture.h"
#include "base/rng.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/tempdir.h"

#include <math.h>
#include <string.h>

/* A smooth picture with some noise; rows padded, so that strides are honoured or not. */
static struct image_u8 make_image(int32_t w, int32_t h, int32_t channels) {
    struct image_u8 im;
    assert_int_equal(image_u8_create(&im, w + 3, h, channels), ST_OK);
    im.width_px = w;
    struct rng rng = rng_make((uint64_t)(w * 1000 + h * 10 + channels));
    for (int32_t y = 0; y < h; y++)
        for (int32_t x = 0; x < w; x++)
            for (int32_t c = 0; c < channels; c++)
                image_u8_at(&im, x, y)[c] =
                    (uint8_t)(128 + 100 * sin(x * 0.2 + c) * cos(y * 0.15) + rng_below(&rng, 5));
    return im;
}

static void png_returns_every_value(void **state) {
    (void)state;
    struct errctx err = {0};
    for (int32_t channels = 1; channels <= 3; channels += 2) {
        static const int32_t sizes[][2] = {{1, 1}, {37, 5}, {5, 37}, {64, 64}};
        for (int k = 0; k < 4; k++) {
            struct image_u8 im = make_image(sizes[k][0], sizes[k][1], channels);
            uint8_t *data = NULL;
            size_t size = 0;
            assert_int_equal(picture_encode_png(&im, &data, &size, &err), ST_OK);
            struct picture p = {0};
            assert_int_equal(picture_decode(data, size, "x.png", &p, &err), ST_OK);
            assert_int_equal(p.channels, channels);
            assert_int_equal(p.sample, PICTURE_U8);
            assert_true(p.width_px == im.width_px && p.height_px == im.height_px);
            size_t row = (size_t)(im.width_px * channels);
            for (int32_t y = 0; y < im.height_px; y++)
                assert_memory_equal((uint8_t *)p.px + (size_t)y * row, image_u8_at(&im, 0, y), row);
            free(data);
            picture_destroy(&p);
            image_u8_destroy(&im);
        }
    }
}

static void png_of_16_bits_returns_every_value(void **state) {
    (void)state;
    struct errctx err = {0};
    struct image_u16 im, back;
    assert_int_equal(image_u16_create(&im, 40, 30, 1), ST_OK);
    for (int i = 0; i < 1200; i++)
        im.px[i] = (uint16_t)(i * 977);
    char dir[TEMPDIR_MAX], path[FILEIO_PATH_MAX];
    assert_true(tempdir_make(dir));
    assert_int_equal(fileio_join(dir, "depth.png", path, &err), ST_OK);
    assert_int_equal(picture_write_png16(path, &im, &err), ST_OK);
    assert_int_equal(picture_read_u16(path, &back, &err), ST_OK);
    assert_memory_equal(im.px, back.px, 1200 * sizeof im.px[0]);
    tempdir_remove(dir);
    image_u16_destroy(&im);
    image_u16_destroy(&back);
}

static void jpeg_stays_close_and_keeps_size(void **state) {
    (void)state;
    const double rms_max = 6.0; /* of 255, at quality 95 with half-resolution chroma */
    struct errctx err = {0};
    for (int32_t channels = 1; channels <= 3; channels += 2) {
        struct image_u8 im = make_image(61, 47, channels);
        uint8_t *data = NULL;
        size_t size = 0;
        assert_int_equal(picture_encode_jpeg(&im, 95, &data, &size, &err), ST_OK);
        struct picture p = {0};
        assert_int_equal(picture_decode(data, size, "x.jpg", &p, &err), ST_OK);
        assert_true(p.width_px == 61 && p.height_px == 47 && p.channels == channels);
        double sum = 0;
        for (int32_t y = 0; y < 47; y++)
            for (int32_t i = 0; i < 61 * channels; i++) {
                double d = ((uint8_t *)p.px)[y * 61 * channels + i] - image_u8_at(&im, 0, y)[i];
                sum += d * d;
            }
        assert_true(sqrt(sum / (61 * 47 * channels)) < rms_max);
        free(data);
        picture_destroy(&p);
        image_u8_destroy(&im);
    }
}

static struct picture decode_ok(const char *data, size_t size) {
    struct picture p = {0};
    struct errctx err = {0};
    if (picture_decode(data, size, "t", &p, &err))
        fail_msg("%s", err.text);
    return p;
}

static void pnm_of_every_kind_is_read(void **state) {
    (void)state;
    struct picture p = decode_ok("P5 2 2 255\n\x01\x02\x03\xff", 15);
    assert_memory_equal(p.px, "\x01\x02\x03\xff", 4);
    picture_destroy(&p);
    p = decode_ok("P5\n# comment\n2 1\n# more\n65535\n\x01\x02\xfe\xff", 37);
    assert_int_equal(p.sample, PICTURE_U16);
    assert_int_equal(((uint16_t *)p.px)[0], 0x0102);
    assert_int_equal(((uint16_t *)p.px)[1], 0xfeff);
    picture_destroy(&p);
    p = decode_ok("P6 1 1 255\nabc", 14);
    assert_int_equal(p.channels, 3);
    assert_memory_equal(p.px, "abc", 3);
    picture_destroy(&p);
    p = decode_ok("P2 3 1 9 1 #x\n2 9", 17);
    assert_memory_equal(p.px, "\x01\x02\x09", 3);
    struct image_u8 grey;
    assert_int_equal(picture_to_grey(&p, &grey, NULL), ST_OK);
    assert_int_equal(grey.px[0], 28); /* 255 / 9 */
    assert_int_equal(grey.px[2], 255);
    image_u8_destroy(&grey);
    picture_destroy(&p);
    p = decode_ok("P3 1 1 300 1 2 300", 18);
    assert_int_equal(((uint16_t *)p.px)[2], 300);
    picture_destroy(&p);
}

static void pfm_is_upright_in_both_byte_orders(void **state) {
    (void)state;
    /* rows from the lowest: 1.0, then infinity, which means no value */
    struct picture p = decode_ok("Pf\n1 2\n-1.0\n\x00\x00\x80\x3f\x00\x00\x80\x7f", 20);
    assert_int_equal(p.sample, PICTURE_F32);
    assert_true(isnan(((float *)p.px)[0]) && ((float *)p.px)[1] == 1.0f);
    picture_destroy(&p);
    p = decode_ok("Pf 1 1 0.5\n\x3f\x80\x00\x00", 15);
    assert_true(((float *)p.px)[0] == 1.0f);
    picture_destroy(&p);
}

static void broken_files_get_one_line_and_no_picture(void **state) {
    (void)state;
    static const struct {
        const char *data;
        size_t size;
    } cases[] = {
        {"", 0},
        {"GIF89a", 6},
        {"\x89PNG\r\n\x1a\n", 8},
        {"\xff\xd8\xff\xe0", 4},
        {"P5", 2},
        {"P5 2 2 255\n\x01\x02\x03", 14}, /* one sample short */
        {"P5 2 2 255", 10},               /* no samples */
        {"P5 0 2 255\n", 11},             /* no width */
        {"P5 99999999999 1 255\n", 21},   /* absurd */
        {"P5 65536 65536 255\nx", 20},    /* more than the file holds */
        {"P5 1 1 0\nx", 10},              /* no maximum */
        {"P5 1 1 65536\nxx", 15},
        {"P5 1 1 9\n\x10", 10}, /* sample above the maximum */
        {"P2 2 1 9 1", 10},
        {"P2 1 1 9 x", 10},
        {"P2 1 1 9 10", 11},
        {"P5 -1 1 255\n", 12},
        {"P5 1\n", 5},
        {"Pf 1 1 0\n....", 13},
        {"Pf 1 1 nan\n....", 15},
        {"Pf 1 1 1\n...", 12},
        {"P7 1 1 255\nx", 12},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct picture p = {0};
        struct errctx err = {0};
        if (picture_decode(cases[i].data, cases[i].size, "name", &p, &err) != ST_FORMAT)
            fail_msg("case %zu: %s", i, err.text);
        assert_null(p.px);
        assert_ptr_equal(strstr(err.text, "name"), err.text);
        assert_null(strchr(err.text, '\n'));
    }
}

/* Cut anywhere, a file is refused; it is never half a picture. */
static void every_truncation_is_refused(void **state) {
    (void)state;
    struct errctx err = {0};
    struct image_u8 im = make_image(23, 17, 3);
    for (int kind = 0; kind < 2; kind++) {
        uint8_t *data = NULL;
        size_t size = 0;
        assert_int_equal(kind ? picture_encode_jpeg(&im, 90, &data, &size, &err)
                              : picture_encode_png(&im, &data, &size, &err),
                         ST_OK);
        for (size_t n = 0; n < size; n++) {
            struct picture p = {0};
            uint8_t *cut = malloc(n ? n : 1); /* of the exact size, for the sanitizer */
            assert_non_null(cut);
            memcpy(cut, data, n);
            if (!picture_decode(cut, n, "cut", &p, &err))
                fail_msg("kind %d: %zu of %zu bytes are a picture", kind, n, size);
            free(cut);
        }
        free(data);
    }
    image_u8_destroy(&im);
}

static void absurd_png_header_takes_no_memory(void **state) {
    (void)state;
    struct errctx err = {0};
    struct image_u8 im = make_image(4, 4, 1);
    uint8_t *data = NULL;
    size_t size = 0;
    assert_int_equal(picture_encode_png(&im, &data, &size, &err), ST_OK);
    data[16] = 0;
    data[17] = 0;
    data[18] = 0x3f; /* 16128 pixels wide and high; the CRC of the header is made to fit */
    data[22] = 0x3f;
    uint32_t crc = 0xffffffffu;
    for (int i = 12; i < 29; i++) {
        crc ^= data[i];
        for (int k = 0; k < 8; k++)
            crc = crc >> 1 ^ (crc & 1 ? 0xedb88320u : 0);
    }
    for (int i = 0; i < 4; i++)
        data[29 + i] = (uint8_t)(~crc >> (24 - 8 * i));
    struct picture p = {0};
    assert_int_equal(picture_decode(data, size, "x", &p, &err), ST_FORMAT);
    assert_non_null(strstr(err.text, "pixels in"));
    free(data);
    image_u8_destroy(&im);
}

static void numbers_are_taken_from_grey_and_equal_channels_only(void **state) {
    (void)state;
    struct errctx err = {0};
    struct image_u16 im;
    struct picture p = decode_ok("P6 2 1 255\n\x05\x05\x05\x09\x09\x09", 17);
    assert_int_equal(picture_to_u16(&p, &im, &err), ST_OK);
    assert_true(im.px[0] == 5 && im.px[1] == 9);
    image_u16_destroy(&im);
    picture_destroy(&p);
    p = decode_ok("P6 1 1 255\n\x05\x05\x06", 14);
    assert_int_equal(picture_to_u16(&p, &im, &err), ST_UNSUPPORTED);
    struct image_f32 f;
    assert_int_equal(picture_to_f32(&p, &f, &err), ST_UNSUPPORTED);
    picture_destroy(&p);
    p = decode_ok("Pf 1 1 1\n\x3f\x80\x00\x00", 13);
    struct image_u8 rgb;
    assert_int_equal(picture_to_rgb(&p, &rgb, &err), ST_UNSUPPORTED);
    assert_int_equal(picture_to_u16(&p, &im, &err), ST_UNSUPPORTED);
    assert_int_equal(picture_to_f32(&p, &f, &err), ST_OK);
    assert_true(f.px[0] == 1.0f);
    image_f32_destroy(&f);
    picture_destroy(&p);
}

static void white_stays_white_in_grey(void **state) {
    (void)state;
    struct picture p = decode_ok("P6 2 1 255\n\xff\xff\xff\xff\x00\x00", 17);
    struct image_u8 im;
    assert_int_equal(picture_to_grey(&p, &im, NULL), ST_OK);
    assert_int_equal(im.px[0], 255);
    assert_int_equal(im.px[1], 76); /* 0.299 * 255 */
    image_u8_destroy(&im);
    picture_destroy(&p);
}

static void files_are_read_in_the_form_that_is_asked_for(void **state) {
    (void)state;
    struct errctx err = {0};
    char dir[TEMPDIR_MAX], png[FILEIO_PATH_MAX], jpg[FILEIO_PATH_MAX], pfm[FILEIO_PATH_MAX];
    assert_true(tempdir_make(dir));
    assert_int_equal(fileio_join(dir, "a.png", png, &err), ST_OK);
    assert_int_equal(fileio_join(dir, "a.jpg", jpg, &err), ST_OK);
    assert_int_equal(fileio_join(dir, "a.pfm", pfm, &err), ST_OK);
    struct image_u8 im = make_image(31, 21, 1), back;
    assert_int_equal(picture_write_png(png, &im, &err), ST_OK);
    assert_int_equal(picture_write_jpeg(jpg, &im, 90, &err), ST_OK);
    assert_int_equal(fileio_write(pfm, "Pf 1 1 1\n\x3f\x80\x00\x00", 13, &err), ST_OK);
    assert_int_equal(picture_read_rgb(png, &back, &err), ST_OK);
    assert_true(back.channels == 3 && back.width_px == 31 && back.height_px == 21);
    for (int c = 0; c < 3; c++)
        assert_int_equal(image_u8_at(&back, 30, 20)[c], *image_u8_at(&im, 30, 20));
    image_u8_destroy(&back);
    assert_int_equal(picture_read_grey(jpg, &back, &err), ST_OK);
    assert_int_equal(back.channels, 1);
    image_u8_destroy(&back);
    assert_int_equal(picture_read_rgb(pfm, &back, &err), ST_UNSUPPORTED);
    assert_ptr_equal(strstr(err.text, pfm), err.text); /* names the file */
    assert_int_equal(picture_read_grey("/nonexistent.png", &back, &err), ST_NOT_FOUND);
    assert_int_equal(picture_write_png("/nonexistent/a.png", &im, &err), ST_NOT_FOUND);
    struct image_u8 empty = {0};
    assert_int_equal(picture_write_png(png, &empty, &err), ST_INVALID);
    assert_ptr_equal(strstr(err.text, png), err.text);
    tempdir_remove(dir);
    image_u8_destroy(&im);
}

static void refuses_to_encode_what_is_no_picture(void **state) {
    (void)state;
    struct image_u8 empty = {0}, two = make_image(4, 4, 2);
    struct errctx err = {0};
    uint8_t *data = NULL;
    size_t size = 0;
    assert_int_equal(picture_encode_png(&empty, &data, &size, &err), ST_INVALID);
    assert_int_equal(picture_encode_jpeg(&empty, 90, &data, &size, &err), ST_INVALID);
    assert_int_equal(picture_encode_png(&two, &data, &size, &err), ST_INVALID);
    assert_int_equal(picture_encode_jpeg(&two, 90, &data, &size, &err), ST_INVALID);
    two.channels = 1;
    assert_int_equal(picture_encode_jpeg(&two, 0, &data, &size, &err), ST_INVALID);
    image_u8_destroy(&two);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(png_returns_every_value),
        cmocka_unit_test(png_of_16_bits_returns_every_value),
        cmocka_unit_test(jpeg_stays_close_and_keeps_size),
        cmocka_unit_test(pnm_of_every_kind_is_read),
        cmocka_unit_test(pfm_is_upright_in_both_byte_orders),
        cmocka_unit_test(broken_files_get_one_line_and_no_picture),
        cmocka_unit_test(every_truncation_is_refused),
        cmocka_unit_test(absurd_png_header_takes_no_memory),
        cmocka_unit_test(numbers_are_taken_from_grey_and_equal_channels_only),
        cmocka_unit_test(white_stays_white_in_grey),
        cmocka_unit_test(files_are_read_in_the_form_that_is_asked_for),
        cmocka_unit_test(refuses_to_encode_what_is_no_picture),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
