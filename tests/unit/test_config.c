#include "base/config.h"
#include "tests/support/cmocka_all.h"

#include <cyaml/cyaml.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum colour { RED = 1, BLUE = 2 };

struct part {
    double size_m;
    int32_t count;
    char name[8];
};

struct settings {
    double speed_hz;
    uint16_t port;
    bool laser;
    enum colour colour;
    double pose[3];
    struct part part;
    struct part *parts;
    uint32_t parts_count;
    char *note;
};

static const cyaml_strval_t colours[] = {{"red", RED}, {"blue", BLUE}};
static const cyaml_schema_field_t part_fields[] = {
    CYAML_FIELD_FLOAT("size_m", CYAML_FLAG_DEFAULT, struct part, size_m),
    CYAML_FIELD_INT("count", CYAML_FLAG_OPTIONAL, struct part, count),
    CYAML_FIELD_STRING("name", CYAML_FLAG_OPTIONAL, struct part, name, 1), CYAML_FIELD_END};
static const cyaml_schema_value_t part_value = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_DEFAULT, struct part, part_fields)};
static const cyaml_schema_value_t number = {CYAML_VALUE_FLOAT(CYAML_FLAG_DEFAULT, double)};
static const cyaml_schema_field_t fields[] = {
    CYAML_FIELD_FLOAT("speed_hz", CYAML_FLAG_DEFAULT, struct settings, speed_hz),
    CYAML_FIELD_UINT("port", CYAML_FLAG_OPTIONAL, struct settings, port),
    CYAML_FIELD_BOOL("laser", CYAML_FLAG_OPTIONAL, struct settings, laser),
    CYAML_FIELD_ENUM("colour", CYAML_FLAG_OPTIONAL, struct settings, colour, colours, 2),
    CYAML_FIELD_SEQUENCE_FIXED("pose", CYAML_FLAG_OPTIONAL, struct settings, pose, &number, 3),
    CYAML_FIELD_MAPPING("part", CYAML_FLAG_OPTIONAL, struct settings, part, part_fields),
    CYAML_FIELD_SEQUENCE("parts", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, struct settings, parts,
                         &part_value, 0, 4),
    CYAML_FIELD_STRING_PTR("note", CYAML_FLAG_POINTER | CYAML_FLAG_OPTIONAL, struct settings, note,
                           0, 20),
    CYAML_FIELD_END};
static const cyaml_schema_value_t top = {
    CYAML_VALUE_MAPPING(CYAML_FLAG_POINTER, struct settings, fields)};
static const struct config_range ranges[] = {
    {"speed_hz", 0.5, 50, "Hz"}, {"parts[].size_m", 0.01, 2, "m"}, {"pose[]", -1, 1, ""}};
static const struct config_schema schema = {&top, ranges, 3};

static enum st load(const char *text, struct settings **out, struct config **out_config,
                    struct errctx *err) {
    void *value = NULL;
    enum st st = config_load_text(text, strlen(text), "rig.yaml", &schema, &value, out_config, err);
    *out = value;
    return st;
}

static void loads_every_kind_of_value(void **state) {
    (void)state;
    struct settings *s = NULL;
    struct config *config = NULL;
    struct errctx err = {0};
    const char *text = "# a comment\n"
                       "speed_hz: 4\n"
                       "port: 0x1f\n"
                       "laser: Yes\n"
                       "colour: blue\n"
                       "pose: [-1, .5, 1e-3]\n"
                       "parts:\n"
                       "  - {size_m: 0.25, count: -7, name: leg}\n"
                       "  - size_m: 1.5\n"
                       "note: \"a: b\"\n";
    if (load(text, &s, &config, &err))
        fail_msg("%s", err.text);
    assert_true(s->speed_hz == 4 && s->port == 31 && s->laser && s->colour == BLUE);
    assert_true(s->pose[0] == -1 && s->pose[1] == 0.5 && s->pose[2] == 1e-3);
    assert_int_equal(s->parts_count, 2);
    assert_true(s->parts[0].count == -7 && !strcmp(s->parts[0].name, "leg"));
    assert_true(s->parts[1].size_m == 1.5 && s->parts[1].count == 0);
    assert_string_equal(s->note, "a: b");
    assert_true(config_has(config, "parts[1].size_m") && !config_has(config, "parts[1].count"));
    assert_true(!config_has(config, "parts[2]") && !config_has(config, "part"));
    assert_true(!config_has(config, "parts[") && !config_has(config, "speed_hz.x"));
    assert_int_equal(config_line(config, "parts[1].size_m"), 9);
    assert_int_equal(config_line(config, "parts[1].count"), 9); /* the nearest that is there */
    assert_int_equal(config_fail(config, &err, "note", "too %s", "short"), ST_FORMAT);
    assert_string_equal(err.text, "rig.yaml:10: note: too short");
    config_free(&schema, s);
    config_destroy(config);
}

