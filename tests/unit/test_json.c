#include "base/fileio.h"
#include "base/json.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/tempdir.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <string.h>

static void tree_prints_in_the_order_it_was_built(void **state) {
    (void)state;
    struct json json;
    json_init_object(&json);
    struct cJSON *aloe = json_object(&json, NULL, "aloe");
    json_number(&json, aloe, "psnr_db", 29.5);
    json_number(&json, aloe, "missing", NAN);
    json_number(&json, aloe, "endless", INFINITY);
    struct cJSON *list = json_array(&json, NULL, "list");
    json_integer(&json, list, NULL, INT64_C(9223372036854775807));
    json_boolean(&json, list, NULL, true);
    json_text(&json, list, NULL, "a\"b\n");
    json_text(&json, list, NULL, NULL);
    char *text = NULL;
    assert_int_equal(json_print(&json, &text, NULL), ST_OK);
    assert_string_equal(text,
                        "{\n\t\"aloe\":\t{\n\t\t\"psnr_db\":\t29.5,\n\t\t\"missing\":\tnull,\n"
                        "\t\t\"endless\":\tnull\n\t},\n"
                        "\t\"list\":\t[9223372036854775807, true, \"a\\\"b\\n\", null]\n}\n");
    free(text);
    json_fini(&json);
}

static void numbers_come_back_exactly(void **state) {
    (void)state;
    static const double values[] = {0.1, 1.0 / 3, 1e-300, 12345678901234567.0, -0.0, 5e-324};
    struct json json;
    json_init_array(&json);
    for (size_t i = 0; i < 6; i++)
        json_number(&json, NULL, NULL, values[i]);
    char *text = NULL;
    assert_int_equal(json_print(&json, &text, NULL), ST_OK);
    struct cJSON *back = cJSON_Parse(text);
    assert_non_null(back);
    for (int i = 0; i < 6; i++)
        assert_true(cJSON_GetArrayItem(back, i)->valuedouble == values[i]);
    cJSON_Delete(back);
    free(text);
    json_fini(&json);
}

static void bytes_that_are_not_utf8_do_not_break_the_output(void **state) {
    (void)state;
    struct json json;
    json_init_array(&json);
    json_text(&json, NULL, NULL,
              "\xc3\xa9 \xff \xc3( \xed\xa0\x80 \xe2\x82\xac \xf0\x9f\x98\x80 \xc0\xaf \xe2\x82");
    char *text = NULL;
    assert_int_equal(json_print(&json, &text, NULL), ST_OK);
    assert_string_equal(text, "[\"\xc3\xa9 ? ?( ??? \xe2\x82\xac \xf0\x9f\x98\x80 ?? ??\"]\n");
    free(text);
    json_fini(&json);
}

static void misplaced_item_fails_the_document(void **state) {
    (void)state;
    struct json json = {NULL, true};
    json_number(&json, NULL, "x", 1);
    char *text = NULL;
    struct errctx err = {0};
    assert_int_equal(json_print(&json, &text, &err), ST_NOMEM);
    assert_null(text);
    json_fini(&json);
}

static void writes_to_streams_and_files_and_reports_full_disks(void **state) {
    (void)state;
    struct json json;
    struct errctx err = {0};
    json_init_object(&json);
    json_integer(&json, NULL, "n", -5);
    char buffer[64] = "";
    FILE *memory = fmemopen(buffer, sizeof buffer, "w");
    assert_non_null(memory);
    assert_int_equal(json_write(&json, memory, &err), ST_OK);
    (void)fclose(memory);
    assert_string_equal(buffer, "{\n\t\"n\":\t-5\n}\n");
    FILE *full = fopen("/dev/full", "w");
    assert_non_null(full);
    assert_int_equal(json_write(&json, full, &err), ST_IO);
    (void)fclose(full);
    char dir[TEMPDIR_MAX], path[FILEIO_PATH_MAX];
    assert_true(tempdir_make(dir));
    assert_int_equal(fileio_join(dir, "a.json", path, &err), ST_OK);
    assert_int_equal(json_write_file(&json, path, &err), ST_OK);
    uint64_t bytes = 0;
    assert_int_equal(fileio_size(path, &bytes, &err), ST_OK);
    assert_int_equal(bytes, strlen(buffer));
    tempdir_remove(dir);
    json_fini(&json);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tree_prints_in_the_order_it_was_built),
        cmocka_unit_test(numbers_come_back_exactly),
        cmocka_unit_test(bytes_that_are_not_utf8_do_not_break_the_output),
        cmocka_unit_test(misplaced_item_fails_the_document),
        cmocka_unit_test(writes_to_streams_and_files_and_reports_full_disks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
