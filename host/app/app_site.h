/* What subcommands that open a site share. */
#ifndef SC_APP_APP_SITE_H
#define SC_APP_APP_SITE_H

#include "base/st.h"
#include "site/site.h"

#include <stddef.h>
#include <stdint.h>

/* Opens a site; a writer's custody events then name "scancart VERSION COMMAND". Errors as
 * site_open(). */
ST_MUST_CHECK enum st app_site_open(const char *path, enum site_mode mode, const char *command,
                                    struct site **out_site, struct errctx *err);
void app_site_set_actor(struct site *site, const char *command);

/* "14.7 MB"; decimal units, three digits. Returns out_text. */
enum { APP_SITE_TEXT_MAX = 40 };
const char *app_site_bytes(int64_t bytes, char out_text[APP_SITE_TEXT_MAX]);
/* "2026-11-22 00:41:07 UTC". Returns out_text. */
const char *app_site_time(int64_t utc_ns, char out_text[APP_SITE_TEXT_MAX]);

#endif
