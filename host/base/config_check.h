/* The check of a YAML tree against a schema. Not for use outside base. */
#ifndef SC_BASE_CONFIG_CHECK_H
#define SC_BASE_CONFIG_CHECK_H

#include "base/config.h"

#include <yaml.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ST_FORMAT with one line at the first place where the document does not follow the schema. The
 * document is a tree (no aliases) of bounded depth. */
ST_MUST_CHECK enum st config_check(const char *name, yaml_document_t *document,
                                   const struct config_schema *schema, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
