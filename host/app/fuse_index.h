/* The controller's index events of a station, from its "index" stream, with the host's time. */
#ifndef SC_APP_FUSE_INDEX_H
#define SC_APP_FUSE_INDEX_H

#include "base/cart_clock.h"
#include "base/st.h"
#include "base/sweep.h"
#include "site/job.h"
#include "site/site.h"

/* Reads all index pulses of a session of a station (`name` of its streams) and finds when the head
 * and the host saw them: the whole recording of head packets, index events and index edges through
 * clock_solve. *out_index is malloc'ed, sorted as sweep_init() wants it. If the clocks cannot be
 * matched (too few pulses, no packets), the controller's time is turned into the host's by a fit
 * through the arrival of its chunks and the edges, and the report says that no pair was found.
 * out_input names the stream's chain; out_report: what was matched, missing, spurious. ST_NOT_FOUND
 * without index events. */
ST_MUST_CHECK enum st fuse_index_read(struct site *site, int64_t station_id, const char *name,
                                      struct sweep_index **out_index, size_t *out_count,
                                      struct job_hash *out_input,
                                      struct cart_clock_report *out_report, struct errctx *err);

#endif
