/* JSON output (cJSON underneath): build a tree, write it once. Failures are kept and told at the
 * end, so that building needs no checks. Numbers that are not finite become null, integers keep all
 * their digits, keys stay in the order they were added: same values, same text. */
#ifndef SC_BASE_JSON_H
#define SC_BASE_JSON_H

#include "base/st.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

struct cJSON;

struct json {
    struct cJSON *root; /* an object or an array */
    bool failed;        /* out of memory somewhere */
};

/* Starts a document that is an object, or an array. On the heap: end with json_fini(). */
void json_init_object(struct json *json);
void json_init_array(struct json *json);
void json_fini(struct json *json); /* takes a zeroed one or NULL */

/* Adds a member `key` to the object `parent`, or an element to the array `parent` (key NULL). A
 * parent of NULL is the root. The first two return the new container, to be a parent in turn. A
 * text of NULL is null; bytes that are not UTF-8 are replaced by '?'. */
struct cJSON *json_object(struct json *json, struct cJSON *parent, const char *key);
struct cJSON *json_array(struct json *json, struct cJSON *parent, const char *key);
void json_number(struct json *json, struct cJSON *parent, const char *key, double value);
void json_integer(struct json *json, struct cJSON *parent, const char *key, int64_t value);
void json_text(struct json *json, struct cJSON *parent, const char *key, const char *text);
void json_boolean(struct json *json, struct cJSON *parent, const char *key, bool value);
void json_null(struct json *json, struct cJSON *parent, const char *key);

/* Writes the document and a newline; ST_NOMEM if any of it is missing, ST_IO. json_write_file()
 * writes a file whole or not at all. json_print() gives a malloc'ed string (with the newline). */
ST_MUST_CHECK enum st json_write(const struct json *json, FILE *out, struct errctx *err);
ST_MUST_CHECK enum st json_write_file(const struct json *json, const char *path,
                                      struct errctx *err);
ST_MUST_CHECK enum st json_print(const struct json *json, char **out_text, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
