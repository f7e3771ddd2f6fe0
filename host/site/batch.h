/* Batches: what every changing function of this folder is wrapped in. Only for host/site. */
#ifndef SC_SITE_BATCH_H
#define SC_SITE_BATCH_H

#include "base/st.h"
#include "site/store.h"

/* Opens a batch unless the caller of the site has one open. ST_PERMISSION for a reader; the first
 * failure of a batch that has failed already. */
ST_MUST_CHECK enum st batch_begin(struct site *site, struct errctx *err);

/* Closes what batch_begin() opened: commits or, if st is a failure, rolls back. Returns st, or the
 * commit's own failure. Within the caller's batch a failure is kept for site_commit(). */
ST_MUST_CHECK enum st batch_end(struct site *site, enum st st, struct errctx *err);

#endif
