/* Checksums: SHA-256 (FIPS 180-4, by libcrypto) names and chains content, CRC-32C (Castagnoli, as
 * in iSCSI, RFC 3720) finds damage cheaply. */
#ifndef SC_BASE_HASH_H
#define SC_BASE_HASH_H

#include "base/st.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { HASH_SHA256_BYTES = 32, HASH_HEX_CHARS = 65 /* with the terminating 0 */ };

/* A hash in progress, on the heap of libcrypto. */
struct hash_sha256 {
    void *context;
};
ST_MUST_CHECK enum st hash_sha256_init(struct hash_sha256 *hash);
ST_MUST_CHECK enum st hash_sha256_update(struct hash_sha256 *hash, const void *data, size_t size);
/* Writes the digest; the hash must still be released. */
ST_MUST_CHECK enum st hash_sha256_final(struct hash_sha256 *hash,
                                        uint8_t out_digest[HASH_SHA256_BYTES]);
void hash_sha256_fini(struct hash_sha256 *hash); /* takes a zeroed one or NULL */

/* All at once. ST_INTERNAL if libcrypto refuses. About 1 GB/s with SHA instructions. */
ST_MUST_CHECK enum st hash_sha256(const void *data, size_t size,
                                  uint8_t out_digest[HASH_SHA256_BYTES]);

/* Of a file's content, in pieces of 1 MiB. */
ST_MUST_CHECK enum st hash_file(const char *path, uint8_t out_digest[HASH_SHA256_BYTES],
                                uint64_t *out_bytes, struct errctx *err);

/* Lower-case hexadecimal and back; ST_FORMAT unless exactly 64 hexadecimal digits. */
void hash_to_hex(const uint8_t digest[HASH_SHA256_BYTES], char out_hex[HASH_HEX_CHARS]);
ST_MUST_CHECK enum st hash_from_hex(const char *hex, uint8_t out_digest[HASH_SHA256_BYTES]);

/* CRC-32C of data that follows data of CRC `crc` (0 at the start): crc(ab) = f(f(0, a), b).
 * "123456789" gives 0xe3069283. The processor's instruction where there is one (8 GB/s), else
 * tables (2 GB/s). No allocation; safe from any thread. */
uint32_t hash_crc32c(uint32_t crc, const void *data, size_t size);

/* The table path by itself: the oracle of the other. */
uint32_t hash_crc32c_portable(uint32_t crc, const void *data, size_t size);

#ifdef __cplusplus
}
#endif
#endif
