#include "import/ply_header.h"

#include <math.h>
#include <string.h>

static const struct {
    const char *name;
    enum ply_type type;
} type_names[] = {
    {"char", PLY_INT8},       {"uchar", PLY_UINT8},    {"short", PLY_INT16},
    {"ushort", PLY_UINT16},   {"int", PLY_INT32},      {"uint", PLY_UINT32},
    {"float", PLY_FLOAT32},   {"double", PLY_FLOAT64}, {"int8", PLY_INT8},
    {"uint8", PLY_UINT8},     {"int16", PLY_INT16},    {"uint16", PLY_UINT16},
    {"int32", PLY_INT32},     {"uint32", PLY_UINT32},  {"float32", PLY_FLOAT32},
    {"float64", PLY_FLOAT64},
};

static const size_t type_bytes[] = {
    [PLY_INT8] = 1,  [PLY_UINT8] = 1,  [PLY_INT16] = 2,   [PLY_UINT16] = 2,
    [PLY_INT32] = 4, [PLY_UINT32] = 4, [PLY_FLOAT32] = 4, [PLY_FLOAT64] = 8};

static bool parse_type(struct number_text *text, enum ply_type *out_type) {
    char word[PLY_NAME_MAX];
    if (!number_text_word(text, word, sizeof word))
        return false;
    for (size_t i = 0; i < sizeof type_names / sizeof type_names[0]; i++)
        if (!strcmp(word, type_names[i].name)) {
            *out_type = type_names[i].type;
            return true;
        }
    return false;
}

static enum st bad_line(const struct number_text *text, const char *what, struct errctx *err) {
    return errctx_set(err, ST_FORMAT, "line %zu: %s", text->line, what);
}

static enum st parse_format(struct ply_header *h, struct number_text *text, struct errctx *err) {
    static const char *const names[] = {"ascii", "binary_little_endian", "binary_big_endian"};
    char word[PLY_NAME_MAX], version[8];
    if (!number_text_word(text, word, sizeof word) ||
        !number_text_word(text, version, sizeof version) || strcmp(version, "1.0"))
        return bad_line(text, "not 'format KIND 1.0'", err);
    for (int i = 0; i < 3; i++)
        if (!strcmp(word, names[i])) {
            h->encoding = (enum ply_encoding)i;
            return ST_OK;
        }
    return bad_line(text, "this kind of format is not known", err);
}

static enum st parse_element(struct ply_header *h, struct number_text *text, struct errctx *err) {
    if (h->element_count == PLY_ELEMENTS_MAX)
        return bad_line(text, "too many elements", err);
    struct ply_element *e = &h->elements[h->element_count];
    if (!number_text_word(text, e->name, sizeof e->name) || !number_text_integer(text, &e->count) ||
        e->count < 0)
        return bad_line(text, "not 'element NAME COUNT'", err);
    h->element_count++;
    return ST_OK;
}

static bool is_integer_type(enum ply_type type) {
    return type != PLY_FLOAT32 && type != PLY_FLOAT64;
}

static enum st parse_property(struct ply_header *h, struct number_text *text, struct errctx *err) {
    if (h->element_count == 0)
        return bad_line(text, "a property before the first element", err);
    struct ply_element *e = &h->elements[h->element_count - 1];
    if (e->property_count == PLY_PROPERTIES_MAX)
        return bad_line(text, "too many properties", err);
    struct ply_property *p = &e->properties[e->property_count];
    const struct number_text before = *text;
    char word[PLY_NAME_MAX];
    p->is_list = number_text_word(text, word, sizeof word) && !strcmp(word, "list");
    if (!p->is_list)
        *text = before;
    if ((p->is_list && (!parse_type(text, &p->count_type) || !is_integer_type(p->count_type))) ||
        !parse_type(text, &p->type) || !number_text_word(text, p->name, sizeof p->name))
        return bad_line(text, "not 'property TYPE NAME' or 'property list TYPE TYPE NAME'", err);
    e->property_count++;
    return ST_OK;
}

