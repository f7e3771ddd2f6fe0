/* What `scancart info` prints about an open site. */
#ifndef SC_APP_APP_INFO_H
#define SC_APP_APP_INFO_H

#include "base/st.h"
#include "site/site.h"

/* For a person, on stdout. */
ST_MUST_CHECK enum st app_info_text(struct site *site, struct errctx *err);
/* For a program, on stdout: one JSON object. */
ST_MUST_CHECK enum st app_info_json(struct site *site, struct errctx *err);

#endif
