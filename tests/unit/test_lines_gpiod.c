/* The GPIO backend against a chip that the test controls: compiled twice, with the real
 * libgpiod 1.x under umockdev and with a stand-in for 2.x. */
#include "capture/backends/lines_gpiod.h"
#include "tests/support/chip_sim.h"
#include "tests/support/cmocka_all.h"
#ifdef TEST_UMOCK
#include "tests/support/umock.h"
#endif

#include <string.h>

enum { SEEN_MAX = 64 };

static struct edge_record seen[SEEN_MAX];
static unsigned seen_count;

static void note(void *ctx, const struct edge_record *edge) {
    (void)ctx;
    if (seen_count < SEEN_MAX)
        seen[seen_count++] = *edge;
}

static const struct lines_sink sink = {NULL, note};
static const struct lines_gpiod_config wired = {.chip = CHIP_SIM_LABEL,
                                                .line = {[EDGE_RECORD_INDEX] = "GPIO17",
                                                         [EDGE_RECORD_STROBE] = "GPIO23",
                                                         [EDGE_RECORD_ESTOP] = "GPIO27",
                                                         [EDGE_RECORD_INTERLOCK] = "2"}};

static struct lines *open_with(const struct lines_gpiod_config *config) {
    struct lines *lines = NULL;
    struct errctx err = {0};
    if (lines_gpiod_open(config, &lines, &err))
        fail_msg("%s", err.text);
    return lines;
}

static void refuses(const struct lines_gpiod_config *config, enum st st, const char *word) {
    struct lines *lines = NULL;
    struct errctx err = {0};
    enum st got = lines_gpiod_open(config, &lines, &err);
    chip_sim_deny(false);
    if (got != st || lines || !strstr(err.text, word))
        fail_msg("%s: '%s' (not %s, '%s')", st_name(got), err.text, st_name(st), word);
}

static enum st pump(struct lines *lines, struct errctx *err) {
    return lines->ops->pump(lines, 0, &sink, err);
}

static void gives_edges_with_the_chips_times(void **state) {
    (void)state;
    struct errctx err = {0};
    struct lines *lines = open_with(&wired);
    chip_sim_edge(0, true, 1000000001);
    chip_sim_edge(0, false, 1100000000); /* index: only rising edges are asked for */
    chip_sim_edge(0, true, 1250000007);
    chip_sim_edge(1, false, 1300000000); /* e-stop: both */
    chip_sim_edge(1, true, 1400000000);
    assert_int_equal(pump(lines, &err), ST_OK);
    assert_int_equal(seen_count, 4);
    int64_t index_ns[2], estop_ns[2];
    unsigned i = 0, e = 0;
    for (unsigned k = 0; k < seen_count; k++) {
        if (seen[k].line == EDGE_RECORD_INDEX) {
            assert_int_equal(seen[k].seq, i);
            assert_true(seen[k].rising);
            index_ns[i++] = seen[k].t_ns;
        } else {
            assert_int_equal(seen[k].line, EDGE_RECORD_ESTOP);
            assert_int_equal(seen[k].rising, e);
            estop_ns[e++] = seen[k].t_ns;
        }
    }
    assert_true(i == 2 && index_ns[0] == 1000000001 && index_ns[1] == 1250000007);
    assert_true(e == 2 && estop_ns[0] == 1300000000 && estop_ns[1] == 1400000000);
    struct lines_stats stats;
    lines->ops->stats(lines, &stats);
    assert_int_equal(stats.edges[EDGE_RECORD_INDEX], 2);
    assert_int_equal(stats.lost, 0);
    lines_close(lines);
}

static void gives_more_edges_than_one_read_holds(void **state) {
    (void)state;
    struct errctx err = {0};
    struct lines *lines = open_with(&wired);
    for (int i = 0; i < 40; i++)
        chip_sim_edge(3, true, i);
    assert_int_equal(pump(lines, &err), ST_OK);
    assert_int_equal(seen_count, 40);
    for (unsigned i = 0; i < 40; i++)
        assert_true(seen[i].line == EDGE_RECORD_STROBE && seen[i].t_ns == i && seen[i].seq == i);
    lines_close(lines);
}

static void tells_levels(void **state) {
    (void)state;
    struct errctx err = {0};
    struct lines_levels levels;
    struct lines *lines = open_with(&wired);
    chip_sim_level(1, true);
    chip_sim_level(2, false);
    assert_int_equal(lines->ops->levels(lines, &levels, &err), ST_OK);
    assert_int_equal(levels.wired, 0xf);
    assert_int_equal(levels.high, 1 << EDGE_RECORD_ESTOP);
    chip_sim_level(2, true);
    assert_int_equal(lines->ops->levels(lines, &levels, &err), ST_OK);
    assert_int_equal(levels.high, 1 << EDGE_RECORD_ESTOP | 1 << EDGE_RECORD_INTERLOCK);
    lines_close(lines);
}

