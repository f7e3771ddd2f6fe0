/* Range samples with their directions as a stream of kind "polar", format "polar_sample.1": an item
 * is a struct polar_sample of base/sample.h, little-endian, 40 bytes. */
#ifndef SC_SITE_POLAR_CHUNK_H
#define SC_SITE_POLAR_CHUNK_H

#include "base/sample.h"
#include "base/st.h"
#include "base/vec.h"
#include "site/site.h"
#include "site/stream.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define POLAR_CHUNK_KIND   "polar"
#define POLAR_CHUNK_FORMAT "polar_sample.1"

/* Adds a stream to a station and all samples to it, in the open batch or as batches of its own.
 * meta_json may be NULL. Imported samples have no time: the chunks' times are 0. ST_INVALID for no
 * samples, and as stream_add() and stream_append(). */
ST_MUST_CHECK enum st polar_chunk_write(struct site *site, int64_t station_id, const char *name,
                                        struct vec3 origin_m, const char *meta_json,
                                        const struct polar_sample *samples, size_t count,
                                        int64_t *out_stream_id, struct errctx *err);

/* All samples of a polar stream of a station (name NULL: the first); *out_samples is malloc'ed.
 * out_stream may be NULL. ST_NOT_FOUND without one, ST_FORMAT for another format or a chunk that
 * does not hold whole samples, ST_DAMAGED, ST_NOMEM above 2^27 samples. */
ST_MUST_CHECK enum st polar_chunk_read(struct site *site, int64_t station_id, const char *name,
                                       struct polar_sample **out_samples, size_t *out_count,
                                       struct stream *out_stream, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
