/* A small site with something in every table, for tests. */
#ifndef SC_TESTS_SITE_SAMPLE_H
#define SC_TESTS_SITE_SAMPLE_H

#include "base/pose.h"
#include "base/st.h"
#include "site/site.h"
#include "site/station.h"
#include "site/stream.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Fixed time of all rows, ns since 1970. */
#define SITE_SAMPLE_UTC_NS INT64_C(1700000000000000000)

/* A pose somewhere, from "test". */
struct station_pose site_sample_pose(double angle_rad);

/* Payload bytes that depend on `seed`, half of them compressible. */
void site_sample_bytes(uint64_t seed, uint8_t *out_bytes, size_t size);

/* A chunk of `count` items from number `first` on. */
struct stream_chunk site_sample_chunk(int64_t first, int64_t count, const void *payload,
                                      size_t size);

/* Makes a station "stand" with a stream "head" in an open site; returns the stream's id through
 * out_id. */
ST_MUST_CHECK enum st site_sample_stream(struct site *site, int32_t zstd_level, int64_t *out_id,
                                         struct errctx *err);

/* Makes and closes the whole site at `path`. */
ST_MUST_CHECK enum st site_sample_make(const char *path, struct errctx *err);

/* Reads everything that commands read, whatever it is worth; the sanitizers look on. False if a
 * reader of a stream does not come to an end. */
bool site_sample_read_all(const char *path);

#endif
