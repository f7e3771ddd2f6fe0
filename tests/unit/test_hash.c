#include "base/fileio.h"
#include "base/hash.h"
#include "base/rng.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/tempdir.h"

#include <string.h>

static void crc32c_of_check_string_is_the_published_value(void **state) {
    (void)state;
    assert_int_equal(hash_crc32c(0, "123456789", 9), 0xe3069283u);
    assert_int_equal(hash_crc32c_portable(0, "123456789", 9), 0xe3069283u);
    uint8_t zeros[32] = {0};
    assert_int_equal(hash_crc32c(0, zeros, 32), 0x8a9136aau); /* RFC 3720, appendix B.4 */
    assert_int_equal(hash_crc32c(0, NULL, 0), 0);
}

static void crc32c_paths_agree_for_any_length_and_cut(void **state) {
    (void)state;
    uint8_t data[300];
    struct rng rng = rng_make(1);
    for (size_t i = 0; i < sizeof data; i++)
        data[i] = (uint8_t)rng_u64(&rng);
    for (size_t n = 0; n < 64; n++)
        for (size_t offset = 0; offset < 9; offset++)
            assert_int_equal(hash_crc32c(7, data + offset, n),
                             hash_crc32c_portable(7, data + offset, n));
    uint32_t whole = hash_crc32c(0, data, sizeof data);
    for (size_t cut = 0; cut <= sizeof data; cut++) {
        uint32_t crc = hash_crc32c(0, data, cut);
        assert_int_equal(hash_crc32c(crc, data + cut, sizeof data - cut), whole);
    }
}

static const char abc_hex[] = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

static void sha256_of_abc_is_the_published_value(void **state) {
    (void)state;
    uint8_t digest[HASH_SHA256_BYTES];
    char hex[HASH_HEX_CHARS];
    assert_int_equal(hash_sha256("abc", 3, digest), ST_OK);
    hash_to_hex(digest, hex);
    assert_string_equal(hex, abc_hex);
    struct hash_sha256 hash;
    assert_int_equal(hash_sha256_init(&hash), ST_OK);
    assert_int_equal(hash_sha256_update(&hash, "a", 1), ST_OK);
    assert_int_equal(hash_sha256_update(&hash, "bc", 2), ST_OK);
    assert_int_equal(hash_sha256_final(&hash, digest), ST_OK);
    hash_sha256_fini(&hash);
    hash_to_hex(digest, hex);
    assert_string_equal(hex, abc_hex);
}

static void file_hash_equals_the_hash_of_its_bytes(void **state) {
    (void)state;
    char dir[TEMPDIR_MAX], path[FILEIO_PATH_MAX];
    struct errctx err = {0};
    assert_true(tempdir_make(dir));
    assert_int_equal(fileio_join(dir, "abc", path, &err), ST_OK);
    assert_int_equal(fileio_write(path, "abc", 3, &err), ST_OK);
    uint8_t digest[HASH_SHA256_BYTES];
    uint64_t bytes = 0;
    assert_int_equal(hash_file(path, digest, &bytes, &err), ST_OK);
    char hex[HASH_HEX_CHARS];
    hash_to_hex(digest, hex);
    assert_string_equal(hex, abc_hex);
    assert_int_equal(bytes, 3);
    assert_int_equal(hash_file("/nonexistent", digest, NULL, &err), ST_NOT_FOUND);
    assert_int_equal(hash_file(dir, digest, NULL, &err), ST_IO); /* a directory */
    tempdir_remove(dir);
}

static void hex_must_be_64_digits(void **state) {
    (void)state;
    uint8_t digest[HASH_SHA256_BYTES], again[HASH_SHA256_BYTES];
    char hex[80];
    assert_int_equal(hash_sha256("abc", 3, digest), ST_OK);
    assert_int_equal(hash_from_hex(abc_hex, again), ST_OK);
    assert_memory_equal(digest, again, sizeof digest);
    assert_int_equal(hash_from_hex("", again), ST_FORMAT);
    (void)snprintf(hex, sizeof hex, "%s0", abc_hex);
    assert_int_equal(hash_from_hex(hex, again), ST_FORMAT);
    (void)snprintf(hex, sizeof hex, "%s", abc_hex);
    hex[63] = '\0';
    assert_int_equal(hash_from_hex(hex, again), ST_FORMAT);
    hex[62] = 'g';
    hex[63] = '0';
    assert_int_equal(hash_from_hex(hex, again), ST_FORMAT);
    assert_memory_equal(digest, again, sizeof digest); /* not touched by failures */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(crc32c_of_check_string_is_the_published_value),
        cmocka_unit_test(crc32c_paths_agree_for_any_length_and_cut),
        cmocka_unit_test(sha256_of_abc_is_the_published_value),
        cmocka_unit_test(file_hash_equals_the_hash_of_its_bytes),
        cmocka_unit_test(hex_must_be_64_digits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