static void refusals_name_file_line_key_and_what_was_expected(void **state) {
    (void)state;
    static const struct {
        const char *text, *message;
    } cases[] = {
        {"speed_hz: 4\npart:\n  size_m: 1\n  sise_m: 2\n",
         "rig.yaml:4: part: no such key 'sise_m' (known: size_m, count, name)"},
        {"speed_hz: 4\n\nparts:\n  - size_m: 1\n  - size_m: 2z\n",
         "rig.yaml:5: parts[1].size_m: '2z' is not a number"},
        {"speed_hz: 4\nparts:\n  - size_m: 1\n  - size_m: 2.5\n",
         "rig.yaml:4: parts[1].size_m: 2.5 is not within 0.01..2 m"},
        {"# top\nspeed_hz: 900\n", "rig.yaml:2: speed_hz: 900 is not within 0.5..50 Hz"},
        {"speed_hz: 4\npose: [0, 0,\n  -1.5]\n", "rig.yaml:3: pose[2]: -1.5 is not within -1..1"},
        {"speed_hz: 4\npose: [0, 0]\n", "rig.yaml:2: pose: a list of 2; it must have 3"},
        {"speed_hz: nan\n", "rig.yaml:1: speed_hz: 'nan' is not a number"},
        {"speed_hz: .inf\n", "rig.yaml:1: speed_hz: '.inf' is not a number"},
        {"speed_hz: 1e999\n", "rig.yaml:1: speed_hz: 1e999 is too large a number"},
        {"speed_hz:\n", "rig.yaml:1: speed_hz: '' is not a number"},
        {"speed_hz: [4]\n", "rig.yaml:1: speed_hz: a list where a number is wanted"},
        {"speed_hz: 4\nport: 65536\n", "rig.yaml:2: port: 65536 is not within 0..65535"},
        {"speed_hz: 4\nport: -1\n", "rig.yaml:2: port: -1 is not within 0..65535"},
        {"speed_hz: 4\nport: 1.5\n", "rig.yaml:2: port: '1.5' is not a whole number"},
        {"speed_hz: 4\nport: 010\n", "rig.yaml:2: port: '010' is not a whole number"},
        {"speed_hz: 4\npart: {size_m: 1, count: 3000000000}\n",
         "rig.yaml:2: part.count: 3000000000 is not within -2147483648..2147483647"},
        {"speed_hz: 4\nlaser: maybe\n", "rig.yaml:2: laser: 'maybe' is neither true nor false"},
        {"speed_hz: 4\ncolour: green\n", "rig.yaml:2: colour: 'green' is none of: red, blue"},
        {"speed_hz: 4\ncolour: 1\n", "rig.yaml:2: colour: '1' is none of: red, blue"},
        {"speed_hz: 4\npart: {size_m: 1, name: leftmost}\n",
         "rig.yaml:2: part.name: text of 8 bytes; at most 7 are allowed"},
        {"speed_hz: 4\npart: {size_m: 1, name: ''}\n",
         "rig.yaml:2: part.name: text of 0 bytes; at least 1 are needed"},
        {"port: 4\nlaser: no\n", "rig.yaml:1: the key 'speed_hz' is missing"},
        {"speed_hz: 4\npart:\n  count: 1\n", "rig.yaml:3: part: the key 'size_m' is missing"},
        {"speed_hz: 4\nport: 1\nspeed_hz: 5\n",
         "rig.yaml:3: key 'speed_hz' is here twice (first in line 1)"},
        {"speed_hz: 4\npart: 7\n",
         "rig.yaml:2: part: a single value where a group of keys is wanted"},
        {"speed_hz: 4\nparts:\n  size_m: 7\n",
         "rig.yaml:3: parts: a group of keys where a list is wanted"},
        {"speed_hz: 4\nparts: [{size_m: 1}, {size_m: 1}, {size_m: 1}, {size_m: 1}, {size_m: 1}]\n",
         "rig.yaml:2: parts: a list of 5; it must have 0..4"},
        {"- 1\n", "rig.yaml:1: a list where a group of keys is wanted"},
        {"", "rig.yaml:1: the file is empty"},
        {"# nothing\n\n", "rig.yaml:1: the file is empty"},
        {"speed_hz: 4\n---\nspeed_hz: 5\n", "rig.yaml:2: a second document; only one is read"},
        {"speed_hz: 4\npart: &p {size_m: 1}\nparts:\n  - *p\n",
         "rig.yaml:4: an alias (*); repeat the value instead"},
        {"speed_hz: 4\nnote: \"a\\0b\"\n", "rig.yaml:2: note: a zero byte in a value"},
        {"speed_hz: 4\n[a]: 5\n", "rig.yaml:2: a key that is not a word"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct settings *s = NULL;
        struct errctx err = {0};
        assert_int_equal(load(cases[i].text, &s, NULL, &err), ST_FORMAT);
        assert_null(s);
        assert_string_equal(err.text, cases[i].message);
    }
}

static void broken_yaml_names_its_line(void **state) {
    (void)state;
    static const char *const texts[] = {"speed_hz: 4\npose: [1, 2\n\nport: 3\n",
                                        "speed_hz: 4\n\tport: 1\n", "speed_hz: \"4\nport: 1\n",
                                        "speed_hz: 4\nnote: \x01\n"};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        struct settings *s = NULL;
        struct errctx err = {0};
        assert_int_equal(load(texts[i], &s, NULL, &err), ST_FORMAT);
        int line = 0;
        assert_int_equal(sscanf(err.text, "rig.yaml:%d: not YAML: ", &line), 1);
        if (line < 1 || line > 5 || !strstr(err.text, "not YAML: "))
            fail_msg("%zu: %s", i, err.text);
        assert_null(strchr(err.text, '\n'));
    }
}

