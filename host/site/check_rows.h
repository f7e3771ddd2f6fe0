/* The part of site_check() that walks the tables. Only for host/site. */
#ifndef SC_SITE_CHECK_ROWS_H
#define SC_SITE_CHECK_ROWS_H

#include "site/check_walk.h"

/* Row hashes, digests, chunks and their chains, ledger, custody, what jobs refer to, the last seal.
 * Findings go to the walk; returns what check_walk_progress() returns. */
ST_MUST_CHECK enum st check_rows(struct check_walk *walk);

#endif
