/* JPEG by libjpeg-turbo. The library reports an error by a callback that must not return: it jumps
 * back to the function that called the library. All that both sides touch lives in one struct, so
 * that no local variable is lost by the jump. A warning (truncated or corrupt data) is an error
 * here: half a picture is not evidence. */
#include "base/picture_codec.h"

#include <stdio.h> /* before jpeglib.h, which uses FILE */

#include <jpeglib.h>
#include <setjmp.h>
#include <stdbool.h>
#include <stdlib.h>

struct jpeg_failure {
    struct jpeg_error_mgr base; /* first: the library knows this part only */
    jmp_buf back;
    char text[JMSG_LENGTH_MAX];
};

static void on_error(j_common_ptr common) {
    struct jpeg_failure *failure = (struct jpeg_failure *)common->err;
    common->err->format_message(common, failure->text);
    longjmp(failure->back, 1);
}

static void on_message(j_common_ptr common, int level) {
    if (level < 0)
        on_error(common);
}

static struct jpeg_error_mgr *failure_init(struct jpeg_failure *failure) {
    (void)jpeg_std_error(&failure->base);
    failure->base.error_exit = on_error;
    failure->base.emit_message = on_message;
    failure->text[0] = '\0';
    return &failure->base;
}

struct jpeg_reader {
    struct jpeg_decompress_struct jpeg;
    struct jpeg_failure failure;
    struct jpeg_progress_mgr progress;
    struct picture picture;
    enum st st;
};

/* A crafted progressive file can ask for hundreds of passes over a large picture. */
static void on_progress(j_common_ptr common) {
    enum { MAX_SCANS = 200 };
    struct jpeg_reader *reader = (struct jpeg_reader *)common;
    if (reader->jpeg.input_scan_number > MAX_SCANS) {
        (void)snprintf(reader->failure.text, sizeof reader->failure.text, "more than %d scans",
                       MAX_SCANS);
        longjmp(reader->failure.back, 1);
    }
}

static void read_steps(struct jpeg_reader *reader, const uint8_t *data, size_t size,
                       const char *name, struct errctx *err) {
    if (setjmp(reader->failure.back)) {
        reader->st = errctx_set(err, ST_FORMAT, "%s: broken JPEG: %s", name, reader->failure.text);
        return;
    }
    struct jpeg_decompress_struct *jpeg = &reader->jpeg;
    jpeg_create_decompress(jpeg);
    jpeg->progress = &reader->progress;
    jpeg_mem_src(jpeg, data, (unsigned long)size);
    (void)jpeg_read_header(jpeg, TRUE);
    bool grey = jpeg->jpeg_color_space == JCS_GRAYSCALE;
    if (!grey && jpeg->num_components != 3) {
        reader->st = errctx_set(err, ST_UNSUPPORTED, "%s: JPEG of %d channels; save it as RGB",
                                name, jpeg->num_components);
        return;
    }
    jpeg->out_color_space = grey ? JCS_GRAYSCALE : JCS_RGB;
    reader->picture = (struct picture){.width_px = (int32_t)jpeg->image_width,
                                       .height_px = (int32_t)jpeg->image_height,
                                       .channels = grey ? 1 : 3,
                                       .sample = PICTURE_U8,
                                       .value_max = 255};
    reader->st = picture_allocate(&reader->picture, name, err);
    if (reader->st)
        return;
    (void)jpeg_start_decompress(jpeg);
    size_t row_bytes = (size_t)jpeg->output_width * (size_t)jpeg->output_components;
    while (jpeg->output_scanline < jpeg->output_height) {
        JSAMPROW row = (JSAMPROW)reader->picture.px + (size_t)jpeg->output_scanline * row_bytes;
        (void)jpeg_read_scanlines(jpeg, &row, 1);
    }
    (void)jpeg_finish_decompress(jpeg);
}

enum st picture_jpeg_decode(const uint8_t *data, size_t size, const char *name,
                            struct picture *out_picture, struct errctx *err) {
    struct jpeg_reader reader = {.st = ST_OK};
    reader.jpeg.err = failure_init(&reader.failure);
    reader.progress.progress_monitor = on_progress;
    read_steps(&reader, data, size, name, err);
    jpeg_destroy_decompress(&reader.jpeg); /* takes a zeroed one */
    if (reader.st) {
        picture_destroy(&reader.picture);
        return reader.st;
    }
    *out_picture = reader.picture;
    return ST_OK;
}

struct jpeg_writer {
    struct jpeg_compress_struct jpeg;
    struct jpeg_failure failure;
    unsigned char *data;
    unsigned long size;
    enum st st;
};

static void write_steps(struct jpeg_writer *writer, const struct image_u8 *im, int quality,
                        struct errctx *err) {
    if (setjmp(writer->failure.back)) {
        writer->st = errctx_set(err, ST_NOMEM, "cannot encode a JPEG: %s", writer->failure.text);
        return;
    }
    struct jpeg_compress_struct *jpeg = &writer->jpeg;
    jpeg_create_compress(jpeg);
    jpeg_mem_dest(jpeg, &writer->data, &writer->size);
    jpeg->image_width = (JDIMENSION)im->width_px;
    jpeg->image_height = (JDIMENSION)im->height_px;
    jpeg->input_components = im->channels;
    jpeg->in_color_space = im->channels == 1 ? JCS_GRAYSCALE : JCS_RGB;
    jpeg_set_defaults(jpeg);
    jpeg_set_quality(jpeg, quality, TRUE);
    jpeg_start_compress(jpeg, TRUE);
    while (jpeg->next_scanline < jpeg->image_height) {
        JSAMPROW row = image_u8_at(im, 0, (int32_t)jpeg->next_scanline);
        (void)jpeg_write_scanlines(jpeg, &row, 1);
    }
    jpeg_finish_compress(jpeg);
}

enum st picture_encode_jpeg(const struct image_u8 *im, int quality, uint8_t **out_data,
                            size_t *out_size, struct errctx *err) {
    if (im->width_px < 1 || im->height_px < 1 || im->width_px > JPEG_MAX_DIMENSION ||
        im->height_px > JPEG_MAX_DIMENSION || (im->channels != 1 && im->channels != 3))
        return errctx_set(err, ST_INVALID,
                          "a picture of %dx%d pixels, %d channels cannot be a JPEG",
                          (int)im->width_px, (int)im->height_px, (int)im->channels);
    if (quality < 1 || quality > 100)
        return errctx_set(err, ST_INVALID, "JPEG quality %d is not within 1..100", quality);
    struct jpeg_writer writer = {.st = ST_OK};
    writer.jpeg.err = failure_init(&writer.failure);
    write_steps(&writer, im, quality, err);
    jpeg_destroy_compress(&writer.jpeg);
    if (writer.st) {
        free(writer.data);
        return writer.st;
    }
    *out_data = writer.data;
    *out_size = writer.size;
    return ST_OK;
}
