#include "base/json.h"

#include "base/fileio.h"

#include <cjson/cJSON.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

void json_init_object(struct json *json) {
    json->root = cJSON_CreateObject();
    json->failed = !json->root;
}

void json_init_array(struct json *json) {
    json->root = cJSON_CreateArray();
    json->failed = !json->root;
}

void json_fini(struct json *json) {
    if (!json)
        return;
    cJSON_Delete(json->root);
    json->root = NULL;
}

/* Puts an item in its place; a failure is remembered and the item freed. */
static struct cJSON *add(struct json *json, struct cJSON *parent, const char *key,
                         struct cJSON *item) {
    parent = parent ? parent : json->root;
    bool ok = parent && item &&
              (key ? cJSON_AddItemToObject(parent, key, item) : cJSON_AddItemToArray(parent, item));
    if (ok)
        return item;
    cJSON_Delete(item);
    json->failed = true;
    return NULL;
}

struct cJSON *json_object(struct json *json, struct cJSON *parent, const char *key) {
    return add(json, parent, key, cJSON_CreateObject());
}

struct cJSON *json_array(struct json *json, struct cJSON *parent, const char *key) {
    return add(json, parent, key, cJSON_CreateArray());
}

void json_number(struct json *json, struct cJSON *parent, const char *key, double value) {
    (void)add(json, parent, key, isfinite(value) ? cJSON_CreateNumber(value) : cJSON_CreateNull());
}

void json_integer(struct json *json, struct cJSON *parent, const char *key, int64_t value) {
    char digits[24]; /* cJSON keeps numbers as double: beyond 2^53 it would round */
    (void)snprintf(digits, sizeof digits, "%" PRId64, value);
    (void)add(json, parent, key, cJSON_CreateRaw(digits));
}

/* Length of the UTF-8 sequence at p (RFC 3629), 0 if it is none. */
static size_t utf8_length(const unsigned char *p) {
    if (p[0] < 0x80)
        return 1;
    size_t n = p[0] >= 0xf0 ? 4 : p[0] >= 0xe0 ? 3 : 2;
    if (p[0] < 0xc2 || p[0] > 0xf4)
        return 0;
    for (size_t i = 1; i < n; i++) /* stops at the terminating 0 */
        if ((p[i] & 0xc0) != 0x80)
            return 0;
    bool overlong = (p[0] == 0xe0 && p[1] < 0xa0) || (p[0] == 0xf0 && p[1] < 0x90);
    bool surrogate = p[0] == 0xed && p[1] >= 0xa0;
    bool beyond = p[0] == 0xf4 && p[1] >= 0x90;
    return overlong || surrogate || beyond ? 0 : n;
}

void json_text(struct json *json, struct cJSON *parent, const char *key, const char *text) {
    if (!text) {
        json_null(json, parent, key);
        return;
    }
    size_t size = strlen(text);
    char *clean = malloc(size + 1);
    if (!clean) {
        json->failed = true;
        return;
    }
    memcpy(clean, text, size + 1);
    for (size_t i = 0; i < size;) {
        size_t n = utf8_length((const unsigned char *)clean + i);
        if (n == 0)
            clean[i] = '?';
        i += n ? n : 1;
    }
    (void)add(json, parent, key, cJSON_CreateString(clean));
    free(clean);
}

void json_boolean(struct json *json, struct cJSON *parent, const char *key, bool value) {
    (void)add(json, parent, key, cJSON_CreateBool(value));
}

void json_null(struct json *json, struct cJSON *parent, const char *key) {
    (void)add(json, parent, key, cJSON_CreateNull());
}

enum st json_print(const struct json *json, char **out_text, struct errctx *err) {
    char *text = json->failed ? NULL : cJSON_Print(json->root);
    size_t size = text ? strlen(text) : 0;
    char *line = text ? realloc(text, size + 2) : NULL;
    if (!line) {
        free(text);
        return errctx_set(err, ST_NOMEM, "no memory for the JSON output");
    }
    memcpy(line + size, "\n", 2);
    *out_text = line;
    return ST_OK;
}

enum st json_write(const struct json *json, FILE *out, struct errctx *err) {
    char *text = NULL;
    enum st st = json_print(json, &text, err);
    if (st)
        return st;
    if (fputs(text, out) < 0 || fflush(out) != 0)
        st = errctx_set(err, ST_IO, "cannot write the JSON output");
    free(text);
    return st;
}

enum st json_write_file(const struct json *json, const char *path, struct errctx *err) {
    char *text = NULL;
    enum st st = json_print(json, &text, err);
    if (st)
        return st;
    st = fileio_write(path, text, strlen(text), err);
    free(text);
    return st;
}
