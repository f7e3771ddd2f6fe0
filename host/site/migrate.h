/* The database's schema and its history. Version n is made from version n - 1 by migration n; a new
 * site runs them all, so the history is tested each time. */
#ifndef SC_SITE_MIGRATE_H
#define SC_SITE_MIGRATE_H

#include "base/st.h"
#include "site/store.h"

#include <stdint.h>

enum { MIGRATE_NEWEST = 2, MIGRATE_APPLICATION_ID = 0x53434152 /* "SCAR" */ };

/* Runs the migrations after site->schema_version up to `version` in the open batch and updates
 * both. */
ST_MUST_CHECK enum st migrate_to(struct site *site, int32_t version, struct errctx *err);

/* ST_OK if the open database's tables and indexes are those of `version` to the letter; else
 * ST_DAMAGED and the first difference. */
ST_MUST_CHECK enum st migrate_verify(struct site *site, int32_t version, struct errctx *err);

#endif
