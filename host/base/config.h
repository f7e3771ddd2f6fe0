/* Configuration files: YAML that must follow a schema. The schema is libcyaml's (include
 * <cyaml/cyaml.h> and describe the struct with its macros), which also fills the struct. Before
 * that the file is held against the schema here, more strictly than libcyaml does (it takes "2z"
 * for 2 and "maybe" for true), so that every refusal is one line with file, line, key and what was
 * expected:
 *
 *   rig.yaml:7: mirror.speed_hz: 900 is not within 0.5..50 Hz
 *   rig.yaml:9: mirror: no such key 'sped_hz' (known: speed_hz, encoder_counts)
 *
 * Numbers are decimal (integers also 0x...), finite; booleans are true, false, yes, no, on, off;
 * aliases, repeated keys and second documents are refused. */
#ifndef SC_BASE_CONFIG_H
#define SC_BASE_CONFIG_H

#include "base/st.h"

#include <stdbool.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

struct cyaml_schema_value; /* of libcyaml */

/* Bounds of a number, both allowed. key: the path from the top, [] for any element of a sequence:
 * "mirror.speed_hz", "stations[].pose[]". A number without a row here is bounded by its type alone.
 */
struct config_range {
    const char *key;
    double min, max;
    const char *unit; /* for the message; "" if none */
};

struct config_schema {
    const struct cyaml_schema_value *top; /* a mapping with CYAML_FLAG_POINTER */
    const struct config_range *ranges;
    size_t range_count;
};

/* Largest configuration file. */
enum { CONFIG_MAX_BYTES = 4 << 20 };

/* The file as it was read: knows the line of every key. */
struct config;

/* Loads a file, or text in memory (`name` stands for the file in messages). *out_value is the
 * filled struct; keys that are absent leave zeros: use config_has() to tell. out_config may be
 * NULL; else free it with config_destroy(). ST_FORMAT with one line; ST_NOT_FOUND, ST_IO, ST_NOMEM.
 */
ST_MUST_CHECK enum st config_load(const char *path, const struct config_schema *schema,
                                  void **out_value, struct config **out_config, struct errctx *err);
ST_MUST_CHECK enum st config_load_text(const char *text, size_t size, const char *name,
                                       const struct config_schema *schema, void **out_value,
                                       struct config **out_config, struct errctx *err);

/* Frees what config_load() filled; takes NULL. */
void config_free(const struct config_schema *schema, void *value);
void config_destroy(struct config *config); /* takes NULL */

/* True if the file holds that key: "mirror.speed_hz", "stations[2].name". */
bool config_has(const struct config *config, const char *key);

/* Line of a key (from 1), of its nearest parent if the file does not hold it. */
int config_line(const struct config *config, const char *key);

/* For checks that the schema cannot express: writes "file:line: key: message" and returns
 * ST_FORMAT. */
enum st config_fail(const struct config *config, struct errctx *err, const char *key,
                    const char *fmt, ...) ST_PRINTF(4, 5);

#ifdef __cplusplus
}
#endif
#endif
