/* The controller's index events of a station, from its "index" stream, with the host's time. */
#ifndef SC_APP_FUSE_INDEX_H
#define SC_APP_FUSE_INDEX_H

#include "base/st.h"
#include "base/sweep.h"
#include "site/job.h"
#include "site/site.h"

/* Reads all index pulses, sorted by revolution; *out_index is malloc'ed. The controller's time is
 * turned into the host's by a fit through the arrival of its chunks, refined by the edges of the
 * "gpio" stream where there is one. out_input names the stream's chain. ST_NOT_FOUND without index
 * events. */
ST_MUST_CHECK enum st fuse_index_read(struct site *site, int64_t station_id,
                                      struct sweep_index **out_index, size_t *out_count,
                                      struct job_hash *out_input, struct errctx *err);

#endif
