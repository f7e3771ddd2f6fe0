/* State of one walk of site_check(): findings, counts, progress. Only for host/site. */
#ifndef SC_SITE_CHECK_WALK_H
#define SC_SITE_CHECK_WALK_H

#include "base/st.h"
#include "site/site_check.h"
#include "site/store.h"

#include <stdint.h>

struct check_walk {
    struct site *site;
    const struct site_check_options *options; /* may be NULL */
    struct site_check_result result;
    int64_t max_errors;
    int64_t done_bytes, total_bytes, database_bytes;
};

/* Reports a finding. `where` as in struct site_check_finding. */
void check_walk_error(struct check_walk *walk, const char *where, const char *format, ...)
    ST_PRINTF(3, 4);
void check_walk_warning(struct check_walk *walk, const char *where, const char *format, ...)
    ST_PRINTF(3, 4);
/* The same for a row of a table. */
void check_walk_row(struct check_walk *walk, enum store_table table, int64_t id, const char *format,
                    ...) ST_PRINTF(4, 5);

/* Counts bytes as walked. ST_CANCELLED if the caller wants to stop, ST_FULL after max_errors. */
ST_MUST_CHECK enum st check_walk_progress(struct check_walk *walk, int64_t bytes);

#endif