static void what_is_not_wired_is_not_there(void **state) {
    (void)state;
    struct errctx err = {0};
    struct lines_levels levels;
    const struct lines_gpiod_config one = {.chip = "gpiochip0", .line = {"0", NULL, NULL, NULL}};
    struct lines *lines = open_with(&one);
    assert_int_equal(lines->ops->levels(lines, &levels, &err), ST_OK);
    assert_int_equal(levels.wired, 1);
    chip_sim_edge(1, true, 5);
    assert_int_equal(pump(lines, &err), ST_OK);
    assert_int_equal(seen_count, 0);
    lines_close(lines);
}

static void finds_the_chip_by_label_name_and_path(void **state) {
    (void)state;
    const char *const chips[] = {CHIP_SIM_LABEL, "gpiochip0", "/dev/gpiochip0"};
    struct lines_gpiod_config config = {.line = {"GPIO17", NULL, NULL, NULL}};
    config.chip = chips[(*(int *)*state)++ % 3];
    lines_close(open_with(&config));
}

static void refuses_absent_busy_and_forbidden(void **state) {
    (void)state;
    struct lines_gpiod_config config = wired;
    config.chip = "pinctrl-none";
    refuses(&config, ST_NOT_FOUND, "pinctrl-none");
    config = wired;
    config.line[EDGE_RECORD_STROBE] = "GPIO99";
    refuses(&config, ST_NOT_FOUND, "GPIO99");
    config.line[EDGE_RECORD_STROBE] = "99";
    refuses(&config, ST_NOT_FOUND, "'99'");
    config.line[EDGE_RECORD_STROBE] = "GPIO17";
    refuses(&config, ST_INVALID, "twice");
    config = (struct lines_gpiod_config){.chip = CHIP_SIM_LABEL};
    refuses(&config, ST_INVALID, "gpio.mirror_index");
    chip_sim_deny(true);
    refuses(&wired, ST_PERMISSION, "70-scancart.rules");
    chip_sim_busy(3);
    config = (struct lines_gpiod_config){.chip = CHIP_SIM_LABEL, .line = {"GPIO23"}};
    refuses(&config, ST_BUSY, "GPIO23");
}

static void unplugged_is_said(void **state) {
    (void)state;
    struct errctx err = {0};
    struct lines *lines = open_with(&wired);
    chip_sim_edge(0, true, 77);
    assert_int_equal(pump(lines, &err), ST_OK);
    assert_int_equal(seen_count, 1);
    chip_sim_unplug();
    assert_int_equal(pump(lines, &err), ST_DEVICE);
    assert_non_null(strstr(err.text, "unplugged"));
    lines_close(lines);
}

static void counts_what_the_kernel_dropped(void **state) {
    (void)state;
    struct errctx err = {0};
    struct lines_stats stats;
    struct lines *lines = open_with(&wired);
    chip_sim_edge(0, true, 1);
    bool can_tell = chip_sim_lose(0, 3);
    chip_sim_edge(0, true, 5);
    assert_int_equal(pump(lines, &err), ST_OK);
    lines->ops->stats(lines, &stats);
    assert_int_equal(stats.lost, can_tell ? 3 : 0);
    assert_int_equal(seen[1].seq, can_tell ? 4 : 1);
    lines_close(lines);
}

static int set_up(void **state) {
    static int round;
    *state = &round;
    seen_count = 0;
    return !chip_sim_plug();
}

static int tear_down(void **state) {
    (void)state;
    chip_sim_remove();
    return 0;
}

#define WITH_CHIP(f) cmocka_unit_test_setup_teardown(f, set_up, tear_down)

int main(int argc, char **argv) {
    (void)argc;
    (void)argv;
#ifdef TEST_UMOCK
    int skip = umock_enter(argv);
    if (skip)
        return skip;
#endif
    const struct CMUnitTest tests[] = {
        WITH_CHIP(gives_edges_with_the_chips_times),
        WITH_CHIP(gives_more_edges_than_one_read_holds),
        WITH_CHIP(tells_levels),
        WITH_CHIP(what_is_not_wired_is_not_there),
        WITH_CHIP(finds_the_chip_by_label_name_and_path),
        WITH_CHIP(finds_the_chip_by_label_name_and_path),
        WITH_CHIP(finds_the_chip_by_label_name_and_path),
        WITH_CHIP(refuses_absent_busy_and_forbidden),
        WITH_CHIP(unplugged_is_said),
        WITH_CHIP(counts_what_the_kernel_dropped),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
