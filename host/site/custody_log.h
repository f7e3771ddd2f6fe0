/* Custody events that the site module writes by itself. Only for host/site. */
#ifndef SC_SITE_CUSTODY_LOG_H
#define SC_SITE_CUSTODY_LOG_H

#include "base/hash.h"
#include "base/st.h"
#include "site/custody.h"
#include "site/store.h"

/* Appends an event within a batch. `detail` is "" or JSON. */
ST_MUST_CHECK enum st custody_log(struct site *site, const char *what, const char *detail,
                                  struct errctx *err);

/* The same with a detail made printf-style by a JSON template whose text arguments need no escapes.
 */
ST_MUST_CHECK enum st custody_logf(struct site *site, struct errctx *err, const char *what,
                                   const char *format, ...) ST_PRINTF(4, 5);

/* The first event of a writer's session: "opened", after a seal or after a crash. */
ST_MUST_CHECK enum st custody_log_open(struct site *site, struct errctx *err);

/* The last event of a session: "sealed" with the seal over all tables. */
ST_MUST_CHECK enum st custody_log_seal(struct site *site, struct errctx *err);

/* Link 0, and link n from link n-1 and the event. */
ST_MUST_CHECK enum st custody_log_first(const uint8_t uuid[16],
                                        uint8_t out_link[HASH_SHA256_BYTES]);
ST_MUST_CHECK enum st custody_log_link(const uint8_t before[HASH_SHA256_BYTES],
                                       const struct custody_event *event,
                                       uint8_t out_link[HASH_SHA256_BYTES]);

/* The event a statement on `SELECT * FROM custody` stands on. */
ST_MUST_CHECK enum st custody_log_read(sqlite3_stmt *stmt, struct custody_event *out_event,
                                       struct errctx *err);

#endif
