/* PNG by libspng. */
#include "base/picture_codec.h"

#include <spng.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* A deflate stream expands at most 1032 times (RFC 1951: 258 bytes from 2 bits). A header that
 * promises more pixels than the file can hold is refused before memory is taken. */
static bool is_plausible(const struct spng_ihdr *ihdr, size_t file_bytes) {
    static const int channels_of[7] = {1, 0, 3, 1, 2, 0, 4};
    uint64_t bits = (uint64_t)ihdr->bit_depth * (uint64_t)channels_of[ihdr->color_type];
    uint64_t raw_bytes = ((uint64_t)ihdr->width * bits + 7) / 8 * ihdr->height;
    return raw_bytes / 1032 <= file_bytes;
}

/* True if the chunks go on to a complete last one (IEND); libspng does not miss its checksum. */
static bool is_whole(const uint8_t *data, size_t size) {
    enum {
        SIGNATURE_BYTES = 8,
        CHUNK_BYTES = 12
    }; /* length, name and checksum around the content */
    size_t at = SIGNATURE_BYTES;
    while (size >= CHUNK_BYTES && at <= size - CHUNK_BYTES) {
        const uint8_t *p = data + at;
        size_t length = (size_t)p[0] << 24 | (size_t)p[1] << 16 | (size_t)p[2] << 8 | p[3];
        if (!memcmp(p + 4, "IEND", 4))
            return true;
        if (length > size)
            return false;
        at += CHUNK_BYTES + length;
    }
    return false;
}

/* What to decode to: grey and RGB as they are, everything with a palette or alpha to RGB of 8 bits.
 */
static int choose_format(const struct spng_ihdr *ihdr, struct picture *picture) {
    bool grey = ihdr->color_type == SPNG_COLOR_TYPE_GRAYSCALE;
    bool plain = grey || ihdr->color_type == SPNG_COLOR_TYPE_TRUECOLOR;
    picture->channels = grey ? 1 : 3;
    if (plain && ihdr->bit_depth == 16) {
        picture->sample = PICTURE_U16;
        picture->value_max = 65535;
        return SPNG_FMT_PNG;
    }
    picture->sample = PICTURE_U8;
    picture->value_max = 255;
    return grey ? SPNG_FMT_G8 : SPNG_FMT_RGB8;
}

static enum st decode(spng_ctx *ctx, const uint8_t *data, size_t size, const char *name,
                      struct picture *picture, struct errctx *err) {
    struct spng_ihdr ihdr;
    int rc = spng_set_image_limits(ctx, IMAGE_MAX_SIDE_PX, IMAGE_MAX_SIDE_PX);
    if (!rc)
        rc = spng_set_chunk_limits(ctx, size, size); /* no metadata larger than the file */
    if (!rc)
        rc = spng_set_png_buffer(ctx, data, size);
    if (!rc)
        rc = spng_get_ihdr(ctx, &ihdr);
    if (rc)
        return errctx_set(err, ST_FORMAT, "%s: broken PNG: %s", name, spng_strerror(rc));
    if (!is_plausible(&ihdr, size))
        return errctx_set(err, ST_FORMAT, "%s: broken PNG: %ux%u pixels in %zu bytes", name,
                          (unsigned)ihdr.width, (unsigned)ihdr.height, size);
    picture->width_px = (int32_t)ihdr.width;
    picture->height_px = (int32_t)ihdr.height;
    int format = choose_format(&ihdr, picture);
    enum st st = picture_allocate(picture, name, err);
    if (st)
        return st;
    size_t bytes = 0;
    size_t room = (size_t)picture->width_px * (size_t)picture->height_px *
                  (size_t)picture->channels * (picture->sample == PICTURE_U16 ? 2 : 1);
    rc = spng_decoded_image_size(ctx, format, &bytes);
    if (!rc && bytes != room)
        return errctx_set(err, ST_INTERNAL, "%s: PNG decodes to %zu bytes, not %zu", name, bytes,
                          room);
    if (!rc)
        rc = spng_decode_image(ctx, picture->px, room, format, 0);
    if (!rc)
        rc = spng_decode_chunks(ctx); /* to the end of the file, so that a cut one is noticed */
    if (rc)
        return errctx_set(err, ST_FORMAT, "%s: broken PNG: %s", name, spng_strerror(rc));
    return ST_OK;
}

