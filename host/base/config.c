#include "base/config.h"

#include "base/config_check.h"
#include "base/fileio.h"

#include <cyaml/cyaml.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct config {
    char *name;
    yaml_document_t document;
};

/* Nesting that a configuration may have. libyaml's time grows with the square of the depth. */
enum { MAX_DEPTH = 64 };

static enum st fail_parser(const yaml_parser_t *parser, const char *name, struct errctx *err) {
    return errctx_set(err, parser->error == YAML_MEMORY_ERROR ? ST_NOMEM : ST_FORMAT,
                      "%s:%zu: not YAML: %s", name, parser->problem_mark.line + 1,
                      parser->problem ? parser->problem : "unreadable");
}

/* What an event adds to the depth. */
static int depth_step(yaml_event_type_t type) {
    if (type == YAML_SEQUENCE_START_EVENT || type == YAML_MAPPING_START_EVENT)
        return 1;
    return type == YAML_SEQUENCE_END_EVENT || type == YAML_MAPPING_END_EVENT ? -1 : 0;
}

/* Refuses by events what must not reach the document loader: aliases (a tree that is none), deep
 * nesting, no or several documents. */
static enum st scan_events(yaml_parser_t *parser, const char *name, struct errctx *err) {
    int depth = 0, documents = 0;
    for (bool end = false; !end;) {
        yaml_event_t event;
        if (!yaml_parser_parse(parser, &event))
            return fail_parser(parser, name, err);
        const char *fault = NULL;
        depth += depth_step(event.type);
        documents += event.type == YAML_DOCUMENT_START_EVENT;
        end = event.type == YAML_STREAM_END_EVENT;
        if (event.type == YAML_ALIAS_EVENT)
            fault = "an alias (*); repeat the value instead";
        else if (documents > 1)
            fault = "a second document; only one is read";
        else if (depth > MAX_DEPTH)
            fault = "nested too deeply";
        else if (end && documents == 0)
            fault = "the file is empty";
        size_t line = end ? 1 : event.start_mark.line + 1;
        yaml_event_delete(&event);
        if (fault)
            return errctx_set(err, ST_FORMAT, "%s:%zu: %s", name, line, fault);
    }
    return ST_OK;
}

/* Reads the one document of a text. */
static enum st parse(const char *text, size_t size, const char *name, yaml_document_t *out_document,
                     struct errctx *err) {
    yaml_parser_t parser;
    enum st st = ST_OK;
    for (int pass = 0; pass < 2 && !st; pass++) {
        if (!yaml_parser_initialize(&parser))
            return errctx_set(err, ST_NOMEM, "%s: no memory for a YAML parser", name);
        yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
        if (pass == 0)
            st = scan_events(&parser, name, err);
        else if (!yaml_parser_load(&parser, out_document))
            st = fail_parser(&parser, name, err);
        yaml_parser_delete(&parser);
    }
    return st;
}

/* Keeps the first message of libcyaml. */
static void keep_message(cyaml_log_t level, void *context, const char *fmt, va_list args) {
    struct errctx *message = context;
    (void)level;
    if (!message->text[0])
        (void)vsnprintf(message->text, sizeof message->text, fmt, args);
}

static cyaml_config_t cyaml_options(struct errctx *message) {
    cyaml_config_t options = {.log_fn = keep_message,
                              .log_ctx = message,
                              .log_level = CYAML_LOG_ERROR,
                              .mem_fn = cyaml_mem,
                              .flags = CYAML_CFG_NO_ALIAS};
    return options;
}

/* Lets libcyaml fill the struct. The text has passed config_check(): a failure is a schema mistake.
 */
static enum st fill(const char *text, size_t size, const char *name,
                    const struct config_schema *schema, void **out_value, struct errctx *err) {
    struct errctx message = {ST_OK, ""};
    cyaml_config_t options = cyaml_options(&message);
    cyaml_data_t *value = NULL;
    cyaml_err_t rc =
        cyaml_load_data((const uint8_t *)text, size, &options, schema->top, &value, NULL);
    if (rc == CYAML_OK && value) {
        *out_value = value;
        return ST_OK;
    }
    message.text[strcspn(message.text, "\n")] = '\0';
    return errctx_set(err, rc == CYAML_ERR_OOM ? ST_NOMEM : ST_FORMAT, "%s: %s: %s", name,
                      cyaml_strerror(rc), message.text);
}

