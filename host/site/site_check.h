/* Verifies a whole site: the database's structure and schema, the hash of every row, the digest of
 * every table, the CRC and chain of every chunk, the balance of the ledger, the custody chain, the
 * presence and hash of every file, what jobs refer to, and files that nobody knows. Changes
 * nothing. The site is untrusted input. */
#ifndef SC_SITE_SITE_CHECK_H
#define SC_SITE_SITE_CHECK_H

#include "base/st.h"
#include "site/site.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum site_check_severity {
    SITE_CHECK_WARNING =
        1, /* untidy, nothing measured is touched: a file without a row, a log left by a crash */
    SITE_CHECK_ERROR = 2 /* content is missing or is not what was written */
};

struct site_check_finding {
    enum site_check_severity severity;
    char where[256]; /* "site.db: table chunk, row 17" or "frames/ab...cd.jpg" */
    char what[256];
};

struct site_check_options {
    /* Called for each finding in the order of the walk; may be NULL. */
    void (*on_finding)(void *context, const struct site_check_finding *finding);
    /* Called now and then with bytes walked and to walk; false stops with ST_CANCELLED. May be
     * NULL. */
    bool (*on_progress)(void *context, int64_t done_bytes, int64_t total_bytes);
    void *context;
    int32_t max_findings; /* the walk stops after so many errors; 0: 1000 */
};

struct site_check_result {
    int64_t errors, warnings;
    int64_t rows, chunks, files, bytes; /* verified */
    struct site_check_finding
        first;          /* the first error, or the first warning if there is no error */
    bool stopped_early; /* max_findings was reached */
};

/* Walks the site. ST_OK: the walk reached its end (or max_findings): see out_result->errors. Other
 * statuses mean that nothing could be checked: ST_NOT_FOUND (no site there), ST_IO, ST_PERMISSION,
 * ST_NOMEM, ST_UNSUPPORTED (made by a newer program), ST_CANCELLED. A site.db that cannot be opened
 * because it is damaged is a finding. Cost: reads everything once; memory bounded by the largest
 * value. */
ST_MUST_CHECK enum st site_check(const char *path, const struct site_check_options *options,
                                 struct site_check_result *out_result, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
