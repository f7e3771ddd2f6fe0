#include "base/config_check.h"

#include <cyaml/cyaml.h>
#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum { PATH_CHARS = 256 };

/* State of one walk. `path` is the key path of the current node. */
struct check {
    const char *name;
    yaml_document_t *document;
    const struct config_schema *schema;
    struct errctx *err;
    char path[PATH_CHARS];
};

static enum st walk(struct check *check, const yaml_node_t *node,
                    const struct cyaml_schema_value *schema);

/* "name:line: path: message" */
static enum st fail(struct check *check, const yaml_node_t *node, const char *fmt, ...)
    ST_PRINTF(3, 4);
static enum st fail(struct check *check, const yaml_node_t *node, const char *fmt, ...) {
    char text[600];
    va_list args;
    va_start(args, fmt);
    (void)vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    return errctx_set(check->err, ST_FORMAT, "%s:%zu: %s%s%s", check->name,
                      node->start_mark.line + 1, check->path, check->path[0] ? ": " : "", text);
}

/* Appends to the path (cut where it is longer than any sensible one); returns the old length. */
static size_t path_push(struct check *check, const char *separator, const char *key) {
    size_t length = strlen(check->path);
    (void)snprintf(check->path + length, PATH_CHARS - length, "%s%.60s", length ? separator : "",
                   key);
    return length;
}

static const char *scalar_text(const yaml_node_t *node) {
    return (const char *)node->data.scalar.value;
}

static const char *node_kind(const yaml_node_t *node) {
    switch (node->type) {
    case YAML_SCALAR_NODE:
        return "a single value";
    case YAML_SEQUENCE_NODE:
        return "a list";
    case YAML_MAPPING_NODE:
        return "a group of keys";
    case YAML_NO_NODE:
        break;
    }
    return "nothing";
}

/* [+-] then 0, a decimal number without leading zeros, or 0x and hexadecimal digits. (libcyaml
 * would read a leading zero as octal.) */
static bool is_integer(const char *s) {
    s += *s == '+' || *s == '-';
    if (s[0] == '0' && (s[1] == 'x' || s[1] == 'X'))
        return s[2] && s[2 + strspn(s + 2, "0123456789abcdefABCDEF")] == '\0';
    size_t digits = strspn(s, "0123456789");
    return digits > 0 && s[digits] == '\0' && (s[0] != '0' || digits == 1);
}

/* [+-] digits [. digits] [e [+-] digits], at least one digit before the e. */
static bool is_float(const char *s) {
    s += *s == '+' || *s == '-';
    size_t whole = strspn(s, "0123456789");
    s += whole;
    size_t fraction = 0;
    if (*s == '.') {
        fraction = strspn(s + 1, "0123456789");
        s += 1 + fraction;
    }
    if (whole + fraction == 0)
        return false;
    if (*s == 'e' || *s == 'E') {
        s++;
        s += *s == '+' || *s == '-';
        size_t exponent = strspn(s, "0123456789");
        if (exponent == 0)
            return false;
        s += exponent;
    }
    return *s == '\0';
}

/* True if the path "a[3].b[0]" fits the pattern "a[].b[]". */
static bool path_fits(const char *path, const char *pattern) {
    for (; *pattern; pattern++, path++) {
        if (*pattern != *path)
            return false;
        if (*path == '[')
            path += strspn(path + 1, "0123456789");
    }
    return *path == '\0';
}

static enum st check_range(struct check *check, const yaml_node_t *node, double value) {
    for (size_t i = 0; i < check->schema->range_count; i++) {
        const struct config_range *range = &check->schema->ranges[i];
        if (!path_fits(check->path, range->key))
            continue;
        if (!(value >= range->min && value <= range->max))
            return fail(check, node, "%s is not within %.10g..%.10g%s%s", scalar_text(node),
                        range->min, range->max, range->unit && range->unit[0] ? " " : "",
                        range->unit ? range->unit : "");
    }
    return ST_OK;
}

static enum st check_signed(struct check *check, const yaml_node_t *node, uint32_t bytes) {
    const char *text = scalar_text(node);
    if (!is_integer(text))
        return fail(check, node, "'%.60s' is not a whole number", text);
    errno = 0;
    long long value = strtoll(text, NULL, 0);
    long long max = bytes >= 8 ? INT64_MAX : (1LL << (8 * bytes - 1)) - 1;
    if (errno || value > max || value < -max - 1)
        return fail(check, node, "%.60s is not within %lld..%lld", text, -max - 1, max);
    return check_range(check, node, (double)value);
}

static enum st check_unsigned(struct check *check, const yaml_node_t *node, uint32_t bytes) {
    const char *text = scalar_text(node);
    if (!is_integer(text))
        return fail(check, node, "'%.60s' is not a whole number", text);
    errno = 0;
    unsigned long long value = strtoull(text, NULL, 0);
    unsigned long long max = bytes >= 8 ? UINT64_MAX : (1ULL << (8 * bytes)) - 1;
    if (errno || text[0] == '-' || value > max)
        return fail(check, node, "%.60s is not within 0..%llu", text, max);
    return check_range(check, node, (double)value);
}

