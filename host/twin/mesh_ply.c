#include "twin/mesh_ply.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_ELEMENTS = 16, MAX_PROPERTIES = 64, MAX_CORNERS = 65536 };

enum encoding { ASCII, LITTLE, BIG };

enum type { I8, U8, I16, U16, I32, U32, F32, F64, TYPES };

static const struct {
    const char *name, *alias;
    int bytes;
} types[TYPES] = {{"char", "int8", 1},     {"uchar", "uint8", 1},   {"short", "int16", 2},
                  {"ushort", "uint16", 2}, {"int", "int32", 4},     {"uint", "uint32", 4},
                  {"float", "float32", 4}, {"double", "float64", 8}};

struct property {
    enum type type, count_type; /* count_type: of a list */
    int is_list;
    int role; /* vertex: 1 2 3 for x y z; face: 1 for the corners; 0: skipped */
};

struct element {
    int is_vertex, is_face;
    unsigned long long count;
    struct property property[MAX_PROPERTIES];
    int property_count;
};

struct ply {
    const char *at, *end, *name;
    struct errctx *err;
    enum encoding encoding;
    struct element element[MAX_ELEMENTS];
    int element_count;
    struct mesh *mesh;
};

static enum st fail(struct ply *p, const char *what) {
    return errctx_set(p->err, ST_FORMAT, "%s: PLY: %s", p->name, what);
}

static int type_of(const char *word, enum type *out) {
    for (int i = 0; i < TYPES; i++)
        if (!strcmp(word, types[i].name) || !strcmp(word, types[i].alias)) {
            *out = (enum type)i;
            return 1;
        }
    return 0;
}

/* ---- header ---- */

static enum st header_element(struct ply *p, const char *name, const char *count) {
    if (p->element_count >= MAX_ELEMENTS)
        return fail(p, "too many elements in the header");
    struct element *e = &p->element[p->element_count++];
    char *end = NULL;
    e->count = strtoull(count, &end, 10);
    if (end == count || *end || *count == '-')
        return fail(p, "an element's count is not a number");
    e->is_vertex = !strcmp(name, "vertex");
    e->is_face = !strcmp(name, "face");
    return ST_OK;
}

static enum st header_property(struct ply *p, char words[6][64], int count) {
    if (!p->element_count)
        return fail(p, "a property before any element");
    struct element *e = &p->element[p->element_count - 1];
    if (e->property_count >= MAX_PROPERTIES)
        return fail(p, "too many properties");
    struct property *q = &e->property[e->property_count++];
    q->is_list = !strcmp(words[1], "list");
    int ok = q->is_list
                 ? count == 5 && type_of(words[2], &q->count_type) && type_of(words[3], &q->type)
                 : count == 3 && type_of(words[1], &q->type);
    if (!ok || (q->is_list && q->count_type >= F32))
        return fail(p, "a property of unknown type");
    const char *name = words[count - 1];
    if (e->is_vertex && !q->is_list && name[0] >= 'x' && name[0] <= 'z' && !name[1])
        q->role = name[0] - 'x' + 1;
    if (e->is_face && q->is_list &&
        (!strcmp(name, "vertex_indices") || !strcmp(name, "vertex_index")))
        q->role = 1;
    return ST_OK;
}

/* Splits one header line into words; returns their number, -1 at the end of the text. */
static int header_line(struct ply *p, char words[6][64]) {
    const char *newline = memchr(p->at, '\n', (size_t)(p->end - p->at));
    if (!newline)
        return -1;
    char line[256];
    size_t length = (size_t)(newline - p->at);
    length = length < sizeof line - 1 ? length : sizeof line - 1;
    memcpy(line, p->at, length);
    line[length] = 0;
    p->at = newline + 1;
    return sscanf(line, "%63s %63s %63s %63s %63s %63s", words[0], words[1], words[2], words[3],
                  words[4], words[5]);
}

static enum st header(struct ply *p) {
    char words[6][64];
    int has_format = 0;
    for (int lines = 0; lines < 10000; lines++) {
        int n = header_line(p, words);
        enum st st = ST_OK;
        if (n < 0)
            return fail(p, "the header does not end");
        if (n < 1 || !strcmp(words[0], "ply") || !strcmp(words[0], "comment") ||
            !strcmp(words[0], "obj_info"))
            continue;
        if (!strcmp(words[0], "end_header"))
            return has_format ? ST_OK : fail(p, "no format");
        if (!strcmp(words[0], "format") && n >= 2) {
            has_format = 1;
            if (!strcmp(words[1], "ascii"))
                p->encoding = ASCII;
            else if (!strcmp(words[1], "binary_little_endian"))
                p->encoding = LITTLE;
            else if (!strcmp(words[1], "binary_big_endian"))
                p->encoding = BIG;
            else
                st = fail(p, "unknown format");
        } else if (!strcmp(words[0], "element") && n == 3) {
            st = header_element(p, words[1], words[2]);
        } else if (!strcmp(words[0], "property") && n >= 3) {
            st = header_property(p, words, n);
        } else {
            st = fail(p, "a header line that makes no sense");
        }
        if (st)
            return st;
    }
    return fail(p, "the header does not end");
}

