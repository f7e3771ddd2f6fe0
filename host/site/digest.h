/* Tables and their digests. The digest of a table is its row count and the sum of its row hashes
 * (row.h) modulo 2^256, so that adding or removing a row costs O(1) and a missing or exchanged row
 * is found. Only for host/site. */
#ifndef SC_SITE_DIGEST_H
#define SC_SITE_DIGEST_H

#include "base/hash.h"
#include "base/st.h"
#include "site/site.h"

#include <stdbool.h>
#include <stdint.h>

/* Tables with row hashes, in the order in which they are made and checked: what is referred to
 * comes first. */
enum store_table {
    STORE_SITE,
    STORE_GEOREF,
    STORE_STATION,
    STORE_STATION_POSE,
    STORE_CALIB,
    STORE_STREAM,
    STORE_CHUNK,
    STORE_LEDGER,
    STORE_FILE,
    STORE_FRAME,
    STORE_JOB,
    STORE_JOB_HASH,
    STORE_PHOTO,
    STORE_CUSTODY,
    STORE_TABLES
};

struct digest {
    int64_t rows;
    uint8_t sum[HASH_SHA256_BYTES]; /* little-endian */
    bool dirty;                     /* differs from what is stored */
};

void digest_add(struct digest *digest, const uint8_t row_sha256[HASH_SHA256_BYTES]);
void digest_remove(struct digest *digest, const uint8_t row_sha256[HASH_SHA256_BYTES]);
bool digest_equal(const struct digest *a, const struct digest *b);

/* As stored. ST_DAMAGED if a digest does not match its own hash or is missing. */
ST_MUST_CHECK enum st digest_read(struct site *site, enum store_table table,
                                  struct digest *out_digest, struct errctx *err);
ST_MUST_CHECK enum st digest_load(struct site *site, struct digest out_digests[STORE_TABLES],
                                  struct errctx *err);
/* Writes the dirty ones within a batch. */
ST_MUST_CHECK enum st digest_save(struct site *site, struct errctx *err);

/* SHA-256 over the digests of all tables but custody: what a seal names. */
ST_MUST_CHECK enum st digest_seal(const struct digest digests[STORE_TABLES],
                                  uint8_t out_sha256[HASH_SHA256_BYTES]);

#endif
