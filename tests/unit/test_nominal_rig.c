/* The record in calibration/ is the rig that the code calls nominal. */
#include "base/fileio.h"
#include "base/rig_yaml.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdlib.h>

static void the_record_is_the_nominal_rig(void **state) {
    (void)state;
    static const char path[] = SCANCART_SOURCE_DIR "/calibration/nominal-rig.yaml";
    uint8_t *text = NULL;
    size_t size = 0;
    struct rig read, nominal = rig_nominal();
    assert_int_equal(fileio_read(path, RIG_YAML_MAX_BYTES, &text, &size, NULL), ST_OK);
    assert_int_equal(rig_yaml_read((const char *)text, size, path, &read, NULL), ST_OK);
    char a[RIG_YAML_MAX_BYTES], b[RIG_YAML_MAX_BYTES];
    assert_int_equal(rig_yaml_write(&read, a, sizeof a), ST_OK);
    assert_int_equal(rig_yaml_write(&nominal, b, sizeof b), ST_OK);
    assert_string_equal(a, b);
    free(text);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(the_record_is_the_nominal_rig)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