static enum st check_float(struct check *check, const yaml_node_t *node, uint32_t bytes) {
    const char *text = scalar_text(node);
    if (!is_float(text))
        return fail(check, node, "'%.60s' is not a number", text);
    double value = strtod(text, NULL);
    if (!isfinite(value) || (bytes == sizeof(float) && !isfinite((float)value)))
        return fail(check, node, "%.60s is too large a number", text);
    return check_range(check, node, value);
}

static enum st check_boolean(struct check *check, const yaml_node_t *node) {
    static const char *const words[] = {"true", "false", "yes", "no", "on", "off"};
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++)
        if (!strcasecmp(scalar_text(node), words[i]))
            return ST_OK;
    return fail(check, node, "'%.60s' is neither true nor false", scalar_text(node));
}

static enum st check_string(struct check *check, const yaml_node_t *node,
                            const struct cyaml_schema_value *schema) {
    size_t length = node->data.scalar.length;
    if (length < schema->string.min)
        return fail(check, node, "text of %zu bytes; at least %u are needed", length,
                    (unsigned)schema->string.min);
    uint32_t max = schema->string.max;
    if (!(schema->flags & CYAML_FLAG_POINTER) && max >= schema->data_size)
        max = schema->data_size - 1;
    if (length > max)
        return fail(check, node, "text of %zu bytes; at most %u are allowed", length,
                    (unsigned)max);
    return ST_OK;
}

/* Adds ", word" to a list that is cut where it gets long. */
static void list_add(char *list, size_t size, const char *word) {
    size_t length = strlen(list);
    if (length + strlen(word) + 8 < size)
        (void)snprintf(list + length, size - length, "%s%s", length ? ", " : "", word);
    else if (length >= 3 && length + 5 < size && strcmp(list + length - 3, "...") != 0)
        (void)snprintf(list + length, size - length, " ...");
}

static enum st check_word(struct check *check, const yaml_node_t *node,
                          const struct cyaml_schema_value *schema) {
    char known[300] = "";
    for (uint32_t i = 0; i < schema->enumeration.count; i++) {
        if (!strcmp(scalar_text(node), schema->enumeration.strings[i].str))
            return ST_OK;
        list_add(known, sizeof known, schema->enumeration.strings[i].str);
    }
    return fail(check, node, "'%.60s' is none of: %s", scalar_text(node), known);
}

static enum st check_scalar(struct check *check, const yaml_node_t *node,
                            const struct cyaml_schema_value *schema) {
    static const char *const wanted[CYAML__TYPE_COUNT] = {
        [CYAML_INT] = "a whole number", [CYAML_UINT] = "a whole number",
        [CYAML_BOOL] = "true or false", [CYAML_ENUM] = "a word",
        [CYAML_FLOAT] = "a number",     [CYAML_STRING] = "text"};
    if (node->type != YAML_SCALAR_NODE)
        return fail(check, node, "%s where %s is wanted", node_kind(node), wanted[schema->type]);
    if (strlen(scalar_text(node)) != node->data.scalar.length)
        return fail(check, node, "a zero byte in a value");
    bool null_allowed = (schema->flags & CYAML_FLAG_POINTER_NULL) == CYAML_FLAG_POINTER_NULL;
    if (null_allowed && node->data.scalar.length == 0)
        return ST_OK;
    switch ((int)schema->type) { /* int: the composite types are not for here */
    case CYAML_INT:
        return check_signed(check, node, schema->data_size);
    case CYAML_UINT:
        return check_unsigned(check, node, schema->data_size);
    case CYAML_FLOAT:
        return check_float(check, node, schema->data_size);
    case CYAML_BOOL:
        return check_boolean(check, node);
    case CYAML_ENUM:
        return check_word(check, node, schema);
    default:
        return check_string(check, node, schema);
    }
}

static const struct cyaml_schema_field *find_field(const struct cyaml_schema_value *schema,
                                                   const char *key) {
    for (const struct cyaml_schema_field *f = schema->mapping.fields; f->key; f++)
        if (!strcmp(f->key, key))
            return f;
    return NULL;
}

static enum st fail_unknown_key(struct check *check, const yaml_node_t *key,
                                const struct cyaml_schema_value *schema) {
    char known[400] = "";
    for (const struct cyaml_schema_field *f = schema->mapping.fields; f->key; f++)
        list_add(known, sizeof known, f->key);
    return fail(check, key, "no such key '%.60s' (known: %s)", scalar_text(key), known);
}