void config_free(const struct config_schema *schema, void *value) {
    if (!value)
        return;
    struct errctx message = {ST_OK, ""};
    cyaml_config_t options = cyaml_options(&message);
    (void)cyaml_free(&options, schema->top, value, 0);
}

enum st config_load_text(const char *text, size_t size, const char *name,
                         const struct config_schema *schema, void **out_value,
                         struct config **out_config, struct errctx *err) {
    if (size > CONFIG_MAX_BYTES)
        return errctx_set(err, ST_FORMAT, "%s is larger than the %d bytes a configuration may have",
                          name, CONFIG_MAX_BYTES);
    struct config *config = calloc(1, sizeof *config);
    char *name_copy = config ? strdup(name) : NULL;
    if (!name_copy) {
        free(config);
        return errctx_set(err, ST_NOMEM, "%s: no memory", name);
    }
    config->name = name_copy;
    enum st st = parse(text, size, name, &config->document, err);
    if (st) {
        free(name_copy);
        free(config);
        return st;
    }
    void *value = NULL;
    st = config_check(name, &config->document, schema, err);
    if (!st)
        st = fill(text, size, name, schema, &value, err);
    if (st || !out_config) {
        config_destroy(config);
        config = NULL;
    }
    if (st)
        return st;
    *out_value = value;
    if (out_config)
        *out_config = config;
    return ST_OK;
}

enum st config_load(const char *path, const struct config_schema *schema, void **out_value,
                    struct config **out_config, struct errctx *err) {
    uint8_t *text = NULL;
    size_t size = 0;
    enum st st = fileio_read(path, CONFIG_MAX_BYTES, &text, &size, err);
    if (st)
        return st;
    st = config_load_text((const char *)text, size, path, schema, out_value, out_config, err);
    free(text);
    return st;
}

void config_destroy(struct config *config) {
    if (!config)
        return;
    yaml_document_delete(&config->document);
    free(config->name);
    free(config);
}

/* The node of a key path, or NULL; *out_nearest is the deepest node on the way, *out_line its line
 * (of the key where it has one). yaml_document_get_node() takes a document that is not const but
 * changes nothing. */
static yaml_node_t *find(const struct config *config, const char *key, size_t *out_line) {
    union {
        const yaml_document_t *in;
        yaml_document_t *out;
    } document = {.in = &config->document};
    yaml_node_t *node = yaml_document_get_root_node(document.out);
    *out_line = node->start_mark.line + 1;
    while (*key) {
        yaml_node_t *next = NULL;
        size_t length = strcspn(key, ".[");
        if (*key == '[' && node->type == YAML_SEQUENCE_NODE) {
            char *end = NULL;
            long index = strtol(key + 1, &end, 10);
            yaml_node_item_t *items = node->data.sequence.items.start;
            if (*end == ']' && index >= 0 && index < node->data.sequence.items.top - items)
                next = yaml_document_get_node(document.out, items[index]);
            if (next)
                *out_line = next->start_mark.line + 1;
            length = *end == ']' ? (size_t)(end - key) + 1 : strlen(key);
        } else if (*key != '[' && node->type == YAML_MAPPING_NODE) {
            yaml_node_pair_t *pair = node->data.mapping.pairs.start;
            for (; pair < node->data.mapping.pairs.top && !next; pair++) {
                yaml_node_t *k = yaml_document_get_node(document.out, pair->key);
                if (k && k->type == YAML_SCALAR_NODE && k->data.scalar.length == length &&
                    !memcmp(k->data.scalar.value, key, length)) {
                    next = yaml_document_get_node(document.out, pair->value);
                    *out_line = k->start_mark.line + 1;
                }
            }
        }
        if (!next)
            return NULL;
        node = next;
        key += length;
        key += *key == '.';
    }
    return node;
}

bool config_has(const struct config *config, const char *key) {
    size_t line;
    return find(config, key, &line) != NULL;
}

int config_line(const struct config *config, const char *key) {
    size_t line;
    (void)find(config, key, &line);
    return (int)line;
}

enum st config_fail(const struct config *config, struct errctx *err, const char *key,
                    const char *fmt, ...) {
    char text[512];
    va_list args;
    va_start(args, fmt);
    (void)vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    return errctx_set(err, ST_FORMAT, "%s:%d: %s: %s", config->name, config_line(config, key), key,
                      text);
}
