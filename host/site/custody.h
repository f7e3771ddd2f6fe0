/* Custody: the append-only log of who did what to the site, when, with which program, as a hash
 * chain. The module itself logs creation, upgrades, changes of poses and georeference, replaced
 * photographs, and a seal over all tables when a writer closes. Whoever notes the newest link on
 * paper at the scene can prove later that nothing before it was changed.
 *
 *   link_0 = SHA-256("scancart/custody/1" 0 uuid of the site)
 *   link_n = SHA-256(link_n-1 | sequence i64 | utc_ns i64 | who 0 program 0 what 0 detail 0) */
#ifndef SC_SITE_CUSTODY_H
#define SC_SITE_CUSTODY_H

#include "base/hash.h"
#include "base/st.h"
#include "site/site.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct custody_event {
    int64_t sequence; /* 1, 2, 3, ... */
    int64_t utc_ns;   /* wall clock */
    char who[SITE_NAME_MAX], program[SITE_NAME_MAX];
    char what[SITE_KIND_MAX];   /* "created", "sealed", "capture.start", ... */
    char detail[SITE_TEXT_MAX]; /* JSON or "" */
    uint8_t link[HASH_SHA256_BYTES];
};

/* Appends an event with the site's actor and clock. `detail_json` may be NULL. */
ST_MUST_CHECK enum st custody_add(struct site *site, const char *what, const char *detail_json,
                                  struct errctx *err);

/* The newest event; ST_NOT_FOUND if there is none. */
ST_MUST_CHECK enum st custody_last(struct site *site, struct custody_event *out_event,
                                   struct errctx *err);

/* Pages through the events by sequence, see station_list(). */
ST_MUST_CHECK enum st custody_list(struct site *site, int64_t after_sequence,
                                   struct custody_event *out_events, size_t capacity,
                                   size_t *out_count, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
