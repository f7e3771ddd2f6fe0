#include "base/st.h"
#include "tests/support/cmocka_all.h"

#include <string.h>

static void every_status_has_a_name_of_its_own(void **state) {
    (void)state;
    for (int a = 0; a >= ST_INTERNAL; a--) {
        assert_string_not_equal(st_name((enum st)a), "unknown status");
        for (int b = 0; b > a; b--)
            assert_string_not_equal(st_name((enum st)a), st_name((enum st)b));
    }
}

static void message_is_kept_and_prefixed(void **state) {
    (void)state;
    struct errctx err = {0};
    assert_int_equal(errctx_set(&err, ST_FORMAT, "row %d is short", 7), ST_FORMAT);
    assert_int_equal(errctx_prefix(&err, ST_FORMAT, "%s", "scan.3d"), ST_FORMAT);
    assert_string_equal(err.text, "scan.3d: row 7 is short");
    assert_int_equal(err.st, ST_FORMAT);
    assert_int_equal(errctx_set(NULL, ST_IO, "nobody asks"), ST_IO);
    assert_int_equal(errctx_prefix(NULL, ST_IO, "nobody asks"), ST_IO);
}

static void message_stays_one_line_whatever_it_quotes(void **state) {
    (void)state;
    struct errctx err = {0};
    (void)errctx_set(&err, ST_FORMAT, "'%s' is no name", "a\nb\x1b[2J\xc3\xa9");
    assert_string_equal(err.text, "'a?b?[2J\xc3\xa9' is no name");
    (void)errctx_prefix(&err, ST_FORMAT, "x\ny");
    assert_string_equal(err.text, "x?y: 'a?b?[2J\xc3\xa9' is no name");
}

static void long_messages_are_cut_to_fit(void **state) {
    (void)state;
    struct errctx err = {0};
    char text[2000];
    memset(text, 'x', sizeof text);
    text[sizeof text - 1] = '\0';
    (void)errctx_set(&err, ST_FORMAT, "%s", text);
    assert_int_equal(strlen(err.text), sizeof err.text - 1);
    (void)errctx_prefix(&err, ST_FORMAT, "%s", text);
    assert_int_equal(strlen(err.text), sizeof err.text - 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_status_has_a_name_of_its_own),
        cmocka_unit_test(message_is_kept_and_prefixed),
        cmocka_unit_test(message_stays_one_line_whatever_it_quotes),
        cmocka_unit_test(long_messages_are_cut_to_fit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
