/* libgpiod 1.x: each line has a file of its own with its events. */
#include "capture/backends/lines_gpiod.h"

#include <errno.h>
#include <gpiod.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum {
    EVENTS = 16, /* all that the kernel keeps of a line */
    CHIPS_MAX = 256
};

struct lines_gpiod_v1 {
    struct lines lines;
    char chip_name[64];
    struct gpiod_chip *chip;
    struct gpiod_line *line[LINES_COUNT]; /* NULL: not wired */
    struct pollfd file[LINES_COUNT];      /* fd -1: not wired */
    uint32_t seq[LINES_COUNT];
    struct lines_stats stats;
};

static struct lines_gpiod_v1 *of(struct lines *lines) {
    return (struct lines_gpiod_v1 *)lines;
}

static enum st v1_levels(struct lines *lines, struct lines_levels *out_levels, struct errctx *err) {
    struct lines_gpiod_v1 *g = of(lines);
    struct lines_levels levels = {0, 0};
    for (unsigned i = 0; i < LINES_COUNT; i++) {
        if (!g->line[i])
            continue;
        int value = gpiod_line_get_value(g->line[i]);
        if (value < 0)
            return lines_gpiod_failed(errno, g->chip_name, NULL, err);
        levels.wired = (uint8_t)(levels.wired | 1u << i);
        levels.high = (uint8_t)(levels.high | (unsigned)value << i);
    }
    *out_levels = levels;
    return ST_OK;
}

/* All events that wait on one line. Returns 0 or errno. */
static int drain(struct lines_gpiod_v1 *g, unsigned line, const struct lines_sink *sink) {
    struct gpiod_line_event event[EVENTS];
    struct pollfd *file = &g->file[line];
    while (file->revents & POLLIN) {
        int n = gpiod_line_event_read_fd_multiple(file->fd, event, EVENTS);
        if (n < 0)
            return errno;
        for (int i = 0; i < n; i++) {
            struct edge_record edge = {
                .t_ns = (int64_t)event[i].ts.tv_sec * 1000000000 + event[i].ts.tv_nsec,
                .seq = g->seq[line]++,
                .line = (uint8_t)line,
                .rising = event[i].event_type == GPIOD_LINE_EVENT_RISING_EDGE};
            g->stats.edges[line]++;
            sink->edge(sink->ctx, &edge);
        }
        if (n < EVENTS || poll(file, 1, 0) < 0)
            break;
    }
    return file->revents & (POLLERR | POLLHUP | POLLNVAL) ? ENODEV : 0;
}

static enum st v1_pump(struct lines *lines, unsigned timeout_ms, const struct lines_sink *sink,
                       struct errctx *err) {
    struct lines_gpiod_v1 *g = of(lines);
    int ready = poll(g->file, LINES_COUNT, (int)timeout_ms);
    if (ready < 0 && errno != EINTR)
        return lines_gpiod_failed(errno, g->chip_name, NULL, err);
    for (unsigned i = 0; ready > 0 && i < LINES_COUNT; i++) {
        int error = g->file[i].fd >= 0 ? drain(g, i, sink) : 0;
        if (error)
            return lines_gpiod_failed(error, g->chip_name, NULL, err);
    }
    return ST_OK;
}

static void v1_stats(const struct lines *lines, struct lines_stats *out_stats) {
    *out_stats = ((const struct lines_gpiod_v1 *)lines)->stats;
}

static void v1_close(struct lines *lines) {
    struct lines_gpiod_v1 *g = of(lines);
    for (int i = 0; i < LINES_COUNT; i++)
        if (g->line[i] && g->file[i].fd >= 0)
            gpiod_line_release(g->line[i]);
    if (g->chip)
        gpiod_chip_close(g->chip);
    free(g);
}

static const struct lines_ops v1_ops = {
    .levels = v1_levels, .pump = v1_pump, .stats = v1_stats, .close = v1_close};

static int bias_flag(enum lines_gpiod_bias bias) {
    static const int flag[] = {[LINES_GPIOD_BIAS_AS_IS] = 0,
                               [LINES_GPIOD_BIAS_NONE] = GPIOD_LINE_REQUEST_FLAG_BIAS_DISABLE,
                               [LINES_GPIOD_BIAS_PULL_UP] = GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP,
                               [LINES_GPIOD_BIAS_PULL_DOWN] =
                                   GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN};
    return flag[bias];
}

static enum st take_line(struct lines_gpiod_v1 *g, unsigned line, const char *name,
                         enum lines_gpiod_bias bias, struct errctx *err) {
    unsigned number;
    struct gpiod_line *found = gpiod_chip_find_line(g->chip, name);
    if (!found && lines_gpiod_number(name, &number))
        found = gpiod_chip_get_line(g->chip, number);
    if (!found)
        return lines_gpiod_failed(errno ? errno : ENOENT, g->chip_name, name, err);
    int flags = bias_flag(bias);
    int failed = lines_gpiod_both_edges(line)
                     ? gpiod_line_request_both_edges_events_flags(found, "scancart", flags)
                     : gpiod_line_request_rising_edge_events_flags(found, "scancart", flags);
    if (failed)
        return errno == EINVAL ? errctx_set(err, ST_UNSUPPORTED, "line '%s' of %s takes no edges",
                                            name, g->chip_name)
                               : lines_gpiod_failed(errno, g->chip_name, name, err);
    g->line[line] = found;
    g->file[line].fd = gpiod_line_event_get_fd(found);
    return ST_OK;
}

/* The chip with that label, NULL with errno: EACCES if one could not be looked at. */
static struct gpiod_chip *open_by_label(const char *label) {
    int error = ENOENT;
    for (unsigned i = 0; i < CHIPS_MAX; i++) {
        char path[32];
        (void)snprintf(path, sizeof path, "/dev/gpiochip%u", i);
        if (access(path, F_OK))
            continue;
        struct gpiod_chip *chip = gpiod_chip_open(path);
        if (chip && !strcmp(gpiod_chip_label(chip), label))
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
    struct gpiod_chip *found = *chip == '/' ? gpiod_chip_open(chip) : gpiod_chip_open_by_name(chip);
    return found || errno == EACCES || errno == EPERM || *chip == '/' ? found : open_by_label(chip);
}

enum st lines_gpiod_open(const struct lines_gpiod_config *config, struct lines **out_lines,
                         struct errctx *err) {
    enum st st = lines_gpiod_check(config, err);
    if (st)
        return st;
    struct lines_gpiod_v1 *g = calloc(1, sizeof *g);
    if (!g)
        return errctx_set(err, ST_NOMEM, "no memory for the lines");
    g->lines.ops = &v1_ops;
    strncpy(g->chip_name, config->chip, sizeof g->chip_name - 1);
    for (int i = 0; i < LINES_COUNT; i++)
        g->file[i] = (struct pollfd){.fd = -1, .events = POLLIN};
    errno = 0;
    g->chip = open_chip(config->chip);
    if (!g->chip)
        st = lines_gpiod_failed(errno ? errno : ENOENT, g->chip_name, NULL, err);
    for (unsigned i = 0; i < LINES_COUNT && !st; i++)
        if (config->line[i])
            st = take_line(g, i, config->line[i], config->bias, err);
    if (st)
        v1_close(&g->lines);
    else
        *out_lines = &g->lines;
    return st;
}
