/* Any bytes as a configuration under a schema with every kind of value. */
#include "base/config.h"

#include <cyaml/cyaml.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

struct item {
    int16_t a;
    char *s;
};
struct all {
    double x;
    uint8_t u;
    bool b;
    int kind;
    uint32_t bits;
    float v[2];
    struct item *items;
    uint32_t items_count;
    char name[6];
};

static const cyaml_strval_t words[] = {{"one", 1}, {"two", 2}};
static const cyaml_schema_field_t item_fields[] = {
    CYAML_FIELD_INT("a", CYAML_FLAG_OPTIONAL, struct item, a),
    CYAML_FIELD_STRING_PTR("s", CYAML_FLAG_POINTER_NULL | CYAML_FLAG_OPTIONAL, struct item, s, 0,
                           9),
    CYAML_FIELD_END};
static const cyaml_schema_value_t item = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, struct item, item_fields)};
static const cyaml_schema_value_t number = {CYAML_VALUE_FLOAT(CYAML_FLAG_DEFAULT, float)};
static const cyaml_schema_field_t fields[] = {
    CYAML_FIELD_FLOAT("x", CYAML_FLAG_OPTIONAL, struct all, x),
    CYAML_FIELD_UINT("u", CYAML_FLAG_OPTIONAL, struct all, u),
    CYAML_FIELD_BOOL("b", CYAML_FLAG_OPTIONAL, struct all, b),
    CYAML_FIELD_ENUM("kind", CYAML_FLAG_OPTIONAL, struct all, kind, words, 2),
    CYAML_FIELD_FLAGS("bits", CYAML_FLAG_OPTIONAL, struct all, bits, words, 2),
    CYAML_FIELD_SEQUENCE_FIXED("v", CYAML_FLAG_OPTIONAL, struct all, v, &number, 2),
    CYAML_FIELD_SEQUENCE("items", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, struct all, items,
                         &item, 0, 5),
    CYAML_FIELD_STRING("name", CYAML_FLAG_OPTIONAL, struct all, name, 0),
    CYAML_FIELD_END};
static const cyaml_schema_value_t top = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, struct all, fields)};
static const struct config_range ranges[] = {{"x", -10, 10, "m"}, {"items[].a", 0, 100, ""}};
static const struct config_schema schema = {&top, ranges, 2};

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char *text = malloc(size ? size : 1);
    if (!text)
        return 0;
    memcpy(text, data, size);
    struct errctx err = {0};
    struct config *config = NULL;
    void *value = NULL;
    enum st st = config_load_text(text, size, "fuzz", &schema, &value, &config, &err);
    if (st) {
        if (value || config || !err.text[0] || strchr(err.text, '\n'))
            abort(); /* one line, nothing left */
    } else {
        const struct all *all = value;
        if (!(all->x >= -10 && all->x <= 10) || all->items_count > 5 || strlen(all->name) > 5)
            abort(); /* what was accepted follows the schema */
        (void)config_has(config, "items[0].s");
        config_destroy(config);
        config_free(&schema, value);
    }
    free(text);
    return 0;
}
