/* libgpiod 2.x: one request holds all lines, the kernel numbers the edges of each. */
#include "capture/backends/lines_gpiod.h"

#include <errno.h>
#include <gpiod.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { EVENTS = 64, KERNEL_EVENTS = 1024, PATH_BYTES = 300, CHIPS_MAX = 256 };

struct lines_gpiod_v2 {
    struct lines lines;
    char chip_name[64];
    struct gpiod_chip *chip;
    struct gpiod_line_request *request;
    struct gpiod_edge_event_buffer *events;
    size_t line_count; /* of the chip */
    bool wired[LINES_COUNT];
    unsigned offset[LINES_COUNT];
    unsigned long seen[LINES_COUNT]; /* the kernel's number of the last edge, from 1 */
    struct lines_stats stats;
};

static struct lines_gpiod_v2 *of(struct lines *lines) {
    return (struct lines_gpiod_v2 *)lines;
}

static enum st v2_levels(struct lines *lines, struct lines_levels *out_levels, struct errctx *err) {
    struct lines_gpiod_v2 *g = of(lines);
    struct lines_levels levels = {0, 0};
    for (unsigned i = 0; i < LINES_COUNT; i++) {
        if (!g->wired[i])
            continue;
        enum gpiod_line_value value = gpiod_line_request_get_value(g->request, g->offset[i]);
        if (value == GPIOD_LINE_VALUE_ERROR)
            return lines_gpiod_failed(errno, g->chip_name, NULL, err);
        levels.wired = (uint8_t)(levels.wired | 1u << i);
        levels.high = (uint8_t)(levels.high | (value == GPIOD_LINE_VALUE_ACTIVE ? 1u : 0u) << i);
    }
    *out_levels = levels;
    return ST_OK;
}

static void hand_over(struct lines_gpiod_v2 *g, struct gpiod_edge_event *event,
                      const struct lines_sink *sink) {
    unsigned offset = gpiod_edge_event_get_line_offset(event), line = 0;
    while (line < LINES_COUNT && !(g->wired[line] && g->offset[line] == offset))
        line++;
    if (line == LINES_COUNT)
        return;
    unsigned long number = gpiod_edge_event_get_line_seqno(event);
    if (number > g->seen[line] + 1)
        g->stats.lost += number - g->seen[line] - 1;
    g->seen[line] = number;
    g->stats.edges[line]++;
    struct edge_record edge = {.t_ns = (int64_t)gpiod_edge_event_get_timestamp_ns(event),
                               .seq = (uint32_t)(number - 1),
                               .line = (uint8_t)line,
                               .rising = gpiod_edge_event_get_event_type(event) ==
                                         GPIOD_EDGE_EVENT_RISING_EDGE};
    sink->edge(sink->ctx, &edge);
}

static enum st v2_pump(struct lines *lines, unsigned timeout_ms, const struct lines_sink *sink,
                       struct errctx *err) {
    struct lines_gpiod_v2 *g = of(lines);
    int64_t timeout_ns = (int64_t)timeout_ms * 1000000;
    for (int round = 0; round < KERNEL_EVENTS / EVENTS; round++) {
        int ready = gpiod_line_request_wait_edge_events(g->request, round ? 0 : timeout_ns);
        if (ready < 0 && errno == EINTR)
            return ST_OK;
        int n = ready > 0
                    ? gpiod_line_request_read_edge_events(g->request, g->events, (size_t)EVENTS)
                    : ready;
        if (n < 0)
            return lines_gpiod_failed(errno, g->chip_name, NULL, err);
        for (int i = 0; i < n; i++)
            hand_over(g, gpiod_edge_event_buffer_get_event(g->events, (unsigned long)i), sink);
        if (!n)
            break;
    }
    return ST_OK;
}

static void v2_stats(const struct lines *lines, struct lines_stats *out_stats) {
    *out_stats = ((const struct lines_gpiod_v2 *)lines)->stats;
}

static void v2_close(struct lines *lines) {
    struct lines_gpiod_v2 *g = of(lines);
    if (g->request)
        gpiod_line_request_release(g->request);
    if (g->events)
        gpiod_edge_event_buffer_free(g->events);
    if (g->chip)
        gpiod_chip_close(g->chip);
    free(g);
}

static const struct lines_ops v2_ops = {
    .levels = v2_levels, .pump = v2_pump, .stats = v2_stats, .close = v2_close};

/* --- opening ---------------------------------------------------------------------------------- */

static bool has_label(struct gpiod_chip *chip, const char *label) {
    struct gpiod_chip_info *info = gpiod_chip_get_info(chip);
    bool same = info && !strcmp(gpiod_chip_info_get_label(info), label);
    if (info)
        gpiod_chip_info_free(info);
    return same;
}

/* The chip with that label, NULL with errno: EACCES if one could not be looked at. */
static struct gpiod_chip *open_by_label(const char *label) {
    int error = ENOENT;
    for (int i = 0; i < CHIPS_MAX; i++) {
        char path[PATH_BYTES];
        (void)snprintf(path, sizeof path, "/dev/gpiochip%d", i);
        errno = 0;
        struct gpiod_chip *chip = gpiod_is_gpiochip_device(path) ? gpiod_chip_open(path) : NULL;
        if (chip && has_label(chip, label))
            return chip;
        if (chip)
            gpiod_chip_close(chip);
        else if (errno == EACCES || errno == EPERM)
            error = errno;
    }
    errno = error;
    return NULL;
}