/* ---- body ---- */

static int read_ascii(struct ply *p, double *out) {
    char *after = NULL;
    while (p->at < p->end && (*p->at == ' ' || *p->at == '\t' || *p->at == '\r' || *p->at == '\n'))
        p->at++;
    if (p->at >= p->end)
        return 0;
    *out = strtod(p->at, &after);
    if (after == p->at || after > p->end)
        return 0;
    p->at = after;
    return 1;
}

static int read_value(struct ply *p, enum type type, double *out) {
    if (p->encoding == ASCII)
        return read_ascii(p, out);
    int bytes = types[type].bytes;
    if (p->end - p->at < bytes)
        return 0;
    uint64_t raw = 0;
    for (int i = 0; i < bytes; i++) {
        int from = p->encoding == LITTLE ? bytes - 1 - i : i;
        raw = raw << 8 | (uint8_t)p->at[from];
    }
    p->at += bytes;
    uint32_t raw32 = (uint32_t)raw;
    float f;
    memcpy(&f, &raw32, sizeof f);
    switch (type) {
    case I8:
        *out = (double)(int8_t)raw;
        break;
    case I16:
        *out = (double)(int16_t)raw;
        break;
    case I32:
        *out = (double)(int32_t)raw32;
        break;
    case F32:
        *out = (double)f;
        break;
    case F64:
        memcpy(out, &raw, sizeof *out);
        break;
    case U8:
    case U16:
    case U32:
    case TYPES:
        *out = (double)raw;
        break;
    }
    return 1;
}

static enum st read_list(struct ply *p, const struct property *q) {
    double n = 0, value = 0;
    if (!read_value(p, q->count_type, &n))
        return fail(p, "the file ends in a list");
    if (!(n >= 0 && n <= MAX_CORNERS))
        return fail(p, "a list of an absurd length");
    if (q->role && n < 3)
        return fail(p, "a face needs three corners");
    uint32_t first = 0, before = 0;
    for (int i = 0; i < (int)n; i++) {
        if (!read_value(p, q->type, &value))
            return fail(p, "the file ends in a list");
        if (!q->role)
            continue;
        if (!(value >= 0 && value < (double)p->mesh->vertex_count))
            return fail(p, "a face names a vertex that is not there");
        uint32_t corner = (uint32_t)value;
        if (i >= 2)
            mesh_triangle(p->mesh, first, before, corner, 0);
        first = i ? first : corner;
        before = corner;
    }
    return p->mesh->st ? errctx_set(p->err, p->mesh->st, "%s: PLY: too many triangles", p->name)
                       : ST_OK;
}

static enum st read_item(struct ply *p, const struct element *e, unsigned long long number) {
    double xyz[3] = {0, 0, 0};
    for (int i = 0; i < e->property_count; i++) {
        const struct property *q = &e->property[i];
        if (q->is_list) {
            enum st st = read_list(p, q);
            if (st)
                return st;
            continue;
        }
        double value = 0;
        if (!read_value(p, q->type, &value))
            return fail(p, e->is_vertex ? "the file ends among the vertices"
                                        : "the file ends too early");
        if (e->is_vertex && q->role)
            xyz[q->role - 1] = value;
    }
    if (!e->is_vertex)
        return ST_OK;
    struct vec3 v = vec3_make(xyz[0], xyz[1], xyz[2]);
    if (!vec3_is_finite(v) || vec3_norm(v) > 1e30)
        return errctx_set(p->err, ST_INVALID, "%s: PLY: vertex %llu is not a finite number",
                          p->name, number);
    (void)mesh_vertex(p->mesh, v, vec3_make(0, 0, 0));
    return p->mesh->st
               ? errctx_set(p->err, p->mesh->st, "%s: PLY: no memory for the vertices", p->name)
               : ST_OK;
}

/* A file cannot hold more items than bytes: refuses absurd counts at once. */
static enum st plausible(struct ply *p, const struct element *e) {
    if (e->property_count && e->count > (unsigned long long)(p->end - p->at))
        return fail(p, "the header promises more than the file can hold");
    if (!e->property_count && e->count)
        return fail(p, "an element without properties");
    if (!e->is_vertex)
        return ST_OK;
    int roles = 0;
    for (int i = 0; i < e->property_count; i++)
        roles |= 1 << e->property[i].role;
    return (roles & 14) == 14 ? ST_OK : fail(p, "the vertices have no x, y and z");
}

enum st mesh_ply(const char *text, size_t size, const char *name, struct mesh *mesh,
                 struct errctx *err) {
    struct ply *p = calloc(1, sizeof *p);
    if (!p)
        return errctx_set(err, ST_NOMEM, "%s: out of memory", name);
    p->at = text;
    p->end = text + size;
    p->name = name;
    p->err = err;
    p->mesh = mesh;
    enum st st = header(p);
    for (int i = 0; i < p->element_count && !st; i++) {
        const struct element *e = &p->element[i];
        st = plausible(p, e);
        for (unsigned long long k = 0; k < e->count && !st; k++)
            st = read_item(p, e, k);
    }
    free(p);
    return st;
}
