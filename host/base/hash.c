#include "base/hash.h"

#include "base/fileio.h"

#include <errno.h>
#include <openssl/evp.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum st hash_sha256_init(struct hash_sha256 *hash) {
    hash->context = NULL;
    EVP_MD_CTX *context = EVP_MD_CTX_new();
    if (!context)
        return ST_NOMEM;
    if (EVP_DigestInit_ex(context, EVP_sha256(), NULL) != 1) {
        EVP_MD_CTX_free(context);
        return ST_INTERNAL;
    }
    hash->context = context;
    return ST_OK;
}

enum st hash_sha256_update(struct hash_sha256 *hash, const void *data, size_t size) {
    return EVP_DigestUpdate(hash->context, data, size) == 1 ? ST_OK : ST_INTERNAL;
}

enum st hash_sha256_final(struct hash_sha256 *hash, uint8_t out_digest[HASH_SHA256_BYTES]) {
    return EVP_DigestFinal_ex(hash->context, out_digest, NULL) == 1 ? ST_OK : ST_INTERNAL;
}

void hash_sha256_fini(struct hash_sha256 *hash) {
    if (!hash)
        return;
    EVP_MD_CTX_free(hash->context);
    hash->context = NULL;
}

enum st hash_sha256(const void *data, size_t size, uint8_t out_digest[HASH_SHA256_BYTES]) {
    return EVP_Digest(data, size, out_digest, NULL, EVP_sha256(), NULL) == 1 ? ST_OK : ST_INTERNAL;
}

static enum st hash_stream(FILE *file, const char *path, uint8_t *piece, size_t piece_bytes,
                           uint8_t out_digest[HASH_SHA256_BYTES], uint64_t *out_bytes,
                           struct errctx *err) {
    struct hash_sha256 hash = {NULL};
    enum st st = hash_sha256_init(&hash);
    uint64_t bytes = 0;
    size_t n = 1;
    while (!st && n > 0) {
        n = fread(piece, 1, piece_bytes, file);
        bytes += n;
        st = hash_sha256_update(&hash, piece, n);
    }
    if (!st && ferror(file))
        st = ST_IO;
    if (!st)
        st = hash_sha256_final(&hash, out_digest);
    hash_sha256_fini(&hash);
    if (st)
        return errctx_set(err, st, "cannot hash %s: %s", path, st_name(st));
    if (out_bytes)
        *out_bytes = bytes;
    return ST_OK;
}

enum st hash_file(const char *path, uint8_t out_digest[HASH_SHA256_BYTES], uint64_t *out_bytes,
                  struct errctx *err) {
    enum { PIECE_BYTES = 1 << 20 };
    FILE *file = fopen(path, "rb");
    if (!file) {
        int error = errno;
        char reason[128];
        if (strerror_r(error, reason, sizeof reason))
            (void)snprintf(reason, sizeof reason, "error %d", error);
        return errctx_set(err, fileio_status(error), "cannot read %s: %s", path, reason);
    }
    uint8_t *piece = malloc(PIECE_BYTES);
    enum st st = piece ? hash_stream(file, path, piece, PIECE_BYTES, out_digest, out_bytes, err)
                       : errctx_set(err, ST_NOMEM, "cannot hash %s: out of memory", path);
    free(piece);
    (void)fclose(file);
    return st;
}

void hash_to_hex(const uint8_t digest[HASH_SHA256_BYTES], char out_hex[HASH_HEX_CHARS]) {
    static const char digits[] = "0123456789abcdef";
    for (int i = 0; i < HASH_SHA256_BYTES; i++) {
        out_hex[2 * i] = digits[digest[i] >> 4];
        out_hex[2 * i + 1] = digits[digest[i] & 15];
    }
    out_hex[2 * HASH_SHA256_BYTES] = '\0';
}

static int hex_value(char c) {
    if (c >= '0' && c <= '9')
        return c - '0';
    if (c >= 'a' && c <= 'f')
        return c - 'a' + 10;
    if (c >= 'A' && c <= 'F')
        return c - 'A' + 10;
    return -1;
}

enum st hash_from_hex(const char *hex, uint8_t out_digest[HASH_SHA256_BYTES]) {
    uint8_t digest[HASH_SHA256_BYTES];
    for (int i = 0; i < HASH_SHA256_BYTES; i++) {
        int high = hex_value(hex[2 * i]);
        int low = high < 0 ? -1 : hex_value(hex[2 * i + 1]);
        if (low < 0)
            return ST_FORMAT;
        digest[i] = (uint8_t)(high * 16 + low);
    }
    if (hex[2 * HASH_SHA256_BYTES] != '\0')
        return ST_FORMAT;
    memcpy(out_digest, digest, sizeof digest);
    return ST_OK;
}

/* Slicing by 8 (Kounavis and Berry 2005): table[k][b] is the CRC of byte b followed by k zero
 * bytes. */
static uint32_t crc_table[8][256];

static void fill_crc_table(void) {
    const uint32_t polynomial = 0x82f63b78u; /* 0x1edc6f41 with its bits reversed */
    for (uint32_t b = 0; b < 256; b++) {
        uint32_t crc = b;
        for (int bit = 0; bit < 8; bit++)
            crc = (crc >> 1) ^ (crc & 1u ? polynomial : 0u);
        crc_table[0][b] = crc;
    }
    for (int k = 1; k < 8; k++)
        for (int b = 0; b < 256; b++) {
            uint32_t crc = crc_table[k - 1][b];
            crc_table[k][b] = (crc >> 8) ^ crc_table[0][crc & 255u];
        }
}

uint32_t hash_crc32c_portable(uint32_t crc, const void *data, size_t size) {
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    (void)pthread_once(&once, fill_crc_table);
    const uint8_t *p = data;
    crc = ~crc;
    for (; size >= 8; size -= 8, p += 8) {
        uint32_t low = crc ^ ((uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 |
                              (uint32_t)p[3] << 24);
        crc = crc_table[7][low & 255u] ^ crc_table[6][low >> 8 & 255u] ^
              crc_table[5][low >> 16 & 255u] ^ crc_table[4][low >> 24] ^ crc_table[3][p[4]] ^
              crc_table[2][p[5]] ^ crc_table[1][p[6]] ^ crc_table[0][p[7]];
    }
    for (; size > 0; size--, p++)
        crc = (crc >> 8) ^ crc_table[0][(crc ^ *p) & 255u];
    return ~crc;
}

#if defined(__x86_64__) && defined(__GNUC__)
#define CRC_INSTRUCTION 1
__attribute__((target("sse4.2"))) static uint32_t crc_by_instruction(uint32_t crc, const void *data,
                                                                     size_t size) {
    const uint8_t *p = data;
    uint64_t wide = ~crc;
    for (; size >= 8; size -= 8, p += 8) {
        uint64_t word;
        memcpy(&word, p, sizeof word);
        wide = __builtin_ia32_crc32di(wide, word);
    }
    crc = (uint32_t)wide;
    for (; size > 0; size--, p++)
        crc = __builtin_ia32_crc32qi(crc, *p);
    return ~crc;
}
#endif

uint32_t hash_crc32c(uint32_t crc, const void *data, size_t size) {
#ifdef CRC_INSTRUCTION
    if (__builtin_cpu_supports("sse4.2"))
        return crc_by_instruction(crc, data, size);
#endif
    return hash_crc32c_portable(crc, data, size);
}
