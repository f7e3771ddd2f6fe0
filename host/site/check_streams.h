/* The part of site_check() that follows the chains of raw chunks and balances the ledger. Only for
 * host/site. */
#ifndef SC_SITE_CHECK_STREAMS_H
#define SC_SITE_CHECK_STREAMS_H

#include "base/hash.h"
#include "base/st.h"
#include "site/check_walk.h"
#include "site/chunk_row.h"

#include <stddef.h>
#include <stdint.h>

struct check_streams_one {
    int64_t id, next_sequence;
    uint8_t chain[HASH_SHA256_BYTES];
    bool lost; /* a damaged chunk: its link cannot be followed over the next one */
};

struct check_streams {
    struct check_streams_one *streams; /* by id */
    size_t count, capacity;
    struct chunk_row_buffer buffer;
};

/* Takes note of the row of table stream; rows come in the order of id. ST_NOMEM. */
ST_MUST_CHECK enum st check_streams_add(struct check_streams *streams, sqlite3_stmt *stmt);

/* A row of table chunk: CRC, size, place in its stream and its chain. Returns ST_NOMEM or ST_OK. */
ST_MUST_CHECK enum st check_streams_chunk(struct check_streams *streams, struct check_walk *walk,
                                          sqlite3_stmt *stmt);

/* Every item number of a stream is in a chunk or in the ledger, and not twice. */
ST_MUST_CHECK enum st check_streams_ledger(struct check_streams *streams, struct check_walk *walk);

void check_streams_fini(struct check_streams *streams);

#endif
