/* Rows of jobs: what their hashes refer to, and reading one whole. Only for host/site. */
#ifndef SC_SITE_JOB_ROW_H
#define SC_SITE_JOB_ROW_H

#include "base/hash.h"
#include "base/st.h"
#include "site/job.h"
#include "site/store.h"

#include <stdbool.h>

enum job_row_direction { JOB_ROW_INPUT = 1, JOB_ROW_OUTPUT = 2 };

/* True if something in the site has that hash: a file, a calibration record, a link of a stream's
 * chain (link 0 of an empty stream too), a job's key. */
ST_MUST_CHECK enum st job_row_knows(struct site *site, const uint8_t sha256[HASH_SHA256_BYTES],
                                    bool *out_known, struct errctx *err);

/* True if every output of a job is there: files also on the disk. */
ST_MUST_CHECK enum st job_row_has_outputs(struct site *site, int64_t job_id, bool *out_all,
                                          struct errctx *err);

#endif