static void parse_obj_info(struct ply_header *h, struct number_text *text) {
    char word[PLY_NAME_MAX];
    int64_t value = 0;
    if (!number_text_word(text, word, sizeof word) || !number_text_integer(text, &value))
        return; /* free text */
    if (!strcmp(word, "num_rows"))
        h->num_rows = value;
    if (!strcmp(word, "num_cols"))
        h->num_columns = value;
}

enum st ply_header_parse(const void *data, size_t size, struct ply_header *out_header,
                         struct number_text *out_body, struct errctx *err) {
    struct ply_header h;
    memset(&h, 0, sizeof h);
    struct number_text text = number_text_start(data, size);
    char word[PLY_NAME_MAX];
    if (!number_text_word(&text, word, sizeof word) || strcmp(word, "ply"))
        return errctx_set(err, ST_FORMAT, "not a PLY file: it does not begin with 'ply'");
    bool has_format = false;
    for (;;) {
        number_text_next_line(&text);
        if (text.at == text.end)
            return bad_line(&text, "the header has no 'end_header'", err);
        if (!number_text_word(&text, word, sizeof word))
            return bad_line(&text, "not a line of a PLY header", err);
        enum st st = ST_OK;
        if (!strcmp(word, "end_header"))
            break;
        if (!strcmp(word, "format")) {
            st = parse_format(&h, &text, err);
            has_format = true;
        } else if (!strcmp(word, "element")) {
            st = parse_element(&h, &text, err);
        } else if (!strcmp(word, "property")) {
            st = parse_property(&h, &text, err);
        } else if (!strcmp(word, "obj_info")) {
            parse_obj_info(&h, &text);
        } else if (strcmp(word, "comment") != 0) {
            st = bad_line(&text, "not a line of a PLY header", err);
        }
        if (st)
            return st;
    }
    if (!has_format)
        return bad_line(&text, "the header has no 'format'", err);
    number_text_next_line(&text);
    *out_header = h;
    *out_body = text;
    return ST_OK;
}

static uint64_t load_bits(const unsigned char *from, size_t n, bool big_endian) {
    uint64_t bits = 0;
    for (size_t i = 0; i < n; i++)
        bits |= (uint64_t)from[i] << 8 * (big_endian ? n - 1 - i : i);
    return bits;
}

static double from_bits(uint64_t bits, enum ply_type type) {
    float f = 0.0f;
    double d = 0.0;
    const uint32_t low = (uint32_t)bits;
    switch (type) {
    case PLY_INT8:
        return (int8_t)bits;
    case PLY_UINT8:
    case PLY_UINT16:
    case PLY_UINT32:
        return (double)bits;
    case PLY_INT16:
        return (int16_t)bits;
    case PLY_INT32:
        return (int32_t)low;
    case PLY_FLOAT32:
        memcpy(&f, &low, sizeof f);
        return (double)f;
    case PLY_FLOAT64:
        memcpy(&d, &bits, sizeof d);
        return d;
    }
    return NAN;
}

bool ply_header_scalar(const struct ply_header *header, struct number_text *body,
                       enum ply_type type, double *out_value) {
    if (header->encoding == PLY_ASCII)
        return !number_text_at_end(body) && number_text_double(body, out_value);
    const size_t n = type_bytes[type];
    if ((size_t)(body->end - body->at) < n)
        return false;
    unsigned char bytes[8];
    memcpy(bytes, body->at, n);
    body->at += n;
    *out_value = from_bits(load_bits(bytes, n, header->encoding == PLY_BIG_ENDIAN), type);
    return isfinite(*out_value);
}

size_t ply_header_least_bytes(const struct ply_header *header, const struct ply_element *element) {
    size_t bytes = 0;
    for (int i = 0; i < element->property_count; i++) {
        const struct ply_property *p = &element->properties[i];
        bytes +=
            header->encoding == PLY_ASCII ? 2 : type_bytes[p->is_list ? p->count_type : p->type];
    }
    return bytes ? bytes : 1;
}
