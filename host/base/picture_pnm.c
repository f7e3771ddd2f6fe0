/* PGM and PPM (P2 P3 P5 P6, 8 and 16 bits) and PFM (Pf PF): a header of words, then samples. The
 * header is text from outside: every number is bounded while it is read, and the promised samples
 * must be there before memory is taken for them. */
#include "base/picture_codec.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

struct pnm_cursor {
    const uint8_t *at, *end;
};

static bool is_space(uint8_t c) {
    return c == ' ' || (c >= '\t' && c <= '\r');
}

/* Skips white space and comments (# to the end of the line). */
static void skip_space(struct pnm_cursor *cursor) {
    while (cursor->at < cursor->end) {
        if (*cursor->at == '#')
            while (cursor->at < cursor->end && *cursor->at != '\n')
                cursor->at++;
        else if (is_space(*cursor->at))
            cursor->at++;
        else
            return;
    }
}

/* A decimal number of 0..max; false if there is none or it is larger. */
static bool read_number(struct pnm_cursor *cursor, uint32_t max, uint32_t *out_value) {
    skip_space(cursor);
    const uint8_t *start = cursor->at;
    uint32_t value = 0;
    while (cursor->at < cursor->end && *cursor->at >= '0' && *cursor->at <= '9') {
        value = value * 10 + (uint32_t)(*cursor->at++ - '0');
        if (value > max)
            return false;
    }
    *out_value = value;
    return cursor->at > start;
}

/* The one white space that ends a header. */
static bool end_header(struct pnm_cursor *cursor) {
    return cursor->at < cursor->end && is_space(*cursor->at++);
}

static enum st fail(struct errctx *err, const char *name, const char *what) {
    return errctx_set(err, ST_FORMAT, "%s: broken PGM, PPM or PFM: %s", name, what);
}

/* Samples as text. */
static enum st read_text(struct pnm_cursor *cursor, struct picture *picture, size_t count,
                         const char *name, struct errctx *err) {
    for (size_t i = 0; i < count; i++) {
        uint32_t value;
        if (!read_number(cursor, picture->value_max, &value))
            return fail(err, name, "a sample is missing, no number or above the maximum");
        if (picture->sample == PICTURE_U8)
            ((uint8_t *)picture->px)[i] = (uint8_t)value;
        else
            ((uint16_t *)picture->px)[i] = (uint16_t)value;
    }
    return ST_OK;
}

/* Samples as bytes, two of them high byte first. */
static enum st read_binary(const struct pnm_cursor *cursor, struct picture *picture, size_t count,
                           const char *name, struct errctx *err) {
    uint32_t largest = 0;
    if (picture->sample == PICTURE_U8) {
        memcpy(picture->px, cursor->at, count);
        for (size_t i = 0; i < count; i++)
            largest = cursor->at[i] > largest ? cursor->at[i] : largest;
    } else {
        for (size_t i = 0; i < count; i++) {
            uint32_t value = (uint32_t)cursor->at[2 * i] << 8 | cursor->at[2 * i + 1];
            ((uint16_t *)picture->px)[i] = (uint16_t)value;
            largest = value > largest ? value : largest;
        }
    }
    if (largest > picture->value_max)
        return fail(err, name, "a sample is above the maximum");
    return ST_OK;
}

static enum st decode_integers(struct pnm_cursor cursor, bool text, struct picture *picture,
                               const char *name, struct errctx *err) {
    if (!read_number(&cursor, 65535, &picture->value_max) || picture->value_max == 0 ||
        !end_header(&cursor))
        return fail(err, name, "the maximum is not within 1..65535");
    picture->sample = picture->value_max < 256 ? PICTURE_U8 : PICTURE_U16;
    size_t count =
        (size_t)picture->width_px * (size_t)picture->height_px * (size_t)picture->channels;
    size_t left = (size_t)(cursor.end - cursor.at);
    /* In text a sample takes a digit and a space, the last one a digit. */
    size_t need = text ? 2 * count - 1 : picture->sample == PICTURE_U8 ? count : 2 * count;
    if (left < need)
        return fail(err, name, "fewer samples than the header says");
    enum st st = picture_allocate(picture, name, err);
    if (st)
        return st;
    return text ? read_text(&cursor, picture, count, name, err)
                : read_binary(&cursor, picture, count, name, err);
}

/* The third word of a PFM header: a scale whose sign is the byte order. */
static bool read_scale(struct pnm_cursor *cursor, bool *out_little_endian) {
    char word[32];
    size_t n = 0;
    skip_space(cursor);
    while (cursor->at < cursor->end && !is_space(*cursor->at) && n + 1 < sizeof word)
        word[n++] = (char)*cursor->at++;
    word[n] = '\0';
    char *end = NULL;
    double scale = strtod(word, &end);
    *out_little_endian = scale < 0.0;
    return n > 0 && *end == '\0' && isfinite(scale) && scale != 0.0 && end_header(cursor);
}

static float float_from_bytes(const uint8_t *p, bool little_endian) {
    uint32_t bits =
        little_endian
            ? (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24
            : (uint32_t)p[3] | (uint32_t)p[2] << 8 | (uint32_t)p[1] << 16 | (uint32_t)p[0] << 24;
    float value;
    memcpy(&value, &bits, sizeof value);
    return isfinite(value) ? value : NAN;
}

static enum st decode_floats(struct pnm_cursor cursor, struct picture *picture, const char *name,
                             struct errctx *err) {
    bool little_endian = false;
    if (!read_scale(&cursor, &little_endian))
        return fail(err, name, "the scale is not a number");
    picture->sample = PICTURE_F32;
    size_t row = (size_t)picture->width_px * (size_t)picture->channels;
    size_t height = (size_t)picture->height_px;
    if ((size_t)(cursor.end - cursor.at) < 4 * row * height)
        return fail(err, name, "fewer samples than the header says");
    enum st st = picture_allocate(picture, name, err);
    if (st)
        return st;
    float *px = picture->px;
    for (size_t y = 0; y < height; y++) /* the file's first row is the lowest */
        for (size_t x = 0; x < row; x++)
            px[(height - 1 - y) * row + x] =
                float_from_bytes(cursor.at + 4 * (y * row + x), little_endian);
    return ST_OK;
}

enum st picture_pnm_decode(const uint8_t *data, size_t size, const char *name,
                           struct picture *out_picture, struct errctx *err) {
    if (size < 3 || data[0] != 'P' || !is_space(data[2]))
        return fail(err, name, "no header");
    struct pnm_cursor cursor = {data + 2, data + size};
    char kind = (char)data[1];
    uint32_t width = 0, height = 0;
    if (!read_number(&cursor, IMAGE_MAX_SIDE_PX, &width) ||
        !read_number(&cursor, IMAGE_MAX_SIDE_PX, &height) || width == 0 || height == 0)
        return fail(err, name, "the size is not within 1..65536");
    bool colour = kind == '3' || kind == '6' || kind == 'F';
    struct picture picture = {
        .width_px = (int32_t)width, .height_px = (int32_t)height, .channels = colour ? 3 : 1};
    enum st st = kind == 'f' || kind == 'F'
                     ? decode_floats(cursor, &picture, name, err)
                     : decode_integers(cursor, kind == '2' || kind == '3', &picture, name, err);
    if (st) {
        picture_destroy(&picture);
        return st;
    }
    *out_picture = picture;
    return ST_OK;
}