enum st picture_png_decode(const uint8_t *data, size_t size, const char *name,
                           struct picture *out_picture, struct errctx *err) {
    if (!is_whole(data, size))
        return errctx_set(err, ST_FORMAT, "%s: broken PNG: it ends too early", name);
    spng_ctx *ctx = spng_ctx_new(0);
    if (!ctx)
        return errctx_set(err, ST_NOMEM, "%s: no memory for a PNG decoder", name);
    struct picture picture = {0};
    enum st st = decode(ctx, data, size, name, &picture, err);
    spng_ctx_free(ctx);
    if (st) {
        picture_destroy(&picture);
        return st;
    }
    *out_picture = picture;
    return ST_OK;
}

/* One picture to encode, whatever its sample size. */
struct png_source {
    const uint8_t *rows;
    size_t stride_bytes, row_bytes;
    int32_t width_px, height_px, channels, bits;
};

static int encode(spng_ctx *ctx, const struct png_source *source, uint8_t **out_data,
                  size_t *out_size) {
    enum { COMPRESSION_LEVEL = 4 }; /* of 9: within 2 % of the smallest in half the time */
    static const uint8_t colour_types[5] = {0, SPNG_COLOR_TYPE_GRAYSCALE, 0,
                                            SPNG_COLOR_TYPE_TRUECOLOR,
                                            SPNG_COLOR_TYPE_TRUECOLOR_ALPHA};
    struct spng_ihdr ihdr = {.width = (uint32_t)source->width_px,
                             .height = (uint32_t)source->height_px,
                             .bit_depth = (uint8_t)source->bits,
                             .color_type = colour_types[source->channels]};
    int rc = spng_set_option(ctx, SPNG_ENCODE_TO_BUFFER, 1);
    if (!rc)
        rc = spng_set_option(ctx, SPNG_IMG_COMPRESSION_LEVEL, COMPRESSION_LEVEL);
    if (!rc)
        rc = spng_set_ihdr(ctx, &ihdr);
    if (!rc)
        rc = spng_encode_image(ctx, NULL, 0, SPNG_FMT_PNG,
                               SPNG_ENCODE_PROGRESSIVE | SPNG_ENCODE_FINALIZE);
    for (int32_t y = 0; y < source->height_px && !rc; y++) {
        rc = spng_encode_row(ctx, source->rows + (size_t)y * source->stride_bytes,
                             source->row_bytes);
        if (rc == SPNG_EOI && y + 1 == source->height_px)
            rc = 0; /* said after the last row */
    }
    if (rc)
        return rc;
    *out_data = spng_get_png_buffer(ctx, out_size, &rc);
    return rc;
}

static enum st encode_source(const struct png_source *source, uint8_t **out_data, size_t *out_size,
                             struct errctx *err) {
    if (source->width_px < 1 || source->height_px < 1)
        return errctx_set(err, ST_INVALID, "an empty picture cannot be a PNG");
    if (source->channels < 1 || source->channels > 4 || source->channels == 2)
        return errctx_set(err, ST_INVALID, "a picture of %d channels cannot be a PNG",
                          (int)source->channels);
    spng_ctx *ctx = spng_ctx_new(SPNG_CTX_ENCODER);
    if (!ctx)
        return errctx_set(err, ST_NOMEM, "no memory for a PNG encoder");
    uint8_t *data = NULL;
    size_t size = 0;
    int rc = encode(ctx, source, &data, &size);
    spng_ctx_free(ctx);
    if (rc || !data)
        return errctx_set(err, rc == SPNG_EMEM ? ST_NOMEM : ST_INTERNAL, "cannot encode a PNG: %s",
                          spng_strerror(rc));
    *out_data = data;
    *out_size = size;
    return ST_OK;
}

enum st picture_encode_png(const struct image_u8 *im, uint8_t **out_data, size_t *out_size,
                           struct errctx *err) {
    struct png_source source = {.rows = im->px,
                                .stride_bytes = im->stride_bytes,
                                .row_bytes = (size_t)im->width_px * (size_t)im->channels,
                                .width_px = im->width_px,
                                .height_px = im->height_px,
                                .channels = im->channels,
                                .bits = 8};
    return encode_source(&source, out_data, out_size, err);
}

enum st picture_encode_png16(const struct image_u16 *im, uint8_t **out_data, size_t *out_size,
                             struct errctx *err) {
    struct png_source source = {.rows = (const uint8_t *)im->px,
                                .stride_bytes = im->stride_elem * 2,
                                .row_bytes = (size_t)im->width_px * (size_t)im->channels * 2,
                                .width_px = im->width_px,
                                .height_px = im->height_px,
                                .channels = im->channels,
                                .bits = 16};
    return encode_source(&source, out_data, out_size, err);
}