/* One "key: value" of a mapping; `pair` is its index, to find the same key before it. */
static enum st check_pair(struct check *check, const yaml_node_t *node, ptrdiff_t pair,
                          const struct cyaml_schema_value *schema) {
    const yaml_node_pair_t *pairs = node->data.mapping.pairs.start;
    const yaml_node_t *key = yaml_document_get_node(check->document, pairs[pair].key);
    if (!key || key->type != YAML_SCALAR_NODE ||
        strlen(scalar_text(key)) != key->data.scalar.length)
        return fail(check, key ? key : node, "a key that is not a word");
    const struct cyaml_schema_field *field = find_field(schema, scalar_text(key));
    if (!field)
        return fail_unknown_key(check, key, schema);
    for (ptrdiff_t i = 0; i < pair; i++) {
        const yaml_node_t *other = yaml_document_get_node(check->document, pairs[i].key);
        if (!strcmp(scalar_text(other), scalar_text(key)))
            return fail(check, key, "key '%s' is here twice (first in line %zu)", field->key,
                        other->start_mark.line + 1);
    }
    size_t length = path_push(check, ".", field->key);
    enum st st =
        walk(check, yaml_document_get_node(check->document, pairs[pair].value), &field->value);
    check->path[length] = '\0';
    return st;
}

static enum st check_mapping(struct check *check, const yaml_node_t *node,
                             const struct cyaml_schema_value *schema) {
    if (node->type != YAML_MAPPING_NODE)
        return fail(check, node, "%s where a group of keys is wanted", node_kind(node));
    ptrdiff_t count = node->data.mapping.pairs.top - node->data.mapping.pairs.start;
    for (ptrdiff_t i = 0; i < count; i++) {
        enum st st = check_pair(check, node, i, schema);
        if (st)
            return st;
    }
    for (const struct cyaml_schema_field *f = schema->mapping.fields; f->key; f++) {
        bool found = (f->value.flags & CYAML_FLAG_OPTIONAL) != 0;
        for (ptrdiff_t i = 0; i < count && !found; i++)
            found = !strcmp(scalar_text(yaml_document_get_node(
                                check->document, node->data.mapping.pairs.start[i].key)),
                            f->key);
        if (!found)
            return fail(check, node, "the key '%s' is missing", f->key);
    }
    return ST_OK;
}

static enum st check_sequence(struct check *check, const yaml_node_t *node,
                              const struct cyaml_schema_value *schema) {
    if (node->type != YAML_SEQUENCE_NODE)
        return fail(check, node, "%s where a list is wanted", node_kind(node));
    bool words = schema->type == CYAML_FLAGS;
    ptrdiff_t count = node->data.sequence.items.top - node->data.sequence.items.start;
    if (!words &&
        (count < (ptrdiff_t)schema->sequence.min || count > (ptrdiff_t)schema->sequence.max))
        return schema->sequence.min == schema->sequence.max
                   ? fail(check, node, "a list of %td; it must have %u", count,
                          (unsigned)schema->sequence.min)
                   : fail(check, node, "a list of %td; it must have %u..%u", count,
                          (unsigned)schema->sequence.min, (unsigned)schema->sequence.max);
    for (ptrdiff_t i = 0; i < count; i++) {
        const yaml_node_t *item =
            yaml_document_get_node(check->document, node->data.sequence.items.start[i]);
        char index[32];
        (void)snprintf(index, sizeof index, "[%td]", i);
        size_t length = path_push(check, "", index);
        enum st st = !words ? walk(check, item, schema->sequence.entry)
                     : item->type == YAML_SCALAR_NODE
                         ? check_word(check, item, schema)
                         : fail(check, item, "%s where a word is wanted", node_kind(item));
        check->path[length] = '\0';
        if (st)
            return st;
    }
    return ST_OK;
}

static enum st walk(struct check *check, const yaml_node_t *node,
                    const struct cyaml_schema_value *schema) {
    enum st st = ST_OK;
    switch (schema->type) {
    case CYAML_MAPPING:
        st = check_mapping(check, node, schema);
        break;
    case CYAML_SEQUENCE:
    case CYAML_SEQUENCE_FIXED:
    case CYAML_FLAGS:
        st = check_sequence(check, node, schema);
        break;
    case CYAML_BITFIELD: /* left to libcyaml */
    case CYAML_IGNORE:
        break;
    case CYAML_INT:
    case CYAML_UINT:
    case CYAML_BOOL:
    case CYAML_ENUM:
    case CYAML_FLOAT:
    case CYAML_STRING:
    case CYAML__TYPE_COUNT:
        st = check_scalar(check, node, schema);
        break;
    }
    return st;
}

enum st config_check(const char *name, yaml_document_t *document,
                     const struct config_schema *schema, struct errctx *err) {
    struct check check = {.name = name, .document = document, .schema = schema, .err = err};
    return walk(&check, yaml_document_get_root_node(document), schema->top);
}