static struct gpiod_chip *open_chip(const char *chip) {
    char path[PATH_BYTES];
    int n = snprintf(path, sizeof path, *chip == '/' ? "%s" : "/dev/%s", chip);
    if (n > 0 && n < (int)sizeof path && gpiod_is_gpiochip_device(path))
        return gpiod_chip_open(path);
    return open_by_label(chip);
}

static enum gpiod_line_bias bias_of(enum lines_gpiod_bias bias) {
    static const enum gpiod_line_bias to[] = {[LINES_GPIOD_BIAS_AS_IS] = GPIOD_LINE_BIAS_AS_IS,
                                              [LINES_GPIOD_BIAS_NONE] = GPIOD_LINE_BIAS_DISABLED,
                                              [LINES_GPIOD_BIAS_PULL_UP] = GPIOD_LINE_BIAS_PULL_UP,
                                              [LINES_GPIOD_BIAS_PULL_DOWN] =
                                                  GPIOD_LINE_BIAS_PULL_DOWN};
    return to[bias];
}

static enum st add_line(struct lines_gpiod_v2 *g, unsigned line, const char *name,
                        enum lines_gpiod_bias bias, struct gpiod_line_config *lines,
                        struct errctx *err) {
    int offset = gpiod_chip_get_line_offset_from_name(g->chip, name);
    if (offset >= 0)
        g->offset[line] = (unsigned)offset;
    else if (!lines_gpiod_number(name, &g->offset[line]) || g->offset[line] >= g->line_count)
        return lines_gpiod_failed(ENOENT, g->chip_name, name, err);
    struct gpiod_line_settings *settings = gpiod_line_settings_new();
    bool good = settings &&
                !gpiod_line_settings_set_direction(settings, GPIOD_LINE_DIRECTION_INPUT) &&
                !gpiod_line_settings_set_edge_detection(settings, lines_gpiod_both_edges(line)
                                                                      ? GPIOD_LINE_EDGE_BOTH
                                                                      : GPIOD_LINE_EDGE_RISING) &&
                !gpiod_line_settings_set_bias(settings, bias_of(bias)) &&
                !gpiod_line_settings_set_event_clock(settings, GPIOD_LINE_CLOCK_MONOTONIC) &&
                !gpiod_line_config_add_line_settings(lines, &g->offset[line], 1, settings);
    int error = settings ? errno : ENOMEM;
    if (settings)
        gpiod_line_settings_free(settings);
    g->wired[line] = good;
    return good ? ST_OK : lines_gpiod_failed(error, g->chip_name, name, err);
}

static const char *last_name(const struct lines_gpiod_config *config) {
    const char *name = NULL;
    for (int i = 0; i < LINES_COUNT; i++)
        name = config->line[i] ? config->line[i] : name;
    return name;
}

static size_t count_lines(struct gpiod_chip *chip) {
    struct gpiod_chip_info *info = gpiod_chip_get_info(chip);
    size_t count = info ? gpiod_chip_info_get_num_lines(info) : 0;
    if (info)
        gpiod_chip_info_free(info);
    return count;
}

static enum st request_lines(struct lines_gpiod_v2 *g, const struct lines_gpiod_config *config,
                             struct errctx *err) {
    g->line_count = count_lines(g->chip);
    struct gpiod_line_config *lines = gpiod_line_config_new();
    struct gpiod_request_config *how = gpiod_request_config_new();
    g->events = gpiod_edge_event_buffer_new((size_t)EVENTS);
    enum st st =
        lines && how && g->events ? ST_OK : lines_gpiod_failed(ENOMEM, g->chip_name, NULL, err);
    for (unsigned i = 0; i < LINES_COUNT && !st; i++)
        if (config->line[i])
            st = add_line(g, i, config->line[i], config->bias, lines, err);
    if (!st) {
        gpiod_request_config_set_consumer(how, "scancart");
        gpiod_request_config_set_event_buffer_size(how, (size_t)KERNEL_EVENTS);
        g->request = gpiod_chip_request_lines(g->chip, how, lines);
        if (!g->request)
            st = lines_gpiod_failed(errno, g->chip_name, last_name(config), err);
    }
    if (how)
        gpiod_request_config_free(how);
    if (lines)
        gpiod_line_config_free(lines);
    return st;
}

enum st lines_gpiod_open(const struct lines_gpiod_config *config, struct lines **out_lines,
                         struct errctx *err) {
    enum st st = lines_gpiod_check(config, err);
    if (st)
        return st;
    struct lines_gpiod_v2 *g = calloc(1, sizeof *g);
    if (!g)
        return errctx_set(err, ST_NOMEM, "no memory for the lines");
    g->lines.ops = &v2_ops;
    strncpy(g->chip_name, config->chip, sizeof g->chip_name - 1);
    g->chip = open_chip(config->chip);
    st = g->chip ? request_lines(g, config, err)
                 : lines_gpiod_failed(errno, g->chip_name, NULL, err);
    if (st)
        v2_close(&g->lines);
    else
        *out_lines = &g->lines;
    return st;
}
