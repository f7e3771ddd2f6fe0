#define _GNU_SOURCE /* posix_openpt and friends */
#include "base/clock.h"
#include "base/log.h"
#include "base/progress.h"
#include "tests/support/cmocka_all.h"

#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const int64_t second_ns = 1000000000;

static void text_shows_share_count_and_remaining_time(void **state) {
    (void)state;
    struct progress p;
    progress_init(&p, NULL, "fuse", 400, "tiles");
    char text[128];
    progress_text(&p, 100, 10 * second_ns, text, sizeof text);
    assert_string_equal(text, "fuse  [######..................]  25 %  100/400 tiles  0:30 left");
    progress_text(&p, 0, 10 * second_ns, text, sizeof text);
    assert_string_equal(text, "fuse  [........................]   0 %  0/400 tiles  -:-- left");
    progress_text(&p, 400, 3723 * second_ns, text, sizeof text);
    assert_string_equal(text, "fuse  [########################] 100 %  400/400 tiles  1:02:03");
    progress_text(&p, 500, second_ns, text, sizeof text); /* more than promised */
    assert_non_null(strstr(text, "100 %"));
}

static void unknown_total_shows_no_promise(void **state) {
    (void)state;
    struct progress p;
    progress_init(&p, NULL, "capture", 0, "samples");
    char text[128];
    progress_text(&p, 12345, 65 * second_ns, text, sizeof text);
    assert_string_equal(text, "capture  12345 samples  1:05");
}

static void long_labels_stay_on_the_line(void **state) {
    (void)state;
    struct progress p;
    char label[201], text[300];
    memset(label, 'x', 200);
    label[200] = '\0';
    progress_init(&p, NULL, label, 10, "things");
    progress_text(&p, 5, second_ns, text, sizeof text);
    assert_int_equal(strlen(text), 79);
}

static void writes_nothing_where_there_is_no_terminal(void **state) {
    (void)state;
    char buffer[256] = "";
    FILE *out = fmemopen(buffer, sizeof buffer, "w");
    assert_non_null(out);
    struct progress p;
    progress_init(&p, out, "x", 3, "things");
    for (int i = 0; i < 3; i++)
        progress_add(&p, 1);
    progress_fini(&p, true);
    (void)fclose(out);
    assert_string_equal(buffer, "");
    progress_add(NULL, 1);
    progress_fini(NULL, true);
}

/* What a terminal shows arrives in pieces: reads until the line has ended. */
static void read_line(int fd, char *out_text, size_t size) {
    size_t used = 0;
    struct pollfd wait = {.fd = fd, .events = POLLIN};
    while (used + 1 < size && !strchr(out_text, '\n') && poll(&wait, 1, 5000) == 1) {
        ssize_t n = read(fd, out_text + used, size - 1 - used);
        if (n <= 0)
            return;
        used += (size_t)n;
        out_text[used] = '\0';
    }
}

static void terminal_gets_few_lines_and_the_last_state(void **state) {
    (void)state;
    int master = posix_openpt(O_RDWR | O_NOCTTY);
    if (master < 0 || grantpt(master) || unlockpt(master))
        skip(); /* no pseudo-terminals here */
    int slave = open(ptsname(master), O_RDWR | O_NOCTTY);
    FILE *out = fdopen(slave, "w");
    assert_non_null(out);
    assert_int_equal(setenv("TERM", "xterm", 1), 0);
    struct progress p;
    int64_t start_ns = clock_now_ns();
    progress_init(&p, out, "x", 100000, "things");
    for (int i = 0; i < 100000; i++)
        progress_add(&p, 1);
    progress_fini(&p, true);
    int64_t periods = (clock_now_ns() - start_ns) / (second_ns / 10);
    char text[4096] = "";
    read_line(master, text, sizeof text);
    assert_non_null(strstr(text, "100000/100000 things"));
    int draws = 0;
    for (const char *at = text; (at = strstr(at, "\rx  [")); at++)
        draws++;
    assert_in_range(draws, 2, 2 + periods);
    assert_int_equal(setenv("TERM", "dumb", 1), 0);
    progress_init(&p, out, "x", 1, "things");
    assert_null(p.out);
    (void)fclose(out);
    (void)close(master);
}

struct heard {
    int count;
    enum log_level level;
    char text[64];
};

static void hear(void *context, enum log_level level, const char *text) {
    struct heard *heard = context;
    heard->count++;
    heard->level = level;
    (void)snprintf(heard->text, sizeof heard->text, "%s", text);
}

static void log_is_silent_until_a_sink_is_set_and_filters_by_level(void **state) {
    (void)state;
    struct heard heard = {0};
    log_write(LOG_ERROR, "nobody hears %d", 1);
    assert_false(log_enabled(LOG_ERROR));
    log_set_sink(hear, &heard, LOG_WARN);
    log_write(LOG_INFO, "too fine");
    assert_int_equal(heard.count, 0);
    log_write(LOG_WARN, "%d samples lost", 7);
    assert_int_equal(heard.count, 1);
    assert_int_equal(heard.level, LOG_WARN);
    assert_string_equal(heard.text, "7 samples lost");
    assert_string_equal(log_level_name(LOG_WARN), "warning");
    log_set_sink(NULL, NULL, LOG_DEBUG);
    log_write(LOG_ERROR, "nobody again");
    assert_int_equal(heard.count, 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(text_shows_share_count_and_remaining_time),
        cmocka_unit_test(unknown_total_shows_no_promise),
        cmocka_unit_test(long_labels_stay_on_the_line),
        cmocka_unit_test(writes_nothing_where_there_is_no_terminal),
        cmocka_unit_test(terminal_gets_few_lines_and_the_last_state),
        cmocka_unit_test(log_is_silent_until_a_sink_is_set_and_filters_by_level),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