static void missing_and_oversized_files_are_refused(void **state) {
    (void)state;
    struct errctx err = {0};
    void *value = NULL;
    assert_int_equal(config_load("/nonexistent/rig.yaml", &schema, &value, NULL, &err),
                     ST_NOT_FOUND);
    assert_string_equal(err.text, "cannot read /nonexistent/rig.yaml: No such file or directory");
    char *text = calloc(1, CONFIG_MAX_BYTES + 1);
    assert_non_null(text);
    assert_int_equal(
        config_load_text(text, CONFIG_MAX_BYTES + 1, "big", &schema, &value, NULL, &err),
        ST_FORMAT);
    free(text);
    assert_null(value);
}

static void deep_nesting_is_refused_at_once(void **state) {
    (void)state;
    enum { DEPTH = 100000 };
    char *text = malloc(2 * DEPTH + 32);
    assert_non_null(text);
    int n = sprintf(text, "speed_hz: ");
    memset(text + n, '[', DEPTH);
    memset(text + n + DEPTH, ']', DEPTH);
    text[n + 2 * DEPTH] = '\0';
    struct settings *s = NULL;
    struct errctx err = {0};
    assert_int_equal(load(text, &s, NULL, &err), ST_FORMAT);
    assert_string_equal(err.text, "rig.yaml:1: nested too deeply");
    free(text);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(loads_every_kind_of_value),
        cmocka_unit_test(refusals_name_file_line_key_and_what_was_expected),
        cmocka_unit_test(broken_yaml_names_its_line),
        cmocka_unit_test(missing_and_oversized_files_are_refused),
        cmocka_unit_test(deep_nesting_is_refused_at_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
